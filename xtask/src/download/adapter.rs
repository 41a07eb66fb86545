//! The interface of a CAN adapter for a download.

use std::io::ErrorKind;
use std::time::Duration;

use tater_wire::Frame;

/// A connection to the bus.
pub trait Adapter {
    /// Sends a frame, or loses it.
    fn send(&mut self, frame: &Frame) -> Result<(), String>;

    /// The next frame from the bus, if one arrives within this time, which is not 0; `None` may also come
    /// earlier.
    fn receive(&mut self, wait: Duration) -> Result<Option<Frame>, String>;
}

/// Whether a read only timed out.
pub const fn is_timeout(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}
