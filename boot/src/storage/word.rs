//! Half-words that reveal cut programming.
//!
//! A cut leaves zeros missing. So each word counts its own zeros (a Berger code): data that lost zeros have
//! fewer, a count that lost zeros is larger, and the two never match again. Neither an erased half-word nor 0
//! is a valid word.

/// Bits of data: two for the kind, ten for the amount.
const DATA_BITS: u16 = 12;

const AMOUNT_BITS: u16 = 10;

pub const MOST: u16 = (1 << AMOUNT_BITS) - 1;

/// Starts any content of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Word {
    /// UPSECS grew by so many seconds.
    Time(u16),
    /// OD grew by so many revolutions; in journals of earlier programs by so many thousands of counts.
    Travel(u16),
    /// PTEMP rose by so many tenths of a degree.
    Heat(u16),
    /// Starts a record of so many half-words.
    Record(u16),
}

impl Word {
    /// The hot mark, and its removal: growths by nothing, so that a program that does not know them skips them.
    pub const HOT: Self = Self::Heat(0);
    /// See [`Self::HOT`].
    pub const COOL: Self = Self::Travel(0);

    /// The hot mark after this word; `None` if it says nothing about it.
    pub const fn hot_mark(self) -> Option<bool> {
        match self {
            Self::HOT => Some(true),
            Self::COOL => Some(false),
            _ => None,
        }
    }

    /// Amounts are at most [`MOST`].
    pub const fn encode(self) -> u16 {
        let (kind, amount) = match self {
            Self::Time(amount) => (0, amount),
            Self::Travel(amount) => (1, amount),
            Self::Heat(amount) => (2, amount),
            Self::Record(amount) => (3, amount),
        };
        let data = kind << AMOUNT_BITS | amount & MOST;
        zeros(data) << DATA_BITS | data
    }

    /// `None` if it was not programmed completely.
    pub const fn decode(word: u16) -> Option<Self> {
        let data = word & ((1 << DATA_BITS) - 1);
        if zeros(data) != word >> DATA_BITS {
            return None;
        }
        let amount = data & MOST;
        Some(match data >> AMOUNT_BITS {
            0 => Self::Time(amount),
            1 => Self::Travel(amount),
            2 => Self::Heat(amount),
            _ => Self::Record(amount),
        })
    }
}

const fn zeros(data: u16) -> u16 {
    let mut zeros = 0;
    let mut bit = 0;
    while bit < DATA_BITS {
        zeros += 1 - (data >> bit & 1);
        bit += 1;
    }
    zeros
}

pub const fn join(low: u16, high: u16) -> u32 {
    let ([a, b], [c, d]) = (low.to_le_bytes(), high.to_le_bytes());
    u32::from_le_bytes([a, b, c, d])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn word_round_trips_and_no_cut_makes_another() {
        for make in [Word::Time, Word::Travel, Word::Heat, Word::Record] {
            for amount in 0..=MOST {
                let word = make(amount);
                let code = word.encode();
                assert_eq!(Word::decode(code), Some(word));
                // Every code with more ones than this one: all possible results of a cut.
                let missing = !code;
                let mut ones = missing;
                while ones != 0 {
                    assert_eq!(Word::decode(code | ones), None, "{code:04x} cut to {:04x}", code | ones);
                    ones = (ones - 1) & missing;
                }
            }
        }
        assert_eq!((Word::decode(0), Word::decode(u16::MAX)), (None, None));
    }
}
