//! Mode 4: torque = gain × velocity error, nothing else (manual 6.1). RealTime and TC/TO run on it.

use crate::num::{Law, gain};
use crate::units::{CountsPerSec, Torque};

/// The velocity law with its gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VelocityLoop {
    gain: Law,
}

impl VelocityLoop {
    /// From property KPV, in 1/16 torque unit per count/s. Every value is allowed.
    #[must_use]
    pub fn new(kpv: u16) -> Self {
        Self { gain: gain(kpv, 4) }
    }

    /// The torque towards `wanted`, within ±`limit`.
    #[must_use]
    pub fn step(&self, wanted: CountsPerSec, measured: CountsPerSec, limit: Torque) -> Torque {
        let error = wanted.0.saturating_sub(measured.0);
        Torque::from_fixed(self.gain.saturating_mul(error)).clamp_abs(limit)
    }

    /// The damping of the velocity, in torque units per count/s.
    #[must_use]
    pub const fn damping(&self) -> Law {
        self.gain
    }
}
