//! The simulator in process, as `wraptor.sim`.

mod board;
mod hand;
mod scenario;

pub use board::Board;
pub use hand::SimHand;
pub use scenario::{Run, run, scenarios};

use pyo3::prelude::*;

use crate::call::MOST_SECONDS;
use crate::errors;

/// Largest load on a joint, N·m: a hundred times what a motor can.
const MOST_N_M: f64 = 1e4;

/// A simulated span, s.
///
/// # Errors
/// `ValueError`: below 0, or above [`MOST_SECONDS`].
fn span(seconds: f64) -> PyResult<f64> {
    if (0.0..=MOST_SECONDS).contains(&seconds) {
        return Ok(seconds);
    }
    let expected = format!("simulated seconds, 0 to {MOST_SECONDS}");
    Err(errors::value("seconds", &seconds.to_string(), &expected, "give how far time advances"))
}

/// What steps have left: simulated time advances by whole microseconds.
#[derive(Default)]
struct Remainder {
    us: f64,
}

impl Remainder {
    /// The next step in whole microseconds, such that the steps' sum is rounded and not each of them.
    fn step_us(&mut self, seconds: f64) -> u64 {
        let wanted = self.us + seconds * 1e6;
        // The remainder may be half a microsecond too far.
        let us = wanted.round().max(0.0);
        self.us = wanted - us;
        us as u64
    }
}

/// A load on a joint behind a gear, as torque on the motor.
///
/// # Errors
/// `ValueError`: no number, or out of range.
fn at_motor(n_m: f64, gear_ratio: f64) -> PyResult<f64> {
    if n_m.abs() <= MOST_N_M {
        return Ok(n_m / gear_ratio);
    }
    let expected = format!("N m on the joint, -{MOST_N_M} to {MOST_N_M}");
    Err(errors::value("torque", &n_m.to_string(), &expected, "check the unit and the model that computes it"))
}
