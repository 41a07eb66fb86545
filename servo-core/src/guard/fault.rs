//! What must never go on, and what merely bounds: two enums, each naming the property that governs it.

use crate::units::MilliVolts;

/// Bus voltage above which the bridge and its capacitors are in danger: 24 V + 1/3 (motors that are braked
/// pump the bus up).
const OVER: MilliVolts = MilliVolts(32_000);

/// Bus voltage below which the gate drivers lose their supply.
const UNDER: MilliVolts = MilliVolts(16_000);

/// Ticks that a wrong bus voltage must last: a motor's start dips a long cable for milliseconds.
const BUS_MS: u8 = 10;

/// A condition that ends motion at once: bridge off, brake engaged, until `Command::ClearFault`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// The hall lines lie too often or one of them is stuck (property HALLS).
    Halls,
    /// Phase current above what a working motor can draw (property IMOTOR).
    OverCurrent,
    /// Motor temperature at its limit (property OTEMP).
    OverTemperature,
    /// Bus voltage above the bridge's rating (property VBUS).
    OverVoltage,
    /// Bus voltage too low for the gate drivers (property VBUS).
    UnderVoltage,
    /// The gate driver or the over-current comparator switched the bridge off.
    Bridge,
    /// The host fell silent in a mode in which it steers (property MODE, 2 and 4).
    HostLost,
}

/// A bound that the torque or the duty ran into; the motion goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum LimitCause {
    /// Torque at MT, or IHIT while homing.
    Torque,
    /// Duty at 97 %: the bootstrap drivers need the rest (property VBUS).
    Duty,
    /// Torque derated near the motor's temperature limit (property OTEMP).
    Thermal,
    /// Torque cut back because the phase current is above the motor's peak (property IMOTOR).
    Current,
}

/// Something that is wrong at once, but for the bus voltage: said where it is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Condition(u8);

impl Condition {
    /// The driver's break input has switched the bridge off.
    pub const BRIDGE: Self = Self(1 << 0);
    /// The phase current is that of a short.
    pub const SHORT: Self = Self(1 << 1);
    /// The hall decoder has given up on the lines. Stays so until it is cleared.
    pub const HALLS: Self = Self(1 << 2);
    /// The motor is at its temperature limit.
    pub const HOT: Self = Self(1 << 3);
    /// The host is needed, and silent.
    pub const HOST_LOST: Self = Self(1 << 4);
}

/// Beside the bits of [`Condition`]: the bus voltage was wrong at the last check.
const BUS: u8 = 1 << 7;

/// Watches for faults and keeps the first until it is cleared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    latched: Option<Fault>,
    /// What has been said since the last check, a bit each: nothing as a rule, so that a tick has but this to look at.
    said: u8,
    /// How long the bus voltage has been wrong on one side.
    bus_ms: u8,
    bus_high: bool,
}

impl Faults {
    /// The latched fault.
    #[must_use]
    pub const fn latched(&self) -> Option<Fault> {
        self.latched
    }

    /// Something is wrong: to be said before each [`Self::check`] at which it is.
    pub const fn raise(&mut self, wrong: Condition) {
        self.said |= wrong.0;
    }

    /// Forgets the latched fault; one that persists comes back at the next check, before anything is driven: how long the
    /// bus voltage has been wrong is not forgotten, and hall lines that are wrong are reported at each tick.
    pub const fn clear(&mut self) {
        self.latched = None;
        self.said &= !Condition::HALLS.0;
    }

    /// One tick of 1 ms: the bus voltage, and what else has been said.
    ///
    /// Returns a fault when it latches, once.
    #[inline]
    pub fn check(&mut self, bus: MilliVolts) -> Option<Fault> {
        let bus_right = (UNDER.0..=OVER.0).contains(&bus.0);
        if bus_right && self.said == 0 { None } else { self.judge(bus) }
    }

    /// The rest of [`Self::check`], where something is wrong.
    #[inline(never)]
    fn judge(&mut self, bus: MilliVolts) -> Option<Fault> {
        let said = self.said;
        let wrong = |what: Condition| said & what.0 != 0;
        let high = bus > OVER;
        if !high && bus >= UNDER {
            self.bus_ms = 0;
        } else if high == self.bus_high {
            self.bus_ms = self.bus_ms.saturating_add(1);
        } else {
            self.bus_high = high;
            self.bus_ms = 1;
        }
        self.said &= Condition::HALLS.0;
        if self.bus_ms != 0 {
            self.said |= BUS;
        }
        if self.latched.is_some() {
            return None;
        }
        self.latched = if wrong(Condition::BRIDGE) {
            Some(Fault::Bridge)
        } else if wrong(Condition::SHORT) {
            Some(Fault::OverCurrent)
        } else if wrong(Condition::HALLS) {
            Some(Fault::Halls)
        } else if self.bus_ms >= BUS_MS {
            Some(if high { Fault::OverVoltage } else { Fault::UnderVoltage })
        } else if wrong(Condition::HOT) {
            Some(Fault::OverTemperature)
        } else if wrong(Condition::HOST_LOST) {
            Some(Fault::HostLost)
        } else {
            None
        };
        self.latched
    }
}
