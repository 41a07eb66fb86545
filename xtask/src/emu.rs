//! `cargo xtask emu`: the image, built if it is not, on emulated boards. The program `board-emu` does it.

use std::process::Stdio;

use crate::Failure;
use crate::image::{self, Profile};
use crate::program::{program, typed};

/// The arguments of the chore.
#[derive(clap::Args)]
pub struct EmuArgs {
    /// How many boards, 1 to 7, or which nodes, such as 2-4 [default: 1]
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
    /// Print what the boards log; takes --profile release
    #[arg(long)]
    rtt: bool,
    /// How often the host polls a board, ms, by the number of boards; 0: MODE alone, ten times a second [default: 1]
    #[arg(long, value_name = "MS")]
    poll_ms: Option<u32>,
    /// With log strings or without [default: production; with --rtt release]
    #[arg(long, value_enum)]
    profile: Option<Profile>,
}

/// Builds the image and runs it.
///
/// # Errors
/// An expectation that is not met (1); bad input, an image that cannot be built, a board that stops (2). What it was has been
/// said.
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
            Err(Failure::Judged(format!("an expectation is not met\n  repeat with: {line}")))
        }
        Ok(_) => Err(Failure::Unusable(format!("no verdict\n  repeat with: {line}"))),
        Err(error) => Err(Failure::Unusable(format!("cannot start: {error}\n  repeat with: {line}"))),
    }
}
