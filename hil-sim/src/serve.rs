//! Serves the bus and the hand in real time, for programs that expect hardware.
//!
//! Simulated time follows the clock that is passed in and never waits for a client; on a slow machine it falls behind with a
//! warning.

mod args;
mod bus;
pub mod can;
mod discovery;
pub mod event;
mod hand;
mod link;
mod pace;
mod pty;
mod tcp;
mod telnet;
mod truth;

pub use args::BusArgs;
pub use bus::bus;
pub use hand::{HandArgs, hand};
