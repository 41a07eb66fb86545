//! A `.tek` file, checked by the rules of the boards' monitor before anything is sent (docs/download.md).

use std::fmt;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use tater_f103::map::{APPLICATION, MAP};
use tater_wire::image::{HEADER_END, Header, ImageError};
use tater_wire::tek::{Dialect, Reader, Record, TekError};

/// What erased flash holds, and so what no record brings.
const ERASED: u8 = 0xFF;

const COPY: &str = "copy the file again from where it came from";
const WORDS: [&str; 2] = [
    "firmware of another processor, whose addresses are those of words: `cargo xtask tek decode --bytes-per-address 2` reads it",
    "firmware of another processor, whose addresses are those of words: `cargo xtask tek decode --bytes-per-address 4` reads it",
];
const REBUILD: &str = "build the image for the application's addresses and encode it again";
const SEAL: &str = "encode it again with `cargo xtask tek encode --seal VERSION`";

/// A place in a file, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct At {
    /// Line, empty ones included.
    pub line: u32,
    /// Character of the line.
    pub column: u32,
    /// Number of the record.
    pub record: u32,
}

/// Why a file is none that a board takes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FirmwareError {
    /// `None` for the image as a whole.
    pub at: Option<At>,
    /// What was found, and what is expected.
    pub found: String,
    /// The next step of a user.
    pub next_step: &'static str,
}

impl fmt::Display for FirmwareError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(At { line, column, record }) = self.at {
            write!(f, "{line}:{column}: record {record}: ")?;
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
        Self::of_records(text).map(|(contents, _)| contents)
    }

    /// The contents, and the records as lines that end with CR LF: what a board downloads, whatever ends the file's lines.
    fn of_records(text: &[u8]) -> Result<(Self, Vec<u8>), FirmwareError> {
        let damaged = |TekError { record, line, column, kind }: TekError| FirmwareError {
            at: Some(At { line, column, record }),
            found: kind.to_string(),
            next_step: kind.is_dialect().then(|| words(text)).flatten().unwrap_or(kind.next_step()),
        };
        let (mut reader, mut image, mut lines) = (Reader::new(Dialect::Ti), Image::default(), Vec::new());
        for byte in text.iter().copied().map(Some).chain([None]) {
            let record = match byte {
                Some(byte) => reader.push(byte),
                None => reader.finish(),
            };
            let Some(record) = record.map_err(damaged)? else { continue };
            let taken = image.take(record);
            if let Err((column, found, next_step)) = taken {
                let at = Some(At { line: reader.line(), column, record: image.records });
                return Err(FirmwareError { at, found, next_step: words(text).unwrap_or(next_step) });
            }
            lines.extend_from_slice(reader.characters());
            lines.extend_from_slice(b"\r\n");
        }
        Ok((image.finish()?, lines))
    }
}

/// The advice for a file whose addresses are those of words: each record begins where the one before it ends if 2 or 4 bytes count as one.
fn words(text: &[u8]) -> Option<&'static str> {
    let (mut reader, mut before) = (Reader::new(Dialect::Gnu), None);
    for &byte in text {
        let Some(Record::Data { address, bytes }) = reader.push(byte).ok()? else { continue };
        let len = bytes.len() as u64;
        if let Some((start, len)) = before.replace((address, len)) {
            let step = address.checked_sub(start).filter(|&step| step > 0 && len % step == 0);
            match step.map(|step| len / step) {
                Some(2) => return Some(WORDS[0]),
                Some(4) => return Some(WORDS[1]),
                _ => {}
            }
        }
    }
    None
}

#[derive(Default)]
struct Image {
    records: u32,
    len: usize,
    entry: u64,
    /// From the first address on, with what erased flash holds between records.
    bytes: Vec<u8>,
    first: u32,
    /// The first addresses between records that no record brings.
    gap: Option<RangeInclusive<u32>>,
}

impl Image {
    /// Takes a record, or returns column, what was found and the next step.
    fn take(&mut self, record: Record<'_>) -> Result<(), (u32, String, &'static str)> {
        self.records += 1;
        match record {
            Record::Data { address, bytes } => self.insert(address, bytes),
            Record::End { .. } if self.bytes.is_empty() => Err((
                4,
                "found a termination record before any data, expected the application's bytes".to_owned(),
                COPY,
            )),
            Record::End { entry } => {
                self.entry = entry;
                Ok(())
            }
            Record::Symbols => Ok(()),
        }
    }

    fn insert(&mut self, address: u64, bytes: &[u8]) -> Result<(), (u32, String, &'static str)> {
        let end = address.saturating_add(bytes.len() as u64);
        let Some(address) = u32::try_from(address)
            .ok()
            .filter(|address| APPLICATION.holds((*address).into(), bytes.len() as u64))
        else {
            let found = format!("found addresses {address:#010x} to {:#010x}", end.saturating_sub(1));
            let (from, to) = (APPLICATION.start, APPLICATION.end() - 1);
            return Err((8, format!("{found}, expected {from:#010x} to {to:#010x}"), REBUILD));
        };
        if self.bytes.is_empty() {
            self.first = address;
        }
        // Both are of the application's area.
        let next = self.first + self.bytes.len() as u32;
        let Some(gap) = address.checked_sub(next) else {
            let found = format!(
                "found address {address:#010x}, expected {next:#010x} or above: the record overlaps those before it, or they do not rise"
            );
            return Err((8, found, COPY));
        };
        if gap > 0 {
            self.gap.get_or_insert(next..=address - 1);
        }
        self.bytes.resize(self.bytes.len() + gap as usize, ERASED);
        self.bytes.extend_from_slice(bytes);
        self.len += bytes.len();
        Ok(())
    }

    /// The gap as a part of a sentence.
    fn gap(&self) -> String {
        self.gap.as_ref().map_or_else(String::new, |gap| {
            format!("; no record brings {:#010x} to {:#010x}", gap.start(), gap.end())
        })
    }

    fn finish(self) -> Result<Contents, FirmwareError> {
        let whole = |found: String| FirmwareError { at: None, found: found + &self.gap(), next_step: COPY };
        let begins = self.first == APPLICATION.start && self.bytes.len() >= HEADER_END as usize;
        let header = match begins.then(|| Header::verify(&self.bytes, &MAP)) {
            None => None,
            Some(Err(ImageError::Unsealed)) => {
                // Words of the vector table that are missing may have been the seal.
                let lost = self.gap.as_ref().is_some_and(|gap| *gap.start() < APPLICATION.start + HEADER_END);
                if lost {
                    return Err(whole(
                        "found no complete header, expected the image's first bytes".to_owned(),
                    ));
                }
                None
            }
            Some(Ok(header)) => Some(header),
            // The records are whole, but not the image: some are lost, or it was changed before it was encoded.
            Some(Err(error)) => return Err(whole(error.to_string())),
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
        let (contents, lines) = Contents::of_records(&text)?;
        let (first, start) = (*contents.addresses.start(), APPLICATION.start);
        let header = contents.header.ok_or_else(|| match first == start {
            true => FirmwareError {
                at: None,
                found: "found an image that is not sealed, expected the header that the monitor checks"
                    .to_owned(),
                next_step: SEAL,
            },
            false => FirmwareError {
                at: None,
                found: format!(
                    "found a first address of {first:#010x}, expected {start:#010x}, where the monitor looks for the header"
                ),
                next_step: COPY,
            },
        })?;
        Ok(Self { text: lines, header })
    }

    /// Length, CRC-32 and version of the image.
    #[must_use]
    pub const fn header(&self) -> &Header {
        &self.header
    }

    /// The records as a board downloads them: lines that end with CR LF, one termination record.
    pub(crate) fn text(&self) -> &[u8] {
        &self.text
    }
}
