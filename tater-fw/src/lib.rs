//! The application of a motor board, over a trait for its hardware: all that a Tater does and that needs no register.
//!
//! [`Tater`] has the servo, properties, the bus and reports; what it keeps without power is in [`boot::storage`]. The hardware is
//! [`Board`]: the metal implements it with registers, the simulator with a plant. Time is passed in, never read.
#![no_std]
#![forbid(unsafe_code)]
// Runs on the board: no panic, no index out of bounds; a test may.
#![cfg_attr(
    not(test),
    deny(
        clippy::indexing_slicing,
        clippy::string_slice,
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable
    )
)]

#[cfg(test)]
extern crate std;
// The fake board is compiled here and in the system tests.
#[cfg(test)]
extern crate self as tater_fw;

mod bind;
pub mod board;
pub mod codes;
pub mod conformance;
pub mod events;
pub mod find;
pub mod motion;
mod set_error;
pub mod tater;

pub use board::{Analog, Board};
pub use set_error::SetError;
pub use tater::Tater;
