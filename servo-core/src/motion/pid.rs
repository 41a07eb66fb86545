//! The position PID of modes 3 and 5.
//!
//! Torque = KP·e + ∫KI·e + KD·(set-point velocity − measured velocity). In a move the set-point's velocity is
//! the profile's, so the motor does not lag behind a moving set-point; in a hold it is zero, so the derivative
//! acts on the measurement alone and a commanded step gives no kick (DESIGN 4.3).

use crate::motion::torque::missing;
use crate::num::{Law, TICK_HZ, gain, mul_clamped, sum_of_products};
use crate::units::Torque;

/// The gains as the host sets them: properties KP, KI, KD.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PidConfig {
    /// Torque units per count.
    pub kp: u16,
    /// Torque units per count·second.
    pub ki: u16,
    /// 1/256 torque unit per count/s.
    pub kd: u16,
}

impl PidConfig {
    /// The gains in the scale of a tick. Every value of the properties' ranges is allowed; products saturate.
    #[must_use]
    pub fn build(self) -> Pid {
        // The largest KI of 32767 is 32.767 a tick; the truncation of the smallest (1) is 0.8 %.
        let ki = gain(self.ki, 0).checked_div_int(TICK_HZ.cast_signed()).unwrap_or(Law::ZERO);
        let kd = gain(self.kd, 8);
        Pid { kp: gain(self.kp, 0), ki, kd, missing: missing(kd) }
    }
}

/// The law's coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pid {
    kp: Law,
    ki: Law,
    kd: Law,
    missing: Law,
}

/// What the law remembers: the integral, in torque units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PidState {
    integral: Law,
}

impl Pid {
    /// One tick: `error` in counts, `velocity_error` in counts/s, torque from `low` to `high`: what the limits
    /// and the bus voltage leave at the present speed, which is not the same both ways.
    ///
    /// The integral stands still while the output is at the end of that range in the error's direction
    /// (anti-windup), and never leaves the range by itself.
    #[must_use]
    pub fn step(
        &self,
        state: &mut PidState,
        error: Law,
        velocity_error: Law,
        (low, high): (Torque, Torque),
    ) -> Torque {
        let direct = self.direct(error, velocity_error);
        let (low, high) = (low.to_fixed(), high.to_fixed());
        let increment = mul_clamped(self.ki, error);
        // The range is an envelope's, within ±1024, and the integral is inside it; products are within ±8192: no sum wraps.
        let unbounded = direct + state.integral;
        let winding_up =
            (unbounded > high && increment > Law::ZERO) || (unbounded < low && increment < Law::ZERO);
        if !winding_up {
            state.integral = (state.integral + increment).max(low).min(high);
        }
        Torque::from_fixed((direct + state.integral).max(low).min(high))
    }

    /// The state from which the next step gives `torque`, so that taking over from another law, or moving the
    /// set-point to the measured position, gives no bump. The integral stays within ±`limit`.
    #[must_use]
    pub fn bumpless(&self, torque: Torque, error: Law, velocity_error: Law, limit: Torque) -> PidState {
        let limit = limit.to_fixed();
        let integral = torque.to_fixed().saturating_sub(self.direct(error, velocity_error));
        // `clamp` would ask whether the bounds are in order.
        PidState { integral: integral.max(limit.saturating_neg()).min(limit) }
    }

    /// What the law lacks in damping: see [`missing`].
    #[must_use]
    pub const fn missing_damping(&self) -> Law {
        self.missing
    }

    fn direct(&self, error: Law, velocity_error: Law) -> Law {
        // Gains are not negative.
        sum_of_products((self.kp, error), (self.kd, velocity_error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMIT: Torque = Torque(750);
    const RANGE: (Torque, Torque) = (Torque(-750), LIMIT);

    fn law(kp: u16, ki: u16, kd: u16) -> Pid {
        PidConfig { kp, ki, kd }.build()
    }

    #[test]
    fn each_gain_has_its_scale() {
        let mut state = PidState::default();
        assert_eq!(law(60, 0, 0).step(&mut state, Law::ONE, Law::ZERO, RANGE), Torque(60));
        assert_eq!(law(0, 0, 128).step(&mut state, Law::ZERO, Law::from_num(100), RANGE), Torque(50));
        let integral = law(0, 300, 0);
        let mut torque = Torque::ZERO;
        for _ in 0..1000 {
            torque = integral.step(&mut state, Law::ONE, Law::ZERO, RANGE);
        }
        // One count for one second, less the truncation of KI to a tick.
        assert!((299..=300).contains(&torque.0), "{torque:?}");
    }

    #[test]
    fn a_long_saturation_leaves_no_windup() {
        let law = law(60, 3000, 0);
        let mut state = PidState::default();
        for _ in 0..10_000 {
            assert_eq!(law.step(&mut state, Law::from_num(100), Law::ZERO, RANGE), LIMIT);
        }
        // The proportional part alone was at the limit, so nothing was integrated and the way back is free.
        assert!(law.step(&mut state, Law::from_num(-1), Law::ZERO, RANGE) < Torque::ZERO);
    }

    proptest! {
        #[test]
        fn never_beyond_the_limits(
            gains: (u16, u16, u16), errors in prop::collection::vec((any::<i32>(), any::<i32>()), 1..50),
            low in -990i16..=990, room in 0i16..=990,
        ) {
            let law = law(gains.0 >> 1, gains.1 >> 1, gains.2 >> 1);
            let mut state = PidState::default();
            let (low, high) = (Torque(low), Torque(low + room));
            for (error, rate) in errors {
                let torque = law.step(&mut state, Law::from_bits(error), Law::from_bits(rate), (low, high));
                prop_assert!(low <= torque && torque <= high);
                prop_assert!(low.to_fixed() <= state.integral.max(low.to_fixed()) && state.integral <= high.to_fixed().max(Law::ZERO));
            }
        }

        #[test]
        fn taking_over_gives_no_bump(
            torque in -750i16..=750, error in -3i32..=3, rate in -200i32..=200,
        ) {
            let law = law(60, 300, 192);
            let (error, rate) = (Law::from_num(error), Law::from_num(rate));
            let mut state = law.bumpless(Torque(torque), error, rate, LIMIT);
            let integral_was_clamped = state.integral.saturating_abs() == LIMIT.to_fixed();
            let next = law.step(&mut state, error, rate, RANGE);
            // One tick of integral action at 3 counts is 0.9 units.
            prop_assert!(integral_was_clamped || (next.0 - torque).abs() <= 1, "{next:?} after {torque}");
        }
    }
}
