//! What TSTOP and BT trade: false alarms per hour against the delay of a real one.
//!
//! A false alarm is a move without an obstacle that ends as a stall (TSTOP) or a breakaway (BT). Each plant moves slowly, with 50 ms from count
//! to count, and as fast as it can. The delay is that from an object's first touch to the end of the move, at 100 counts/s.
//! BT makes no difference to it up to MT: the torque is at its limit before the rotor is slow enough.

use rayon::prelude::*;
use servo_core::{Config, EndReason, mode::Mode};
use tater_fw::codes::mode_code;
use tater_wire::MotorKind;

use super::ensemble::Ensemble;
use hil_experiment::properties::{self, Property};
use hil_experiment::run::{MotorRun, Options, run};
use hil_experiment::scenario::Scenario;
use hil_world::plant::Model;
use traces::input::BadInput;

/// Plants of a trade-off; a false alarm in 100 plants is about 15 in an hour of motion.
const PLANTS: u64 = 100;

/// A property that ends a motion, with the values that are tried, in its unit.
struct Guard {
    name: &'static str,
    values: &'static [i64],
    ends: EndReason,
}

const TSTOP: Guard = Guard {
    name: "TSTOP",
    values: &[10, 20, 30, 50, 75, 100, 150, 200, 300, 400, 600],
    ends: EndReason::Stalled,
};

const BT: Guard = Guard {
    name: "BT",
    values: &[50, 100, 150, 200, 250, 300, 350, 400, 450, 500, 600, 700],
    ends: EndReason::Breakaway,
};

/// A value of the property.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// The value, in the property's unit.
    pub value: i64,
    /// Moves without an obstacle that ended by it.
    pub alarms: u64,
    /// The plant of the first.
    pub seed: Option<u64>,
    /// Time of all moves without an obstacle, s.
    pub motion_s: f64,
    /// From an object's first touch to the end, ms: mean and longest over the plants.
    pub delay_ms: Option<(f64, f64)>,
    /// Moves against the object that ended otherwise.
    pub missed: u64,
}

impl Point {
    /// False alarms per hour of motion.
    #[must_use]
    pub fn per_hour(&self) -> f64 {
        self.alarms as f64 * 3600.0 / self.motion_s
    }

    /// The rate that 95 % of such trials would show an alarm of, if there was none: 3 in the whole time (the rule of three).
    #[must_use]
    pub fn resolution_per_hour(&self) -> f64 {
        3.0 * 3600.0 / self.motion_s
    }
}

/// What a property trades.
#[derive(Clone, Debug)]
pub struct TradeOff {
    /// The property.
    pub property: &'static Property,
    /// Its present value.
    pub now: i64,
    /// The values that were tried, ascending.
    pub points: Vec<Point>,
}

impl TradeOff {
    /// The second of the values from which on no false alarm was seen: the first may only have been lucky.
    #[must_use]
    pub fn suggested(&self) -> Option<i64> {
        let quiet = self.points.iter().rposition(|point| point.alarms > 0).map_or(0, |last| last + 1);
        self.points.get(quiet + 1).map(|point| point.value)
    }
}

/// The trade-offs of the motor's guards: TSTOP, and BT of a link.
#[must_use]
pub fn trade_offs(ensemble: &Ensemble, put: &(dyn Fn(&mut Config) + Sync)) -> Vec<TradeOff> {
    let guards = if ensemble.motor == MotorKind::Link { vec![TSTOP, BT] } else { vec![TSTOP] };
    // The scenarios are valid, as a test shows.
    let Ok(moves) = Moves::new(ensemble) else { return Vec::new() };
    let trade = |guard: &Guard| {
        let property = properties::find(guard.name)?;
        let mut config = ensemble.bench.cases.first()?.config;
        put(&mut config);
        let points = guard.values.iter().map(|value| {
            moves.point(ensemble, guard, *value, &|config| {
                put(config);
                // A link would break away before it stalls.
                if guard.ends == EndReason::Stalled {
                    config.bt = 0;
                }
                // The values are in the property's range.
                let _ = property.set(config, *value);
            })
        });
        Some(TradeOff { property, now: property.get(&config), points: points.collect() })
    };
    guards.iter().filter_map(trade).collect()
}

/// Where the object begins, counts.
const CONTACT: f64 = 100.0;

/// Moves without an obstacle, and one into an object.
struct Moves {
    free: Vec<Scenario>,
    into: Scenario,
}

impl Moves {
    fn new(ensemble: &Ensemble) -> Result<Self, BadInput> {
        let name = ensemble.motor.name();
        let head =
            |ms: u32| format!("name = 'alarms'\nabout = 'A move.'\nmotor = '{name}'\nduration_ms = {ms}\n");
        let bench = |text: String| -> Result<Scenario, BadInput> {
            let mut scenario = Scenario::parse("alarms", &text)?;
            scenario.rig = ensemble.bench.rig.clone();
            scenario.hall_scatter_deg = ensemble.bench.hall_scatter_deg;
            for (case, known) in scenario.cases.iter_mut().zip(&ensemble.bench.cases) {
                let (min, max) = (case.plant.min_count, case.plant.max_count);
                case.plant = known.plant.clone();
                (case.plant.min_count, case.plant.max_count) = (min, max);
                let Config { mv, accel, .. } = case.config;
                case.config = Config { mv, accel, ..known.config };
            }
            Ok(scenario)
        };
        let free = "plant = { min_count = -100, max_count = 500 }\n";
        let slow = "set = { MV = 20, ACCEL = 30 }\ninitial = { position_counts = 100 }\n\n[[at]]\nms = 50\nmove = 125\n";
        let fast = "set = { MV = 4080, ACCEL = 1000 }\n\n[[at]]\nms = 50\nmove = 300\n";
        let into = format!(
            "set = {{ MV = 100 }}\ninitial = {{ position_counts = 40 }}\n\n[[object]]\nfrom_count = {CONTACT}\nside = \"closing\"\nstiffness_n_m_rad = 0.5\n\
             damping_n_m_s = 0.005\n\n[[at]]\nms = 50\nmove = 300\n"
        );
        Ok(Self {
            free: vec![
                bench(format!("{}{free}{slow}", head(1700)))?,
                bench(format!("{}{free}{fast}", head(1000)))?,
            ],
            into: bench(format!("{}{into}", head(2000)))?,
        })
    }

    fn point(
        &self,
        ensemble: &Ensemble,
        guard: &Guard,
        value: i64,
        put: &(dyn Fn(&mut Config) + Sync),
    ) -> Point {
        let seeds: Vec<u64> =
            (0..ensemble.plants.min(PLANTS)).map(|i| ensemble.first_seed.wrapping_add(i)).collect();
        let one = |scenario: &Scenario, seed: u64, trace: bool| -> Option<MotorRun> {
            let mut scenario = scenario.clone();
            for case in &mut scenario.cases {
                put(&mut case.config);
                case.plant = ensemble.plant(&case.plant, seed);
            }
            let options = Options { seed, model: Model::Averaged, trace };
            run(&scenario, &options).ok()?.runs.into_iter().next()
        };
        let runs: Vec<(Vec<Option<MotorRun>>, Option<MotorRun>)> = seeds
            .par_iter()
            .map(|&seed| {
                (self.free.iter().map(|free| one(free, seed, false)).collect(), one(&self.into, seed, true))
            })
            .collect();
        let mut point = Point { value, alarms: 0, seed: None, motion_s: 0.0, delay_ms: None, missed: 0 };
        let mut delays = Vec::new();
        for (&seed, (free, into)) in seeds.iter().zip(&runs) {
            for run in free.iter().flatten() {
                point.motion_s += run.metrics.end_ms.map_or(run.metrics.sim_s, |ms| ms / 1000.0);
                if run.metrics.end_reason == Some(guard.ends) {
                    point.alarms += 1;
                    point.seed.get_or_insert(seed);
                }
            }
            match into.as_ref().filter(|run| run.metrics.end_reason == Some(guard.ends)).and_then(delay_ms) {
                Some(delay) => delays.push(delay),
                None => point.missed += 1,
            }
        }
        if !delays.is_empty() {
            let sum: f64 = delays.iter().sum();
            point.delay_ms = Some((sum / delays.len() as f64, delays.into_iter().fold(0.0, f64::max)));
        }
        point
    }
}

/// From the first touch to the end of the move, ms.
fn delay_ms(run: &MotorRun) -> Option<f64> {
    let trace = run.trace.as_ref()?;
    let (time, position, mode) =
        (trace.column("time_ms"), trace.column("position_counts"), trace.column("mode"));
    let touch = position.iter().position(|counts| *counts >= CONTACT)?;
    let moves = f64::from(mode_code(Mode::Trapezoidal).number());
    let end = (touch..mode.len()).find(|&at| mode[at] != moves)?;
    Some(time[end] - time[touch])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn suggestion_is_a_step_beyond_the_first_quiet_value() {
        let property = properties::find("BT").expect("known");
        let point = |value: i64, alarms: u64| Point {
            value,
            alarms,
            seed: None,
            motion_s: 3600.0,
            delay_ms: None,
            missed: 0,
        };
        let points = vec![point(100, 9), point(150, 0), point(200, 1), point(250, 0), point(300, 0)];
        let trade = TradeOff { property, now: 400, points };
        assert_eq!(trade.suggested(), Some(300));
        assert_eq!(trade.points[0].per_hour(), 9.0);
        let noisy = TradeOff { points: vec![point(100, 0), point(150, 1)], ..trade };
        assert_eq!(noisy.suggested(), None);
    }
}
