//! Mode 4: torque = gain × velocity error, nothing else (manual 6.1). RealTime and TC/TO run on it.

use crate::motion::torque::missing;
use crate::num::{Law, gain, round_product, saturating_i16};
use crate::units::{CountsPerSec, Torque};

/// The velocity law with its gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VelocityLoop {
    gain: Law,
    missing: Law,
}

impl VelocityLoop {
    /// With property KPV, in 1/16 torque unit per count/s.
    #[must_use]
    pub fn new(kpv: u16) -> Self {
        let gain = gain(kpv, 4);
        Self { gain, missing: missing(gain) }
    }

    /// The torque towards `wanted`, within ±`limit`.
    #[must_use]
    pub fn step(&self, wanted: CountsPerSec, measured: CountsPerSec, limit: Torque) -> Torque {
        let error = wanted.0.saturating_sub(measured.0);
        let limit = i32::from(limit.0);
        let torque = round_product(self.gain, error).max(-limit).min(limit);
        Torque(saturating_i16(torque))
    }

    /// Damping that the law lacks: see [`missing`].
    #[must_use]
    pub const fn missing_damping(&self) -> Law {
        self.missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn torque_is_gain_times_error() {
        let torque =
            VelocityLoop::new(24).step(CountsPerSec::from_int(300), CountsPerSec::from_int(200), Torque(750));
        assert_eq!(torque, Torque(150));
    }

    proptest! {
        #[test]
        fn torque_stays_within_the_limit(kpv in 0u16..=255, wanted: i32, measured: i32, limit in 0i16..=990) {
            let (wanted, measured) = (CountsPerSec(Law::from_bits(wanted)), CountsPerSec(Law::from_bits(measured)));
            let torque = VelocityLoop::new(kpv).step(wanted, measured, Torque(limit));
            prop_assert!(torque.saturating_abs() <= Torque(limit));
            prop_assert!(torque == Torque::ZERO || (torque > Torque::ZERO) == (wanted > measured));
        }
    }
}
