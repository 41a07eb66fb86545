//! The image that `cargo xtask image` has made, executed: faults at the pins, wedged tasks, budgets.

pub mod bench;
mod budgets;
mod faults;
mod probes;
mod scenarios;
mod wedged;
