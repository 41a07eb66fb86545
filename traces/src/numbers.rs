//! A table in memory as numbers by column, for those that reckon with it, whatever its file's format. Its errors name the place in the file.

use super::input::{BadInput, did_you_mean, shorten};
use super::table::{Cell, Source, TableError};

/// A table as numbers.
#[derive(Clone, Debug)]
pub struct Numbers {
    place: String,
    header_line: Option<u64>,
    columns: Vec<Column>,
    /// Where each row is found.
    lines: Vec<u64>,
    facts: Vec<(String, String)>,
}

#[derive(Clone, Debug)]
struct Column {
    name: String,
    /// NaN: no number.
    values: Vec<f64>,
    /// The first cell that has something else: its row and what it says.
    odd: Option<(usize, String)>,
}

impl Numbers {
    /// Reads all rows of the file `place`.
    ///
    /// # Errors
    /// Those of the source; two columns with one name.
    pub fn read(place: &str, source: &dyn Source) -> Result<Self, BadInput> {
        let heading = source.heading();
        let column = |name: &str| Column { name: name.to_owned(), values: Vec::new(), odd: None };
        let mut numbers = Self {
            place: place.to_owned(),
            header_line: source.header_line(),
            columns: heading.columns.iter().map(|of| column(&of.name)).collect(),
            lines: Vec::new(),
            facts: heading.metadata.clone(),
        };
        for (at, own) in numbers.columns.iter().enumerate() {
            if numbers.columns[..at].iter().any(|other| other.name.eq_ignore_ascii_case(&own.name)) {
                let found = if own.name.is_empty() { "no name" } else { &own.name };
                return Err(BadInput::new(numbers.header(), "two columns have the same name")
                    .found(shorten(found))
                    .expected("each name once")
                    .next("name the columns in the first line"));
            }
        }
        let mut row = 0;
        let done = source.rows(&mut |cells| {
            row += 1;
            numbers.push(source.line(row), cells);
            Ok(())
        });
        done.map_err(|error| bad(place, error))?;
        Ok(numbers)
    }

    fn push(&mut self, line: u64, cells: &[Cell]) {
        let row = self.lines.len();
        self.lines.push(line);
        for (column, cell) in self.columns.iter_mut().zip(cells) {
            column.values.push(match cell {
                Cell::Float(_) | Cell::Int(_) | Cell::Absent => cell.number().unwrap_or(f64::NAN),
                Cell::Text(text) => match text.parse::<f64>() {
                    Ok(value) if value.is_finite() => value,
                    _ => {
                        column.odd.get_or_insert_with(|| (row, text.clone()));
                        f64::NAN
                    }
                },
            });
        }
    }

    fn header(&self) -> String {
        self.header_line.map_or_else(|| self.place.clone(), |line| format!("{}:{line}", self.place))
    }

    /// The file.
    #[must_use]
    pub fn place(&self) -> &str {
        &self.place
    }

    /// The facts of its head.
    #[must_use]
    pub fn facts(&self) -> &[(String, String)] {
        &self.facts
    }

    /// Names of the columns, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> + Clone {
        self.columns.iter().map(|column| column.name.as_str())
    }

    /// Name of a column; empty if there is none.
    #[must_use]
    pub fn name(&self, column: usize) -> &str {
        self.columns.get(column).map_or("", |column| &column.name)
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// The first column that has one of these names, in any case; the names in their order.
    #[must_use]
    pub fn find(&self, names: &[&str]) -> Option<usize> {
        names.iter().find_map(|name| self.names().position(|own| own.eq_ignore_ascii_case(name)))
    }

    /// The same, of a column that must be there.
    ///
    /// # Errors
    /// None of them is there.
    pub fn need(&self, names: &[&str], expected: &str) -> Result<usize, BadInput> {
        self.find(names).ok_or_else(|| {
            let wanted = names.first().copied().unwrap_or_default();
            BadInput::new(self.header(), format!("no column {wanted}"))
                .found(shorten(&self.names().collect::<Vec<_>>().join(", ")))
                .expected(expected)
                .next(
                    did_you_mean(wanted, self.names())
                        .unwrap_or_else(|| "name the columns in the first line".to_owned()),
                )
        })
    }

    /// A cell's number; `None` if it is empty.
    ///
    /// # Errors
    /// Something else is there.
    pub fn maybe(&self, row: usize, column: usize) -> Result<Option<f64>, BadInput> {
        let Some(of) = self.columns.get(column) else { return Ok(None) };
        let value = of.values.get(row).copied().filter(|value| value.is_finite());
        match &of.odd {
            Some((odd, _)) if *odd == row => Err(self.bad(row, column, "no number", "a number")),
            _ => Ok(value),
        }
    }

    /// A cell's number.
    ///
    /// # Errors
    /// None is there.
    pub fn number(&self, row: usize, column: usize) -> Result<f64, BadInput> {
        self.maybe(row, column)?.ok_or_else(|| self.bad(row, column, "an empty cell", "a number"))
    }

    /// An error at a cell.
    #[must_use]
    pub fn bad(&self, row: usize, column: usize, problem: &str, expected: &str) -> BadInput {
        let line = self.lines.get(row).copied().unwrap_or_default();
        let of = self.columns.get(column);
        let odd = of.and_then(|of| of.odd.as_ref()).filter(|(at, _)| *at == row);
        let value = of.and_then(|of| of.values.get(row)).filter(|value| value.is_finite());
        let found = match (odd, value) {
            (Some((_, text)), _) => format!("{:?}", shorten(text)),
            (None, Some(value)) => value.to_string(),
            (None, None) => "nothing".to_owned(),
        };
        BadInput::new(format!("{}:{line}", self.place), format!("{}: {problem}", self.name(column)))
            .found(found)
            .expected(expected)
            .next("correct this row, or leave it out")
    }

    /// An error of the whole file.
    #[must_use]
    pub fn bad_file(&self, problem: String, found: String, expected: String, next: &str) -> BadInput {
        BadInput::new(self.place.clone(), problem).found(found).expected(expected).next(next)
    }
}

/// A table's error in the file `place`.
#[must_use]
pub fn bad(place: &str, error: TableError) -> BadInput {
    let expected = "a whole table".to_owned();
    match error {
        TableError::Io(error) => BadInput::new(place, "cannot be read or written")
            .found(error.to_string())
            .expected("a file that can be read, or a place that can be written")
            .next("check the path, its rights and the free space"),
        TableError::File(found) => BadInput::new(place, "the file is no trace, or truncated or damaged")
            .found(found)
            .expected(expected)
            .next("make the file again, or choose another"),
        TableError::Place { row, column, found, expected } => BadInput::new(
            format!("{place}:{row}"),
            if column.is_empty() { "bad row".to_owned() } else { format!("column {column}") },
        )
        .found(found)
        .expected(expected)
        .next("correct the file, or make it again"),
    }
}
