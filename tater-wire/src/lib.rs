//! The protocol of the hand's CAN bus, as Barrett's published host software speaks it: parsing and emitting, no behavior.
//!
//! `no_std`, without heap or clock. Parsing never panics, whatever the bytes, and `Message::parse` inverts `Message::frame`.
//! `docs/wire.md` in the repository describes the same protocol for a host.
//!
//! | module | subject |
//! |---|---|
//! | [`id`], [`frame`] | nodes, groups and the 11-bit identifier; the bytes of a frame |
//! | [`message`], [`value`] | what a frame means: GET, SET, replies, packed torques |
//! | [`property`], [`command`], [`mode`], [`end`], [`fault`] | the tables: every property, and the values of CMD, MODE, END and ERROR |
//! | [`tek`], [`download`] | a firmware file, and how it is sent to a board |
//! | [`image`], [`map`] | the header that the monitor checks; what a memory map is |
//!
//! # Example
//! A host starts a move of motor 4, and reads the position in the reply.
//! ```
//! use tater_wire::{Body, Destination, Frame, Message, Node, Property};
//!
//! let motor = Node::new(4).expect("1 to 7");
//! let move_to = Message::set(Destination::Node(motor), Property::M, 200).expect("it fits 32 bits").frame();
//! assert_eq!((move_to.raw_id(), move_to.data()), (0x004, &[0x80 | 58, 0, 200, 0, 0, 0][..]));
//!
//! // GET P: the reply has 22 bits, most significant byte first, and goes to group 3.
//! let get = Message::get(Destination::Node(motor), Property::P).frame();
//! assert_eq!(get.data(), [48]);
//! let reply = Frame::from_raw(0x483, &[0x80, 0x00, 0xC8]).expect("11 bits and 3 bytes");
//! let message = Message::parse(&reply).expect("a position");
//! assert_eq!((message.from, message.body), (motor, Body::Position(200)));
//! ```
#![no_std]
#![forbid(unsafe_code)]
// Input from the bus is not trusted: no panic, no index out of bounds, except in tests.
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
pub mod find;
pub mod frame;
pub mod id;
pub mod image;
pub mod map;
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
