//! Traces as CSV: `# key=value` lines, a header, then one line of numbers a row; an absent number is empty.
//!
//! Every line ends in LF, also the last: a file that ends elsewhere is truncated. Of a recording that was killed in the middle of a write the
//! rows before are read, as of one in MCAP. A column whose numbers all have the same digits
//! after the point keeps them, so that a file that is read and written again is the same.

use std::io::Write;

use super::names::{RECORDED_BY, unit};
use super::table::{Cell, Column, Heading, Kind, Sink, Source, TableError, check, text};

/// Writes a trace as CSV.
pub struct Writer<W: Write> {
    out: W,
    columns: Vec<Column>,
    rows: u64,
}

impl<W: Write> Writer<W> {
    /// Begins a file.
    ///
    /// # Errors
    /// Metadata that fits no line, or those of the output.
    pub fn new(mut out: W, heading: &Heading) -> Result<Self, TableError> {
        for (key, value) in &heading.metadata {
            if key.contains(['=', '\n', '\r']) || value.contains(['\n', '\r']) {
                return Err(TableError::File(format!("metadata {key} does not fit in a line of CSV")));
            }
            writeln!(out, "# {key}={value}")?;
        }
        let names: Vec<&str> = heading.columns.iter().map(|column| column.name.as_str()).collect();
        writeln!(out, "{}", names.join(","))?;
        Ok(Self { out, columns: heading.columns.clone(), rows: 0 })
    }
}

impl<W: Write> Sink for Writer<W> {
    fn row(&mut self, cells: &[Cell]) -> Result<(), TableError> {
        self.rows += 1;
        check(&self.columns, self.rows, cells)?;
        let texts = self.columns.iter().zip(cells).map(|(column, cell)| text(column, cell));
        Ok(writeln!(self.out, "{}", texts.collect::<Vec<_>>().join(","))?)
    }

    fn finish(&mut self) -> Result<(), TableError> {
        Ok(self.out.flush()?)
    }
}

/// Reads a trace from CSV.
pub struct Reader {
    text: String,
    heading: Heading,
    /// Lines before the first row.
    head_lines: usize,
}

impl Reader {
    /// Reads a whole file once, to learn what its columns are.
    ///
    /// # Errors
    /// No text, a truncated file, a line that is longer or shorter than the header, or a cell that is no finite number. The row of an
    /// error is the line.
    pub fn new(bytes: Vec<u8>) -> Result<Self, TableError> {
        let text = String::from_utf8(bytes).map_err(|_| TableError::File("is no text".to_owned()))?;
        // Spreadsheets write a byte order mark.
        let mut text = match text.strip_prefix('\u{feff}') {
            Some(rest) => rest.to_owned(),
            None => text,
        };
        let cut = text.split_off(text.rfind('\n').map_or(0, |at| at + 1));
        let lines = text.lines().count();
        let has_header = text.lines().any(|line| !line.starts_with('#'));
        let is_killed_log = has_header && text.starts_with(&format!("# {RECORDED_BY}="));
        if text.is_empty() || !cut.is_empty() && !is_killed_log {
            let last = if cut.is_empty() { "nothing".to_owned() } else { cut };
            return Err(TableError::place(
                number(lines),
                "",
                last,
                "a line that ends in LF; the file is truncated",
            ));
        }
        let mut metadata = Vec::new();
        for (index, line) in text.lines().enumerate() {
            let Some(fact) = line.strip_prefix('#') else { break };
            let fact = fact.strip_prefix(' ').and_then(|fact| fact.split_once('='));
            let Some((key, value)) = fact else {
                return Err(TableError::place(number(index), "", line, "# key=value"));
            };
            metadata.push((key.to_owned(), value.to_owned()));
        }
        let head_lines = metadata.len() + 1;
        let names = text.lines().nth(metadata.len()).unwrap_or("");
        let mut shapes: Vec<Shape> = names.split(',').map(Shape::new).collect();
        for (index, line) in text.lines().enumerate().skip(head_lines) {
            for (shape, cell) in shapes.iter_mut().zip(cells(names, index, line)?) {
                shape.see(number(index), cell)?;
            }
        }
        let columns = shapes.into_iter().map(Shape::column).collect();
        Ok(Self { heading: Heading { columns, metadata }, head_lines, text })
    }
}

impl Source for Reader {
    fn heading(&self) -> &Heading {
        &self.heading
    }

    fn rows(&self, sink: &mut dyn FnMut(&[Cell]) -> Result<(), TableError>) -> Result<(), TableError> {
        for (index, line) in self.text.lines().enumerate().skip(self.head_lines) {
            let columns = self.heading.columns.iter().zip(line.split(','));
            let row = columns.map(|(column, text)| {
                let wrong = || TableError::place(number(index), &column.name, text, "a number");
                match column.kind {
                    _ if text.is_empty() => Ok(Cell::Absent),
                    Kind::Int => text.parse().map(Cell::Int).map_err(|_| wrong()),
                    Kind::Float | Kind::Text => text.parse().map(Cell::Float).map_err(|_| wrong()),
                }
            });
            sink(&row.collect::<Result<Vec<_>, TableError>>()?)?;
        }
        Ok(())
    }
}

fn number(index: usize) -> u64 {
    u64::try_from(index + 1).unwrap_or(u64::MAX)
}

fn cells<'a>(names: &str, index: usize, line: &'a str) -> Result<impl Iterator<Item = &'a str>, TableError> {
    let (found, expected) = (line.split(',').count(), names.split(',').count());
    if found == expected {
        return Ok(line.split(','));
    }
    let (found, expected) = (format!("{found} columns"), format!("{expected} columns, as in the header"));
    Err(TableError::place(number(index), "", found, expected))
}

/// What a column is, as far as its cells have been seen.
struct Shape {
    column: Column,
    /// Whether all are integers as Rust writes them.
    is_int: bool,
    /// Whether all have `column.decimals` digits, once one has been seen.
    is_fixed: bool,
}

impl Shape {
    fn new(name: &str) -> Self {
        Self { column: Column::new(name, unit(name), Kind::Float), is_int: true, is_fixed: true }
    }

    fn see(&mut self, line: u64, text: &str) -> Result<(), TableError> {
        if text.is_empty() {
            self.column.nullable = true;
            return Ok(());
        }
        let value: f64 = text.parse().unwrap_or(f64::NAN);
        if !value.is_finite() {
            return Err(TableError::place(line, &self.column.name, text, "a finite number"));
        }
        self.is_int &= text.parse::<i64>().is_ok_and(|value| value.to_string() == text);
        let digits = text.split_once('.').map_or(0, |(_, digits)| digits.len());
        let digits = *self.column.decimals.get_or_insert(u8::try_from(digits).unwrap_or(u8::MAX));
        self.is_fixed = self.is_fixed && format!("{value:.*}", usize::from(digits)) == text;
        Ok(())
    }

    fn column(self) -> Column {
        let Self { mut column, is_int, is_fixed } = self;
        let is_int = is_int && column.decimals.is_some();
        column.kind = if is_int { Kind::Int } else { Kind::Float };
        column.decimals = column.decimals.filter(|_| is_fixed && !is_int);
        column
    }
}
