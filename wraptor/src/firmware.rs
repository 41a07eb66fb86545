//! A `.tek` file, checked by the rules of the boards' monitor before anything is sent (docs/download.md).

use std::fmt;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use tater_wire::image::{HEADER_END, Header, ImageError};
use tater_wire::memory::APPLICATION;
use tater_wire::tek::{Dialect, Reader, Record, TekError};

/// What erased flash holds, and so what no record brings.
const ERASED: u8 = 0xFF;

const AGAIN: &str = "encode the image again";
const REBUILD: &str = "build the image for the application's addresses and encode it again";
const SEAL: &str = "encode it again with `cargo xtask tek encode --seal VERSION`";

/// Why a file is none that a board takes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FirmwareError {
    /// Line and column, from 1; `None` for the image as a whole.
    pub at: Option<(u32, u32)>,
    /// What was found, and what is expected.
    pub found: String,
    /// The next step of a user.
    pub next_step: &'static str,
}

impl fmt::Display for FirmwareError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((line, column)) = self.at {
            write!(f, "{line}:{column}: record {line}: ")?;
        }
        write!(f, "{}\n  next: {}", self.found, self.next_step)
    }
}

impl std::error::Error for FirmwareError {}

/// Longest file, bytes: several times the text of the longest image.
const LONGEST: u64 = 4 << 20;

/// Why a file cannot be downloaded.
#[derive(Debug)]
pub enum FileError {
    /// It cannot be read, is no regular file, or is too long for one of firmware.
    Unreadable(PathBuf, io::Error),
    /// It is none that a board takes.
    Damaged(PathBuf, FirmwareError),
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable(path, error) => {
                let next = "check that it is a .tek file that you may read";
                write!(f, "{}: cannot be read: {error}\n  next: {next}", path.display())
            }
            // A line and column follow the name as with compilers.
            Self::Damaged(path, error) if error.at.is_some() => write!(f, "{}:{error}", path.display()),
            Self::Damaged(path, error) => write!(f, "{}: {error}", path.display()),
        }
    }
}

impl std::error::Error for FileError {}

/// The text of a file that is no device or pipe, which might have no end.
fn text(path: &Path) -> io::Result<Vec<u8>> {
    if !path.metadata()?.is_file() {
        return Err(io::Error::new(
            ErrorKind::InvalidInput,
            "found a folder, device or pipe, expected a file",
        ));
    }
    let mut text = Vec::new();
    File::open(path)?.take(LONGEST + 1).read_to_end(&mut text)?;
    if text.len() as u64 > LONGEST {
        let found = format!("found more than {} MiB, expected a file of firmware", LONGEST >> 20);
        return Err(io::Error::new(ErrorKind::InvalidData, found));
    }
    Ok(text)
}

/// The content of a `.tek` file whose records are whole and can be downloaded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Contents {
    /// Records, the termination among them.
    pub records: u32,
    /// Bytes of data.
    pub len: usize,
    /// First and last address.
    pub addresses: RangeInclusive<u32>,
    /// Entry of the termination record.
    pub entry: u64,
    /// The header; `None`: the image is not sealed, and a monitor refuses it.
    pub header: Option<Header>,
}

impl Contents {
    /// Reads a file.
    ///
    /// # Errors
    /// Its first defect.
    pub fn read(text: &[u8]) -> Result<Self, FirmwareError> {
        let damaged = |TekError { line, column, kind, .. }: TekError| FirmwareError {
            at: Some((line, column)),
            found: kind.to_string(),
            next_step: match kind.is_dialect() {
                true => {
                    "not the profile that boards download: `cargo xtask tek decode` reads it, `tek encode` writes that profile"
                }
                false => "copy the file again from where it came from, or encode the image again",
            },
        };
        let (mut reader, mut image) = (Reader::new(Dialect::Ti), Image::default());
        for &byte in text {
            if let Some(record) = reader.push(byte).map_err(damaged)? {
                image.take(record)?;
            }
        }
        if let Some(record) = reader.finish().map_err(damaged)? {
            image.take(record)?;
        }
        image.finish()
    }
}

#[derive(Default)]
struct Image {
    records: u32,
    len: usize,
    entry: u64,
    /// From the first address on, with what erased flash holds between records.
    bytes: Vec<u8>,
    first: u32,
}

impl Image {
    fn take(&mut self, record: Record<'_>) -> Result<(), FirmwareError> {
        self.records += 1;
        let at = |column| Some((self.records, column));
        match record {
            Record::Data { address, bytes } => {
                let end = address.saturating_add(bytes.len() as u64);
                let Some(address) = u32::try_from(address)
                    .ok()
                    .filter(|address| APPLICATION.holds((*address).into(), bytes.len() as u64))
                else {
                    let found = format!("found addresses {address:#010x} to {:#010x}", end.saturating_sub(1));
                    let (from, to) = (APPLICATION.start, APPLICATION.end() - 1);
                    let found = format!("{found}, expected {from:#010x} to {to:#010x}");
                    return Err(FirmwareError { at: at(8), found, next_step: REBUILD });
                };
                if self.bytes.is_empty() {
                    self.first = address;
                }
                // Both are of the application's area.
                let next = self.first + self.bytes.len() as u32;
                let Some(gap) = address.checked_sub(next) else {
                    let found = format!(
                        "found address {address:#010x}, expected {next:#010x} or above: the record overlaps those before it, or they \
                         do not rise"
                    );
                    let next_step = "decode the file and encode it again";
                    return Err(FirmwareError { at: at(8), found, next_step });
                };
                self.bytes.resize(self.bytes.len() + gap as usize, ERASED);
                self.bytes.extend_from_slice(bytes);
                self.len += bytes.len();
                Ok(())
            }
            Record::End { .. } if self.bytes.is_empty() => {
                let found =
                    "found a termination record before any data, expected the application's bytes".to_owned();
                Err(FirmwareError { at: at(4), found, next_step: AGAIN })
            }
            Record::End { entry } => {
                self.entry = entry;
                Ok(())
            }
            Record::Symbols => Ok(()),
        }
    }

    fn finish(self) -> Result<Contents, FirmwareError> {
        let begins = self.first == APPLICATION.start && self.bytes.len() >= HEADER_END as usize;
        let header = match begins.then(|| Header::verify(&self.bytes)) {
            None | Some(Err(ImageError::Unsealed)) => None,
            Some(Ok(header)) => Some(header),
            Some(Err(error)) => {
                let next_step = "the records are whole, but not the image: seal it again when encoding";
                return Err(FirmwareError { at: None, found: error.to_string(), next_step });
            }
        };
        // A file without data has ended above.
        let last = self.first + (self.bytes.len() as u32).saturating_sub(1);
        let Self { records, len, entry, first, .. } = self;
        Ok(Contents { records, len, addresses: first..=last, entry, header })
    }
}

/// A `.tek` file that a monitor takes: whole, in the application's area, sealed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Firmware {
    text: Vec<u8>,
    header: Header,
}

impl Firmware {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// Why it cannot be downloaded, with its name.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let text = text(path).map_err(|error| FileError::Unreadable(path.to_owned(), error))?;
        Self::new(text).map_err(|error| FileError::Damaged(path.to_owned(), error))
    }

    /// Checks the text of a file.
    ///
    /// # Errors
    /// Its first defect, or that it is not sealed.
    pub fn new(text: Vec<u8>) -> Result<Self, FirmwareError> {
        let unsealed = || FirmwareError {
            at: None,
            found: "found an image that is not sealed, expected the header that the monitor checks"
                .to_owned(),
            next_step: SEAL,
        };
        let header = Contents::read(&text)?.header.ok_or_else(unsealed)?;
        Ok(Self { text, header })
    }

    /// Length, CRC-32 and version of the image.
    #[must_use]
    pub const fn header(&self) -> &Header {
        &self.header
    }

    /// The file's characters.
    pub(crate) fn text(&self) -> &[u8] {
        &self.text
    }
}
