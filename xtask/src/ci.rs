//! All checks and tests, in the order in which they are cheap.

use std::process::Command;
use std::time::Instant;

use crate::program::{output, program, root, run};
use crate::setup::THUMB;
use crate::{Outcome, emu, fuzz, hall_oracle, host_tools, image, instructions, setup, size, table};

/// One step: what it is called and what it does.
struct Step {
    name: &'static str,
    check: fn() -> Outcome,
}

const STEPS: [Step; 17] = [
    Step { name: "set-up", check: setup::install },
    Step { name: "format", check: || run(program("cargo fmt --all --check")) },
    Step { name: "clippy, host", check: clippy_host },
    Step { name: "clippy, microcontroller", check: clippy_thumb },
    Step { name: "documentation", check: documentation },
    Step { name: "build, microcontroller", check: build_thumb },
    Step { name: "image", check: image::check },
    Step { name: "size", check: size::check },
    Step { name: "tests", check: tests },
    Step { name: "figures", check: figures },
    Step { name: "property table", check: || table::table(true) },
    Step { name: "scenarios", check: scenarios },
    Step { name: "hall captures", check: hall_oracle::check },
    Step { name: "host tools", check: host_tools::check },
    Step { name: "instructions", check: instructions::check },
    Step { name: "emulation", check: emu::check },
    Step { name: "fuzz targets", check: fuzz::check },
];

/// Runs every step; the first failure ends it.
///
/// # Errors
/// The name of the step that failed, and the line to repeat it.
pub fn ci() -> Outcome {
    let start = Instant::now();
    for (i, step) in STEPS.iter().enumerate() {
        println!("[{}/{}] {}", i + 1, STEPS.len(), step.name);
        let begin = Instant::now();
        (step.check)().map_err(|error| format!("{}: {error}", step.name))?;
        println!("  {} took {:.1} s", step.name, begin.elapsed().as_secs_f64());
    }
    println!("All {} steps passed in {:.0} s.", STEPS.len(), start.elapsed().as_secs_f64());
    Ok(())
}

fn clippy_host() -> Outcome {
    run(program("cargo clippy --quiet --workspace --all-targets -- -D warnings"))
}

/// The crates that run on boards: GOD's is to have a microcontroller as well.
const BOARD: &str = "--package servo-core --package tater-wire --package tater-fw --package god";

fn clippy_thumb() -> Outcome {
    // What goes into the image only with log strings comes second.
    for features in ["", "--features tater-fw/log"] {
        run(program(&format!("cargo clippy --quiet {BOARD} --target {THUMB} {features} -- -D warnings")))?;
    }
    Ok(())
}

fn build_thumb() -> Outcome {
    run(program(&format!("cargo build --quiet --release {BOARD} --lib --target {THUMB}")))
}

/// The system tests that measure: cargo would keep what they print to itself.
const MEASURING: [&str; 9] = [
    "emulated::",
    "god::garbage::",
    "god::realtime::",
    "power_cuts::",
    "trust::",
    "protocol::download::",
    "protocol::hosts::answers",
    "protocol::image::",
    "protocol::table::",
];

fn tests() -> Outcome {
    let skips = MEASURING.map(|name| format!("--skip {name}")).join(" ");
    run(program(&format!("cargo test --quiet --workspace -- {skips}")))
}

/// The fewest distinct contents of the flash after a power cut that must have been tried.
const CUT_STATES: u64 = 100_000;

/// Runs the measuring tests and shows their figures, and what they skipped.
fn figures() -> Outcome {
    let names = MEASURING.join(" ");
    let text = output(program(&format!("cargo test --package system-tests -- --nocapture {names}")))?;
    let told =
        |mark: &'static str| text.lines().filter_map(move |line| line.split_once(mark)).map(|(_, rest)| rest);
    told("figure: ").for_each(|figure| println!("  {figure}"));
    told("skipped: ").for_each(|what| println!("  skipped: {what}"));
    for (figure, test) in OF_IMAGE {
        if !told("figure: ").any(|told| told.contains(figure)) {
            return Err(format!(
                "found no figure \"{figure}\", which needs the production image that the step \"image\" has made: its test was \
                 skipped or is gone\n  repeat with: cargo test --package system-tests -- --nocapture {test}"
            ));
        }
    }
    let states: u64 = told("figure: ").filter_map(distinct_states).sum();
    println!("  power cuts in all: {states} distinct states");
    if states < CUT_STATES {
        return Err(format!("{states} distinct states after power cuts, expected {CUT_STATES} at least"));
    }
    Ok(())
}

/// Figures of tests that take what the step "image" has made, and skip what they measure without; and those tests.
const OF_IMAGE: [(&str, &str); 7] = [
    ("edge to bridge", "emulated::budgets::"),
    ("hall line 2 low: bridge off after", "emulated::faults::"),
    ("task idle wedged: reset after", "emulated::wedged::"),
    ("from a native board", "emulated::scenarios::"),
    ("bytes of production image onto a board", "protocol::image::"),
    ("power cuts of the image, download", "power_cuts::image::download::"),
    ("power cuts of the image, storage", "power_cuts::image::storage::"),
];

/// The number before "distinct states".
fn distinct_states(figure: &str) -> Option<u64> {
    let (before, _) = figure.split_once(" distinct")?;
    before.rsplit(' ').next()?.parse().ok()
}

fn documentation() -> Outcome {
    let mut doc = program("cargo doc --quiet --workspace --no-deps");
    doc.env("RUSTDOCFLAGS", "-D warnings");
    run(doc)
}

/// Every shipped scenario must meet its own expectations; the headline one with both models of the inverter.
fn scenarios() -> Outcome {
    let names = shipped()?;
    let listed = output(simulator("list"))?;
    if let Some(name) = names.iter().find(|name| !listed.contains(name.as_str())) {
        return Err(format!("`hil-sim list` does not name {name}"));
    }
    let mut runs: Vec<String> = names.iter().map(|name| format!("run {name} --json")).collect();
    runs.push("run spread-full-travel --json --model switched".into());
    let failures: Vec<String> = runs.iter().filter_map(|line| output(simulator(line)).err()).collect();
    println!("  {} of {} runs met their expectations", runs.len() - failures.len(), runs.len());
    if failures.is_empty() { Ok(()) } else { Err(failures.join("\n")) }
}

fn simulator(line: &str) -> Command {
    program(&format!("cargo run --quiet --release --package hil-sim -- {line}"))
}

/// The names of the scenario files, sorted.
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
