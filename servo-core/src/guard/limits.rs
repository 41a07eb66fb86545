//! The last word on torque and duty: every path to the bridge ends in [`TorqueEnvelope::bound`].
//!
//! Torque is bounded by MT (IHIT while homing), by temperature and by the phase current; then it becomes a
//! voltage, and the voltage a duty bounded by what the bootstrap drivers can do.

use crate::guard::fault::LimitCause;
use crate::motion::torque::emf;
use crate::num::{mul_low_unsigned, saturating_i16, share_q32};
use crate::units::{CountsPerSec, Duty, MilliAmps, MilliVolts, Torque};

/// The largest voltage across the motor in 1/1024 of the bus: 990/1024 = 96.7 %. The high-side drivers charge
/// their bootstrap capacitors in the rest, and MT's maximum of 990 is this duty at 24 V; at 20 V it gives 825.
const MAX_DUTY: u32 = 990;

/// Phase current above which torque is cut back, mA: 10 % over the motor's 9.98 A at peak torque.
const PEAK_MA: i32 = 11_000;

/// Phase current that only a short or a wrong motor draws, mA: 24 V across 2.405 Ω − 30 % is 14.3 A.
const SHORT_MA: i32 = 15_000;

/// The least duty at which the current is looked at, in 1/32768.
const LEAST_DUTY: i32 = 1 << 11;

/// Bus current that is the peak's at no duty from `LEAST_DUTY` on, mA: the peak's at that is 687.
const LITTLE_MA: i32 = 640;
const _: () = assert!(LITTLE_MA << 15 <= LEAST_DUTY * PEAK_MA);

/// Consecutive ticks above `SHORT_MA` that are a fault; the comparator on the bridge acts within microseconds.
const SHORT_MS: u8 = 5;

/// How fast the current limit comes back, torque units a ms: full torque within 100 ms.
const RECOVERY: i16 = 10;

/// No cut: above any torque limit.
const NO_CUT: i16 = 1024;

/// What the limits made of a wanted torque.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AppliedTorque {
    /// For the bridge.
    pub duty: Duty,
    /// The torque that this duty gives, after every clamp: what T reads.
    pub torque: Torque,
    /// The limit that acted last, if any.
    pub limit: Option<LimitCause>,
}

impl AppliedTorque {
    /// Nothing driven.
    pub const OFF: Self = Self { duty: Duty::ZERO, torque: Torque::ZERO, limit: None };
}

/// The state of the current limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TorqueLimiter {
    /// What the current leaves of `NO_CUT`, 0..=1024.
    left: i16,
    /// Ticks in a row with the current of a short; then `left` is less than `NO_CUT`.
    short_ms: u8,
}

impl Default for TorqueLimiter {
    fn default() -> Self {
        Self { left: NO_CUT, short_ms: 0 }
    }
}

impl TorqueLimiter {
    /// Looks at the bus current that flowed at the duty applied since the last tick. A six-step bridge draws
    /// duty × phase current, so the guard divides where it is over the peak; below 1/16 duty the quotient is noise and
    /// is left alone.
    ///
    /// Returns whether the phase current has been that of a short for several ticks: a fault.
    #[inline]
    pub fn watch_current(&mut self, bus: MilliAmps, applied: Duty) -> bool {
        // So little is below the peak at any duty that is looked at; as a rule there is no more to ask.
        if (-LITTLE_MA..=LITTLE_MA).contains(&i32::from(bus.0)) {
            return self.recover();
        }
        let duty = i32::from(applied.0.to_bits()).abs();
        // ≤ 2^30, and the peak times the duty ≤ 11,000 × 2^15 < 2^29.
        let current = i32::from(bus.0).abs() << 15;
        if duty >= LEAST_DUTY && current > duty * PEAK_MA {
            return self.cut_back(current / duty);
        }
        self.recover()
    }

    #[inline]
    fn recover(&mut self) -> bool {
        if self.left != NO_CUT {
            self.left = self.left.saturating_add(RECOVERY).min(NO_CUT);
            self.short_ms = 0;
        }
        false
    }

    #[inline(never)]
    fn cut_back(&mut self, phase: i32) -> bool {
        // 1 A over the peak is about 100 torque units; a quarter of it a tick settles in a few ticks.
        let cut = i16::try_from(phase.saturating_sub(PEAK_MA) / 40).unwrap_or(NO_CUT);
        self.left = self.left.saturating_sub(cut).max(0);
        self.short_ms = if phase > SHORT_MA { self.short_ms.saturating_add(1) } else { 0 };
        self.short_ms >= SHORT_MS
    }

    /// What bounds this tick: the least of MT (or IHIT), temperature and current, and what the bus leaves at this
    /// velocity.
    #[must_use]
    #[inline]
    pub fn envelope(
        &self,
        mt: Torque,
        thermal: Torque,
        velocity: CountsPerSec,
        bus: MilliVolts,
    ) -> TorqueEnvelope {
        let Torque(most) = mt.min(thermal).min(Torque(self.left));
        let most = i32::from(most);
        // 0..=2703 and ±31,772: nothing below comes near 2^31.
        let volts = volts(bus);
        let emf = emf(velocity);
        let within = |torque: i32| torque.max(-most).min(most);
        let high = within(volts - emf);
        let low = within(-volts - emf);
        TorqueEnvelope { most, mt, thermal, low, high, volts, emf, bus }
    }
}

/// The largest voltage across the motor that a bus has, in torque units: `bus` · `MAX_DUTY` / 24,000, rounded down. A product
/// whose upper word is the result: 800ths are all that there is between whole numbers, and its error is less than 1/65536.
fn volts(bus: MilliVolts) -> i32 {
    const SHARE: u32 = share_q32(MAX_DUTY, 24_000);
    mul_low_unsigned(bus.0.into(), SHARE, 32).cast_signed()
}

/// The bounds of one tick, in torque units (a voltage of 24 V is 1024).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TorqueEnvelope {
    /// The torque limit in force.
    most: i32,
    /// Two of the three it is the least of; the third is the current's.
    mt: Torque,
    thermal: Torque,
    /// The torques that can be had: within ±`most`, less what the duty limit leaves. At speed the EMF takes from
    /// one side and gives to the other.
    low: i32,
    high: i32,
    /// The largest voltage across the motor.
    volts: i32,
    emf: i32,
    bus: MilliVolts,
}

impl TorqueEnvelope {
    /// The torque limit in force, either way.
    #[must_use]
    pub const fn most(&self) -> Torque {
        Torque(saturating_i16(self.most))
    }

    /// The torques that can be had, lowest and highest.
    #[must_use]
    pub const fn range(&self) -> (Torque, Torque) {
        (Torque(saturating_i16(self.low)), Torque(saturating_i16(self.high)))
    }

    /// Which limit is in force: of equal ones the first in this order.
    fn governing(&self) -> LimitCause {
        if self.most == i32::from(self.mt.0) {
            LimitCause::Torque
        } else if self.most == i32::from(self.thermal.0) {
            LimitCause::Thermal
        } else {
            LimitCause::Current
        }
    }

    /// Bounds a torque and turns it into a duty.
    #[must_use]
    #[inline]
    pub fn bound(&self, wanted: Torque) -> AppliedTorque {
        let mut torque = i32::from(wanted.0);
        let mut limit = None;
        // Between them the voltage is in its bound as well: there is nothing between them where `most` is not the
        // outer bound of both.
        if torque >= self.high || torque <= self.low {
            torque = torque.max(self.low).min(self.high);
            limit = Some(if torque.abs() == self.most { self.governing() } else { LimitCause::Duty });
            let volts = torque + self.emf;
            if volts.abs() > self.volts {
                // Turned faster than the bus could turn it: even braking at the torque limit asks for too much.
                torque = volts.max(-self.volts).min(self.volts) - self.emf;
                limit = Some(LimitCause::Duty);
            }
        }
        // 23.4375 mV a unit, and volts ≤ 2703 (65.5 V) × 23.4375 × 32768 would pass 2^31: a quarter of it does
        // not. The quarter is rounded up so that the duty does not pass its bound; a dead bus must not divide by zero.
        let volts = torque + self.emf;
        let quarter = (i32::from(self.bus.0).max(1_000) + 3) / 4;
        let bits = volts * 192_000 / quarter;
        let (duty, torque) = (Duty::from_bits(saturating_i16(bits)), Torque(saturating_i16(torque)));
        AppliedTorque { duty, torque, limit }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::Law;
    use proptest::prelude::*;

    const BUS: MilliVolts = MilliVolts(24_000);
    const FULL: Torque = Torque(990);

    fn envelope(mt: i16, speed: i16, bus: MilliVolts) -> TorqueEnvelope {
        TorqueLimiter::default().envelope(Torque(mt), FULL, CountsPerSec::from_int(speed), bus)
    }

    fn bound(torque: i16, speed: i16, bus: MilliVolts) -> AppliedTorque {
        envelope(990, speed, bus).bound(Torque(torque))
    }

    #[test]
    fn torque_at_standstill_is_duty() {
        assert_eq!(
            bound(512, 0, BUS),
            AppliedTorque { duty: Duty::from_bits(1 << 14), torque: Torque(512), limit: None }
        );
        assert_eq!(bound(-512, 0, BUS).duty, Duty::from_bits(-(1 << 14)));
    }

    #[test]
    fn a_low_bus_gives_less_and_says_so() {
        // DESIGN 4.1: at 20 V no more than 825 can be had.
        let bounded = bound(990, 0, MilliVolts(20_000));
        assert_eq!((bounded.torque, bounded.limit), (Torque(825), Some(LimitCause::Duty)));
    }

    #[test]
    fn at_speed_the_emf_takes_its_share() {
        let bounded = bound(990, 700, BUS);
        // 990 − 0.9696 × 700 = 311.
        assert_eq!((bounded.torque, bounded.limit), (Torque(311), Some(LimitCause::Duty)));
    }

    #[test]
    fn what_can_be_had_at_speed_is_not_the_same_both_ways() {
        assert_eq!(envelope(990, 700, BUS).range(), (Torque(-990), Torque(311)));
        assert_eq!(envelope(750, 0, BUS).range(), (Torque(-750), Torque(750)));
        // Faster than the bus can drive it: only braking is left.
        let (low, high) = envelope(750, 1100, BUS).range();
        assert!(low == Torque(-750) && high < Torque::ZERO, "{low:?} {high:?}");
        // So fast that the duty bound brakes harder than MT; it is said.
        let bounded = bound(0, 2500, BUS);
        assert_eq!((bounded.duty, bounded.limit), (Duty::from_bits(31_680), Some(LimitCause::Duty)));
        assert_eq!(bounded.torque, Torque(990 - 2424));
    }

    #[test]
    fn the_least_limit_governs() {
        let mut limits = TorqueLimiter::default();
        let governing = |limits: &TorqueLimiter, thermal: i16| {
            let envelope = limits.envelope(Torque(750), Torque(thermal), CountsPerSec::ZERO, BUS);
            (envelope.most(), envelope.bound(Torque(900)).limit)
        };
        assert_eq!(governing(&limits, 990), (Torque(750), Some(LimitCause::Torque)));
        assert_eq!(governing(&limits, 300), (Torque(300), Some(LimitCause::Thermal)));
        for _ in 0..30 {
            // Half duty: the bus carries half of a phase current of 13 A.
            assert!(!limits.watch_current(MilliAmps(6_500), Duty::from_bits(1 << 14)));
        }
        let (least, by) = governing(&limits, 990);
        assert!(least < Torque(300) && by == Some(LimitCause::Current), "{least:?} by {by:?}");
        for _ in 0..100 {
            assert!(!limits.watch_current(MilliAmps(1_000), Duty::from_bits(1 << 14)));
        }
        assert_eq!(governing(&limits, 990).1, Some(LimitCause::Torque));
    }

    #[test]
    fn a_short_is_a_fault_after_five_ticks() {
        let mut limits = TorqueLimiter::default();
        for tick in 1..=5 {
            assert_eq!(limits.watch_current(MilliAmps(8_000), Duty::from_bits(1 << 14)), tick >= 5);
        }
    }

    #[test]
    fn the_current_of_a_short_is_counted_in_a_row_alone() {
        let mut limits = TorqueLimiter::default();
        for between in [MilliAmps(0), MilliAmps(1_000)] {
            for _ in 0..4 {
                assert!(!limits.watch_current(MilliAmps(8_000), Duty::from_bits(1 << 14)));
            }
            assert!(!limits.watch_current(between, Duty::from_bits(1 << 14)));
        }
    }

    #[test]
    fn every_bus_has_its_share_of_voltage() {
        for bus in 0..=u16::MAX {
            assert_eq!(volts(MilliVolts(bus)).unsigned_abs(), u32::from(bus) * MAX_DUTY / 24_000, "{bus}");
        }
    }

    proptest! {
        #[test]
        fn whatever_is_wanted_the_duty_is_bounded(
            torque: i16, most in 0i16..=990, velocity: i32, bus: u16,
        ) {
            let velocity = CountsPerSec(Law::from_bits(velocity));
            let most = Torque(most);
            let bounded = TorqueLimiter::default().envelope(most, FULL, velocity, MilliVolts(bus)).bound(Torque(torque));
            let duty = i32::from(bounded.duty.0.to_bits());
            prop_assert!(duty.unsigned_abs() <= (1 << 15) * MAX_DUTY / 1024, "{}", duty);
            // Nothing has wrapped: the duty is the voltage over the bus, and 250 mV of bus in the rounding of a quarter.
            let volts = i64::from(bounded.torque.0) + i64::from(emf(velocity));
            let exact = volts * 24 * 32_000 / i64::from(bus.max(1_000));
            prop_assert!((i64::from(duty) - exact).abs() <= 1 + exact.abs() / 250, "{} {}", duty, exact);
            prop_assert!(bounded.limit == Some(LimitCause::Duty) || bounded.torque.saturating_abs() <= most);
        }
    }
}
