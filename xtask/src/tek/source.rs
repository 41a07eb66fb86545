//! Reads an image: raw bytes, or a linked application.

use std::path::Path;

use object::Endianness;
use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{FileHeader, ProgramHeader};

use super::memory::{MAX_SPAN, Memory};
use crate::{Failure, files};

/// Bytes and entry of a file: by the program headers of a linked application, or from `base` for raw bytes.
///
/// # Errors
/// The file cannot be read or is empty, or `base` is missing or contradicts the program headers.
pub fn read(path: &Path, base: Option<u32>) -> Result<(Memory, u32), Failure> {
    let data = files::read(path)?;
    let place = path.display();
    let wrong = |error: String| Failure::Judged(format!("{place}: {error}"));
    if data.starts_with(b"\x7fELF") {
        let (memory, entry) = linked(&data).map_err(wrong)?;
        let found = memory.range().map_or(0, |range| *range.start());
        return match base {
            Some(base) if u64::from(base) != found => Err(wrong(format!(
                "found a first physical address of {found:#010x}, expected {base:#010x}, as --base says; \
                 leave --base out, or link for that address"
            ))),
            _ => Ok((memory, entry)),
        };
    }
    let Some(base) = base else {
        return Err(Failure::Unusable(format!(
            "{place}: is no ELF file, so its address must be given: --base 0x08004000, for example"
        )));
    };
    if data.len() as u64 > MAX_SPAN {
        return Err(wrong(format!(
            "found more than {} MiB, expected an image\n  next: check the path: a device has no end",
            MAX_SPAN / 1024 / 1024
        )));
    }
    let mut memory = Memory::default();
    if data.is_empty() || memory.insert(base.into(), &data).is_err() {
        return Err(wrong("found no bytes, expected at least 1".into()));
    }
    Ok((memory, base))
}

/// Loaded bytes by physical address, as in flash, and the entry.
///
/// # Errors
/// Not a linked program, or a damaged one.
pub fn linked(data: &[u8]) -> Result<(Memory, u32), String> {
    let damaged = |error: object::Error| format!("found a damaged file, expected a 32-bit ELF file: {error}");
    let header = FileHeader32::<Endianness>::parse(data).map_err(damaged)?;
    let endian = header.endian().map_err(damaged)?;
    let mut memory = Memory::default();
    for segment in header.program_headers(endian, data).map_err(damaged)? {
        if segment.p_type(endian) != PT_LOAD {
            continue;
        }
        let address = segment.p_paddr(endian);
        let bytes = segment.data(endian, data).map_err(|()| {
            format!("found a segment for {address:#010x} whose bytes are beyond the end of the file")
        })?;
        memory
            .insert(address.into(), bytes)
            .map_err(|taken| format!("found two segments with bytes for {taken:#010x}, expected one"))?;
    }
    if memory.len() == 0 {
        return Err(
            "found no segment to load, expected a linked application (an object file is not linked)".into()
        );
    }
    Ok((memory, header.e_entry(endian)))
}

/// Overwrites what an ELF file loads from a physical address.
///
/// # Errors
/// No segment holds all these addresses.
pub fn overwrite(data: &mut [u8], address: u32, bytes: &[u8]) -> Result<(), String> {
    let damaged = |error: object::Error| format!("found a damaged file, expected a 32-bit ELF file: {error}");
    let header = FileHeader32::<Endianness>::parse(&*data).map_err(damaged)?;
    let endian = header.endian().map_err(damaged)?;
    let loads = header.program_headers(endian, &*data).map_err(damaged)?.iter();
    let place = loads.filter(|segment| segment.p_type(endian) == PT_LOAD).find_map(|segment| {
        let (offset, len) = segment.file_range(endian);
        let at = u64::from(address.checked_sub(segment.p_paddr(endian))?);
        (at + bytes.len() as u64 <= len).then_some((offset + at) as usize)
    });
    let place = place.and_then(|at| data.get_mut(at..at + bytes.len()));
    let Some(place) = place else {
        return Err(format!(
            "found no segment with {} bytes from {address:#010x} on, expected one",
            bytes.len()
        ));
    };
    place.copy_from_slice(bytes);
    Ok(())
}
