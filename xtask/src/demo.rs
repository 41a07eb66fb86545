//! The demonstration: a tuning run with metrics and a report of how a motor of the hand moves.

use crate::Outcome;
use crate::program::{program, root, run};

/// The spread with the manual's settings, and a finger link at the manual's speed limit.
const SCENARIOS: [&str; 2] = ["spread-full-travel", "link-fast"];

/// Needs no set-up besides cargo.
pub fn demo() -> Outcome {
    println!("Building the simulator (three and a half minutes the first time, on two cores) ...");
    run(program("cargo build --quiet --bin hil-sim"))?;
    for scenario in SCENARIOS {
        println!("\n== {scenario}");
        run(program(&format!("cargo run --quiet --bin hil-sim -- run {scenario} --out out/{scenario}")))?;
    }
    println!("\nOpen in a browser:");
    for scenario in SCENARIOS {
        println!("  {}", root().join("out").join(scenario).join("report.html").display());
    }
    println!("\nTune by hand, for example:");
    println!("  cargo run --bin hil-sim -- run spread-full-travel --set KP=30 --out out/soft");
    Ok(())
}
