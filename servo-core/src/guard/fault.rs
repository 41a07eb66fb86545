//! Faults, which end a motion, and limits, which reduce its torque. Each names the property that governs it.

use crate::units::MilliVolts;

/// Bus voltage above which the bridge and its capacitors are at risk: 24 V + 1/3. Braked motors raise the bus voltage.
const OVER: MilliVolts = MilliVolts(32_000);

/// Bus voltage below which the gate drivers lose their supply.
const UNDER: MilliVolts = MilliVolts(16_000);

/// Consecutive ticks of bad bus voltage that are a fault: a motor's start dips a long cable for milliseconds.
const BUS_MS: u8 = 10;

/// A condition that ends motion at once: bridge off, brake engaged, until `Command::ClearFault`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Fault {
    /// Too many invalid hall transitions, or a stuck line (property HALLS).
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
    /// No frame from the host in mode 2 or 4, where the host closes the loop. It ends the motion as the others do, but
    /// forbids none: the next order clears it, and a fault of another kind replaces it.
    HostLost,
    /// HI could not leave its stop and return to it (property IHIT).
    Jammed,
    /// The motor ran against its own torque (property FIND).
    Wiring,
}

/// A limit that reduced the torque or the duty; the motion continues.
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
    /// Torque folded back, or raised slowly, because the supply cannot deliver more (property VBUS).
    Supply,
}

/// A fault condition, raised where it is detected. The bus voltage is checked by [`Faults::check`] itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Condition(u8);

impl Condition {
    /// The break input switched the bridge off.
    pub const BRIDGE: Self = Self(1 << 0);
    /// The phase current of a short circuit.
    pub const SHORT: Self = Self(1 << 1);
    /// The hall decoder gave up on the lines. Stays raised until it is cleared.
    pub const HALLS: Self = Self(1 << 2);
    /// The motor is at its temperature limit.
    pub const HOT: Self = Self(1 << 3);
    /// The host is needed and silent.
    pub const HOST_LOST: Self = Self(1 << 4);
    /// HI could not prove that the motor turns.
    pub const JAMMED: Self = Self(1 << 5);
    /// The motor ran against its own torque.
    pub const WIRING: Self = Self(1 << 6);
}

/// Beside the bits of [`Condition`]: bad bus voltage at the last check.
const BUS: u8 = 1 << 7;

/// Latches the first fault until it is cleared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults {
    latched: Option<Fault>,
    /// Conditions raised since the last check, a bit each: one comparison for a tick without any.
    raised: u8,
    /// Consecutive ticks of bad bus voltage on the side `bus_high`.
    bus_ms: u8,
    bus_high: bool,
}

impl Faults {
    /// The latched fault.
    #[must_use]
    pub const fn latched(&self) -> Option<Fault> {
        self.latched
    }

    /// Raises a condition for the next [`Self::check`]. A condition that persists is raised again before each.
    pub const fn raise(&mut self, condition: Condition) {
        self.raised |= condition.0;
    }

    /// The latched fault, if it forbids motion.
    #[must_use]
    pub const fn forbidding(&self) -> Option<Fault> {
        match self.latched {
            Some(Fault::HostLost) | None => None,
            fault => fault,
        }
    }

    /// A host has ordered something again.
    pub const fn host_is_back(&mut self) {
        if let Some(Fault::HostLost) = self.latched {
            self.latched = None;
        }
    }

    /// Clears the latched fault. A condition that persists latches again at the next check, before anything is driven: the
    /// time of a bad bus voltage is kept, and the decoder reports bad hall lines at each tick.
    pub const fn clear(&mut self) {
        self.latched = None;
        self.raised &= !Condition::HALLS.0;
    }

    /// One tick of 1 ms. Returns a fault once, when it latches.
    #[inline]
    pub fn check(&mut self, bus: MilliVolts) -> Option<Fault> {
        let bus_good = (UNDER.0..=OVER.0).contains(&bus.0);
        if bus_good && self.raised == 0 { None } else { self.judge(bus) }
    }

    #[inline(never)]
    fn judge(&mut self, bus: MilliVolts) -> Option<Fault> {
        let raised = self.raised;
        let raised = |condition: Condition| raised & condition.0 != 0;
        let high = bus > OVER;
        if !high && bus >= UNDER {
            self.bus_ms = 0;
        } else if high == self.bus_high {
            self.bus_ms = self.bus_ms.saturating_add(1);
        } else {
            self.bus_high = high;
            self.bus_ms = 1;
        }
        self.raised &= Condition::HALLS.0;
        if self.bus_ms != 0 {
            self.raised |= BUS;
        }
        if self.forbidding().is_some() {
            return None;
        }
        let fault = if raised(Condition::BRIDGE) {
            Some(Fault::Bridge)
        } else if raised(Condition::SHORT) {
            Some(Fault::OverCurrent)
        } else if raised(Condition::HALLS) {
            Some(Fault::Halls)
        } else if self.bus_ms >= BUS_MS {
            Some(if high { Fault::OverVoltage } else { Fault::UnderVoltage })
        } else if raised(Condition::HOT) {
            Some(Fault::OverTemperature)
        } else if raised(Condition::WIRING) {
            Some(Fault::Wiring)
        } else if raised(Condition::HOST_LOST) {
            Some(Fault::HostLost)
        } else if raised(Condition::JAMMED) {
            Some(Fault::Jammed)
        } else {
            None
        };
        if fault.is_some() {
            self.latched = fault;
        }
        fault
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUS_GOOD: MilliVolts = MilliVolts(24_000);

    #[test]
    fn each_condition_is_a_fault_of_its_own() {
        for (condition, fault) in [
            (Condition::BRIDGE, Fault::Bridge),
            (Condition::SHORT, Fault::OverCurrent),
            (Condition::HALLS, Fault::Halls),
            (Condition::HOT, Fault::OverTemperature),
            (Condition::HOST_LOST, Fault::HostLost),
            (Condition::JAMMED, Fault::Jammed),
            (Condition::WIRING, Fault::Wiring),
        ] {
            let mut faults = Faults::default();
            faults.raise(condition);
            assert_eq!((faults.check(BUS_GOOD), faults.latched()), (Some(fault), Some(fault)));
        }
    }

    #[test]
    fn bad_bus_voltage_counts_only_in_consecutive_ticks() {
        let mut faults = Faults::default();
        for tick in 0..100 {
            let bus = if tick % BUS_MS == 0 { BUS_GOOD } else { MilliVolts(UNDER.0 - 1) };
            assert_eq!(faults.check(bus), None, "{tick}");
        }
        assert_eq!(faults.check(MilliVolts(UNDER.0 - 1)), Some(Fault::UnderVoltage));
    }
}
