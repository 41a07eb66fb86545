//! Runs shipped scenarios, prints their metrics, and writes a folder of each below `out` as `hil-sim run NAME --out` does: `cargo xtask demo`.
//!
//! It is no command of hil-sim, because the first program that a newcomer runs should compile soon: it needs a third of the packages.

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use hil_experiment::run::{Options, run};
use hil_experiment::scenario::Scenario;
use hil_experiment::{folder, report};
use hil_world::plant::Model;

fn show(name: &str) -> Result<(), Box<dyn Error>> {
    let scenario = Scenario::find(name)?;
    let begun = Instant::now();
    let outcome = run(&scenario, &Options { seed: 1, model: Model::Averaged, trace: true })?;
    println!("\n== {name}\n{}", report::text(&outcome, begun.elapsed().as_secs_f64()));
    let folder = Path::new("out").join(name);
    std::fs::create_dir_all(&folder)?;
    for (file, bytes) in folder::files(&scenario, &outcome, "unknown") {
        std::fs::write(folder.join(file), bytes)?;
    }
    if outcome.passed() { Ok(()) } else { Err(format!("{name} does not meet its expectations").into()) }
}

fn main() -> Result<(), Box<dyn Error>> {
    std::env::args().skip(1).try_for_each(|name| show(&name))
}
