//! The position PID of modes 3 and 5.
//!
//! Torque = KP·e + ∫KI·e + KD·(set-point velocity − measured velocity). In a move the set-point's velocity is
//! the profile's, so the motor does not lag behind a moving set-point; in a hold it is zero, so the derivative
//! acts on the measurement alone and a commanded step gives no kick (DESIGN 4.3).

use crate::num::{Law, TICK_HZ, gain};
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
        Pid { kp: gain(self.kp, 0), ki, kd: gain(self.kd, 8) }
    }
}

/// The law's coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pid {
    kp: Law,
    ki: Law,
    kd: Law,
}

/// What the law remembers: the integral, in torque units.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PidState {
    integral: Law,
}

impl Pid {
    /// One tick: `error` in counts, `velocity_error` in counts/s, torque within ±`limit`.
    ///
    /// The integral stands still while the output is at the limit in the error's direction (anti-windup), and
    /// never exceeds the limit by itself.
    #[must_use]
    pub fn step(&self, state: &mut PidState, error: Law, velocity_error: Law, limit: Torque) -> Torque {
        let direct = self.direct(error, velocity_error);
        let limit = limit.to_fixed();
        let increment = self.ki.saturating_mul(error);
        let unbounded = direct.saturating_add(state.integral);
        let winding_up = (unbounded > limit && increment > Law::ZERO)
            || (unbounded < limit.saturating_neg() && increment < Law::ZERO);
        if !winding_up {
            state.integral =
                state.integral.saturating_add(increment).clamp(limit.saturating_neg(), limit);
        }
        let torque = direct.saturating_add(state.integral).clamp(limit.saturating_neg(), limit);
        Torque::from_fixed(torque)
    }

    /// The state from which the next step gives `torque`, so that taking over from another law, or moving the
    /// set-point to the measured position, gives no bump. The integral stays within ±`limit`.
    #[must_use]
    pub fn bumpless(&self, torque: Torque, error: Law, velocity_error: Law, limit: Torque) -> PidState {
        let limit = limit.to_fixed();
        let integral = torque.to_fixed().saturating_sub(self.direct(error, velocity_error));
        PidState { integral: integral.clamp(limit.saturating_neg(), limit) }
    }

    /// The damping of the velocity, in torque units per count/s.
    #[must_use]
    pub const fn damping(&self) -> Law {
        self.kd
    }

    fn direct(&self, error: Law, velocity_error: Law) -> Law {
        self.kp.saturating_mul(error).saturating_add(self.kd.saturating_mul(velocity_error))
    }
}
