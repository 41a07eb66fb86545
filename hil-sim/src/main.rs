//! `hil-sim`: run scenarios of the servo against the motor's plant.
#![forbid(unsafe_code)]
fn main() {}
