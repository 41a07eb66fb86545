//! Bytes by address.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// Longest address range of an image: more than any microcontroller's flash, and safe to allocate.
pub const MAX_SPAN: u64 = 16 * 1024 * 1024;

/// Contents of erased flash.
pub const ERASED: u8 = 0xFF;

/// Non-empty pieces.
#[derive(Debug, Default, PartialEq)]
pub struct Memory {
    pieces: BTreeMap<u64, Vec<u8>>,
}

impl Memory {
    /// Adds bytes, the last of which must have an address.
    ///
    /// # Errors
    /// The first address that is already taken; nothing is added.
    pub fn insert(&mut self, address: u64, bytes: &[u8]) -> Result<(), u64> {
        let Some(more) = (bytes.len() as u64).checked_sub(1) else { return Ok(()) };
        if let Some((&next, _)) = self.pieces.range(address..).next()
            && next - address <= more
        {
            return Err(next);
        }
        if let Some((&start, before)) = self.pieces.range_mut(..address).next_back() {
            let way = address - start;
            if way < before.len() as u64 {
                return Err(address);
            }
            if way == before.len() as u64 {
                before.extend_from_slice(bytes);
                return Ok(());
            }
        }
        self.pieces.insert(address, bytes.to_vec());
        Ok(())
    }

    /// Pieces by rising address. Two may touch if the second was added first.
    pub fn pieces(&self) -> impl Iterator<Item = (u64, &[u8])> {
        self.pieces.iter().map(|(&start, bytes)| (start, bytes.as_slice()))
    }

    pub fn len(&self) -> usize {
        self.pieces.values().map(Vec::len).sum()
    }

    pub fn range(&self) -> Option<RangeInclusive<u64>> {
        let (&first, _) = self.pieces.first_key_value()?;
        let (&start, bytes) = self.pieces.last_key_value()?;
        Some(first..=start + (bytes.len() as u64 - 1))
    }

    /// All bytes in one piece, with gaps as erased flash; empty if there are none.
    ///
    /// # Errors
    /// The range is longer than [`MAX_SPAN`].
    pub fn image(&self) -> Result<Vec<u8>, String> {
        let Some(range) = self.range() else { return Ok(Vec::new()) };
        let mut image = blank(&range)?;
        for (start, bytes) in self.pieces() {
            let at = (start - range.start()) as usize;
            image[at..at + bytes.len()].copy_from_slice(bytes);
        }
        Ok(image)
    }
}

/// # Errors
/// The range is longer than [`MAX_SPAN`].
pub fn blank(range: &RangeInclusive<u64>) -> Result<Vec<u8>, String> {
    let (first, last) = (range.start(), range.end());
    match last - first {
        more if more < MAX_SPAN => Ok(vec![ERASED; more as usize + 1]),
        _ => Err(format!(
            "found addresses from {first:#010x} to {last:#010x}, expected at most {} MiB from the first to the last",
            MAX_SPAN / 1024 / 1024
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adjacent_pieces_join_and_overlap_is_an_error() {
        let mut memory = Memory::default();
        assert_eq!(memory.range(), None);
        for (address, bytes) in [(10, &[1, 2][..]), (12, &[3]), (20, &[4]), (u64::MAX, &[9]), (5, &[])] {
            assert_eq!(memory.insert(address, bytes), Ok(()));
        }
        assert_eq!(memory.pieces().collect::<Vec<_>>(), [(10, &[1, 2, 3][..]), (20, &[4]), (u64::MAX, &[9])]);
        assert_eq!(memory.range(), Some(10..=u64::MAX));
        for (address, len, taken) in
            [(9, 2, 10), (12, 1, 12), (11, 9, 11), (13, 8, 20), (20, 1, 20), (10, 1, 10)]
        {
            assert_eq!(memory.insert(address, &vec![0; len]), Err(taken), "{address}");
        }
        assert_eq!(memory.insert(13, &[0; 7]), Ok(()));
        assert_eq!(memory.len(), 12);
        assert!(memory.image().is_err_and(|error| error.contains("16 MiB")));
    }

    #[test]
    fn gaps_are_filled_up_to_the_longest_range() {
        let mut memory = Memory::default();
        assert_eq!(memory.image(), Ok(Vec::new()));
        assert_eq!(memory.insert(7, &[1]), Ok(()));
        assert_eq!(memory.insert(4, &[2]), Ok(()));
        assert_eq!(memory.image(), Ok(vec![2, 0xFF, 0xFF, 1]));
        assert_eq!(memory.insert(4 + MAX_SPAN - 1, &[3]), Ok(()));
        assert_eq!(memory.image().map(|image| image.len() as u64), Ok(MAX_SPAN));
        assert_eq!(memory.insert(4 + MAX_SPAN, &[3]), Ok(()));
        assert!(memory.image().is_err());
    }
}
