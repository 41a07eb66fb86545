//! File format of a hand's state without power: seven flashes, GOD's storage, and the motors' positions.
//!
//! Little-endian: `MAGIC`; the length of the body (4 bytes); the body; the CRC-32 of everything before (4). The body holds for each
//! of nodes 1 to 7 the rotor's position in hall counts (8, IEEE 754), the number of pages that are not erased (2), and each of
//! these pages after its number (2); GOD's bytes end the body.

use flate2::Crc;
use god::memory::Stored;
use tater_f103::map::{FLASH, PAGE};

/// File type and version.
const MAGIC: &[u8] = b"hil-sim hand, state 1\n";

const BOARDS: usize = 7;

const PAGE_BYTES: usize = PAGE as usize;

const FLASH_BYTES: usize = FLASH.len as usize;

/// The state of one board and its motor.
#[derive(Clone, Debug, PartialEq)]
pub struct Kept {
    /// The whole flash.
    pub flash: Vec<u8>,
    /// The rotor's position, hall counts.
    pub counts: f64,
}

/// The state of a hand.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Nodes 1 to 7.
    pub boards: Vec<Kept>,
    /// GOD's storage.
    pub god: Stored,
}

/// Why bytes are not a hand's state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadState {
    /// Offset of the error, bytes.
    pub at: usize,
    /// The content found.
    pub found: String,
    /// The content expected.
    pub expected: String,
}

impl State {
    /// Encodes the state.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut body = Vec::new();
        for Kept { flash, counts } in &self.boards {
            body.extend(counts.to_le_bytes());
            let pages = || (0u16..).zip(flash.chunks(PAGE_BYTES)).filter(|(_, page)| !is_erased(page));
            // At most 128 pages.
            body.extend((pages().count() as u16).to_le_bytes());
            for (number, page) in pages() {
                body.extend(number.to_le_bytes());
                body.extend(page);
            }
        }
        body.extend(self.god.to_bytes());
        let mut bytes = MAGIC.to_vec();
        // Under a megabyte: seven flashes and GOD.
        bytes.extend((body.len() as u32).to_le_bytes());
        bytes.extend(body);
        bytes.extend(sum(&bytes).to_le_bytes());
        bytes
    }

    /// Decodes a state.
    ///
    /// # Errors
    /// The bytes are something else, of another version, or corrupted.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, BadState> {
        let mut reader = Reader { bytes, at: 0 };
        let kind = String::from_utf8_lossy(MAGIC).into_owned();
        if reader.take(MAGIC.len(), &kind)? != MAGIC {
            let first = String::from_utf8_lossy(&bytes[..MAGIC.len()]).into_owned();
            return Err(BadState { at: 0, found: format!("{first:?}"), expected: format!("{kind:?}") });
        }
        let len = u32::from_le_bytes(reader.array("the length of the body")?) as usize;
        let end = reader.at.saturating_add(len);
        if bytes.len() != end.saturating_add(4) {
            let (found, expected) = (bytes.len(), end.saturating_add(4));
            return Err(reader.error(format!("a file of {found} bytes"), &format!("{expected} bytes")));
        }
        let (before, stored) = bytes.split_at(end);
        if sum(before).to_le_bytes() != stored {
            reader.at = end;
            let stored = stored.iter().rev().fold(String::new(), |text, byte| text + &format!("{byte:02X}"));
            return Err(reader.error(format!("CRC-32 {stored}"), &format!("CRC-32 {:08X}", sum(before))));
        }
        reader.bytes = before;
        let boards = (0..BOARDS).map(|_| reader.kept()).collect::<Result<_, _>>()?;
        let rest = &reader.bytes[reader.at..];
        let god =
            Stored::from_bytes(rest).map_err(|error| reader.error(error.to_string(), "GOD's storage"))?;
        Ok(Self { boards, god })
    }
}

fn is_erased(page: &[u8]) -> bool {
    page.iter().all(|&byte| byte == 0xFF)
}

fn sum(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn error(&self, found: String, expected: &str) -> BadState {
        BadState { at: self.at, found, expected: expected.to_owned() }
    }

    fn take(&mut self, len: usize, what: &str) -> Result<&'a [u8], BadState> {
        let rest = &self.bytes[self.at..];
        let taken = rest.get(..len).ok_or_else(|| self.error(format!("{} bytes", rest.len()), what))?;
        self.at += len;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], BadState> {
        let taken = self.take(N, what)?;
        Ok(std::array::from_fn(|i| taken[i]))
    }

    fn kept(&mut self) -> Result<Kept, BadState> {
        let counts = f64::from_le_bytes(self.array("a position")?);
        if !counts.is_finite() {
            return Err(self.error(counts.to_string(), "a position"));
        }
        let pages = u16::from_le_bytes(self.array("a number of pages")?);
        let mut flash = vec![0xFF; FLASH_BYTES];
        for _ in 0..pages {
            let number = u16::from_le_bytes(self.array("a page's number")?);
            let page = self.take(PAGE_BYTES, "a page")?;
            let from = usize::from(number) * PAGE_BYTES;
            let Some(place) = flash.get_mut(from..from + PAGE_BYTES) else {
                return Err(self.error(format!("page {number}"), "pages 0 to 127"));
            };
            place.copy_from_slice(page);
        }
        Ok(Kept { flash, counts })
    }
}
