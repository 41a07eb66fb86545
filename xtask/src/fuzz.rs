//! Runs every fuzz target for a while, if the nightly compiler that libFuzzer needs is installed.

use std::path::PathBuf;
use std::process::Command;

use crate::Outcome;
use crate::program::{in_parallel, output_of_both, program, root, run, succeeds, target};

/// Seconds for each target: most findings come in the first few.
const SECONDS: u32 = 30;

const VERSION: &str = "0.13.2";

/// Runs every target of `fuzz/`, or prints why not.
///
/// # Errors
/// The input that breaks a target, with a command to repeat it; or an outdated lock file.
pub fn check() -> Outcome {
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
    run(fuzz(&fuzzer, &["build"]))?;
    let targets = targets()?;
    let failures = in_parallel(&targets, |name| {
        let seconds = format!("-max_total_time={SECONDS}");
        let options = [&seconds, "-seed=1", "-verbosity=0", "-print_funcs=0", "-print_final_stats=1"];
        output_of_both(fuzz(&fuzzer, &[["run", name, "--"].as_slice(), &options].concat())).map(|text| {
            let runs = text.lines().find_map(|line| line.strip_prefix("stat::number_of_executed_units:"));
            println!("  {name}: {} runs", runs.unwrap_or("unknown").trim());
        })
    });
    if !failures.is_empty() {
        return Err(failures.join("\n"));
    }
    println!("  {} targets held for {SECONDS} s each", targets.len());
    Ok(())
}

fn fuzz(fuzzer: &PathBuf, arguments: &[&str]) -> Command {
    let mut command = Command::new(fuzzer);
    command.current_dir(root()).arg("fuzz").arg(arguments[0]);
    command.arg("--target-dir").arg(target().join("fuzz")).args(&arguments[1..]);
    command.env("RUSTUP_TOOLCHAIN", "nightly");
    command
}

/// Path of cargo-fuzz, installed below the target folder if it is missing.
fn fuzzer() -> Option<PathBuf> {
    let tools = target().join("tools");
    let fuzzer = tools.join("bin/cargo-fuzz");
    if !fuzzer.exists() {
        let mut install =
            program(&format!("cargo install cargo-fuzz --version {VERSION} --locked --quiet --root"));
        install.arg(&tools);
        run(install).ok()?;
    }
    Some(fuzzer)
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
