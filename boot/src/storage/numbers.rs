//! A set of property numbers.

/// Numbers 0 to 127, the range of the wire. In words of 32 bits: shifts of a `u128` are long on a Cortex-M3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Numbers([u32; 4]);

impl Numbers {
    pub const NONE: Self = Self([0; 4]);

    /// Numbers up to 127.
    pub const fn with(self, number: u8) -> Self {
        let ([a, b, c, d], bit) = (self.0, 1 << (number % 32));
        Self(match number / 32 {
            0 => [a | bit, b, c, d],
            1 => [a, b | bit, c, d],
            2 => [a, b, c | bit, d],
            _ => [a, b, c, d | bit],
        })
    }

    /// Intersection.
    pub const fn both(self, other: Self) -> Self {
        let ([a, b, c, d], [e, f, g, h]) = (self.0, other.0);
        Self([a & e, b & f, c & g, d & h])
    }

    pub const fn without(self, other: Self) -> Self {
        let [a, b, c, d] = other.0;
        self.both(Self([!a, !b, !c, !d]))
    }

    pub fn extend(&mut self, other: Self) {
        self.0.iter_mut().zip(other.0).for_each(|(word, other)| *word |= other);
    }

    /// Ignores numbers above 127.
    pub fn insert(&mut self, number: u8) {
        if let Some(word) = self.0.get_mut(usize::from(number / 32)) {
            *word |= 1 << (number % 32);
        }
    }

    pub fn remove(&mut self, number: u8) {
        if let Some(word) = self.0.get_mut(usize::from(number / 32)) {
            *word &= !(1 << (number % 32));
        }
    }

    #[inline(always)]
    pub fn contains(&self, number: u8) -> bool {
        self.0.get(usize::from(number / 32)).is_some_and(|word| word >> (number % 32) & 1 != 0)
    }

    pub fn is_empty(&self) -> bool {
        self.0.iter().all(|&word| word == 0)
    }

    /// In ascending order.
    pub fn iter(self) -> impl Iterator<Item = u8> {
        let [mut word, b, c, d] = self.0;
        let (mut first, mut others) = (0, [b, c, d].into_iter());
        core::iter::from_fn(move || {
            while word == 0 {
                word = others.next()?;
                first += 32;
            }
            let number = first + word.trailing_zeros();
            word &= word - 1;
            // Below 128.
            u8::try_from(number).ok()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn set_contains_exactly_the_inserted_numbers() {
        let mut numbers = Numbers::default();
        assert!(numbers.is_empty());
        for number in [127, 0, 31, 32, 64, 95, 128, 255] {
            numbers.insert(number);
        }
        assert_eq!(numbers.iter().collect::<Vec<_>>(), [0, 31, 32, 64, 95, 127]);
        assert!(!numbers.is_empty() && !numbers.contains(128) && !numbers.contains(255));
        numbers.remove(64);
        numbers.remove(200);
        assert_eq!(numbers.iter().collect::<Vec<_>>(), [0, 31, 32, 95, 127]);
        for number in [1, 33, 65, 97] {
            let once = Numbers::NONE.with(number);
            assert_eq!((once.with(number), once.iter().count()), (once, 1), "{number} twice");
        }
        let mut other = Numbers::NONE.with(1).with(32).with(94).with(127);
        assert_eq!(numbers.both(other).iter().collect::<Vec<_>>(), [32, 127]);
        assert_eq!(numbers.without(other).iter().collect::<Vec<_>>(), [0, 31, 95]);
        other.extend(numbers);
        assert_eq!(other.iter().collect::<Vec<_>>(), [0, 1, 31, 32, 94, 95, 127]);
    }
}
