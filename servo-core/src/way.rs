//! The two ways of a joint.

/// A way to turn or to push: closing, in which hall counts rise, or opening.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Way {
    /// Counts fall.
    Opening,
    /// Counts rise.
    Closing,
}

impl Way {
    /// The way of a signed quantity (counts, a velocity, a torque); `None` at zero.
    #[inline]
    #[must_use]
    pub const fn of(value: i32) -> Option<Self> {
        match value {
            0 => None,
            1.. => Some(Self::Closing),
            _ => Some(Self::Opening),
        }
    }

    /// Closing if it `closes`, else opening.
    #[inline]
    #[must_use]
    pub const fn closing_if(closes: bool) -> Self {
        if closes { Self::Closing } else { Self::Opening }
    }

    /// Whether it closes.
    #[inline]
    #[must_use]
    pub const fn is_closing(self) -> bool {
        matches!(self, Self::Closing)
    }

    /// The other way.
    #[inline]
    #[must_use]
    pub const fn back(self) -> Self {
        match self {
            Self::Opening => Self::Closing,
            Self::Closing => Self::Opening,
        }
    }

    /// A signed quantity as it counts along this way: positive closing becomes positive this way. Wraps.
    #[inline]
    #[must_use]
    pub const fn along(self, value: i32) -> i32 {
        match self {
            Self::Opening => value.wrapping_neg(),
            Self::Closing => value,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn way_of_a_number_is_its_sign() {
        assert_eq!([-3, 0, 2].map(Way::of), [Some(Way::Opening), None, Some(Way::Closing)]);
        for value in [i32::MIN, -1, 1, i32::MAX] {
            let way = Way::of(value).expect("not zero");
            assert_eq!(way.back().back(), way);
            assert_eq!(
                (way.along(value), way.back().along(value)),
                (value.wrapping_abs(), value.wrapping_abs().wrapping_neg())
            );
        }
    }
}
