//! The words on the hand's bus, as Barrett's published host software speaks them, and nothing that acts on them.
//!
//! `no_std`, no heap, no clock: the motor boards, the board that speaks to the host, the simulator and the chores
//! all read and write the same bytes with this crate.
//!
//! Where to look: who speaks to whom is in [`id`], bytes on the wire in [`frame`], what they mean in [`message`],
//! every property in [`property`], the numbers of CMD in [`command`], what ERROR says in [`fault`]; downloads are
//! [`tek`] (the file), [`download`] (its way over the bus), [`image`] (the header that the monitor checks) and
//! [`memory`] (what lies where in flash).
#![no_std]
#![forbid(unsafe_code)]
// What comes from the bus is never trusted: no panic, no index out of bounds; a test may.
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

pub mod command;
pub mod download;
pub mod end;
pub mod fault;
pub mod frame;
pub mod id;
pub mod image;
pub mod memory;
pub mod message;
pub mod mode;
pub mod property;
pub mod tek;
pub mod value;

pub use command::Cmd;
pub use end::EndCode;
pub use fault::FaultCode;
pub use frame::Frame;
pub use id::{Destination, Group, Identifier, Node};
pub use message::{Body, Message, Torques};
pub use mode::ModeCode;
pub use property::{MotorKind, Property};
pub use value::Value;
