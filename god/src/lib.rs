//! GOD, the General Operations Device: speaks Grasper Control Language (manual 5) and RealTime (6) to the host, and CAN to the
//! seven motor boards.
//!
//! `no_std`, no heap, no clock, no port: bytes and frames go in and out through [`io::Io`], time is passed in, and what is to
//! survive a power-off is in [`memory::Memory`]. What GOD does is one future, [`god::run`], that whoever has the ports polls after each
//! byte, frame or deadline; it never blocks, and needs no waker.
//!
//! Where to look: the host's bytes become lines in [`mod@line`], lines become commands in [`words`]; which motors a prefix selects is in
//! [`motors`]; every command is a row of [`command`], every parameter one of [`parameter`], every status code one of
//! [`status`]; counts of the language and of the boards meet in [`units`] alone; [`boards`] talks to the boards.
#![no_std]
#![forbid(unsafe_code)]
// What comes from host and bus is never trusted: no panic, no index out of bounds; a test may.
#![cfg_attr(
    not(test),
    deny(
        clippy::indexing_slicing,
        clippy::string_slice,
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable
    )
)]

#[cfg(test)]
extern crate std;

mod administration;
pub mod boards;
pub mod command;
pub mod events;
pub mod god;
pub mod io;
pub mod line;
mod lower;
pub mod memory;
pub mod motors;
mod movement;
pub mod parameter;
mod realtime;
mod sequences;
mod settings;
pub mod status;
pub mod units;
pub mod words;

pub use god::run;
pub use io::Io;
pub use memory::Memory;
pub use motors::Motors;
pub use status::Status;
