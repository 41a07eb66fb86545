//! The temperature of the palm, where GOD's board and its sensor are: one heat capacity that all losses of the hand warm.
//!
//! C·dT/dt = P − (T − T_ambient)/R: P is the rest losses of the eight boards plus the copper losses of the seven motors, which all reach the
//! air through the palm. The motors' own paths are in `plant::thermal`.

/// Thermal resistance from palm to air, K/W. Chosen: a palm of 0.1 m² in still air at 10 W/(m²·K).
const PALM_AIR_K_W: f64 = 1.0;

/// Heat capacity of the palm, J/K. Chosen: 1 kg of aluminum, of the hand's 6.9 (manual 2). With 1 K/W the time constant is 15 min.
const PALM_J_K: f64 = 900.0;

/// Temperature of the air, °C, as the motors' (`PlantParams::ambient_c`).
const AMBIENT_C: f64 = 25.0;

/// Losses of the boards at rest, W. Chosen: 1 W of each motor board, as its thermistor has it (`rig`), and 3 W of GOD, so that a hand at
/// rest is at 35 °C, the lower end of normal use (manual 2).
const BOARDS_W: f64 = 10.0;

/// Interval of the equation, µs: a ten-thousandth of the time constant, in which seven stalls at full torque warm the palm by 0.19 K.
pub(crate) const INTERVAL_US: u64 = 100_000;

/// The palm. A hand begins at rest temperature, as its boards do.
#[derive(Clone, Debug)]
pub struct Palm {
    celsius: f64,
    copper_j: f64,
    at_us: u64,
    fixed_c: Option<f64>,
}

impl Default for Palm {
    fn default() -> Self {
        Self { celsius: AMBIENT_C + PALM_AIR_K_W * BOARDS_W, copper_j: 0.0, at_us: 0, fixed_c: None }
    }
}

impl Palm {
    /// Next time to call [`Self::advance`], µs.
    #[must_use]
    pub const fn next_us(&self) -> u64 {
        self.at_us + INTERVAL_US
    }

    /// Advances to a time, with the copper losses of all motors up to it. Returns the temperature, 0.1 °C.
    pub fn advance(&mut self, copper_j: f64, now_us: u64) -> i16 {
        let dt = now_us.saturating_sub(self.at_us) as f64 * 1e-6;
        let out_j = (self.celsius - AMBIENT_C) / PALM_AIR_K_W * dt;
        self.celsius += (BOARDS_W * dt + (copper_j - self.copper_j) - out_j) / PALM_J_K;
        (self.copper_j, self.at_us) = (copper_j, now_us);
        self.tenths()
    }

    /// Forces the reading, °C: a sensor's fault, or a day's heat at once. `None`: it follows the model.
    pub(crate) const fn fix(&mut self, celsius: Option<f64>) {
        self.fixed_c = celsius;
    }

    /// What GOD's sensor reads, 0.1 °C.
    #[must_use]
    pub fn tenths(&self) -> i16 {
        // A palm is far from the ends of the type.
        (self.fixed_c.unwrap_or(self.celsius) * 10.0).round() as i16
    }
}
