//! Frames of a bus of motor boards, by an SLCAN adapter or by a CAN interface of Linux.

use std::io::ErrorKind;

use tater_wire::Frame;

use crate::deadline::Deadline;
use crate::error::{Cause, Failure};
use crate::port::{Port, Waker};
use crate::slcan::Slcan;

/// An open adapter.
pub(crate) enum Adapter {
    Slcan(Slcan),
    #[cfg(target_os = "linux")]
    Can(Port),
}

impl Adapter {
    /// Opens an SLCAN adapter over TCP, `HOST:PORT`, at 1 Mbit/s.
    ///
    /// # Errors
    /// The cause.
    pub fn slcan(address: &str, deadline: &Deadline) -> Result<Self, Cause> {
        Slcan::open(Port::tcp(address, deadline)?, deadline).map(Self::Slcan)
    }

    /// The same on a serial port, such as `/dev/ttyACM0`.
    ///
    /// # Errors
    /// The same.
    #[cfg(unix)]
    pub fn slcan_serial(path: &str, baud: u32, deadline: &Deadline) -> Result<Self, Cause> {
        Slcan::open(Port::tty(path, baud)?, deadline).map(Self::Slcan)
    }

    /// Opens a CAN interface of Linux, such as `can0`, which is up at 1 Mbit/s.
    ///
    /// # Errors
    /// There is none.
    #[cfg(target_os = "linux")]
    pub fn can(interface: &str) -> Result<Self, Cause> {
        Port::can(interface).map(Self::Can)
    }

    /// Sends a frame.
    ///
    /// # Errors
    /// The adapter is gone, or takes nothing until the deadline.
    pub fn send(&mut self, frame: &Frame, deadline: &Deadline) -> Result<(), Failure> {
        let sent = match self {
            Self::Slcan(slcan) => slcan.send(frame, deadline),
            #[cfg(target_os = "linux")]
            Self::Can(port) => port.send(frame, deadline),
        };
        sent.map_err(|error| match error.kind() {
            ErrorKind::TimedOut => Failure::TimedOut(deadline.limit()),
            _ => Failure::Lost(error.to_string()),
        })
    }

    /// What ends a wait of [`Self::receive`] from another thread.
    pub fn waker(&self) -> Waker {
        match self {
            Self::Slcan(slcan) => slcan.waker(),
            #[cfg(target_os = "linux")]
            Self::Can(port) => port.waker(),
        }
    }

    /// The next frame; `None` at the deadline, or before it after [`Waker::wake`].
    ///
    /// # Errors
    /// The adapter is gone.
    pub fn receive(&mut self, deadline: &Deadline) -> Result<Option<Frame>, Failure> {
        match self {
            Self::Slcan(slcan) => slcan.receive(deadline),
            #[cfg(target_os = "linux")]
            Self::Can(port) => loop {
                match port.receive(deadline) {
                    Ok(Some(crate::port::Event::Frame(frame))) => return Ok(Some(frame)),
                    Ok(Some(_)) => {}
                    Ok(None) => return Ok(None),
                    Err(why) => return Err(Failure::Lost(why)),
                }
            },
        }
    }

    /// Whether the adapter has refused a frame since the last call, and a new value of that.
    pub const fn set_refused(&mut self, to: bool) -> bool {
        match self {
            Self::Slcan(slcan) => std::mem::replace(&mut slcan.has_refused, to),
            #[cfg(target_os = "linux")]
            Self::Can(_) => false,
        }
    }
}
