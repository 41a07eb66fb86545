//! Extended Tektronix hex, the format of `.tek` files: the records as a monitor receives them, character by
//! character without `%` and line ends, and whole files.
//!
//! A record is `%LLTCC...`: LL counts the characters after `%`, T is 6 for data, 3 for symbols and 8 for the end,
//! CC is the sum of the values of all characters but its own. Addresses and the entry are one digit for the number
//! of digits, then the digits.

mod decode;

pub use decode::{Decoder, MAX_DATA, Record, TekError, TekErrorKind};
