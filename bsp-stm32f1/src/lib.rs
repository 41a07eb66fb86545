//! Drivers of an STM32F1, for the programs of a motor board.
//!
//! They decide nothing: each function only reads or writes registers. [`timing`] is compiled on a host too, where it is
//! tested; the rest has registers. All of the project's `unsafe` for the hardware is here.
//!
//! A board passes in its memory map (`flash::Mapped`) and, by symbols of its linker script, what a fatal error does first
//! (`stop`).
#![no_std]
// Runs on the board: no panic, no index out of bounds.
#![deny(
    clippy::indexing_slicing,
    clippy::string_slice,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::unreachable
)]

pub mod timing;

#[cfg(target_os = "none")]
pub mod adc;
#[cfg(target_os = "none")]
mod address;
#[cfg(target_os = "none")]
pub mod can;
#[cfg(target_os = "none")]
pub mod clock;
#[cfg(target_os = "none")]
pub mod clocks;
#[cfg(target_os = "none")]
pub mod flash;
#[cfg(target_os = "none")]
pub mod halls;
#[cfg(target_os = "none")]
mod memory;
#[cfg(target_os = "none")]
pub mod pwm;
#[cfg(target_os = "none")]
pub mod stop;
#[cfg(target_os = "none")]
pub mod system;
#[cfg(target_os = "none")]
pub mod watchdog;
