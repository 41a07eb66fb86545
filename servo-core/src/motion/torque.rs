//! Torque to voltage without a current sensor in the loop: the resistive drop of the torque's current plus the motor's EMF at
//! its speed (decision 0005). Voltages are in torque units: 1024 is 24 V, the bus at which full duty at standstill gives
//! the motor's peak torque.

use crate::num::{Law, round_product, saturating_i16};
use crate::units::{CountsPerSec, Torque};

/// EMF in torque units per count/s: 0.0651 V·s/rad (manual: 65 N·cm at 9.98 A) × 2π/18 rad/count is 22.72 mV
/// per count/s, and a torque unit is 24 V / 1024 = 23.44 mV.
pub const EMF_PER_SPEED: Law = Law::lit("0.9696");

/// Least damping of a law before the EMF may be compensated in full, in torque units per count/s. A motor whose Ke is 30 % low
/// gets 0.3 × 0.97 = 0.29 too much; with 3/8, T = 0 never accelerates it (decision 0005).
pub const MIN_DAMPING: Law = Law::lit("0.375");

/// Damping to add to a law that damps by `damping` torque units per count/s to reach [`MIN_DAMPING`]; 0 if it damps enough.
#[must_use]
pub fn missing(damping: Law) -> Law {
    MIN_DAMPING.saturating_sub(damping).max(Law::ZERO)
}

/// A law's torque with the missing damping added, before every limit, so that plugging at speed stays inside the torque limit.
#[must_use]
#[inline]
pub fn damped(torque: Torque, velocity: CountsPerSec, missing: Law) -> Torque {
    if missing == Law::ZERO {
        return torque;
    }
    Torque(saturating_i16(i32::from(torque.0) - round_product(missing, velocity.0)))
}

/// The motor's EMF at a velocity, in torque units: torque + EMF is the voltage across the driven phases, and
/// voltage − EMF the torque that it gives. Within ±31,772.
#[must_use]
#[inline]
pub fn emf(velocity: CountsPerSec) -> i32 {
    round_product(EMF_PER_SPEED, velocity.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::product;

    /// EMF of a motor whose Ke is 30 % low.
    const WEAK_EMF: Law = Law::lit("0.6787");

    #[test]
    fn no_load_speed_is_full_voltage() {
        // 24 V / 22.72 mV = 1056 counts/s (decision 0003).
        assert_eq!(emf(CountsPerSec::from_int(1056)), 1024);
        assert_eq!(emf(CountsPerSec::from_int(-1056)), -1024);
    }

    #[test]
    fn zero_torque_brakes_a_low_ke_motor_at_any_speed_and_gain() {
        for sixteenths in 0..16 {
            let damping: Law = Law::from_num(sixteenths) >> 4;
            for speed in [-1500, -300, -20, 20, 300, 1500] {
                let velocity = CountsPerSec::from_int(speed);
                let law = Torque::from_fixed(product(damping, velocity.0)).saturating_neg();
                let applied = i32::from(damped(law, velocity, missing(damping)).0) + emf(velocity);
                let current = Law::from_num(applied).saturating_sub(product(WEAK_EMF, velocity.0));
                assert!(current.signum() == -velocity.0.signum(), "{current} at {speed}, gain {damping}");
            }
        }
    }
}
