//! `cargo xtask apply`: writes tuned values to boards, with `hil-sim apply`, which has the search's tables and the connection to a bus.
//!
//! A build of the simulator takes minutes where there is none, so the first line comes before it, and cargo shows its progress.

use std::process::Stdio;

use crate::Failure;
use crate::program::{program, typed};
use programs::output::warn;

/// Arguments of `apply`.
#[derive(clap::Args)]
#[command(disable_help_flag = true)]
pub struct ApplyArgs {
    /// tuned.json --slcan HOST:PORT|--can IFACE [--node N] [--dry-run] [--json], or --undo; --help explains each
    #[arg(value_name = "ARGUMENTS", trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<String>,
}

/// # Errors
/// A board did not take the values (1); it could not begin (2). The details are printed.
pub fn apply(args: &ApplyArgs) -> Result<(), Failure> {
    let mut build = program("cargo build --release --package hil-sim --bin hil-sim");
    let line = typed(&build);
    warn(&format!("first hil-sim is built, where it is not up to date, which takes some minutes: {line}"));
    match build.stdin(Stdio::null()).status() {
        Ok(status) if status.success() => {}
        Ok(status) => return Err(Failure::Unusable(format!("not built: {status}\n  repeat with: {line}"))),
        Err(error) => return Err(Failure::Unusable(format!("cannot start: {error}\n  repeat with: {line}"))),
    }
    let mut apply = program("cargo run --quiet --release --package hil-sim -- apply");
    apply.args(&args.arguments);
    let line = typed(&apply);
    // Files are named from the user's folder.
    if let Ok(folder) = std::env::current_dir() {
        apply.current_dir(folder);
    }
    match apply.stdin(Stdio::null()).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) if status.code() == Some(1) => {
            Err(Failure::Judged(format!("the values are not on all boards\n  repeat with: {line}")))
        }
        Ok(_) => Err(Failure::Unusable(format!("not applied\n  repeat with: {line}"))),
        Err(error) => Err(Failure::Unusable(format!("cannot start: {error}\n  repeat with: {line}"))),
    }
}
