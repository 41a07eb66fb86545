//! The last word on torque and duty: every path to the bridge ends in [`Envelope::bound`].
//!
//! Torque is bounded by MT (IHIT while homing), by temperature and by the phase current; then it becomes a
//! voltage, and the voltage a duty bounded by what the bootstrap drivers can do.

use crate::guard::fault::Limit;
use crate::motion::torque::emf;
use crate::units::{CountsPerSec, Duty, MilliAmps, MilliVolts, Torque};

/// The largest voltage across the motor in 1/1024 of the bus: 990/1024 = 96.7 %. The high-side drivers charge
/// their bootstrap capacitors in the rest, and MT's maximum of 990 is this duty at 24 V; at 20 V it gives 825.
const MAX_DUTY: i32 = 990;

/// Phase current above which torque is cut back, mA: 10 % over the motor's 9.98 A at peak torque.
const PEAK_MA: i32 = 11_000;

/// Phase current that only a short or a wrong motor draws, mA: 24 V across 2.405 Ω − 30 % is 14.3 A.
const SHORT_MA: i32 = 15_000;

/// Consecutive ticks above `SHORT_MA` that are a fault; the comparator on the bridge acts within microseconds.
const SHORT_MS: u8 = 5;

/// How fast the current limit comes back, torque units a ms: full torque within 100 ms.
const RECOVERY: i16 = 10;

/// No cut: above any torque limit.
const NO_CUT: i16 = 1024;

/// What the limits made of a wanted torque.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounded {
    /// For the bridge.
    pub duty: Duty,
    /// The torque that this duty gives, after every clamp: what T reads.
    pub torque: Torque,
    /// The limit that acted last, if any.
    pub limit: Option<Limit>,
}

impl Bounded {
    /// Nothing driven.
    pub const OFF: Self = Self { duty: Duty::ZERO, torque: Torque::ZERO, limit: None };
}

/// The state of the current limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    current_cut: Torque,
    short_ms: u8,
}

impl Default for Limits {
    fn default() -> Self {
        Self { current_cut: Torque(NO_CUT), short_ms: 0 }
    }
}

impl Limits {
    /// Looks at the bus current that flowed at the duty applied since the last tick. A six-step bridge draws
    /// duty × phase current, so the guard divides; below 1/16 duty the quotient is noise and is left alone.
    pub fn watch_current(&mut self, bus: MilliAmps, applied: Duty) {
        let duty = i32::from(applied.0.to_bits()).abs();
        let phase = if duty >= 1 << 11 { i32::from(bus.0).abs().saturating_mul(1 << 15) / duty } else { 0 };
        if phase > PEAK_MA {
            // 1 A over the peak is about 100 torque units; a quarter of it a tick settles in a few ticks.
            let cut = i16::try_from(phase.saturating_sub(PEAK_MA) / 40).unwrap_or(NO_CUT);
            self.current_cut = Torque(self.current_cut.0.saturating_sub(cut).max(0));
        } else {
            self.current_cut = Torque(self.current_cut.0.saturating_add(RECOVERY).min(NO_CUT));
        }
        self.short_ms = if phase > SHORT_MA { self.short_ms.saturating_add(1) } else { 0 };
    }

    /// Whether the phase current has been that of a short for several ticks: a fault.
    #[must_use]
    pub const fn short(&self) -> bool {
        self.short_ms >= SHORT_MS
    }

    /// What bounds this tick: the least of MT (or IHIT), temperature and current, and what the bus leaves at this
    /// velocity.
    #[must_use]
    pub fn envelope(&self, mt: Torque, thermal: Torque, velocity: CountsPerSec, bus: MilliVolts) -> Envelope {
        let mut most = (mt, Limit::Torque);
        if thermal < most.0 {
            most = (thermal, Limit::Thermal);
        }
        if self.current_cut < most.0 {
            most = (self.current_cut, Limit::Current);
        }
        let (most, governing) = most;
        let volts = i32::from(bus.0).saturating_mul(MAX_DUTY) / 24_000;
        let volts = Torque(i16::try_from(volts).unwrap_or(i16::MAX));
        let emf = emf(velocity);
        let high = volts.saturating_sub(emf).clamp_abs(most);
        let low = volts.saturating_neg().saturating_sub(emf).clamp_abs(most);
        Envelope { most, governing, low, high, volts, emf, bus }
    }
}

/// The bounds of one tick, in torque units (a voltage of 24 V is 1024).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Envelope {
    /// The torque limit in force.
    most: Torque,
    /// Which limit that is.
    governing: Limit,
    /// The torques that can be had: within ±`most`, less what the duty limit leaves. At speed the EMF takes from
    /// one side and gives to the other.
    low: Torque,
    high: Torque,
    /// The largest voltage across the motor.
    volts: Torque,
    emf: Torque,
    bus: MilliVolts,
}

impl Envelope {
    /// The torque limit in force, either way.
    #[must_use]
    pub const fn most(&self) -> Torque {
        self.most
    }

    /// The torques that can be had, lowest and highest.
    #[must_use]
    pub const fn range(&self) -> (Torque, Torque) {
        (self.low, self.high)
    }

    /// Bounds a torque and turns it into a duty.
    #[must_use]
    pub fn bound(&self, wanted: Torque) -> Bounded {
        let mut torque = wanted.max(self.low).min(self.high);
        let by_torque = torque.saturating_abs() == self.most;
        let mut limit = (wanted >= self.high || wanted <= self.low).then_some(if by_torque {
            self.governing
        } else {
            Limit::Duty
        });
        let mut volts = torque.saturating_add(self.emf);
        if volts.saturating_abs() > self.volts {
            // Turned faster than the bus could turn it: even braking at the torque limit asks for too much.
            volts = volts.clamp_abs(self.volts);
            torque = volts.saturating_sub(self.emf);
            limit = Some(Limit::Duty);
        }
        // 23.4375 mV a unit, and volts ≤ 2703 (65.5 V) × 23.4375 × 32768 would pass 2^31: a quarter of it does
        // not. The quarter's rounding may not pass the bound, and a dead bus must not divide by zero.
        let bus_mv = i32::from(self.bus.0).max(1_000);
        let most_bits = MAX_DUTY * 32;
        let bits = i32::from(volts.0).saturating_mul(192_000) / (bus_mv / 4);
        let bits = i16::try_from(bits.clamp(-most_bits, most_bits)).unwrap_or(0);
        Bounded { duty: Duty::from_bits(bits), torque, limit }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::Law;
    use proptest::prelude::*;

    const BUS: MilliVolts = MilliVolts(24_000);
    const FULL: Torque = Torque(990);

    fn envelope(mt: i16, speed: i16, bus: MilliVolts) -> Envelope {
        Limits::default().envelope(Torque(mt), FULL, CountsPerSec::from_int(speed), bus)
    }

    fn bound(torque: i16, speed: i16, bus: MilliVolts) -> Bounded {
        envelope(990, speed, bus).bound(Torque(torque))
    }

    #[test]
    fn torque_at_standstill_is_duty() {
        assert_eq!(
            bound(512, 0, BUS),
            Bounded { duty: Duty::from_bits(1 << 14), torque: Torque(512), limit: None }
        );
        assert_eq!(bound(-512, 0, BUS).duty, Duty::from_bits(-(1 << 14)));
    }

    #[test]
    fn a_low_bus_gives_less_and_says_so() {
        // DESIGN 4.1: at 20 V no more than 825 can be had.
        let bounded = bound(990, 0, MilliVolts(20_000));
        assert_eq!((bounded.torque, bounded.limit), (Torque(825), Some(Limit::Duty)));
    }

    #[test]
    fn at_speed_the_emf_takes_its_share() {
        let bounded = bound(990, 700, BUS);
        // 990 − 0.9696 × 700 = 311.
        assert_eq!((bounded.torque, bounded.limit), (Torque(311), Some(Limit::Duty)));
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
        assert_eq!((bounded.duty, bounded.limit), (Duty::from_bits(31_680), Some(Limit::Duty)));
        assert_eq!(bounded.torque, Torque(990 - 2424));
    }

    #[test]
    fn the_least_limit_governs() {
        let mut limits = Limits::default();
        let governing = |limits: &Limits, thermal: i16| {
            let envelope = limits.envelope(Torque(750), Torque(thermal), CountsPerSec::ZERO, BUS);
            (envelope.most(), envelope.bound(Torque(900)).limit)
        };
        assert_eq!(governing(&limits, 990), (Torque(750), Some(Limit::Torque)));
        assert_eq!(governing(&limits, 300), (Torque(300), Some(Limit::Thermal)));
        for _ in 0..30 {
            // Half duty: the bus carries half of a phase current of 13 A.
            limits.watch_current(MilliAmps(6_500), Duty::from_bits(1 << 14));
        }
        assert!(!limits.short());
        let (least, by) = governing(&limits, 990);
        assert!(least < Torque(300) && by == Some(Limit::Current), "{least:?} by {by:?}");
        for _ in 0..100 {
            limits.watch_current(MilliAmps(1_000), Duty::from_bits(1 << 14));
        }
        assert_eq!(governing(&limits, 990).1, Some(Limit::Torque));
    }

    #[test]
    fn a_short_is_a_fault_after_five_ticks() {
        let mut limits = Limits::default();
        for tick in 1..=5 {
            limits.watch_current(MilliAmps(8_000), Duty::from_bits(1 << 14));
            assert_eq!(limits.short(), tick >= 5);
        }
    }

    proptest! {
        #[test]
        fn whatever_is_wanted_the_duty_is_bounded(
            torque: i16, most in 0i16..=990, velocity: i32, bus: u16,
        ) {
            let velocity = CountsPerSec(Law::from_bits(velocity));
            let most = Torque(most);
            let bounded = Limits::default().envelope(most, FULL, velocity, MilliVolts(bus)).bound(Torque(torque));
            let duty = i32::from(bounded.duty.0.to_bits());
            prop_assert!(duty.abs() <= (1 << 15) * MAX_DUTY / 1024, "{}", duty);
            prop_assert!(bounded.limit == Some(Limit::Duty) || bounded.torque.saturating_abs() <= most);
        }
    }
}
