//! `cargo xtask soak`: clients come and go at a simulated hand for hours (hil-sim/tests/hand/soak.rs).

use crate::Outcome;
use crate::program::{program, run};

/// # Errors
/// Memory, threads or files of the hand have grown; with the command to repeat it.
pub fn soak(hours: f64) -> Outcome {
    let mut soak = program("cargo test --quiet --package hil-sim --test hand -- --nocapture soak::clients");
    soak.env("SOAK_HOURS", hours.to_string());
    run(soak)
}
