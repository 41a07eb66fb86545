//! The motor board: an STM32F103CB, its pins, peripherals and timing (`docs/board.md`).
//!
//! It decides nothing: each function only reads or writes registers. The numbers ([`pins`], [`timing`],
//! [`scale`]) are compiled on a host too, where they are tested; the rest has registers. All of the project's `unsafe` is here.

pub mod digital;
pub mod pins;
pub mod scale;
pub mod timing;

#[cfg(target_os = "none")]
mod adc;
#[cfg(target_os = "none")]
mod address;
#[cfg(target_os = "none")]
pub mod can;
#[cfg(target_os = "none")]
pub mod clocks;
#[cfg(target_os = "none")]
mod flash;
#[cfg(target_os = "none")]
mod halls;
#[cfg(target_os = "none")]
mod memory;
#[cfg(target_os = "none")]
pub mod metal;
#[cfg(target_os = "none")]
mod pwm;
#[cfg(target_os = "none")]
pub mod stop;
#[cfg(target_os = "none")]
mod watchdog;

#[cfg(target_os = "none")]
pub use metal::Metal;
