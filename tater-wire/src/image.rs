//! The application's image, and the header by which the monitor verifies it: four words of the vector table that a
//! Cortex-M leaves reserved, so that any linked application has room for it (decision 0017).
//!
//! | offset | word |
//! |---|---|
//! | 0 | initial stack pointer: in RAM |
//! | 4 | reset vector: inside the image, odd (Thumb) |
//! | 0x1C | [`MAGIC`] |
//! | 0x20 | bytes of the image, including this header; a multiple of 4 |
//! | 0x24 | CRC-32 (ISO-HDLC, that of zip and Ethernet) of the image with this word as 0xFFFFFFFF |
//! | 0x28 | the application's VERS |

use crate::map::Map;

/// "TatR", little-endian.
pub const MAGIC: u32 = u32::from_le_bytes(*b"TatR");

/// Bytes from the start of the image to the end of the header; the minimum length of an image.
pub const HEADER_END: u32 = 0x2C;

/// [`HEADER_END`] as the length of an array.
pub const HEADER_BYTES: usize = HEADER_END as usize;

/// Offsets of the header's words.
pub const MAGIC_AT: u32 = 0x1C;
/// See [`MAGIC_AT`].
pub const LEN_AT: u32 = 0x20;
/// See [`MAGIC_AT`].
pub const CRC_AT: u32 = 0x24;
/// See [`MAGIC_AT`].
pub const VERSION_AT: u32 = 0x28;

/// CRC-32 (ISO-HDLC) of a sequence of bytes, four bits at a time (decision 0040).
#[derive(Clone, Copy, Debug)]
pub struct Crc32(u32);

/// The generator, with its highest power in the lowest bit and left out.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// Effect of four bits leaving the register on the rest of it.
#[rustfmt::skip]
const NIBBLES: [u32; 16] = [
    left(0), left(1), left(2), left(3), left(4), left(5), left(6), left(7),
    left(8), left(9), left(10), left(11), left(12), left(13), left(14), left(15),
];

const fn left(bits: u32) -> u32 {
    let mut rest = bits;
    let mut i = 0;
    while i < 4 {
        rest = rest >> 1 ^ if rest & 1 == 0 { 0 } else { POLYNOMIAL };
        i += 1;
    }
    rest
}

impl Default for Crc32 {
    fn default() -> Self {
        Self(u32::MAX)
    }
}

impl Crc32 {
    /// The next bytes.
    pub fn update(&mut self, bytes: &[u8]) {
        // Four bits always index the table.
        let shift = |crc: u32| crc >> 4 ^ NIBBLES.get((crc & 15) as usize).copied().unwrap_or(0);
        for &byte in bytes {
            self.0 = shift(shift(self.0 ^ u32::from(byte)));
        }
    }

    /// The CRC-32 of all bytes so far.
    #[must_use]
    pub const fn finish(self) -> u32 {
        !self.0
    }
}

/// The content of an image's header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Bytes of the image.
    pub len: u32,
    /// CRC-32 over it.
    pub crc: u32,
    /// The application's VERS.
    pub version: u32,
}

/// Reason why bytes are no image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageError {
    /// Shorter than a header, longer than the application's area, or not a multiple of 4 bytes.
    Length {
        /// Bytes.
        found: u32,
        /// Bytes of the area.
        most: u32,
    },
    /// The initial stack pointer is not in RAM.
    Stack {
        /// The word.
        found: u32,
        /// The end of the RAM.
        end: u32,
    },
    /// The reset vector is not inside the image, or not odd.
    Reset {
        /// The word.
        found: u32,
    },
    /// No header: the image is not sealed.
    Unsealed,
    /// Cannot be sealed: the reserved vectors are in use.
    Reserved,
    /// The CRC-32 does not match.
    Crc {
        /// Computed.
        found: u32,
        /// In the header.
        expected: u32,
    },
}

impl core::fmt::Display for ImageError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Length { found, most } => {
                write!(f, "the image has {found} bytes, expected {HEADER_END} to {most} and a multiple of 4")
            }
            Self::Stack { found, end } => write!(
                f,
                "the first word, the initial stack pointer, is {found:#010x}, expected an address up to {end:#010x}"
            ),
            Self::Reset { found } => {
                write!(f, "the reset vector is {found:#010x}, expected an odd address inside the image")
            }
            Self::Unsealed => f.write_str("the image is not sealed: no header in its vector table"),
            Self::Reserved => f.write_str("the image cannot be sealed: its reserved vectors are in use"),
            Self::Crc { found, expected } => {
                write!(f, "the image's CRC-32 is {found:#010x}, but its header says {expected:#010x}")
            }
        }
    }
}

impl core::error::Error for ImageError {}

/// The CRC-32 of an image, from its bytes in order.
#[derive(Debug, Default)]
pub struct Summer {
    crc: Crc32,
    at: u32,
}

impl Summer {
    /// The next bytes of the image; the header's CRC word counts as 0xFFFFFFFF.
    pub fn update(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            let in_crc = (CRC_AT..CRC_AT + 4).contains(&self.at);
            self.crc.update(&[if in_crc { 0xFF } else { byte }]);
            self.at = self.at.saturating_add(1);
        }
    }

    /// The CRC-32 of all bytes so far.
    #[must_use]
    pub fn finish(self) -> u32 {
        self.crc.finish()
    }
}

impl Header {
    /// The header of an image of a board from its first [`HEADER_END`] bytes, with the vectors checked, but not the CRC.
    ///
    /// # Errors
    /// The defect of the image.
    pub fn read(start: &[u8], map: &Map) -> Result<Self, ImageError> {
        let word = |at: u32| {
            let bytes = usize::try_from(at).ok().and_then(|at| start.get(at..)).and_then(<[u8]>::first_chunk);
            bytes.copied().map(u32::from_le_bytes).ok_or(length(start.len() as u32, map))
        };
        if word(MAGIC_AT)? != MAGIC {
            return Err(ImageError::Unsealed);
        }
        let header = Self { len: word(LEN_AT)?, crc: word(CRC_AT)?, version: word(VERSION_AT)? };
        check(header.len, word(0)?, word(4)?, map)?;
        Ok(header)
    }

    /// The header of a whole image of a board, checked.
    ///
    /// # Errors
    /// The defect of the image. Bytes after the header's length are an error too.
    pub fn verify(image: &[u8], map: &Map) -> Result<Self, ImageError> {
        let header = Self::read(image, map)?;
        let found = u32::try_from(image.len()).unwrap_or(u32::MAX);
        if header.len != found {
            return Err(length(found, map));
        }
        let found = sum(image);
        if found == header.crc { Ok(header) } else { Err(ImageError::Crc { found, expected: header.crc }) }
    }
}

const fn length(found: u32, map: &Map) -> ImageError {
    ImageError::Length { found, most: map.application.len }
}

fn check(len: u32, stack: u32, reset: u32, map: &Map) -> Result<(), ImageError> {
    let Map { application, of, .. } = map;
    if !(HEADER_END..=application.len).contains(&len) || !len.is_multiple_of(4) {
        return Err(length(len, map));
    }
    if !stack.is_multiple_of(4) || stack <= of.ram.start || stack > of.ram.end() {
        return Err(ImageError::Stack { found: stack, end: of.ram.end() });
    }
    let inside = application.start + HEADER_END..application.start + len;
    if reset.is_multiple_of(2) || !inside.contains(&(reset - 1)) {
        return Err(ImageError::Reset { found: reset });
    }
    Ok(())
}

fn sum(image: &[u8]) -> u32 {
    let mut summer = Summer::default();
    summer.update(image);
    summer.finish()
}

/// Writes the header into a linked image of a board. Its length must be a multiple of 4 already.
///
/// # Errors
/// The vectors are not those of an application, or the reserved ones contain something other than a header.
pub fn seal(image: &mut [u8], version: u32, map: &Map) -> Result<Header, ImageError> {
    let len = u32::try_from(image.len()).unwrap_or(u32::MAX);
    let word = |image: &[u8], at: u32| {
        image.get(at as usize..).and_then(<[u8]>::first_chunk).copied().map(u32::from_le_bytes)
    };
    let (Some(stack), Some(reset), Some(magic)) = (word(image, 0), word(image, 4), word(image, MAGIC_AT))
    else {
        return Err(length(len, map));
    };
    check(len, stack, reset, map)?;
    let blank = [MAGIC_AT, LEN_AT, CRC_AT, VERSION_AT]
        .iter()
        .all(|&at| matches!(word(image, at), Some(0 | u32::MAX)));
    if !blank && magic != MAGIC {
        return Err(ImageError::Reserved);
    }
    let mut write = |at: u32, word: u32| {
        if let Some(slot) = image.get_mut(at as usize..).and_then(<[u8]>::first_chunk_mut) {
            *slot = word.to_le_bytes();
        }
    };
    write(MAGIC_AT, MAGIC);
    write(LEN_AT, len);
    write(VERSION_AT, version);
    let crc = sum(image);
    if let Some(slot) = image.get_mut(CRC_AT as usize..).and_then(<[u8]>::first_chunk_mut) {
        *slot = crc.to_le_bytes();
    }
    Ok(Header { len, crc, version })
}

#[cfg(test)]
mod tests;
