//! Hardware in the loop without the hardware: the motor, its joint, its sensors and its bridge.
//!
//! [`run`] runs a [`scenario::Scenario`] and gives an [`Outcome`]; the binary `hil-sim` is a thin shell around
//! it. The library reads no clock: time is simulated, and the same seed gives the same outcome.
#![forbid(unsafe_code)]

pub mod board;
pub mod bus;
pub mod grasper;
pub mod hand;
pub mod metrics;
pub mod node;
pub mod over_can;
pub mod plant;
pub mod properties;
pub mod replay;
pub mod report;
pub mod rig;
mod run;
pub mod scenario;
pub mod slcan;
pub mod trace;

pub use plant::Model;
pub use run::{MotorRun, Options, Outcome, board, node_of, rig, run, set};
pub use servo_core::MotorKind;
pub use tater_fw::motion::motor;

/// The properties of a kind of motor before anybody sets one.
#[must_use]
pub const fn defaults(motor: MotorKind) -> servo_core::Config {
    servo_core::Config::for_motor(motor)
}
