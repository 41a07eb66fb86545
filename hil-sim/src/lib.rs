//! Hardware in the loop without the hardware: the motor, its joint, its sensors and its bridge.
#![forbid(unsafe_code)]

pub mod replay;
