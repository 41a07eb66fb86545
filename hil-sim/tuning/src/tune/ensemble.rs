//! One motor on many plants: what a set of properties costs there.

use rayon::prelude::*;
use servo_core::Config;
use tater_wire::{MotorKind, Property};

use super::objective::{Goal, Objective};
use hil_experiment::properties;
use hil_experiment::run::{MotorRun, Options, run};
use hil_experiment::scenario::Scenario;
use hil_world::plant::{Model, PlantParams};

/// Plants between two looks at a candidate that may be hopeless.
const HEAT: usize = 10;

/// Cost of a plant that breaks a limit; above every cost of plants that do not.
const BROKEN: f64 = 1000.0;

/// A term over the plants of an ensemble.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Mean over the plants that have it, in the metric's unit.
    pub mean: f64,
    /// The largest.
    pub worst: f64,
    /// The plant that has it.
    pub seed: u64,
    /// Mean and worst, in units of the term's scale.
    pub cost: [f64; 2],
}

/// A broken limit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Broken {
    /// The goal that was run.
    pub objective: Objective,
    /// The plant.
    pub seed: u64,
    /// The limit, in words.
    pub what: String,
}

/// What properties cost on the plants.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The cost; a lower bound if the ensemble was left early.
    pub cost: f64,
    /// Whether every plant was run.
    pub is_whole: bool,
    /// Each term of each goal, in order.
    pub terms: Vec<Spread>,
    /// The broken limits in order of plants.
    pub broken: Vec<Broken>,
    /// Runs.
    pub runs: u64,
}

/// Plants, and what the motor does on each.
#[derive(Clone, Debug)]
pub struct Ensemble {
    /// The kind of motor.
    pub motor: MotorKind,
    /// What it does.
    pub goals: Vec<Goal>,
    /// The motor free in the middle of its joint, for its loops, and its board.
    pub bench: Scenario,
    /// Relative scatter of inertia, friction, Ke and R; the supply is drawn from 20..28 V unless it is given.
    pub scatter: f64,
    /// The supply of every plant, V.
    pub supply_v: Option<f64>,
    /// The seed of the first plant; the others follow.
    pub first_seed: u64,
    /// Number of plants.
    pub plants: u64,
}

impl Ensemble {
    /// The plant of a seed.
    #[must_use]
    pub fn plant(&self, base: &PlantParams, seed: u64) -> PlantParams {
        let mut plant = if self.scatter > 0.0 { base.scattered(seed, self.scatter) } else { base.clone() };
        if let Some(v) = self.supply_v {
            plant.bus_v = v;
        }
        plant
    }

    /// Judges properties: `put` changes those of a board. Leaves the ensemble once its cost is known to be above `bound`; the plants run
    /// on all threads of the present pool, and the result does not depend on their number.
    #[must_use]
    pub fn judge(&self, put: &(dyn Fn(&mut Config) + Sync), bound: f64) -> Judged {
        let seeds: Vec<u64> = (0..self.plants).map(|i| self.first_seed.wrapping_add(i)).collect();
        let mut sums: Vec<Sum> = vec![Sum::default(); self.goals.iter().map(|goal| goal.terms.len()).sum()];
        let mut judged = Judged { cost: 0.0, is_whole: true, terms: Vec::new(), broken: Vec::new(), runs: 0 };
        let mut done = 0;
        for heat in seeds.chunks(HEAT) {
            let plants: Vec<Vec<Measured>> = heat.par_iter().map(|seed| self.measure(*seed, put)).collect();
            for (seed, goals) in heat.iter().zip(plants) {
                let mut place = 0;
                for (goal, measured) in self.goals.iter().zip(goals) {
                    judged.runs += 1;
                    if let Some(what) = measured.broken {
                        judged.broken.push(Broken { objective: goal.objective, seed: *seed, what });
                    }
                    for (term, value) in goal.terms.iter().zip(measured.values) {
                        sums[place].add(*seed, value, term.cost(value));
                        place += 1;
                    }
                }
            }
            done += heat.len();
            judged.cost = self.cost(&sums, seeds.len()) + BROKEN * judged.broken.len() as f64;
            if done < seeds.len() && judged.cost > bound {
                judged.is_whole = false;
                // As if the other plants were like these: hopeless candidates stay comparable.
                judged.cost = self.cost(&sums, done) + BROKEN * judged.broken.len() as f64;
                break;
            }
        }
        judged.terms = sums.iter().map(Sum::spread).collect();
        judged
    }

    fn cost(&self, sums: &[Sum], plants: usize) -> f64 {
        let terms = self.goals.iter().flat_map(|goal| &goal.terms);
        let (cost, weight) = terms.zip(sums).fold((0.0, 0.0), |(cost, weight), (term, sum)| {
            let mean = sum.cost / plants as f64;
            (cost + term.weight * (mean + sum.worst_cost) / 2.0, weight + term.weight)
        });
        cost / f64::max(weight, f64::MIN_POSITIVE)
    }

    /// Every goal on one plant.
    fn measure(&self, seed: u64, put: &(dyn Fn(&mut Config) + Sync)) -> Vec<Measured> {
        self.goals.iter().map(|goal| self.run(goal, seed, put)).collect()
    }

    fn run(&self, goal: &Goal, seed: u64, put: &(dyn Fn(&mut Config) + Sync)) -> Measured {
        let mut scenario = goal.scenario.clone();
        let (mut trip_a, mut mt) = (f64::INFINITY, f64::INFINITY);
        for case in &mut scenario.cases {
            put(&mut case.config);
            case.plant = self.plant(&case.plant, seed);
            trip_a = case.plant.trip_a;
            mt = properties::find(Property::MT.row().name).map_or(mt, |row| row.get(&case.config) as f64);
        }
        let options = Options { seed, model: Model::Averaged, trace: false };
        let run: Result<MotorRun, String> = match run(&scenario, &options) {
            Ok(mut outcome) if !outcome.runs.is_empty() => Ok(outcome.runs.swap_remove(0)),
            Ok(_) => Err("no motor".to_owned()),
            Err(e) => Err(format!("{} = {} is out of range, expected {}", e.field, e.found, e.expected)),
        };
        match run {
            Ok(run) => Measured {
                broken: goal.broken(&run, trip_a, mt),
                values: goal.terms.iter().map(|term| term.of(&run)).collect(),
            },
            Err(what) => Measured { broken: Some(what), values: vec![None; goal.terms.len()] },
        }
    }
}

/// One goal on one plant.
struct Measured {
    broken: Option<String>,
    values: Vec<Option<f64>>,
}

/// A term over the plants so far.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    plants: f64,
    value: f64,
    worst: f64,
    seed: u64,
    cost: f64,
    worst_cost: f64,
}

impl Sum {
    fn add(&mut self, seed: u64, value: Option<f64>, cost: f64) {
        self.cost += cost;
        if let Some(value) = value {
            self.plants += 1.0;
            self.value += value;
            self.worst = self.worst.max(value);
        }
        if cost > self.worst_cost {
            (self.worst_cost, self.seed) = (cost, seed);
        }
    }

    fn spread(&self) -> Spread {
        let plants = f64::max(self.plants, 1.0);
        Spread {
            mean: self.value / plants,
            worst: self.worst,
            seed: self.seed,
            cost: [self.cost / plants, self.worst_cost],
        }
    }
}
