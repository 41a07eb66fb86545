//! GOD, the General Operations Device: speaks Grasper Control Language (manual 5) and RealTime (6) to the host, and CAN to the seven motor
//! boards of a robot hand.
//!
//! `no_std`, no heap, no clock, no port: bytes and frames go in and out through [`Io`], time is passed in, and what survives a power-off is in
//! [`Memory`]. GOD is one future, [`run`], which the owner of the ports polls after each byte, frame or deadline. It never blocks, needs no
//! waker, and bounds every wait for the bus.
//!
//! ```
//! use core::pin::pin;
//! use god::{Io, Memory, io};
//!
//! let (io, memory) = (Io::default(), Memory::default());
//! let mut god = pin!(god::run(&io, &memory));
//! // A host presses Return.
//! io.push_rx(b'\r');
//! let next_us = io::poll(god.as_mut(), &io, 0);
//! let answer: String = std::iter::from_fn(|| io.pop_tx()).map(char::from).collect();
//! assert!(answer.ends_with("\r\n\r=> "));
//! // Without further input, GOD has to be polled again in a minute, when it stores its hours of operation.
//! assert_eq!(next_us, 60_000_000);
//! ```
//!
//! # Layers
//! Imports point downwards only.
//!
//! | layer | modules |
//! |---|---|
//! | shell | [`shell`]: start, prompt, line, dispatch |
//! | commands | `movement`, `realtime`, `settings`, `sequences`, `administration`, `walk_through` |
//! | motion | `motion`: prepare, start, follow, judge, restore; `pace`: motors that arrive together |
//! | queries and orders | `query`: what boards are asked; `order`: what they are told |
//! | context | [`god`](mod@god): ports, memory, boards, parameters, session |
//! | link and state | [`boards`]: questions, answers, reports; [`session`]: what outlives a command; [`memory`]: what outlives the power |
//! | ports | [`io`]: bytes, frames, time; [`framing`]: where packets begin and end; [`events`]: the log; [`line`](mod@line): lines of the host |
//! | tables | [`grammar`], [`command`], [`parameter`], [`status`], [`motors`], [`units`] |
#![no_std]
#![forbid(unsafe_code)]
// Input from host and bus is never trusted: no panic, no index out of bounds; tests may.
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
pub mod framing;
pub mod god;
pub mod grammar;
pub mod io;
pub mod line;
pub mod memory;
mod motion;
pub mod motors;
mod movement;
mod order;
mod pace;
mod packets;
pub mod parameter;
mod query;
mod realtime;
mod sequences;
pub mod session;
mod settings;
mod shared;
pub mod shell;
pub mod status;
#[cfg(test)]
mod testing;
pub mod units;
mod walk_through;
mod words;

pub use io::Io;
pub use memory::Memory;
pub use motors::Motors;
pub use shell::run;
pub use status::Status;

// What `run` keeps in RAM on a board: 7 KiB at most.
#[cfg(target_pointer_width = "32")]
const _: () = {
    const fn future_bytes<'a, T: core::future::Future>(_: &impl Fn(&'a Io, &'a Memory) -> T) -> usize {
        size_of::<T>()
    }
    assert!(future_bytes(&run) <= 7 * 1024, "GOD's future is too large for its board");
};
