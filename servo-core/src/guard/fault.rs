//! What must never go on, and what merely bounds: two enums, each naming the property that governs it.

use crate::guard::thermal::Thermal;
use crate::units::{DeciCelsius, MilliVolts};

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
    over_ms: u8,
    under_ms: u8,
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

    /// One tick of 1 ms: bus voltage, motor thermistor with its limit, and what switched the bridge off or
    /// should: the driver's break input, and a phase current that is a short's. `host_lost`: the host is needed, and
    /// silent.
    ///
    /// Returns a fault when it latches, once.
    pub fn check(
        &mut self,
        bus: MilliVolts,
        (motor_temp, otemp): (DeciCelsius, i16),
        bridge_fault: bool,
        short: bool,
        host_lost: bool,
    ) -> Option<Fault> {
        self.over_ms = if bus > OVER { self.over_ms.saturating_add(1) } else { 0 };
        self.under_ms = if bus < UNDER { self.under_ms.saturating_add(1) } else { 0 };
        if self.latched.is_some() {
            return None;
        }
        self.latched = if bridge_fault {
            Some(Fault::Bridge)
        } else if short {
            Some(Fault::OverCurrent)
        } else if self.halls {
            Some(Fault::Halls)
        } else if self.over_ms >= BUS_MS {
            Some(Fault::OverVoltage)
        } else if self.under_ms >= BUS_MS {
            Some(Fault::UnderVoltage)
        } else if Thermal::over(motor_temp, otemp) {
            Some(Fault::OverTemperature)
        } else if host_lost {
            Some(Fault::HostLost)
        } else {
            None
        };
        self.latched
    }
}
