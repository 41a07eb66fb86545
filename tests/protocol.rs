//! What a host and the boards say to each other.

#[allow(dead_code, reason = "tater-fw's own tests use all of it")]
#[path = "../tater-fw/src/tater/tests/board.rs"]
mod board;
mod locked;
mod properties;
