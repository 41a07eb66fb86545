//! All checks and tests, the cheap ones first, in three tasks: `check` needs Rust and a linker alone, `ci` is before a merge, `nightly` is what takes
//! longer.
//!
//! Host programs are built with the dev profile alone (simulator and servo with opt-level 3 in it, Cargo.toml): a second build
//! in release would take minutes, and dev has overflow checks.

use std::time::{Duration, Instant};

use crate::image::Profile;
use crate::program::{in_parallel, output, program, root, run, simulator};
use crate::setup::THUMB;
use crate::{
    Outcome, c_library, emu, fuzz, hall_oracle, host_tools, image, instructions, miri, model, mutants,
    packages, promises, ray_sweep, reports, setup, size, soak, table, wheel, windows,
};

/// From which task on a step runs.
#[derive(Clone, Copy, PartialEq, Eq)]
enum In {
    /// Needs Rust and a linker alone.
    Check,
    Ci,
    /// Is slow, or looks for what no change is likely to have broken.
    Nightly,
}

struct Step {
    name: &'static str,
    runs: In,
    check: fn() -> Outcome,
}

const fn step(runs: In, name: &'static str, check: fn() -> Outcome) -> Step {
    Step { name, runs, check }
}

/// docs/checks.md has them with the reason why each is where it is.
const STEPS: [Step; 38] = [
    step(In::Check, "set-up", setup::install),
    step(In::Check, "format", || run(program("cargo fmt --all --check"))),
    step(In::Check, "clippy, host", clippy_host),
    step(In::Check, "unit tests", unit_tests),
    step(In::Check, "property table", || table::table(true)),
    step(In::Check, "model files", || model::model(true)),
    step(In::Check, "scenarios", scenarios),
    step(In::Check, "torture, a sample", torture_sample),
    step(In::Ci, "licenses and sources", packages::licenses),
    step(In::Ci, "clippy, wheel", clippy_wheel),
    step(In::Ci, "clippy, microcontroller", clippy_thumb),
    step(In::Ci, "other systems", other_systems),
    step(In::Ci, "documentation", documentation),
    step(In::Ci, "build, microcontroller", build_thumb),
    step(In::Ci, "image", || image::check(Profile::Production)),
    step(In::Ci, "size", size::check),
    step(In::Ci, "tests", tests),
    step(In::Ci, "torture", torture),
    step(In::Ci, "hall captures", hall_oracle::check),
    step(In::Ci, "host tools", host_tools::check),
    step(In::Ci, "C library", c_library::check),
    step(In::Ci, "Python wheel", wheel::check),
    step(In::Ci, "instructions", instructions::check),
    step(In::Ci, "emulation", emu::check),
    step(In::Nightly, "second build of the image", image::reproducible),
    step(In::Nightly, "image with logs", emu::check_logs),
    step(In::Nightly, "packages", packages::check),
    step(In::Nightly, "robot models", model::check),
    step(In::Nightly, "reports in Chromium", reports::check),
    step(In::Nightly, "torture of the documents", documented_torture),
    step(In::Nightly, "long torture", long_torture),
    step(In::Nightly, "tests, ten times as many", tests_with_effort),
    step(In::Nightly, "soak", || soak::soak(SOAK_HOURS)),
    step(In::Nightly, "Windows under Wine", windows::check),
    step(In::Nightly, "sweep under Ray", ray_sweep::check),
    step(In::Nightly, "miri", miri::check),
    step(In::Nightly, "fuzz targets", fuzz::check),
    step(In::Nightly, "mutants", mutants::sample_of_each),
];

/// Runs what Rust and a linker alone can check, and says what it has left out.
///
/// # Errors
/// Name of the failed step, and a command that repeats it.
pub fn check() -> Outcome {
    steps(|step| step.runs == In::Check)?;
    let left = |of: In| {
        STEPS.iter().filter(move |step| step.runs == of).map(|step| step.name).collect::<Vec<_>>().join(", ")
    };
    println!("Left out, for `cargo xtask ci`: {}.", left(In::Ci));
    println!("Left out, for `cargo xtask nightly`: {}.", left(In::Nightly));
    Ok(())
}

/// Runs every step before a merge.
///
/// # Errors
/// As [`check`].
pub fn ci() -> Outcome {
    steps(|step| step.runs != In::Nightly)
}

/// Runs what is too slow for each change.
///
/// # Errors
/// As [`check`].
pub fn nightly() -> Outcome {
    steps(|step| step.runs == In::Nightly)
}

/// Runs these steps and prints the time of each; stops at the first failure.
fn steps(is_one: impl Fn(&Step) -> bool) -> Outcome {
    let start = Instant::now();
    let chosen: Vec<&Step> = STEPS.iter().filter(|step| is_one(step)).collect();
    let mut took = Vec::new();
    for (i, step) in chosen.iter().enumerate() {
        println!("[{}/{}] {}", i + 1, chosen.len(), step.name);
        let begin = Instant::now();
        (step.check)().map_err(|error| format!("{}: {error}", step.name))?;
        println!("  {} took {:.1} s", step.name, begin.elapsed().as_secs_f64());
        took.push((step.name, begin.elapsed()));
    }
    print!("{}", times(&took, start.elapsed()));
    println!("All {} steps passed in {:.0} s.", chosen.len(), start.elapsed().as_secs_f64());
    Ok(())
}

fn times(took: &[(&str, Duration)], total: Duration) -> String {
    let mut took = took.to_vec();
    took.sort_by_key(|(_, time)| std::cmp::Reverse(*time));
    let share = |time: Duration| 100.0 * time.as_secs_f64() / total.as_secs_f64().max(f64::MIN_POSITIVE);
    took.iter()
        .map(|(name, time)| format!("{:>8.1} s {:>5.1} %  {name}\n", time.as_secs_f64(), share(*time)))
        .collect()
}

fn clippy_host() -> Outcome {
    run(program("cargo clippy --quiet --all-targets -- -D warnings"))
}

fn clippy_wheel() -> Outcome {
    run(program("cargo clippy --quiet --package wraptor-py --all-targets -- -D warnings"))
}

/// Tests inside the crates, which start no server and need no image.
fn unit_tests() -> Outcome {
    let mut tests = program("cargo test --quiet --lib --bins");
    tests.env(fuzz::PROPERTY_SEED, fuzz::CI_SEED.to_string());
    let text = output(tests)?;
    let passed: u64 = text.lines().filter_map(passed).sum();
    println!("  {passed} tests passed");
    Ok(())
}

/// The number of a line such as `test result: ok. 12 passed; 0 failed; ...`.
fn passed(line: &str) -> Option<u64> {
    let (_, rest) = line.split_once("test result: ok. ")?;
    rest.split_once(" passed")?.0.parse().ok()
}

/// Systems for which the programs of a host are checked, and the browser, for which the simulated world is.
const SYSTEMS: [&str; 2] = [windows::SYSTEM, "aarch64-apple-darwin"];
const BROWSER: &str = "wasm32-unknown-unknown";

/// Checks, without a linker for them, that host programs compile for other systems.
fn other_systems() -> Outcome {
    // In one run, because what builds for the host, macros and build scripts, is built once.
    let mut clippy = program("cargo clippy --quiet --workspace --exclude wraptor-py --exclude system-tests");
    for system in SYSTEMS {
        setup::add(system)?;
        clippy.args(["--target", system]);
    }
    clippy.args(["--", "-D", "warnings"]);
    run(clippy)?;
    setup::add(BROWSER)?;
    run(program(&format!("cargo check --quiet --package hil-world --target {BROWSER}")))
}

/// The crates for microcontrollers. GOD has no board yet, and the kinematics no caller on one.
const BOARD: &str = "--package servo-core --package tater-wire --package boot --package tater-fw --package bsp-stm32f1 --package tater-f103 --package stub --package god --package kinematics";

fn clippy_thumb() -> Outcome {
    // The second run covers the code of the log feature.
    for features in ["", "--features tater-f103/log"] {
        run(program(&format!("cargo clippy --quiet {BOARD} --target {THUMB} {features} -- -D warnings")))?;
    }
    Ok(())
}

/// Cores of the stub board (docs/porting.md): a Cortex-M4 and a Cortex-M0+.
const OTHER_CORES: [&str; 2] = ["thumbv7em-none-eabi", "thumbv6m-none-eabi"];

/// Builds GOD, which is in no image, and the stub board for other cores; the step "image" builds the other crates.
fn build_thumb() -> Outcome {
    run(program(&format!("cargo build --quiet --release --package god --lib --target {THUMB}")))?;
    // In one run: what links is one thread for each.
    let mut stub = program("cargo build --quiet --profile firmware --package stub --bins");
    for core in OTHER_CORES {
        setup::add(core)?;
        stub.args(["--target", core]);
    }
    run(stub)
}

/// Tests for the night, by parts of their names. Together they take a quarter of the time of all: programs of hosts on emulated boards, which others play
/// on native ones; random samples of which the steps before or shorter tests play a part; and the table of docs/torture.md.
const OF_NIGHT: [&str; 11] = [
    "host::barrett_serial::barrett_host_moves_and_runs_realtime_on_emulated_boards",
    "host::btutil::emulated_board_does_the_same",
    "host::handif::handif_drives_an_emulated_hand",
    "host::libgripper::libgripper_runs_with_compat_262_on_emulated_boards",
    "host::serial_bhand::serial_bhand_drives_an_emulated_hand",
    "emulated::torture::native_and_emulated_verdicts_agree",
    "profile::half_a_million_replanned_moves_keep_every_guarantee",
    "short_search_beats_the_defaults_by_6_percent_at_most",
    "soak::clients_that_come_and_go_for_hours_leave_nothing_behind",
    "torture::a_sample_of_seeds_holds",
    "torture::every_fault_bites_is_cleared_and_the_hand_recovers",
];

/// Runs these tests without those whose names are skipped, timed: each prints its time. Returns what they print.
fn timed_tests(which: &str, effort: u32, skipped: &[&str]) -> Result<String, String> {
    let mut tests = program(&format!("cargo test {which} -- --nocapture"));
    tests.env(fuzz::PROPERTY_SEED, fuzz::CI_SEED.to_string()).env("EFFORT", effort.to_string());
    if cfg!(target_os = "linux") {
        // The harness knows times, but gives them only to a nightly compiler or who asks like this; in the environment of the build it would
        // compile everything anew.
        let host = output(program("rustc --print host-tuple"))?.trim().to_uppercase().replace('-', "_");
        tests.env(format!("CARGO_TARGET_{host}_RUNNER"), "env RUSTC_BOOTSTRAP=1");
        tests.args(["-Zunstable-options", "--report-time"]);
    }
    tests.args(skipped.iter().flat_map(|name| ["--skip", name]));
    output(tests)
}

/// The slowest tests, with their times.
fn slowest(text: &str) -> String {
    let mut times: Vec<(f64, &str)> = text.lines().filter_map(timed).collect();
    times.sort_by(|a, b| b.0.total_cmp(&a.0));
    times.iter().take(SLOWEST).map(|(seconds, name)| format!("{seconds:>8.1} s  {name}\n")).collect()
}

const SLOWEST: usize = 25;

/// Time and name in a line such as `test a::b ... ok <1.234s>`.
fn timed(line: &str) -> Option<(f64, &str)> {
    let (name, rest) = line.strip_prefix("test ")?.split_once(" ... ")?;
    let (_, time) = rest.rsplit_once('<')?;
    Some((time.strip_suffix("s>")?.parse().ok()?, name))
}

/// Ten times as many of each sample.
const EFFORT: u32 = 10;

fn tests_with_effort() -> Outcome {
    // Without it they skip what they cannot do.
    image::build(Profile::Production).map_err(String::from)?;
    let text = timed_tests("--lib --bins --tests", EFFORT, &[])?;
    print!("{}", slowest(&text));
    has_figures(&text, &[])
}

/// That no test was skipped for lack of the production image, unless its name is.
fn has_figures(text: &str, skipped: &[&str]) -> Outcome {
    let wanted = OF_IMAGE.iter().filter(|(_, test)| !skipped.iter().any(|name| name.starts_with(test)));
    let missing = |figure: &str| !marked(text, "figure: ").any(|line| line.contains(figure));
    match wanted.into_iter().find(|(figure, _)| missing(figure)) {
        None => Ok(()),
        Some((figure, test)) => Err(format!(
            "found no figure \"{figure}\": its test was skipped for lack of the production image (step \"image\") or \
             removed\n  repeat with: cargo test --package system-tests -- --nocapture {test}"
        )),
    }
}

/// What follows the mark in each line that has it.
fn marked<'a>(text: &'a str, mark: &'a str) -> impl Iterator<Item = &'a str> {
    text.lines().filter_map(move |line| line.split_once(mark)).map(|(_, rest)| rest)
}

fn tests() -> Outcome {
    // The step "unit tests" has run the others.
    let text = timed_tests("--test *", 1, &OF_NIGHT)?;
    // Their harness is rustdoc's own, which gives no times.
    run(program("cargo test --quiet --doc"))?;
    // The workspace turns the formats of traces on.
    run(program("cargo test --quiet --package traces --no-default-features"))?;
    print!("{}", slowest(&text));
    marked(&text, "figure: ").for_each(|figure| println!("  {figure}"));
    marked(&text, "skipped: ").for_each(|what| println!("  skipped: {what}"));
    has_figures(&text, &OF_NIGHT)?;
    let states: u64 = marked(&text, "figure: ").filter_map(distinct_states).sum();
    println!("  power cuts in all: {states} distinct states");
    let readme = std::fs::read_to_string(root().join("README.md")).map_err(|error| error.to_string())?;
    let least = promised_states(&readme).ok_or("found no \"more than N distinct states\" in README.md")?;
    if states <= least {
        return Err(format!("{states} distinct states after power cuts, README.md says more than {least}"));
    }
    marked(&text, "test result: ").filter(|result| !result.contains(" 0 passed")).for_each(|result| {
        println!("test result: {result}");
    });
    Ok(())
}

/// Distinct flash contents after power cuts that the README promises.
fn promised_states(readme: &str) -> Option<u64> {
    let (before, _) = readme.split_once(" distinct states")?;
    let (_, number) = before.rsplit_once("more than ")?;
    number.replace(',', "").parse().ok()
}

/// Figures of tests that are skipped without the image of the step "image", with those tests.
const OF_IMAGE: [(&str, &str); 8] = [
    ("edge to bridge", "emulated::budgets::"),
    ("hall line 2 low: bridge off after", "emulated::faults::"),
    ("task idle wedged: reset after", "emulated::wedged::"),
    ("from a native board", "emulated::scenarios::"),
    ("emulated torture: seed", "emulated::torture::"),
    ("bytes of production image onto a board", "protocol::image::"),
    ("power cuts of the image, download", "power_cuts::image::download::"),
    ("power cuts of the image, storage", "power_cuts::image::storage::"),
];

fn distinct_states(figure: &str) -> Option<u64> {
    let (before, _) = figure.split_once(" distinct")?;
    before.rsplit(' ').next()?.parse().ok()
}

fn documentation() -> Outcome {
    for packages in ["", "--package wraptor-py"] {
        let mut doc = program(&format!("cargo doc --quiet {packages} --no-deps"));
        doc.env("RUSTDOCFLAGS", "-D warnings");
        run(doc)?;
    }
    Ok(())
}

fn scenarios() -> Outcome {
    let names = shipped()?;
    let listed = output(simulator("list")?)?;
    if let Some(name) = names.iter().find(|name| !listed.contains(name.as_str())) {
        return Err(format!("`hil-sim list` does not name {name}"));
    }
    let mut runs: Vec<String> = names.iter().map(|name| format!("run {name} --json")).collect();
    runs.push("run spread-full-travel --json --model switched".into());
    let failures = in_parallel(&runs, |line| output(simulator(line)?).map(|_| ()));
    println!("  {} of {} runs met their expectations", runs.len() - failures.len(), runs.len());
    if failures.is_empty() { Ok(()) } else { Err(failures.join("\n")) }
}

/// The seeds of the torture chamber: always the same, because a landing must not depend on chance (decision 0075). `check` plays the first,
/// `ci` those that follow, the night all that the documents speak of (decision 0081). Those that have ever failed are among the tests;
/// `cargo xtask fresh` plays new ones.
const SEEDS_OF_CHECK: u32 = 100;
const SEEDS_OF_CI: u32 = 300;
const SEEDS_OF_DOCUMENTS: u32 = 1000;

/// And of those that last ten minutes and more. Both have failed once (tests/torture/failed.txt).
const LONG_SEED: u32 = 8;
const LONG_SEEDS: u32 = 2;

fn torture_sample() -> Outcome {
    tortured(&format!("--seed 1 --seeds {SEEDS_OF_CHECK}"))
}

fn torture() -> Outcome {
    tortured(&format!("--seed {} --seeds {}", SEEDS_OF_CHECK + 1, SEEDS_OF_CI - SEEDS_OF_CHECK))?;
    tortured(&format!("--long --seed {LONG_SEED} --seeds {LONG_SEEDS}"))
}

fn documented_torture() -> Outcome {
    let json = output(simulator(&format!("torture --seed 1 --seeds {SEEDS_OF_DOCUMENTS} --json"))?)?;
    print!("{json}");
    promises::compare(&json)
}

fn long_torture() -> Outcome {
    tortured("--long --seed 1 --seeds 40")
}

/// The line that replays a failure names its seed.
fn tortured(seeds: &str) -> Outcome {
    output(simulator(&format!("torture {seeds}"))?).map(|text| print!("{text}"))
}

/// Simulated hours of clients that come and go.
const SOAK_HOURS: f64 = 10.0;

fn shipped() -> Result<Vec<String>, String> {
    let folder = root().join("hil-sim/scenarios");
    let entries = std::fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned()))
        .collect();
    names.sort();
    if names.is_empty() {
        return Err(format!("no scenarios in {}", folder.display()));
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_of_a_test_is_that_of_its_line() {
        let text = "test a::b ... ok <0.500s>\ntest c ... ok <12.000s>\nfigure: 3\ntest d ... ok\n";
        assert_eq!(slowest(text), "    12.0 s  c\n     0.5 s  a::b\n");
        assert_eq!(passed("test result: ok. 12 passed; 0 failed; 0 ignored"), Some(12));
    }

    #[test]
    fn tests_of_the_night_exist() {
        let mut folders = vec![root().join("tests"), root().join("hil-sim/tests")];
        let mut sources = String::new();
        while let Some(folder) = folders.pop() {
            for entry in std::fs::read_dir(folder).expect("readable") {
                let path = entry.expect("readable").path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.extension().is_some_and(|extension| extension == "rs") {
                    sources += &std::fs::read_to_string(path).expect("text");
                }
            }
        }
        for name in OF_NIGHT {
            let function = name.rsplit("::").next().expect("a name");
            assert!(sources.contains(&format!("fn {function}(")), "{name}");
        }
    }

    #[test]
    fn figure_of_a_test_is_missed_unless_it_is_skipped() {
        let text: String =
            OF_IMAGE.iter().skip(1).map(|(figure, _)| format!("x figure: {figure} 3\n")).collect();
        assert!(has_figures(&text, &[]).is_err_and(|error| error.contains("edge to bridge")));
        assert_eq!(has_figures(&text, &["emulated::budgets::a"]), Ok(()));
    }

    /// The table of the page has each step once, in order, under its task.
    #[test]
    fn page_names_the_steps() {
        let page = std::fs::read_to_string(root().join("docs/checks.md")).expect("the page");
        let rows = page.lines().skip_while(|line| !line.starts_with("| step |")).skip(2);
        let rows: Vec<(&str, &str)> = rows
            .map_while(|line| {
                let mut cells = line.strip_prefix("| ")?.split(" | ");
                Some((cells.next()?, cells.next()?))
            })
            .collect();
        let task = |step: &Step| match step.runs {
            In::Check => "check",
            In::Ci => "ci",
            In::Nightly => "nightly",
        };
        let steps: Vec<(&str, &str)> = STEPS.iter().map(|step| (step.name, task(step))).collect();
        assert_eq!(rows, steps);
    }

    #[test]
    fn times_are_listed_slowest_first() {
        let took = [("a", Duration::from_secs(1)), ("b", Duration::from_secs(3))];
        assert_eq!(times(&took, Duration::from_secs(4)), "     3.0 s  75.0 %  b\n     1.0 s  25.0 %  a\n");
    }

    #[test]
    fn readme_promises_a_number_of_states() {
        assert_eq!(promised_states("old or new: more than 300,000 distinct states |"), Some(300_000));
        assert_eq!(promised_states("more than some distinct states"), None);
    }

    #[test]
    fn distinct_states_is_the_number_before_the_words() {
        assert_eq!(distinct_states("power cuts: 12 cuts, 34 distinct states"), Some(34));
        assert_eq!(distinct_states("12 cuts"), None);
    }
}
