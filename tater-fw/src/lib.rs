//! A motor board of the hand, over a trait for its hardware: all that a Tater does and that needs no register.
//!
//! Two programs share a board. The [`monitor`] runs after a reset: it takes downloads and starts the application.
//! The application is a [`tater`]: servo, properties, bus, reports. Both keep their non-volatile state in
//! [`storage`]. The hardware is [`board::Board`]: the metal implements it with registers, the simulator with a plant.
//! Time is passed in, never read.
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
mod lock;
pub mod monitor;
pub mod motion;
pub mod storage;
pub mod tater;

pub use board::{Analog, Board, Flash, FlashError};
pub use monitor::Monitor;
pub use tater::Tater;
