//! Extended Tektronix hex, the format of `.tek` files: the records as a monitor receives them, character by
//! character without `%` and line ends, and whole files.
//!
//! A record is `%LLTCC...`: LL counts the characters after `%`, T is 6 for data, 3 for symbols and 8 for the end,
//! CC is the sum, modulo 256, of the [`value`]s of all characters after `%` but its own. Addresses and the entry are
//! one digit for the number of digits (0 means 16), then the digits. All digits are hexadecimal, upper case.

mod decode;
mod error;

pub use decode::{Decoder, MAX_DATA, Record};
pub use error::{TekError, TekErrorKind};

/// What a character adds to a checksum; `None` if it cannot be in a record.
#[must_use]
pub const fn value(character: u8) -> Option<u8> {
    match character {
        b'0'..=b'9' => Some(character - b'0'),
        b'A'..=b'Z' => Some(character - b'A' + 10),
        b'$' => Some(36),
        b'%' => Some(37),
        b'.' => Some(38),
        b'_' => Some(39),
        b'a'..=b'z' => Some(character - b'a' + 40),
        _ => None,
    }
}

/// A hexadecimal digit's value; lower case is none.
const fn digit(character: u8) -> Option<u8> {
    match value(character) {
        Some(value) if value < 16 => Some(value),
        _ => None,
    }
}
