//! The last word on torque and duty: every path to the bridge ends in [`Limits::bound`].
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

    /// The torque limit in force: the least of MT (or IHIT), temperature and current, and which of them it is.
    #[must_use]
    pub fn torque_limit(&self, mt: Torque, thermal: Torque) -> (Torque, Limit) {
        let mut least = (mt, Limit::Torque);
        if thermal < least.0 {
            least = (thermal, Limit::Thermal);
        }
        if self.current_cut < least.0 {
            least = (self.current_cut, Limit::Current);
        }
        least
    }

    /// The torques that can be had at a velocity and bus voltage: within ±`most`, less what the duty limit
    /// leaves. At speed the EMF takes from one side and gives to the other.
    #[must_use]
    pub fn range(most: Torque, velocity: CountsPerSec, bus: MilliVolts) -> (Torque, Torque) {
        let (volts, emf) = (most_volts(bus), emf(velocity));
        let high = volts.saturating_sub(emf).clamp_abs(most);
        let low = volts.saturating_neg().saturating_sub(emf).clamp_abs(most);
        (low, high)
    }

    /// Bounds a torque at a velocity and bus voltage, and turns it into a duty.
    #[must_use]
    pub fn bound(
        &self,
        wanted: Torque,
        (most, governing): (Torque, Limit),
        velocity: CountsPerSec,
        bus: MilliVolts,
    ) -> Bounded {
        let torque = wanted.clamp_abs(most);
        let mut limit = (torque != wanted || wanted.saturating_abs() >= most).then_some(governing);
        // The bus in torque units: 23.4375 mV each. A dead bus must not divide by zero.
        let bus_mv = i32::from(bus.0).max(1_000);
        let most_volts = most_volts(bus);
        let emf = emf(velocity);
        let wanted_volts = torque.saturating_add(emf);
        let volts = wanted_volts.clamp_abs(most_volts);
        if wanted_volts.saturating_abs() >= most_volts {
            limit = Some(Limit::Duty);
        }
        let torque = if volts == wanted_volts { torque } else { volts.saturating_sub(emf) };
        // volts ≤ 2703 (65.5 V) × 23.4375 mV × 32768 = 768,000 would pass 2^31: a quarter of it does not.
        // The quarter's rounding may not pass the bound either.
        let most_bits = MAX_DUTY * 32;
        let bits = i32::from(volts.0).saturating_mul(192_000) / (bus_mv / 4);
        let bits = i16::try_from(bits.clamp(-most_bits, most_bits)).unwrap_or(0);
        Bounded { duty: Duty::from_bits(bits), torque, limit }
    }
}

/// The largest voltage across the motor, in torque units: 24 V is 1024 of them.
fn most_volts(bus: MilliVolts) -> Torque {
    let units = i32::from(bus.0).saturating_mul(MAX_DUTY) / 24_000;
    Torque(i16::try_from(units).unwrap_or(i16::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::Law;
    use proptest::prelude::*;

    const BUS: MilliVolts = MilliVolts(24_000);
    const MOST: (Torque, Limit) = (Torque(990), Limit::Torque);

    fn bound(torque: i16, speed: i16, bus: MilliVolts) -> Bounded {
        Limits::default().bound(Torque(torque), MOST, CountsPerSec::from_int(speed), bus)
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
        let fast = CountsPerSec::from_int(700);
        assert_eq!(Limits::range(Torque(990), fast, BUS), (Torque(-990), Torque(311)));
        assert_eq!(Limits::range(Torque(750), CountsPerSec::ZERO, BUS), (Torque(-750), Torque(750)));
        // Faster than the bus can drive it: only braking is left.
        let (low, high) = Limits::range(Torque(750), CountsPerSec::from_int(1100), BUS);
        assert!(low == Torque(-750) && high < Torque::ZERO, "{low:?} {high:?}");
    }

    #[test]
    fn the_least_limit_governs() {
        let mut limits = Limits::default();
        assert_eq!(limits.torque_limit(Torque(750), Torque(990)), (Torque(750), Limit::Torque));
        assert_eq!(limits.torque_limit(Torque(750), Torque(300)), (Torque(300), Limit::Thermal));
        for _ in 0..30 {
            // Half duty: the bus carries half of a phase current of 13 A.
            limits.watch_current(MilliAmps(6_500), Duty::from_bits(1 << 14));
        }
        assert!(!limits.short());
        let (least, governing) = limits.torque_limit(Torque(750), Torque(990));
        assert!(least < Torque(300) && governing == Limit::Current, "{least:?} by {governing:?}");
        for _ in 0..100 {
            limits.watch_current(MilliAmps(1_000), Duty::from_bits(1 << 14));
        }
        assert_eq!(limits.torque_limit(Torque(750), Torque(990)).1, Limit::Torque);
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
            let most = (Torque(most), Limit::Torque);
            let bounded = Limits::default().bound(Torque(torque), most, velocity, MilliVolts(bus));
            let duty = i32::from(bounded.duty.0.to_bits());
            prop_assert!(duty.abs() <= (1 << 15) * MAX_DUTY / 1024, "{}", duty);
            prop_assert!(bounded.limit == Some(Limit::Duty) || bounded.torque.saturating_abs() <= most.0);
        }
    }
}
