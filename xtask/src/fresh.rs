//! `cargo xtask fresh`: seeds that no run has played before. `ci` plays the same ones each time, because a landing must not depend on
//! chance (decision 0075); this is run before an issue is resolved, and its seed goes into the note.

use crate::Outcome;
use crate::fuzz::{self, FuzzArgs, PROPERTY_SEED, new_seed};
use crate::program::{output, program, run, simulator};
use programs::output::warn;

/// Packages with property tests.
const PACKAGES: &str = "--package servo-core --package tater-wire --package boot --package tater-fw --package god --package kinematics \
                        --package hil-world --package hil-sim --package system-tests";

/// Arguments of `fresh`.
#[derive(clap::Args)]
pub struct FreshArgs {
    /// Repeat the run with this seed; a new one without it, which is printed
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    seed: Option<u32>,
    /// Minutes of the torture chamber, and a fifth of that for its long seeds
    #[arg(long, value_name = "N", default_value_t = 20)]
    minutes: u32,
}

/// # Errors
/// What a fresh seed breaks, with the command that repeats it.
pub fn fresh(args: &FreshArgs) -> Outcome {
    let seed = args.seed.unwrap_or_else(new_seed);
    warn(&format!(
        "seed {seed}; the same run again: cargo xtask fresh --seed {seed} --minutes {}",
        args.minutes
    ));
    print!("{}", output(simulator(&format!("torture --seed {seed} --minutes {}", args.minutes))?)?);
    // Those that last ten minutes and more have a fifth of the time.
    let long = args.minutes.div_ceil(5);
    print!("{}", output(simulator(&format!("torture --long --seed {seed} --minutes {long}"))?)?);
    let mut tests = program(&format!("cargo test --quiet {PACKAGES}"));
    tests.env(PROPERTY_SEED, seed.to_string());
    run(tests)?;
    fuzz::fuzz(&FuzzArgs { seed: Some(seed) })
}
