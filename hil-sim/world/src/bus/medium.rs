//! Faults between the stations: the cable.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use tater_wire::Frame;

/// The fate of a frame on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// All stations receive it.
    Delivered,
    /// All stations receive it, but its sender sees an error in the last bit and sends it again: receivers get it twice (ISO 11898-1,
    /// "double reception").
    Duplicated,
    /// A bit error: an error frame follows, all stations discard the frame, and its sender retransmits it.
    Corrupted {
        /// Bits of the frame sent before the error, at most all of it.
        at_bit: u64,
    },
}

/// A cable. Its decisions may depend only on earlier calls, so that runs repeat.
pub trait Medium {
    /// The fate of a frame of `bits` bits that starts now.
    fn fate(&mut self, _frame: &Frame, _bits: u64, _now_us: u64) -> Fate {
        Fate::Delivered
    }

    /// Whether a receiver's software gets a frame that its controller acknowledged. `station` is `None` for the host.
    fn delivers(&mut self, _frame: &Frame, _station: Option<usize>) -> bool {
        true
    }
}

/// A cable without faults.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clean;

impl Medium for Clean {}

/// Random faults, the same for the same seed.
#[derive(Clone, Debug)]
pub struct Noise {
    rng: Pcg64Mcg,
    drop: f64,
    corrupt: f64,
}

impl Noise {
    /// Probabilities that a receiver loses a frame and that a frame is corrupted; clamped to 0..=1, NaN counts as 0.
    #[must_use]
    pub fn new(seed: u64, drop: f64, corrupt: f64) -> Self {
        let probability = |p: f64| if p.is_nan() { 0.0 } else { p.clamp(0.0, 1.0) };
        Self { rng: Pcg64Mcg::seed_from_u64(seed), drop: probability(drop), corrupt: probability(corrupt) }
    }
}

impl Medium for Noise {
    fn fate(&mut self, _: &Frame, bits: u64, _: u64) -> Fate {
        if self.rng.random_bool(self.corrupt) {
            return Fate::Corrupted { at_bit: self.rng.random_range(1..=bits.max(1)) };
        }
        Fate::Delivered
    }

    fn delivers(&mut self, _: &Frame, _: Option<usize>) -> bool {
        !self.rng.random_bool(self.drop)
    }
}
