//! Defects of a record or a file, with their position.

use core::fmt;

use super::encode::DATA_BYTES;

/// A defect and its position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TekError {
    /// Number of the record, from 1.
    pub record: u32,
    /// Line of the file, from 1, empty lines included; in a stream the record's number.
    pub line: u32,
    /// Character of the line, from 1; `%` is character 1, also in a stream, where it is not sent.
    pub column: u32,
    /// The defect.
    pub kind: TekErrorKind,
}

/// Formats that are mistaken for Extended Tektronix hex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Foreign {
    /// Intel hex: the first line begins with `:`.
    IntelHex,
    /// Motorola S-records: the first line begins with `S`.
    SRecord,
    /// Text with two bytes a character.
    Utf16,
    /// No text: a linked program, raw bytes, a compressed file.
    Binary,
}

/// A defect of a record or of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TekErrorKind {
    /// Not a hexadecimal digit.
    Digit {
        /// The character.
        found: u8,
    },
    /// A character that no record may contain.
    Character {
        /// The character.
        found: u8,
    },
    /// The length field is less than the shortest record of its type.
    Short {
        /// The field's value.
        found: u8,
        /// The minimum.
        expected: u8,
    },
    /// Unknown record type.
    Type {
        /// The character.
        found: u8,
    },
    /// More address digits than the record has room for.
    Digits {
        /// The record's number of digits.
        found: u8,
        /// The available room.
        expected: u8,
    },
    /// An odd number of data digits.
    Odd {
        /// Number of digits.
        found: u8,
    },
    /// Data beyond the last address.
    Wrap {
        /// Address of the first byte.
        address: u64,
        /// Number of bytes.
        len: u8,
    },
    /// A termination record with characters after its entry address.
    Tail {
        /// Characters after `%`.
        found: u8,
        /// Length required by its address.
        expected: u8,
    },
    /// The checksum does not match.
    Checksum {
        /// Computed.
        found: u8,
        /// In the record.
        expected: u8,
    },
    /// Characters after the termination record.
    AfterEnd {
        /// The character.
        found: u8,
    },
    /// A line that does not start with `%`.
    Start {
        /// The character.
        found: u8,
    },
    /// A line that is shorter or longer than its record.
    Line {
        /// Characters after `%`.
        found: u8,
        /// The length field, or the minimum if there is none.
        expected: u8,
    },
    /// A line with too many characters.
    Long {
        /// The maximum.
        expected: u16,
    },
    /// The file ends without a termination record.
    NoEnd,
    /// The file begins as one of another format.
    Foreign {
        /// The format.
        found: Foreign,
    },
    /// [`super::Dialect::Ti`] only: not 8 address digits.
    AddressWidth {
        /// Number of digits.
        found: u8,
    },
    /// [`super::Dialect::Ti`] only: not 1 to 32 data bytes in a record.
    DataBytes {
        /// Number of bytes.
        found: u8,
    },
    /// [`super::Dialect::Ti`] only: a symbol record.
    Symbols,
}

impl TekErrorKind {
    /// Whether the file is complete, but not in the profile of [`super::Dialect::Ti`].
    #[must_use]
    pub const fn is_dialect(self) -> bool {
        matches!(self, Self::AddressWidth { .. } | Self::DataBytes { .. } | Self::Symbols)
    }

    /// The next step of a user. A damaged file is copied again; converting or encoding what is left of it would hide the damage.
    #[must_use]
    pub const fn next_step(self) -> &'static str {
        match self {
            Self::Foreign { found: Foreign::IntelHex } => {
                "convert it: `objcopy -I ihex -O binary --gap-fill 0xFF FILE FILE.bin`, then `cargo xtask tek encode FILE.bin --base \
                 ADDRESS --output FILE.tek` with the address of its first byte, such as 0x08004000"
            }
            Self::Foreign { found: Foreign::SRecord } => {
                "convert it: `objcopy -I srec -O binary --gap-fill 0xFF FILE FILE.bin`, then `cargo xtask tek encode FILE.bin --base \
                 ADDRESS --output FILE.tek` with the address of its first byte, such as 0x08004000"
            }
            Self::Foreign { found: Foreign::Utf16 } => {
                "save it as plain text: `iconv -f UTF-16 -t ASCII FILE > FILE.tek`"
            }
            Self::Foreign { found: Foreign::Binary } => {
                "use the .tek file itself; `cargo xtask tek encode` makes one of a linked program or of raw bytes"
            }
            Self::AddressWidth { .. } | Self::DataBytes { .. } | Self::Symbols => {
                "not the profile that boards download: `cargo xtask tek decode` reads it, `tek encode` writes that profile"
            }
            _ => "copy the file again from where it came from",
        }
    }
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
            Self::Start { found } => write!(f, "found {}, expected % at the start of a line", Shown(found)),
            Self::Line { found, expected } => write!(
                f,
                "found {found} characters after %, expected {expected}: the line is damaged or its length field is wrong"
            ),
            Self::Long { expected } => {
                write!(f, "found a longer line, expected at most {expected} characters")
            }
            Self::NoEnd => f.write_str("found the end of the file, expected a termination record (type 8)"),
            Self::Foreign { found } => {
                let found = match found {
                    Foreign::IntelHex => "a file of Intel hex",
                    Foreign::SRecord => "a file of Motorola S-records",
                    Foreign::Utf16 => "text in UTF-16",
                    Foreign::Binary => "a binary file",
                };
                write!(f, "found {found}, expected Extended Tektronix hex, whose lines begin with %")
            }
            Self::AddressWidth { found } => write!(f, "found {found} address digits, expected 8"),
            Self::DataBytes { found } => {
                write!(f, "found {found} data bytes in a record, expected 1 to {DATA_BYTES}")
            }
            Self::Symbols => f.write_str("found a symbol record (type 3), expected types 6 and 8 only"),
        }
    }
}

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
