//! The shipped scenarios of the motor: a result that breaks one which the start passes is none. An ensemble has a few motions; these
//! are what users see.

use rayon::prelude::*;

use super::candidate::{Axis, Settings, put};
use hil_experiment::run::{Options, run};
use hil_experiment::scenario::{Scenario, Verdict};
use hil_world::plant::Model;

/// What each scenario costs that a candidate breaks and the start does not.
const BROKEN: f64 = 20.0;

/// Those of these scenarios that pass with the start.
#[must_use]
pub fn passed(mut scenarios: Vec<Scenario>, axes: &[Axis]) -> Vec<Scenario> {
    let start: Vec<i64> = axes.iter().map(|axis| axis.start).collect();
    scenarios.retain(|scenario| broken(scenario, axes, &start).is_none());
    scenarios
}

/// The scenarios that these values break: the first expectation of each, in words.
#[must_use]
pub fn lost(settings: &Settings, values: &[i64]) -> Vec<String> {
    settings.shipped.par_iter().filter_map(|scenario| broken(scenario, &settings.axes, values)).collect()
}

/// What they cost a candidate.
#[must_use]
pub fn penalty(settings: &Settings, values: &[i64]) -> f64 {
    BROKEN * lost(settings, values).len() as f64
}

fn broken(scenario: &Scenario, axes: &[Axis], values: &[i64]) -> Option<String> {
    let mut tried = scenario.clone();
    tried.cases.iter_mut().for_each(|case| put(axes, values, &mut case.config));
    let options = Options { seed: 1, model: Model::Averaged, trace: false };
    match run(&tried, &options) {
        Ok(outcome) => {
            let failed = outcome.expectations.into_iter().find(|verdict| !verdict.ok);
            let words =
                |of: Verdict| format!("{}: {} = {}, want {}", scenario.name, of.name, of.value, of.want);
            failed.map(words)
        }
        Err(error) => Some(format!("{}: {}", scenario.name, error.field)),
    }
}
