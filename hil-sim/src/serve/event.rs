//! Reports of the threads that wait for sockets, and items shared by the servers.

use std::net::TcpStream;
use std::time::Duration;

use tater_wire::Frame;

use traces::input::BadInput;

/// Real time since the start in µs; `None` ends the service.
pub type Clock<'a> = &'a mut dyn FnMut() -> Option<u64>;

/// Longest wait for an event: boards answer a request within half a millisecond, and hosts poll every millisecond.
pub const WAIT: Duration = Duration::from_micros(200);

/// Longest stretch of simulated time between two polls of the sockets, µs.
pub const SLICE_US: u64 = 2_000;

/// Events queued before the threads that read sockets block.
pub const EVENTS: usize = 16;

pub enum Event {
    Client(NewClient),
    /// Bytes of the client with this number.
    Bytes(u64, Vec<u8>),
    /// The client with this number sends nothing more, and may still read.
    InputEnded(u64),
    /// The client with this number neither sends nor reads.
    Gone(u64),
    #[cfg_attr(not(target_os = "linux"), expect(dead_code, reason = "CAN interfaces are Linux's"))]
    Frame(Frame),
    #[cfg_attr(not(target_os = "linux"), expect(dead_code, reason = "CAN interfaces are Linux's"))]
    Lost(String),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    Gcl,
    Slcan,
    Truth,
}

pub struct NewClient {
    pub stream: TcpStream,
    pub peer: String,
    pub protocol: Protocol,
}

/// An error of the command line.
pub fn bad(place: String, found: &str, expected: &str, next: &str) -> BadInput {
    BadInput::new(place, "cannot be served").found(found).expected(expected).next(next)
}
