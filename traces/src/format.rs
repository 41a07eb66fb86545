//! The formats of tables, by a file's extension.

use std::io::Write;
use std::path::Path;

use super::csv;
use super::input::BadInput;
#[cfg(feature = "mcap")]
use super::mcap;
#[cfg(feature = "parquet")]
use super::parquet;
use super::table::{Heading, Sink, Source, TableError};

/// A format of tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Text, as every program writes it.
    Csv,
    /// For viewers such as Foxglove.
    Mcap,
    /// For data tools.
    Parquet,
}

impl std::fmt::Display for Format {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(match self {
            Self::Csv => "CSV",
            Self::Mcap => "MCAP",
            Self::Parquet => "Parquet",
        })
    }
}

/// What files of a format begin with; text begins with anything.
const BEGINNINGS: [(Format, &[u8]); 2] = [(Format::Mcap, b"\x89MCAP"), (Format::Parquet, b"PAR1")];

impl Format {
    /// The format that a path's extension names, in any case.
    ///
    /// # Errors
    /// Another extension.
    pub fn of(path: &Path) -> Result<Self, BadInput> {
        let extension = path.extension().and_then(|extension| extension.to_str());
        match extension.map(str::to_ascii_lowercase).as_deref() {
            Some("csv") => Ok(Self::Csv),
            Some("mcap") => Ok(Self::Mcap),
            Some("parquet") => Ok(Self::Parquet),
            _ => Err(BadInput::new(path.display().to_string(), "the extension names no format")
                .found(extension.map_or_else(|| "no extension".to_owned(), |other| format!(".{other}")))
                .expected(".csv, .mcap or .parquet")
                .next("choose a file with one of these extensions")),
        }
    }

    /// The format of the bytes of a file, by how they begin.
    #[must_use]
    pub fn of_bytes(bytes: &[u8]) -> Self {
        let begun = BEGINNINGS.iter().find(|(_, beginning)| bytes.starts_with(beginning));
        begun.map_or(Self::Csv, |(format, _)| *format)
    }

    /// The format of a file, and what to tell its user. What a file begins with counts more than its name; bytes that are no text are of the
    /// format that the name says, so that the error is about a damaged file of it.
    #[must_use]
    pub fn of_file(path: &Path, bytes: &[u8]) -> (Self, Option<String>) {
        let found = Self::of_bytes(bytes);
        // A pipe's name says nothing.
        let Ok(named) = Self::of(path) else { return (found, None) };
        let is_cut = BEGINNINGS.iter().any(|(_, beginning)| beginning.starts_with(bytes));
        let is_text = !is_cut && bytes.iter().take(512).all(|byte| *byte >= b'\t');
        if named == found || found == Self::Csv && !is_text {
            return (named, None);
        }
        (found, Some(format!("the name says {named}, but the content is {found}, and is read as such")))
    }

    /// Opens the bytes of a file.
    ///
    /// # Errors
    /// Those of the format.
    pub fn source(self, bytes: Vec<u8>) -> Result<Box<dyn Source>, TableError> {
        Ok(match self {
            Self::Csv => Box::new(csv::Reader::new(bytes)?),
            #[cfg(feature = "mcap")]
            Self::Mcap => Box::new(mcap::Reader::new(bytes).map_err(TableError::of_memory)?),
            #[cfg(feature = "parquet")]
            Self::Parquet => Box::new(parquet::Reader::new(bytes).map_err(TableError::of_memory)?),
            #[cfg(not(all(feature = "mcap", feature = "parquet")))]
            other => return Err(other.left_out()),
        })
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
            #[cfg(feature = "mcap")]
            Self::Mcap => Box::new(mcap::Writer::new(out, heading)?),
            #[cfg(feature = "parquet")]
            Self::Parquet => Box::new(parquet::Writer::new(out, heading)?),
            #[cfg(not(all(feature = "mcap", feature = "parquet")))]
            other => return Err(other.left_out()),
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
            #[cfg(feature = "mcap")]
            Self::Mcap => Box::new(mcap::Appender::new(out, heading)?),
            _ => self.sink(out, heading)?,
        })
    }

    /// The error about a format whose feature this program was built without.
    #[cfg(not(all(feature = "mcap", feature = "parquet")))]
    fn left_out(self) -> TableError {
        TableError::input(
            None,
            "this program was built without the file's format",
            self.to_string(),
            "CSV",
            "bring it to CSV: hil-sim convert IN OUT.csv",
        )
    }
}

#[cfg(all(test, not(any(feature = "mcap", feature = "parquet"))))]
mod tests {
    use super::*;

    #[test]
    fn format_without_its_feature_is_refused() {
        for (format, bytes) in [(Format::Mcap, &b"\x89MCAP"[..]), (Format::Parquet, b"PAR1")] {
            assert_eq!(Format::of_bytes(bytes), format);
            let error = format.source(bytes.to_vec()).map(|_| ()).expect_err("left out").to_string();
            assert!(error.contains("built without") && error.contains("hil-sim convert"), "{error}");
            let error = format.sink(Vec::new(), &Heading::default()).map(|_| ()).expect_err("left out");
            assert!(error.to_string().contains(&format!("found {format}")), "{error}");
        }
    }
}

#[cfg(all(test, feature = "mcap", feature = "parquet"))]
mod tests {
    use super::*;
    use crate::table::{Cell, Column, Kind};

    const ALL: [(Format, &str, &str); 3] = [
        (Format::Csv, "a.csv", "CSV"),
        (Format::Mcap, "a.MCAP", "MCAP"),
        (Format::Parquet, "a.b.parquet", "Parquet"),
    ];

    #[test]
    fn each_format_is_known_by_its_name_and_reads_what_it_writes() {
        let columns = vec![Column::new("time_ms", "ms", Kind::Int), Column::new("bus_v", "V", Kind::Float)];
        let heading = Heading { columns, ..Heading::default() };
        let row = [Cell::Int(3), Cell::Float(24.5)];
        for (format, name, text) in ALL {
            assert_eq!((Format::of(Path::new(name)), format.to_string().as_str()), (Ok(format), text));
            for is_appended in [false, true] {
                let mut bytes = Vec::new();
                let begun = match is_appended {
                    true => format.appending(&mut bytes, &heading),
                    false => format.sink(&mut bytes, &heading),
                };
                let mut sink = begun.expect("begun");
                sink.row(&row).expect("written");
                sink.finish().expect("ended");
                drop(sink);
                assert_eq!(Format::of_bytes(&bytes), format);
                let source = format.source(bytes).expect("a table");
                let mut rows = 0;
                let count = &mut |cells: &[Cell]| {
                    assert_eq!(cells, row);
                    rows += 1;
                    Ok(())
                };
                source.rows(count).expect("rows");
                assert_eq!((rows, &source.heading().columns[0].name), (1, &"time_ms".to_owned()));
            }
        }
        for (name, found) in [("a.xlsx", "found:    .xlsx"), ("a", "found:    no extension")] {
            let error = Format::of(Path::new(name)).expect_err(name).to_string();
            assert!(error.starts_with(&format!("{name}: ")) && error.contains(found), "{error}");
        }
    }

    #[test]
    fn content_counts_more_than_the_name() {
        let of = |name: &str, bytes: &[u8]| {
            let (format, note) = Format::of_file(Path::new(name), bytes);
            (format, note.is_some())
        };
        for (format, name, _) in ALL {
            assert_eq!(of(name, b"\x89MCAP0"), (Format::Mcap, format != Format::Mcap));
            assert_eq!(of(name, b"PAR1"), (Format::Parquet, format != Format::Parquet));
            assert_eq!(of(name, b"time_ms\n0\n"), (Format::Csv, format != Format::Csv));
            // No text, nothing, or the first bytes of a format: damage of what the name says.
            for bytes in [&b"\0\x01"[..], b"", b"PA", b"\x89MC"] {
                assert_eq!(of(name, bytes), (format, false), "{bytes:?}");
            }
        }
        assert_eq!(of("/dev/stdin", b"PAR1"), (Format::Parquet, false));
        let (_, note) = Format::of_file(Path::new("a.csv"), b"PAR1");
        assert_eq!(
            note.as_deref(),
            Some("the name says CSV, but the content is Parquet, and is read as such")
        );
    }
}
