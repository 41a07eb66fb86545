//! Traces as CSV: `# key=value` lines, a header, then one line of numbers a row; an absent number is empty.
//!
//! The [`Writer`]'s lines end in LF and its cells are parted by commas. The [`Reader`] takes what other programs write as well: UTF-16, blank
//! lines and comments, quotes, blanks around cells, any line end and none after the last, `sep=`, semicolons and tabs, decimal commas and
//! typeset minus signs. What it has guessed is in its notes; what can be read in two ways is an error. A column whose numbers all have the same digits after the point keeps them, so that a file that is read and written
//! again is the same.

use std::borrow::Cow;
use std::io::Write;

use super::input::shorten;
use super::names::{RECORDED_BY, unit};
use super::table::{Cell, Column, Heading, Kind, Sink, Source, TableError, check, check_size, text};

/// Longest line, bytes: [`MOST_COLUMNS`](super::table::MOST_COLUMNS) of a hundred bytes each.
const MOST_LINE: usize = 1_000_000;

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
    /// No text, nothing in it, a row that is longer or shorter than the header, a quote over several lines, numbers that can be read in two
    /// ways, or more than [`check_size`] takes.
    pub fn new(bytes: Vec<u8>) -> Result<Self, TableError> {
        let mut notes = Vec::new();
        let text = decode(bytes, &mut notes)?;
        let Lines { metadata, text, lines, separator } = split(text, &mut notes)?;
        let Some(header) = text.lines().next() else {
            let expected = "a header and rows";
            let next = "choose another file: this one is empty or truncated";
            return Err(TableError::input(Some(1), "no header", "nothing", expected, next));
        };
        let delimiter = separator.unwrap_or_else(|| delimiter(header));
        let mut reader = Self {
            dialect: Dialect { delimiter, has_decimal_comma: false },
            text,
            lines,
            heading: Heading { columns: Vec::new(), metadata },
            places: Vec::new(),
            notes,
        };
        let names = reader.names()?;
        reader.dialect.has_decimal_comma = reader.has_decimal_comma()?;
        reader.learn(&names)?;
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
        builder.has_headers(false).flexible(true);
        // `delimiter` and `sep=` know ASCII alone.
        builder.delimiter(u8::try_from(self.dialect.delimiter).unwrap_or(b','));
        let records = builder.from_reader(self.text.as_bytes()).into_records();
        records.map(|record| {
            let mut record = record.map_err(|error| TableError::File(error.to_string()))?;
            let at = record.position().map_or(1, csv::Position::line);
            let index = usize::try_from(at).unwrap_or(usize::MAX).saturating_sub(1);
            let line = self.lines.get(index).copied().unwrap_or(at);
            if record.as_slice().contains('\n') {
                // Most often one quote too many, which takes the rest of the file for a cell.
                let quoted = record.iter().find(|cell| cell.contains('\n')).unwrap_or_default();
                let next = "close the quote, or remove the line break inside it";
                return Err(TableError::input(
                    Some(line),
                    "a quote is not closed in its line",
                    shorten(quoted),
                    "cells without line breaks",
                    next,
                ));
            }
            // Only now: an open quote in the last line is told by the line end in its cell.
            record.trim();
            Ok((line, record))
        })
    }

    /// The header's cells.
    fn names(&self) -> Result<Vec<String>, TableError> {
        let Some(header) = self.records().next() else { return Ok(Vec::new()) };
        let (line, header) = header?;
        check_size(header.len(), 0)?;
        let is_number = |cell: &str| cell.is_empty() || plain(self.dialect, cell).parse::<f64>().is_ok();
        if header.iter().all(is_number) && header.iter().any(|cell| !cell.is_empty()) {
            let found = shorten(&header.iter().collect::<Vec<_>>().join(", "));
            let next = "write the columns' names above the rows, without # before them";
            return Err(TableError::input(
                Some(line),
                "the header has no names",
                found,
                "names of columns, such as time_ms",
                next,
            ));
        }
        Ok(header.iter().map(str::to_owned).collect())
    }

    /// Whether cells have a comma where others have a point.
    fn has_decimal_comma(&self) -> Result<bool, TableError> {
        if self.dialect.delimiter == ',' {
            return Ok(false);
        }
        let (mut comma, mut point, mut grouped) = (None, None, None);
        for record in self.records().skip(1) {
            let (line, record) = record?;
            for cell in &record {
                let seen = match mark(cell) {
                    Some(Mark::Comma) => &mut comma,
                    Some(Mark::Point) => &mut point,
                    Some(Mark::Grouped) => &mut grouped,
                    None => continue,
                };
                if seen.is_none() {
                    *seen = Some((line, cell.to_owned()));
                }
            }
        }
        // 1,234 is a decimal only beside numbers that can be nothing else.
        match (&comma, &point, &grouped) {
            (None, None, None) | (None, Some(_), None) => Ok(false),
            (Some(_), None, _) => Ok(true),
            (None, None, Some((line, cell))) => Err(TableError::input(
                Some(*line),
                "a number can be read in two ways",
                cell,
                "numbers without separators of thousands, and a decimal point",
                "write it with a point or without the comma, as it is meant",
            )),
            (comma, Some(point), grouped) => {
                let other = comma.as_ref().or(grouped.as_ref()).unwrap_or(point);
                let (first, second) = if other.0 <= point.0 { (other, point) } else { (point, other) };
                Err(TableError::input(
                    Some(second.0),
                    "numbers have both commas and points",
                    format!("{} here, {} in line {}", second.1, first.1, first.0),
                    "one decimal mark, and no separators of thousands",
                    "write all numbers with a decimal point alone",
                ))
            }
        }
    }

    fn learn(&mut self, names: &[String]) -> Result<(), TableError> {
        let mut shapes: Vec<Shape> = names.iter().map(|name| Shape::new(name)).collect();
        for record in self.records().skip(1) {
            let (line, record) = record?;
            if record.len() != names.len() {
                return Err(ragged(line, &record, names.len(), self.dialect));
            }
            let has_numbers = |cell: &str| {
                let mut words = cell.split_whitespace();
                words.clone().count() > 1 && words.all(|word| word.parse::<f64>().is_ok())
            };
            if record.len() == 1 && record.iter().all(has_numbers) {
                let found = shorten(record.as_slice());
                let next = "write them with commas, semicolons or tabs between the cells";
                return Err(TableError::input(
                    Some(line),
                    "cells are parted by blanks",
                    found,
                    "commas, semicolons or tabs",
                    next,
                ));
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

/// A row with another number of cells than the header.
fn ragged(line: u64, record: &csv::StringRecord, names: usize, dialect: Dialect) -> TableError {
    let (found, expected) =
        (format!("{} columns", record.len()), format!("{names} columns, as in the header"));
    let ends_empty = record.iter().next_back().is_some_and(str::is_empty);
    let next = if record.len() == names + 1 && ends_empty {
        "end the header in a separator as well, or no row"
    } else if record.len() > names && dialect.delimiter == ',' {
        "part the cells by semicolons if numbers have decimal commas; otherwise correct this row"
    } else {
        "correct this row, or leave it out"
    };
    TableError::input(Some(line), "bad row", found, expected, next)
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

/// The text of a file.
fn decode(bytes: Vec<u8>, notes: &mut Vec<String>) -> Result<String, TableError> {
    let packed = match bytes.as_slice() {
        [b'P', b'K', 3, 4, ..] => Some(("a zip archive, such as .xlsx", "save the sheet as CSV")),
        [0x1F, 0x8B, ..] => Some(("bytes of gzip", "unpack it: gunzip FILE")),
        _ => None,
    };
    if let Some((found, next)) = packed {
        return Err(TableError::input(None, "the file is packed", found, "text", next));
    }
    // "Unicode text" of spreadsheets.
    let wide: Option<fn([u8; 2]) -> u16> = match bytes.as_slice() {
        [0xFF, 0xFE, ..] => Some(u16::from_le_bytes),
        [0xFE, 0xFF, ..] => Some(u16::from_be_bytes),
        _ => None,
    };
    let text = match wide {
        Some(unit) => {
            notes.push("the text is UTF-16".to_owned());
            let (pairs, odd) = bytes.as_chunks::<2>();
            let text: Result<String, _> = char::decode_utf16(pairs.iter().map(|pair| unit(*pair))).collect();
            let text = text.ok().filter(|_| odd.is_empty());
            text.ok_or_else(|| no_text(None, "bytes that are no UTF-16 after its byte order mark"))?
        }
        None => String::from_utf8(bytes).map_err(|error| {
            let at = error.utf8_error().valid_up_to();
            let byte = error.as_bytes().get(at).copied().unwrap_or_default();
            no_text(Some(line_at(error.as_bytes(), at)), &format!("byte {byte:#04x} at offset {at}"))
        })?,
    };
    if let Some(at) = text.find('\0') {
        return Err(no_text(Some(line_at(text.as_bytes(), at)), &format!("a NUL byte at offset {at}")));
    }
    Ok(text)
}

fn no_text(line: Option<u64>, found: &str) -> TableError {
    let next = "save the file as UTF-8; if a computer lost power while it wrote, remove what follows the last whole row";
    TableError::input(line, "the file is no text", found, "text in UTF-8", next)
}

/// The line of a byte.
fn line_at(bytes: &[u8], at: usize) -> u64 {
    bytes.iter().take(at).fold(1, |line, byte| line + u64::from(*byte == b'\n'))
}

/// The header and the rows of a file, each a line that ends in LF, and what stands around them.
struct Lines {
    metadata: Vec<(String, String)>,
    text: String,
    lines: Vec<u64>,
    /// What `sep=` before the header names, as spreadsheets write and read it.
    separator: Option<char>,
}

/// Parts a file into the facts before its header, and its header and rows with their lines.
fn split(text: String, notes: &mut Vec<String>) -> Result<Lines, TableError> {
    let unix = if text.contains('\r') { text.replace("\r\n", "\n").replace('\r', "\n") } else { text };
    // Spreadsheets write a byte order mark.
    let unix = unix.strip_prefix('\u{feff}').unwrap_or(&unix);
    let (mut metadata, mut kept, mut lines) = (Vec::new(), String::with_capacity(unix.len()), Vec::new());
    let mut separator = None;
    for (number, line) in (1..).zip(unix.lines()) {
        if line.len() > MOST_LINE {
            let expected = format!("{MOST_LINE} bytes at most");
            let next = "check that this is a table with a line a row";
            let found = format!("{} bytes", line.len());
            return Err(TableError::input(Some(number), "a line is too long", found, expected, next));
        }
        let mark = line.strip_prefix("sep=").filter(|_| lines.is_empty());
        if line.trim_start().starts_with(['#', '%']) {
            // A fact is a line of the Writer's.
            let fact = line.strip_prefix("# ").and_then(|fact| fact.split_once('='));
            metadata.extend(
                fact.filter(|_| lines.is_empty()).map(|(key, value)| (key.to_owned(), value.to_owned())),
            );
        } else if let Some(mark) = mark {
            separator = Some(only_mark(number, mark)?);
        } else if !line.trim().is_empty() {
            kept.push_str(line);
            kept.push('\n');
            lines.push(number);
            check_size(1, lines.len() as u64)?;
        }
    }
    if !unix.ends_with('\n') && lines.len() > 1 {
        let last = unix.lines().count();
        if metadata.first().is_some_and(|(key, _)| key == RECORDED_BY) {
            // A recording that was killed in the middle of a write: the rows before are whole.
            let begin = kept.trim_end_matches('\n').rfind('\n').map_or(0, |at| at + 1);
            kept.truncate(begin);
            lines.pop();
            notes.push(format!(
                "line {last} is left out: it has no line end, so the recording was cut off in it"
            ));
        } else {
            notes.push(format!(
                "line {last} has no line end: if the file is cut off, its last number is another one"
            ));
        }
    }
    Ok(Lines { metadata, text: kept, lines, separator })
}

/// The separator of `sep=`.
fn only_mark(line: u64, mark: &str) -> Result<char, TableError> {
    // Not trimmed: a tab is one of them.
    let mut chars = mark.chars();
    match (chars.next(), chars.next()) {
        (Some(c @ (',' | ';' | '\t' | '|')), None) => Ok(c),
        _ => Err(TableError::input(
            Some(line),
            "sep= names no separator",
            shorten(mark),
            "sep=, with a comma, a semicolon, a tab or a bar",
            "correct or remove this line",
        )),
    }
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

/// A cell as Rust writes numbers.
fn plain(dialect: Dialect, cell: &str) -> Cow<'_, str> {
    let point = if dialect.has_decimal_comma && cell.contains(',') {
        Cow::Owned(cell.replace(',', "."))
    } else {
        Cow::Borrowed(cell)
    };
    // Typeset minus signs.
    match point.strip_prefix('\u{2212}') {
        Some(rest) => Cow::Owned(format!("-{rest}")),
        None => point,
    }
}

/// A cell's number, if it is one and finite.
fn number(dialect: Dialect, cell: &str) -> Option<f64> {
    plain(dialect, cell).parse().ok().filter(|value: &f64| value.is_finite())
}

/// What stands between the digits of a number.
enum Mark {
    /// A decimal comma.
    Comma,
    /// A decimal point.
    Point,
    /// A comma before groups of three digits each: of thousands, or a decimal one.
    Grouped,
}

/// The mark of a number, if it has one.
fn mark(cell: &str) -> Option<Mark> {
    let commas = cell.matches(',').count();
    let read = |has_decimal_comma| number(Dialect { delimiter: ';', has_decimal_comma }, cell);
    let digits = cell.trim_start_matches(['-', '+', '\u{2212}']);
    let is_group = |group: &str| group.len() == 3 && group.bytes().all(|byte| byte.is_ascii_digit());
    let mut groups = digits.split(',');
    let is_first =
        |first: &str| (1..=3).contains(&first.len()) && first.bytes().all(|byte| byte.is_ascii_digit());
    // Thousands never begin with 0.
    let has_first = groups.next().is_some_and(is_first) && !digits.starts_with('0');
    if commas > 0 && has_first && groups.all(is_group) {
        Some(Mark::Grouped)
    } else if commas == 1 && read(true).is_some() {
        Some(Mark::Comma)
    } else {
        (cell.contains('.') && read(false).is_some()).then_some(Mark::Point)
    }
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
    use crate::table::tests::cells;

    fn read(csv: &str) -> Result<Reader, TableError> {
        Reader::new(csv.as_bytes().to_vec())
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
            ("time_ms;bus_v\n0;24,5\n1;\u{2212}0,125\n", "decimal commas"),
            ("sep=;\r\ntime_ms;bus_v\r\n0;24,5\r\n1;-0,125\r\n", "decimal commas"),
            ("\u{feff}sep=,\ntime_ms,bus_v\n0,24.5\n1,-0.125\n", ""),
            ("sep=|\ntime_ms|bus_v\n0|24.5\n1|-0.125\n", "'|'"),
            ("time_ms \t bus_v\n0 \t 24.5\n1\t -0.125 \n", "tabs"),
            ("time_ms,bus_v\r\n0,24.5\n1,-0.125\r", ""),
            ("time_ms,bus_v\n0,24.5\n1,\u{2212}0.125\n", ""),
            ("% made by a program\ntime_ms,bus_v\n0,24.5\n% a comment, too\n1,-0.125\n", ""),
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
    fn cut_row_of_a_recording_is_left_out_and_named() {
        let reader = read("# recorded_by=hil-sim log\ntime_ms,bus_v\n0,24.5\n1,24").expect("a recording");
        assert_eq!(cells(&reader), [[Cell::Int(0), Cell::Float(24.5)]]);
        assert_eq!(reader.notes().len(), 1);
        assert!(reader.notes()[0].starts_with("line 4 is left out"), "{:?}", reader.notes());
    }

    #[test]
    fn places_are_lines_of_the_file() {
        let reader = read("# a\n\nx,y\n\n1,2\n# b\n3,4\n").expect("a table");
        assert_eq!((reader.header_line(), reader.line(1), reader.line(2)), (Some(3), 5, 7));
        for (csv, place) in [
            ("x,y\n1,2\n\n3\n", "line 4: bad row: found 1 columns, expected 2 columns, as in the header"),
            (
                "x,y\n1,2,\n",
                "line 2: bad row: found 3 columns, expected 2 columns, as in the header; end the header",
            ),
            ("x,y\n1,5,2,5\n", "part the cells by semicolons"),
            ("", "line 1: no header: found nothing"),
            ("# a=b\n", "no header"),
            ("sep=ab\nx,y\n", "line 1: sep= names no separator: found ab"),
            ("#x,y\n1,2\n3,4\n", "line 2: the header has no names: found 1, 2"),
            ("x y\n1 2\n3 4\n", "line 2: cells are parted by blanks: found 1 2"),
            ("x,note\n1,a\n2,\"b\n\n#3\",c\n", "line 3: a quote is not closed in its line"),
            ("x,note\n1,a\n2,\"b\n3,c\n4,d\n", "line 3: a quote is not closed in its line"),
            ("\"x,note\n1,a\n", "line 1: a quote is not closed in its line"),
            ("x,y\n1,2\n\0\0\0\0", "line 3: the file is no text: found a NUL byte at offset 8"),
        ] {
            let error = read(csv).expect_err(csv).to_string();
            assert!(error.contains(place), "{csv:?}: {error}");
        }
    }

    #[test]
    fn bad_rows_say_what_to_do() {
        for (csv, next) in [
            ("x,y\n1,2,\n", "end the header in a separator"),
            ("x,y\n1,2,3\n", "part the cells by semicolons"),
            ("x,y\n1\n", "correct this row"),
            ("x,y\n1,2,3,\n", "part the cells by semicolons"),
            ("x;y\n1;2;3;4\n", "correct this row"),
        ] {
            let error = read(csv).expect_err(csv).to_string();
            assert!(error.contains(next), "{csv:?}: {error}");
        }
        for one in ["x\n1\n2\n", "note\na b\nc d\n", "note\n1 b\n"] {
            assert_eq!(read(one).expect(one).heading().columns.len(), 1);
        }
    }

    #[test]
    fn column_keeps_its_kind_and_its_digits() {
        let csv = "a,b,c,d,e,f,g\n1,24.50,1.5,007,,1e3,1\n-2,24.55,1.25,8,,2e3,2.0\n";
        let found = read(csv).expect("a table").heading().columns.clone();
        let found: Vec<_> = found.iter().map(|of| (of.kind, of.decimals, of.nullable)).collect();
        let float = (Kind::Float, None, false);
        let want = [
            (Kind::Int, None, false),
            (Kind::Float, Some(2), false),
            float,
            float,
            (Kind::Float, None, true),
            float,
            float,
        ];
        assert_eq!(found, want);
    }

    #[test]
    fn marks_in_quotes_part_no_cells() {
        for csv in ["\"a\";b\n1;2\n", "\"a,b,c\";d\n1;2\n", "\"a\"\tb\n1\t2\n"] {
            assert_eq!(cells(&read(csv).expect(csv)), [[Cell::Int(1), Cell::Int(2)]], "{csv:?}");
        }
        assert!(read("x,y").expect("a header").notes().is_empty(), "no row was cut");
    }

    /// A stream whose disk is full once the rows leave its buffer.
    struct Full;

    impl Write for Full {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Err(std::io::ErrorKind::StorageFull.into())
        }
    }

    #[test]
    fn table_is_written_as_it_is_read() {
        let text = "# motor=link\ntime_ms,bus_v,note\n0.0,24.50,a\n0.5,24.55,\n";
        let reader = read(text).expect("a table");
        let mut written = Vec::new();
        let mut writer = Writer::new(&mut written, reader.heading()).expect("begun");
        reader.rows(&mut |row| writer.row(row)).expect("written");
        let error = writer.row(&[Cell::Int(1)]).expect_err("too few cells").to_string();
        assert!(error.starts_with("row 3"), "{error}");
        writer.finish().expect("ended");
        drop(writer);
        assert_eq!(String::from_utf8_lossy(&written), text);
        let full = Writer::new(Full, reader.heading()).expect("begun").finish();
        assert!(matches!(full, Err(TableError::Io(_))), "{full:?}");
        for (key, value) in [("a=b", "c"), ("a\nb", "c"), ("a", "b\nc"), ("a", "b\rc")] {
            let metadata = vec![(key.to_owned(), value.to_owned())];
            let heading = Heading { metadata, ..reader.heading().clone() };
            let error = Writer::new(Vec::new(), &heading).map(|_| ()).expect_err("no line").to_string();
            assert!(error.contains("does not fit in a line"), "{error}");
        }
    }

    #[test]
    fn bytes_that_are_no_text_say_what_they_are() {
        for (bytes, words) in [
            (b"x,y\n1,2\xB0\n".to_vec(), "line 2: the file is no text: found byte 0xb0 at offset 7"),
            (b"PK\x03\x04rest".to_vec(), "a zip archive, such as .xlsx"),
            (b"\x1F\x8B\x08rest".to_vec(), "bytes of gzip"),
            (b"\xFF\xFEx\0,".to_vec(), "no UTF-16"),
            (b"\xFE\xFF\xD8\0\0x".to_vec(), "no UTF-16"),
            (b"x\0,\0y\0\n\0".to_vec(), "line 1: the file is no text: found a NUL byte"),
        ] {
            let error = Reader::new(bytes).expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn utf_16_of_spreadsheets_is_read() {
        let text = "\u{feff}time_ms\tbus_v\r\n0\t24,5\r\n";
        let units = || text.encode_utf16();
        for bytes in [
            units().flat_map(u16::to_le_bytes).collect::<Vec<u8>>(),
            units().flat_map(u16::to_be_bytes).collect(),
        ] {
            let reader = Reader::new(bytes).expect("text");
            assert_eq!(cells(&reader), [[Cell::Int(0), Cell::Float(24.5)]]);
            assert!(reader.notes().iter().any(|note| note.contains("UTF-16")), "{:?}", reader.notes());
        }
    }

    #[test]
    fn numbers_with_two_readings_are_refused() {
        for (csv, words) in [
            ("x;y\n999;1\n1,000;2\n", "line 3: a number can be read in two ways: found 1,000"),
            ("x;y\n1,234,567;2\n", "found 1,234,567"),
            (
                "x;y\n1,5;2\n1.5;2\n",
                "line 3: numbers have both commas and points: found 1.5 here, 1,5 in line 2",
            ),
            ("x;y\n1.500;2\n1,5;2\n", "line 3: numbers have both commas and points: found 1,5 here"),
            ("x;y\n1,500;2\n1;2.5\n", "line 3: numbers have both"),
        ] {
            let error = read(csv).expect_err(csv).to_string();
            assert!(error.contains(words), "{csv:?}: {error}");
        }
        // A number that can be nothing else tells what the others are.
        for (csv, want) in [("x\ty\n1,234\t0,5\n", 1.234), ("x;y\n0,500;7\n", 0.5)] {
            let reader = read(csv).unwrap_or_else(|error| panic!("{csv:?}: {error}"));
            assert_eq!(cells(&reader)[0][0], Cell::Float(want), "{csv:?}");
        }
    }

    #[test]
    fn tables_beyond_all_bounds_are_refused_before_they_take_memory() {
        use crate::table::MOST_COLUMNS;
        let wide = format!("{}\n", ",".repeat(MOST_COLUMNS));
        let long = format!("x\n{}\n", "1".repeat(MOST_LINE + 1));
        for (csv, words) in
            [(wide, "10001 columns, expected 10000"), (long, "line 2: a line is too long: found 1000001")]
        {
            let error = read(&csv).expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        }
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
