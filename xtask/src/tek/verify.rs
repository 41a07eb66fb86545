//! Checks that a `.tek` file is complete, downloadable and sealed, by the monitor's rules.

use std::path::Path;

use tater_f103::map::APPLICATION;
use tater_wire::image::Header;
use wraptor::FirmwareError;
use wraptor::firmware::Contents;

use crate::{Failure, files};

/// Prints a summary of the file; an unsealed image is not an error.
///
/// # Errors
/// The first error, with line and column.
pub fn verify(path: &Path) -> Result<(), Failure> {
    let Contents { records, len, addresses, entry, header } =
        Contents::read(&files::read(path)?).map_err(|error| defect(path, &error))?;
    let seal = match header {
        Some(Header { version, crc, .. }) => format!("sealed: version {version}, CRC-32 {crc:#010x}"),
        None if *addresses.start() != APPLICATION.start => format!(
            "not sealed: a monitor will reject it, for it does not begin at {:#010x}; its first record may be lost, so compare it with \
             the original",
            APPLICATION.start
        ),
        None => "not sealed: a monitor will reject it, `cargo xtask tek encode --seal VERSION` seals".into(),
    };
    let (place, first, last) = (path.display(), addresses.start(), addresses.end());
    files::print(&format!(
        "{place}: {records} records, {len} bytes in {first:#010x} to {last:#010x}, entry {entry:#010x}\n\
         complete and downloadable; {seal}\n"
    ))?;
    Ok(())
}

/// A file that no board takes: `FILE:LINE:COLUMN: ...`.
pub fn defect(path: &Path, error: &FirmwareError) -> Failure {
    let separator = if error.at.is_some() { ":" } else { ": " };
    Failure::Judged(format!("{}{separator}{error}", path.display()))
}
