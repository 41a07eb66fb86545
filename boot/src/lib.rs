//! What every board does after a reset, and what it keeps without power. Knows no motor and no register.
//!
//! The [`monitor`] runs after a reset: it takes downloads and starts the application. Both programs keep their
//! non-volatile state in [`storage`]. The hardware is a [`Chip`]: the metal implements it with registers, the simulator with a
//! rig. Time is passed in, never read.
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

pub mod chip;
pub mod conformance;
pub mod identity;
pub mod lock;
pub mod monitor;
pub mod storage;
#[cfg(test)]
mod tests;

pub use chip::{Chip, Flash, FlashError};
pub use monitor::Monitor;
