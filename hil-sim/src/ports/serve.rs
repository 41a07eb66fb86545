//! The bus and the hand served in real time, for programs that expect hardware.
//!
//! Simulated time follows the clock that is passed in and waits for nobody; where the machine is too slow it falls behind and
//! says so. Nothing here decides what happens on the bus or in the hand.

mod args;
mod bus;
mod can;
mod event;
mod hand;
mod link;
mod pace;
mod pty;
mod tcp;

pub use args::BusArgs;
pub use bus::bus;
pub use hand::{HandArgs, hand};
