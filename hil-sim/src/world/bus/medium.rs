//! What may go wrong between the stations: the cable as middleware.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use tater_wire::Frame;

/// What becomes of a frame on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It arrives.
    Whole,
    /// An error at this bit: an error frame follows, nobody takes the frame, and its sender tries again.
    Broken {
        /// Bits of the frame that were sent, at most all of it.
        at_bit: u64,
    },
}

/// The cable. What it decides may depend on all that it has seen, but on nothing else: runs repeat.
pub trait Medium {
    /// What becomes of a frame of so many bits that begins now.
    fn fate(&mut self, _frame: &Frame, _bits: u64, _now_us: u64) -> Fate {
        Fate::Whole
    }

    /// Whether a listener takes a whole frame; one that does not has still acknowledged it (its software has
    /// lost it). `station` is `None` for the host.
    fn hears(&mut self, _frame: &Frame, _station: Option<usize>) -> bool {
        true
    }
}

/// A cable without faults.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clean;

impl Medium for Clean {}

/// Faults by chance, the same for the same seed.
#[derive(Clone, Debug)]
pub struct Noise {
    rng: Pcg64Mcg,
    drop: f64,
    corrupt: f64,
}

impl Noise {
    /// `drop`: probability that a listener loses a frame; `corrupt`: that a frame is destroyed at a random bit and sent
    /// again. Both are clamped to 0..=1, and not a number is 0.
    #[must_use]
    pub fn new(seed: u64, drop: f64, corrupt: f64) -> Self {
        let probability = |p: f64| if p.is_nan() { 0.0 } else { p.clamp(0.0, 1.0) };
        Self { rng: Pcg64Mcg::seed_from_u64(seed), drop: probability(drop), corrupt: probability(corrupt) }
    }
}

impl Medium for Noise {
    fn fate(&mut self, _: &Frame, bits: u64, _: u64) -> Fate {
        if self.rng.random_bool(self.corrupt) {
            return Fate::Broken { at_bit: self.rng.random_range(1..=bits.max(1)) };
        }
        Fate::Whole
    }

    fn hears(&mut self, _: &Frame, _: Option<usize>) -> bool {
        !self.rng.random_bool(self.drop)
    }
}
