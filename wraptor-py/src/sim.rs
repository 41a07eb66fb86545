//! The simulator in process, as `wraptor.sim`.

mod board;
mod hand;
mod scenario;

pub use board::Board;
pub use hand::SimHand;
pub use scenario::{Run, run, scenarios};

use pyo3::prelude::*;

use crate::errors;

/// Largest load on a joint, N·m: a hundred times what a motor can.
const MOST_N_M: f64 = 1e4;

/// A simulated span in whole microseconds.
///
/// # Errors
/// `ValueError`: below 0, or above 10⁹ s.
fn span_us(seconds: f64) -> PyResult<u64> {
    if (0.0..=1e9).contains(&seconds) {
        return Ok((seconds * 1e6).round() as u64);
    }
    let found = seconds.to_string();
    Err(errors::value("seconds", &found, "simulated seconds, 0 or more", "give how far time advances"))
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
