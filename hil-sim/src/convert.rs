//! `hil-sim convert`: traces between CSV, MCAP and Parquet, and the files of all who read or write traces.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use tater_wire::property::ROWS;

use super::output::{is_same_file, replace_file};
use hil_experiment::trace::COLUMNS;
use traces::input::BadInput;
use traces::names::{MOTOR, UNTRUSTED};
use traces::table::{Heading, Sink, Source, TableError};
use traces::{csv, mcap, names, parquet};

/// The arguments of `hil-sim convert`.
#[derive(clap::Args)]
pub struct ConvertArgs {
    /// A trace: .csv (as of `hil-sim run --out`), .mcap or .parquet.
    input: PathBuf,
    /// The file to write: .csv, .mcap or .parquet.
    output: PathBuf,
}

/// A format of traces, by a file's extension.
#[derive(Clone, Copy)]
pub enum Format {
    Csv,
    Mcap,
    Parquet,
}

impl Format {
    /// # Errors
    /// Another extension.
    pub fn of(path: &Path) -> Result<Self, BadInput> {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("csv") => Ok(Self::Csv),
            Some("mcap") => Ok(Self::Mcap),
            Some("parquet") => Ok(Self::Parquet),
            other => Err(BadInput {
                place: path.display().to_string(),
                problem: "the extension names no format".to_owned(),
                found: other.map_or_else(|| "no extension".to_owned(), |other| format!(".{other}")),
                expected: ".csv, .mcap or .parquet".to_owned(),
                next: "choose a file with one of these extensions".to_owned(),
            }),
        }
    }

    /// Begins a file.
    ///
    /// # Errors
    /// Those of the format and of `out`.
    pub fn sink<'a, W: Write + Send + 'a>(
        self,
        out: W,
        heading: &Heading,
    ) -> Result<Box<dyn Sink + 'a>, TableError> {
        Ok(match self {
            Self::Csv => Box::new(csv::Writer::new(out, heading)?),
            Self::Mcap => Box::new(mcap::Writer::new(out, heading)?),
            Self::Parquet => Box::new(parquet::Writer::new(out, heading)?),
        })
    }

    /// The same for a file that grows for days: each row is written at once, and nothing of it is kept. Parquet keeps a group of rows, and a line of
    /// its index for each group.
    ///
    /// # Errors
    /// The same.
    pub fn appending<'a, W: Write + Send + 'a>(
        self,
        out: W,
        heading: &Heading,
    ) -> Result<Box<dyn Sink + 'a>, TableError> {
        Ok(match self {
            Self::Mcap => Box::new(mcap::Appender::new(out, heading)?),
            Self::Csv | Self::Parquet => self.sink(out, heading)?,
        })
    }
}

/// Bytes of a file that is written piece by piece: a [`Sink`] has one handle, and who writes the file the other.
#[derive(Clone, Default)]
pub struct Pending(Arc<Mutex<Vec<u8>>>);

impl Pending {
    /// Takes what is there.
    pub fn take(&self) -> Vec<u8> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Write for Pending {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Names of the columns of a run, and of what a board says of its properties.
fn known() -> Vec<&'static str> {
    let properties = ROWS.iter().map(|row| row.name);
    COLUMNS.iter().map(|column| column.name).chain([MOTOR, UNTRUSTED]).chain(properties).collect()
}

/// Opens a trace.
///
/// # Errors
/// A file that cannot be read or is no trace.
pub fn open(path: &Path) -> Result<Box<dyn Source>, BadInput> {
    let format = if path.exists() { Format::of(path) } else { Ok(Format::Csv) }?;
    let source = std::fs::read(path).map_err(TableError::Io).and_then(|bytes| {
        let source: Box<dyn Source> = match format {
            Format::Csv => Box::new(csv::Reader::new(bytes)?),
            Format::Mcap => Box::new(mcap::Reader::new(bytes)?),
            Format::Parquet => Box::new(parquet::Reader::new(bytes)?),
        };
        names::check(source.heading(), &known())?;
        Ok(source)
    });
    source.map_err(|error| bad(path, error))
}

/// A trace's error, with its place in the file.
pub fn bad(path: &Path, error: TableError) -> BadInput {
    let file = path.display().to_string();
    let expected = "a whole trace".to_owned();
    match error {
        TableError::Io(error) => BadInput {
            place: file,
            problem: "cannot be read or written".to_owned(),
            found: error.to_string(),
            expected: "a file that can be read, or a place that can be written".to_owned(),
            next: "check the path, its rights and the free space".to_owned(),
        },
        TableError::File(found) => BadInput {
            place: file,
            problem: "the file is no trace, or truncated or damaged".to_owned(),
            found,
            expected,
            next: "make the file again, or choose another".to_owned(),
        },
        TableError::Place { row, column, found, expected } => BadInput {
            place: format!("{file}:{row}"),
            problem: if column.is_empty() { "bad row".to_owned() } else { format!("column {column}") },
            found,
            expected,
            next: "correct the file, or make it again".to_owned(),
        },
    }
}

/// Converts a trace.
///
/// # Errors
/// Files that cannot be read or written, or no trace.
pub fn convert(args: &ConvertArgs) -> Result<(), BadInput> {
    let ConvertArgs { input, output } = args;
    let format = Format::of(output)?;
    if is_same_file(input, output) {
        return Err(BadInput {
            place: output.display().to_string(),
            problem: "the trace would overwrite itself".to_owned(),
            found: "one file for both".to_owned(),
            expected: "a file of its own for the result".to_owned(),
            next: "choose another path".to_owned(),
        });
    }
    copy(open(input)?.as_ref(), input, output, format)
}

/// Writes the text of a CSV as a trace of any format.
///
/// # Errors
/// A file that cannot be written.
pub fn write(output: &Path, format: Format, csv: String) -> Result<(), BadInput> {
    let source = csv::Reader::new(csv.into_bytes()).map_err(|error| bad(output, error))?;
    copy(&source, output, output, format)
}

fn copy(source: &dyn Source, input: &Path, output: &Path, format: Format) -> Result<(), BadInput> {
    let mut bytes = Vec::new();
    let mut sink = format.sink(&mut bytes, source.heading()).map_err(|error| bad(output, error))?;
    source.rows(&mut |row| sink.row(row)).map_err(|error| bad(input, error))?;
    sink.finish().map_err(|error| bad(output, error))?;
    drop(sink);
    replace_file(output, &bytes).map_err(|error| bad(output, TableError::Io(error)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use traces::table::{Cell, Column, Kind};

    /// What a writer keeps of its rows it writes with the end, which is as long after 10 rows as after 100,000; and each row is written at once.
    #[test]
    fn appended_rows_are_not_kept() {
        let heading = Heading {
            columns: vec![Column::new("time_ms", "ms", Kind::Float), Column::new("mode", "", Kind::Int)],
            metadata: vec![("node".to_owned(), "4".to_owned())],
        };
        for (format, shortest) in [(Format::Csv, 4), (Format::Mcap, 40)] {
            let end = |rows: u32| {
                let pending = Pending::default();
                let mut sink = format.appending(pending.clone(), &heading).expect("in memory");
                pending.take();
                for row in 0..rows {
                    sink.row(&[Cell::Float(f64::from(row)), Cell::Int(3)]).expect("in memory");
                    let written = pending.take();
                    // The first of a channel declares it.
                    assert!(
                        row == 0 || (shortest..100).contains(&written.len()),
                        "row {row}: {}",
                        written.len()
                    );
                }
                sink.finish().expect("in memory");
                pending.take().len()
            };
            assert_eq!(end(10), end(100_000));
        }
    }

    #[test]
    fn every_quantity_of_a_trace_has_a_unit() {
        let without: Vec<&str> =
            COLUMNS.iter().map(|column| column.name).filter(|name| names::unit(name).is_empty()).collect();
        assert_eq!(without, ["mode", "halls_code", "strain", "bridge_on", "brake_released"]);
        assert_eq!(
            (names::unit("velocity_counts_s"), names::unit("phase_a_a"), names::unit("load_n_m")),
            ("counts/s", "A", "N·m")
        );
    }
}
