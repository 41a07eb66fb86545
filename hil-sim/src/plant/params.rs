//! What a motor and its joint are made of, with the reason for every number that the manual does not give.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use servo_core::MotorKind;

/// A plant or rig parameter outside its range.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamError {
    /// The field's name, as written in a scenario file.
    pub field: &'static str,
    /// The value found.
    pub found: f64,
    /// What is allowed, in words.
    pub expected: String,
}

impl std::fmt::Display for ParamError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { field, found, expected } = self;
        write!(f, "{field} is {found}, but it must be {expected}; correct it or leave it out for the default")
    }
}

impl std::error::Error for ParamError {}

/// One motor with its bridge, gear, joint and heat paths. All mechanical quantities are at the motor's shaft.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlantParams {
    /// Line-to-line winding resistance at 25 °C. 2.405 Ω: 24 V squared over 239.5 W (DESIGN 4.2).
    pub r_ohm: f64,
    /// Rise of the resistance per kelvin. 0.0039: copper.
    pub r_per_k: f64,
    /// Line-to-line inductance. Chosen 0.8 mH: an electrical time constant of 0.33 ms, usual for a slotted motor
    /// of this size, which keeps the 20 kHz ripple at or below 24 V · 12.5 µs / 0.8 mH = 0.38 A.
    pub l_mh: f64,
    /// Line-to-line EMF constant, and so torque constant. 0.0651 V·s/rad (DESIGN 4.2).
    pub ke_v_s: f64,
    /// Rotor and reflected joint inertia. Chosen 2e-5 kg·m²: a steel rotor of 30 mm diameter and 30 mm length is
    /// 1.9e-5; a finger link of 5e-4 kg·m² behind 49:1 adds 2e-7. ACCEL 60 then takes 0.024 N·m of the 0.48 of MT 750.
    pub j_kg_m2: f64,
    /// Coulomb friction. Chosen 0.03 N·m: DESIGN 4.2 bounds it by 0.04.
    pub coulomb_n_m: f64,
    /// Friction to be overcome from rest. Chosen 0.04 N·m: a third above Coulomb, as in greased gears.
    pub static_n_m: f64,
    /// Viscous friction. Chosen 1e-5 N·m·s/rad: 3.7 mN·m at no-load speed, under an eighth of Coulomb.
    pub viscous_n_m_s: f64,
    /// Supply voltage. 24 V.
    pub bus_v: f64,
    /// Forward voltage of a body diode. 0.8 V: silicon at some amperes.
    pub diode_v: f64,
    /// Dead time of the bridge. 1 µs, at most 5.
    pub dead_time_us: f64,
    /// Phase current at which the gate driver's break input trips; 25 A: above the 20 A of plugging at full speed.
    pub trip_a: f64,
    /// Motor turns per joint turn.
    pub gear_ratio: f64,
    /// Lead angle of the worm; 0 = no worm. 5° chosen: a single-start worm of 49:1 or 39:1.
    pub worm_lead_deg: f64,
    /// Friction coefficient of the worm's mesh. 0.09 chosen: just above tan 5° = 0.0875, so that the fingers
    /// cannot be driven backwards, as the manual has it, and yet a motor can leave a stop that it ran into.
    pub worm_friction: f64,
    /// Torque of the engaged brake; 0 = no brake. 2 N·m: three times the motor's peak.
    pub brake_n_m: f64,
    /// Time from the brake's command to its effect, either way. 20 ms: a small power-off brake.
    pub brake_delay_ms: f64,
    /// Sector (0..=5) in which count 0 lies: how the rotor was mounted to the joint.
    pub zero_sector: u8,
    /// Lowest whole count of the range; the stop stands half a count below.
    pub min_count: f64,
    /// Highest whole count of the range; the stop stands half a count above.
    pub max_count: f64,
    /// Stiffness of the stops. 20 N·m/rad: full torque dents them by a tenth of a count.
    pub stop_stiffness_n_m_rad: f64,
    /// Damping of the stops while being run into. 0.02 N·m·s/rad: half of critical, √(2e-5 · 20) = 0.02.
    pub stop_damping_n_m_s: f64,
    /// Heat capacity of the winding. 10 J/K: 26 g of copper; a full stall heats it by 24 K/s.
    pub winding_j_k: f64,
    /// Heat resistance winding to housing. 1.5 K/W: with 10 J/K a time constant of 15 s, usual at this size.
    pub winding_housing_k_w: f64,
    /// Heat capacity of the housing. 60 J/K: 130 g of steel.
    pub housing_j_k: f64,
    /// Heat resistance housing to ambient. 6 K/W: with 60 J/K six minutes; 7.5 W hold the 70 °C limit.
    pub housing_ambient_k_w: f64,
    /// Ambient temperature.
    pub ambient_c: f64,
}

impl PlantParams {
    /// The nominal plant of a kind of motor.
    #[must_use]
    pub fn for_motor(kind: MotorKind) -> Self {
        let (gear_ratio, worm, brake_n_m, min_count, max_count) = match kind {
            MotorKind::Link => (49.0, true, 0.0, -25.0, 338.0),
            MotorKind::Spread => (18.28, false, 2.0, 0.0, 166.0),
            MotorKind::Tip => (39.0, true, 0.0, -158.0, 350.0),
        };
        Self {
            r_ohm: 2.405,
            r_per_k: 0.0039,
            l_mh: 0.8,
            ke_v_s: 0.0651,
            j_kg_m2: 2e-5,
            coulomb_n_m: 0.03,
            static_n_m: 0.04,
            viscous_n_m_s: 1e-5,
            bus_v: 24.0,
            diode_v: 0.8,
            dead_time_us: 1.0,
            trip_a: 25.0,
            gear_ratio,
            worm_lead_deg: if worm { 5.0 } else { 0.0 },
            worm_friction: 0.09,
            brake_n_m,
            brake_delay_ms: 20.0,
            zero_sector: 0,
            min_count,
            max_count,
            stop_stiffness_n_m_rad: 20.0,
            stop_damping_n_m_s: 0.02,
            winding_j_k: 10.0,
            winding_housing_k_w: 1.5,
            housing_j_k: 60.0,
            housing_ambient_k_w: 6.0,
            ambient_c: 25.0,
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// The first field out of range (NaN is out of every range).
    pub fn validate(&self) -> Result<(), ParamError> {
        // The ranges keep the exact solutions well-conditioned and the steps short against every time constant.
        let rows: [(&'static str, f64, f64, f64); 28] = [
            ("r_ohm", self.r_ohm, 0.1, 100.0),
            ("r_per_k", self.r_per_k, 0.0, 0.01),
            ("l_mh", self.l_mh, 0.05, 20.0),
            ("ke_v_s", self.ke_v_s, 0.001, 1.0),
            ("j_kg_m2", self.j_kg_m2, 2e-6, 1e-2),
            ("coulomb_n_m", self.coulomb_n_m, 0.0, 10.0),
            ("static_n_m", self.static_n_m, self.coulomb_n_m, 10.0),
            ("viscous_n_m_s", self.viscous_n_m_s, 0.0, 1e-2),
            ("bus_v", self.bus_v, 0.0, 60.0),
            ("diode_v", self.diode_v, 0.0, 2.0),
            ("dead_time_us", self.dead_time_us, 0.0, 5.0),
            ("trip_a", self.trip_a, 0.1, 1000.0),
            ("gear_ratio", self.gear_ratio, 1.0, 1000.0),
            ("worm_lead_deg", self.worm_lead_deg, 0.0, 45.0),
            ("worm_friction", self.worm_friction, 0.0, 0.5),
            ("brake_n_m", self.brake_n_m, 0.0, 100.0),
            ("brake_delay_ms", self.brake_delay_ms, 0.0, 1000.0),
            ("zero_sector", f64::from(self.zero_sector), 0.0, 5.0),
            ("min_count", self.min_count, -1e6, 1e6),
            ("max_count", self.max_count, self.min_count, 1e6),
            ("stop_stiffness_n_m_rad", self.stop_stiffness_n_m_rad, 0.1, 1000.0),
            ("stop_damping_n_m_s", self.stop_damping_n_m_s, 0.0, 10.0),
            ("winding_j_k", self.winding_j_k, 0.1, 1e4),
            ("winding_housing_k_w", self.winding_housing_k_w, 0.01, 1e3),
            ("housing_j_k", self.housing_j_k, 0.1, 1e5),
            ("housing_ambient_k_w", self.housing_ambient_k_w, 0.01, 1e3),
            ("ambient_c", self.ambient_c, -60.0, 125.0),
            // A worm that friction does not lock would need its own efficiency going backwards.
            ("worm_friction", self.worm_friction, self.worm_lead_deg.to_radians().tan(), 0.5),
        ];
        check(&rows)
    }

    /// This plant with inertia, friction, EMF constant and resistance each scaled by a factor uniform in
    /// 1 ± `spread` (0..=0.9), and a supply uniform in 20..28 V, all drawn from `seed`.
    #[must_use]
    pub fn scattered(&self, seed: u64, spread: f64) -> Self {
        let mut rng = Pcg64Mcg::new(u128::from(seed) << 64 | 0x5eed);
        let mut factor = || 1.0 + spread * rng.random_range(-1.0..=1.0);
        let friction = factor();
        Self {
            j_kg_m2: self.j_kg_m2 * factor(),
            ke_v_s: self.ke_v_s * factor(),
            r_ohm: self.r_ohm * factor(),
            coulomb_n_m: self.coulomb_n_m * friction,
            static_n_m: self.static_n_m * friction,
            viscous_n_m_s: self.viscous_n_m_s * friction,
            bus_v: rng.random_range(20.0..=28.0),
            ..self.clone()
        }
    }
}

/// The first row (field, value, min, max) whose value is outside its range.
pub(crate) fn check(rows: &[(&'static str, f64, f64, f64)]) -> Result<(), ParamError> {
    for &(field, found, min, max) in rows {
        if !(found >= min && found <= max) {
            return Err(ParamError { field, found, expected: format!("{min} to {max}") });
        }
    }
    Ok(())
}
