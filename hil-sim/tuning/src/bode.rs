//! Measures a loop of the servo: a motor board in the simulator, excited over the bus alone.
//!
//! The loop is broken where the law's torque enters the motor. A law computes its torque from its set-point and from what it observes,
//!
//! ```text
//! mode 4:  u = uᵣ + (…)    uᵣ = KPV/16·v + F·sgn v
//! mode 3:  u = uᵣ + (…)    uᵣ = KP·xₛ + (KD/256 + K)·vₛ + aₛ/B + F·clamp(vₛ/2, ±1)
//! ```
//!
//! and all of (…) is feedback: KP, KD or KPV of the observed rotor, and the observed load. So S = u/uᵣ and L = (uᵣ − u)/u whatever the
//! feedforward is, and whatever the observer makes of the halls. The set-point of mode 3 follows P through the profile; it is read
//! back. K, B and F are MKE, MKA and MFC.
//!
//! The servo is not linear: halls of whole counts, friction, limits, a profile and gains of a resting set-point. What is measured is the
//! best linear approximation for this amplitude (`multisine.rs`).

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use tater_wire::{MotorKind, Property};

use super::multisine::{Estimate, Multisine, Record};
use hil_experiment::events::motor_text;
use hil_experiment::run::{Options, board, set};
use hil_experiment::scenario::{Case, Scenario};
use hil_world::node::{Node, Sample};
use hil_world::plant::Model;
use traces::input::BadInput;

pub mod page;

#[cfg(test)]
mod tests;

/// Ticks of a period, 2 s: lines are half a hertz apart, odd ones a hertz.
const PERIOD: usize = 2000;

/// The control tick, Hz.
const TICK_HZ: f64 = 1000.0;

/// Lines over the band: ten a decade and more.
const LINES: usize = 48;

/// Periods that are measured, after one in which the transient dies out.
const PERIODS: usize = 4;

/// Which loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loop {
    /// Mode 3; P is excited.
    Position,
    /// Mode 4; V is excited.
    Velocity,
}

/// What to measure.
#[derive(Clone, Copy, Debug)]
pub struct Setup {
    /// The loop.
    pub of: Loop,
    /// RMS of the excitation: counts of P or counts/s of V.
    pub amplitude: f64,
    /// Realizations, at least 2.
    pub realizations: u32,
    /// Seed of the excitation and of the sensors' noise.
    pub seed: u64,
}

/// What was measured.
#[derive(Clone, Debug)]
pub struct Measured {
    /// L at each line.
    pub open_loop: Vec<Estimate>,
    /// Share of the ticks in which a limit held, 0 to 1.
    pub limited: f64,
    /// Largest distance from the middle of the joint, counts.
    pub travel: f64,
    /// Whether the joint came within a count of its stops.
    pub stops: bool,
}

impl Loop {
    /// Default amplitude: RMS in counts or counts/s.
    #[must_use]
    pub const fn amplitude(self) -> f64 {
        match self {
            Self::Position => 3.0,
            Self::Velocity => 100.0,
        }
    }

    /// Its name, as in `--mode`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
        }
    }

    /// Band of the excitation, Hz.
    const fn band(self) -> (f64, f64) {
        match self {
            Self::Position => (1.0, 200.0),
            Self::Velocity => (1.0, 300.0),
        }
    }

    /// Relative RMS of a line: P moves less at high frequencies, where the profile cannot follow.
    fn weight(self, hz: f64) -> f64 {
        match self {
            Self::Position => 1.0 / (1.0 + (hz / 10.0).powi(2)),
            Self::Velocity => 1.0,
        }
    }
}

/// A motor in the middle of its joint, for `set` and `override_figures`.
///
/// # Errors
/// None for the three kinds.
pub fn scenario(motor: MotorKind) -> Result<Scenario, BadInput> {
    let motor = motor.name();
    let text = format!("name = 'bode'\nabout = 'A loop is measured.'\nmotor = '{motor}'\nduration_ms = 1\n");
    let scenario = Scenario::parse("bode", &text)?;
    Ok(Scenario { arguments: format!("bode --motor {motor}"), ..scenario })
}

/// Measures a loop of the scenario's motor.
///
/// # Errors
/// A plant out of range, or a motion that ended: at a stop, by a stall or a fault.
pub fn measure(scenario: &Scenario, setup: &Setup) -> Result<Measured, BadInput> {
    let excitation = Multisine::new(PERIOD, TICK_HZ, setup.of.band(), LINES);
    let mut records = Vec::new();
    let (mut limited, mut travel) = (0, 0.0_f64);
    for realization in 0..setup.realizations {
        let mut run = Run::new(scenario, setup, &excitation, realization)?;
        for _ in 0..=PERIODS {
            run.period(setup)?;
        }
        let spectra = |signal: &[f64]| -> Vec<_> {
            signal.chunks_exact(PERIOD).skip(1).map(|period| excitation.spectrum(period)).collect()
        };
        let (wanted, input) = (spectra(&run.reference), spectra(&run.torque));
        let pairs = wanted.iter().zip(&input);
        let output = pairs.map(|(r, u)| r.iter().zip(u).map(|(r, u)| r - u).collect()).collect();
        // The reference path of mode 3 is not linear, so uᵣ itself is the reference.
        let reference = excitation.spectrum(&mean_period(&run.reference[PERIOD..]));
        records.push(Record { reference, input, output });
        limited += run.limited;
        travel = travel.max(run.travel);
    }
    let ticks = f64::from(setup.realizations) * ((PERIODS + 1) * PERIOD) as f64;
    let plant = &scenario.cases[0].plant;
    Ok(Measured {
        open_loop: excitation.estimate(&records),
        limited: f64::from(limited) / ticks,
        travel,
        stops: travel > (plant.max_count - plant.min_count) / 2.0 - 1.0,
    })
}

fn mean_period(signal: &[f64]) -> Vec<f64> {
    let periods = (signal.len() / PERIOD) as f64;
    (0..PERIOD).map(|at| signal.iter().skip(at).step_by(PERIOD).sum::<f64>() / periods).collect()
}

struct Run {
    node: Node,
    case: Case,
    middle: i64,
    /// A period of whole P or V.
    excitation: Vec<f64>,
    /// uᵣ and u of each tick.
    reference: Vec<f64>,
    torque: Vec<f64>,
    limited: u32,
    travel: f64,
    last: Option<Sample>,
}

impl Run {
    fn new(
        scenario: &Scenario,
        setup: &Setup,
        excitation: &Multisine,
        realization: u32,
    ) -> Result<Self, BadInput> {
        let seed = setup.seed.wrapping_mul(1000).wrapping_add(u64::from(realization));
        let mut scenario = scenario.clone();
        let mut case = scenario.cases[0].clone();
        let middle = ((case.plant.min_count + case.plant.max_count) / 2.0).round();
        scenario.initial.position_counts = middle;
        // The motion goes on until it is told to end.
        case.config.tstop = 0;
        let options = Options { seed, model: Model::Averaged, trace: false };
        let mut node = board(&scenario, &case, &options).map_err(|e| {
            BadInput::new(scenario.arguments.clone(), format!("{} is out of range", e.field))
                .found(e.found.to_string())
                .expected(e.expected.clone())
                .next("choose other values")
        })?;
        let mode = match setup.of {
            Loop::Position => 3,
            Loop::Velocity => 4,
        };
        set(&mut node, Property::MODE, mode).map_err(|why| ended(&scenario.arguments, format!("{why:?}")))?;
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let weight = |hz| setup.of.weight(hz);
        let excitation = excitation.draw(setup.amplitude, weight, &mut rng);
        let excitation = excitation.into_iter().map(f64::round).collect();
        let (reference, torque) = (Vec::new(), Vec::new());
        let middle = middle as i64;
        Ok(Self { node, case, middle, excitation, reference, torque, limited: 0, travel: 0.0, last: None })
    }

    fn period(&mut self, setup: &Setup) -> Result<(), BadInput> {
        for at in 0..PERIOD {
            let x = self.excitation[at] as i64;
            let (property, value) = match setup.of {
                Loop::Position => (Property::P, self.middle + x),
                Loop::Velocity => (Property::V, x),
            };
            let place = "bode";
            set(&mut self.node, property, value).map_err(|why| ended(place, format!("{why:?}")))?;
            while let Some(answer) = self.node.mailboxes().first().copied() {
                self.node.sent(&answer);
            }
            self.node.step();
            if let Some(event) = self.node.event() {
                return Err(ended(place, motor_text(&event)));
            }
            let Some(sample) = self.node.sample() else {
                return Err(ended(place, "the board was reset".to_owned()));
            };
            self.reference.push(self.reference_torque(setup.of, &sample));
            self.torque.push(f64::from(sample.status.torque.0));
            self.limited += u32::from(sample.status.limit.is_some());
            self.travel = self.travel.max((sample.truth.counts - self.middle as f64).abs());
            self.last = Some(sample);
        }
        Ok(())
    }

    /// uᵣ of a tick; see the module's head.
    fn reference_torque(&self, of: Loop, sample: &Sample) -> f64 {
        let config = &self.case.config;
        let velocity: f64 = sample.status.setpoint_velocity.0.to_num();
        let friction = f64::from(config.motor.mfc);
        match of {
            Loop::Velocity if velocity == 0.0 || config.kpv == 0 => 0.0,
            Loop::Velocity => f64::from(config.kpv) / 16.0 * velocity + friction * velocity.signum(),
            Loop::Position => {
                let before: f64 = self.last.map_or(0.0, |last| last.status.setpoint_velocity.0.to_num());
                let position = sample.setpoint_counts() - self.middle as f64;
                let damping = f64::from(config.kd) / 256.0 + f64::from(config.motor.mke) / 4096.0;
                f64::from(config.kp) * position
                    + damping * velocity
                    + (velocity - before) * TICK_HZ / (f64::from(config.motor.mka) / 16.0)
                    + friction * (velocity / 2.0).clamp(-1.0, 1.0)
            }
        }
    }
}

fn ended(place: &str, found: String) -> BadInput {
    BadInput::new(place, "the motor stopped following the excitation")
        .found(found)
        .expected("a motion within the joint, without stalls and faults")
        .next("choose another --amplitude")
}
