//! Speed of whole runs on one core: `run_speed [SCENARIO] [RUNS]` prints runs a second of wall time.

use std::time::Instant;

use hil_experiment::run::Options;
use hil_experiment::scenario::Scenario;
use hil_world::plant::Model;

fn main() {
    let mut words = std::env::args().skip(1);
    let name = words.next().unwrap_or_else(|| "spread-full-travel".to_owned());
    let runs = words.next().and_then(|word| word.parse().ok()).unwrap_or(2_000_u32);
    let scenario = Scenario::find(&name).unwrap_or_else(|bad| panic!("{bad}"));
    let begun = Instant::now();
    let mut sum = 0.0;
    for seed in 0..runs {
        let options = Options { seed: seed.into(), model: Model::Averaged, trace: false };
        let outcome = hil_experiment::run::run(&scenario, &options).expect("a scenario that parses");
        sum += outcome.metrics.position_counts + outcome.metrics.heat_j;
    }
    let per_s = f64::from(runs) / begun.elapsed().as_secs_f64();
    println!("{name}: {per_s:.0} runs/s, {} ms each; checksum {:016x}", scenario.duration_ms, sum.to_bits());
}
