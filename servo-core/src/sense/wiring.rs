//! How a motor's six wires are connected: the hall code of each sector of the bridge, and the order of the phases.
//!
//! Three hall lines and three phases in any order, with any of the lines inverted, give 48 relations between hall code and
//! bridge sector: 6 shifts, 2 senses and 4 ways of inverting lines (inverting all three is a shift by three sectors). Each
//! has a mirror image, in which the same motor runs the other way and counts the other way: nothing on the board can tell
//! the two apart (decision 0046).

/// Codes of sectors 0..5 of the hand's motors (decision 0003). Those of odd sectors have two lines high.
const STANDARD: [u8; 6] = [2, 6, 4, 5, 1, 3];

/// Sectors of an electrical revolution.
const SECTORS: u8 = 6;

/// The sector of a code that does not occur.
const NONE: u8 = 0xF;

/// The wiring of one motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// See [`Self::from_number`].
    number: u8,
    /// Bit set of the codes that a rising line leads to.
    two_high: u8,
    /// The sector of each code, in four bits each.
    sectors: u32,
}

impl Wiring {
    /// Wirings that differ, mirror images included.
    pub const NUMBERS: u8 = 96;

    /// Wirings that differ but for the mirror image: the numbers below interchange no phases.
    pub const RELATIONS: u8 = 48;

    /// The wiring that the hand's boards are shipped with.
    pub const STANDARD: Self = Self { number: 0, two_high: 0b0110_1000, sectors: 0xF132_504F };

    /// The wiring of a number below [`Self::NUMBERS`]: the sector of the first standard code, plus 6 if the codes come in the
    /// reversed order, plus 12 for each way of inverting a line (none, line 0, 1, 2), plus 48 if phases B and C are interchanged.
    #[must_use]
    #[inline(never)]
    pub fn from_number(number: u8) -> Option<Self> {
        if number >= Self::NUMBERS {
            return None;
        }
        let (first, reversed) = (number % SECTORS, !(number / SECTORS).is_multiple_of(2));
        let inverted = (1 << (number / 12 % 4)) >> 1;
        let (mut two_high, mut sectors) = (0, u32::MAX);
        let mut sector = first;
        for (code, is_odd) in STANDARD.into_iter().zip([false, true].into_iter().cycle()) {
            let code = code ^ inverted;
            two_high |= u8::from(is_odd) << code;
            sectors ^= u32::from(NONE ^ sector) << (4 * code);
            sector = (if reversed { sector + SECTORS - 1 } else { sector + 1 }) % SECTORS;
        }
        Some(Self { number, two_high, sectors })
    }

    /// The number of [`Self::from_number`].
    #[must_use]
    pub const fn number(&self) -> u8 {
        self.number
    }

    /// The same relation of codes and bridge with the other sense of closing.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        // Interchanging B and C turns the legs of sector k into those of sector 1 - k, and closing is then the other direction: three
        // sectors further.
        let first = (2 * SECTORS - 2 - self.number % SECTORS) % SECTORS;
        let rest = self.number - self.number % SECTORS;
        // 48 more or less, and the reversed order or not: bits of the number's sixths, of which there are 16.
        let sixths = (rest / SECTORS) ^ 0b1001;
        Self::from_number(sixths * SECTORS + first).unwrap_or(*self)
    }

    /// Whether phases B and C are interchanged.
    #[must_use]
    pub const fn swaps_phases(&self) -> bool {
        self.number >= Self::RELATIONS
    }

    /// Bit set of the codes that a rising line leads to: neighbors have alternately one and two lines high, apart from an
    /// inverted line.
    #[inline]
    #[must_use]
    pub const fn two_high(&self) -> u8 {
        self.two_high
    }

    /// The sector 0..=5 of a code (bits above 2 are ignored); `None` for the two that do not occur.
    #[inline]
    #[must_use]
    pub fn sector(&self, code: u8) -> Option<u8> {
        let [sector, ..] = (self.sectors >> (4 * (code & 7)) & u32::from(NONE)).to_le_bytes();
        (sector != NONE).then_some(sector)
    }

    /// The code in a sector; sectors repeat every six.
    #[must_use]
    pub fn code(&self, sector: u8) -> u8 {
        (0..8).find(|&code| self.sector(code) == Some(sector % SECTORS)).unwrap_or(0)
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
        assert_eq!(Wiring::from_number(0), Some(Wiring::STANDARD));
    }

    /// Three sensors 120 degrees apart, in any order, with any of them inverted.
    #[test]
    fn relations_are_all_48_in_which_neighbors_differ_in_one_line_and_opposites_in_three() {
        for wiring in all() {
            let codes: [u8; 6] = core::array::from_fn(|sector| wiring.code(u8::try_from(sector).unwrap()));
            for (at, code) in codes.into_iter().enumerate() {
                assert_eq!(wiring.sector(code), u8::try_from(at).ok());
                assert_eq!((code ^ codes[(at + 1) % 6]).count_ones(), 1, "{codes:?}");
                assert_eq!(code ^ codes[(at + 3) % 6], 7, "{codes:?}");
            }
            let valid = (0..8).filter(|&code| wiring.sector(code).is_some()).count();
            assert_eq!(valid, 6, "{wiring:?}");
            // A code leads to two_high by a line that rises, apart from an inverted one.
            let inverted = (1 << (wiring.number() / 12 % 4)) >> 1;
            for code in codes {
                assert_eq!(wiring.two_high() >> code & 1 != 0, (code ^ inverted).count_ones() == 2);
            }
        }
        let unswapped = || all().filter(|wiring| !wiring.swaps_phases());
        assert_eq!(unswapped().count(), usize::from(Wiring::RELATIONS));
        for a in unswapped() {
            assert_eq!(
                unswapped().filter(|b| (0..8).all(|code| a.sector(code) == b.sector(code))).count(),
                1
            );
        }
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
