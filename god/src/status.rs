//! Status codes: what follows "ERR" (manual 5.1.3, table 4).
//!
//! The table leaves 8 and 512 unused, and has no code for a motor that a fault of its board has stopped, nor for a flash that does not take
//! what is saved. GOD uses them for these two, so that no failure is reported as success (decision 0001).

use core::ops::{BitOr, BitOrAssign};

/// `NAME = value, "meaning";`
macro_rules! table {
    ($($name:ident = $value:literal, $meaning:literal;)*) => {
        impl Status {
            $(#[doc = $meaning] pub const $name: Self = Self($value);)*
        }

        /// Every code, by ascending value.
        pub const ROWS: &[StatusSpec] = &[$(StatusSpec { status: Status($value), meaning: $meaning },)*];
    };
}

/// A sum of status codes; 0 is success.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Status(u16);

/// A code's row.
#[derive(Clone, Copy, Debug)]
pub struct StatusSpec {
    /// A power of 2.
    pub status: Status,
    /// Its meaning, as ERR prints it.
    pub meaning: &'static str,
}

table! {
    NO_BOARD = 1, "a motor's board does not answer, or two have its number: ERR 1 names them";
    NO_MOTOR = 2, "no motor is selected";
    NOT_INITIALIZED = 4, "a motor does not know where it is: HI finds out";
    FAULT = 8, "a fault has stopped a motor: G ERROR tells which";
    NOT_REACHED = 16, "a motor ended farther than MPE from where it was to go";
    UNKNOWN_COMMAND = 32, "there is no such command";
    UNKNOWN_PARAMETER = 64, "there is no such parameter";
    INVALID_VALUE = 128, "a value is missing, no number or out of range";
    READ_ONLY = 256, "the parameter can only be read";
    NOT_STORED = 512, "the flash of a board, or of the hand, has not taken what was to be saved";
    TOO_MANY_ARGUMENTS = 1024, "the command takes fewer arguments";
    BAD_HEADER = 2048, "no header of a RealTime control block";
    NO_PREFIX = 4096, "the command takes no motor prefix";
    OVER_TEMPERATURE = 8192, "the hand is hotter than OTEMP, or a motor than it stands";
    ABORTED = 16384, "ended by ^C";
}

impl Status {
    /// Success.
    pub const OK: Self = Self(0);

    /// The number that is printed after ERR.
    #[must_use]
    pub const fn code(self) -> u16 {
        self.0
    }

    /// The status of any number.
    #[must_use]
    pub const fn of(code: u16) -> Self {
        Self(code)
    }

    /// The codes that only the motion knows which they ended. The others hold for as long as their cause does.
    #[must_use]
    pub fn of_motion(self) -> Self {
        let kept = Self::NOT_REACHED | Self::ABORTED | Self::FAULT | Self::NOT_STORED;
        Self(self.0 & kept.0)
    }

    /// Whether it is success.
    #[must_use]
    pub const fn is_ok(self) -> bool {
        self.0 == 0
    }

    /// Whether it contains all of those codes.
    #[must_use]
    pub const fn has(self, codes: Self) -> bool {
        self.0 & codes.0 == codes.0
    }
}

impl BitOr for Status {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for Status {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_ascending_powers_of_two() {
        assert!(ROWS.iter().all(|row| row.status.code().is_power_of_two() && !row.meaning.is_empty()));
        assert!(ROWS.windows(2).all(|pair| pair[0].status.code() < pair[1].status.code()));
        let all = ROWS.iter().fold(Status::OK, |sum, row| sum | row.status);
        assert_eq!(all.code(), 32767);
        assert_eq!(all | Status::NO_BOARD, all, "a union");
    }
}
