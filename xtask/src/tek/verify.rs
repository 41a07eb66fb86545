//! Checks that a `.tek` file is complete, downloadable and sealed, by the monitor's rules.

use std::io::BufRead;
use std::path::Path;

use tater_wire::image::{HEADER_END, Header, ImageError};
use tater_wire::memory::APPLICATION;
use tater_wire::tek::{Dialect, Record};

use super::memory::Memory;
use super::records::{extent, open, records};
use crate::{Failure, files};

const REBUILD: &str = "build the image for the application's addresses and encode it again";

/// Prints a summary of the file; an unsealed image is not an error.
///
/// # Errors
/// The first error, with line and column.
pub fn verify(path: &Path) -> Result<(), Failure> {
    let Verified { records, extent, entry, header } = read(path, open(path)?)?;
    let place = path.display();
    let seal = match header {
        Some(Header { version, crc, .. }) => format!("sealed: version {version}, CRC-32 {crc:#010x}"),
        None => "not sealed: a monitor will reject it, `cargo xtask tek encode --seal VERSION` seals".into(),
    };
    files::print(&format!(
        "{place}: {records} records, {extent}, entry {entry:#010x}\ncomplete and downloadable; {seal}\n"
    ))?;
    Ok(())
}

/// Header of a file that a board will accept; `path` is for messages only.
///
/// # Errors
/// As [`verify`]; or that it is not sealed.
pub fn sealed(path: &Path, file: &[u8]) -> Result<Header, Failure> {
    read(path, file)?.header.ok_or_else(|| {
        let place = path.display();
        let found = format!(
            "{place}: found an image that is not sealed, expected the header that the monitor checks"
        );
        Failure::Judged(format!("{found}\n  encode it again with `cargo xtask tek encode --seal VERSION`"))
    })
}

struct Verified {
    records: u32,
    extent: String,
    entry: u64,
    header: Option<Header>,
}

fn read(path: &Path, file: impl BufRead) -> Result<Verified, Failure> {
    let (mut memory, mut count, mut next, mut start) = (Memory::default(), 0_u32, 0, 0);
    records(path, file, Dialect::Ti, |record, _| {
        count += 1;
        match record {
            Record::Data { address, bytes } => {
                judge(address, bytes.len() as u64, next)?;
                next = address + bytes.len() as u64;
                // Rising addresses cannot overlap.
                memory.insert(address, bytes).map_err(|taken| (8, format!("found {taken:#010x} twice")))
            }
            Record::End { .. } if count == 1 => {
                let found = "found a termination record before any data, expected the application's bytes";
                Err((4, format!("{found}\n  encode the image again")))
            }
            Record::End { entry } => {
                start = entry;
                Ok(())
            }
            Record::Symbols => Ok(()),
        }
    })?;
    let place = path.display();
    let seal = seal(&memory).map_err(|error| {
        format!("{place}: {error}\n  the records are whole, but not the image: seal it again when encoding")
    })?;
    Ok(Verified { records: count, extent: extent(&memory), entry: start, header: seal })
}

/// Checks that a data record is inside the application and follows `next`, the end of the one before.
fn judge(address: u64, len: u64, next: u64) -> Result<(), (u32, String)> {
    let last = address + (len - 1);
    if !APPLICATION.holds(address, len) {
        let (first_good, last_good) = (APPLICATION.start, APPLICATION.end() - 1);
        let found = format!("found addresses {address:#010x} to {last:#010x}");
        return Err((8, format!("{found}, expected {first_good:#010x} to {last_good:#010x}\n  {REBUILD}")));
    }
    if address < next {
        let found = format!("found address {address:#010x}, expected {next:#010x} or above");
        let why = "the record overlaps those before it, or they do not rise";
        return Err((8, format!("{found}: {why}\n  decode the file and encode it again")));
    }
    Ok(())
}

/// The checked header of a sealed image; `None` if it is not sealed.
fn seal(memory: &Memory) -> Result<Option<Header>, String> {
    let image = memory.image()?;
    let at_start = memory.range().is_some_and(|range| *range.start() == u64::from(APPLICATION.start));
    if !at_start || image.len() < HEADER_END as usize {
        return Ok(None);
    }
    match Header::verify(&image) {
        Ok(header) => Ok(Some(header)),
        Err(ImageError::Unsealed) => Ok(None),
        Err(error) => Err(error.to_string()),
    }
}
