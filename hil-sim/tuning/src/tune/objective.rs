//! What a tuning run wants: scenarios of one motor, and how much each of their metrics costs.

use std::collections::BTreeMap;

use std::fmt;

use serde::Serialize;
use tater_wire::MotorKind;

use hil_experiment::metrics::{self, Metric, Metrics, Value, Window};
use hil_experiment::run::MotorRun;
use hil_experiment::scenario::{Case, Scenario};
use hil_world::plant::PlantParams;
use hil_world::rig::RigParams;
use traces::input::BadInput;

/// A kind of motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Objective {
    /// A move over the whole range at 200 counts/s.
    Move,
    /// A fast move of ten counts, and a load on the position that is then held.
    Step,
    /// RealTime's mode 4, fast, slow and backwards.
    Velocity,
    /// Torque-controlled closing on an object that gives way.
    Grasp,
}

impl Objective {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Move, Self::Step, Self::Velocity, Self::Grasp];

    /// Its name, as in `--objective`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Move => "move",
            Self::Step => "step",
            Self::Velocity => "velocity",
            Self::Grasp => "grasp",
        }
    }
}

impl fmt::Display for Objective {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// One summand of the cost: `weight · |metric − target| / scale`.
#[derive(Clone, Debug)]
pub struct Term {
    /// The kind of motion.
    pub objective: Objective,
    /// The metric.
    pub metric: &'static Metric,
    /// The part of the run.
    pub window: Window,
    /// Its best value.
    pub target: f64,
    /// The distance from it that costs 1: the figure wanted of 95 % of plants in docs/servo.md, or chosen.
    pub scale: f64,
    /// Share of the cost.
    pub weight: f64,
}

/// The keys of a table that have another value than in a second one, as in an inline table of TOML.
fn differing<T: Serialize>(of: &T, from: &T) -> String {
    // Both are structs of numbers, which TOML can hold.
    let table = |value: &T| toml::Table::try_from(value).unwrap_or_default();
    let from = table(from);
    let of = table(of);
    let keys = of.iter().filter(|(key, value)| from.get(*key) != Some(*value));
    keys.map(|(key, value)| format!("{key} = {value}")).collect::<Vec<String>>().join(", ")
}

/// Cost of a metric that a run does not have, such as the settling time of a rotor that does not settle.
const ABSENT: f64 = 10.0;

impl Term {
    /// Its value of a run: the distance from the target, in the metric's unit; none if the run has no such value.
    #[must_use]
    pub fn of(&self, run: &MotorRun) -> Option<f64> {
        match (self.metric.get)(run.within(self.window)) {
            Value::Number(value) => Some((value - self.target).abs()),
            _ => None,
        }
    }

    /// What a value costs before the weight.
    #[must_use]
    pub fn cost(&self, value: Option<f64>) -> f64 {
        value.map_or(ABSENT, |value| (value / self.scale).min(ABSENT))
    }
}

/// A scenario of one motor with the terms that it measures.
#[derive(Clone, Debug)]
pub struct Goal {
    /// The kind of motion.
    pub objective: Objective,
    /// Its text, a scenario file.
    pub text: String,
    /// The scenario, without scatter.
    pub scenario: Scenario,
    /// What is measured.
    pub terms: Vec<Term>,
}

impl Goal {
    /// The goal of a motor.
    ///
    /// # Errors
    /// None: the texts are valid, as a test shows.
    pub fn new(objective: Objective, motor: MotorKind) -> Result<Self, BadInput> {
        let text = text(objective, motor);
        let name = format!("{objective}-{}.toml", motor.name());
        let scenario = Scenario::parse(&name, &text)?;
        Ok(Self { objective, text, scenario, terms: terms(objective) })
    }

    /// The text with these values of properties set, and with the scenario's plant and sensors, so that it runs with them.
    #[must_use]
    pub fn text_with(&self, values: &[(&str, i64)]) -> String {
        let text = self.text_with_figures();
        let written = text.split_once("set = { ").and_then(|(before, after)| {
            let (own, after) = after.split_once(" }")?;
            Some((before, own, after))
        });
        // Each name once: TOML refuses a second.
        let values: BTreeMap<&str, String> =
            values.iter().map(|(name, value)| (*name, format!("{name} = {value}"))).collect();
        let is_new = |own: &&str| own.split(' ').next().is_none_or(|name| !values.contains_key(name));
        let own = written.map_or("", |(_, own, _)| own).split(", ").filter(|own| !own.is_empty());
        let set: Vec<&str> = own.filter(is_new).chain(values.values().map(String::as_str)).collect();
        let set = format!("set = {{ {} }}", set.join(", "));
        match written {
            Some((before, _, after)) => format!("{before}{set}{after}"),
            // Top-level keys come before the first table.
            None => text.replacen("\nduration_ms", &format!("\n{set}\nduration_ms"), 1),
        }
    }

    /// The text with the plant and the sensors as the scenario has them: `--plant`, `--rig` and `--supply` may have changed them.
    fn text_with_figures(&self) -> String {
        let Some(Case { motor, plant, .. }) = self.scenario.cases.first() else { return self.text.clone() };
        let plant = differing(plant, &PlantParams::for_motor(*motor));
        let rig = differing(&self.scenario.rig, &RigParams::default());
        let is_own = |line: &&str| !line.starts_with("plant = {");
        let mut text: String = self.text.split_inclusive('\n').filter(is_own).collect();
        for (name, keys) in [("plant", plant), ("rig", rig)] {
            if !keys.is_empty() {
                let line = format!("\n{name} = {{ {keys} }}\nduration_ms");
                text = text.replacen("\nduration_ms", &line, 1);
            }
        }
        text
    }

    /// Whether a run broke a limit: the first that it broke, in words.
    #[must_use]
    pub fn broken(&self, run: &MotorRun, trip_a: f64, mt: f64) -> Option<String> {
        let Metrics { faults, peak_torque, peak_current_a, peak_winding_c, .. } = &run.metrics;
        let end_reason = match self.objective {
            // The hold that follows is no move.
            Objective::Step => run.within(STEPPED).end_reason,
            _ => run.metrics.end_reason,
        };
        let ended = end_reason.map_or("none", metrics::end_word);
        let wanted = match self.objective {
            Objective::Move | Objective::Step => "arrived",
            // No move.
            Objective::Velocity => "none",
            // A link breaks away where it meets the object, the others stall there.
            Objective::Grasp if ended == "breakaway" => ended,
            Objective::Grasp => "stalled",
        };
        let touched = match self.objective {
            Objective::Grasp => CONTACT - 1.0,
            _ => f64::INFINITY,
        };
        if let Some(fault) = faults.first() {
            Some(format!("ERROR {}", metrics::fault_word(*fault)))
        } else if ended != wanted {
            Some(format!("ended {ended}, not {wanted}"))
        } else if *peak_torque > mt {
            Some(format!("torque {peak_torque} beyond MT {mt}"))
        } else if *peak_current_a > trip_a {
            Some(format!("phase current {peak_current_a:.1} A beyond {trip_a} A"))
        } else if *peak_winding_c > MAX_WINDING_C {
            Some(format!("winding at {peak_winding_c:.0} C, beyond {MAX_WINDING_C} C"))
        } else {
            let early = run.metrics.breakaway_counts.filter(|counts| *counts < touched);
            early.map(|counts| format!("broke away at {counts:.0} counts, before any contact"))
        }
    }
}

/// A short motion from room temperature stays far below the winding's 155 C (decision 0014).
const MAX_WINDING_C: f64 = 110.0;

/// Where the object of a grasp begins, counts.
const CONTACT: f64 = 100.0;

fn text(objective: Objective, motor: MotorKind) -> String {
    // Whole ranges of the manual, table 1, less a margin: the stops are moved away, so that they do not hide an overshoot.
    let travel = match motor {
        MotorKind::Link | MotorKind::Tip => 325,
        MotorKind::Spread => 160,
    };
    let name = motor.name();
    let head = |about: &str, duration_ms: u32| {
        format!(
            "name = \"{objective}-{name}\"\nabout = \"{about}\"\nmotor = \"{name}\"\nduration_ms = {duration_ms}\n"
        )
    };
    let free = "plant = { min_count = -100, max_count = 500 }\n";
    match objective {
        Objective::Move => format!(
            "{}{free}set = {{ MV = 200, MCV = 200, MOV = 200, ACCEL = 100 }}\n\n[[at]]\nms = 50\nmove = {travel}\n",
            head("The whole range at 200 counts/s.", 5 * travel + 700)
        ),
        Objective::Step => format!(
            "{}{free}set = {{ MV = 4080, MCV = 4080, MOV = 4080, ACCEL = 1000 }}\n\
             initial = {{ position_counts = 50 }}\n\n[[at]]\nms = 50\nmove = 60\n\n\
             [[at]]\nms = 500\nmode = \"pid\"\n\n[[at]]\nms = 550\ndisturbance_n_m = 0.2\n\n\
             [[expect]]\nmetric = \"settling_ms\"\nmax = 1000\nto_ms = 499\n\n\
             [[expect]]\nmetric = \"peak_hold_error_counts\"\nmax = 100\nfrom_ms = 550\n",
            head("A fast move of ten counts, and a load while the position is held.", 1000)
        ),
        Objective::Velocity => {
            let window = |from: u32, to: u32| {
                format!(
                    "\n[[expect]]\nmetric = \"ripple_counts_s\"\nmax = 1000\nfrom_ms = {from}\nto_ms = {to}\n"
                )
            };
            let at = |ms: u32, what: &str| format!("\n[[at]]\nms = {ms}\n{what}\n");
            format!(
                "{}{free}initial = {{ position_counts = 100 }}\n{}{}{}{}{}{}{}{}",
                head("RealTime at 100, 30 and -200 counts/s.", 1600),
                at(20, "mode = \"velocity\""),
                at(20, "velocity = 100"),
                at(520, "velocity = 30"),
                at(1020, "velocity = -200"),
                at(1550, "abort = true"),
                window(FAST.from_ms, FAST.to_ms),
                window(SLOW.from_ms, SLOW.to_ms),
                window(BACK.from_ms, BACK.to_ms),
            )
        }
        Objective::Grasp => format!(
            "{}set = {{ HOLD = 1 }}\ninitial = {{ position_counts = 40 }}\n\n\
             [[object]]\nfrom_count = {CONTACT:.0}\nside = \"closing\"\nstiffness_n_m_rad = 0.5\ndamping_n_m_s = 0.005\n\n\
             [[at]]\nms = 50\nmove = {travel}\n\n\
             [[expect]]\nmetric = \"chatter\"\nmax = 1000\nfrom_ms = 1500\n",
            head("A move that closes on an object which gives way, stalls and holds.", 2000)
        ),
    }
}

const FAST: Window = Window { from_ms: 220, to_ms: 519 };
const SLOW: Window = Window { from_ms: 720, to_ms: 1019 };
const BACK: Window = Window { from_ms: 1220, to_ms: 1519 };
const STEPPED: Window = Window { from_ms: 0, to_ms: 499 };
const LOADED: Window = Window { from_ms: 550, to_ms: u32::MAX };
const HELD: Window = Window { from_ms: 1500, to_ms: u32::MAX };

fn terms(objective: Objective) -> Vec<Term> {
    let term = |name: &str, window, target, scale, weight| {
        metrics::find(name).map(|metric| Term { objective, metric, window, target, scale, weight })
    };
    let of = |name: &str, scale, weight| term(name, Window::ALL, 0.0, scale, weight);
    let terms = match objective {
        Objective::Move => vec![
            of("tracking_rms_counts", 0.4, 2.0),
            of("overshoot_counts", 0.8, 1.0),
            of("final_error_counts", 0.5, 1.0),
            of("speed_at_end_counts_s", 20.0, 1.0),
            of("ripple_counts_s", 3.0, 2.0),
            of("chatter", 20.0, 1.0),
        ],
        Objective::Step => vec![
            term("settling_ms", STEPPED, 0.0, 60.0, 2.0),
            term("overshoot_counts", STEPPED, 0.0, 1.0, 1.0),
            term("peak_hold_error_counts", LOADED, 0.0, 4.0, 2.0),
            term("hold_error_counts", LOADED, 0.0, 0.5, 1.0),
            term("chatter", LOADED, 0.0, 20.0, 1.0),
        ],
        Objective::Velocity => vec![
            term("ripple_counts_s", FAST, 0.0, 3.0, 1.0),
            term("mean_velocity_counts_s", FAST, 100.0, 5.0, 1.0),
            term("ripple_counts_s", SLOW, 0.0, 3.0, 1.0),
            term("mean_velocity_counts_s", SLOW, 30.0, 1.5, 1.0),
            term("ripple_counts_s", BACK, 0.0, 3.0, 1.0),
            term("mean_velocity_counts_s", BACK, -200.0, 10.0, 1.0),
            of("chatter", 20.0, 1.0),
        ],
        Objective::Grasp => vec![
            of("end_after_last_count_ms", 400.0, 1.0),
            term("peak_hold_error_counts", HELD, 0.0, 2.0, 1.0),
            term("chatter", HELD, 0.0, 10.0, 1.0),
        ],
    };
    terms.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use hil_experiment::run::{Options, run};
    use hil_world::plant::Model;

    #[test]
    fn every_goal_of_every_motor_measures_all_of_its_terms() {
        let options = Options { seed: 1, model: Model::Averaged, trace: false };
        for motor in [MotorKind::Link, MotorKind::Spread, MotorKind::Tip] {
            for objective in Objective::ALL {
                let goal = Goal::new(objective, motor).unwrap_or_else(|bad| panic!("{bad}"));
                let outcome = run(&goal.scenario, &options).expect("valid");
                let run = &outcome.runs[0];
                assert_eq!(goal.broken(run, 100.0, 990.0), None, "{objective} of {motor:?}: {:?}", run.log);
                for term in &goal.terms {
                    assert!(term.of(run).is_some(), "{objective} of {motor:?}: {}", term.metric.name);
                }
            }
        }
    }
}
