//! Decodes records from characters.

use heapless::Vec;

use super::character::{digit, value};
use super::error::{TekError, TekErrorKind};

/// Most data bytes in one record: 255 characters minus the shortest head, in pairs.
pub const MAX_DATA: usize = 124;

/// Characters of LL, T and CC.
const HEAD: u8 = 5;

/// Characters of HEAD, the number of address digits and one such digit.
const HEAD_AND_ADDRESS: u8 = HEAD + 2;

/// A record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Record<'a> {
    /// Type 6: bytes from an address on; none of them is beyond the last 64-bit address.
    Data {
        /// Address of the first byte.
        address: u64,
        /// The bytes.
        bytes: &'a [u8],
    },
    /// Type 3: symbols, which are skipped.
    Symbols,
    /// Type 8: the termination, with the entry address.
    End {
        /// The entry address.
        entry: u64,
    },
}

/// Decodes records from the characters that a monitor receives: without `%` and line ends, separated by their length.
#[derive(Clone, Debug, Default)]
pub struct Decoder {
    records: u32,
    ended: bool,
    failed: Option<TekError>,
    /// Received characters of the present record; 0 between records.
    came: u8,
    /// LL, T and CC of the present record.
    len: u8,
    kind: u8,
    checksum: u8,
    /// Sum of the received characters, except CC.
    sum: u8,
    digits: u8,
    address: u64,
    /// The first digit of a byte.
    high: u8,
    bytes: Vec<u8, MAX_DATA>,
}

impl Decoder {
    /// Takes the next character; the last one of a record returns the record.
    ///
    /// # Errors
    /// The defect of this character's record. The error persists: it is returned for every further character.
    pub fn push(&mut self, character: u8) -> Result<Option<Record<'_>>, TekError> {
        if let Some(error) = self.failed {
            return Err(error);
        }
        if let Err((column, kind)) = self.take(character) {
            let record = self.records.saturating_add(1);
            let error = TekError { record, line: record, column, kind };
            self.failed = Some(error);
            return Err(error);
        }
        if self.came < 2 || self.came < self.len {
            return Ok(None);
        }
        self.came = 0;
        self.records = self.records.saturating_add(1);
        Ok(self.last())
    }

    pub(super) fn last(&self) -> Option<Record<'_>> {
        if self.came > 0 || self.records == 0 {
            return None;
        }
        Some(match self.kind {
            b'6' => Record::Data { address: self.address, bytes: &self.bytes },
            b'8' => Record::End { entry: self.address },
            _ => Record::Symbols,
        })
    }

    /// Takes a character, or returns the column and the defect.
    fn take(&mut self, found: u8) -> Result<(), (u32, TekErrorKind)> {
        let at = self.came;
        // `%` is column 1, and not sent.
        let here = u32::from(at) + 2;
        if self.ended {
            return Err((here, TekErrorKind::AfterEnd { found }));
        }
        if at == 0 {
            self.start();
        }
        let value = match value(found) {
            Some(value) => value,
            // GNU writes characters without a value in names (`*ABS*`) and counts them as 0.
            None if self.kind == b'3' && found.is_ascii_graphic() => 0,
            None => return Err((here, TekErrorKind::Character { found })),
        };
        let hex = || digit(found).ok_or((here, TekErrorKind::Digit { found }));
        match at {
            0 => self.len = hex()? << 4,
            1 => {
                self.len |= hex()?;
                self.at_least(HEAD)?;
            }
            2 => {
                self.kind = found;
                match found {
                    b'3' => {}
                    b'6' | b'8' => self.at_least(HEAD_AND_ADDRESS)?,
                    _ => return Err((here, TekErrorKind::Type { found })),
                }
            }
            3 => self.checksum = hex()? << 4,
            4 => self.checksum |= hex()?,
            _ if self.kind == b'3' => {}
            5 => self.count(hex()?).map_err(|kind| (here, kind))?,
            _ => self.digit(at, hex()?),
        }
        if !matches!(at, 3 | 4) {
            self.sum = self.sum.wrapping_add(value);
        }
        // A record has at most 255 characters, the last of which has at = 254.
        self.came = at.saturating_add(1);
        if at >= 4 && self.came == self.len { self.end() } else { Ok(()) }
    }

    fn start(&mut self) {
        (self.sum, self.digits, self.address, self.high) = (0, 0, 0, 0);
        self.bytes.clear();
    }

    fn at_least(&self, expected: u8) -> Result<(), (u32, TekErrorKind)> {
        let found = self.len;
        if found < expected { Err((2, TekErrorKind::Short { found, expected })) } else { Ok(()) }
    }

    /// The number of address digits, and whether it fits the record's length.
    fn count(&mut self, count: u8) -> Result<(), TekErrorKind> {
        self.digits = if count == 0 { 16 } else { count };
        let room = self.len.saturating_sub(HEAD + 1);
        match room.checked_sub(self.digits) {
            None => Err(TekErrorKind::Digits { found: self.digits, expected: room }),
            Some(0) => Ok(()),
            Some(rest) if self.kind == b'8' => {
                Err(TekErrorKind::Tail { found: self.len, expected: self.len.saturating_sub(rest) })
            }
            Some(found) if found % 2 == 1 => Err(TekErrorKind::Odd { found }),
            Some(_) => Ok(()),
        }
    }

    fn digit(&mut self, at: u8, digit: u8) {
        let in_data = at.checked_sub(HEAD.saturating_add(1).saturating_add(self.digits));
        match in_data {
            None => self.address = self.address << 4 | u64::from(digit),
            Some(place) if place % 2 == 0 => self.high = digit << 4,
            Some(_) => {
                // 124 bytes fit, and the length field allows no more.
                let _ = self.bytes.push(self.high | digit);
            }
        }
    }

    fn end(&mut self) -> Result<(), (u32, TekErrorKind)> {
        if self.sum != self.checksum {
            return Err((5, TekErrorKind::Checksum { found: self.sum, expected: self.checksum }));
        }
        // At most 124.
        let len = u8::try_from(self.bytes.len()).unwrap_or(u8::MAX);
        // Minus one, so that the last byte may be at the last address.
        if self.address.checked_add(u64::from(len.saturating_sub(1))).is_none() {
            return Err((8, TekErrorKind::Wrap { address: self.address, len }));
        }
        self.ended = self.kind == b'8';
        Ok(())
    }
}

#[cfg(test)]
mod tests;
