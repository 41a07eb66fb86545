//! Runs the image of `cargo xtask image` on emulated boards: faults at the pins, wedged tasks, budgets.

pub mod bench;
mod budgets;
mod conformance;
mod faults;
mod heat;
mod motions;
mod probes;
mod scenarios;
mod shared_bus;
mod torture;
mod tuned;
mod wedged;
mod wiring;
