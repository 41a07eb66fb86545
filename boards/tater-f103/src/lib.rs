//! The motor board: an STM32F103CB, its memory map, pins and analog scales (`docs/board.md`).
//!
//! It decides nothing. What describes the board ([`map`], [`pins`], [`scale`]) is compiled on a host too, where it is tested; the
//! rest is the metal's.
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

pub mod digital;
pub mod map;
pub mod pins;
pub mod scale;

#[cfg(target_os = "none")]
pub mod metal;
#[cfg(target_os = "none")]
pub use metal::Metal;
