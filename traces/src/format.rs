//! The formats of tables, by a file's extension.

use std::io::Write;
use std::path::Path;

use super::input::BadInput;
use super::table::{Heading, Sink, Source, TableError};
use super::{csv, mcap, parquet};

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
        match bytes {
            [0x89, b'M', b'C', b'A', b'P', ..] => Self::Mcap,
            [b'P', b'A', b'R', b'1', ..] => Self::Parquet,
            _ => Self::Csv,
        }
    }

    /// The format of a file, and what to tell its user. What a file begins with counts more than its name; bytes that are no text are of the
    /// format that the name says, so that the error is about a damaged file of it.
    #[must_use]
    pub fn of_file(path: &Path, bytes: &[u8]) -> (Self, Option<String>) {
        let found = Self::of_bytes(bytes);
        // A pipe's name says nothing.
        let Ok(named) = Self::of(path) else { return (found, None) };
        let is_text = !bytes.is_empty() && bytes.iter().take(512).all(|byte| *byte >= b'\t');
        if named == found || found == Self::Csv && !is_text {
            return (named, None);
        }
        (found, Some(format!("the name says {named:?}, but the content is {found:?}, and is read as such")))
    }

    /// Opens the bytes of a file.
    ///
    /// # Errors
    /// Those of the format.
    pub fn source(self, bytes: Vec<u8>) -> Result<Box<dyn Source>, TableError> {
        Ok(match self {
            Self::Csv => Box::new(csv::Reader::new(bytes)?),
            Self::Mcap => Box::new(mcap::Reader::new(bytes)?),
            Self::Parquet => Box::new(parquet::Reader::new(bytes)?),
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
