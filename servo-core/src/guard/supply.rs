//! Protects the supply that the boards of a hand share: 30 A for seven motors, and no sink for what a braked motor returns.
//!
//! Each board sees the bus voltage alone, and folds its torque back as the voltage falls below what it is without load. The
//! loop of voltage and torque runs once a tick. With the capacitance C of a board (2.2 mF, docs/board.md) it settles if
//!
//! ```text
//! g = dI/dT · FOLD · 1 ms / C < 2      dI/dT = 2·T/1024² · 24² V² / (V · R), A of the bus per torque unit
//! ```
//!
//! g is 0.9 at 2.4 Ω and 1.2 at 1.7 Ω (decision 0053). Returned current is limited by the duty, not by the torque: a lower
//! duty brakes harder, and the winding takes the energy.

use crate::motor::Motor;
use crate::num::{half_up, saturating_u16};
use crate::units::{MilliVolts, Torque};

/// Torque that seven of the hand's motors may apply at any time and at once: 480/1024 of 24 V across 1.7 Ω (2.4 − 30 %) draws
/// 0.22 · 24 V / 1.7 Ω = 3.1 A each, 22 A in all. Seven of another motor may draw as much: see [`Bus::free`].
const FREE: u32 = 480;

/// Largest rise of the torque above that in a tick: seven motors then draw 4 A more a tick, and the voltage shows it before
/// it has fallen by 0.3 V.
const RISE: u32 = 32;

/// Power of the supply at peak current of the hand's motor, mW: 24 V · 9.98 A.
const HAND_MW: u64 = 239_520;

/// Fall of the bus voltage, mV, that reduces no torque: noise, and the regulation of the source.
const SLACK_MV: u32 = 300;

/// Torque without fold-back: MT's maximum.
const FULL: i32 = 990;

/// Fold-back, torque units per 1024 mV.
const FOLD: i32 = 164;

/// Fall of the unloaded voltage in an idle tick, µV: 0.25 V/s. Other motors may load the bus for seconds.
const FALL_UV: u32 = 250;

/// The supply and what a motor may take from it, or return.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bus {
    /// Torque that is applied without regard to the supply, and its largest rise above that in a tick.
    pub free: i32,
    rise: i32,
    /// Nominal voltage, µV: a source above it needs no torque limit until its voltage has fallen below; and a voltage raised by braked motors is
    /// not the source's.
    nominal_uv: u32,
    /// Bus voltage above which returned current is limited, 28 V of 24: a supply may be a sixth above its nominal voltage.
    pub return_from: MilliVolts,
    /// Bus voltage from which on nothing is returned, 29 V of 24: seven motors return 20 A at most, which is 1.3 V in a tick.
    return_none: MilliVolts,
    /// Bus voltage beyond any supply's, 30 V of 24: a torque within 1/16 of the EMF counts as braking, because a motor whose EMF is that much
    /// higher than its model returns current at it.
    returns: MilliVolts,
    /// Voltage across a motor at `return_from`, torque units.
    return_volts: i32,
}

impl Bus {
    /// The supply of a motor.
    #[must_use]
    pub fn new(motor: &Motor) -> Self {
        let mv = u32::from(motor.mvn) * 100;
        let millivolts = |parts: u32| MilliVolts(saturating_u16(mv * parts / 24));
        let power_mw = u64::from(half_up(u64::from(mv) * u64::from(motor.mpk), 1000));
        // A weak motor may apply all of its torque.
        let share = |of: u32| half_up(u64::from(of) * HAND_MW, power_mw).min(1024).cast_signed();
        let return_volts = half_up(u64::from(mv * 28 / 24) * 1024, motor.full_mv().into());
        Self {
            free: share(FREE),
            rise: share(RISE),
            nominal_uv: mv * 1000,
            return_from: millivolts(28),
            return_none: millivolts(29),
            returns: millivolts(30),
            return_volts: return_volts.cast_signed(),
        }
    }

    /// A torque that grows by at most `rise` a tick above `free`.
    #[inline(never)]
    #[must_use]
    pub fn risen(&self, torque: i32, previous: i32) -> i32 {
        let same = if torque < 0 { -previous } else { previous };
        let most = same.max(self.free) + self.rise;
        torque.max(-most).min(most)
    }

    /// The voltage across the motor, in torque units, that returns no more current than `bus` allows, instead of `volts`.
    #[inline(never)]
    #[must_use]
    pub fn without_return(&self, volts: i32, torque: i32, bus: MilliVolts) -> i32 {
        let room = i32::from(self.return_none.0) - i32::from(bus.0);
        let most = if room > 0 { (self.return_volts * room) >> 10 } else { 0 };
        let unsure = if bus > self.returns { (volts - torque) / 16 } else { 0 };
        if i64::from(volts) * i64::from(torque - unsure) >= 0 { volts } else { volts.max(-most).min(most) }
    }
}

/// The bus voltage without load, as seen while this motor idles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Supply {
    /// µV; 0 before the first idle tick.
    unloaded_uv: u32,
    /// Bus voltage below which torque folds back.
    full_from: MilliVolts,
}

impl Supply {
    /// One tick in idle.
    pub fn learn(&mut self, source: &Bus, bus: MilliVolts) {
        let seen = (u32::from(bus.0) * 1_000).min(source.nominal_uv);
        self.unloaded_uv = self.unloaded_uv.saturating_sub(FALL_UV).max(seen);
        let full_from = (self.unloaded_uv / 1_000).saturating_sub(SLACK_MV);
        self.full_from = MilliVolts(u16::try_from(full_from).unwrap_or(u16::MAX));
    }

    /// The torque, and the voltage across the motor in the same unit, that the bus voltage allows, if it limits.
    #[must_use]
    #[inline]
    pub fn fold(&self, source: &Bus, bus: MilliVolts) -> Option<Torque> {
        if bus >= self.full_from { None } else { Some(folded(source.free, self.full_from, bus)) }
    }
}

#[inline(never)]
fn folded(free: i32, full_from: MilliVolts, bus: MilliVolts) -> Torque {
    let missing = i32::from(full_from.0) - i32::from(bus.0);
    let torque = (FULL - ((missing * FOLD) >> 10)).max(free);
    Torque(crate::num::saturating_i16(torque))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hand() -> Bus {
        Bus::new(&Motor::HAND)
    }

    fn on(source: u16) -> Supply {
        let mut supply = Supply::default();
        supply.learn(&hand(), MilliVolts(source));
        supply
    }

    #[test]
    fn torque_folds_back_from_the_unloaded_voltage() {
        for source in [20_000, 24_000] {
            let fold = |below: u16| on(source).fold(&hand(), MilliVolts(source - below));
            assert_eq!(fold(0), None);
            assert_eq!(fold(300), None);
            assert_eq!(fold(300 + 1_024), Some(Torque(990 - 164)));
            assert_eq!(fold(3_600), Some(Torque(480)));
            assert_eq!(fold(source), Some(Torque(480)), "a motor can always move");
        }
        // 28 V may fall to 23.7 first.
        assert_eq!(on(28_000).fold(&hand(), MilliVolts(23_700)), None);
        assert!(on(28_000).fold(&hand(), MilliVolts(23_600)).is_some());
    }

    #[test]
    fn unloaded_voltage_rises_at_once_and_falls_slowly() {
        let mut supply = on(20_000);
        supply.learn(&hand(), MilliVolts(24_000));
        assert_eq!(supply, on(24_000));
        for _ in 0..1_000 {
            supply.learn(&hand(), MilliVolts(21_000));
        }
        assert_eq!(supply.fold(&hand(), MilliVolts(23_449)), Some(Torque(990)), "0.25 V in a second");
        assert_eq!(supply.fold(&hand(), MilliVolts(23_450)), None);
        supply.learn(&hand(), MilliVolts(31_000));
        assert_eq!(supply, on(24_000), "braked motors raise the voltage, not the source");
    }

    #[test]
    fn torque_rises_by_steps_above_what_is_free() {
        for sign in [1, -1] {
            assert_eq!(hand().risen(sign * 990, 0), sign * 512);
            assert_eq!(hand().risen(sign * 990, sign * 512), sign * 544);
            assert_eq!(hand().risen(sign * 990, -sign * 990), sign * 512, "reversed");
            assert_eq!(hand().risen(sign * 600, sign * 800), sign * 600, "falls at once");
        }
    }

    #[test]
    fn high_bus_trades_returned_current_for_heat_in_the_winding() {
        // At 900 counts/s forwards the EMF is 873; torque −300 needs 573.
        assert_eq!(hand().without_return(573, -300, MilliVolts(28_001)), 573);
        assert_eq!(hand().without_return(573, -300, MilliVolts(28_800)), 233);
        assert_eq!(hand().without_return(573, -300, MilliVolts(29_000)), 0);
        assert_eq!(hand().without_return(-573, 300, MilliVolts(40_000)), 0);
        // Neither driving nor plugging returns current.
        for (volts, torque) in [(573, 300), (-100, -900)] {
            assert_eq!(hand().without_return(volts, torque, MilliVolts(31_000)), volts);
        }
        // The bus says that this little torque drives nothing.
        assert_eq!(hand().without_return(-630, -10, MilliVolts(30_000)), -630);
        assert_eq!(hand().without_return(-630, -10, MilliVolts(30_001)), 0);
    }
}
