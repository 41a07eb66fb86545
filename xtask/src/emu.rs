//! `cargo xtask emu`: builds the image and runs it on emulated boards, with the program `board-emu`.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::image::{self, Profile};
use crate::program::{built, output, program, root, typed};
use crate::{Failure, Outcome};

/// Arguments of `emu`.
#[derive(clap::Args)]
pub struct EmuArgs {
    /// Number of boards, 1 to 7, or a range of nodes, such as 2-4 [default: 1]
    #[arg(long, value_name = "1-7")]
    nodes: Option<String>,
    /// A shipped scenario, or a TOML file [default: spread-full-travel]
    #[arg(long, value_name = "NAME")]
    scenario: Option<String>,
    /// Print one JSON object, and nothing else, to standard output
    #[arg(long)]
    json: bool,
    /// Wait for a GDB on this port of 127.0.0.1
    #[arg(long, value_name = "PORT")]
    gdb: Option<u16>,
    /// Print the boards' logs; implies --profile release
    #[arg(long)]
    rtt: bool,
    /// Poll period of the host for each board, ms; 0 polls MODE alone, ten times a second [default: 1]
    #[arg(long, value_name = "MS")]
    poll_ms: Option<u32>,
    /// With log strings or without [default: production; with --rtt release]
    #[arg(long, value_enum)]
    profile: Option<Profile>,
    /// Instead of a scenario: serve a hand of seven boards here, as fast as the machine can; port 0 picks a free one
    #[arg(long, value_name = "HOST:PORT")]
    listen: Option<String>,
}

/// # Errors
/// A missed expectation (1); bad input, a failed build, or a board that stops (2). The details are printed.
pub fn emu(args: &EmuArgs) -> Result<(), Failure> {
    let profile = args.profile.unwrap_or(if args.rtt { Profile::Release } else { Profile::Production });
    image::build(profile)?;
    let mut emulate = program("cargo run --quiet --release --package board-emu --");
    emulate.arg("--image").arg(image::folder(profile));
    let valued = [
        ("--nodes", args.nodes.clone()),
        ("--scenario", args.scenario.clone()),
        ("--gdb", args.gdb.map(|port| port.to_string())),
        ("--poll-ms", args.poll_ms.map(|ms| ms.to_string())),
        ("--listen", args.listen.clone()),
    ];
    for (name, value) in valued {
        if let Some(value) = value {
            emulate.args([name, &value]);
        }
    }
    emulate.args(args.json.then_some("--json")).args(args.rtt.then_some("--rtt"));
    let line = typed(&emulate);
    match emulate.stdin(Stdio::null()).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) if status.code() == Some(1) => {
            Err(Failure::Judged(format!("an expectation was missed\n  repeat with: {line}")))
        }
        Ok(_) => Err(Failure::Unusable(format!("no verdict\n  repeat with: {line}"))),
        Err(error) => Err(Failure::Unusable(format!("cannot start: {error}\n  repeat with: {line}"))),
    }
}

/// Builds the emulator with the profile of the checks, and the production image. Returns program and folder.
///
/// # Errors
/// The failed program with a command to repeat it.
pub fn build() -> Result<(PathBuf, PathBuf), String> {
    image::build(Profile::Production)?;
    Ok((built("board-emu")?, image::folder(Profile::Production)))
}

/// Keys of the JSON object besides those of `hil-sim run`; they are a contract.
const KEYS: [&str; 9] = [
    "tick_instructions_mean",
    "tick_instructions_max",
    "hall_instructions_max",
    "hall_latency_us_max",
    "can_latency_us_max",
    "cpu_load_pct",
    "stack_bytes_max",
    "realtime_x",
    "instructions",
];

/// Runs seven boards with the production image, from erased flash.
///
/// # Errors
/// The failed run, or the missing keys.
pub fn check() -> Outcome {
    has_keys(Profile::Production, &["--nodes", "7"])
}

/// Builds and checks the image with logs, and runs a board with it, from erased flash.
///
/// # Errors
/// A failed build or run, or the missing keys.
pub fn check_logs() -> Outcome {
    image::check(Profile::Release)?;
    has_keys(Profile::Release, &["--rtt"])
}

/// Runs an image, and finds all keys in what the run prints.
fn has_keys(profile: Profile, rest: &[&str]) -> Outcome {
    let mut emulate = Command::new(built("board-emu")?);
    emulate.args(["--json", "--image"]).current_dir(root()).arg(image::folder(profile)).args(rest);
    let line = typed(&emulate);
    let told = output(emulate)?;
    let found: Value = serde_json::from_str(&told)
        .map_err(|error| format!("found no JSON object: {error}\n  repeat with: {line}"))?;
    let missing: Vec<&str> = KEYS.into_iter().filter(|key| !found[key].is_number()).collect();
    if !missing.is_empty() {
        return Err(format!("found no number for {missing:?}\n  repeat with: {line}"));
    }
    println!("  {}", KEYS.map(|key| format!("{key} {}", found[key])).join(", "));
    Ok(())
}
