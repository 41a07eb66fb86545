//! What can be wrong with a record or a file, and where.

use core::fmt;

/// What is wrong, and where.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TekError {
    /// Which record, from 1.
    pub record: u32,
    /// Which line of the file, from 1; a stream has none: the record's number.
    pub line: u32,
    /// Which character of the line, from 1; `%` is character 1, in a stream too, where it is not sent.
    pub column: u32,
    /// What was wrong.
    pub kind: TekErrorKind,
}

/// What can be wrong with a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TekErrorKind {
    /// Not a hexadecimal digit.
    Digit {
        /// The character.
        found: u8,
    },
    /// Not a character that a record may hold.
    Character {
        /// The character.
        found: u8,
    },
    /// The length field is less than the shortest record of its type.
    Short {
        /// What the field says.
        found: u8,
        /// The least.
        expected: u8,
    },
    /// No type that there is.
    Type {
        /// The character.
        found: u8,
    },
    /// More address digits than the record has room for.
    Digits {
        /// What the record says.
        found: u8,
        /// What there is room for.
        expected: u8,
    },
    /// An odd number of data digits.
    Odd {
        /// How many.
        found: u8,
    },
    /// Data past the last address.
    Wrap {
        /// Of the first byte.
        address: u64,
        /// How many bytes.
        len: u8,
    },
    /// A termination record that goes on after its entry address.
    Tail {
        /// Characters after `%`.
        found: u8,
        /// What its address needs.
        expected: u8,
    },
    /// The checksum is not that of the characters.
    Checksum {
        /// Computed.
        found: u8,
        /// In the record.
        expected: u8,
    },
    /// Something after the termination record.
    AfterEnd {
        /// The character.
        found: u8,
    },
}

impl fmt::Display for TekError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { record, line, column, kind } = self;
        write!(f, "record {record}, line {line}, column {column}: {kind}")
    }
}

impl core::error::Error for TekError {}

impl fmt::Display for TekErrorKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Digit { found } => {
                write!(f, "found {}, expected a hexadecimal digit, 0-9 or A-F", Shown(found))
            }
            Self::Character { found } => {
                write!(f, "found {}, expected a character of a record: 0-9 A-Z a-z $ % . _", Shown(found))
            }
            Self::Short { found, expected } => {
                write!(
                    f,
                    "found length {found:02X}, expected at least {expected:02X} for the shortest record"
                )
            }
            Self::Type { found } => {
                let shown = Shown(found);
                write!(f, "found record type {shown}, expected 6 (data), 8 (termination) or 3 (symbols)")
            }
            Self::Digits { found, expected } => {
                write!(f, "found {found} address digits, expected at most {expected}, by the record's length")
            }
            Self::Odd { found } => write!(f, "found {found} data digits, expected two a byte"),
            Self::Wrap { address, len } => {
                write!(f, "found {len} bytes from {address:#x} on, expected no byte after the last address")
            }
            Self::Tail { found, expected } => {
                write!(f, "found a termination record of length {found:02X}, expected {expected:02X}")
            }
            Self::Checksum { found, expected } => {
                write!(
                    f,
                    "found characters of checksum {found:02X}, expected {expected:02X}, as the record says"
                )
            }
            Self::AfterEnd { found } => {
                write!(f, "found {} after the termination record, expected the end of the file", Shown(found))
            }
        }
    }
}

/// A character as a person can read it.
struct Shown(u8);

impl fmt::Display for Shown {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            b'\n' => f.write_str("a line feed"),
            b'\r' => f.write_str("a carriage return"),
            b' ' => f.write_str("a space"),
            b'!'..=b'~' => write!(f, "'{}'", char::from(self.0)),
            byte => write!(f, "byte {byte:#04x}"),
        }
    }
}
