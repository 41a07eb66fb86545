//! Records: values by property number, whole or not at all.
//!
//! | half-word | |
//! |---|---|
//! | 0 | [`Word::Record`]: half-words up to and with the CRC |
//! | 1 | bits 15..12 version of this layout, 4 complete, 3 trusted, 2..0 hall code; the others 0 |
//! | 2, 3 | sequence number, one more than that of the record before |
//! | ... | entries: property number \| n << 8, then the value, two's complement, in n half-words, 0 if forgotten |
//! | last two | CRC-32 (ISO-HDLC) of all before |
//! | and one | only if trusted: the mark, all ones while the position in the record may be trusted |
//!
//! Where the flash is programmed by more than a half-word, a record and its mark begin at a unit each, and what is left of a unit stays erased.
//!
//! Low half-words and bytes first. An entry says its own length, so that a number that this version does not know is
//! kept, and one of a length that it does not know is skipped.

use super::pages::{Page, first, units, words};
use super::values::NUMBERS;
use super::word::{Word, join};
use crate::chip::Flash;
use heapless::Vec;
use tater_wire::image::Crc32;

/// A record of another version is not read, and its page is erased: there must be no other version (see `storage`).
const VERSION: u16 = 1;

/// Half-words before the entries, and of the CRC.
const HEAD: usize = 4;
pub const TAIL: usize = 2;

/// Maximum half-words of a record before its CRC: an entry for each number on the wire, of at most three.
pub const MOST_WORDS: usize = HEAD + 3 * NUMBERS;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Head {
    pub sequence: u32,
    /// Contains all values: a property without an entry is not stored. Other records name only changes.
    pub complete: bool,
    /// The hall code at the position in this record, which may be trusted while the mark is intact.
    pub trusted: Option<u8>,
}

impl Head {
    fn info(&self) -> u16 {
        let trusted = self.trusted.map_or(0, |code| 8 | u16::from(code & 7));
        VERSION << 12 | u16::from(self.complete) << 4 | trusted
    }

    fn parse(info: u16, sequence: u32) -> Option<Self> {
        let [low, _] = info.to_le_bytes();
        let head = Self { sequence, complete: low & 16 != 0, trusted: (low & 8 != 0).then_some(low & 7) };
        (head.info() == info).then_some(head)
    }
}

/// The half-words of a record to be written, before the CRC.
pub fn encode(
    words: &mut Vec<u16, MOST_WORDS>,
    head: &Head,
    entries: &mut dyn Iterator<Item = (u8, Option<i32>)>,
) {
    let [low, high] = halves(head.sequence);
    words.clear();
    // They fit: each number comes once.
    let mut push = |word| {
        let _ = words.push(word);
    };
    // The length goes into the first one.
    [0, head.info(), low, high].into_iter().for_each(&mut push);
    for (id, value) in entries.take(NUMBERS) {
        let [low, high] = halves(value.unwrap_or(0).cast_unsigned());
        let count = match value {
            None => 0,
            Some(value) if i16::try_from(value).is_ok() => 1,
            Some(_) => 2,
        };
        push(u16::from(id) | count << 8);
        [low, high].into_iter().take(usize::from(count)).for_each(&mut push);
    }
    let len = u16::try_from(words.len() + TAIL).unwrap_or(u16::MAX);
    if let Some(first) = words.first_mut() {
        *first = Word::Record(len).encode();
    }
}

/// A whole record in the flash.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    pub head: Head,
    page: Page,
    at: usize,
    len: usize,
}

impl Found {
    /// `None` if there is no record, or it is incomplete.
    pub fn read<F: Flash>(flash: &F, page: Page, at: usize) -> Option<Self> {
        const {
            assert!(
                F::MAP.is_whole()
                    && first::<F>() + units::<F>(MOST_WORDS + TAIL) + units::<F>(1) <= words::<F>(),
                "a first record has a place"
            )
        };
        let Word::Record(len) = Word::decode(page.read(flash, at))? else { return None };
        let len = usize::from(len);
        if len < HEAD + TAIL || at + len > words::<F>() {
            return None;
        }
        let word = |i| page.read(flash, at + i);
        if checksum((0..len - TAIL).map(word)) != join(word(len - 2), word(len - 1)) {
            return None;
        }
        let head = Head::parse(word(1), join(word(2), word(3)))?;
        let found = Self { head, page, at, len };
        (found.end::<F>() <= words::<F>()).then_some(found)
    }

    /// The half-word after it and its mark.
    pub fn end<F: Flash>(&self) -> usize {
        self.at + units::<F>(self.len) + units::<F>(usize::from(self.head.trusted.is_some()))
    }

    pub fn mark<F: Flash>(&self) -> Option<u32> {
        self.head.trusted.map(|_| self.page.address::<F>(self.at + units::<F>(self.len)))
    }

    /// Property numbers with their values, `None` for forgotten ones.
    pub fn entries<F: Flash>(&self, flash: &F) -> impl Iterator<Item = (u8, Option<i32>)> {
        let (page, end) = (self.page, self.at + self.len - TAIL);
        let mut at = self.at + HEAD;
        // Every iteration advances by at least a half-word.
        core::iter::from_fn(move || {
            while at < end {
                let [id, count] = page.read(flash, at).to_le_bytes();
                let value = at + 1;
                at = value + usize::from(count);
                let word = |i| page.read(flash, value + i);
                match count {
                    _ if at > end => {}
                    0 => return Some((id, None)),
                    1 => return Some((id, Some(i32::from(word(0).cast_signed())))),
                    2 => return Some((id, Some(join(word(0), word(1)).cast_signed()))),
                    _ => {}
                }
            }
            None
        })
    }
}

fn checksum(words: impl Iterator<Item = u16>) -> u32 {
    let mut crc = Crc32::default();
    words.for_each(|word| crc.update(&word.to_le_bytes()));
    crc.finish()
}

pub const fn halves(word: u32) -> [u16; 2] {
    let [a, b, c, d] = word.to_le_bytes();
    [u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])]
}
