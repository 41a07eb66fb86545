//! The board's analog front end: from motor quantities to the converter's 12 bits (docs/board.md, "Analog
//! front end").

use hil_world::rig::{Analog, Rig};

/// Codes of the converter; its reference is VDDA, 3.3 V.
const CODES: f64 = 4096.0;
const VDDA: f64 = 3.3;
/// Divider of the supply voltage.
const DIVIDER: f64 = 10.0 / (100.0 + 10.0);
/// Shunt of the supply current in ohm, gain of its amplifier, and the amplifier's mid-point in V.
const SHUNT: f64 = 2e-3;
const GAIN: f64 = 41.25;
const MIDDLE: f64 = 1.65;
/// Corner frequency of the low-pass behind the amplifier, Hz.
const LOW_PASS: f64 = 1000.0;
/// Thermistors: B in K, and 25 degrees Celsius in K, where they equal their pull-up.
const B: f64 = 3950.0;
const T0: f64 = 298.15;
const CURRENT: usize = 5;
const VOLTAGE: usize = 1;
const STRAIN: usize = 2;
const MOTOR_TEMP: usize = 3;
const BOARD_TEMP: usize = 4;

/// The front end with the state of its low-pass.
#[derive(Clone, Debug, Default)]
pub struct FrontEnd {
    /// Output of the low-pass, A.
    current_a: f64,
    /// Time of the last sample, us.
    at_us: u64,
    peak_phase_a: f64,
}

impl FrontEnd {
    /// A front end that has seen no current yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The converter's present inputs, by channel. The supply current is its mean since the last call.
    pub fn sample(&mut self, rig: &mut Rig) -> [u16; 18] {
        let seen = rig.analog();
        self.peak_phase_a = self.peak_phase_a.max(rig.truth().peak_phase_a);
        let dt = rig.now_us().saturating_sub(self.at_us) as f64 * 1e-6;
        self.at_us = rig.now_us();
        self.codes(&seen, dt)
    }

    /// Largest phase current since the last call, A.
    pub const fn take_peak(&mut self) -> f64 {
        std::mem::replace(&mut self.peak_phase_a, 0.0)
    }

    /// `dt` in s.
    fn codes(&mut self, seen: &Analog, dt: f64) -> [u16; 18] {
        let amps = f64::from(seen.current.0) * 1e-3;
        self.current_a += (amps - self.current_a) * (1.0 - (-std::f64::consts::TAU * LOW_PASS * dt).exp());
        let mut inputs = [0; 18];
        inputs[VOLTAGE] = code(f64::from(seen.bus.0) * 1e-3 * DIVIDER);
        inputs[CURRENT] = code(self.current_a * SHUNT * GAIN + MIDDLE);
        // Output of the strain amplifier equals its code.
        inputs[STRAIN] = seen.raw[0].min(4095);
        inputs[MOTOR_TEMP] = thermistor(seen.motor_temp.0);
        inputs[BOARD_TEMP] = thermistor(seen.board_temp.0);
        inputs
    }
}

fn code(volts: f64) -> u16 {
    (volts / VDDA * CODES).round().clamp(0.0, CODES - 1.0) as u16
}

/// Code of a thermistor to ground below its pull-up, at a temperature in 0.1 degrees Celsius.
fn thermistor(tenths: i16) -> u16 {
    let kelvin = f64::from(tenths) * 0.1 + 273.15;
    let ratio = (B * (1.0 / kelvin - 1.0 / T0)).exp();
    code(VDDA * ratio / (1.0 + ratio))
}

#[cfg(test)]
mod tests;
