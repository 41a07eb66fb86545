//! Physical quantities as newtypes, each with one scale (decision 0002). Every conversion between a raw integer and a quantity
//! is here. Positions are in hall counts, 18 a motor revolution, positive in the closing direction.

use fixed::types::{I1F15, I16F16, I22F10};

/// A position or a distance in hall counts, with 1/1024 count resolution. The 22 integer bits are those of the wire's
/// position frame: ±2,097,151 counts, 33 minutes at full speed. A position wraps there; a difference is right across the
/// wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Counts(pub I22F10);

impl Counts {
    /// Position or distance zero.
    pub const ZERO: Self = Self(I22F10::ZERO);

    /// A whole number of counts; wraps outside ±2^21.
    #[must_use]
    pub const fn from_int(counts: i32) -> Self {
        Self(I22F10::from_bits(counts << 10))
    }

    /// The nearest whole count, which property P reads.
    #[must_use]
    pub const fn round(self) -> i32 {
        self.0.to_bits().wrapping_add(512) >> 10
    }

    /// `self + other`, wrapping as a position counter does.
    #[must_use]
    pub const fn wrapping_add(self, other: Self) -> Self {
        Self(self.0.wrapping_add(other.0))
    }

    /// `self − other`, wrapping: the true distance while it is under 2^21 counts.
    #[must_use]
    pub const fn wrapping_sub(self, other: Self) -> Self {
        Self(self.0.wrapping_sub(other.0))
    }

    /// The opposite distance; −2^21 counts stays as it is.
    #[must_use]
    pub const fn wrapping_neg(self) -> Self {
        Self(self.0.wrapping_neg())
    }

    /// The distance as a control error, saturated to ±32767 counts.
    #[must_use]
    pub fn saturating_error(self) -> I16F16 {
        I16F16::from_bits(self.0.to_bits().clamp(i32::MIN >> 6, i32::MAX >> 6) << 6)
    }
}

/// A velocity in hall counts per second, ±32767 with 1/65536 resolution; positive closes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct CountsPerSec(pub I16F16);

impl CountsPerSec {
    /// Standstill.
    pub const ZERO: Self = Self(I16F16::ZERO);

    /// A whole number of counts per second.
    #[must_use]
    pub const fn from_int(counts_per_sec: i16) -> Self {
        Self(I16F16::from_bits((counts_per_sec as i32) << 16))
    }

    /// The opposite velocity.
    #[must_use]
    pub const fn saturating_neg(self) -> Self {
        Self(self.0.saturating_neg())
    }

    /// The nearest whole number of counts per second, halves up, which property V reads.
    #[must_use]
    pub const fn round(self) -> i16 {
        ((self.0.to_bits().saturating_add(1 << 15)) >> 16) as i16
    }
}

/// A torque in 1/1024 of the motor's peak (65 N·cm: stall at full duty and 24 V); positive closes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Torque(pub i16);

impl Torque {
    /// No torque.
    pub const ZERO: Self = Self(0);

    /// The magnitude; −32768 saturates to 32767.
    #[must_use]
    pub const fn saturating_abs(self) -> Self {
        Self(self.0.saturating_abs())
    }

    /// The opposite torque; −32768 saturates to 32767.
    #[must_use]
    pub const fn saturating_neg(self) -> Self {
        Self(self.0.saturating_neg())
    }

    /// The difference of two torques; saturates.
    #[must_use]
    pub const fn saturating_sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }

    /// The sum of two torques; saturates.
    #[must_use]
    pub const fn saturating_add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }

    /// Bounded to ±`limit` (`limit` ≥ 0).
    #[must_use]
    pub fn clamp_abs(self, limit: Self) -> Self {
        Self(self.0.max(limit.0.saturating_neg()).min(limit.0))
    }

    /// Rounded from a control law's result, which is below 32,767.5.
    #[must_use]
    pub const fn from_fixed(units: I16F16) -> Self {
        Self(((units.to_bits() + (1 << 15)) >> 16) as i16)
    }
}

/// A bridge duty as a signed fraction of the bus voltage across the two driven phases, −1 ≤ d < 1 in 1/32768.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Duty(pub I1F15);

impl Duty {
    /// Both driven phases at the same potential: the motor's EMF is short-circuited through them.
    pub const ZERO: Self = Self(I1F15::ZERO);

    /// From 1/32768 of the bus voltage.
    #[must_use]
    pub const fn from_bits(bits: i16) -> Self {
        Self(I1F15::from_bits(bits))
    }
}

/// A time-stamp or a duration in microseconds. Time-stamps wrap after 71.6 minutes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Micros(pub u32);

impl Micros {
    /// The time from `earlier` to `self`, right across the wrap for up to 71.6 minutes.
    #[must_use]
    pub const fn wrapping_since(self, earlier: Self) -> Self {
        Self(self.0.wrapping_sub(earlier.0))
    }

    /// The time-stamp `by` later, wrapping.
    #[must_use]
    pub const fn wrapping_add(self, by: Self) -> Self {
        Self(self.0.wrapping_add(by.0))
    }
}

/// A temperature in tenths of a degree Celsius.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct DeciCelsius(pub i16);

/// A bus voltage in millivolts, 0..65 V.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct MilliVolts(pub u16);

/// A current in milliamperes, ±32 A.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct MilliAmps(pub i16);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn torque_is_bounded_either_way() {
        let bounded = |torque| Torque(torque).clamp_abs(Torque(100));
        assert_eq!([-101, -100, 0, 7, 100, 101].map(bounded), [-100, -100, 0, 7, 100, 100].map(Torque));
    }
}
