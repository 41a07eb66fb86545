//! A table in memory as numbers by column, for those that reckon with it, whatever its file's format. Its errors name the place in the file.

use super::input::{BadInput, did_you_mean, shorten};
use super::names::{LARGEST, is_time};
use super::table::{Cell, Source, TableError, check_size};

/// A table as numbers.
#[derive(Clone, Debug)]
pub struct Numbers {
    place: String,
    header_line: Option<u64>,
    columns: Vec<Values>,
    /// Where each row is found.
    lines: Vec<u64>,
    facts: Vec<(String, String)>,
}

#[derive(Clone, Debug)]
struct Values {
    name: String,
    /// NaN: an empty cell. Infinite: something else than a finite number.
    values: Vec<f64>,
    /// What is there instead in the first such cells, with their rows.
    odd: Vec<(usize, String)>,
}

/// Latest time of a column of times: nanoseconds since 1970, in the year 2286.
const LATEST_NS: f64 = 1e19;

/// Cells whose text is kept for an error. A column of notes, which nobody needs as numbers, has one in each row.
const MOST_ODD: usize = 1000;

impl Numbers {
    /// Reads all rows of the file `place`.
    ///
    /// # Errors
    /// Those of the source; two columns with one name.
    pub fn read(place: &str, source: &dyn Source) -> Result<Self, BadInput> {
        let heading = source.heading();
        let column = |name: &str| Values { name: name.to_owned(), values: Vec::new(), odd: Vec::new() };
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
            check_size(cells.len(), row)?;
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
            let value = match (cell, cell.number()) {
                (Cell::Absent, _) => f64::NAN,
                (_, Some(value)) => value,
                (other, None) => {
                    if column.odd.len() < MOST_ODD {
                        let text = match other {
                            Cell::Text(text) => format!("{:?}", shorten(text)),
                            _ => "no finite number".to_owned(),
                        };
                        column.odd.push((row, text));
                    }
                    f64::INFINITY
                }
            };
            column.values.push(value);
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
    /// Something else is there, or a number that is too large for anything but a time.
    pub fn maybe(&self, row: usize, column: usize) -> Result<Option<f64>, BadInput> {
        let Some(of) = self.columns.get(column) else { return Ok(None) };
        let Some(value) = of.values.get(row).copied().filter(|value| !value.is_nan()) else {
            return Ok(None);
        };
        if value.is_infinite() {
            return Err(self.bad(row, column, "no number", "a number"));
        }
        // Times say by their size what unit they have: `clock_unit`.
        let most = if is_time(&of.name) { LATEST_NS } else { LARGEST };
        if value.abs() > most {
            let expected = format!("a number from -{most:e} to {most:e}");
            return Err(self.bad(row, column, "out of range", &expected));
        }
        Ok(Some(value))
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
        let odd = of.and_then(|of| of.odd.iter().find(|(at, _)| *at == row));
        let found = match (odd, of.and_then(|of| of.values.get(row))) {
            (Some((_, text)), _) => text.clone(),
            (None, Some(value)) if value.is_infinite() => {
                let first = of.and_then(|of| of.odd.first()).map_or("text", |(_, text)| text);
                format!("no finite number; the first such cell has {first}")
            }
            (None, Some(value)) if value.abs() > 1e15 => format!("{value:e}"),
            (None, Some(value)) if value.is_finite() => value.to_string(),
            _ => "nothing".to_owned(),
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
        TableError::Input(line, bad) => BadInput {
            place: line.map_or_else(|| place.to_owned(), |line| format!("{place}:{line}")),
            ..*bad
        },
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_without_a_number_is_an_error_wherever_it_stands() {
        let csv = "time_ms,x,y\n0,a,1\n1,2,1e300\n2,NaN,3\n3,,4\n";
        let numbers = read(csv).expect("a table");
        for (row, column, words) in [
            (0, 1, "a.csv:2: x: no number\n  found:    \"a\""),
            (2, 1, "a.csv:4: x: no number\n  found:    \"NaN\""),
            (1, 2, "a.csv:3: y: out of range\n  found:    1e300"),
        ] {
            let error = numbers.maybe(row, column).expect_err(words).to_string();
            assert!(error.starts_with(words), "{error}");
        }
        assert_eq!((numbers.maybe(1, 1), numbers.maybe(3, 1)), (Ok(Some(2.0)), Ok(None)));
    }

    fn read(csv: &str) -> Result<Numbers, BadInput> {
        Numbers::read("a.csv", &crate::csv::Reader::new(csv.into()).expect("a table"))
    }

    #[test]
    fn table_is_numbers_by_column() {
        let table = read("# seed=7\ntime_ms,bus_v,note\n0,24.5,a\n1764000000000,,b\n").expect("a table");
        assert_eq!((table.place(), table.len(), table.is_empty()), ("a.csv", 2, false));
        assert_eq!(table.facts(), [("seed".to_owned(), "7".to_owned())]);
        assert_eq!(table.names().collect::<Vec<_>>(), ["time_ms", "bus_v", "note"]);
        assert_eq!((table.name(1), table.name(3)), ("bus_v", ""));
        assert_eq!((table.find(&["x", "BUS_V"]), table.find(&["x"])), (Some(1), None));
        assert_eq!((table.need(&["note"], "a note"), table.number(0, 1)), (Ok(2), Ok(24.5)));
        assert_eq!(
            (table.number(1, 0), table.maybe(1, 1), table.maybe(0, 3)),
            (Ok(1.764e12), Ok(None), Ok(None))
        );
        let empty = read("x,y\n").expect("a table");
        assert!(empty.is_empty());
    }

    #[test]
    fn error_names_line_column_and_what_is_there() {
        let csv = "# a bench\nx,time_ms,note\n1e12,1,a\n1e13,1e19,\n1e16,2e19,b\n,1,c\n";
        let table = read(csv).expect("a table");
        assert_eq!((table.number(0, 0), table.number(1, 1)), (Ok(1e12), Ok(1e19)));
        for (found, words) in [
            (table.number(0, 2), "a.csv:3: note: no number\n  found:    \"a\"\n"),
            (table.number(1, 0), "a.csv:4: x: out of range\n  found:    10000000000000\n"),
            (table.number(2, 0), "a.csv:5: x: out of range\n  found:    1e16\n"),
            (table.number(2, 1), "a.csv:5: time_ms: out of range\n  found:    2e19\n"),
            (table.number(3, 0), "a.csv:6: x: an empty cell\n  found:    nothing\n"),
        ] {
            let error = found.expect_err(words).to_string();
            assert!(error.starts_with(words), "{error}");
        }
        let error = table.need(&["tim_ms"], "a trace").expect_err("no column").to_string();
        let words = "a.csv:2: no column tim_ms\n  found:    x, time_ms, note\n  expected: a trace\n  next:     did you mean time_ms?";
        assert_eq!(error, words);
        let error = read("x,X\n1,2\n").map(|_| ()).expect_err("twice").to_string();
        assert!(error.starts_with("a.csv:1: two columns have the same name\n  found:    X\n"), "{error}");
    }
}
