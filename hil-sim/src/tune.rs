//! `hil-sim tune`: arguments, progress, validation and the result.

use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::{ValueEnum, value_parser};
use serde_json::{Value, json};
use tater_wire::MotorKind;

use super::figures::{Figures, MotorArg};
use super::output::{COMMIT, check_folder, print, quoted, write_folder};
use super::tune_report::{self, Drawn};
use hil_experiment::metrics;
use hil_experiment::motor_file::MotorFile;
use hil_experiment::properties::{self, Property};
use hil_experiment::scenario::{SHIPPED, Scenario};
use hil_tuning::bode;
use hil_tuning::tune::{
    self, Axis, Broken, Candidate, Ensemble, Envelope, Found, Goal, Judged, LEAST_EDGE, LEAST_PHASE_DEG,
    LoopMargins, MOST_MS, Objective, Progress, Settings, TradeOff,
};
use programs::interrupt;
use programs::output::warn;
use traces::input::{self, BadInput};

/// Threads that begin at once: far more than any machine has cores.
const MOST_JOBS: u64 = 256;

/// Seeds of plants: each seed of a search has its own, the validation's begin in the middle.
const SEEDS: u64 = 1 << 20;

/// Time of a search that says neither how long nor how many candidates.
const BUDGET: Duration = Duration::from_secs(60);

/// Real time since the program started.
type Clock<'a> = &'a dyn Fn() -> Duration;

/// The arguments of `hil-sim tune`.
#[derive(clap::Args)]
pub struct TuneArgs {
    /// The motor: link, spread, tip or all, or a file that describes another (docs/motor.md).
    #[arg(long, value_name = "MOTOR")]
    motor: Motors,
    /// What the gains are for.
    #[arg(long, value_enum)]
    objective: ObjectiveName,
    /// Plants on which each candidate runs: ±30 % in inertia, friction, Ke and R, 20 to 28 V, halls ±10 degrees.
    #[arg(long, default_value_t = 100, value_parser = value_parser!(u64).range(1..=SEEDS / 2))]
    robust: u64,
    /// Time of the search of each motor, such as 60s or 5m; it ends with a generation.
    #[arg(long, value_name = "TIME", value_parser = time, conflicts_with = "candidates")]
    budget: Option<Duration>,
    /// End with the generation in which this many candidates have been judged, instead of a time.
    #[arg(long, value_parser = value_parser!(u64).range(1..))]
    candidates: Option<u64>,
    /// Properties to tune, with commas. Default: KP, KI and KD; KPV for velocity; all four for all.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    properties: Vec<String>,
    /// Start from this value of a property, or keep it if it is not tuned; repeatable.
    #[arg(long, value_name = "PROPERTY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    figures: Figures,
    /// List the candidates of which no other is better in both metrics: two names with a comma.
    #[arg(long, value_name = "METRIC,METRIC", value_delimiter = ',')]
    pareto: Vec<String>,
    /// Plants of the validation, which the search has not seen.
    #[arg(long, default_value_t = 1000, value_parser = value_parser!(u64).range(1..=SEEDS / 2))]
    unseen: u64,
    /// Seed of the search and of its plants.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Threads; default: one for each core. The result does not depend on them.
    #[arg(long, value_parser = value_parser!(u64).range(1..=MOST_JOBS))]
    jobs: Option<u64>,
    /// Write tuned.json, report.html and the scenarios into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Debug)]
enum Motors {
    One(MotorArg),
    All,
}

impl std::str::FromStr for Motors {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text == "all" { Ok(Self::All) } else { text.parse().map(Self::One) }
    }
}

impl Motors {
    /// The kinds, and the file if there is one.
    fn read(&self) -> Result<(Vec<MotorKind>, Option<MotorFile>), BadInput> {
        match self {
            Self::One(motor) => motor.read().map(|(kind, file)| (vec![kind], file)),
            Self::All => Ok((vec![MotorKind::Link, MotorKind::Spread, MotorKind::Tip], None)),
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ObjectiveName {
    /// A move over the whole range at 200 counts/s.
    Move,
    /// A fast move of ten counts, and a load on the position that is then held.
    Step,
    /// RealTime's mode 4 at 100, 30 and -200 counts/s.
    Velocity,
    /// Closing on an object that gives way, and holding it.
    Grasp,
    /// All of these.
    All,
}

impl ObjectiveName {
    fn objectives(self) -> Vec<Objective> {
        match self {
            Self::Move => vec![Objective::Move],
            Self::Step => vec![Objective::Step],
            Self::Velocity => vec![Objective::Velocity],
            Self::Grasp => vec![Objective::Grasp],
            Self::All => Objective::ALL.to_vec(),
        }
    }

    fn properties(self) -> &'static [&'static str] {
        match self {
            Self::Move | Self::Step | Self::Grasp => &["KP", "KI", "KD"],
            Self::Velocity => &["KPV"],
            Self::All => &["KP", "KI", "KD", "KPV"],
        }
    }
}

fn time(text: &str) -> Result<Duration, String> {
    let (digits, unit) = match text.strip_suffix('m') {
        Some(digits) => (digits, 60.0),
        None => (text.strip_suffix('s').unwrap_or(text), 1.0),
    };
    let seconds = digits.trim().parse::<f64>().ok().map(|number| number * unit);
    match seconds {
        Some(seconds) if seconds > 0.0 && seconds <= 604_800.0 => Ok(Duration::from_secs_f64(seconds)),
        _ => Err("expected a time above 0 and up to a week, such as 60s or 5m".to_owned()),
    }
}

/// One motor's search and its validation.
struct Tuned {
    found: Found,
    axes: Vec<Axis>,
    goals: Vec<Goal>,
    /// Properties of `--set` that are not tuned.
    kept: Vec<(&'static str, i64)>,
    /// The unseen plants liked nothing better than the start.
    kept_start: bool,
    /// Start and result on unseen plants.
    unseen: [Judged; 2],
    plants: u64,
    first_unseen: u64,
    /// The command line that gives this result again.
    reproduce: String,
    /// Some of those plants over time; none without a report.
    envelopes: Vec<Envelope>,
}

impl Tuned {
    fn passed(&self) -> bool {
        self.unseen[1].broken.is_empty()
            && self.found.lost.is_empty()
            && self.found.tuned.judged.broken.is_empty()
            && self.found.margins.iter().all(LoopMargins::suffice)
    }

    fn improvement_percent(&self) -> f64 {
        let [start, tuned] = &self.unseen;
        100.0 * (1.0 - tuned.cost / start.cost)
    }
}

/// Runs `hil-sim tune`. Returns whether every result passed its validation.
///
/// # Errors
/// Bad arguments; no candidate that keeps the limits; files that cannot be written.
pub fn tune(args: &mut TuneArgs, clock: Clock) -> Result<bool, Box<dyn Error>> {
    interrupt::finish_first();
    let kinds;
    (kinds, args.figures.motor_file) = args.motor.read()?;
    let (args, pareto) = (&*args, pareto(args)?);
    args.out.as_deref().map_or(Ok(()), check_folder)?;
    let jobs = args.jobs.map_or(0, |jobs| jobs as usize);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).build().map_err(|e| {
        BadInput::new("--jobs", "the threads cannot be started")
            .found(e.to_string())
            .expected("fewer threads than the system allows")
            .next("give a smaller number")
    })?;
    let mut all = Vec::new();
    for kind in kinds {
        let (settings, first_unseen) = settings(args, kind)?;
        let kept = kept(args, &settings);
        let mut found = search(args, &settings, &pool, clock).map_err(|broken| hopeless(kind, &broken))?;
        let unseen = Ensemble { first_seed: first_unseen, plants: args.unseen, ..settings.ensemble.clone() };
        let on_unseen = |candidate: &Candidate| {
            pool.install(|| {
                unseen.judge(&|config| tune::put(&settings.axes, &candidate.values, config), f64::INFINITY)
            })
        };
        let start = on_unseen(&found.start);
        let result =
            if found.tuned.values == found.start.values { start.clone() } else { on_unseen(&found.tuned) };
        let kept_start = result.cost >= start.cost && pool.install(|| found.keep_start(&settings, &start));
        let result = if kept_start { start.clone() } else { result };
        let envelopes = args.out.as_ref().map_or_else(Vec::new, |_| {
            let [before, after] = [&found.start, &found.tuned]
                .map(|candidate| |config: &mut _| tune::put(&settings.axes, &candidate.values, config));
            pool.install(|| tune::envelopes(&unseen, tune_report::PLANTS, &before, &after))
        });
        let Settings { axes, ensemble, .. } = settings;
        let reproduce = reproduce(args, kind, found.candidates);
        all.push(Tuned {
            found,
            axes,
            goals: ensemble.goals,
            kept_start,
            unseen: [start, result],
            plants: args.unseen,
            first_unseen,
            reproduce,
            kept,
            envelopes,
        });
    }
    let reproduce = all.iter().map(|tuned| tuned.reproduce.as_str()).collect::<Vec<_>>().join(" && ");
    let passed = all.iter().all(Tuned::passed);
    let motors: Vec<Value> = all.iter().map(|tuned| motor_json(tuned, &pareto)).collect();
    let mut object = json!({ "motors": motors, "passed": passed, "reproduce": reproduce, "commit": COMMIT });
    if interrupt::interrupted() {
        object["interrupted"] = json!(true);
    }
    // Printed first: a folder that fills up meanwhile loses nothing.
    if args.json {
        print(&format!("{object}\n"))?;
    } else {
        print(&text(&all, &reproduce))?;
    }
    if let Some(dir) = &args.out {
        write(dir, &object, &all)?;
    }
    for tuned in &all {
        refusals(tuned);
    }
    Ok(passed)
}

fn pareto(args: &TuneArgs) -> Result<Vec<String>, BadInput> {
    let known: Vec<&str> = metrics::METRICS.iter().map(|metric| metric.name).collect();
    for name in &args.pareto {
        if !known.contains(&name.as_str()) {
            return Err(BadInput::new(
                format!("--pareto {}", input::shorten(name)),
                "no metric has this name",
            )
            .found(input::shorten(name))
            .expected(known.join(", "))
            .next(
                input::did_you_mean(name, known.iter().copied())
                    .unwrap_or_else(|| "use two of those".to_owned()),
            ));
        }
    }
    let [.., last] = args.pareto.as_slice() else { return Ok(Vec::new()) };
    if args.pareto.len() != 2 || args.pareto.first() == Some(last) {
        return Err(BadInput::new("--pareto", "a front has two metrics")
            .found(args.pareto.join(","))
            .expected("two different names with a comma")
            .next("give for example --pareto tracking_rms_counts,chatter"));
    }
    Ok(args.pareto.clone())
}

/// The search of a motor, and the first seed of its validation.
fn settings(args: &TuneArgs, kind: MotorKind) -> Result<(Settings, u64), BadInput> {
    let mut goals = Vec::new();
    for objective in args.objective.objectives() {
        let mut goal = Goal::new(objective, kind)?;
        let scenario = &mut goal.scenario;
        args.figures.take_motor(scenario)?;
        for assignment in &args.set {
            scenario.set(assignment)?;
        }
        args.figures.apply(scenario)?;
        scenario.hall_scatter_deg = HALLS_DEG;
        goals.push(goal);
    }
    let mut bench = bode::scenario(kind)?;
    args.figures.take_motor(&mut bench)?;
    for assignment in &args.set {
        bench.set(assignment)?;
    }
    args.figures.apply(&mut bench)?;
    bench.hall_scatter_deg = HALLS_DEG;
    let supply_v = args.figures.supply.first().map(|_| bench.cases[0].plant.bus_v);
    let config = bench.cases[0].config;
    let names: Vec<&str> = if args.properties.is_empty() {
        args.objective.properties().to_vec()
    } else {
        args.properties.iter().map(String::as_str).collect()
    };
    let mut axes: Vec<Axis> = Vec::new();
    for name in names {
        let property = properties::find(name.trim()).ok_or_else(|| unknown(name))?;
        if axes.iter().all(|axis| axis.property.name != property.name) {
            axes.push(Axis { property, start: property.get(&config), knee: knee(property) });
        }
    }
    let first_seed = args.seed.wrapping_mul(SEEDS);
    let ensemble =
        Ensemble { motor: kind, goals, bench, scatter: SCATTER, supply_v, first_seed, plants: args.robust };
    let first_unseen = first_seed.wrapping_add(SEEDS / 2);
    drawable(&ensemble, (first_seed, args.robust))?;
    drawable(&ensemble, (first_unseen, args.unseen))?;
    let candidates = args.candidates.map_or(usize::MAX, |most| most as usize);
    let shipped = tune::shipped_passed(shipped(args, kind)?, &axes);
    Ok((Settings { axes, ensemble, shipped, seed: args.seed, candidates }, first_unseen))
}

/// Whether the simulator takes so many plants from a seed on: ±30 % may be beyond what it computes.
fn drawable(ensemble: &Ensemble, (first, plants): (u64, u64)) -> Result<(), BadInput> {
    let base = &ensemble.bench.cases[0].plant;
    let wrong = (0..plants)
        .map(|i| first.wrapping_add(i))
        .find_map(|seed| ensemble.plant(base, seed).validate().err().map(|error| (seed, error)));
    let Some((seed, error)) = wrong else { return Ok(()) };
    Err(BadInput::new(format!("the {}, plant {seed}", ensemble.motor.name()), format!("{} is out of range", error.field)).found(error.found.to_string()).expected(error.expected).next("give other --plant or --supply figures: the plants are ±30 % about them, at 20 to 28 V unless --supply is given"))
}

/// The shipped scenarios of the motor alone, for gains that are to suit everything.
fn shipped(args: &TuneArgs, kind: MotorKind) -> Result<Vec<Scenario>, BadInput> {
    let mut all = Vec::new();
    for shipped in SHIPPED.iter().filter(|_| args.objective == ObjectiveName::All) {
        let mut scenario = Scenario::find(shipped.name)?;
        let is_of = matches!(scenario.cases.as_slice(), [case] if case.motor == kind);
        // Figures that do not fit one, such as a stiction below its friction, leave it out.
        let fits = |scenario: &mut Scenario| {
            args.figures.take_motor(scenario)?;
            args.set.iter().try_for_each(|assignment| scenario.set(assignment))?;
            args.figures.apply(scenario)
        };
        match fits(&mut scenario) {
            _ if !is_of => {}
            Ok(()) => all.push(scenario),
            Err(bad) => warn(&format!(
                "note: {} is left out, as it does not fit: {}: {}",
                shipped.name, bad.place, bad.problem
            )),
        }
    }
    Ok(all)
}

/// Properties of `--set` that are not tuned: the tuned values rest on them.
fn kept(args: &TuneArgs, settings: &Settings) -> Vec<(&'static str, i64)> {
    let config = settings.ensemble.goals.first().map(|goal| goal.scenario.cases[0].config);
    let names = args.set.iter().filter_map(|assignment| assignment.split_once('='));
    let given = names.filter_map(|(name, _)| properties::find(name.trim()));
    let is_kept = |property: &&Property| settings.axes.iter().all(|axis| axis.property.name != property.name);
    let value = |property: &Property| config.map(|config| (property.name, property.get(&config)));
    given.filter(is_kept).filter_map(value).collect()
}

/// The ensemble of docs/servo.md.
const SCATTER: f64 = 0.3;
const HALLS_DEG: f64 = 10.0;

/// Below this value a property is searched by differences: what makes a small but visible change.
fn knee(property: &Property) -> f64 {
    match property.name {
        "KP" => 20.0,
        "KI" => 200.0,
        "KD" => 100.0,
        "KPV" => 4.0,
        _ => f64::max(1.0, property.range().1 as f64 / 64.0),
    }
}

fn unknown(name: &str) -> BadInput {
    let known = properties::PROPERTIES.map(|property| property.name);
    BadInput::new(format!("--properties {}", input::shorten(name)), "no property has this name")
        .found(input::shorten(name))
        .expected(format!("one of {}", properties::names()))
        .next(input::did_you_mean(name, known.into_iter()).unwrap_or_else(|| "use one of those".to_owned()))
}

/// The start breaks a limit, and so does every candidate.
fn hopeless(kind: MotorKind, broken: &Broken) -> BadInput {
    BadInput::new(format!("--motor {}", kind.name()), "no candidate keeps the limits on all plants").found(format!("{} on plant {}: {}", broken.objective, broken.seed, broken.what)).expected("gains without a broken limit").next("give more time with --budget, describe the motor with --set MKA, MKE, MFC and MFS, or lower what it must do")
}

fn search(
    args: &TuneArgs,
    settings: &Settings,
    pool: &rayon::ThreadPool,
    clock: Clock,
) -> Result<Found, Broken> {
    let begun = clock();
    let budget = match (args.budget, args.candidates) {
        (Some(budget), _) => Some(budget),
        (None, None) => Some(BUDGET),
        (None, Some(_)) => None,
    };
    let bar = indicatif::ProgressBar::new_spinner();
    let found = tune::tune(settings, pool, &mut |progress: &Progress| {
        let spent = clock() - begun;
        let left = match (budget, args.candidates) {
            (Some(budget), _) => budget.saturating_sub(spent).as_secs_f64(),
            (None, most) => {
                let most = most.unwrap_or_default() as f64;
                let done = progress.candidates as f64;
                spent.as_secs_f64() * (most - done).max(0.0) / done
            }
        };
        let values: Vec<String> = settings
            .axes
            .iter()
            .zip(&progress.values)
            .map(|(axis, value)| format!("{}={value}", axis.property.name))
            .collect();
        bar.set_message(format!(
            "{} candidates, {} runs; best {:.3} with {}; {left:.0} s left",
            progress.candidates,
            progress.runs,
            progress.best,
            values.join(" ")
        ));
        bar.tick();
        !interrupt::interrupted() && budget.is_none_or(|budget| spent < budget)
    });
    bar.finish_and_clear();
    found
}

/// The command line that gives this result again.
fn reproduce(args: &TuneArgs, kind: MotorKind, candidates: usize) -> String {
    let objective = args.objective.to_possible_value();
    let mut line = format!(
        "hil-sim tune{} --objective {} --robust {} --candidates {candidates} --unseen {} --seed {}",
        if args.figures.motor_file.is_some() { String::new() } else { format!(" --motor {}", kind.name()) },
        objective.as_ref().map_or("", |value| value.get_name()),
        args.robust,
        args.unseen,
        args.seed
    );
    if !args.properties.is_empty() {
        let names: Vec<&str> = args.properties.iter().map(|name| name.trim()).collect();
        line.push_str(&format!(" --properties {}", names.join(",")));
    }
    for assignment in &args.set {
        line.push_str(&format!(" --set {}", quoted(assignment)));
    }
    if !args.pareto.is_empty() {
        line.push_str(&format!(" --pareto {}", args.pareto.join(",")));
    }
    line.push_str(&args.figures.arguments());
    line
}

fn values_json(axes: &[Axis], values: &[i64]) -> Value {
    axes.iter().zip(values).map(|(axis, value)| (axis.property.name.to_owned(), json!(value))).collect()
}

fn motor_json(tuned: &Tuned, pareto: &[String]) -> Value {
    let Tuned { found, axes, goals, kept, unseen: [start, result], plants, first_unseen, reproduce, .. } =
        tuned;
    let terms: Vec<Value> = goals
        .iter()
        .flat_map(|goal| &goal.terms)
        .zip(start.terms.iter().zip(&result.terms))
        .map(|(term, (start, result))| {
            let of = |spread: &tune::Spread| json!({ "mean": spread.mean, "worst": spread.worst, "worst_seed": spread.seed });
            json!({
                "objective": term.objective.name(),
                "metric": term.metric.name,
                "from_ms": term.window.from_ms,
                "target": term.target,
                "scale": term.scale,
                "weight": term.weight,
                "start": of(start),
                "tuned": of(result),
            })
        })
        .collect();
    let broken: Vec<Value> = result
        .broken
        .iter()
        .map(|broken| json!({ "objective": broken.objective.name(), "seed": broken.seed, "what": broken.what }))
        .collect();
    let mut object = json!({
        "motor": found.motor.name(),
        "passed": tuned.passed(),
        "properties": values_json(axes, &found.tuned.values),
        "start": values_json(axes, &found.start.values),
        "set": kept.iter().map(|(name, value)| ((*name).to_owned(), json!(value))).collect::<Value>(),
        "best_before_back_off": values_json(axes, &found.best.values),
        "cost": { "start": found.start.judged.cost, "tuned": found.tuned.judged.cost },
        "candidates": found.candidates,
        "runs": found.runs,
        "kept_start": tuned.kept_start,
        "reproduce": reproduce,
        "stability": { "edge_factor": found.edge, "least_edge_factor": LEAST_EDGE, "backed_off_by": found.backed_off,
            "least_phase_margin_deg": LEAST_PHASE_DEG, "most_ms": MOST_MS,
            "start": margins_json(&found.start_margins), "tuned": margins_json(&found.margins) },
        "trade_offs": trade_offs_json(&found.trade_offs),
        "validation": {
            "plants": plants,
            "first_seed": first_unseen,
            "cost_start": start.cost,
            "cost_tuned": result.cost,
            "improvement_percent": tuned.improvement_percent(),
            "start_broken": start.broken.len(),
            "broken": broken,
            "lost_scenarios": found.lost,
        },
        "terms": terms,
    });
    if let [a, b] = pareto {
        object["pareto"] = front(tuned, a, b);
    }
    object
}

fn margins_json(margins: &[LoopMargins]) -> Value {
    margins
        .iter()
        .map(|margins| {
            let LoopMargins { of, plants, unmeasured, phase_margin_deg, gain_margin, ms, seed, .. } = margins;
            let unmeasured = unmeasured.as_ref().map(|(seed, why)| json!({ "seed": seed, "why": why }));
            json!({
                "loop": of.name(),
                "plants": plants,
                "phase_margin_deg": phase_margin_deg,
                "gain_margin": gain_margin,
                "ms": ms,
                "worst_seed": seed,
                "unmeasured": unmeasured,
                "suffices": margins.suffice(),
            })
        })
        .collect()
}

fn trade_offs_json(all: &[TradeOff]) -> Value {
    let point = |point: &tune::Point| {
        json!({
            "value": point.value,
            "alarms": point.alarms,
            "first_seed": point.seed,
            "motion_s": point.motion_s,
            "false_alarms_per_hour": point.per_hour(),
            "resolution_per_hour": point.resolution_per_hour(),
            "delay_ms_mean": point.delay_ms.map(|(mean, _)| mean),
            "delay_ms_worst": point.delay_ms.map(|(_, worst)| worst),
            "missed": point.missed,
        })
    };
    all.iter()
        .map(|trade| {
            json!({
                "property": trade.property.name,
                "now": trade.now,
                "suggested": trade.suggested(),
                "points": trade.points.iter().map(point).collect::<Vec<Value>>(),
            })
        })
        .collect()
}

/// Candidates of which no other is better in both metrics: means over the plants.
fn front(tuned: &Tuned, a: &str, b: &str) -> Value {
    let terms: Vec<&tune::Term> = tuned.goals.iter().flat_map(|goal| &goal.terms).collect();
    let place = |name: &str| terms.iter().position(|term| term.metric.name == name);
    let (Some(a_at), Some(b_at)) = (place(a), place(b)) else { return json!([]) };
    let mut points: Vec<(f64, f64, &Candidate)> = tuned
        .found
        .archive
        .iter()
        .filter(|candidate| candidate.judged.broken.is_empty())
        .map(|candidate| (candidate.judged.terms[a_at].mean, candidate.judged.terms[b_at].mean, candidate))
        .collect();
    points.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.total_cmp(&y.1)));
    let mut least = f64::INFINITY;
    points.retain(|point| {
        let is_better = point.1 < least;
        least = least.min(point.1);
        is_better
    });
    points
        .into_iter()
        .map(|(x, y, candidate)| json!({ a: x, b: y, "properties": values_json(&tuned.axes, &candidate.values) }))
        .collect()
}

fn text(all: &[Tuned], reproduce: &str) -> String {
    let mut text = String::new();
    for tuned in all {
        let Tuned { found, axes, goals, unseen: [start, result], plants, .. } = tuned;
        text.push_str(&format!("{}\n", found.motor.name()));
        for (axis, (before, after)) in axes.iter().zip(found.start.values.iter().zip(&found.tuned.values)) {
            text.push_str(&format!("  {:<6} {before:>6} -> {after}\n", axis.property.name));
        }
        let edge = match found.edge {
            Some(edge) => format!("all gains can rise by {edge:.2}"),
            None => "all gains can rise by 4 or more".to_owned(),
        };
        let back = match found.backed_off {
            1.0 => "no back-off".to_owned(),
            factor => format!("lowered to {factor:.2} of the best, which leaves {LEAST_EDGE}"),
        };
        text.push_str(&format!("  {edge} until a limit breaks or the cost doubles; {back}\n"));
        if tuned.kept_start {
            text.push_str(
                "  the best candidate cost no less than the start on the unseen plants: the start is kept\n",
            );
        }
        text.push_str(&stability_text(found));
        text.push_str(&trade_offs_text(&found.trade_offs));
        text.push_str(&format!(
            "  cost on {plants} unseen plants {:.4} -> {:.4} ({:+.1} %), {} candidates, {} runs\n",
            start.cost,
            result.cost,
            0.0 - tuned.improvement_percent(),
            found.candidates,
            found.runs
        ));
        text.push_str(
            "  metric, distance from target            mean before    after   worst before    after\n",
        );
        let terms = goals.iter().flat_map(|goal| &goal.terms);
        for (term, (before, after)) in terms.zip(start.terms.iter().zip(&result.terms)) {
            text.push_str(&format!(
                "  {:<40} {:>10.3} {:>8.3} {:>14.3} {:>8.3}\n",
                format!("{} {}", term.objective, term.metric.name),
                before.mean,
                after.mean,
                before.worst,
                after.worst
            ));
        }
    }
    text.push_str(&format!("reproduce with: {reproduce}\n"));
    text
}

fn stability_text(found: &Found) -> String {
    let mut text = String::new();
    for (before, after) in found.start_margins.iter().zip(&found.margins) {
        let margin =
            |margin: Option<f64>| margin.map_or_else(|| "none".to_owned(), |margin| format!("{margin:.1}"));
        text.push_str(&format!(
            "  {} loop, worst of {} plants: phase margin {} -> {} deg (least {LEAST_PHASE_DEG}), gain margin {} -> {}, Ms {:.2} -> {:.2} (most {MOST_MS})\n",
            after.of.name(),
            after.plants,
            margin(before.phase_margin_deg),
            margin(after.phase_margin_deg),
            margin(before.gain_margin),
            margin(after.gain_margin),
            before.ms,
            after.ms
        ));
        if let Some((seed, why)) = &after.unmeasured {
            text.push_str(&format!("  not measured on plant {seed}: {why}\n"));
        }
    }
    text
}

fn trade_offs_text(all: &[TradeOff]) -> String {
    let mut text = String::new();
    for trade in all {
        let suggested = trade.suggested().map_or_else(|| "none".to_owned(), |value| value.to_string());
        text.push_str(&format!(
            "  {} is {}; a step beyond the least without a false alarm: {suggested}\n      value  false alarms/h  delay mean   worst ms  missed\n",
            trade.property.name, trade.now
        ));
        for point in &trade.points {
            let rate = if point.alarms == 0 {
                format!("< {:.0}", point.resolution_per_hour())
            } else {
                format!("{:.0}", point.per_hour())
            };
            // A value that missed every object has no delay.
            let delay = |ms: Option<f64>| ms.map_or_else(|| "none".to_owned(), |ms| format!("{ms:.0}"));
            let [mean, worst] =
                [point.delay_ms.map(|(mean, _)| mean), point.delay_ms.map(|(_, worst)| worst)].map(delay);
            text.push_str(&format!(
                "      {:>5} {rate:>15} {mean:>11} {worst:>10} {:>7}\n",
                point.value, point.missed
            ));
        }
    }
    text
}

fn refusals(tuned: &Tuned) {
    for margins in tuned.found.margins.iter().filter(|margins| !margins.suffice()) {
        let motor = tuned.found.motor.name();
        warn(&format!(
            "refused: {motor}, the {} loop on plant {} has Ms {:.2}, phase margin {:?} deg; half of the gains found do not suffice either",
            margins.of.name(),
            margins.seed,
            margins.ms,
            margins.phase_margin_deg
        ));
    }
    for lost in &tuned.found.lost {
        warn(&format!("refused: {}, the shipped scenario {lost}", tuned.found.motor.name()));
    }
    let Some(broken) = tuned.unseen[1].broken.first() else { return };
    let motor = tuned.found.motor.name();
    let more = tuned.unseen[1].broken.len() - 1;
    warn(&format!(
        "refused: {motor}, {} on plant {}: {}, and {more} more of {} unseen plants",
        broken.objective, broken.seed, broken.what, tuned.plants
    ));
}

fn write(dir: &Path, object: &Value, all: &[Tuned]) -> Result<(), BadInput> {
    let mut files: Vec<(String, String)> = Vec::new();
    for tuned in all {
        let found = tuned.axes.iter().zip(&tuned.found.tuned.values);
        let found = found.map(|(axis, value)| (axis.property.name, *value));
        let values: Vec<(&str, i64)> = tuned.kept.iter().copied().chain(found).collect();
        for goal in &tuned.goals {
            let name = format!("{}-{}.toml", goal.objective, tuned.found.motor.name());
            files.push((name, goal.text_with(&values)));
        }
    }
    let drawn = all.iter().map(|tuned| {
        let Tuned { found, axes, goals, envelopes, .. } = tuned;
        Drawn { found, axes, goals, envelopes }
    });
    let drawn: Vec<Drawn> = drawn.collect();
    files.push(("report.html".to_owned(), tune_report::html(object, &drawn)));
    files.push(("tuned.json".to_owned(), format!("{object:#}\n")));
    let files: Vec<(&str, &[u8])> =
        files.iter().map(|(name, text)| (name.as_str(), text.as_bytes())).collect();
    write_folder(dir, &files)
}
