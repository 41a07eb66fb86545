//! Extended Tektronix hex, the format of `.tek` files: records as a monitor receives them, character by character
//! without `%` and line ends ([`Decoder`]), whole files ([`Reader`]), and what we write ([`Encoder`]).
//!
//! A record is `%LLTCC...`: LL counts the characters after `%`, T is 6 for data, 3 for symbols and 8 for the end,
//! CC is the sum, modulo 256, of the [`value`]s of all characters after `%` but its own. Addresses and the entry are
//! one digit for the number of digits (0 means 16), then the digits. All digits are hexadecimal, upper case.
//!
//! What is written, and what [`Dialect::Ti`] takes, is the profile of the files that hosts have downloaded for years:
//! addresses of 8 digits, at most 32 bytes a record, no symbols, lines of 79 characters that end with CR LF.
//! [`Dialect::Gnu`] is all else that GNU objcopy and srecord write.
//!
//! GNU objcopy (seen with binutils 2.40) differs in three ways. It sees data only inside a section, which is a type 3
//! record, so it says that a file of ours "has no sections"; with that record added by hand it reads the rest. It
//! writes whole aligned blocks of 32 bytes, zeros beyond a section's end included, and leaves out those that are all
//! zeros; so a file of its is whole only with its sections, which [`Reader::section`] gives. And it writes the low 32
//! bits of an address.

mod decode;
mod encode;
mod error;
mod file;

pub use decode::{Decoder, MAX_DATA, Record};
pub use encode::{DATA_BYTES, Encoder, Line, end};
pub use error::{TekError, TekErrorKind};
pub use file::{Dialect, MAX_LINE, Reader};

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

#[cfg(test)]
mod tests;
