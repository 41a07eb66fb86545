//! Traces as CSV: `# key=value` lines, a header, then one line of numbers a row; an absent number is empty.
//!
//! The [`Writer`]'s lines end in LF and its cells are parted by commas. The [`Reader`] takes what other programs write as well: blank lines and
//! comments, quotes, blanks around cells, any line end and none after the last, semicolons and tabs, and decimal commas. What it has guessed is
//! in its notes. A column whose numbers all have the same digits after the point keeps them, so that a file that is read and written
//! again is the same.

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

/// How a file writes a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Dialect {
    delimiter: char,
    has_decimal_comma: bool,
}

/// Reads a table from CSV.
#[derive(Debug)]
pub struct Reader {
    /// The header and the rows, each a line that ends in LF.
    text: String,
    /// The line of the file of each of them; the first is 1.
    lines: Vec<u64>,
    dialect: Dialect,
    heading: Heading,
    /// Places of the columns in a line: one without a name is left out.
    places: Vec<usize>,
    notes: Vec<String>,
}

impl Reader {
    /// Reads a whole file once, to learn what its columns are. A column with a cell that is no finite number is text.
    ///
    /// # Errors
    /// No text, nothing in it, a row that is longer or shorter than the header, or decimal commas beside decimal points.
    pub fn new(bytes: Vec<u8>) -> Result<Self, TableError> {
        let text = String::from_utf8(bytes).map_err(|error| {
            let at = error.utf8_error().valid_up_to();
            TableError::File(format!("is no text of UTF-8: byte {at}"))
        })?;
        // Spreadsheets write a byte order mark.
        let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
        let mut notes = Vec::new();
        let (metadata, text, lines) = split(text, &mut notes);
        let Some(header) = text.lines().next() else {
            let expected = "a header and rows; the file is truncated";
            return Err(TableError::place(1, "", "nothing", expected));
        };
        let delimiter = delimiter(header);
        let mut reader = Self {
            dialect: Dialect { delimiter, has_decimal_comma: false },
            text,
            lines,
            heading: Heading { columns: Vec::new(), metadata },
            places: Vec::new(),
            notes,
        };
        reader.dialect.has_decimal_comma = reader.has_decimal_comma()?;
        reader.learn()?;
        if reader.dialect != (Dialect { delimiter: ',', has_decimal_comma: false }) {
            let mark = match delimiter {
                '\t' => "tabs".to_owned(),
                ',' => "commas".to_owned(),
                other => format!("{other:?}"),
            };
            let point =
                if reader.dialect.has_decimal_comma { ", and numbers have decimal commas" } else { "" };
            reader.notes.push(format!("cells are parted by {mark}{point}"));
        }
        Ok(reader)
    }

    /// The rows with their lines, the header first.
    fn records(&self) -> impl Iterator<Item = Result<(u64, csv::StringRecord), TableError>> {
        let mut builder = csv::ReaderBuilder::new();
        builder.has_headers(false).flexible(true).trim(csv::Trim::All);
        // The three that `delimiter` knows are ASCII.
        builder.delimiter(u8::try_from(self.dialect.delimiter).unwrap_or(b','));
        let records = builder.from_reader(self.text.as_bytes()).into_records();
        records.map(|record| {
            let record = record.map_err(|error| TableError::File(error.to_string()))?;
            let at = record.position().map_or(1, csv::Position::line);
            let index = usize::try_from(at).unwrap_or(usize::MAX).saturating_sub(1);
            Ok((self.lines.get(index).copied().unwrap_or(at), record))
        })
    }

    /// Whether cells have a comma where others have a point.
    fn has_decimal_comma(&self) -> Result<bool, TableError> {
        if self.dialect.delimiter == ',' {
            return Ok(false);
        }
        let mut comma = false;
        for record in self.records().skip(1) {
            let (line, record) = record?;
            let is_number = |cell: &str| cell.parse::<f64>().is_ok_and(f64::is_finite);
            comma = comma
                || record
                    .iter()
                    .any(|cell| cell.matches(',').count() == 1 && is_number(&cell.replace(',', ".")));
            let point = record.iter().find(|cell| cell.contains('.') && is_number(cell));
            if let (true, Some(found)) = (comma, point) {
                return Err(TableError::place(
                    line,
                    "",
                    found,
                    "decimal commas, as above, or points everywhere",
                ));
            }
        }
        Ok(comma)
    }

    fn learn(&mut self) -> Result<(), TableError> {
        let mut names: Vec<String> = Vec::new();
        let mut shapes: Vec<Shape> = Vec::new();
        for record in self.records() {
            let (line, record) = record?;
            if names.is_empty() {
                names = record.iter().map(str::to_owned).collect();
                shapes = names.iter().map(|name| Shape::new(name)).collect();
                continue;
            }
            if record.len() != names.len() {
                let (found, expected) = (
                    format!("{} columns", record.len()),
                    format!("{} columns, as in the header", names.len()),
                );
                return Err(TableError::place(line, "", found, expected));
            }
            for (shape, cell) in shapes.iter_mut().zip(&record) {
                shape.see(self.dialect, cell);
            }
        }
        // The index of a data frame, or what follows a mark at the end of each line.
        self.places = (0..names.len()).filter(|at| !names[*at].is_empty()).collect();
        if self.places.len() < names.len() {
            self.notes.push("a column without a name is left out".to_owned());
        }
        let columns: Vec<Column> = shapes.into_iter().map(Shape::column).collect();
        self.heading.columns = self.places.iter().map(|at| columns[*at].clone()).collect();
        Ok(())
    }
}

impl Source for Reader {
    fn heading(&self) -> &Heading {
        &self.heading
    }

    fn rows(&self, sink: &mut dyn FnMut(&[Cell]) -> Result<(), TableError>) -> Result<(), TableError> {
        for record in self.records().skip(1) {
            let (_, record) = record?;
            let texts = self.places.iter().map(|at| record.get(*at).unwrap_or_default());
            let cells = self.heading.columns.iter().zip(texts).map(|(column, cell)| match column.kind {
                _ if cell.is_empty() => Cell::Absent,
                Kind::Text => Cell::Text(cell.to_owned()),
                Kind::Int => cell.parse().map_or(Cell::Absent, Cell::Int),
                Kind::Float => number(self.dialect, cell).map_or(Cell::Absent, Cell::Float),
            });
            sink(&cells.collect::<Vec<_>>())?;
        }
        Ok(())
    }

    fn line(&self, row: u64) -> u64 {
        let index = usize::try_from(row).unwrap_or(usize::MAX);
        self.lines.get(index).copied().unwrap_or(row)
    }

    fn header_line(&self) -> Option<u64> {
        self.lines.first().copied()
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }
}

/// Parts a file into the facts before its header, and its header and rows with their lines.
fn split(text: &str, notes: &mut Vec<String>) -> (Vec<(String, String)>, String, Vec<u64>) {
    let unix =
        if text.contains('\r') { text.replace("\r\n", "\n").replace('\r', "\n") } else { text.to_owned() };
    let (mut metadata, mut kept, mut lines) = (Vec::new(), String::with_capacity(unix.len()), Vec::new());
    for (number, line) in (1..).zip(unix.lines()) {
        if line.trim_start().starts_with('#') {
            // A fact is a line of the Writer's.
            let fact = line.strip_prefix("# ").and_then(|fact| fact.split_once('='));
            metadata.extend(
                fact.filter(|_| lines.is_empty()).map(|(key, value)| (key.to_owned(), value.to_owned())),
            );
        } else if !line.trim().is_empty() {
            kept.push_str(line);
            kept.push('\n');
            lines.push(number);
        }
    }
    if !unix.ends_with('\n') && lines.len() > 1 {
        if metadata.first().is_some_and(|(key, _)| key == RECORDED_BY) {
            // A recording that was killed in the middle of a write: the rows before are whole.
            let last = kept.trim_end_matches('\n').rfind('\n').map_or(0, |at| at + 1);
            kept.truncate(last);
            lines.pop();
        } else {
            let last = unix.lines().count();
            notes.push(format!(
                "line {last} has no line end: if the file is cut off, its last number is another one"
            ));
        }
    }
    (metadata, kept, lines)
}

/// The mark between cells: the one that the header has most of, outside quotes.
fn delimiter(header: &str) -> char {
    let mut counts = [(',', 0), (';', 0), ('\t', 0)];
    let mut is_quoted = false;
    for c in header.chars() {
        is_quoted ^= c == '"';
        counts.iter_mut().filter(|(mark, _)| *mark == c && !is_quoted).for_each(|(_, count)| *count += 1);
    }
    // The first of equals: a comma.
    counts.iter().rev().max_by_key(|(_, count)| *count).map_or(',', |(mark, _)| *mark)
}

/// A cell's number, if it is one and finite.
fn number(dialect: Dialect, cell: &str) -> Option<f64> {
    let value = if dialect.has_decimal_comma { cell.replace(',', ".").parse::<f64>() } else { cell.parse() };
    value.ok().filter(|value| value.is_finite())
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

    fn see(&mut self, dialect: Dialect, text: &str) {
        if text.is_empty() {
            self.column.nullable = true;
            return;
        }
        let Some(value) = number(dialect, text) else {
            self.column.kind = Kind::Text;
            return;
        };
        self.is_int &= text.parse::<i64>().is_ok_and(|value| value.to_string() == text);
        let digits = text.split_once('.').map_or(0, |(_, digits)| digits.len());
        let digits = *self.column.decimals.get_or_insert(u8::try_from(digits).unwrap_or(u8::MAX));
        self.is_fixed = self.is_fixed && format!("{value:.*}", usize::from(digits)) == text;
    }

    fn column(self) -> Column {
        let Self { mut column, is_int, is_fixed } = self;
        if column.kind == Kind::Text {
            column.decimals = None;
            return column;
        }
        let is_int = is_int && column.decimals.is_some();
        column.kind = if is_int { Kind::Int } else { Kind::Float };
        column.decimals = column.decimals.filter(|_| is_fixed && !is_int);
        column
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(csv: &str) -> Result<Reader, TableError> {
        Reader::new(csv.as_bytes().to_vec())
    }

    fn cells(reader: &Reader) -> Vec<Vec<Cell>> {
        let mut rows = Vec::new();
        let push = &mut |row: &[Cell]| {
            rows.push(row.to_vec());
            Ok(())
        };
        reader.rows(push).expect("read before");
        rows
    }

    /// The same two rows, as programs elsewhere write them.
    #[test]
    fn dialects_are_read_alike() {
        let plain = read("time_ms,bus_v\n0,24.5\n1,-0.125\n").expect("plain");
        assert!(plain.notes().is_empty(), "{:?}", plain.notes());
        for (csv, note) in [
            ("\u{feff}time_ms,bus_v\r\n0,24.5\r\n1,-0.125\r\n", ""),
            ("time_ms,bus_v\r0,24.5\r1,-0.125\r", ""),
            ("\"time_ms\",\"bus_v\"\n\"0\",\"24.5\"\n1,-0.125\n", ""),
            ("# Made by hand\n\n  time_ms , bus_v \n0,  24.5\n#\n\n1 ,-0.125\n\n   \n", ""),
            ("time_ms,bus_v\n0,24.5\n1,-0.125", "line 3 has no line end"),
            ("# a bench\n\ntime_ms,bus_v\n0,24.5\n1,-0.125", "line 5 has no line end"),
            ("time_ms;bus_v\n0;24.5\n1;-0.125\n", "';'"),
            ("time_ms\tbus_v\n0\t24.5\n1\t-0.125\n", "tabs"),
            ("time_ms;bus_v\n0;24,5\n1;-0,125\n", "decimal commas"),
            (",time_ms,bus_v\n0,0,24.5\n1,1,-0.125\n", "without a name"),
            ("time_ms,bus_v,\n0,24.5,\n1,-0.125,\n", "without a name"),
        ] {
            let reader = read(csv).unwrap_or_else(|error| panic!("{csv:?}: {error}"));
            let numbers = |row: Vec<Cell>| row.iter().map(Cell::number).collect::<Vec<_>>();
            let rows: Vec<_> = cells(&reader).into_iter().map(numbers).collect();
            assert_eq!(rows, [[Some(0.0), Some(24.5)], [Some(1.0), Some(-0.125)]], "{csv:?}");
            let names: Vec<&str> =
                reader.heading().columns.iter().map(|column| column.name.as_str()).collect();
            assert_eq!(names, ["time_ms", "bus_v"], "{csv:?}");
            let notes = reader.notes().join("; ");
            assert_eq!(notes.is_empty(), note.is_empty(), "{csv:?}: {notes}");
            assert!(notes.contains(note), "{csv:?}: {notes}");
        }
    }

    #[test]
    fn places_are_lines_of_the_file() {
        let reader = read("# a\n\nx,y\n\n1,2\n# b\n3,4\n").expect("a table");
        assert_eq!((reader.header_line(), reader.line(1), reader.line(2)), (Some(3), 5, 7));
        for (csv, place) in [
            ("x,y\n1,2\n\n3\n", "row 4, column : found 1 columns, expected 2 columns, as in the header"),
            ("x;y\n1,5;2\n1.5;2\n", "row 3, column : found 1.5, expected decimal commas"),
            ("", "row 1, column : found nothing, expected a header"),
            ("# a=b\n", "expected a header"),
        ] {
            let error = read(csv).expect_err(csv).to_string();
            assert!(error.contains(place), "{csv:?}: {error}");
        }
        assert!(Reader::new(vec![b'a', 0xB0, b'\n']).expect_err("Latin-1").to_string().contains("byte 1"));
    }

    #[test]
    fn text_beside_numbers_is_a_column_of_text() {
        let reader = read("x,note\n1,\"a, b\"\n2,\n").expect("a table");
        assert_eq!(reader.heading().columns[1].kind, Kind::Text);
        assert_eq!(
            cells(&reader),
            [vec![Cell::Int(1), Cell::from("a, b")], vec![Cell::Int(2), Cell::Absent]]
        );
    }
}
