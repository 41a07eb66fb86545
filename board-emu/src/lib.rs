//! An emulated motor board: a Cortex-M3 runs the flashed bytes, with as much of an STM32F103 around it as
//! they use, connected to the motor of `hil-sim`.
//!
//! From the inside out: [`cpu`] executes instructions and exceptions and counts them; [`chip`] is memory and
//! peripherals; [`machine`] advances both in time; [`board`] connects the pins to motor, sensors and bus.
#![forbid(unsafe_code)]

pub mod analog;
pub mod board;
pub mod bridge;
pub mod chip;
pub mod cpu;
pub mod gdb;
pub mod hand;
pub mod image;
pub mod machine;
pub mod meter;
pub mod rtt;
pub mod session;
pub mod stop;
pub mod time;
