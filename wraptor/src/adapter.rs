//! Frames of a bus of motor boards, by an SLCAN adapter or by a CAN interface of Linux.

use std::io::ErrorKind;

use tater_wire::Frame;

use crate::deadline::Deadline;
use crate::error::{Cause, Failure};
use crate::port::{Port, Waker};
use crate::slcan::Slcan;

/// What an adapter has not carried at the first attempt, since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Health {
    /// Times that it refused a frame; each was sent again.
    pub refusals: u64,
    /// Received lines that should have been frames and were none.
    pub damaged: u64,
}

/// An open adapter.
pub(crate) enum Adapter {
    Slcan(Box<Slcan>),
    #[cfg(target_os = "linux")]
    Can(Port),
}

impl Adapter {
    /// Opens an SLCAN adapter over TCP, `HOST:PORT`, at 1 Mbit/s.
    ///
    /// # Errors
    /// The cause.
    pub fn slcan(address: &str, deadline: &Deadline) -> Result<Self, Cause> {
        let port = Port::tcp(address, deadline).map_err(|cause| match cause {
            Cause::NothingListens | Cause::NoAnswer(_) | Cause::Unreachable(_) => {
                Cause::NoAdapter(cause.to_string())
            }
            cause => cause,
        })?;
        Slcan::open(port, deadline).map(Box::new).map(Self::Slcan)
    }

    /// The same on a serial port, such as `/dev/ttyACM0`.
    ///
    /// # Errors
    /// The same.
    #[cfg(unix)]
    pub fn slcan_serial(path: &str, baud: u32, deadline: &Deadline) -> Result<Self, Cause> {
        Slcan::open(Port::tty(path, baud)?, deadline).map(Box::new).map(Self::Slcan)
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

    /// Whether frames of a download follow, so that an SLCAN adapter need not acknowledge one before the next is sent.
    pub const fn stream(&mut self, is_streaming: bool) {
        match self {
            Self::Slcan(slcan) => slcan.is_streaming = is_streaming,
            #[cfg(target_os = "linux")]
            Self::Can(_) => {}
        }
    }

    /// Closes and opens an SLCAN adapter that may have left the bus.
    ///
    /// # Errors
    /// The adapter is gone.
    pub fn reopen(&mut self, deadline: &Deadline) -> Result<(), Failure> {
        match self {
            Self::Slcan(slcan) => slcan.reopen(deadline).map_err(|error| Failure::Lost(error.to_string())),
            #[cfg(target_os = "linux")]
            Self::Can(_) => Ok(()),
        }
    }

    /// Frames refused, and lines that should have been frames, since the adapter was opened.
    pub const fn health(&self) -> Health {
        match self {
            Self::Slcan(slcan) => Health { refusals: slcan.refusals, damaged: slcan.damaged },
            #[cfg(target_os = "linux")]
            Self::Can(_) => Health { refusals: 0, damaged: 0 },
        }
    }
}
