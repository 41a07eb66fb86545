//! Torque and duty limits. Every path to the bridge ends in [`TorqueEnvelope::bound`].
//!
//! Torque is limited by MT (IHIT while HI seeks the stop), by temperature, by phase current and by what the supply can take.
//! It then becomes a voltage, and the voltage a duty that the bootstrap drivers can deliver (decision 0005).

use crate::guard::fault::LimitCause;
use crate::guard::supply::{Bus, Supply};
use crate::motor::{BoardFigures, Motor};
use crate::num::{Law, half_up, mul_low, mul_low_unsigned, saturating_i16};
use crate::units::{Duty, MilliAmps, MilliVolts, Torque};
use core::num::NonZeroU32;

/// Largest voltage across the motor in 1/1024 of the bus: 990/1024 = 96.7 %. The high-side drivers recharge their bootstrap
/// capacitors in the rest. At 24 V this is also MT's maximum; at 20 V it gives T = 825.
const MAX_DUTY: u32 = 990;

/// Least duty at which the current is judged, in 1/32768.
const LEAST_DUTY: i32 = 1 << 11;

/// Consecutive ticks above [`Scale::short_ma`] that are a fault. The comparator on the bridge acts within microseconds.
const SHORT_MS: u8 = 5;

/// Recovery of the current limit, torque units a ms: full torque within 100 ms.
const RECOVERY: i16 = 10;

/// No current limit: above every torque limit.
const NO_CUT: i16 = 1024;

/// Currents, voltages and powers in torque units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scale {
    /// Voltage of 1024 units over 128, mV.
    eighths_mv: i32,
    /// `MAX_DUTY` over the voltage of 1024 units in mV, 2^-32.
    share: u32,
    /// Supply current below that of the peak at every duty from `LEAST_DUTY` on, mA.
    little_ma: i32,
    /// Phase current above which torque is cut back, mA: 10 % over the peak.
    peak_ma: i32,
    /// Phase current that only a short circuit or another motor draws, mA: half more than the peak; 24 V across 2.405 Ω − 30 % is 14.3 A.
    short_ma: i32,
    /// Current that is four torque units, mA.
    four_units_ma: NonZeroU32,
    /// mA·mV/256 in the square of torque units, less an eighth, 2^-16; 1 for the hand's motor of 239.5 W.
    power: i32,
    /// Power that is noise: two thirds of a step of the converter, 9.8 mA, at 24 V.
    noise: i32,
    /// Least voltage against a torque at which the current is judged: noise makes a current of 22 units there, 2 % of the peak.
    least_braking: i32,
    /// Largest EMF that can be missing: the supply's voltage, because no other adds to a torque.
    most_emf: i32,
    /// Largest torque of a motor that is shorted to brake, because its bus takes no more: what the bridge switches.
    shorted: i32,
    /// Ripple of the current over |U|·(1 − |duty|), 2^-10: see [`Scale::dead_time`].
    ripple: i32,
    /// Duty that dead time takes of the supply, 1/32768, and that of a quarter of a millivolt that two diodes take.
    dead: i32,
    diodes: i32,
    bus: Bus,
}

impl Scale {
    /// Of a motor that fits the board.
    #[must_use]
    pub fn new(motor: &Motor, board: &BoardFigures) -> Self {
        let full = motor.full_mv();
        let peak = u32::from(motor.mpk);
        let lag = u32::from(motor.mte.max(1));
        let signed = |n: u64, d: u64| half_up(n, d).cast_signed();
        // 24 V · 9980 mA of the hand's motor.
        let power = signed(239_520_000 << 16, u64::from(full) * u64::from(peak));
        let of_noise = |hands: i32| mul_low(hands, power, 16);
        let peak_ma = (peak + peak / 10).cast_signed();
        Self {
            eighths_mv: (full * 8).cast_signed(),
            // Rounded up, so that an exact product is not rounded down.
            share: half_up(u64::from(MAX_DUTY) << 32, full.into()) + 1,
            // Of 1/16 less 6 %.
            little_ma: peak_ma / 17,
            peak_ma,
            short_ma: (peak + peak / 2).cast_signed(),
            four_units_ma: NonZeroU32::new(peak / 256).unwrap_or(NonZeroU32::MIN),
            power,
            noise: of_noise(620),
            least_braking: of_noise(32),
            most_emf: signed(u64::from(motor.mvn) * 100 * 1024, full.into()),
            shorted: signed(u64::from(board.shorted_ma) * 1024, peak.into()),
            // Half a period over τₑ.
            // To the nearest.
            ripple: ((board.half_period + lag / 2) / lag).min(1024).cast_signed(),
            dead: board.dead,
            diodes: board.diodes,
            bus: Bus::new(motor),
        }
    }

    /// The supply that the board is on.
    #[must_use]
    pub const fn bus(&self) -> &Bus {
        &self.bus
    }

    /// Largest voltage across the motor: `bus` · `MAX_DUTY` over the voltage of 1024 units, rounded down. The product's error is below 1/65536.
    fn volts(&self, bus: MilliVolts) -> i32 {
        mul_low_unsigned(bus.0.into(), self.share, 32).cast_signed()
    }
}

/// A commanded torque after the limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AppliedTorque {
    /// Duty for the bridge.
    pub duty: Duty,
    /// Voltage across the driven phases, torque units.
    pub volts: i32,
    /// Torque that this duty gives.
    pub torque: Torque,
    /// The limit that reduced it, if any.
    pub limit: Option<LimitCause>,
}

impl AppliedTorque {
    /// Bridge off.
    pub const OFF: Self = Self { duty: Duty::ZERO, volts: 0, torque: Torque::ZERO, limit: None };
}

/// What the last tick has applied, and what it has shown.
#[derive(Clone, Copy, Debug)]
pub struct LastTick<'a> {
    /// Supply current, mean of the tick.
    pub current: MilliAmps,
    /// What was applied.
    pub applied: &'a AppliedTorque,
    /// Whether the hall count has changed.
    pub counted: bool,
}

impl LastTick<'_> {
    /// Bridge off, at rest.
    pub const OFF: Self = Self { current: MilliAmps(0), applied: &AppliedTorque::OFF, counted: false };
}

/// The state of the limits of current and supply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TorqueLimiter {
    /// Torque that the phase current allows, 0..=`NO_CUT`.
    left: i16,
    /// Consecutive ticks with the current of a short circuit; `left` is then below `NO_CUT`.
    short_ms: u8,
    /// EMF that the supply current has shown not to be there, torque units; below 0 that of a rotor that is braked.
    missing_emf: i32,
    supply: Supply,
}

impl Default for TorqueLimiter {
    fn default() -> Self {
        Self { left: NO_CUT, short_ms: 0, missing_emf: 0, supply: Supply::default() }
    }
}

impl TorqueLimiter {
    /// One tick in idle, which shows the supply without this motor.
    pub fn idle(&mut self, scale: &Scale, bus: MilliVolts) {
        self.supply.learn(&scale.bus, bus);
    }

    /// Checks the bus current at the duty applied since the last tick (duty × phase current); below 1/16 duty the quotient
    /// is noise. Returns whether the phase current has been that of a short circuit for several ticks: a fault.
    #[inline]
    pub fn watch_current(&mut self, scale: &Scale, bus: MilliAmps, applied: Duty) -> bool {
        if (-scale.little_ma..=scale.little_ma).contains(&i32::from(bus.0)) {
            return self.recover();
        }
        let duty = i32::from(applied.0.to_bits()).abs();
        // At most 2^30, and so is the peak times the duty.
        let current = i32::from(bus.0).abs() << 15;
        if duty >= LEAST_DUTY && current > duty * scale.peak_ma {
            return self.cut_back(scale, current / duty);
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
    fn cut_back(&mut self, scale: &Scale, phase: i32) -> bool {
        // Removing a quarter of the excess a tick settles in a few ticks.
        let excess = phase.saturating_sub(scale.peak_ma).max(0).unsigned_abs();
        let cut = i16::try_from(excess / scale.four_units_ma).unwrap_or(NO_CUT);
        self.left = self.left.saturating_sub(cut).max(0);
        self.short_ms = if phase > scale.short_ma { self.short_ms.saturating_add(1) } else { 0 };
        self.short_ms >= SHORT_MS
    }

    /// The torque limits of this tick, within what the bus voltage leaves of an EMF within ±2^15 torque units.
    #[must_use]
    #[inline]
    pub fn envelope(
        &mut self,
        scale: &Scale,
        (mt, thermal): (Torque, Torque),
        emf: i32,
        bus: MilliVolts,
        last: &LastTick,
    ) -> TorqueEnvelope {
        let current = Torque(self.left);
        let mut most = i32::from(mt.0).min(thermal.0.into()).min(self.left.into());
        let mut volts = scale.volts(bus);
        if let Some(folded) = self.supply.fold(&scale.bus, bus) {
            most = most.min(folded.0.into());
            // A rotor that hits a stop at speed is estimated to run on for some ms: its EMF would be compensated.
            volts = volts.min((i32::from(folded.0) * scale.most_emf) >> 10);
        }
        // U·I is power, and no dead time enters it: I is U·I over |U|, torque units. [`Scale::power`] is an eighth too low, so that a current may be
        // 9/8 of its limit.
        let power = mul_low((i32::from(last.current.0) * i32::from(bus.0)) >> 8, scale.power, 16);
        // A voltage against the torque brakes: it returns current, and draws none. An eighth is allowed: both numbers are small, so that their two
        // highest bits are equal.
        let braking_shift = (last.applied.volts ^ i32::from(last.applied.torque.0)).cast_unsigned() >> 30;
        let exceeds = power > last.applied.volts.abs() * (most >> braking_shift) + scale.noise;
        let emf = if exceeds || self.missing_emf != 0 {
            self.without_missing(scale, emf, power - scale.noise, most, last)
        } else {
            emf
        };
        let within = |torque: i32| torque.max(-most).min(most);
        let high = within(volts - emf);
        let low = within(-(volts + emf));
        TorqueEnvelope { most, mt, thermal, current, low, high, volts, emf, bus }
    }

    /// `emf` without what the supply current of the last tick has shown not to be there: more current than the torque limit's flows only where
    /// an EMF was compensated that the rotor does not have, of a speed or a Ke that is wrong. It stays missing until a count shows that the
    /// rotor turns. The same holds for a rotor that is braked and draws current: too high an EMF drives it on, against its torque.
    #[inline(never)]
    fn without_missing(&mut self, scale: &Scale, emf: i32, power: i32, most: i32, last: &LastTick) -> i32 {
        let LastTick { applied, counted, .. } = *last;
        let power = power + (power >> 3);
        let torque = i32::from(applied.torque.0);
        let (volts, adds) = (applied.volts.abs(), (emf ^ torque) >= 0);
        let brakes = volts >= scale.least_braking && (applied.volts ^ torque) < 0;
        let draws = brakes && (power > 0 || self.missing_emf < 0);
        let over = if draws {
            // The current that the torque lacks.
            torque.abs() + power / volts.max(1)
        } else if adds && volts > 0 {
            let over = power / volts - (most + (most >> 3));
            // The current has risen to two thirds in the mean of its first tick.
            if over > 0 { over + over / 2 } else { over }
        } else {
            // An EMF that opposes a greater torque is no addition to it.
            -most
        };
        if over > 0 || counted {
            let before = if draws { -self.missing_emf } else { self.missing_emf };
            let missing = (before.max(0) + over).max(0).min(scale.most_emf);
            self.missing_emf = if draws { -missing } else { missing };
        }
        let missing = if adds { self.missing_emf } else { -self.missing_emf };
        emf.signum() * (emf.abs() - missing.max(0)).max(0)
    }
}

/// [`MAX_DUTY`] in 1/32768.
const MOST_DUTY: i32 = 31_680;

impl Scale {
    /// The duty that the bridge's dead time takes, 1/32768, with the sign of the current: for 0.5 µs of each 50 µs the current flows
    /// through a diode of 0.8 V instead of a switch, in both legs. Where the ripple of the current passes zero it takes nothing; with the
    /// period t of the PWM and τₑ = L/R of the winding it is
    ///
    /// ```text
    /// i_ripple = |U|·(1 − |duty|)·t/2τₑ         0.075 of |U|, torque units, of the hand's motor
    /// ```
    ///
    /// `quarter` is a quarter of the bus voltage in mV.
    fn dead_time(&self, volts: i32, torque: i32, duty: i32, quarter: i32) -> i32 {
        // |volts| < 2^14 and |duty| < 2^15, so the product is below 2^29.
        if torque == 0 {
            return 0;
        }
        // A voltage has the sign of its duty: |U|·|duty| is U·duty.
        let ripple = ((volts.abs() << 15) - volts * duty) >> 15;
        let ripple = (ripple * self.ripple) >> 10;
        // From none to all within ±1.5 units, in 2^-8.
        let share = ((torque.abs() - ripple) * 83 + 128).clamp(0, 256);
        let whole = self.dead + self.diodes / quarter;
        let lost = (whole * share) >> 8;
        if torque < 0 { -lost } else { lost }
    }
}

/// Torque and voltage limits of one tick, in torque units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TorqueEnvelope {
    most: i32,
    /// Three of the four limits that `most` is the least of; the fourth is the supply's.
    mt: Torque,
    thermal: Torque,
    current: Torque,
    /// Range of torques within ±`most` that the duty limit allows. At speed the EMF narrows it on one side and widens it on
    /// the other.
    low: i32,
    high: i32,
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

    /// Lowest and highest torque available.
    #[must_use]
    pub const fn bounds(&self) -> (Law, Law) {
        // Within ±`most`.
        (Law::from_bits(self.low << 16), Law::from_bits(self.high << 16))
    }

    /// Torque that is left to drive a rotor whose EMF in its direction is `emf`; negative if the bus cannot drive it so fast.
    #[must_use]
    pub fn forward(&self, emf: i32) -> i32 {
        self.most.min(self.volts - emf)
    }

    /// [`Self::most`] as a number.
    #[must_use]
    pub const fn most_units(&self) -> i32 {
        self.most
    }

    /// Torque of a motor with its terminals shorted, as far as the bridge switches its current.
    #[must_use]
    pub fn short(&self, scale: &Scale) -> Torque {
        Torque(saturating_i16(self.switched(scale, -self.emf)))
    }

    /// A braking torque whose current the bridge switches, within the voltage of the bus.
    #[inline(never)]
    fn switched(&self, scale: &Scale, torque: i32) -> i32 {
        let torque = torque.max(-scale.shorted).min(scale.shorted);
        torque.max(-self.volts - self.emf).min(self.volts - self.emf)
    }

    /// Of equal limits the first in this order.
    fn governing(&self) -> LimitCause {
        if self.most == i32::from(self.mt.0) {
            LimitCause::Torque
        } else if self.most == i32::from(self.thermal.0) {
            LimitCause::Thermal
        } else if self.most == i32::from(self.current.0) {
            LimitCause::Current
        } else {
            LimitCause::Supply
        }
    }

    /// Limits a torque and converts it to a duty. `previous` is the torque of the last tick.
    #[must_use]
    #[inline]
    pub fn bound(&self, scale: &Scale, wanted: Torque, previous: Torque) -> AppliedTorque {
        let mut torque = i32::from(wanted.0);
        let mut limit = None;
        let is_free = torque < self.high
            && torque > self.low
            && (-scale.bus.free..=scale.bus.free).contains(&torque)
            && self.bus <= scale.bus.return_from;
        if !is_free {
            // A copy, so that the limits stay in registers otherwise.
            (torque, limit) = { *self }.limited(scale, torque, previous);
        }
        // A voltage of 64 V × 32768 would pass 2^31; a quarter of it does not. The quarter is rounded up so that the duty stays within its limit.
        let volts = torque + self.emf;
        let quarter = (i32::from(self.bus.0).max(1_000) + 3) / 4;
        let bits = volts * scale.eighths_mv / quarter;
        let bits = (bits + scale.dead_time(volts, torque, bits, quarter)).clamp(-MOST_DUTY, MOST_DUTY);
        let (duty, torque) = (Duty::from_bits(saturating_i16(bits)), Torque(saturating_i16(torque)));
        AppliedTorque { duty, volts, torque, limit }
    }

    /// The nearest torque within all limits, and what limits it.
    #[inline(never)]
    fn limited(self, scale: &Scale, mut torque: i32, previous: Torque) -> (i32, Option<LimitCause>) {
        let mut limit = None;
        let supply = &scale.bus;
        // Inside the range the voltage is within its limit too.
        if torque >= self.high || torque <= self.low {
            torque = torque.max(self.low).min(self.high);
            limit = Some(if torque.abs() == self.most { self.governing() } else { LimitCause::Duty });
            let volts = torque + self.emf;
            if volts.abs() > self.volts {
                // Faster than the bus could drive it: even braking at the torque limit needs too much voltage.
                torque = volts.max(-self.volts).min(self.volts) - self.emf;
                limit = Some(LimitCause::Duty);
            }
        }
        if !(-supply.free..=supply.free).contains(&torque) {
            (torque, limit) = self.risen(supply, torque, previous).unwrap_or((torque, limit));
        }
        if self.bus > supply.return_from {
            (torque, limit) = self.without_return(scale, torque).unwrap_or((torque, limit));
        }
        (torque, limit)
    }

    /// The torque and its limit if it would load the supply too suddenly.
    fn risen(&self, supply: &Bus, torque: i32, previous: Torque) -> Option<(i32, Option<LimitCause>)> {
        let risen = supply.risen(torque, previous.0.into());
        // Braking loads no supply, however hard; nor does the voltage that the EMF lacks.
        let sign = torque.signum();
        let loads = (torque + self.emf).signum() == sign;
        // Without voltage nothing is drawn: less torque would brake with more voltage than there may be.
        let risen = if (risen + self.emf).signum() == sign { risen } else { -self.emf };
        (loads && risen != torque).then_some((risen, Some(LimitCause::Supply)))
    }

    /// The torque and its limit if it would raise the bus voltage further: more braking, at a lower duty.
    fn without_return(&self, scale: &Scale, torque: i32) -> Option<(i32, Option<LimitCause>)> {
        let volts = torque + self.emf;
        let allowed = scale.bus.without_return(volts, torque, self.bus);
        (allowed != volts).then(|| (self.switched(scale, allowed - self.emf), Some(LimitCause::Duty)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::torque::emf as emf_at;
    use crate::units::CountsPerSec;
    use proptest::prelude::*;

    fn hand() -> Scale {
        Scale::new(&Motor::HAND, &BoardFigures::TATER)
    }

    const BUS: MilliVolts = MilliVolts(24_000);
    const FULL: Torque = Torque(990);

    const K: Law = Law::lit("0.9696");

    /// Dead time at 24 V: 1 % of the bus and 1.6 V of diodes, 0.01·(1 + 1.6/24)·32768, with each term rounded.
    const LOST: i16 = 328 + 21;

    fn emf(velocity: CountsPerSec) -> i32 {
        emf_at(K, velocity)
    }

    fn envelope(mt: i16, speed: i16, bus: MilliVolts) -> TorqueEnvelope {
        TorqueLimiter::default().envelope(
            &hand(),
            (Torque(mt), FULL),
            emf(CountsPerSec::from_int(speed)),
            bus,
            &LastTick::OFF,
        )
    }

    fn bound(torque: i16, speed: i16, bus: MilliVolts) -> AppliedTorque {
        envelope(990, speed, bus).bound(&hand(), Torque(torque), Torque(torque))
    }

    #[test]
    fn slow_rise_of_plugging_torque_keeps_the_duty_limit() {
        // The EMF is far beyond the bus; −990 needs −20 of its ±97, and −512 would need 458.
        let plugging =
            envelope(990, 1000, MilliVolts(2_374)).bound(&hand(), FULL.saturating_neg(), Torque::ZERO);
        // No voltage, and the dead time of a current that flows: 1 % of 2.374 V and of 1.6 V.
        assert_eq!((plugging.volts, plugging.duty), (0, Duty::from_bits(-(328 + 220))));
        assert_eq!(plugging.limit, Some(LimitCause::Supply));
    }

    #[test]
    fn torque_at_standstill_is_duty_and_dead_time() {
        assert_eq!(
            bound(512, 0, BUS),
            AppliedTorque {
                duty: Duty::from_bits((1 << 14) + LOST),
                volts: 512,
                torque: Torque(512),
                limit: None
            }
        );
        assert_eq!(bound(-512, 0, BUS).duty, Duty::from_bits(-(1 << 14) - LOST));
    }

    /// 400 units of EMF at duty 400/1024 have a ripple of 0.075·400·(1 − 0.39) = 18 units.
    #[test]
    fn dead_time_takes_nothing_where_the_ripple_of_the_current_passes_zero() {
        let envelope = TorqueLimiter::default().envelope(&hand(), (FULL, FULL), 400, BUS, &LastTick::OFF);
        let lost = |torque: i16| {
            let bounded = envelope.bound(&hand(), Torque(torque), Torque(torque));
            assert_eq!(bounded.volts, 400 + i32::from(torque));
            i32::from(bounded.duty.0.to_bits()) - bounded.volts * 32
        };
        for torque in [-14, -1, 0, 1, 14] {
            assert_eq!(lost(torque), 0, "{torque}");
        }
        for torque in [22, 100, -22, -100] {
            assert_eq!(lost(torque), i32::from(LOST * torque.signum()), "{torque}");
        }
        assert!((15..22).all(|torque| lost(torque) <= lost(torque + 1)), "gradually");
    }

    #[test]
    fn dead_time_at_no_torque_and_no_speed_takes_nothing() {
        assert_eq!(bound(0, 0, BUS).duty, Duty::ZERO);
    }

    #[test]
    fn dead_time_is_the_mirror_image_in_the_other_direction() {
        for torque in 0..=300 {
            for speed in [-300, -20, 0, 20, 300] {
                let (one, other) = (bound(torque, speed, BUS), bound(-torque, -speed, BUS));
                let sum = one.duty.0.to_bits() + other.duty.0.to_bits();
                // Shifts round down.
                assert!(sum.abs() <= 1, "{torque} at {speed}: {one:?} {other:?}");
            }
        }
    }

    #[test]
    fn dead_time_takes_no_duty_beyond_the_limit() {
        assert_eq!(bound(990, 0, BUS).duty, Duty::from_bits(31_680));
        assert_eq!(bound(-990, 0, BUS).duty, Duty::from_bits(-31_680));
    }

    #[test]
    fn low_bus_voltage_reduces_torque_and_reports_the_duty_limit() {
        // 990 · 20/24.
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
    fn torque_range_at_speed_is_asymmetric() {
        let range = |torque, emf| {
            let (low, high) = envelope(torque, emf, BUS).bounds();
            (low.to_num::<i32>(), high.to_num::<i32>())
        };
        assert_eq!(range(990, 700), (-990, 311));
        assert_eq!(range(750, 0), (-750, 750));
        // Faster than the bus can drive it: only braking is left.
        let (low, high) = range(750, 1100);
        assert!(low == -750 && high < 0, "{low} {high}");
        // So fast that the duty limit brakes harder than MT.
        let bounded = bound(0, 2500, BUS);
        assert_eq!((bounded.duty, bounded.limit), (Duty::from_bits(31_680 - LOST), Some(LimitCause::Duty)));
        assert_eq!(bounded.torque, Torque(990 - 2424));
    }

    #[test]
    fn least_limit_governs() {
        let mut limits = TorqueLimiter::default();
        let governing = |limits: &mut TorqueLimiter, thermal: i16| {
            let envelope = limits.envelope(&hand(), (Torque(750), Torque(thermal)), 0, BUS, &LastTick::OFF);
            (envelope.most(), envelope.bound(&hand(), Torque(900), Torque(900)).limit)
        };
        assert_eq!(governing(&mut limits, 990), (Torque(750), Some(LimitCause::Torque)));
        assert_eq!(governing(&mut limits, 300), (Torque(300), Some(LimitCause::Thermal)));
        for _ in 0..30 {
            // Half duty: the bus carries half of a phase current of 13 A.
            assert!(!limits.watch_current(&hand(), MilliAmps(6_500), Duty::from_bits(1 << 14)));
        }
        let (least, by) = governing(&mut limits, 990);
        assert!(least < Torque(300) && by == Some(LimitCause::Current), "{least:?} by {by:?}");
        for _ in 0..100 {
            assert!(!limits.watch_current(&hand(), MilliAmps(1_000), Duty::from_bits(1 << 14)));
        }
        assert_eq!(governing(&mut limits, 990).1, Some(LimitCause::Torque));
    }

    #[test]
    fn a_tick_above_the_peak_removes_a_quarter_of_the_excess() {
        let mut limits = TorqueLimiter::default();
        // Half duty, 6 A of bus: 12 A of phase, 1 A or 100 units of torque above the peak.
        assert!(!limits.watch_current(&hand(), MilliAmps(6_000), Duty::from_bits(1 << 14)));
        assert_eq!(limits.left, NO_CUT - 26);
    }

    /// However long: nor does what is below the peak raise the limit for later.
    #[test]
    fn current_below_the_peak_or_of_little_duty_cuts_nothing() {
        for (current, duty) in [(1_000, 1 << 14), (-1_000, 1 << 14), (1_000, (1 << 11) - 1)] {
            let mut limits = TorqueLimiter::default();
            for _ in 0..100 {
                assert!(!limits.watch_current(&hand(), MilliAmps(current), Duty::from_bits(duty)));
                assert_eq!(limits, TorqueLimiter::default(), "{current} mA at {duty}");
            }
        }
    }

    #[test]
    fn short_circuit_is_a_fault_after_five_ticks() {
        let mut limits = TorqueLimiter::default();
        for tick in 1..=5 {
            assert_eq!(limits.watch_current(&hand(), MilliAmps(8_000), Duty::from_bits(1 << 14)), tick >= 5);
        }
    }

    #[test]
    fn short_circuit_current_counts_only_in_consecutive_ticks() {
        let mut limits = TorqueLimiter::default();
        for between in [MilliAmps(0), MilliAmps(1_000)] {
            for _ in 0..4 {
                assert!(!limits.watch_current(&hand(), MilliAmps(8_000), Duty::from_bits(1 << 14)));
            }
            assert!(!limits.watch_current(&hand(), between, Duty::from_bits(1 << 14)));
        }
    }

    /// A rotor that is estimated to run at 700 counts/s stands: 679 units of EMF are compensated, and 779 flow where 100 are allowed. 24 V and
    /// a duty of 779/1024 of them draw 5.8 A.
    #[test]
    fn emf_that_the_supply_current_denies_is_taken_until_a_count() {
        let mut limits = TorqueLimiter::default();
        let most = Torque(100);
        for sign in [1, -1] {
            limits = TorqueLimiter::default();
            let emf = sign * 679;
            let applied =
                AppliedTorque { volts: sign * 779, torque: Torque(100 * sign as i16), ..AppliedTorque::OFF };
            let stands = LastTick { current: MilliAmps(5_776), applied: &applied, counted: false };
            assert_eq!(limits.envelope(&hand(), (most, FULL), emf, BUS, &LastTick::OFF).emf, emf);
            assert_eq!(limits.envelope(&hand(), (most, FULL), emf, BUS, &stands).emf, 0, "all of it");
            let freed = AppliedTorque { volts: sign * 100, ..applied };
            let fits = LastTick { current: MilliAmps(95), applied: &freed, counted: false };
            assert_eq!(limits.envelope(&hand(), (most, FULL), emf, BUS, &fits).emf, 0, "it stays missing");
            // A rotor that turns draws less: what it draws less is the EMF that it has.
            let turns = LastTick { current: MilliAmps(20), counted: true, ..fits };
            let given = limits.envelope(&hand(), (most, FULL), emf, BUS, &turns).emf * sign;
            assert!(given == 0 && limits.missing_emf < 1000, "{given} {limits:?}");
            let before = limits.missing_emf;
            let _ = limits.envelope(&hand(), (most, FULL), emf, BUS, &turns);
            assert!(limits.missing_emf < before, "{limits:?}");
        }
        // Braking: the EMF opposes the torque, and its current has not come yet.
        let braking = limits.envelope(
            &hand(),
            (most, FULL),
            679,
            BUS,
            &LastTick {
                current: MilliAmps(0),
                applied: &AppliedTorque { volts: 579, torque: Torque(-100), ..AppliedTorque::OFF },
                counted: false,
            },
        );
        assert_eq!(braking.emf, 679);
    }

    /// A rotor turns at 480 units of EMF, of which the estimate makes 600: T 100 is 500 units against it, and −20 of current drive the rotor on, which
    /// 24 V and a duty of 500/1024 draw as 95 mA.
    #[test]
    fn emf_that_drives_a_rotor_on_is_taken() {
        for sign in [1, -1] {
            let mut limits = TorqueLimiter::default();
            let (most, emf) = (Torque(100), -600 * sign);
            let tick = |volts: i32, current: i16| {
                let applied =
                    AppliedTorque { volts, torque: Torque(100 * sign as i16), ..AppliedTorque::OFF };
                (applied, MilliAmps(current))
            };
            let mut next = |(applied, current): (AppliedTorque, MilliAmps)| {
                let last = LastTick { current, applied: &applied, counted: true };
                limits.envelope(&hand(), (most, FULL), emf, BUS, &last).emf * -sign
            };
            let taken = next(tick(-500 * sign, 95));
            assert!((478..=483).contains(&taken), "{taken}");
            // Now the current is that of T, and flows back.
            let taken = next(tick(-380 * sign, -362));
            assert!((474..=484).contains(&taken), "{taken}");
            // It flows back harder: the EMF is there.
            let taken = next(tick(-380 * sign, -724));
            assert!(taken > 560, "{taken}");
        }
    }

    /// At the limit, and with the noise of the converter: 9/8 and a step.
    #[test]
    fn current_of_the_torque_limit_takes_no_emf() {
        for torque in [20, 100, 400, 750] {
            for emf in [0, 100, 240] {
                let mut limits = TorqueLimiter::default();
                let volts = i32::from(torque) + emf;
                let applied = AppliedTorque { volts, torque: Torque(torque), ..AppliedTorque::OFF };
                let amps = i32::from(torque) * 9_980 / 1024 * volts / 1024 + 6;
                let current = MilliAmps(i16::try_from(amps).expect("mA"));
                let envelope = limits.envelope(
                    &hand(),
                    (Torque(torque), FULL),
                    emf,
                    BUS,
                    &LastTick { current, applied: &applied, counted: false },
                );
                assert_eq!((envelope.emf, limits), (emf, TorqueLimiter::default()), "{torque} {emf}");
            }
        }
    }

    #[test]
    fn voltage_limit_is_exact_for_every_bus_voltage() {
        for bus in 0..=u16::MAX {
            assert_eq!(
                hand().volts(MilliVolts(bus)).unsigned_abs(),
                u32::from(bus) * MAX_DUTY / 24_000,
                "{bus}"
            );
        }
    }

    proptest! {
        #[test]
        fn whatever_is_wanted_the_duty_is_bounded(
            torque: i16, most in 0i16..=990, velocity: i32, bus: u16,
        ) {
            let velocity = CountsPerSec(Law::from_bits(velocity));
            let most = Torque(most);
            let bounded = TorqueLimiter::default().envelope(&hand(), (most, FULL), emf(velocity), MilliVolts(bus), &LastTick::OFF)
                .bound(&hand(), Torque(torque), Torque(torque));
            let duty = i32::from(bounded.duty.0.to_bits());
            prop_assert!(duty.unsigned_abs() <= (1 << 15) * MAX_DUTY / 1024, "{}", duty);
            // Nothing has wrapped: the duty is the voltage over the bus, and 250 mV of bus in the rounding of a quarter; and up to the dead
            // time in the torque's direction, 1 % of the bus and of 1.6 V.
            let volts = i64::from(bounded.torque.0) + i64::from(emf(velocity));
            prop_assert_eq!(i64::from(bounded.volts), volts);
            let exact = volts * 24 * 32_000 / i64::from(bus.max(1_000));
            let lost = 328 + 524_288 / i64::from(bus.max(1_000)) + 1;
            let more = (i64::from(duty) - exact) * if bounded.torque < Torque::ZERO { -1 } else { 1 };
            let rounding = 1 + exact.abs() / 250;
            prop_assert!((-rounding..=lost + rounding).contains(&more), "{} {}", duty, exact);
            prop_assert!(bounded.limit == Some(LimitCause::Duty) || bounded.torque.saturating_abs() <= most);
        }
    }

    /// T + E is the voltage across the motor. Beyond 25 V on the bus, none that would return power to it.
    #[test]
    fn braking_that_would_raise_the_bus_further_takes_no_power_from_the_rotor() {
        let high = MilliVolts(hand().bus.return_from.0 + 3000);
        for speed in [300, -300] {
            let turned = if speed > 0 { -1 } else { 1 };
            let at =
                |bus| envelope(990, speed, bus).bound(&hand(), Torque(turned * 100), Torque(turned * 100));
            let (calm, raised) = (at(BUS), at(high));
            assert_eq!((calm.torque, calm.limit), (Torque(turned * 100), None));
            assert_eq!(raised.limit, Some(LimitCause::Duty), "{raised:?}");
            // The voltage across the motor is what `supply` allows.
            let emf = emf(CountsPerSec::from_int(speed));
            let volts =
                hand().bus.without_return(i32::from(turned) * 100 + emf, i32::from(turned) * 100, high);
            assert_eq!(i32::from(raised.torque.0), volts - emf);
            assert!(raised.torque.0.abs() > 100, "more braking: {raised:?}");
            assert!(raised.duty.0.to_bits().abs() < calm.duty.0.to_bits().abs(), "at a lower duty");
        }
    }

    /// Less torque than the rise allows would need a voltage of the other sign: then none is applied.
    #[test]
    fn torque_that_rises_slowly_keeps_the_sign_of_its_voltage() {
        for (wanted, previous, speed) in
            [(900, 0, 0), (900, 0, 200), (900, 0, -200), (900, 0, -900), (-900, 0, 900)]
        {
            for sign in [1, -1] {
                let (wanted, speed) = (sign * wanted, sign * speed);
                let envelope = envelope(990, speed, BUS);
                let bounded = envelope.bound(&hand(), Torque(wanted), Torque(previous));
                let emf = emf(CountsPerSec::from_int(speed));
                let risen =
                    hand().bus.risen(i32::from(wanted).clamp(envelope.low, envelope.high), previous.into());
                let expected =
                    if (risen + emf).signum() == i32::from(wanted.signum()) { risen } else { -emf };
                assert_eq!(i32::from(bounded.torque.0), expected, "{wanted} at {speed}");
                assert_eq!(bounded.limit, Some(LimitCause::Supply), "{wanted} at {speed}");
            }
        }
        // Braking draws nothing, however suddenly.
        let braking = envelope(990, 500, BUS).bound(&hand(), Torque(-400), Torque::ZERO);
        assert_eq!((braking.torque, braking.limit), (Torque(-400), None));
    }
}
