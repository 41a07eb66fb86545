//! The interface of a CAN adapter.

use std::io::ErrorKind;
use std::time::Duration;

use tater_wire::Frame;

pub trait Adapter {
    /// Sends a frame; it may get lost.
    fn send(&mut self, frame: &Frame) -> Result<(), String>;

    /// Waits up to `wait`, which is not 0, for a frame; may return `None` earlier.
    fn receive(&mut self, wait: Duration) -> Result<Option<Frame>, String>;
}

/// Whether a read timed out or was interrupted.
pub const fn is_timeout(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}
