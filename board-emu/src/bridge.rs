//! From the timer's outputs to the motor model's bridge: which output drives each gate, and when.
//!
//! A driver switches its gate on at a high level; a pull-down holds an undriven one off.

use hil_world::rig::{Bridge, Leg, Rig, duty};

use crate::chip::Chip;
use crate::chip::gpio::Mode;
use crate::chip::tim1::{Gate, Gates};

/// Pins of legs A, B, C as (port, number); port A is 0.
const HIGH: [(usize, usize); 3] = [(0, 8), (0, 9), (0, 10)];
const LOW: [(usize, usize); 3] = [(1, 13), (1, 14), (1, 15)];
const NAMES: [&str; 3] = ["A", "B", "C"];
/// Turn-off time of a gate driver with its MOSFET (docs/board.md), in ns and in clocks of 72 MHz.
const SWITCH_OFF_NS: u64 = 250;
const SWITCH_OFF: u64 = SWITCH_OFF_NS * 72 / 1000;
/// PWM period of the motor model: 50 us at 72 MHz.
const PERIOD: u64 = 3600;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Switch {
    Off,
    On,
    /// Start and length of the on-time within the period, clocks.
    Pwm(u64, u64),
}

/// An error names the output that should drive the gate.
fn gate(chip: &Chip, (port, pin): (usize, usize), timer: Gate, armed: bool) -> Result<Switch, String> {
    let held = |level: bool| if level { Switch::On } else { Switch::Off };
    let name = || format!("gate at P{}{pin}", ['A', 'B', 'C', 'D', 'E'][port]);
    let open = || {
        if armed { Err(format!("{}: not driven while the bridge is on", name())) } else { Ok(Switch::Off) }
    };
    match (chip.gpio.mode(port, pin), timer) {
        (Mode::AlternatePushPull, Gate::Open) | (Mode::Analog | Mode::Floating, _) => open(),
        (Mode::AlternatePushPull, Gate::Held(level)) => Ok(held(level)),
        (Mode::AlternatePushPull, Gate::Pwm { rise, high }) => Ok(Switch::Pwm(rise, high)),
        (Mode::Pulled, _) if !chip.gpio.level(port, pin) => open(),
        // A pull-up against the pull-down gives no defined level.
        (Mode::Pulled, _) => Err(format!("{}: the chip pulls it up, against the driver's pull-down", name())),
        (Mode::AlternateOpenDrain, _) => open(),
        (Mode::PushPull | Mode::OpenDrain, _) if armed => {
            Err(format!("{}: the port has it, not TIM1", name()))
        }
        (Mode::PushPull | Mode::OpenDrain, _) => Ok(held(chip.gpio.output(port, pin) == Some(true))),
    }
}

/// Clocks between the on-times of the two switches.
fn gap((from, on): (u64, u64), next: u64, period: u64) -> u64 {
    (next + 2 * period - from - on) % period
}

fn leg(gates: &Gates, high: Switch, low: Switch, compare: u32) -> Result<(Leg, u32), String> {
    match (high, low) {
        (Switch::Off, Switch::Off) => Ok((Leg::Float, 0)),
        (Switch::Off, Switch::On) => Ok((Leg::Low, 0)),
        (Switch::On, Switch::Off) => Ok((Leg::Pwm, gates.full)),
        (Switch::On, _) | (_, Switch::On) => Err("both switches conduct".to_owned()),
        (Switch::Pwm(..), Switch::Off) => {
            Err("only its high side is modulated, which the motor's model lacks".to_owned())
        }
        (Switch::Pwm(rise, on), Switch::Pwm(rise_n, on_n)) => {
            let (a, b) = (gap((rise, on), rise_n, gates.period), gap((rise_n, on_n), rise, gates.period));
            // Unless they overlap, both on-times and the gaps fill the period.
            if on + on_n + a + b != gates.period {
                Err("both switches conduct for a part of the period".to_owned())
            } else if a.min(b) < SWITCH_OFF {
                let ns = a.min(b) * 1000 / 72;
                Err(format!(
                    "dead time of {ns} ns: a switch needs {SWITCH_OFF_NS} ns to switch off, so both conduct"
                ))
            } else if on.abs_diff(2 * u64::from(compare) - gates.dead) != 0 {
                Err("its high side is on where the timer's channel is off: a polarity is inverted".to_owned())
            } else {
                Ok((Leg::Pwm, compare))
            }
        }
        // The dead time has eaten the shorter pulse.
        (Switch::Off, Switch::Pwm(..)) if 2 * u64::from(compare) <= gates.dead && compare > 0 => {
            Ok((Leg::Pwm, compare))
        }
        (Switch::Off, Switch::Pwm(..)) => {
            Err("only its low side is modulated, which the motor's model lacks".to_owned())
        }
    }
}

/// The state of the bridge.
///
/// # Errors
/// A gate or leg in a state that no bridge survives, or that the motor model cannot represent.
pub fn of(chip: &Chip) -> Result<Bridge, String> {
    let gates = chip.tim1.gates();
    let armed = chip.tim1.is_on();
    let mut legs = [Leg::Float; 3];
    let mut compares = Vec::new();
    for index in 0..3 {
        let high = gate(chip, HIGH[index], gates.high[index], armed)?;
        let low = gate(chip, LOW[index], gates.low[index], armed)?;
        let (leg, compare) = leg(&gates, high, low, gates.compare[index])
            .map_err(|what| format!("leg {}: {what}", NAMES[index]))?;
        legs[index] = leg;
        if leg == Leg::Pwm {
            compares.push(compare);
        }
    }
    if legs == [Leg::Float; 3] {
        return Ok(Bridge::Off);
    }
    if compares.windows(2).any(|pair| pair[0] != pair[1]) {
        return Err(format!(
            "legs with different compare values {compares:?}, which the motor's model lacks"
        ));
    }
    let compare = compares.first().copied().unwrap_or(0);
    if !compares.is_empty() && gates.period != PERIOD {
        return Err(format!(
            "a PWM period of {} clocks of 72 MHz; the motor's model has {PERIOD}",
            gates.period
        ));
    }
    Ok(Bridge::On { legs, duty: duty(compare, gates.full) })
}

/// Checks that the motor model has the timer's dead time, within a clock.
///
/// # Errors
/// Both dead times.
pub fn dead_time_agrees(chip: &Chip, rig: &Rig) -> Result<(), String> {
    let ns = chip.tim1.dead_time() as f64 * 1000.0 / 72.0;
    if (ns - rig.dead_time_ns()).abs() < 1000.0 / 72.0 {
        Ok(())
    } else {
        Err(format!(
            "dead time {ns:.0} ns by TIM1 and {:.0} ns in the motor's model (dead_time_us)",
            rig.dead_time_ns()
        ))
    }
}

#[cfg(test)]
mod tests;
