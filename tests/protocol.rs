//! A Tater as a host sees it over the bus.

#[allow(dead_code, reason = "tater-fw's own tests use all of it")]
#[path = "../tater-fw/src/tater/tests/board.rs"]
mod board;
pub(crate) mod download;
pub(crate) mod hosts;
mod image;
mod locked;
mod properties;
mod table;
mod tek;
mod wire;
