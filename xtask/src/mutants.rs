//! `cargo xtask mutants`: cargo-mutants changes the code in one place, a *mutant*, and runs the tests of its crate. A mutant that no test notices
//! *survives*: a test is missing. Of what runs on a board, each survivor needs the reason why no test can exist, in `xtask/mutants.json`; of what runs
//! on a host the score has to reach its goal.
//!
//! The crate's own tests run, the fast ones first. The wider ones of `tests/` are left out: they take half a minute to link for each mutant.

mod outcomes;
pub mod sample;
mod survivors;

use std::path::PathBuf;
use std::process::Command;

use crate::program::{built, in_parallel, installed, output, program, root, target, typed};
use crate::{Failure, Outcome, files};
use outcomes::{Mutant, Tally};
use survivors::Known;

const VERSION: &str = "27.1.0";

struct Subject {
    name: &'static str,
    package: &'static str,
    files: &'static [&'static str],
    /// Argument of `cargo test` that chooses the tests.
    tests: &'static str,
    /// Least score, percent of the viable mutants: 95 for the loops that can break a finger, less where a fault costs an
    /// answer.
    goal: f64,
    /// Whether each survivor needs a reason in the list.
    explains: bool,
    /// Whether its tests start the simulator, which is built from the unchanged tree.
    is_served: bool,
    /// Tests, by parts of their names, that run only on what survives the others.
    slow: &'static [&'static str],
}

const SUBJECTS: [Subject; 10] = [
    Subject {
        slow: &[
            "no_write_keeps_a_stalled_motor_driven",
            "stages_without_an_end_are_jammed",
            "motion::profile::tests",
        ],
        ..of_a_board("servo-core", "servo-core", &["servo-core/src/**"], 95.0)
    },
    of_a_board("tater-wire", "tater-wire", &["tater-wire/src/**"], 92.0),
    Subject {
        slow: &SLOW_OF_BOARD,
        ..of_a_board("storage", "boot", &["boot/src/storage.rs", "boot/src/storage/**"], 92.0)
    },
    Subject {
        slow: &SLOW_OF_BOARD,
        ..of_a_board("monitor", "boot", &["boot/src/monitor.rs", "boot/src/monitor/**"], 92.0)
    },
    of_a_board("god", "god", &["god/src/**"], 85.0),
    of_a_host("world", "hil-world", &["hil-sim/world/src/**"]),
    of_a_host("experiment", "hil-experiment", &["hil-sim/experiment/src/**"]),
    of_a_host("traces", "traces", &["traces/src/**"]),
    Subject {
        is_served: true,
        slow: &["adapters_that_acknowledge_in_their_own_ways_work", "lost_hand_ends_each_call_in_time"],
        ..of_a_host("wraptor", "wraptor", &["wraptor/src/**"])
    },
    of_a_host("kinematics", "kinematics", &["kinematics/src/**"]),
];

const fn of_a_board(
    name: &'static str,
    package: &'static str,
    files: &'static [&'static str],
    goal: f64,
) -> Subject {
    Subject { name, package, files, tests: "--lib", goal, explains: true, is_served: false, slow: &[] }
}

/// The tests of these crates' own `tests` folders are part of them.
const fn of_a_host(name: &'static str, package: &'static str, files: &'static [&'static str]) -> Subject {
    Subject { tests: "--tests", explains: false, ..of_a_board(name, package, files, 85.0) }
}

/// Together they take ten times as long as the other tests of boot.
const SLOW_OF_BOARD: [&str; 6] = [
    "any_frames_and_readings_keep_the_board",
    "any_rising_records_build_the_image",
    "lost_late_or_duplicated_numbered_frames",
    "abandoned_record_is_never_the_newest",
    "failed_page_is_replaced_by_the_next",
    "hot_mark_survives_a_cut",
];

/// Mutants that are left out.
pub const EXCLUDED: [&str; 2] = [
    // Only messages of failed tests print with it.
    "impl .*Debug for",
    // Compiled only with the feature `defmt`, for logs: the tests are built without it.
    "impl .*defmt::Format for",
];

/// Arguments of `mutants`.
#[derive(clap::Args)]
pub struct MutantsArgs {
    /// Parts of the project; all without one
    #[arg(value_name = "SUBJECT", value_parser = SUBJECTS.map(|subject| subject.name))]
    subjects: Vec<String>,
    /// Only mutants in lines that differ from the commit BASE: by default origin/main, or HEAD~1 without one
    #[arg(long, value_name = "BASE", num_args = 0..=1, require_equals = true, default_missing_value = "")]
    in_diff: Option<String>,
    /// Only N mutants of each subject, chosen by the seed
    #[arg(long, value_name = "N", conflicts_with = "in_diff")]
    sample: Option<usize>,
    /// Seed of the sample
    #[arg(long, default_value_t = 1, requires = "sample")]
    seed: u64,
}

/// Runs the subjects, one on each processor at a time, and prints their scores and survivors.
///
/// # Errors
/// A survivor that needs a reason is not in the list, the list names a mutant that does not exist, a score is below its goal, or cargo-mutants fails.
pub fn mutants(args: &MutantsArgs) -> Result<(), Failure> {
    let known = Known::read(&root().join(survivors::LIST))?;
    let tool = tool()?;
    let diff = args.in_diff.as_deref().map(diff).transpose()?;
    let chosen: Vec<&Subject> = SUBJECTS
        .iter()
        .filter(|subject| args.subjects.is_empty() || args.subjects.iter().any(|name| name == subject.name))
        .collect();
    let failures = in_parallel(&chosen, |subject| {
        judge(subject, args, &tool, diff.as_ref(), &known)
            .map_err(|error| format!("{}: {error}", subject.name))
    });
    if failures.is_empty() { Ok(()) } else { Err(Failure::Judged(failures.join("\n"))) }
}

/// Mutants of each subject that `nightly` tries.
const NIGHTLY: usize = 60;

/// Runs a sample of each subject.
///
/// # Errors
/// As [`mutants`].
pub fn sample_of_each() -> Outcome {
    let args = MutantsArgs { subjects: Vec::new(), in_diff: None, sample: Some(NIGHTLY), seed: 1 };
    mutants(&args).map_err(String::from)
}

fn judge(
    subject: &Subject,
    args: &MutantsArgs,
    tool: &PathBuf,
    diff: Option<&PathBuf>,
    known: &Known,
) -> Result<(), String> {
    let arguments = |verb: &[&str]| {
        let mut command = Command::new(tool);
        command.current_dir(root()).args(["mutants", "--package", subject.package]).args(verb);
        command.args(subject.files.iter().flat_map(|file| ["--file", file]));
        command.args(EXCLUDED.iter().flat_map(|pattern| ["--exclude-re", pattern]));
        command.args(diff.iter().flat_map(|path| ["--in-diff".into(), path.display().to_string()]));
        command
    };
    let listed = outcomes::listed(&output(arguments(&["--list", "--json"]))?)?;
    if diff.is_none() {
        known.all_exist(subject.files, &listed)?;
    }
    if listed.is_empty() {
        println!("{}: no mutants", subject.name);
        return Ok(());
    }
    let folder = target().join("mutation").join(subject.name);
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    if subject.is_served {
        let place = folder.join("build/mutants");
        let program = built("hil-sim")?;
        std::fs::create_dir_all(&place)
            .and_then(|()| std::fs::copy(program, place.join("hil-sim")))
            .map_err(|error| format!("{}: {error}", place.display()))?;
    }
    let size = args.sample.filter(|&size| size < listed.len());
    let names = listed.iter().map(|mutant| mutant.name.as_str());
    let sample = size.map(|size| sample::choose(names, size, args.seed));
    let pass = |more: &[&str], filters: &[&str]| {
        let mut command = arguments(&["--profile", "mutants", "--no-shuffle", "--colors=never"]);
        // The tests of a crate take 2 s at most: the rest is for a busy machine.
        command.args(["--minimum-test-timeout=10", "--timeout-multiplier=4", "--output"]).arg(&folder);
        command.arg(format!("--cargo-arg={}", subject.tests)).args(more);
        if let Some(names) = &sample {
            command.args(names.iter().flat_map(|name| ["--re".into(), sample::exactly(name)]));
        }
        command.args(["--", "--"]).args(filters);
        command.env("CARGO_TARGET_DIR", folder.join("build"));
        // Without it a mutant takes several times as long.
        command.env_remove("CARGO_INCREMENTAL");
        // The same random inputs for each mutant; which failing input is the smallest does not matter.
        command.envs([("PROPTEST_RNG_SEED", "1"), ("PROPTEST_MAX_SHRINK_ITERS", "0")]);
        command.env("PROPTEST_DISABLE_FAILURE_PERSISTENCE", "true");
        execute(command)?;
        let results = folder.join("mutants.out/outcomes.json");
        outcomes::tested(&String::from_utf8_lossy(&files::read(&results)?), &listed)
    };
    let skips: Vec<&str> = subject.slow.iter().flat_map(|name| ["--skip", name]).collect();
    let mut tested = pass(&[], &skips)?;
    let survive = |tested: &[(Mutant, Tally)]| tested.iter().any(|(_, tally)| tally.survived > 0);
    if !skips.is_empty() && survive(&tested) {
        tested = outcomes::replaced(tested, pass(&["--iterate"], &[])?);
    }
    // cargo-mutants 27.1 applies no `--re` to deleted fields of structs.
    tested.retain(|(mutant, _)| sample.as_ref().is_none_or(|names| names.contains(&mutant.name.as_str())));
    report(subject, &tested, listed.len(), diff.is_some(), known)
}

/// Runs cargo-mutants; surviving mutants and tests without an end are results, not errors.
fn execute(mut command: Command) -> Result<(), String> {
    let line = typed(&command);
    // A sample's patterns are thousands of characters.
    let line = line.split(" --re ").next().unwrap_or_default();
    let result = command.output().map_err(|error| format!("cannot start: {error}\n  repeat with: {line}"))?;
    match result.status.code() {
        Some(0 | 2 | 3) => Ok(()),
        _ => {
            let text = [result.stdout, result.stderr].concat();
            Err(format!(
                "{}\n{}\n  repeat with: {line}",
                result.status,
                String::from_utf8_lossy(&text).trim_end()
            ))
        }
    }
}

/// Prints the result of a subject; of a diff without the goal, which a few mutants say nothing about.
fn report(
    subject: &Subject,
    tested: &[(Mutant, Tally)],
    listed: usize,
    is_diff: bool,
    known: &Known,
) -> Result<(), String> {
    let tally = tested.iter().fold(Tally::default(), |sum, (_, tally)| sum.plus(*tally));
    let survivors: Vec<&Mutant> =
        tested.iter().filter(|(_, tally)| tally.survived == 1).map(|(mutant, _)| mutant).collect();
    println!("{}: {} of {listed} mutants, {}", subject.name, tested.len(), tally.line());
    let mut unlisted = String::new();
    for mutant in survivors {
        match known.reason(mutant) {
            Some(reason) => println!("  survived: {}: {reason}", mutant.name),
            None if !subject.explains => println!("  survived: {}\n            {}", mutant.name, mutant.code),
            None => unlisted += &format!("\n  survived: {}\n            {}", mutant.name, mutant.code),
        }
    }
    if !unlisted.is_empty() {
        return Err(format!(
            "no test notices these changes:{unlisted}\n  next: write a test that fails under each, or state in {} why none can",
            survivors::LIST
        ));
    }
    if !is_diff && tally.score() < subject.goal {
        return Err(format!("score {:.1} %, expected {} % at least", tally.score(), subject.goal));
    }
    Ok(())
}

/// A file with the changes since a commit, uncommitted ones included.
fn diff(base: &str) -> Result<PathBuf, String> {
    let base = match base {
        "" if crate::program::succeeds("git rev-parse --verify origin/main") => "origin/main",
        "" => "HEAD~1",
        base => base,
    };
    let mut git = program("git diff --merge-base");
    git.arg(base);
    let text = output(git)?;
    let path = target().join("mutation/changes.diff");
    std::fs::create_dir_all(target().join("mutation"))
        .and_then(|()| std::fs::write(&path, text))
        .map_err(|error| format!("{}: {error}", path.display()))?;
    println!("changes since {base}");
    Ok(path)
}

/// Path of cargo-mutants, installed below the target folder if it is missing.
///
/// # Errors
/// The installation's.
pub fn tool() -> Result<PathBuf, String> {
    installed("cargo-mutants", VERSION)
}
