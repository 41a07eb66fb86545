//! What an ensemble does before and after tuning: bands over time.

use rayon::prelude::*;
use servo_core::Config;

use super::ensemble::Ensemble;
use super::objective::{Goal, Objective};
use hil_experiment::run::{Options, run};
use hil_experiment::trace::Trace;
use hil_world::plant::Model;

/// Points of a band: about half the pixels of a chart.
const POINTS: usize = 400;

/// Minimum, lower quartile, median, upper quartile and maximum over the plants, at each time.
pub type Bands = [Vec<f64>; 5];

/// A quantity over the time of a goal.
#[derive(Clone, Debug)]
pub struct Envelope {
    /// What the motor does.
    pub objective: Objective,
    /// The quantity.
    pub title: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Plants.
    pub plants: u64,
    /// Times, ms: each stands for the span until the next.
    pub times: Vec<f64>,
    /// With the values at the start.
    pub before: Bands,
    /// With the tuned values.
    pub after: Bands,
}

/// Changes the properties of a board.
pub type Put<'a> = &'a (dyn Fn(&mut Config) + Sync);

/// Runs the first `plants` of an ensemble twice, with the values of `before` and of `after`, on all threads of the present pool.
#[must_use]
pub fn envelopes(ensemble: &Ensemble, plants: u64, before: Put, after: Put) -> Vec<Envelope> {
    let plants = plants.min(ensemble.plants);
    let quantity = |goal: &Goal| {
        let (title, unit, of) = signal(goal.objective);
        let runs = |put: Put| -> Vec<Vec<f64>> {
            let seeds: Vec<u64> = (0..plants).map(|i| ensemble.first_seed.wrapping_add(i)).collect();
            seeds
                .par_iter()
                .filter_map(|seed| trace(ensemble, goal, *seed, put).map(|trace| of(&trace)))
                .collect()
        };
        let (before, after) = (runs(before), runs(after));
        let rows = before.iter().chain(&after).map(Vec::len).max().unwrap_or(0);
        let step = rows.div_ceil(POINTS).max(1);
        Envelope {
            objective: goal.objective,
            title,
            unit,
            plants,
            times: (0..rows).step_by(step).map(|ms| ms as f64).collect(),
            before: bands(&before, rows, step),
            after: bands(&after, rows, step),
        }
    };
    ensemble.goals.iter().map(quantity).collect()
}

type Signal = (&'static str, &'static str, fn(&Trace) -> Vec<f64>);

fn signal(objective: Objective) -> Signal {
    match objective {
        Objective::Move => ("Lag behind the set-point", "hall counts", lag),
        Objective::Step | Objective::Grasp => {
            ("Position", "hall counts", |trace| trace.column("position_counts"))
        }
        Objective::Velocity => ("Velocity", "hall counts / s", |trace| trace.column("velocity_counts_s")),
    }
}

/// Set-point less true position in modes 3 and 5; NaN in others.
fn lag(trace: &Trace) -> Vec<f64> {
    let [goal, zero, is, mode] =
        ["setpoint_counts", "zero_counts", "position_counts", "mode"].map(|name| trace.column(name));
    let rows = goal.iter().zip(&zero).zip(is.iter().zip(&mode));
    rows.map(|((goal, zero), (is, mode))| if [3.0, 5.0].contains(mode) { goal + zero - is } else { f64::NAN })
        .collect()
}

fn trace(ensemble: &Ensemble, goal: &Goal, seed: u64, put: Put) -> Option<Trace> {
    let mut scenario = goal.scenario.clone();
    for case in &mut scenario.cases {
        put(&mut case.config);
        case.plant = ensemble.plant(&case.plant, seed);
    }
    let options = Options { seed, model: Model::Averaged, trace: true };
    run(&scenario, &options).ok()?.runs.into_iter().next()?.trace
}

fn bands(runs: &[Vec<f64>], rows: usize, step: usize) -> Bands {
    let mut bands = Bands::default();
    for from in (0..rows).step_by(step) {
        let span = runs.iter().flat_map(|run| run.iter().skip(from).take(step));
        let mut values: Vec<f64> = span.copied().filter(|value| value.is_finite()).collect();
        values.sort_by(f64::total_cmp);
        for (band, share) in bands.iter_mut().zip([0.0, 0.25, 0.5, 0.75, 1.0]) {
            band.push(quantile(&values, share));
        }
    }
    bands
}

/// The value at a share of sorted values; NaN of none.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = share * sorted.len().saturating_sub(1) as f64;
    let low = at.floor() as usize;
    match (sorted.get(low), sorted.get(low + 1)) {
        (Some(a), Some(b)) => a + (b - a) * at.fract(),
        (Some(a), None) => *a,
        _ => f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_those_of_all_runs_in_a_span() {
        let runs = [vec![1.0, 3.0, f64::NAN], vec![2.0, 5.0, f64::NAN]];
        let [least, lower, median, upper, most] = bands(&runs, 3, 2);
        assert_eq!((least[0], lower[0], median[0], upper[0], most[0]), (1.0, 1.75, 2.5, 3.5, 5.0));
        assert!(median[1].is_nan(), "no value there");
    }
}
