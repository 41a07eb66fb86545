//! The demonstration: a tuning run with metrics and a report of how a motor of the hand moves.

use crate::Outcome;
use crate::program::{program, root, run};

/// The spread with the manual's settings, and a finger link at the manual's speed limit.
const SCENARIOS: [&str; 2] = ["spread-full-travel", "link-fast"];

/// Needs no set-up besides cargo.
pub fn demo() -> Outcome {
    println!("Building the simulated motors (under two minutes the first time, on two cores) ...");
    let names = SCENARIOS.join(" ");
    run(program(&format!("cargo run --quiet --package hil-experiment --example demo -- {names}")))?;
    println!("\nOpen in a browser:");
    for scenario in SCENARIOS {
        println!("  {}", root().join("out").join(scenario).join("report.html").display());
    }
    println!("\nTune by hand, for example:");
    println!("  cargo run --bin hil-sim -- run spread-full-travel --set KP=30 --out out/soft");
    Ok(())
}
