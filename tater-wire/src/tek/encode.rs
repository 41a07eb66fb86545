//! Encodes [`super::Dialect::Ti`], line by line.

use heapless::Vec;

use super::character::value;

/// Most data bytes in an encoded record.
pub const DATA_BYTES: usize = 32;

const LINE: usize = 1 + 2 + 1 + 2 + 1 + 8 + 2 * DATA_BYTES + 2;

/// A line with CR LF.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Line(Vec<u8, LINE>);

impl Line {
    /// `bytes` has at most [`DATA_BYTES`].
    fn new(kind: u8, address: u32, bytes: &[u8]) -> Self {
        let mut line = Self::default();
        let len = u8::try_from(2 * bytes.len()).unwrap_or(u8::MAX).saturating_add(14);
        line.put(b'%');
        line.put_byte(len);
        line.put(kind);
        // The checksum's own characters count as 0.
        line.put_byte(0);
        line.put(b'8');
        for byte in address.to_be_bytes().iter().chain(bytes) {
            line.put_byte(*byte);
        }
        let values = line.0.iter().skip(1).filter_map(|&character| value(character));
        let [high, low] = hex(values.fold(0, u8::wrapping_add));
        if let Some(checksum) = line.0.get_mut(4..6) {
            checksum.copy_from_slice(&[high, low]);
        }
        line.put(b'\r');
        line.put(b'\n');
        line
    }

    fn put(&mut self, character: u8) {
        let _ = self.0.push(character);
    }

    fn put_byte(&mut self, byte: u8) {
        for digit in hex(byte) {
            self.put(digit);
        }
    }

    /// `%` to CR LF.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        &self.0
    }
}

fn hex(byte: u8) -> [u8; 2] {
    [byte >> 4, byte & 15].map(|digit| if digit < 10 { b'0' + digit } else { b'A' + digit - 10 })
}

/// The data records of bytes without a gap, one line each.
#[derive(Clone, Debug)]
pub struct Encoder<'a> {
    address: u32,
    bytes: &'a [u8],
}

impl<'a> Encoder<'a> {
    /// `None` if the bytes extend beyond the last 32-bit address.
    #[must_use]
    pub fn new(address: u32, bytes: &'a [u8]) -> Option<Self> {
        let room = u64::from(u32::MAX) - u64::from(address) + 1;
        let len = u64::try_from(bytes.len()).ok()?;
        (len <= room).then_some(Self { address, bytes })
    }
}

impl Iterator for Encoder<'_> {
    type Item = Line;

    fn next(&mut self) -> Option<Line> {
        let (now, rest) = self.bytes.split_at_checked(DATA_BYTES).unwrap_or((self.bytes, &[]));
        if now.is_empty() {
            return None;
        }
        let line = Line::new(b'6', self.address, now);
        self.bytes = rest;
        // At most 32. It wraps only after the last record at the last address, and is not used then.
        self.address = self.address.wrapping_add(u32::try_from(now.len()).unwrap_or(0));
        Some(line)
    }
}

/// The termination record, the last line of a file.
#[must_use]
pub fn end(entry: u32) -> Line {
    Line::new(b'8', entry, &[])
}
