//! Records from characters.

use heapless::Vec;

/// Most data bytes in one record: 255 characters less the shortest head, in pairs.
pub const MAX_DATA: usize = 124;

/// A record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Record<'a> {
    /// Type 6: bytes from an address on.
    Data {
        /// Of the first byte.
        address: u64,
        /// The bytes.
        bytes: &'a [u8],
    },
    /// Type 3: symbols, which are skipped.
    Symbols,
    /// Type 8: the end, with the entry address.
    End {
        /// Where execution starts.
        entry: u64,
    },
}

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
    /// The checksum is not that of the characters.
    Checksum {
        /// Computed.
        found: u8,
        /// In the record.
        expected: u8,
    },
}

/// Takes the characters of records as a monitor receives them: without `%`, line ends or anything else between the
/// records, which it tells apart by their length field.
#[derive(Clone, Debug, Default)]
pub struct Decoder {
    record: Vec<u8, 255>,
}

impl Decoder {
    /// The next character.
    ///
    /// # Errors
    /// What is wrong with the record that this character belongs to; the decoder is of no use after that.
    pub fn push(&mut self, character: u8) -> Result<Option<Record<'_>>, TekError> {
        let _ = self.record.push(character);
        Ok(None)
    }
}
