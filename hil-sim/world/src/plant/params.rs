//! Parameters of a motor and its joint, with the reason for each number that the manual does not give.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};
use tater_wire::MotorKind;

/// Temperature at which `r_ohm` holds, °C.
const R_AT_C: f64 = 25.0;
/// Shortest time constant of the winding, s; 333 µs of the nominal motor. Below three PWM periods, 150 µs, the ripple is no triangle any more:
/// the averaged model then overstates it (`hil-sim run --model switched` does not).
const MIN_ELECTRICAL_S: f64 = 30e-6;
/// Fastest heating of the winding, by bus²/R, K/s; 24 of the nominal motor.
const MAX_STALL_K_S: f64 = 1000.0;
/// Highest no-load speed, counts/s: what a board drives (6,000), at a supply a sixth above its nominal voltage and an EMF 30 % low.
const MAX_NO_LOAD_COUNTS_S: f64 = 10_000.0;
/// Shortest time constant of the motor, s: steps of 10 µs; 11 ms of the nominal motor.
const MIN_MOTOR_S: f64 = 200e-6;
/// Shortest impact on a stop, J/damping and √(J/stiffness), s: steps of 10 µs; 1 ms of the nominal motor.
const MIN_IMPACT_S: f64 = 67e-6;
/// Highest resonance of inductance and inertia through the EMF, rad/s: steps of 12 µs.
const MAX_RESONANCE_RAD_S: f64 = 4000.0;

/// Radians of the shaft of the hand's motors per hall count. Of any motor: [`PlantParams::rad_per_count`].
pub const RAD_PER_COUNT: f64 = std::f64::consts::TAU / MotorKind::COUNTS_PER_TURN as f64;

/// Free play of a joint's gear, rad: 8′.
const PLAY_RAD: f64 = 8.0 / 60.0 * std::f64::consts::PI / 180.0;
/// Stiffness of a joint's gear, N·m/rad.
const JOINT_N_M_RAD: f64 = 10_000.0;

/// A plant or rig parameter outside its range.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamError {
    /// The field's name, as written in a scenario file.
    pub field: &'static str,
    /// The value found.
    pub found: f64,
    /// The allowed values, in words.
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
    /// Pole pairs. 3 (manual 1.3.3); a pair makes six counts a revolution.
    #[serde(default = "hands_pole_pairs")]
    pub pole_pairs: u8,
    /// Line-to-line winding resistance at 25 °C. 2.405 Ω: 24 V squared over 239.5 W (decision 0003).
    pub r_ohm: f64,
    /// Temperature coefficient of the resistance, 1/K. 0.0039: copper.
    pub r_per_k: f64,
    /// Line-to-line inductance. Chosen 0.8 mH: an electrical time constant of 0.33 ms, usual for a slotted
    /// motor of this size. It keeps the 20 kHz ripple at or below 24 V · 12.5 µs / 0.8 mH = 0.38 A.
    pub l_mh: f64,
    /// Line-to-line EMF constant, equal to the torque constant. 0.0651 V·s/rad (decision 0003).
    pub ke_v_s: f64,
    /// Rotor and reflected joint inertia. Chosen 2e-5 kg·m²: a steel rotor of 30 mm diameter and 30 mm length is
    /// 1.9e-5; a finger link of 5e-4 kg·m² behind 49:1 adds 2e-7. ACCEL 60 then takes 0.024 N·m of the 0.48 of MT 750.
    pub j_kg_m2: f64,
    /// Coulomb friction. Chosen 0.03 N·m: decision 0003 limits it to 0.04.
    pub coulomb_n_m: f64,
    /// Breakaway friction from rest. Chosen 0.04 N·m: a third above Coulomb, as in greased gears.
    pub static_n_m: f64,
    /// Speed at which the friction beyond Coulomb's has fallen to 1/e (Stribeck); 0: at once. Chosen 30 counts/s, 10 rad/s at the rotor:
    /// grease carries a gear's teeth from about there.
    #[serde(default)]
    pub stribeck_counts_s: f64,
    /// Amplitude of the cogging torque, once a count. Chosen 2 mN·m, 0.4 % of the torque at MT: a skewed stator.
    #[serde(default)]
    pub cogging_n_m: f64,
    /// Viscous friction. Chosen 1e-5 N·m·s/rad: 3.7 mN·m at no-load speed, under an eighth of Coulomb.
    pub viscous_n_m_s: f64,
    /// Supply voltage. 24 V.
    pub bus_v: f64,
    /// Forward voltage of a body diode. 0.8 V: silicon at a few amperes.
    pub diode_v: f64,
    /// Dead time of the bridge. 0.5 µs, as set in the board's timer (docs/board.md); at most 5.
    pub dead_time_us: f64,
    /// Phase current at which the gate driver's break input trips; 25 A: above the 20 A of plugging at full speed.
    pub trip_a: f64,
    /// Motor turns per joint turn.
    pub gear_ratio: f64,
    /// Free play of the gear, counts of the motor. Chosen 8′ of the joint, usual for a worm of standard quality: a third of a count of a link.
    #[serde(default)]
    pub backlash_counts: f64,
    /// Twist of the gear under torque, rad/(N·m) at the motor. Chosen 10,000 N·m/rad at the joint, a steel shaft of 14 mm over 30 mm: MT 750
    /// twists a link's gear by a third of a count.
    #[serde(default)]
    pub gear_rad_n_m: f64,
    /// Lead angle of the worm; 0 = no worm. 5° chosen: a single-start worm of 49:1 or 39:1.
    pub worm_lead_deg: f64,
    /// Friction coefficient of the worm's mesh. Chosen 0.09: just above tan 5° = 0.0875, so that the fingers
    /// cannot be driven backwards (manual 2), and yet a motor can leave a stop that it ran into.
    pub worm_friction: f64,
    /// Torque of the engaged brake; 0 = no brake. 2 N·m: three times the motor's peak.
    pub brake_n_m: f64,
    /// Time from the brake's command to its effect, either way. 20 ms: a small power-off brake.
    pub brake_delay_ms: f64,
    /// Sector (0..=5) of count 0: how the rotor is mounted on the joint.
    pub zero_sector: u8,
    /// Lowest whole count of the range; the stop is half a count below.
    pub min_count: f64,
    /// Highest whole count of the range; the stop is half a count above.
    pub max_count: f64,
    /// Stiffness of the stops. 20 N·m/rad: full torque compresses them by a tenth of a count.
    pub stop_stiffness_n_m_rad: f64,
    /// Damping of the stops during compression. 0.02 N·m·s/rad: half of critical, √(2e-5 · 20) = 0.02.
    pub stop_damping_n_m_s: f64,
    /// Heat capacity of the winding. 10 J/K: 26 g of copper; a full stall heats it by 24 K/s.
    pub winding_j_k: f64,
    /// Thermal resistance from winding to housing. 1.5 K/W: 15 s with 10 J/K, usual at this size.
    pub winding_housing_k_w: f64,
    /// Heat capacity of the housing. 60 J/K: 130 g of steel.
    pub housing_j_k: f64,
    /// Thermal resistance from housing to ambient. 6 K/W: 6 min with 60 J/K; 7.5 W hold the 70 °C limit.
    pub housing_ambient_k_w: f64,
    /// Ambient temperature.
    pub ambient_c: f64,
}

/// Those of the manual's motor.
const fn hands_pole_pairs() -> u8 {
    3
}

impl PlantParams {
    /// Radians of the shaft per hall count.
    #[must_use]
    pub fn rad_per_count(&self) -> f64 {
        std::f64::consts::TAU / (6.0 * f64::from(self.pole_pairs))
    }

    /// Resistance of two phases in series at a temperature of the winding, Ω.
    #[must_use]
    pub fn pair_ohm(&self, winding_c: f64) -> f64 {
        self.r_ohm * (1.0 + self.r_per_k * (winding_c - R_AT_C)).max(0.1)
    }

    /// The nominal plant of a kind of motor.
    #[must_use]
    pub fn for_motor(kind: MotorKind) -> Self {
        let (worm, brake_n_m) = match kind {
            MotorKind::Link | MotorKind::Tip => (true, 0.0),
            MotorKind::Spread => (false, 2.0),
        };
        let gear_ratio = kind.gear_hundredths() as f64 / 100.0;
        let [min_count, max_count] = kind.range_counts().map(f64::from);
        Self {
            pole_pairs: hands_pole_pairs(),
            r_ohm: 2.405,
            r_per_k: 0.0039,
            l_mh: 0.8,
            ke_v_s: 0.0651,
            j_kg_m2: 2e-5,
            coulomb_n_m: 0.03,
            static_n_m: 0.04,
            stribeck_counts_s: 30.0,
            cogging_n_m: 0.002,
            viscous_n_m_s: 1e-5,
            bus_v: 24.0,
            diode_v: 0.8,
            dead_time_us: 0.5,
            trip_a: 25.0,
            gear_ratio,
            backlash_counts: PLAY_RAD * gear_ratio / RAD_PER_COUNT,
            gear_rad_n_m: gear_ratio * gear_ratio / JOINT_N_M_RAD,
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

    /// The same without cogging, without friction that falls with speed, and with a rigid gear without play: what closed equations hold for.
    #[must_use]
    pub fn ideal(kind: MotorKind) -> Self {
        Self {
            stribeck_counts_s: 0.0,
            cogging_n_m: 0.0,
            backlash_counts: 0.0,
            gear_rad_n_m: 0.0,
            ..Self::for_motor(kind)
        }
    }

    /// Twist of the gear and a stop under torque, rad/(N·m) at the motor.
    #[must_use]
    pub fn stop_rad_n_m(&self) -> f64 {
        1.0 / self.stop_stiffness_n_m_rad + self.gear_rad_n_m
    }

    /// Checks every field, and the combinations that a step must be short against.
    ///
    /// # Errors
    /// The first field out of range (NaN is out of every range).
    pub fn validate(&self) -> Result<(), ParamError> {
        // The ranges keep the exact solutions well-conditioned. Heat: 0.1 J/K · 0.1 K/W are 10 ms against
        // steps of 1 ms.
        let rows: [(&'static str, f64, f64, f64); 33] = [
            ("pole_pairs", f64::from(self.pole_pairs), 1.0, 50.0),
            ("r_ohm", self.r_ohm, 0.1, 100.0),
            ("r_per_k", self.r_per_k, 0.0, 0.01),
            ("l_mh", self.l_mh, 0.005, 200.0),
            ("ke_v_s", self.ke_v_s, 0.001, 5.0),
            ("j_kg_m2", self.j_kg_m2, 1e-8, 0.1),
            ("coulomb_n_m", self.coulomb_n_m, 0.0, 10.0),
            ("static_n_m", self.static_n_m, self.coulomb_n_m, 10.0),
            ("stribeck_counts_s", self.stribeck_counts_s, 0.0, 1000.0),
            // The least inertia follows a tenth of it within steps of 10 us.
            ("cogging_n_m", self.cogging_n_m, 0.0, 0.2),
            ("viscous_n_m_s", self.viscous_n_m_s, 0.0, 1e-2),
            ("bus_v", self.bus_v, 1.0, 60.0),
            ("diode_v", self.diode_v, 0.0, 2.0),
            ("dead_time_us", self.dead_time_us, 0.0, 5.0),
            ("trip_a", self.trip_a, 0.1, 1000.0),
            ("gear_ratio", self.gear_ratio, 1.0, 1000.0),
            ("backlash_counts", self.backlash_counts, 0.0, 20.0),
            ("gear_rad_n_m", self.gear_rad_n_m, 0.0, 10.0),
            ("worm_lead_deg", self.worm_lead_deg, 0.0, 45.0),
            ("worm_friction", self.worm_friction, 0.0, 0.5),
            ("brake_n_m", self.brake_n_m, 0.0, 100.0),
            ("brake_delay_ms", self.brake_delay_ms, 0.0, 1000.0),
            ("zero_sector", f64::from(self.zero_sector), 0.0, 5.0),
            ("min_count", self.min_count, -1e6, 1e6),
            ("max_count", self.max_count, self.min_count, 1e6),
            ("stop_stiffness_n_m_rad", self.stop_stiffness_n_m_rad, 0.1, 1e5),
            ("stop_damping_n_m_s", self.stop_damping_n_m_s, 0.0, 100.0),
            ("winding_j_k", self.winding_j_k, 0.1, 1e4),
            ("winding_housing_k_w", self.winding_housing_k_w, 0.1, 1e3),
            ("housing_j_k", self.housing_j_k, 0.1, 1e5),
            ("housing_ambient_k_w", self.housing_ambient_k_w, 0.1, 1e3),
            ("ambient_c", self.ambient_c, -60.0, 125.0),
            // A worm that friction does not lock would need its own efficiency for backward driving.
            ("worm_friction", self.worm_friction, libm::tan(self.worm_lead_deg.to_radians()), 0.5),
        ];
        check(&rows)?;
        self.validate_together()
    }

    /// With these limits none of 20,000 random plants (hil-sim/world/tests/plant/accepted.rs says what varies; no objects)
    /// lost more than 0.5 % of its energy; without them, up to all of it.
    fn validate_together(&self) -> Result<(), ParamError> {
        let at_least = |field, found: f64, least: f64, why| {
            // Rounded up to three places, so that the value in the error message is accepted.
            let place = libm::exp10(2.0 - libm::log10(least).floor());
            let expected = format!("at least {} for the other values: {why}", (least * place).ceil() / place);
            if found >= least { Ok(()) } else { Err(ParamError { field, found, expected }) }
        };
        // In the averaged model the ripple is a triangle, and so are the floating leg's pulses.
        let l_mh = 1e3 * MIN_ELECTRICAL_S * self.r_ohm;
        at_least("l_mh", self.l_mh, l_mh, "L/R must be 30 µs or more")?;
        // The resistance follows the temperature once a millisecond.
        let winding_j_k = self.bus_v * self.bus_v / self.r_ohm / MAX_STALL_K_S;
        at_least(
            "winding_j_k",
            self.winding_j_k,
            winding_j_k,
            "a stall must heat the winding by 1 K/ms or less",
        )?;
        let ke = self.bus_v / (MAX_NO_LOAD_COUNTS_S * self.rad_per_count());
        at_least("ke_v_s", self.ke_v_s, ke, "the no-load speed, bus/Ke, must be 10,000 counts/s or less")?;
        let j = self.ke_v_s * self.ke_v_s / (1e-3 * self.l_mh * MAX_RESONANCE_RAD_S * MAX_RESONANCE_RAD_S);
        let damping = self.j_kg_m2 / MIN_IMPACT_S;
        check(&[
            ("stop_damping_n_m_s", self.stop_damping_n_m_s, 0.0, damping),
            ("stop_stiffness_n_m_rad", self.stop_stiffness_n_m_rad, 0.1, damping / MIN_IMPACT_S),
        ])?;
        let slow = MIN_MOTOR_S * self.ke_v_s * self.ke_v_s / self.r_ohm;
        at_least("j_kg_m2", self.j_kg_m2, slow, "the motor's time constant R·J/Ke² must be 200 µs or more")?;
        at_least("j_kg_m2", self.j_kg_m2, j, "the resonance Ke/√(L·J) must be 4000 rad/s or less")
    }

    /// Resonance of inductance and inertia through the EMF, rad/s; 515 of the nominal motor.
    fn resonance_rad_s(&self) -> f64 {
        self.ke_v_s / (1e-3 * self.l_mh * self.j_kg_m2).sqrt()
    }

    /// The longest step that couples winding and shaft well enough, µs, 10 to 100 in a valid plant. The EMF of a
    /// step is a prediction: its error grows with the resonance, with the step as a fraction of the motor's time
    /// constant and of an impact on a stop, and with the counts that the EMF's ramps move within the step.
    #[must_use]
    pub fn longest_step_us(&self) -> u64 {
        let resonance = 100.0 * libm::pow(1000.0 / self.resonance_rad_s(), 1.5);
        let motor = 0.05e6 * self.r_ohm * self.j_kg_m2 / (self.ke_v_s * self.ke_v_s);
        let ramps = 0.2e6 * self.ke_v_s * self.rad_per_count() / self.bus_v;
        let damper = 0.15e6 * self.j_kg_m2 / self.stop_damping_n_m_s;
        let spring = 0.15e6 * (self.j_kg_m2 / self.stop_stiffness_n_m_rad).sqrt();
        resonance.min(motor).min(ramps).min(damper).min(spring).clamp(1.0, 100.0) as u64
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

/// The first row (field, value, min, max) whose value is out of range.
pub(crate) fn check(rows: &[(&'static str, f64, f64, f64)]) -> Result<(), ParamError> {
    for &(field, found, min, max) in rows {
        if !(found >= min && found <= max) {
            return Err(ParamError { field, found, expected: format!("{min} to {max}") });
        }
    }
    Ok(())
}
