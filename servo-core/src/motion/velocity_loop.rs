//! Mode 4: torque = gain × velocity error (manual 6.1), and what friction and load take, up to a bound. RealTime and TC/TO run on it.
//!
//! With v the wanted velocity, d the observed load, F the friction and s the torque beyond F that breaks a resting rotor loose,
//!
//! ```text
//! torque = KPV/16·(v − v̂) + (F + s)·sgn v − max(−D, min(d, D))         the last two only if KPV and v are not 0
//! ```
//!
//! The bound D keeps a blocked motor at the torque of its gain: an unbounded d would rise to MT (decision 0064).

use crate::motion::torque::missing;
use crate::motor::Motor;
use crate::num::{Law, round_product, saturating_i16};
use crate::units::{CountsPerSec, Torque};

/// Least D, torque units, and D over F: 40 of the hand's motor with an F of 47, and of one with less, which carries the same joint.
const LEAST_MOST_LOAD: u32 = 40;
const HAND_FRICTION: u32 = 47;

/// The velocity law with its gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VelocityLoop {
    gain: Law,
    missing: Law,
    most_load: Law,
}

impl VelocityLoop {
    /// With a gain in torque units per count/s.
    #[must_use]
    pub fn new(gain: Law, motor: &Motor) -> Self {
        let emf = Law::from_bits(i32::from(motor.mke) << 4);
        let load = LEAST_MOST_LOAD * u32::from(motor.mfc.min(400)) / HAND_FRICTION;
        Self {
            gain,
            missing: missing(gain, emf),
            most_load: Law::from_bits((load.max(LEAST_MOST_LOAD) << 16).cast_signed()),
        }
    }

    /// The torque towards `wanted`, within ±`limit`. `friction`: F + s; `load`: d.
    #[must_use]
    pub fn step(
        &self,
        wanted: CountsPerSec,
        measured: CountsPerSec,
        (friction, load): (Law, Law),
        limit: Torque,
    ) -> Torque {
        let error = wanted.0.saturating_sub(measured.0);
        let limit = i32::from(limit.0);
        let friction = if wanted.0 < Law::ZERO { -friction } else { friction };
        let more = if self.gain == Law::ZERO || wanted == CountsPerSec::ZERO {
            Law::ZERO
        } else {
            friction - load.max(self.most_load.saturating_neg()).min(self.most_load)
        };
        let more = i32::from(Torque::from_fixed(more).0);
        let torque = (round_product(self.gain, error) + more).max(-limit).min(limit);
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
    use crate::num::gain;
    use proptest::prelude::*;

    const NOTHING: (Law, Law) = (Law::ZERO, Law::ZERO);

    #[test]
    fn torque_is_gain_times_error() {
        let torque = VelocityLoop::new(gain(24, 4), &Motor::HAND).step(
            CountsPerSec::from_int(300),
            CountsPerSec::from_int(200),
            NOTHING,
            Torque(750),
        );
        assert_eq!(torque, Torque(150));
    }

    #[test]
    fn friction_and_load_are_compensated_up_to_their_bound_and_not_at_gain_0() {
        let at = |kpv, wanted, load: i32| {
            let wanted = CountsPerSec::from_int(wanted);
            VelocityLoop::new(gain(kpv, 4), &Motor::HAND)
                .step(wanted, wanted, (Law::from_num(47), Law::from_num(load)), Torque(750))
                .0
        };
        assert_eq!((at(32, 100, 0), at(32, -100, 0), at(32, 0, 0)), (47, -47, 0));
        assert_eq!((at(32, 100, 30), at(32, 100, 300), at(32, 0, -300)), (17, 7, 0));
        assert_eq!(at(0, 100, -300), 0);
    }

    proptest! {
        #[test]
        fn torque_stays_within_the_limit(kpv in 0u16..=255, wanted: i32, measured: i32, limit in 0i16..=990) {
            let (wanted, measured) = (CountsPerSec(Law::from_bits(wanted)), CountsPerSec(Law::from_bits(measured)));
            let torque = VelocityLoop::new(gain(kpv, 4), &Motor::HAND).step(wanted, measured, NOTHING, Torque(limit));
            prop_assert!(torque.saturating_abs() <= Torque(limit));
            prop_assert!(torque == Torque::ZERO || (torque > Torque::ZERO) == (wanted > measured));
        }
    }
}
