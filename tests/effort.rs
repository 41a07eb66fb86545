//! How much the tests try: each has a sample that is enough for a change, and `EFFORT=10` takes ten times as many of each. `SEED=17` repeats
//! one seed of a test that names it.

use std::ops::Range;

/// So many of a sample, times EFFORT.
pub fn effort(sample: u64) -> u64 {
    let effort = std::env::var("EFFORT").ok();
    sample * effort.map_or(1, |effort| effort.parse().expect("EFFORT: a whole number, such as 10"))
}

/// The seeds of a sample from `first` on, times EFFORT; of SEED that one alone.
pub fn seeds(first: u64, sample: u64) -> Range<u64> {
    match std::env::var("SEED") {
        Ok(seed) => {
            let seed = seed.parse().expect("SEED: a whole number, such as 17");
            seed..seed + 1
        }
        Err(_) => first..first + effort(sample),
    }
}
