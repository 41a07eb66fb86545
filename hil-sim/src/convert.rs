//! `hil-sim convert`: traces between CSV, MCAP and Parquet, and the files of all who write traces.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::open;
use super::output::is_same_file;
use programs::files;
use traces::csv;
use traces::format::Format;
use traces::input::BadInput;
use traces::numbers::bad;
use traces::table::{Source, TableError};

/// The arguments of `hil-sim convert`.
#[derive(clap::Args)]
pub struct ConvertArgs {
    /// A trace: .csv (as of `hil-sim run --out`), .mcap or .parquet, or the folder of a run.
    input: PathBuf,
    /// The file to write: .csv, .mcap or .parquet.
    output: PathBuf,
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

/// Converts a trace.
///
/// # Errors
/// Files that cannot be read or written, or no trace.
pub fn convert(args: &ConvertArgs) -> Result<(), BadInput> {
    let ConvertArgs { input, output } = args;
    let format = Format::of(output)?;
    let (input, source) = open::trace(input)?;
    if is_same_file(&input, output) {
        return Err(BadInput::new(output.display().to_string(), "the trace would overwrite itself")
            .found("one file for both")
            .expected("a file of its own for the result")
            .next("choose another path"));
    }
    copy(source.as_ref(), &input, output, format)
}

/// Writes the text of a CSV as a trace of any format.
///
/// # Errors
/// A file that cannot be written.
pub fn write(output: &Path, format: Format, csv: String) -> Result<(), BadInput> {
    let source = csv::Reader::new(csv.into_bytes()).map_err(|error| bad(&place(output), error))?;
    copy(&source, output, output, format)
}

fn place(path: &Path) -> String {
    path.display().to_string()
}

fn copy(source: &dyn Source, input: &Path, output: &Path, format: Format) -> Result<(), BadInput> {
    let mut bytes = Vec::new();
    let mut sink = format.sink(&mut bytes, source.heading()).map_err(|error| bad(&place(output), error))?;
    source.rows(&mut |row| sink.row(row)).map_err(|error| bad(&place(input), error))?;
    sink.finish().map_err(|error| bad(&place(output), error))?;
    drop(sink);
    files::replace(output, &bytes).map_err(|error| bad(&place(output), TableError::Io(error)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use traces::table::{Cell, Column, Heading, Kind};

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
}
