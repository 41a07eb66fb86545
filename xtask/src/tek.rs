//! Images of applications as `.tek` files: encode, verify, decode, dump.

mod memory;
mod records;
mod source;
mod verify;

use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::Subcommand;
use tater_f103::map::{APPLICATION, MAP};
use tater_wire::image::{self, HEADER_BYTES, Header, ImageError};
use tater_wire::tek::{self, Dialect, Encoder, Record};

use crate::{Failure, files};
pub use memory::ERASED;
use memory::Memory;
use programs::output::warn;
use records::{extent, open, records};
pub use verify::defect;

/// Text of a dump that is printed at once, bytes.
const PIECE: usize = 1 << 16;

/// Subcommands for `.tek` files.
#[derive(Subcommand)]
pub enum Chore {
    /// Make a .tek file from a linked application or raw bytes
    Encode {
        /// An ELF file, or raw bytes
        input: PathBuf,
        /// Address of the first byte, decimal or 0x...; an ELF file has its own
        #[arg(long, value_parser = address)]
        base: Option<u32>,
        /// The .tek file to write
        #[arg(short, long)]
        output: PathBuf,
        /// Fill gaps, pad to 4 bytes and write the header that the monitor checks, with this VERS
        #[arg(long, value_name = "VERSION")]
        seal: Option<u16>,
        /// Seal data that carry a seal which does not fit, because they were changed on purpose
        #[arg(long, requires = "seal")]
        replace_seal: bool,
    },
    /// Check that a .tek file is complete and downloadable, or report line and column of the first error
    /// (exit code 1); also report whether it is sealed, as a monitor requires
    Verify {
        /// The .tek file
        file: PathBuf,
    },
    /// Convert a .tek file to raw bytes, also one of GNU objcopy, srecord or a linker for DSPs; gaps become 0xFF
    Decode {
        /// The .tek file
        file: PathBuf,
        /// Bytes at each address of the file: 2 or 4 for a DSP that addresses words
        #[arg(long, value_name = "N", default_value = "1", value_parser = bytes_per_address)]
        bytes_per_address: u64,
        /// The file to write
        #[arg(short, long)]
        output: PathBuf,
    },
    /// Print the records of a .tek file
    Dump {
        /// The .tek file
        file: PathBuf,
    },
}

/// An address, decimal or 0x....
fn address(text: &str) -> Result<u32, String> {
    let number = match text.strip_prefix("0x") {
        Some(digits) => u32::from_str_radix(digits, 16),
        None => text.parse(),
    };
    number.map_err(|error| format!("{error}; expected an address up to 0xFFFFFFFF, such as 0x08004000"))
}

fn bytes_per_address(text: &str) -> Result<u64, String> {
    let number = text.parse().ok().filter(|number| matches!(number, 1 | 2 | 4));
    number.ok_or_else(|| "expected 1 (bytes), 2 or 4 (words of a DSP)".to_owned())
}

/// # Errors
/// The error in its files.
pub fn tek(chore: &Chore) -> Result<(), Failure> {
    match chore {
        Chore::Encode { input, base, output, seal, replace_seal } => {
            encode(input, *base, output, *seal, *replace_seal)
        }
        Chore::Verify { file } => verify::verify(file),
        Chore::Decode { file, output, bytes_per_address } => decode(file, output, *bytes_per_address),
        Chore::Dump { file } => dump(file),
    }
}

fn encode(
    input: &Path,
    base: Option<u32>,
    output: &Path,
    version: Option<u16>,
    replace_seal: bool,
) -> Result<(), Failure> {
    let (mut memory, entry) = source::read(input, base)?;
    let mut header = None;
    let place = input.display();
    let broken = memory.image().ok().and_then(|image| broken_seal(&image));
    match (broken, version) {
        (Some(error), Some(_)) if !replace_seal => {
            return Err(Failure::Judged(format!(
                "{place}: found a seal that does not fit: {error}\n  next: copy the file again from where it came from; only if its bytes \
                 were changed on purpose, seal them with --replace-seal"
            )));
        }
        (Some(error), None) => {
            warn(&format!("warning: {place}: its seal does not fit: {error}; {BROKEN}"));
        }
        _ => {}
    }
    if let Some(version) = version {
        let (sealed, found) = seal(&memory, version).map_err(|error| {
            format!(
                "{place}: {error}\n  next: link the image for the application's address {:#010x}, with its vector table first and the \
                 vectors 7 to 10 left 0; or leave --seal out",
                APPLICATION.start
            )
        })?;
        (memory, header) = (sealed, Some(found));
    }
    let text =
        text(&memory, entry).map_err(|error| Failure::Judged(format!("{}: {error}", input.display())))?;
    files::replace(output, &text).map_err(Failure::Unusable)?;
    let sealed = header.map_or_else(String::new, |Header { crc, version, .. }| {
        format!(", sealed: version {version}, CRC-32 {crc:#010x}")
    });
    warn(&format!("{}: {}{sealed}", output.display(), extent(&memory)));
    Ok(())
}

/// What a board does with bytes whose seal does not fit, and what helps.
const BROKEN: &str = "a monitor will reject it: copy the file again from where it came from";

/// Why the seal of these bytes does not fit; `None` if it does, or if there is none.
fn broken_seal(image: &[u8]) -> Option<ImageError> {
    let mut image = image.to_vec();
    image.resize(image.len().next_multiple_of(4), ERASED);
    let magic = image.get(image::MAGIC_AT as usize..)?.first_chunk()?;
    (u32::from_le_bytes(*magic) == image::MAGIC).then(|| Header::verify(&image, &MAP).err())?
}

fn text(memory: &Memory, entry: u32) -> Result<Vec<u8>, String> {
    let mut text = Vec::new();
    for (address, bytes) in memory.pieces() {
        let lines = u32::try_from(address).ok().and_then(|address| Encoder::new(address, bytes));
        let Some(lines) = lines else {
            let len = bytes.len();
            return Err(format!(
                "found {len} bytes from {address:#010x} on, expected no address above 0xffffffff"
            ));
        };
        for line in lines {
            text.extend_from_slice(line.as_bytes());
        }
    }
    text.extend_from_slice(tek::end(entry).as_bytes());
    Ok(text)
}

/// The flash contents of a linked program in one piece, and their address.
///
/// # Errors
/// Not a linked program, or too long an address range.
pub fn flat(elf: &[u8]) -> Result<(u64, Vec<u8>), String> {
    let (memory, _) = source::linked(elf)?;
    let start = memory.range().map_or(0, |range| *range.start());
    Ok((start, memory.image()?))
}

/// A linked application in its three forms.
pub struct Sealed {
    /// ELF file with the header in its first segment, for a debug probe.
    pub elf: Vec<u8>,
    /// Flash contents from the application's address.
    pub bytes: Vec<u8>,
    /// The same as a `.tek` file.
    pub text: Vec<u8>,
    pub header: Header,
}

/// # Errors
/// Not an application, or it cannot be sealed.
pub fn seal_linked(mut elf: Vec<u8>, version: u16) -> Result<Sealed, String> {
    let (memory, entry) = source::linked(&elf)?;
    let (memory, header) = seal(&memory, version)?;
    let bytes = memory.image()?;
    // The vector table, which holds the header, is linked in one piece.
    source::overwrite(&mut elf, APPLICATION.start, &bytes[..HEADER_BYTES])?;
    Ok(Sealed { elf, text: text(&memory, entry)?, bytes, header })
}

fn seal(memory: &Memory, version: u16) -> Result<(Memory, Header), String> {
    let (first, start) = (memory.range().map_or(0, |range| *range.start()), u64::from(APPLICATION.start));
    if first != start {
        return Err(format!(
            "found a first address of {first:#010x}, expected {start:#010x}, where the monitor looks for the \
             header"
        ));
    }
    let mut image = memory.image()?;
    image.resize(image.len().next_multiple_of(4), ERASED);
    let header = image::seal(&mut image, version.into(), &MAP).map_err(|error| error.to_string())?;
    let mut sealed = Memory::default();
    // Inserting into an empty memory cannot fail.
    let _ = sealed.insert(start, &image);
    Ok((sealed, header))
}

/// `unit` is the number of bytes at an address of the file.
fn decode(file: &Path, output: &Path, unit: u64) -> Result<(), Failure> {
    let (mut memory, mut sections, mut start, mut end) = (Memory::default(), Vec::new(), None, None);
    let in_bytes = |address: u64| {
        let beyond = || (8, format!("found address {address:#010x}, expected none beyond 64 bits of bytes"));
        address.checked_mul(unit).ok_or_else(beyond)
    };
    records(file, open(file)?, Dialect::Gnu, |record, section| {
        if let Some(section) = section.filter(|section| !section.is_empty()) {
            sections.push(in_bytes(section.start)?..in_bytes(section.end)?);
        }
        match record {
            Record::Data { address, bytes } => {
                let (before, len) = (end.replace((address, bytes.len() as u64)), bytes.len() as u64);
                let at = in_bytes(address)?;
                let beyond = at.checked_add(len.saturating_sub(1)).is_none();
                if beyond { Err(at) } else { memory.insert(at, bytes) }
                    .map_err(|taken| (8, overlap(taken, address, before, unit)))
            }
            Record::End { entry } => {
                start = Some(entry);
                Ok(())
            }
            Record::Symbols => Ok(()),
        }
    })?;
    let wrong = |error| Failure::Judged(format!("{}: {error}", file.display()));
    let (base, bytes) = assemble(&memory, &sections).map_err(wrong)?;
    warn_of_damage(file, &memory, base, &bytes);
    files::replace(output, &bytes).map_err(Failure::Unusable)?;
    let entry = start.map_or_else(|| "no entry".to_owned(), |start| format!("entry {start:#010x}"));
    let words = if unit == 1 { String::new() } else { format!(", {unit} bytes at each address") };
    warn(&format!("{}: {} bytes, base {:#010x}, {entry}{words}", output.display(), bytes.len(), base / unit));
    Ok(())
}

/// Warns of an image that has lost bytes, before somebody encodes what is left of it.
fn warn_of_damage(file: &Path, memory: &Memory, base: u64, bytes: &[u8]) {
    let (place, start) = (file.display(), u64::from(APPLICATION.start));
    if base != start && APPLICATION.holds(base, bytes.len() as u64) {
        warn(&format!(
            "warning: {place}: found a first address of {base:#010x}, expected {start:#010x} of an application: its first record may be \
             lost; compare the file with the original"
        ));
    }
    if let Some(error) = broken_seal(bytes) {
        let mut ends = memory.pieces().map(|(at, piece)| at + piece.len() as u64);
        let mut starts = memory.pieces().map(|(at, _)| at).skip(1);
        let gap = ends.by_ref().zip(starts.by_ref()).find(|(end, next)| end < next);
        let gap = gap.map_or_else(String::new, |(end, next)| {
            format!("; no record brings {end:#010x} to {:#010x}", next - 1)
        });
        warn(&format!("warning: {place}: its seal does not fit: {error}{gap}; {BROKEN}"));
    }
}

/// The message for bytes at an address that has some, by the address of their record, and by address and number of bytes of the record
/// before: in a file with addresses of words it ends where this one begins.
fn overlap(taken: u64, address: u64, before: Option<(u64, u64)>, unit: u64) -> String {
    let found = format!("found {:#010x} in two records, expected one", taken / unit);
    let words = before.and_then(|(start, len)| {
        let step = address.checked_sub(start).filter(|&step| step > 0 && len % step == 0)?;
        Some(len / step).filter(|per_address| matches!(per_address, 2 | 4) && *per_address != unit)
    });
    match words {
        Some(words) => format!(
            "{found}\n  the file's addresses seem to be those of words: decode it with --bytes-per-address {words}"
        ),
        None => format!("{found}\n  copy the file again from where it came from"),
    }
}

/// Base address and contents. In GNU's files the sections determine them: bytes default to 0, and zeros
/// around the sections are padding.
fn assemble(memory: &Memory, sections: &[Range<u64>]) -> Result<(u64, Vec<u8>), String> {
    let Some(base) = sections.iter().map(|section| section.start).min() else {
        let base = memory.range().map_or(0, |range| *range.start());
        return Ok((base, memory.image()?));
    };
    let last = sections.iter().map(|section| section.end - 1).max().unwrap_or(base);
    let mut bytes = memory::blank(&(base..=last))?;
    for section in sections {
        bytes[(section.start - base) as usize..(section.end - base) as usize].fill(0);
    }
    for (start, piece) in memory.pieces() {
        for (address, &byte) in (start..).zip(piece) {
            if sections.iter().any(|section| section.contains(&address)) {
                bytes[(address - base) as usize] = byte;
            } else if byte != 0 {
                return Err(format!(
                    "found {byte:#04x} for {address:#010x}, which is in no section, expected 0 there or no sections"
                ));
            }
        }
    }
    Ok((base, bytes))
}

fn dump(file: &Path) -> Result<(), Failure> {
    let (mut text, mut line) = (String::new(), 0);
    let judged = records(file, open(file)?, Dialect::Gnu, |record, section| {
        line += 1;
        let what = match (record, section) {
            (Record::Data { address, bytes }, _) => {
                let hex: String = bytes.iter().map(|byte| format!(" {byte:02x}")).collect();
                format!("data        {address:#010x} {:3} bytes:{hex}", bytes.len())
            }
            (Record::Symbols, Some(section)) => {
                format!("section     {:#010x} up to, but not, {:#010x}", section.start, section.end)
            }
            (Record::Symbols, None) => "symbols".into(),
            (Record::End { entry }, _) => format!("termination {entry:#010x} is the entry"),
        };
        text += &format!("{line:6}  {what}\n");
        // In pieces: a file from a pipe may be longer than the memory.
        if text.len() < PIECE {
            Ok(())
        } else {
            files::print(&std::mem::take(&mut text)).map_err(|error| (1, error))
        }
    });
    // Print the records before an error too.
    files::print(&text)?;
    judged.map(|_| ())
}
