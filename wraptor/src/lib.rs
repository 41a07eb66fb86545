//! Host library of a robot hand: its language and RealTime over TCP or a serial port, and its motor boards over CAN.
//!
//! Every call has a limit and returns within it. A connection has one thread, which reads and otherwise sleeps in the kernel; it ends with the
//! connection. A connection that fails names its [`Cause`] and the next step.
//!
//! | module | subject |
//! |---|---|
//! | [`hand`] | [`Hand`]: connect, commands, motions, parameters, properties, RealTime |
//! | [`bus`] | [`Bus`]: motor boards over SLCAN, a CAN interface, or packets through a hand |
//! | [`discovery`] | hands in the network |
//! | [`firmware`] | a `.tek` file, checked |
//! | [`download`] | how far a download has come |
//! | [`turns`] | one connection for several threads |
//! | [`slcan::line`] | lines of SLCAN, for both sides of an adapter |
//! | `error` | [`ConnectError`], [`CallError`] |
//! | `session`, `interpreter`, `adapter`, `slcan`, `port`, `deadline` | lines, GOD in this program, adapters, connections, time; from the top down |
//!
//! # Example
//! ```no_run
//! use std::time::Duration;
//! use wraptor::{Hand, no_progress};
//!
//! let s = Duration::from_secs;
//! let mut hand = Hand::connect("127.0.0.1:11001", s(5))?;
//! hand.init(s(30), &mut no_progress)?;
//! hand.close("G", s(20), &mut no_progress)?;
//! println!("{:?}", hand.parameter("G", "P", s(1))?);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

mod adapter;
pub mod bus;
mod deadline;
pub mod discovery;
pub mod download;
mod error;
pub mod firmware;
pub mod hand;
mod interpreter;
mod port;
mod session;
pub mod slcan;
pub mod turns;

pub use adapter::Health;
pub use bus::Bus;
pub use deadline::Deadline;
pub use discovery::{Found, discover};
pub use download::DownloadProgress;
pub use error::{CallError, Cause, ConnectError, Failure};
pub use firmware::{FileError, Firmware, FirmwareError};
pub use hand::{
    Axis, BoardState, Boards, Canceller, Connect, Control, Feedback, Format, Hand, Progress, RealTime,
    Statistics, no_progress,
};
pub use port::configure_tcp;
pub use tater_wire::{FaultCode, Frame, Node, Property};
pub use turns::{NoTurn, Turns};
