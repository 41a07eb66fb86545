//! How a motor's six wires are connected: the hall code of each sector of the bridge, and the order of the phases.
//!
//! Three hall lines and three phases in any order, with any of the lines inverted, give 48 relations between hall code and
//! bridge sector: 6 shifts, 2 senses and 4 ways of inverting lines (inverting all three is a shift by three sectors). Each
//! has a mirror image, in which the same motor runs the other way and counts the other way: nothing on the board can tell
//! the two apart (decision 0046).

/// Lines that differ between opposite sectors: all.
const ALL_LINES: u8 = 7;

/// Codes of sectors 0..5 of the hand's motors (decision 0003).
const STANDARD: [u8; 6] = [2, 6, 4, 5, 1, 3];

/// Sectors of an electrical revolution.
const SECTORS: u8 = 6;

/// The wiring of one motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wiring {
    sectors: [Option<u8>; 8],
    codes: [u8; 6],
    /// Bit set of the codes that a rising line leads to.
    two_high: u8,
    swapped: bool,
}

impl Wiring {
    /// Wirings that differ, mirror images included.
    pub const NUMBERS: u8 = 96;

    /// The wiring that the hand's boards are shipped with.
    pub const STANDARD: Self = Self {
        sectors: [None, Some(4), Some(0), Some(5), Some(2), Some(3), Some(1), None],
        codes: STANDARD,
        two_high: 0b0110_1000,
        swapped: false,
    };

    /// Wiring with these codes of sectors 0 to 5. `None` unless neighbors, the last and the first included, differ in one line
    /// and opposite sectors in all three, as those of three sensors 120° apart do.
    #[must_use]
    pub fn new(codes: [u8; 6]) -> Option<Self> {
        let mut sectors = [None; 8];
        let [a, b, c, d, e, f] = codes;
        let opposite = a ^ d == ALL_LINES && b ^ e == ALL_LINES && c ^ f == ALL_LINES;
        let mut previous = f;
        for (code, sector) in codes.into_iter().zip(0..) {
            if (code ^ previous).count_ones() != 1 {
                return None;
            }
            let slot = sectors.get_mut(usize::from(code))?;
            if slot.replace(sector).is_some() {
                return None;
            }
            previous = code;
        }
        // Of the two codes that do not occur, the one with at most one line high names the inverted line.
        let inverted = [0, 1, 2, 4].into_iter().find(|code| !codes.contains(code))?;
        let mut two_high = 0;
        for code in codes {
            if (code ^ inverted).count_ones() == 2 {
                two_high |= 1 << code;
            }
        }
        opposite.then_some(Self { sectors, codes, two_high, swapped: false })
    }

    /// The wiring of a number below [`Self::NUMBERS`]: the sector of the first standard code, plus 6 if the codes come in the
    /// reversed order, plus 12 for each way of inverting a line (none, line 0, 1, 2), plus 48 if phases B and C are interchanged.
    #[must_use]
    pub fn from_number(number: u8) -> Option<Self> {
        if number >= Self::NUMBERS {
            return None;
        }
        let (first, reversed, swapped) = (number % 6, !(number / 6).is_multiple_of(2), number >= 48);
        let inverted = (1 << (number / 12 % 4)) >> 1;
        let mut codes = [0; 6];
        for (code, sector) in STANDARD.into_iter().zip(0..) {
            let step = if reversed { SECTORS - sector } else { sector };
            *codes.get_mut(usize::from((first + step) % SECTORS))? = code ^ inverted;
        }
        Some(Self { swapped, ..Self::new(codes)? })
    }

    /// The number of [`Self::from_number`].
    #[must_use]
    pub fn number(&self) -> u8 {
        (0..Self::NUMBERS).find(|&number| Self::from_number(number).as_ref() == Some(self)).unwrap_or(0)
    }

    /// The same relation of codes and bridge with the other sense of closing.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        let [a, b, c, d, e, f] = self.codes;
        // Interchanging B and C turns the legs of sector k into those of sector 1 - k, and closing is then the other direction: three
        // sectors further.
        let mirror = Self::new([e, d, c, b, a, f]).unwrap_or(*self);
        Self { swapped: !self.swapped, ..mirror }
    }

    /// Whether phases B and C are interchanged.
    #[must_use]
    pub const fn swaps_phases(&self) -> bool {
        self.swapped
    }

    /// Bit set of the codes that a rising line leads to: neighbors have alternately one and two lines high, apart from an
    /// inverted line.
    #[inline]
    #[must_use]
    pub const fn two_high(&self) -> u8 {
        self.two_high
    }

    /// The sector 0..=5 of a code (bits above 2 are ignored); `None` for the two that do not occur.
    #[must_use]
    pub fn sector(&self, code: u8) -> Option<u8> {
        self.sectors.get(usize::from(code & 7)).copied().flatten()
    }

    /// The code in a sector; sectors repeat every six.
    #[must_use]
    pub fn code(&self, sector: u8) -> u8 {
        self.codes.get(usize::from(sector % SECTORS)).copied().unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all() -> impl Iterator<Item = Wiring> {
        (0..=255).filter_map(Wiring::from_number)
    }

    #[test]
    fn each_number_is_a_wiring_of_its_own_and_comes_back() {
        assert_eq!(all().count(), 48 * 2);
        for wiring in all() {
            assert_eq!(all().filter(|other| *other == wiring).count(), 1, "{wiring:?}");
            assert_eq!(Wiring::from_number(wiring.number()), Some(wiring));
        }
        assert_eq!(Wiring::STANDARD.number(), 0);
        assert_eq!(Wiring::new(STANDARD), Some(Wiring::STANDARD));
    }

    #[test]
    fn codes_of_all_48_relations_and_no_others_are_a_wiring() {
        let digits = |number: u32| {
            [0, 1, 2, 3, 4, 5].map(|place| u8::try_from(number / 8_u32.pow(place) % 8).unwrap())
        };
        let found = (0..8_u32.pow(6)).filter_map(|number| Wiring::new(digits(number)));
        let consistent =
            |wiring: &Wiring| (0..6).all(|sector| wiring.sector(wiring.code(sector)) == Some(sector));
        assert_eq!(found.filter(consistent).count(), 48);
    }

    #[test]
    fn mirror_of_the_mirror_is_the_wiring() {
        for wiring in all() {
            let mirror = wiring.mirrored();
            assert_ne!(mirror, wiring);
            assert_eq!(mirror.mirrored(), wiring);
            // The legs of sector k with B and C interchanged are those of sector 1 - k, and the other sign is three further.
            assert!((0..6).all(|sector| mirror.code((10 - sector) % 6) == wiring.code(sector)));
        }
    }
}
