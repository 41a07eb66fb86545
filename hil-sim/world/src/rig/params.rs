//! Errors and scales of the board's sensors.

use crate::plant::params::{ParamError, check};
use serde::{Deserialize, Serialize};

/// A wrong code on the hall lines for a time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HallGlitch {
    /// Start, µs since the start of the run.
    pub at_us: u64,
    /// The code seen, 0..=7.
    pub code: u8,
    /// Duration, µs.
    pub duration_us: u64,
}

/// A hall line stuck at a level.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table with line, high and from_us")]
pub struct StuckLine {
    /// Bit of the line in the code, 0..=2.
    pub line: u8,
    /// The level it sticks at.
    pub high: bool,
    /// Start, µs since the start of the run.
    pub from_us: u64,
}

/// The sensors of one board.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RigParams {
    /// Error of the upper boundary of sector k (90° + 60°·k), degrees electrical, ±25; positive = at a higher count.
    pub hall_error_deg: [f64; 6],
    /// Distance between the edges of a boundary in either direction, degrees electrical, 0 to 9. Chosen 1: a latching sensor's 2 mT of
    /// some hundred that a rotor's magnet gives.
    pub hall_hysteresis_deg: f64,
    /// RMS of the place of each edge, degrees electrical, 0 to 1. Chosen 0.3: noise of a few tenths of a mT.
    pub hall_jitter_deg: f64,
    /// Delay of a rising hall line, µs; falling edges are immediate (open collector with a pull-up).
    pub rise_delay_us: u64,
    /// Wrong codes, in order of time, not overlapping.
    pub glitches: Vec<HallGlitch>,
    /// A stuck line.
    pub stuck: Option<StuckLine>,
    /// The motor's phase (0..=2) on each leg of the bridge.
    pub phases: [u8; 3],
    /// The sensor (0..=2) on each hall line.
    pub halls: [u8; 3],
    /// Hall lines whose level is inverted.
    pub inverted: [bool; 3],
    /// Legs of the bridge without a motor.
    pub open: [bool; 3],
    /// Two hall lines shorted together: either one low pulls both low.
    pub shorted: Option<[u8; 2]>,
    /// Noise of each ADC reading, uniform ± this many LSB.
    pub adc_noise_lsb: f64,
    /// Lag of the thermistor behind the housing, s.
    pub thermistor_lag_s: f64,
    /// Strain reading without load, 0..=255.
    pub strain_zero: f64,
    /// Strain LSB per N·m of joint torque, positive when closing on an object.
    pub strain_per_n_m: f64,
}

impl Default for RigParams {
    fn default() -> Self {
        Self {
            hall_error_deg: [0.0; 6],
            hall_hysteresis_deg: 1.0,
            hall_jitter_deg: 0.3,
            rise_delay_us: 0,
            glitches: Vec::new(),
            stuck: None,
            phases: [0, 1, 2],
            halls: [0, 1, 2],
            inverted: [false; 3],
            open: [false; 3],
            shorted: None,
            adc_noise_lsb: 0.5,
            // Chosen: a bead glued to the housing.
            thermistor_lag_s: 2.0,
            strain_zero: 128.0,
            // Chosen: 15 N·m (a link at full torque, half the worm's efficiency) use half the range above zero.
            strain_per_n_m: 4.0,
        }
    }
}

impl RigParams {
    /// The default, with edges at the same place in each direction and each time.
    #[must_use]
    pub fn ideal() -> Self {
        Self { hall_hysteresis_deg: 0.0, hall_jitter_deg: 0.0, ..Self::default() }
    }

    /// Whether phases and hall lines are connected as the standard has it.
    #[must_use]
    pub fn is_wired_as_standard(&self) -> bool {
        let Self { phases, halls, inverted, .. } = Self::default();
        (self.phases, self.halls, self.inverted) == (phases, halls, inverted)
    }

    /// Checks every field.
    ///
    /// # Errors
    /// The first field out of range.
    pub fn validate(&self) -> Result<(), ParamError> {
        for &error in &self.hall_error_deg {
            check(&[("hall_error_deg", error, -25.0, 25.0)])?;
        }
        // With errors of 25 degrees a count is 10 degrees wide at least.
        check(&[
            ("hall_hysteresis_deg", self.hall_hysteresis_deg, 0.0, 9.0),
            ("hall_jitter_deg", self.hall_jitter_deg, 0.0, 1.0),
        ])?;
        let mut free_from = 0;
        for g in &self.glitches {
            check(&[
                ("glitches.code", f64::from(g.code), 0.0, 7.0),
                ("glitches.duration_us", g.duration_us as f64, 1.0, 1e9),
                ("glitches.at_us", g.at_us as f64, free_from as f64, 1e15),
            ])?;
            free_from = g.at_us + g.duration_us;
        }
        if let Some(stuck) = self.stuck {
            check(&[("stuck.line", f64::from(stuck.line), 0.0, 2.0)])?;
        }
        for (field, order) in [("phases", self.phases), ("halls", self.halls)] {
            for (at, &wire) in order.iter().enumerate() {
                let again = order[..at].contains(&wire);
                if wire > 2 || again {
                    let expected = "each of 0, 1 and 2 once".to_owned();
                    return Err(ParamError { field, found: f64::from(wire), expected });
                }
            }
        }
        for line in self.shorted.into_iter().flatten() {
            check(&[("shorted", f64::from(line), 0.0, 2.0)])?;
        }
        if let Some([a, b]) = self.shorted
            && a == b
        {
            let expected = "two different lines".to_owned();
            return Err(ParamError { field: "shorted", found: f64::from(b), expected });
        }
        check(&[
            ("rise_delay_us", self.rise_delay_us as f64, 0.0, 10_000.0),
            ("adc_noise_lsb", self.adc_noise_lsb, 0.0, 100.0),
            ("thermistor_lag_s", self.thermistor_lag_s, 1e-3, 1e4),
            ("strain_zero", self.strain_zero, 0.0, 255.0),
            ("strain_per_n_m", self.strain_per_n_m, -1000.0, 1000.0),
        ])
    }
}
