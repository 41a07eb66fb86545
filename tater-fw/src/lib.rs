//! A motor board of the hand, over a trait for its hardware: all that a Tater does and that needs no register.
//!
//! Two programs share a board. The [`monitor`] runs after a reset: it takes downloads and starts the application.
//! The application is a [`tater`]: servo, properties, bus, reports. Both keep their non-volatile state in
//! [`storage`]. The hardware is [`board::Board`]: the metal implements it with registers, the simulator with a plant.
//! Time is passed in, never read.
#![no_std]
// `unsafe` is for registers: everything but `bsp` forbids it.
#![deny(unsafe_code)]
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

#[forbid(unsafe_code)]
mod bind;
#[forbid(unsafe_code)]
pub mod board;
#[allow(unsafe_code, reason = "registers")]
pub mod bsp;
#[forbid(unsafe_code)]
pub mod codes;
#[forbid(unsafe_code)]
pub mod events;
#[forbid(unsafe_code)]
pub mod find;
#[forbid(unsafe_code)]
mod identity;
#[forbid(unsafe_code)]
mod lock;
#[forbid(unsafe_code)]
pub mod monitor;
#[forbid(unsafe_code)]
pub mod motion;
#[forbid(unsafe_code)]
mod set_error;
#[forbid(unsafe_code)]
pub mod storage;
#[forbid(unsafe_code)]
pub mod tater;

pub use board::{Analog, Board, Flash, FlashError};
pub use monitor::Monitor;
pub use set_error::SetError;
pub use tater::Tater;
