//! How far gains are from instability: margins of the measured loops, and the factor by which all gains can rise.

use rayon::prelude::*;
use servo_core::Config;

use super::candidate::{Axis, Candidate, Settings, put};
use super::ensemble::Ensemble;
use crate::bode::{self, Loop, Setup};
use crate::response::{Point, Response};

/// Least factor by which all gains can rise before a plant of the ensemble breaks a limit or the cost doubles: the usual gain margin of 6 dB.
pub const LEAST_EDGE: f64 = 2.0;

/// Least phase margin, degrees, and largest Ms of a loop: the usual bounds of Åström and Murray, "Feedback Systems", 10.3 and 13.5.
pub const LEAST_PHASE_DEG: f64 = 30.0;
/// See [`LEAST_PHASE_DEG`].
pub const MOST_MS: f64 = 2.0;

/// Largest factor that is tried, and the steps to it.
const MOST_EDGE: f64 = 4.0;
const EDGE_STEP: f64 = 1.189_207_115_002_721; // a quarter of an octave

/// Steps down for the margins' sake: to half of the gains.
const MOST_STEPS: u32 = 4;

/// Plants on which loops are measured. Each takes two loops of 40 s.
const PLANTS: u64 = 20;
const REALIZATIONS: u32 = 4;

/// Plants of a glance during the search, and the cost of having no margin at all: more than any term.
const GLANCED: u64 = 2;
const PENALTY: f64 = 20.0;

/// Properties that multiply an error: what a stability margin is about.
const GAINS: [&str; 4] = ["KP", "KI", "KD", "KPV"];

/// The worst margins of a loop over plants.
#[derive(Clone, Debug)]
pub struct LoopMargins {
    /// The loop.
    pub of: Loop,
    /// Plants on which it was measured.
    pub plants: u64,
    /// The first plant on which it could not be, and why.
    pub unmeasured: Option<(u64, String)>,
    /// Least phase margin, degrees; none if no plant's loop crosses 0 dB in the band.
    pub phase_margin_deg: Option<f64>,
    /// Least gain margin; none if no plant's loop crosses -180 degrees in the band.
    pub gain_margin: Option<f64>,
    /// Largest Ms.
    pub ms: f64,
    /// The plant that has it.
    pub seed: u64,
    /// The open loop of that plant.
    pub response: Option<Response>,
}

impl LoopMargins {
    /// Whether they are large enough, on one plant at least.
    #[must_use]
    pub fn suffice(&self) -> bool {
        let far = |margin: Option<f64>, least: f64| margin.is_none_or(|margin| margin >= least);
        self.plants > 0
            && far(self.phase_margin_deg, LEAST_PHASE_DEG)
            && far(self.gain_margin, LEAST_EDGE)
            && self.ms <= MOST_MS
    }
}

/// Gains that are far enough from instability, and how far.
#[derive(Clone, Debug)]
pub struct Stable {
    /// The gains.
    pub candidate: Candidate,
    /// The factor at which a limit broke or the cost doubled; none below 4.
    pub edge: Option<f64>,
    /// The factor by which the gains were lowered, 1 if they were not.
    pub backed_off: f64,
    /// The loops of the candidate.
    pub margins: Vec<LoopMargins>,
}

/// The loops that the properties shape.
fn loops(axes: &[Axis]) -> Vec<Loop> {
    let has = |names: &[&str]| axes.iter().any(|axis| names.contains(&axis.property.name));
    let position = has(&["KP", "KI", "KD"]).then_some(Loop::Position);
    let velocity = has(&["KPV"]).then_some(Loop::Velocity);
    position.into_iter().chain(velocity).collect()
}

/// Measures the loops of a candidate on the ensemble's first plants.
#[must_use]
pub fn margins(settings: &Settings, values: &[i64]) -> Vec<LoopMargins> {
    measured(settings, values, PLANTS)
}

/// What too little of a margin costs a candidate: a look at a few plants, so that the search turns away before the result is refused.
#[must_use]
pub fn penalty(settings: &Settings, values: &[i64]) -> f64 {
    let lack = |margins: &LoopMargins| {
        let phase = margins.phase_margin_deg.map_or(0.0, |deg| 1.0 - deg / LEAST_PHASE_DEG);
        let gain = margins.gain_margin.map_or(0.0, |factor| 1.0 - factor / LEAST_EDGE);
        let ms = if margins.plants > 0 { margins.ms / MOST_MS - 1.0 } else { 1.0 };
        phase.max(0.0) + gain.max(0.0) + ms.max(0.0)
    };
    PENALTY * measured(settings, values, GLANCED).iter().map(lack).sum::<f64>()
}

fn measured(settings: &Settings, values: &[i64], plants: u64) -> Vec<LoopMargins> {
    let Settings { axes, ensemble, .. } = settings;
    let put = |config: &mut Config| put(axes, values, config);
    loops(axes).into_iter().map(|of| measure(ensemble, of, &put, plants)).collect()
}

fn measure(ensemble: &Ensemble, of: Loop, put: &(dyn Fn(&mut Config) + Sync), plants: u64) -> LoopMargins {
    let seeds: Vec<u64> =
        (0..ensemble.plants.min(plants)).map(|i| ensemble.first_seed.wrapping_add(i)).collect();
    let all: Vec<Result<Response, String>> =
        seeds.par_iter().map(|seed| measure_one(ensemble, of, *seed, put)).collect();
    let mut worst = LoopMargins {
        of,
        plants: 0,
        unmeasured: None,
        phase_margin_deg: None,
        gain_margin: None,
        ms: 0.0,
        seed: ensemble.first_seed,
        response: None,
    };
    let least = |a: Option<f64>, b: Option<f64>| match (a, b) {
        (Some(a), Some(b)) => Some(f64::min(a, b)),
        (a, b) => a.or(b),
    };
    for (seed, response) in seeds.into_iter().zip(all) {
        match response {
            Ok(response) => {
                let margins = response.margins();
                worst.plants += 1;
                worst.phase_margin_deg = least(worst.phase_margin_deg, margins.phase_margin_deg);
                worst.gain_margin = least(worst.gain_margin, margins.gain_margin);
                if margins.ms > worst.ms {
                    (worst.ms, worst.seed, worst.response) = (margins.ms, seed, Some(response));
                }
            }
            Err(why) => {
                worst.unmeasured.get_or_insert((seed, why));
            }
        }
    }
    worst
}

fn measure_one(
    ensemble: &Ensemble,
    of: Loop,
    seed: u64,
    put: &(dyn Fn(&mut Config) + Sync),
) -> Result<Response, String> {
    let mut scenario = ensemble.bench.clone();
    for case in &mut scenario.cases {
        put(&mut case.config);
        case.plant = ensemble.plant(&case.plant, seed);
    }
    let setup = Setup { of, amplitude: of.amplitude(), realizations: REALIZATIONS, seed };
    let measured = bode::measure(&scenario, &setup).map_err(|bad| bad.found)?;
    let points = measured.open_loop.iter().map(|line| Point { hz: line.hz, value: line.value }).collect();
    Response::new(points).map_err(|e| format!("{e:?}"))
}

/// Raises all gains until the ensemble breaks a limit or the cost doubles: the factor, none below 4. Adds its runs to `runs`.
#[must_use]
pub fn edge(settings: &Settings, best: &Candidate, runs: &mut u64) -> Option<f64> {
    let mut factor = EDGE_STEP;
    while factor <= MOST_EDGE * 1.001 {
        let raised = judge(settings, best, factor, runs).judged;
        if !raised.broken.is_empty() || raised.cost > 2.0 * best.judged.cost {
            return Some(factor);
        }
        factor *= EDGE_STEP;
    }
    None
}

/// Lowers all gains if their [`edge`] is nearer than [`LEAST_EDGE`], and further while a loop's margins do not suffice. Adds its runs to `runs`.
#[must_use]
pub(crate) fn back_off(settings: &Settings, best: &Candidate, runs: &mut u64) -> Stable {
    let edge = edge(settings, best, runs);
    let mut judge = |factor: f64| judge(settings, best, factor, runs);
    let mut backed_off = edge.map_or(1.0, |edge| f64::min(1.0, edge / LEAST_EDGE));
    let mut candidate = if backed_off < 1.0 { judge(backed_off) } else { best.clone() };
    let mut margins = self::margins(settings, &candidate.values);
    for _ in 0..MOST_STEPS {
        if margins.iter().all(LoopMargins::suffice) {
            break;
        }
        backed_off /= EDGE_STEP;
        candidate = judge(backed_off);
        margins = self::margins(settings, &candidate.values);
    }
    Stable { candidate, edge, backed_off, margins }
}

/// The candidate with all gains times `factor`.
fn judge(settings: &Settings, best: &Candidate, factor: f64, runs: &mut u64) -> Candidate {
    let values = scaled(&settings.axes, &best.values, factor);
    let judged = settings.ensemble.judge(&|config| put(&settings.axes, &values, config), f64::INFINITY);
    *runs += judged.runs;
    Candidate { values, judged }
}

fn scaled(axes: &[Axis], values: &[i64], factor: f64) -> Vec<i64> {
    axes.iter()
        .zip(values)
        .map(|(axis, value)| {
            let (min, max) = axis.property.range();
            let is_gain = GAINS.contains(&axis.property.name);
            let value = if is_gain { (*value as f64 * factor).round() as i64 } else { *value };
            value.clamp(min, max)
        })
        .collect()
}
