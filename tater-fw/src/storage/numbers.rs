//! A set of property numbers.

/// Numbers 0 to 127, which are all that the wire has. In words of 32 bits: shifts of a `u128` are long on a Cortex-M3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Numbers([u32; 4]);

impl Numbers {
    /// Adds a number; none beyond 127.
    pub fn insert(&mut self, number: u8) {
        if let Some(word) = self.0.get_mut(usize::from(number / 32)) {
            *word |= 1 << (number % 32);
        }
    }

    /// Whether it has a number.
    pub fn contains(&self, number: u8) -> bool {
        self.0.get(usize::from(number / 32)).is_some_and(|word| word >> (number % 32) & 1 != 0)
    }

    /// Whether it has none.
    pub fn is_empty(&self) -> bool {
        self.0.iter().all(|&word| word == 0)
    }

    /// All that it has, rising.
    pub fn iter(self) -> impl Iterator<Item = u8> {
        (0..128).filter(move |&number| self.contains(number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn it_has_what_was_inserted_and_nothing_else() {
        let mut numbers = Numbers::default();
        assert!(numbers.is_empty());
        for number in [127, 0, 31, 32, 64, 95, 128, 255] {
            numbers.insert(number);
        }
        assert_eq!(numbers.iter().collect::<Vec<_>>(), [0, 31, 32, 64, 95, 127]);
        assert!(!numbers.is_empty() && !numbers.contains(128) && !numbers.contains(255));
    }
}
