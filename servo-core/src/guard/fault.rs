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
pub enum Limit {
    /// Torque at MT, or IHIT while homing.
    Torque,
    /// Duty at 97 %: the bootstrap drivers need the rest (property VBUS).
    Duty,
    /// Torque derated near the motor's temperature limit (property OTEMP).
    Thermal,
    /// Torque cut back because the phase current is above the motor's peak (property IMOTOR).
    Current,
}

/// Watches for faults and keeps the first until it is cleared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    latched: Option<Fault>,
    halls: bool,
    /// How long the bus voltage has been wrong on one side.
    bus_ms: u8,
    bus_high: bool,
}

/// What a tick finds wrong at once.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Wrongs {
    /// The driver's break input has switched the bridge off.
    pub bridge: bool,
    /// The phase current is that of a short.
    pub short: bool,
    /// The motor is at its temperature limit.
    pub hot: bool,
    /// The host is needed, and silent.
    pub host_lost: bool,
}

impl Faults {
    /// The latched fault.
    #[must_use]
    pub const fn latched(&self) -> Option<Fault> {
        self.latched
    }

    /// The hall decoder has given up on the lines.
    pub const fn halls(&mut self) {
        self.halls = true;
    }

    /// Forgets the latched fault; one that persists comes back at the next check, before anything is driven: how long the
    /// bus voltage has been wrong is not forgotten, and hall lines that are wrong are reported at each tick.
    pub const fn clear(&mut self) {
        self.latched = None;
        self.halls = false;
    }

    /// One tick of 1 ms: the bus voltage, and what else is wrong.
    ///
    /// Returns a fault when it latches, once.
    #[inline]
    pub fn check(&mut self, bus: MilliVolts, wrongs: Wrongs) -> Option<Fault> {
        let Wrongs { bridge, short, hot, host_lost } = wrongs;
        let bus_right = bus.0.wrapping_sub(UNDER.0) <= OVER.0 - UNDER.0;
        if bus_right && !(bridge | short | hot | host_lost | self.halls) {
            self.bus_ms = 0;
            return None;
        }
        self.judge(bus, wrongs)
    }

    /// The rest of [`Self::check`], where something is wrong.
    #[inline(never)]
    fn judge(&mut self, bus: MilliVolts, wrongs: Wrongs) -> Option<Fault> {
        let high = bus > OVER;
        if !high && bus >= UNDER {
            self.bus_ms = 0;
        } else if high == self.bus_high {
            self.bus_ms = self.bus_ms.saturating_add(1);
        } else {
            self.bus_high = high;
            self.bus_ms = 1;
        }
        if self.latched.is_some() {
            return None;
        }
        self.latched = if wrongs.bridge {
            Some(Fault::Bridge)
        } else if wrongs.short {
            Some(Fault::OverCurrent)
        } else if self.halls {
            Some(Fault::Halls)
        } else if self.bus_ms >= BUS_MS {
            Some(if high { Fault::OverVoltage } else { Fault::UnderVoltage })
        } else if wrongs.hot {
            Some(Fault::OverTemperature)
        } else if wrongs.host_lost {
            Some(Fault::HostLost)
        } else {
            None
        };
        self.latched
    }
}
