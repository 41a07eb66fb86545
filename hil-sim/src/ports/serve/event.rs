//! What the threads that wait for sockets report, and what all servers share.

use std::net::TcpStream;
use std::time::Duration;

use tater_wire::Frame;

use crate::experiment::input::BadInput;

/// Real time since the start in µs; `None` ends the service.
pub type Clock<'a> = &'a mut dyn FnMut() -> Option<u64>;

/// Longest wait for a host: boards answer a request within half a millisecond, and hosts poll every millisecond.
pub const WAIT: Duration = Duration::from_micros(200);

/// Longest stretch of simulated time between two looks at the sockets, µs.
pub const SLICE_US: u64 = 2_000;

/// Events that may wait; then the threads that read sockets do.
pub const EVENTS: usize = 16;

/// What a thread reports.
pub enum Event {
    /// A client wants to be the host.
    Client(Arrival),
    /// Bytes of the client of that number.
    Bytes(u64, Vec<u8>),
    /// The client of that number is gone.
    Gone(u64),
    /// A frame from the CAN interface.
    Frame(Frame),
    /// The CAN interface is gone.
    Lost(String),
}

/// What a client comes for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Door {
    /// Grasper Control Language.
    Gcl,
    /// SLCAN.
    Slcan,
}

/// A client that has connected.
pub struct Arrival {
    /// Its connection.
    pub stream: TcpStream,
    /// Its address.
    pub peer: String,
    /// What it came for.
    pub door: Door,
}

/// An error of the command line.
pub fn bad(place: String, found: &str, expected: &str, next: &str) -> BadInput {
    BadInput {
        place,
        problem: "cannot be served".to_owned(),
        found: found.to_owned(),
        expected: expected.to_owned(),
        next: next.to_owned(),
    }
}
