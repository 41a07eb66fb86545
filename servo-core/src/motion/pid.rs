//! The position PID of modes 3 and 5. Each tick of T = 1 ms, with e in counts and ė = set-point velocity − measured velocity
//! in counts/s,
//!
//! ```text
//! torque = KP·e + I + KD/256·ė        I = I + KI·T·e, limited to the available torque
//! ```
//!
//! in torque units. In a move the set-point has the profile's velocity, so the motor does not lag behind it. In a hold that
//! is zero, so the derivative acts on the measurement alone and a step of P gives no kick (decision 0006).

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
    /// The coefficients of a tick. Gains saturate at 32,767.
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

/// The integral I, in torque units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PidState {
    integral: Law,
}

impl Pid {
    /// One tick with `error` in counts and `velocity_error` in counts/s; returns a torque in `low..=high`, which the limits
    /// and the bus voltage leave at the present speed. Anti-windup: the integral stays within that range and pauses while
    /// the output is beyond its end in the error's direction.
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
        // Range and integral are within ±1024, products within ±8192: no sum overflows.
        let unbounded = direct + state.integral;
        let winding_up =
            (unbounded > high && increment > Law::ZERO) || (unbounded < low && increment < Law::ZERO);
        if !winding_up {
            state.integral = (state.integral + increment).max(low).min(high);
        }
        Torque::from_fixed((direct + state.integral).max(low).min(high))
    }

    /// The state from which the next step gives `torque`: a bumpless transfer. The integral stays within ±`limit`.
    #[must_use]
    pub fn bumpless(&self, torque: Torque, error: Law, velocity_error: Law, limit: Torque) -> PidState {
        let limit = limit.to_fixed();
        let integral = torque.to_fixed().saturating_sub(self.direct(error, velocity_error));
        // Unlike `clamp`, this has no panic.
        PidState { integral: integral.max(limit.saturating_neg()).min(limit) }
    }

    /// Damping that the law lacks: see [`missing`].
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
    fn gains_have_their_scale() {
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
    fn long_saturation_leaves_no_windup() {
        let law = law(60, 3000, 0);
        let mut state = PidState::default();
        for _ in 0..10_000 {
            assert_eq!(law.step(&mut state, Law::from_num(100), Law::ZERO, RANGE), LIMIT);
        }
        assert!(law.step(&mut state, Law::from_num(-1), Law::ZERO, RANGE) < Torque::ZERO);
    }

    proptest! {
        #[test]
        fn torque_and_integral_stay_in_range(
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
        fn bumpless_state_gives_no_bump(
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

    /// At the end of its range exactly, the integral still takes a step; beyond it pauses, but for an error of the other sign.
    #[test]
    fn integral_pauses_beyond_the_end_of_the_range() {
        let pid = law(60, 800, 0);
        for (sign, end) in [(1, LIMIT), (-1, LIMIT.saturating_neg())] {
            let error = Law::from_num(sign);
            let (direct, increment) = (pid.direct(error, Law::ZERO), mul_clamped(pid.ki, error));
            let delta = Law::DELTA * sign;
            assert!(direct.abs() > increment.abs() && increment != Law::ZERO);
            for (beyond, moves) in [(-delta, true), (Law::ZERO, true), (delta, false)] {
                let from = end.to_fixed() - direct + beyond;
                let mut state = PidState { integral: from };
                assert_eq!(pid.step(&mut state, error, Law::ZERO, RANGE), end);
                assert_eq!(state.integral, if moves { from + increment } else { from }, "{sign} {beyond}");
            }
            let mut state = PidState { integral: end.to_fixed() };
            let _ = pid.step(&mut state, -error, Law::from_num(sign * 200), RANGE);
            assert_eq!(state.integral, end.to_fixed() - increment, "back");
        }
    }
}
