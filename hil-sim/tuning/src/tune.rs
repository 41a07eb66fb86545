//! `tune`: properties that shape motion, by CMA-ES over an ensemble of plants.
//!
//! A candidate is a value of each property. Its cost is
//!
//! ```text
//! J = Σ w · (mean + worst) / 2 / Σ w
//! ```
//!
//! over the [`Term`]s of its goals; mean and worst are those of the ensemble, of |metric − target| / scale. A plant that breaks a
//! limit costs 1000, and loops with too little of a margin cost as well. The search is that of Hansen, "The CMA Evolution Strategy: A Tutorial" (arXiv:1604.00772), by the crate
//! `cmaes`. The same settings give the same result, with any number of threads.

mod alarms;
mod candidate;
mod ensemble;
mod envelope;
mod objective;
mod shipped;
mod stability;

pub use alarms::{Point, TradeOff};
pub use candidate::{Axis, Candidate, Settings, put};
pub use ensemble::{Broken, Ensemble, Judged, Spread};
pub use envelope::{Bands, Envelope, envelopes};
pub use objective::{Goal, Objective, Term};
pub use shipped::passed as shipped_passed;
pub use stability::{LEAST_EDGE, LEAST_PHASE_DEG, LoopMargins, MOST_MS};

use std::sync::Mutex;
use std::sync::PoisonError;

use cmaes::{CMAESOptions, DVector};
use rayon::ThreadPool;
use tater_wire::MotorKind;

use stability::Stable;

/// The best candidates are judged again on other plants, this many times as many, and the best there is the result: the first of many on
/// a small ensemble is partly luck.
const SELECTION: u64 = 4;
const SELECTED: usize = 6;

/// A candidate is hopeless while it is known to cost more than this multiple of the best.
const HOPELESS: f64 = 1.5;

/// How far the search is.
#[derive(Clone, Debug)]
pub struct Progress {
    /// Candidates that have been judged.
    pub candidates: usize,
    /// Simulated runs.
    pub runs: u64,
    /// The least cost so far.
    pub best: f64,
    /// Its values, in the order of the axes.
    pub values: Vec<i64>,
}

/// The result of a search.
#[derive(Clone, Debug)]
pub struct Found {
    /// The motor.
    pub motor: MotorKind,
    /// The values with which it began.
    pub start: Candidate,
    /// The best values, before any back-off.
    pub best: Candidate,
    /// The values to use: the best, or those backed off from the edge.
    pub tuned: Candidate,
    /// The factor of all gains at which a limit broke or the cost doubled; none below 4.
    pub edge: Option<f64>,
    /// The factor by which the gains were lowered, 1 if they were not.
    pub backed_off: f64,
    /// The loops at the start, on the ensemble's first plants.
    pub start_margins: Vec<LoopMargins>,
    /// Those with the values to use.
    pub margins: Vec<LoopMargins>,
    /// What TSTOP and BT trade with the values to use; empty unless a goal ends at an obstacle.
    pub trade_offs: Vec<TradeOff>,
    /// Shipped scenarios that the start passes and the values to use do not: the first expectation of each, in words.
    pub lost: Vec<String>,
    /// Candidates that were judged, hopeless ones included.
    pub candidates: usize,
    /// Simulated runs.
    pub runs: u64,
    /// Every candidate that ran on the whole ensemble and broke no limit.
    pub archive: Vec<Candidate>,
}

impl Found {
    /// Makes the start the result, unless it lacks a margin or breaks a limit on plants that the search has not seen. Returns whether
    /// it is.
    pub fn keep_start(&mut self, settings: &Settings, unseen: &Judged) -> bool {
        let keeps = unseen.broken.is_empty() && self.start_margins.iter().all(LoopMargins::suffice);
        if keeps && self.tuned.values != self.start.values {
            (self.tuned, self.margins) = (self.start.clone(), self.start_margins.clone());
            (self.edge, self.backed_off) = (stability::edge(settings, &self.start, &mut self.runs), 1.0);
            self.trade_offs = trade_offs(settings, &self.start.values);
            self.lost.clear();
        }
        keeps
    }
}

/// Searches on the threads of `pool` until the candidates are used up, the search has converged, or `go_on` says no; it is asked between generations.
///
/// # Errors
/// The start breaks a limit that no candidate meets: the first broken one of the best.
pub fn tune(
    settings: &Settings,
    pool: &ThreadPool,
    go_on: &mut dyn FnMut(&Progress) -> bool,
) -> Result<Found, Broken> {
    let Settings { axes, ensemble, .. } = settings;
    let values = |place: &DVector<f64>| -> Vec<i64> {
        axes.iter().zip(place.iter()).map(|(axis, at)| axis.value(*at)).collect()
    };
    let judge = |values: &[i64], bound: f64| ensemble.judge(&|config| put(axes, values, config), bound);
    let start_values: Vec<i64> = axes.iter().map(|axis| axis.start).collect();
    let mut judged = pool.install(|| judge(&start_values, f64::INFINITY));
    judged.cost += pool.install(|| penalty(settings, &start_values));
    let start = Candidate { judged, values: start_values };
    let seen = Mutex::new(Seen { runs: start.judged.runs, archive: vec![start.clone()], candidates: 1 });
    let mut best = start.clone();
    {
        // The bound changes between generations only, so that the order of threads does not matter.
        let bound = Mutex::new(HOPELESS * best.judged.cost);
        let cost = |place: &DVector<f64>| {
            let bound = *bound.lock().unwrap_or_else(PoisonError::into_inner);
            let values = values(place);
            let mut judged = judge(&values, bound);
            if judged.is_whole && judged.broken.is_empty() {
                judged.cost += penalty(settings, &values);
            }
            let cost = judged.cost;
            seen.lock().unwrap_or_else(PoisonError::into_inner).add(Candidate { values, judged });
            cost
        };
        let options = CMAESOptions::new(vec![0.0; axes.len()], 0.5).seed(settings.seed);
        // Only an invalid option is refused, of which there is none.
        if let Ok(mut search) = options.build(cost) {
            loop {
                let progress = {
                    let mut seen = seen.lock().unwrap_or_else(PoisonError::into_inner);
                    seen.sort();
                    best = seen.best().cloned().unwrap_or(best);
                    Progress {
                        candidates: seen.candidates,
                        runs: seen.runs,
                        best: best.judged.cost,
                        values: best.values.clone(),
                    }
                };
                *bound.lock().unwrap_or_else(PoisonError::into_inner) = HOPELESS * best.judged.cost;
                if progress.candidates >= settings.candidates || !go_on(&progress) {
                    break;
                }
                if pool.install(|| search.next_parallel()).is_some() {
                    break;
                }
            }
        }
    }
    let mut seen = seen.into_inner().unwrap_or_else(PoisonError::into_inner);
    seen.sort();
    best = seen.best().cloned().unwrap_or(best);
    if let Some(broken) = best.judged.broken.first() {
        return Err(broken.clone());
    }
    Ok(pool.install(|| finish(settings, start, best, seen)))
}

/// What the search has seen becomes a result: selection, back-off, margins and the guards' trade-offs.
fn finish(settings: &Settings, start: Candidate, best: Candidate, mut seen: Seen) -> Found {
    let best = select(settings, &start, best, &mut seen);
    let Stable { candidate: tuned, edge, backed_off, margins } =
        stability::back_off(settings, &best, &mut seen.runs);
    let start_margins = stability::margins(settings, &start.values);
    let trade_offs = trade_offs(settings, &tuned.values);
    let lost = shipped::lost(settings, &tuned.values);
    let Seen { runs, candidates, archive } = seen;
    let archive = archive.into_iter().filter(|candidate| candidate.judged.is_whole).collect();
    Found {
        motor: settings.ensemble.motor,
        start,
        best,
        tuned,
        edge,
        backed_off,
        start_margins,
        margins,
        trade_offs,
        lost,
        candidates,
        runs,
        archive,
    }
}

/// What a candidate costs beyond its ensemble.
fn penalty(settings: &Settings, values: &[i64]) -> f64 {
    stability::penalty(settings, values) + shipped::penalty(settings, values)
}

/// What TSTOP and BT trade with these values, if a goal ends at an obstacle.
fn trade_offs(settings: &Settings, values: &[i64]) -> Vec<TradeOff> {
    let Settings { axes, ensemble, .. } = settings;
    if ensemble.goals.iter().all(|goal| goal.objective != Objective::Grasp) {
        return Vec::new();
    }
    alarms::trade_offs(ensemble, &|config| put(axes, values, config))
}

/// The best of the best candidates and the start on plants that the search has not seen.
fn select(settings: &Settings, start: &Candidate, best: Candidate, seen: &mut Seen) -> Candidate {
    let ensemble = &settings.ensemble;
    let others = Ensemble {
        first_seed: ensemble.first_seed.wrapping_add(ensemble.plants),
        plants: ensemble.plants.saturating_mul(SELECTION),
        ..ensemble.clone()
    };
    let mut finalists: Vec<Candidate> = vec![start.clone()];
    for candidate in seen.archive.iter().filter(|candidate| candidate.judged.is_whole) {
        if finalists.len() <= SELECTED && finalists.iter().all(|other| other.values != candidate.values) {
            finalists.push(candidate.clone());
        }
    }
    let mut least = f64::INFINITY;
    let mut chosen = best;
    for candidate in finalists {
        let values = &candidate.values;
        let mut judged = others.judge(&|config| put(&settings.axes, values, config), least);
        seen.runs += judged.runs;
        judged.cost += if judged.is_whole { penalty(settings, values) } else { 0.0 };
        if judged.is_whole && judged.cost < least {
            (least, chosen) = (judged.cost, candidate);
        }
    }
    chosen
}

struct Seen {
    runs: u64,
    candidates: usize,
    archive: Vec<Candidate>,
}

impl Seen {
    fn add(&mut self, candidate: Candidate) {
        self.runs += candidate.judged.runs;
        self.candidates += 1;
        self.archive.push(candidate);
    }

    /// Threads finish in any order; the order of values is always the same.
    fn sort(&mut self) {
        self.archive
            .sort_by(|a, b| a.judged.cost.total_cmp(&b.judged.cost).then_with(|| a.values.cmp(&b.values)));
    }

    fn best(&self) -> Option<&Candidate> {
        self.archive.iter().find(|candidate| candidate.judged.is_whole)
    }
}

#[cfg(test)]
mod tests;
