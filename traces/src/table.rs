//! Tables of typed, named columns, row by row: what traces, logs and sweeps are, whatever the file's format.
//!
//! A [`Sink`] takes rows and keeps at most a block of them; the formats are files of their own (`parquet.rs`).

use std::fmt;
use std::io;

use super::input::BadInput;

/// Most columns of a table: more are a file with other separators than its header, and each takes memory.
pub const MOST_COLUMNS: usize = 10_000;

/// Most rows of a table: 18 hours at 1 kHz.
pub const MOST_ROWS: u64 = 1 << 26;

/// Most cells of a table: those of a gigabyte of CSV, and 4 GiB in memory. A few bytes of Parquet can claim more.
pub const MOST_CELLS: u64 = 1 << 29;

/// What the cells of a column are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// 64-bit floating point, finite.
    Float,
    /// 64-bit integer.
    Int,
    /// Text.
    Text,
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// The name, unique in its table; that of a quantity ends in its unit (`bus_v`).
    pub name: String,
    /// The unit, such as `counts/s`; empty where there is none.
    pub unit: String,
    /// What its cells are.
    pub kind: Kind,
    /// Whether a cell may be [`Cell::Absent`].
    pub nullable: bool,
    /// Digits after the point in text formats; `None`: as many as a number needs to read back the same.
    pub decimals: Option<u8>,
}

impl Column {
    /// A column without absent cells, whose numbers are written with as many digits as they need.
    #[must_use]
    pub fn new(name: impl Into<String>, unit: impl Into<String>, kind: Kind) -> Self {
        Self { name: name.into(), unit: unit.into(), kind, nullable: false, decimals: None }
    }

    /// The same with absent cells.
    #[must_use]
    pub fn nullable(mut self) -> Self {
        self.nullable = true;
        self
    }

    /// The same with a fixed number of digits after the point in text formats.
    #[must_use]
    pub fn decimals(mut self, decimals: u8) -> Self {
        self.decimals = Some(decimals);
        self
    }
}

/// What comes before the rows of a table.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Heading {
    /// The columns, in order.
    pub columns: Vec<Column>,
    /// Facts about the whole table (seed, commit, gains), in order; keys are unique.
    pub metadata: Vec<(String, String)>,
}

impl Heading {
    /// The metadata of a key.
    #[must_use]
    pub fn fact(&self, key: &str) -> Option<&str> {
        self.metadata.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str())
    }
}

/// A cell of a table.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// No value; only in nullable columns.
    Absent,
    /// Of a column of [`Kind::Float`].
    Float(f64),
    /// Of a column of [`Kind::Int`].
    Int(i64),
    /// Of a column of [`Kind::Text`].
    Text(String),
}

impl Cell {
    /// Its number, if it has a finite one. A column of text may hold some.
    #[must_use]
    pub fn number(&self) -> Option<f64> {
        let value = match self {
            Self::Float(value) => Some(*value),
            Self::Int(value) => Some(*value as f64),
            Self::Text(text) => text.parse().ok(),
            Self::Absent => None,
        };
        value.filter(|value| value.is_finite())
    }
}

impl From<f64> for Cell {
    fn from(value: f64) -> Self {
        Self::Float(value)
    }
}

impl From<i64> for Cell {
    fn from(value: i64) -> Self {
        Self::Int(value)
    }
}

impl From<&str> for Cell {
    fn from(value: &str) -> Self {
        Self::Text(value.to_owned())
    }
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Absent, Into::into)
    }
}

/// Why a table cannot be read or written.
#[derive(Debug)]
pub enum TableError {
    /// The operating system's reason.
    Io(io::Error),
    /// The file as a whole.
    File(String),
    /// One place in it.
    Place {
        /// The row, the first is 1; for text the line.
        row: u64,
        /// The column's name; empty if the whole row is meant.
        column: String,
        /// What was found there.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// A problem with its next step, in a line of the file or in the file as a whole. Its place is empty: a reader of bytes knows no file.
    Input(Option<u64>, Box<BadInput>),
}

impl TableError {
    /// A cell that does not belong there.
    pub fn place(row: u64, column: &str, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Place { row, column: column.to_owned(), found: found.into(), expected: expected.into() }
    }

    /// A problem with its next step; `line` is `None` for the file as a whole.
    pub fn input(
        line: Option<u64>,
        problem: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
        next: impl Into<String>,
    ) -> Self {
        Self::Input(line, Box::new(BadInput::new("", problem).found(found).expected(expected).next(next)))
    }

    /// An error in reading bytes in memory: what a decoder returns as one of the operating system is damage.
    #[must_use]
    pub fn of_memory(self) -> Self {
        match self {
            Self::Io(error) => Self::File(error.to_string()),
            other => other,
        }
    }
}

/// Checks a table's size before memory is spent on it.
///
/// # Errors
/// More than [`MOST_COLUMNS`], [`MOST_ROWS`] or [`MOST_CELLS`].
pub fn check_size(columns: usize, rows: u64) -> Result<(), TableError> {
    let too_large = |found: String, expected: String| {
        Err(TableError::input(None, "the table is too large", found, expected, "give a part of it"))
    };
    let wide = u64::try_from(columns).unwrap_or(u64::MAX);
    if columns > MOST_COLUMNS {
        too_large(format!("{columns} columns"), format!("{MOST_COLUMNS} columns at most"))
    } else if rows > MOST_ROWS {
        too_large(format!("{rows} rows"), format!("{MOST_ROWS} rows at most"))
    } else if wide.saturating_mul(rows) > MOST_CELLS {
        too_large(format!("{rows} rows of {columns} columns"), format!("{MOST_CELLS} cells at most"))
    } else {
        Ok(())
    }
}

impl fmt::Display for TableError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(error) => write!(f, "{error}"),
            Self::File(problem) => f.write_str(problem),
            Self::Place { row, column, found, expected } => {
                write!(f, "row {row}, column {column}: found {found}, expected {expected}")
            }
            Self::Input(line, bad) => {
                let BadInput { problem, found, expected, next, .. } = bad.as_ref();
                if let Some(line) = line {
                    write!(f, "line {line}: ")?;
                }
                write!(f, "{problem}: found {found}, expected {expected}; {next}")
            }
        }
    }
}

impl std::error::Error for TableError {}

impl From<io::Error> for TableError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// Takes a table row by row.
pub trait Sink {
    /// Appends a row.
    ///
    /// # Errors
    /// A row that does not fit the columns, a number that is not finite, or those of the output.
    fn row(&mut self, cells: &[Cell]) -> Result<(), TableError>;

    /// Writes what is still kept and the end of the file. Without it the file is truncated.
    ///
    /// # Errors
    /// Those of the output.
    fn finish(&mut self) -> Result<(), TableError>;
}

/// Gives a table row by row.
pub trait Source {
    /// The columns and metadata.
    fn heading(&self) -> &Heading;

    /// Gives each row to `sink`, in order.
    ///
    /// # Errors
    /// Those of a damaged file and of `sink`.
    fn rows(&self, sink: &mut dyn FnMut(&[Cell]) -> Result<(), TableError>) -> Result<(), TableError>;

    /// Where a row is found, the first of which is 1: the line of a text file; of other files the row itself.
    fn line(&self, row: u64) -> u64 {
        row
    }

    /// The line of a text file's header.
    fn header_line(&self) -> Option<u64> {
        None
    }

    /// What was guessed about the file, for its user.
    fn notes(&self) -> &[String] {
        &[]
    }
}

/// Writes a cell as text formats have it; an absent cell is empty.
#[must_use]
pub fn text(column: &Column, cell: &Cell) -> String {
    match (cell, column.decimals) {
        (Cell::Absent, _) => String::new(),
        (Cell::Float(value), Some(decimals)) => format!("{value:.*}", usize::from(decimals)),
        (Cell::Float(value), None) => value.to_string(),
        (Cell::Int(value), _) => value.to_string(),
        (Cell::Text(value), _) => value.clone(),
    }
}

/// Checks a row before a [`Sink`] keeps it.
///
/// # Errors
/// The first cell that does not fit its column; `row` counts from 1.
pub fn check(columns: &[Column], row: u64, cells: &[Cell]) -> Result<(), TableError> {
    if cells.len() != columns.len() {
        let (found, expected) = (format!("{} cells", cells.len()), format!("{} cells", columns.len()));
        return Err(TableError::place(row, "", found, expected));
    }
    for (column, cell) in columns.iter().zip(cells) {
        let found = match (cell, column.kind) {
            (Cell::Float(value), Kind::Float) if value.is_finite() => continue,
            (Cell::Int(_), Kind::Int) | (Cell::Text(_), Kind::Text) => continue,
            (Cell::Absent, _) if column.nullable => continue,
            (Cell::Absent, _) => "no value".to_owned(),
            (Cell::Float(value), _) => value.to_string(),
            (Cell::Int(value), _) => value.to_string(),
            (Cell::Text(value), _) => format!("{value:?}"),
        };
        let expected = match column.kind {
            Kind::Float => "a finite number",
            Kind::Int => "an integer",
            Kind::Text => "text",
        };
        return Err(TableError::place(row, &column.name, found, expected));
    }
    Ok(())
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// All rows of a table.
    pub fn cells(source: &dyn Source) -> Vec<Vec<Cell>> {
        let mut rows = Vec::new();
        let push = &mut |row: &[Cell]| {
            rows.push(row.to_vec());
            Ok(())
        };
        source.rows(push).expect("whole rows");
        rows
    }

    #[test]
    fn cell_is_written_with_the_digits_of_its_column() {
        let free = Column::new("x", "", Kind::Float);
        let fixed = free.clone().decimals(2);
        for (column, cell, want) in [
            (&free, Cell::Float(0.1), "0.1"),
            (&fixed, Cell::Float(0.125), "0.12"),
            (&fixed, Cell::Absent, ""),
            (&fixed, Cell::Int(-7), "-7"),
            (&free, Cell::from("a b"), "a b"),
        ] {
            assert_eq!(text(column, &cell), want);
        }
    }

    #[test]
    fn row_fits_its_columns_or_is_named() {
        let columns = [
            Column::new("x", "", Kind::Float),
            Column::new("n", "", Kind::Int).nullable(),
            Column::new("note", "", Kind::Text),
        ];
        let row = |x: f64| [Cell::Float(x), Cell::Int(1), Cell::from("a")];
        assert!(check(&columns, 1, &row(0.5)).is_ok());
        assert!(check(&columns, 1, &[Cell::Float(0.5), Cell::Absent, Cell::from("a")]).is_ok());
        for (cells, words) in [
            (row(f64::INFINITY), "row 4, column x: found inf, expected a finite number"),
            ([Cell::Int(1), Cell::Int(1), Cell::from("a")], "column x: found 1, expected a finite number"),
            (
                [Cell::Float(0.5), Cell::Float(1.5), Cell::from("a")],
                "column n: found 1.5, expected an integer",
            ),
            (
                [Cell::Float(0.5), Cell::from("b"), Cell::from("a")],
                "column n: found \"b\", expected an integer",
            ),
            ([Cell::Float(0.5), Cell::Int(1), Cell::Absent], "column note: found no value, expected text"),
        ] {
            let error = check(&columns, 4, &cells).expect_err(words).to_string();
            assert!(error.contains(words), "{error}");
        }
        let error = check(&columns, 4, &row(0.5)[1..]).expect_err("short").to_string();
        assert_eq!(error, "row 4, column : found 2 cells, expected 3 cells");
    }

    #[test]
    fn fact_is_found_by_its_key() {
        let metadata =
            [("seed", "7"), ("commit", "abc")].map(|(key, value)| (key.to_owned(), value.to_owned()));
        let heading = Heading { metadata: metadata.into(), ..Heading::default() };
        assert_eq!((heading.fact("commit"), heading.fact("x")), (Some("abc"), None));
    }

    #[test]
    fn number_of_a_cell_is_finite() {
        let numbers = [
            (Cell::Float(0.5), Some(0.5)),
            (Cell::Float(f64::NAN), None),
            (Cell::Int(-3), Some(-3.0)),
            (Cell::from("1e3"), Some(1000.0)),
            (Cell::from("inf"), None),
            (Cell::from("a"), None),
            (Cell::from(None::<f64>), Cell::Absent.number()),
        ];
        for (cell, want) in numbers {
            assert_eq!(cell.number(), want, "{cell:?}");
        }
    }

    #[test]
    fn table_within_its_bounds_is_taken() {
        for (columns, rows, words) in [
            (MOST_COLUMNS, 1, ""),
            (MOST_COLUMNS + 1, 1, "10001 columns, expected 10000 columns at most"),
            (1, MOST_ROWS, ""),
            (1, MOST_ROWS + 1, "67108865 rows, expected 67108864 rows at most"),
            (8, MOST_ROWS, ""),
            (9, MOST_ROWS, "67108864 rows of 9 columns, expected 536870912 cells at most"),
        ] {
            let found = check_size(columns, rows).map_err(|error| error.to_string());
            match words {
                "" => assert_eq!(found, Ok(())),
                words => assert!(found.as_ref().is_err_and(|error| error.contains(words)), "{found:?}"),
            }
        }
    }

    #[test]
    fn error_names_its_line_and_what_a_decoder_says_is_damage() {
        let input = |line| TableError::input(line, "no header", "nothing", "a header", "choose another");
        assert_eq!(
            input(Some(3)).to_string(),
            "line 3: no header: found nothing, expected a header; choose another"
        );
        assert_eq!(input(None).to_string(), "no header: found nothing, expected a header; choose another");
        let full = || TableError::from(io::Error::from(io::ErrorKind::StorageFull));
        assert!(matches!(full(), TableError::Io(_)) && matches!(full().of_memory(), TableError::File(_)));
        assert_eq!(TableError::File("a".to_owned()).to_string(), "a");
    }
}
