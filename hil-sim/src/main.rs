//! `hil-sim`: see [`hil_sim::cli`]. The only place that reads the clock.
#![forbid(unsafe_code)]

use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    let start = Instant::now();
    hil_sim::cli::run(&|| start.elapsed())
}
