//! Extended Tektronix hex, the format of `.tek` files: records as a monitor receives them, character by
//! character without `%` and line ends ([`Decoder`]), whole files ([`Reader`]), and our output ([`Encoder`]).
//!
//! A record is `%LLTCC...`: LL counts the characters after `%`, T is 6 for data, 3 for symbols and 8 for the
//! termination, CC is the sum, modulo 256, of the [`value`]s of all characters after `%` except CC. Addresses
//! and the entry are one digit for the number of digits (0 means 16), then the digits. All digits are
//! hexadecimal, upper case.
//!
//! The encoder writes, and [`Dialect::Ti`] accepts, the profile that hosts have downloaded for years:
//! addresses of 8 digits, at most 32 bytes a record, no symbols. The encoder's lines of 79 characters end with CR LF.
//! [`Dialect::Gnu`] adds what GNU objcopy and srecord write.
//!
//! GNU objcopy (tested: binutils 2.40) differs in three ways. It sees data only inside a section, which is a
//! type 3 record, so it reports that our file "has no sections"; with that record added by hand it reads the
//! rest. It writes whole aligned blocks of 32 bytes, including zeros beyond a section's end, and leaves out
//! blocks of zeros; so its file is complete only with its sections, which [`Reader::section`] returns. And it
//! writes the low 32 bits of an address.

mod character;
mod decode;
mod encode;
mod error;
mod file;

pub use character::value;
pub use decode::{Decoder, MAX_DATA, Record};
pub use encode::{DATA_BYTES, Encoder, Line, end};
pub use error::{Foreign, TekError, TekErrorKind};
pub use file::{Dialect, MAX_LINE, Reader};

#[cfg(test)]
mod tests;
