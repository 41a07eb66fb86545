//! Torque to voltage without a current sensor in the loop: the resistive drop of the torque's current plus the motor's EMF at
//! its speed (decision 0005). Voltages are in torque units: 1024 is what gives the motor's peak torque at standstill.

use crate::num::{Law, mul_low, product, round_product, saturating_i16};
use crate::units::{CountsPerSec, Torque};

/// Damping that a law needs at least before the EMF may be compensated in full, over the EMF: what was learned may be 46 % too high, and a
/// motor's own 30 % lower than its property says. 0.75 of 0.97 torque units per count/s.
const MIN_DAMPING: Law = Law::lit("0.773621");

/// Share of the EMF that is compensated at T = 0, 66 % in 2^-16: every motor has 70 %, and the velocity may be read 5 % too high.
const SURE_EMF: i32 = 43_254;

/// Damping to add to a law that damps by `damping` torque units per count/s to reach `MIN_DAMPING` of the EMF `emf` in the same unit; 0 if
/// it damps enough.
#[must_use]
pub fn missing(damping: Law, emf: Law) -> Law {
    product(MIN_DAMPING, emf).saturating_sub(damping).max(Law::ZERO)
}

/// A law's torque with the missing damping added, before every limit, so that plugging at speed stays inside the torque limit.
#[must_use]
#[inline]
pub fn damped(torque: Torque, velocity: CountsPerSec, missing: Law) -> Torque {
    Torque(saturating_i16(i32::from(torque.0) - round_product(missing, velocity.0)))
}

/// The motor's EMF at a velocity, in torque units: torque + EMF is the voltage across the driven phases, and
/// voltage − EMF the torque that it gives. `per_speed` is K in torque units per count/s.
#[must_use]
#[inline]
pub fn emf(per_speed: Law, velocity: CountsPerSec) -> i32 {
    round_product(per_speed, velocity.0)
}

/// The part of `emf` that mode 2 compensates for a torque: a motor whose EMF is 30 % below `nominal` must not accelerate at T = 0,
/// whatever has been learned. Beyond two thirds, which are sure, it compensates twice the torque while that accelerates the motor, or as much
/// as the torque while that brakes it (decision 0064).
#[must_use]
pub fn sure_emf(emf: i32, nominal: i32, torque: Torque) -> i32 {
    let torque = i32::from(torque.0);
    let sure = mul_low(nominal, SURE_EMF, 16);
    if emf >= 0 {
        emf.min(sure + if torque > 0 { 2 * torque } else { -torque })
    } else {
        emf.max(sure + if torque < 0 { 2 * torque } else { -torque })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const K: Law = Law::lit("0.9696");

    #[test]
    fn no_load_speed_is_full_voltage() {
        // 24 V / 22.72 mV = 1056 counts/s (decision 0003).
        assert_eq!(emf(K, CountsPerSec::from_int(1056)), 1024);
        assert_eq!(emf(K, CountsPerSec::from_int(-1056)), -1024);
    }

    /// EMF 30 % low, and the most that can be learned.
    #[test]
    fn zero_torque_never_accelerates_a_low_ke_motor() {
        for learned in ["0.5333", "0.9696", "1.4196"] {
            for speed in [-4080, -1500, -300, -20, -1, 1, 20, 300, 1500, 4080] {
                let velocity = CountsPerSec::from_int(speed);
                let used = emf(Law::from_str(learned).expect("a number"), velocity);
                let applied = sure_emf(used, emf(K, velocity), Torque::ZERO);
                let own = emf(Law::lit("0.6787"), velocity);
                assert!(
                    (applied - own) * i32::from(speed.signum()) <= 1,
                    "{applied} of {own} at {speed}, {learned}"
                );
            }
        }
    }

    #[test]
    fn braking_torque_never_accelerates_and_driving_torque_at_most_trebles() {
        for torque in [20, 100, 400_i16] {
            for speed in [-900, -150, 150, 900_i16] {
                let velocity = CountsPerSec::from_int(speed);
                let used = emf(Law::lit("1.4196"), velocity);
                let own = emf(Law::lit("0.6787"), velocity);
                let forward = i32::from(speed.signum());
                let of = |torque: i32| {
                    let torque = torque * forward;
                    (torque + sure_emf(used, emf(K, velocity), Torque(saturating_i16(torque))) - own)
                        * forward
                };
                assert!(of(-i32::from(torque)) <= 1, "{torque} at {speed}");
                assert!(of(torque.into()) <= 3 * i32::from(torque) + 1, "{torque} at {speed}");
            }
        }
    }

    #[test]
    fn nominal_motor_gets_its_torque_below_150_counts_per_second() {
        for torque in [25, 100, 750] {
            for speed in [-150, -20, 20, 150_i16] {
                let velocity = CountsPerSec::from_int(speed);
                let full = emf(K, velocity);
                let towards = Torque(torque * speed.signum());
                assert_eq!(sure_emf(full, full, towards), full, "{torque} at {speed}");
            }
        }
    }

    #[test]
    fn law_without_enough_damping_gets_what_it_lacks() {
        assert_eq!(missing(Law::ONE, K), Law::ZERO);
        let most = missing(Law::ZERO, K);
        assert!((most - Law::lit("0.75")).abs() < Law::lit("0.001"), "{most}");
        let velocity = CountsPerSec::from_int(100);
        assert_eq!(damped(Torque(10), velocity, most), Torque(-65));
        assert_eq!(damped(Torque(10), velocity, Law::ZERO), Torque(10));
    }
}
