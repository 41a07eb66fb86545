//! A motor board without the board: a Cortex-M3 that runs the bytes that are flashed, with as much of an STM32F103 around it
//! as they touch, wired to the motor of `hil-sim`.
//!
//! From the inside out: [`cpu`] executes instructions, takes exceptions and counts both; [`chip`] is memory and
//! peripherals; [`machine`] is both with time; [`board`] puts the chip's pins to the motor, its sensors and the bus.
#![forbid(unsafe_code)]

pub mod analog;
pub mod board;
pub mod bridge;
pub mod chip;
pub mod cpu;
pub mod gdb;
pub mod image;
pub mod machine;
pub mod meter;
pub mod rtt;
pub mod session;
pub mod stop;
pub mod time;
