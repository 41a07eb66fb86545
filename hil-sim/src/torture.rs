//! `hil-sim torture`: seeds on all cores, progress, results, and the line that replays a failure.

use std::collections::BTreeMap;
use std::error::Error;
use std::hash::{BuildHasher, RandomState};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use clap::builder::PossibleValuesParser;
use clap::value_parser;
use serde::Serialize;

use super::output::{is_same_file, print};
use hil_torture::invariant::measure::Worst;
use hil_torture::invariant::promise::PROMISES;
use hil_torture::report::{replay_line, tables, text};
use hil_torture::{Case, INVARIANTS, Outcome, Selection, Shrunk, Violation, run, run_with_events, shrink};
use programs::files;
use programs::interrupt;
use programs::output::warn;
use traces::input::BadInput;

/// Seeds of a run that says neither how many nor how long.
const SEEDS: u64 = 100;

/// Time for shrinking one failure, and failures that are shrunk.
const SHRINK: Duration = Duration::from_secs(60);
const SHRUNK: usize = 3;

/// A failing seed is printed at once; more than these are only counted.
const PRINTED: usize = 100;

/// Threads that begin at once: far more than any machine has cores.
const MOST_JOBS: u64 = 256;

/// A week.
const MOST_MINUTES: f64 = 10_080.0;

/// Boards of a hand.
const BOARDS: f64 = 7.0;

/// Real time since the program started.
type Clock<'a> = &'a dyn Fn() -> Duration;

/// The arguments of `hil-sim torture`.
#[derive(clap::Args)]
pub struct TortureArgs {
    /// The first seed; default: a fresh one, which is printed.
    #[arg(long)]
    seed: Option<u64>,
    /// Long seeds, of ten minutes of simulated time and more, in which windings heat and cool.
    #[arg(long)]
    long: bool,
    /// Number of seeds; default: 1 with --seed, otherwise 100.
    #[arg(long, value_parser = value_parser!(u64).range(1..))]
    seeds: Option<u64>,
    /// Minutes after which no new seed begins, but for the first one, instead of a number of seeds.
    #[arg(long, value_name = "MINUTES", conflicts_with = "seeds", value_parser = minutes)]
    minutes: Option<f64>,
    /// Threads, at most one a seed; default: one for each core.
    #[arg(long, value_parser = value_parser!(u64).range(1..=MOST_JOBS))]
    jobs: Option<u64>,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
    /// Write a report of the seed: world, program, faults, failure and the events of all boards. Default: torture-SEED.txt.
    #[arg(
        long, value_name = "FILE", num_args = 0..=1, requires = "seed",
        conflicts_with_all = ["seeds", "minutes", "jobs", "no_shrink", "until"]
    )]
    replay: Option<Option<PathBuf>>,
    /// Only these steps of the seed's program: numbers with commas, or `none`.
    #[arg(long, value_name = "NUMBERS", requires = "seed")]
    steps: Option<String>,
    /// Only these faults of the seed: numbers with commas, or `none`.
    #[arg(long, value_name = "NUMBERS", requires = "seed")]
    faults: Option<String>,
    /// End the program earlier, ms.
    #[arg(long, value_name = "MS", requires = "seed")]
    stop_ms: Option<u64>,
    /// Do not shrink failures.
    #[arg(long)]
    no_shrink: bool,
    /// Begin no new seed once one has broken one of these invariants: names with commas.
    #[arg(long, value_name = "INVARIANTS", value_delimiter = ',', value_parser = invariants(), hide_possible_values = true)]
    until: Vec<String>,
    /// Print the tables of invariants and faults, and run nothing.
    #[arg(long, exclusive = true)]
    list: bool,
}

#[derive(Serialize)]
struct Failure {
    seed: u64,
    invariant: &'static str,
    ms: u64,
    motor: usize,
    found: String,
    /// Simulated seconds of the seeds before it that had ended, and this one: the time to catch it.
    simulated_s: f64,
    replay: String,
    shrunk_steps: Option<usize>,
    shrunk_faults: Option<usize>,
}

#[derive(Serialize)]
struct Json {
    first_seed: u64,
    seeds: u64,
    failed: u64,
    recovered: u64,
    hand_hours: f64,
    board_hours: f64,
    wall_s: f64,
    hand_hours_per_core_hour: f64,
    slowest_recovery_ms: u64,
    /// Seeds whose recovery needed a hand on a joint.
    turned_by_hand: u64,
    prompts: u64,
    peak_winding_c: f64,
    peak_phase_a: f64,
    peak_bus_v: f64,
    /// The greatest values that the checks have measured, docs/safety.md.
    worst: BTreeMap<&'static str, f64>,
    /// How many seeds had a fault of each kind.
    faults: BTreeMap<&'static str, u64>,
    /// ERROR values that boards reported.
    errors: Vec<u32>,
    failures: Vec<Failure>,
}

/// What all seeds so far have given.
#[derive(Default)]
struct Sum {
    seeds: u64,
    failed: u64,
    recovered: u64,
    ms: u64,
    slowest_ms: u64,
    turned_by_hand: u64,
    prompts: u64,
    peaks: [f64; 3],
    worst: Worst,
    errors: u64,
    faults: BTreeMap<&'static str, u64>,
    failures: Vec<(Violation, Case, f64)>,
}

impl Sum {
    /// Adds a seed. Returns whether it broke an invariant of `until`.
    fn add(&mut self, case: Case, outcome: Outcome, until: &[String]) -> bool {
        self.seeds += 1;
        self.ms += outcome.ms;
        self.recovered += u64::from(outcome.recovered_ms.is_some());
        self.slowest_ms = self.slowest_ms.max(outcome.recovered_ms.unwrap_or(0));
        self.turned_by_hand += u64::from(outcome.turned_by_hand > 0);
        self.prompts += outcome.prompts;
        self.errors |= outcome.errors;
        self.worst.merge(&outcome.worst);
        for (most, peak) in self.peaks.iter_mut().zip(outcome.peaks) {
            *most = most.max(peak);
        }
        let kinds: std::collections::BTreeSet<&'static str> =
            case.faults.iter().map(|fault| fault.kind.row().name).collect();
        kinds.into_iter().for_each(|kind| *self.faults.entry(kind).or_default() += 1);
        let Some(violation) = outcome.violation else { return false };
        self.failed += 1;
        let ends = until.iter().any(|name| name == violation.invariant);
        if self.failures.len() < PRINTED || ends {
            warn(&format!(
                "seed {}: {} at {} ms, motor {}: {}",
                case.seed, violation.invariant, violation.ms, violation.node, violation.found
            ));
            self.failures.push((violation, case, self.ms as f64 / 1000.0));
        }
        ends
    }
}

impl TortureArgs {
    fn case(&self, seed: u64) -> Case {
        if self.long { Case::draw_long(seed) } else { Case::draw(seed) }
    }
}

/// Runs the seeds. Returns whether every invariant held.
///
/// # Errors
/// Bad numbers, or a report that cannot be written.
pub fn torture(args: &TortureArgs, clock: Clock) -> Result<bool, Box<dyn Error>> {
    if args.list {
        print(&tables())?;
        return Ok(true);
    }
    let selection = Selection {
        steps: numbers("--steps", args.steps.as_deref())?,
        faults: numbers("--faults", args.faults.as_deref())?,
        stop_ms: args.stop_ms,
    };
    if let Some(seed) = args.seed {
        let alone = args.seeds.is_none_or(|seeds| seeds == 1) && args.minutes.is_none();
        are_of(&args.case(seed), alone, &selection)?;
        if let Some(note) = never_played(&args.case(seed), &selection) {
            warn(&note);
        }
    }
    if let (Some(seed), Some(file)) = (args.seed, &args.replay) {
        return replay(args, seed, &selection, file.clone());
    }
    let first = args.seed.unwrap_or_else(fresh_seed);
    let seeds = match (args.seeds, args.minutes, args.seed) {
        (Some(seeds), ..) => seeds,
        (None, Some(_), _) => u64::MAX,
        (None, None, Some(_)) => 1,
        (None, None, None) => SEEDS,
    };
    interrupt::finish_first();
    if args.seed.is_none() {
        warn(&format!("first seed: {first}"));
    }
    let jobs = args.jobs.unwrap_or_else(|| cores() as u64).min(seeds) as usize;
    let begun = clock();
    let sum = play_all(args, &selection, clock, first, seeds, jobs);
    let wall_s = (clock() - begun).as_secs_f64();
    let failures = failures(args, &selection, &sum, clock);
    report(args, first, &sum, failures, wall_s, jobs)?;
    if interrupt::interrupted() {
        warn(&format!("interrupted: these are the results of {} seeds", sum.seeds));
    }
    Ok(sum.failed == 0)
}

fn invariants() -> PossibleValuesParser {
    PossibleValuesParser::new(INVARIANTS.iter().map(|invariant| invariant.name))
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, Into::into)
}

fn fresh_seed() -> u64 {
    // Keys of the system's randomness; a number short enough to type.
    RandomState::new().hash_one(0) % 1_000_000 * 1_000_000
}

fn numbers(option: &str, text: Option<&str>) -> Result<Option<Vec<usize>>, BadInput> {
    let Some(text) = text else { return Ok(None) };
    if text == "none" {
        return Ok(Some(Vec::new()));
    }
    let all: Result<Vec<usize>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    all.map(Some).map_err(|_| {
        BadInput::new(option, "is no list of numbers")
            .found(format!("{text:?}"))
            .expected("numbers with commas, such as 0,3,7, or none")
            .next("copy the line that the failing run printed")
    })
}

/// Steps and faults are numbers of one seed's own, of which `none` are left or some.
fn are_of(case: &Case, alone: bool, selection: &Selection) -> Result<(), BadInput> {
    let seed = case.seed;
    let parts =
        [("--steps", &selection.steps, case.steps.len()), ("--faults", &selection.faults, case.faults.len())];
    for (option, chosen, len) in parts {
        let Some(chosen) = chosen.as_ref().filter(|chosen| !chosen.is_empty()) else { continue };
        let bad = |problem: &str, found: String, expected: String| {
            BadInput::new(option, problem)
                .found(found)
                .expected(expected)
                .next("copy the line that the failing run printed")
        };
        if !alone {
            let found = "several seeds".to_owned();
            return Err(bad("has numbers of one seed", found, "--seed alone, or none".to_owned()));
        }
        if let Some(number) = chosen.iter().find(|&&number| number >= len) {
            let expected = match len {
                0 => format!("none: seed {seed} has none"),
                len => format!("0 to {} of seed {seed}", len - 1),
            };
            return Err(bad("the seed has no such number", number.to_string(), expected));
        }
        if !chosen.is_sorted_by(|a, b| a < b) {
            let found = chosen.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
            return Err(bad("is not in order", found, "rising numbers, each once".to_owned()));
        }
    }
    Ok(())
}

/// A note on selected steps that begin only after the selected end.
fn never_played(case: &Case, selection: &Selection) -> Option<String> {
    let (steps, stop_ms) = (selection.steps.as_ref()?, selection.stop_ms?);
    let begins = |&number: &usize| case.steps.get(number).map(|step| (number, step.at_ms));
    let late: Vec<(usize, u64)> =
        steps.iter().filter_map(begins).filter(|&(_, at_ms)| at_ms >= stop_ms).collect();
    let (first, at_ms) = late.first()?;
    Some(format!(
        "note: {} of {} steps are not played, because --stop-ms {stop_ms} ends the program before; step {first} begins at {at_ms} ms",
        late.len(),
        steps.len()
    ))
}

fn minutes(text: &str) -> Result<f64, String> {
    let minutes = text.parse().ok().filter(|minutes: &f64| *minutes > 0.0 && *minutes <= MOST_MINUTES);
    minutes.ok_or_else(|| format!("expected minutes above 0 and up to {MOST_MINUTES}, such as 5 or 0.5"))
}

fn play_all(
    args: &TortureArgs,
    selection: &Selection,
    clock: Clock,
    first: u64,
    seeds: u64,
    jobs: usize,
) -> Sum {
    let sum = Mutex::new(Sum::default());
    let next = AtomicU64::new(0);
    let over = AtomicU64::new(0);
    let bar = (!args.json).then(|| match args.minutes {
        Some(_) => indicatif::ProgressBar::new_spinner(),
        None => indicatif::ProgressBar::new(seeds),
    });
    let end = args.minutes.map(|minutes| clock() + Duration::from_secs_f64(minutes * 60.0));
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            // Threads of its own: the clock stays on this one, and seeds go on until time, ^C or a failure ends them.
            scope.spawn(|| {
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    // At least one seed is played, however short the time is.
                    if at >= seeds || at > 0 && over.load(Ordering::Relaxed) != 0 {
                        break;
                    }
                    let case = args.case(first.wrapping_add(at)).select(selection);
                    let outcome = run(&case);
                    if sum.lock().unwrap_or_else(PoisonError::into_inner).add(case, outcome, &args.until) {
                        break;
                    }
                }
                over.fetch_or(1, Ordering::Relaxed);
            });
        }
        loop {
            let (done, hours, failed) = {
                let sum = sum.lock().unwrap_or_else(PoisonError::into_inner);
                (sum.seeds, sum.ms as f64 / 3.6e6, sum.failed)
            };
            if let Some(bar) = &bar {
                bar.set_position(done);
                bar.set_message(format!("{done} seeds, {hours:.2} hand-hours, {failed} failed"));
            }
            if end.is_some_and(|end| clock() >= end) || interrupt::interrupted() {
                over.store(1, Ordering::Relaxed);
            }
            if over.load(Ordering::Relaxed) != 0 {
                break;
            }
            std::thread::park_timeout(Duration::from_millis(100));
        }
    });
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
    sum.into_inner().unwrap_or_else(PoisonError::into_inner)
}

fn failures(args: &TortureArgs, selection: &Selection, sum: &Sum, clock: Clock) -> Vec<Failure> {
    let mut seen: Vec<&'static str> = Vec::new();
    let mut all: Vec<&(Violation, Case, f64)> = sum.failures.iter().collect();
    all.sort_by_key(|(_, case, _)| case.seed);
    all.into_iter()
        .map(|(violation, case, simulated_s)| {
            let is_new = !seen.contains(&violation.invariant)
                && seen.len() < SHRUNK
                && !args.no_shrink
                && !interrupt::interrupted();
            let shrunk = is_new.then(|| {
                seen.push(violation.invariant);
                let end = clock() + SHRINK;
                // The numbers of the whole case, so that the printed line replays it.
                let whole = args.case(case.seed);
                let narrowed = if *selection == Selection::default() { &whole } else { case };
                shrink(narrowed, violation, &mut |case| run(case), &mut || {
                    clock() < end && !interrupt::interrupted()
                })
            });
            failure(violation, case, *simulated_s, selection, shrunk)
        })
        .collect()
}

fn failure(
    violation: &Violation,
    case: &Case,
    simulated_s: f64,
    selection: &Selection,
    shrunk: Option<Shrunk>,
) -> Failure {
    // A case that was narrowed by hand has other numbers.
    let shrunk = shrunk.filter(|_| *selection == Selection::default());
    let (violation, selection) = match &shrunk {
        Some(shrunk) => (&shrunk.violation, &shrunk.selection),
        None => (violation, selection),
    };
    let count = |numbers: &Option<Vec<usize>>| shrunk.as_ref().and(numbers.as_ref()).map(Vec::len);
    Failure {
        seed: case.seed,
        invariant: violation.invariant,
        ms: violation.ms,
        motor: violation.node,
        found: violation.found.clone(),
        simulated_s,
        replay: replay_line(case, selection),
        shrunk_steps: count(&selection.steps),
        shrunk_faults: count(&selection.faults),
    }
}

fn report(
    args: &TortureArgs,
    first_seed: u64,
    sum: &Sum,
    failures: Vec<Failure>,
    wall_s: f64,
    jobs: usize,
) -> Result<(), BadInput> {
    let hand_hours = sum.ms as f64 / 3.6e6;
    let core_hours = wall_s * jobs.min(cores()) as f64 / 3600.0;
    let [peak_winding_c, peak_phase_a, peak_bus_v] = sum.peaks;
    let json = Json {
        first_seed,
        seeds: sum.seeds,
        failed: sum.failed,
        recovered: sum.recovered,
        hand_hours,
        board_hours: BOARDS * hand_hours,
        wall_s,
        hand_hours_per_core_hour: hand_hours / core_hours.max(1e-9),
        slowest_recovery_ms: sum.slowest_ms,
        turned_by_hand: sum.turned_by_hand,
        prompts: sum.prompts,
        peak_winding_c,
        peak_phase_a,
        peak_bus_v,
        worst: PROMISES.iter().map(|promise| (promise.name, sum.worst.of(promise.measure))).collect(),
        faults: sum.faults.clone(),
        errors: (0..64).filter(|code| sum.errors >> code & 1 == 1).collect(),
        failures,
    };
    if args.json {
        // Numbers and strings only: this cannot fail.
        return print(&format!("{}\n", serde_json::to_string(&json).unwrap_or_default()));
    }
    let mut text = format!(
        "{} seeds from {first_seed}: {} failed, {} recovered, the slowest in {:.1} s, {} with a hand on a joint\n\
         {:.2} board-hours in {wall_s:.0} s: {:.1} hand-hours per core-hour\n\
         peaks: winding {peak_winding_c:.1} C, phase {peak_phase_a:.1} A, bus {peak_bus_v:.1} V; ERROR {:?}\n",
        json.seeds,
        json.failed,
        json.recovered,
        json.slowest_recovery_ms as f64 / 1000.0,
        json.turned_by_hand,
        json.board_hours,
        json.hand_hours_per_core_hour,
        json.errors,
    );
    for failure in &json.failures {
        let Failure { invariant, ms, motor, found, replay, .. } = failure;
        text.push_str(&format!("{replay}  # {invariant} at {ms} ms, motor {motor}: {found}\n"));
    }
    print(&text)
}

fn replay(
    args: &TortureArgs,
    seed: u64,
    selection: &Selection,
    file: Option<PathBuf>,
) -> Result<bool, Box<dyn Error>> {
    let path = file.unwrap_or_else(|| PathBuf::from(format!("torture-{seed}.txt")));
    if args.json && is_same_file(&path, Path::new("/dev/stdout")) {
        return Err(Box::new(
            BadInput::new(
                format!("--replay {}", path.display()),
                "the report would be mixed with the JSON object",
            )
            .found("standard output, with --json")
            .expected("a file of its own for the report")
            .next("choose another path, or leave out --json"),
        ));
    }
    let case = args.case(seed).select(selection);
    let (outcome, events) = run_with_events(&case);
    files::replace(&path, text(&case, selection, &outcome, &events).as_bytes()).map_err(|e| {
        BadInput::new(format!("--replay {}", path.display()), "cannot be written")
            .found(e.to_string())
            .expected("a file in an existing folder")
            .next("choose another path or free space")
    })?;
    let held = outcome.violation.is_none();
    let found = outcome.violation.map_or_else(
        || "every invariant held".to_owned(),
        |violation| {
            let Violation { invariant, ms, node, found } = violation;
            format!("{invariant} at {ms} ms, motor {node}: {found}")
        },
    );
    if args.json {
        let json = serde_json::json!({
            "seed": seed, "held": held, "found": found, "report": path.display().to_string(), "simulated_ms": outcome.ms,
        });
        print(&format!("{json}\n"))?;
    } else {
        print(&format!("{found}\n{}\n", path.display()))?;
    }
    Ok(held)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn minutes_are_above_zero_and_finite() {
        assert_eq!(minutes("0.5"), Ok(0.5));
        for text in ["0", "-1", "NaN", "inf", "1e9", "five", ""] {
            assert!(minutes(text).is_err_and(|error| error.contains("such as 5")), "{text}");
        }
    }

    #[test]
    fn steps_after_the_end_are_noted() {
        let case = Case::draw(863);
        let last = case.steps.len() - 1;
        let at_ms = case.steps[last].at_ms;
        let note = |steps: Option<Vec<usize>>, stop_ms| {
            never_played(&case, &Selection { steps, faults: None, stop_ms })
        };
        assert!(case.steps[0].at_ms < at_ms);
        let found = note(Some(vec![0, last]), Some(at_ms)).expect("a note");
        assert!(
            found.contains("1 of 2 steps") && found.contains(&format!("step {last} begins at {at_ms} ms"))
        );
        assert_eq!(note(Some(vec![0, last]), Some(at_ms + 1)), None);
        assert_eq!(note(Some(vec![0, last]), None), None);
        assert_eq!(note(None, Some(at_ms)), None, "all that is before the end");
    }

    #[test]
    fn chosen_steps_and_faults_are_those_of_one_seed() {
        let case = Case::draw(863);
        let last = case.steps.len() - 1;
        let chosen = |steps: &[usize], faults: &[usize]| Selection {
            steps: Some(steps.to_vec()),
            faults: Some(faults.to_vec()),
            stop_ms: None,
        };
        assert!(are_of(&case, true, &chosen(&[0, last], &[])).is_ok());
        assert!(are_of(&case, false, &chosen(&[], &[])).is_ok(), "none, of each seed");
        for (alone, selection, word) in [
            (true, chosen(&[last + 1], &[]), "no such number"),
            (true, chosen(&[], &[case.faults.len()]), "no such number"),
            (true, chosen(&[1, 0], &[]), "not in order"),
            (true, chosen(&[1, 1], &[]), "not in order"),
            (false, chosen(&[0], &[]), "one seed"),
        ] {
            let error = are_of(&case, alone, &selection).expect_err("refused").to_string();
            assert!(error.contains(word) && error.contains("next:"), "{error}");
        }
    }
}
