//! `cargo xtask soak`: clients come and go at a simulated hand for hours (hil-sim/tests/hand/soak.rs).

use crate::Outcome;
use crate::program::{program, run};

/// Hours that the tests run (hil-sim/tests/hand/soak.rs).
const SAMPLE_HOURS: f64 = 0.15;

/// # Errors
/// Memory, threads or files of the hand have grown; with the command to repeat it.
pub fn soak(hours: f64) -> Outcome {
    let mut soak = program("cargo test --quiet --test commands -- --nocapture hand::soak::clients");
    soak.env("EFFORT", (hours / SAMPLE_HOURS).ceil().to_string());
    run(soak)
}
