//! Runs every fuzz target for a while, if the nightly compiler that libFuzzer needs is installed.
//!
//! A target starts from its inputs in `fuzz/corpus`, which reach most of what earlier runs reached. `ci` gives the same seed each time,
//! because a landing must not depend on chance (decision 0075); `cargo xtask fuzz` and `fresh` take a new one.

use std::path::PathBuf;
use std::process::Command;
use std::time::{SystemTime, UNIX_EPOCH};

use crate::Outcome;
use crate::program::{in_parallel, installed, output_of_both, program, root, run, succeeds, target};

/// Seconds for each target: most findings come in the first few.
const SECONDS: u32 = 30;

const VERSION: &str = "0.13.2";

/// Arguments of `fuzz`.
#[derive(clap::Args)]
pub struct FuzzArgs {
    /// Repeat the run with this seed; a new one without it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub seed: Option<u32>,
}

/// Most inputs of a target in `ci`, so that a faster machine plays no more than those that have passed before.
const CI_RUNS: u32 = 200_000;

/// Runs every target of `fuzz/` with the seed of `ci`, or prints why not.
///
/// # Errors
/// As [`fuzz`].
pub fn check() -> Outcome {
    fuzz_with(CI_SEED, Some(CI_RUNS))
}

/// Runs every target of `fuzz/`, or prints why not.
///
/// # Errors
/// The input that breaks a target, with a command to repeat it; or an outdated lock file.
pub fn fuzz(args: &FuzzArgs) -> Outcome {
    fuzz_with(args.seed.unwrap_or_else(new_seed), None)
}

fn fuzz_with(seed: u32, runs: Option<u32>) -> Outcome {
    // fuzz/ is its own workspace: changes of dependencies must update its lock file too.
    run(program("cargo update --quiet --workspace --locked --manifest-path fuzz/Cargo.toml")).map_err(
        |error| {
            format!(
                "{error}\n  if fuzz/Cargo.lock is not current: the same line without --locked makes it so; commit it"
            )
        },
    )?;
    // Ask rustup: `cargo +nightly` would install a compiler.
    if !succeeds("rustup run nightly cargo --version") {
        println!("skipped: no nightly compiler (rustup toolchain install nightly)");
        return Ok(());
    }
    let Some(fuzzer) = fuzzer() else {
        println!("skipped: cargo-fuzz cannot be installed (cargo install cargo-fuzz --version {VERSION})");
        return Ok(());
    };
    run(cargo_fuzz(&fuzzer, &["build"]))?;
    let targets = targets()?;
    println!("  seed {seed}");
    let failures = in_parallel(&targets, |name| {
        let corpus = scratch_corpus(name)?;
        let mut options = vec![format!("-max_total_time={SECONDS}"), format!("-seed={seed}")];
        options.extend(runs.map(|runs| format!("-runs={runs}")));
        let mut command = cargo_fuzz(&fuzzer, &["run", name]);
        command.arg(corpus).arg("--").args(options);
        command.args(["-verbosity=0", "-print_funcs=0", "-print_final_stats=1"]);
        let text = output_of_both(command).map_err(|error| failure(name, seed, &error))?;
        let runs = text.lines().find_map(|line| line.strip_prefix("stat::number_of_executed_units:"));
        println!("  {name}: {} runs", runs.unwrap_or("unknown").trim());
        Ok(())
    });
    if !failures.is_empty() {
        return Err(failures.join("\n"));
    }
    println!("  {} targets held for {SECONDS} s each at most", targets.len());
    Ok(())
}

/// The variable that seeds property tests; without it each run has new inputs.
pub const PROPERTY_SEED: &str = "PROPTEST_RNG_SEED";

/// The seed of `ci`, for fuzz targets and property tests.
pub const CI_SEED: u32 = 1;

/// Seconds since 1970: libFuzzer takes 32 bits, and 0 for a seed of its own.
pub fn new_seed() -> u32 {
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(1, |time| time.as_secs());
    u32::try_from(seconds % u64::from(u32::MAX)).unwrap_or(1).max(1)
}

/// A copy of the target's committed inputs, to which libFuzzer adds its own.
fn scratch_corpus(name: &str) -> Result<PathBuf, String> {
    let (from, to) = (root().join("fuzz/corpus").join(name), target().join("fuzz-corpus").join(name));
    let copy = || {
        // What an earlier run has added would change this one.
        if to.exists() {
            std::fs::remove_dir_all(&to)?;
        }
        std::fs::create_dir_all(&to)?;
        for entry in std::fs::read_dir(&from)? {
            let entry = entry?;
            std::fs::copy(entry.path(), to.join(entry.file_name()))?;
        }
        Ok(())
    };
    let explained = |error: std::io::Error| {
        format!(
            "{}: its inputs cannot be copied to {}: {error}\n  next: a new target needs a corpus (CONTRIBUTING.md, Fuzzing)",
            from.display(),
            to.display()
        )
    };
    copy().map_err(explained).map(|()| to)
}

fn failure(name: &str, seed: u32, error: &str) -> String {
    format!("{name}, seed {seed}: {error}\n  the whole run again: cargo xtask fuzz --seed {seed}")
}

fn cargo_fuzz(fuzzer: &PathBuf, arguments: &[&str]) -> Command {
    let mut command = Command::new(fuzzer);
    command.current_dir(root()).arg("fuzz").arg(arguments[0]);
    command.arg("--target-dir").arg(target().join("fuzz")).args(&arguments[1..]);
    command.env("RUSTUP_TOOLCHAIN", "nightly");
    command
}

/// Path of cargo-fuzz, installed below the target folder if it is missing.
fn fuzzer() -> Option<PathBuf> {
    installed("cargo-fuzz", VERSION).ok()
}

fn targets() -> Result<Vec<String>, String> {
    let folder = root().join("fuzz/fuzz_targets");
    let entries = std::fs::read_dir(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| Some(entry.ok()?.path().file_stem()?.to_string_lossy().into_owned()))
        .collect();
    names.sort();
    if names.is_empty() { Err(format!("no targets in {}", folder.display())) } else { Ok(names) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failure_names_seed_and_command() {
        let text = failure("gcl", 17, "exit status: 77");
        assert!(text.starts_with("gcl, seed 17: exit status: 77"), "{text}");
        assert!(text.ends_with("cargo xtask fuzz --seed 17"), "{text}");
    }

    #[test]
    fn each_target_has_a_small_corpus() {
        for name in targets().expect("there are targets") {
            let folder = root().join("fuzz/corpus").join(&name);
            let entries = std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{name}: {error}"));
            let sizes: Vec<u64> =
                entries.map(|entry| entry.and_then(|entry| entry.metadata()).expect("ours").len()).collect();
            // They are read in every run, and kept by git forever.
            assert!((1..=64).contains(&sizes.len()), "{name}: {} files", sizes.len());
            assert!(sizes.iter().sum::<u64>() <= 64 * 1024, "{name}: {sizes:?}");
        }
    }
}
