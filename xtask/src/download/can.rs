//! A CAN interface of Linux (SocketCAN).

use super::adapter::Adapter;
use crate::Failure;

/// # Errors
/// No interface of that name.
#[cfg(target_os = "linux")]
pub fn open(interface: &str) -> Result<Box<dyn Adapter>, Failure> {
    use socketcan::{CanSocket, Socket};
    let socket = CanSocket::open(interface).map_err(|error| {
        Failure::Unusable(format!(
            "--can {interface}: {error}\n  expected a CAN interface that is up (see `ip link`); `sudo ip link set {interface} up \
             type can bitrate 1000000` sets one up"
        ))
    })?;
    Ok(Box::new(linux::Interface { socket, name: interface.to_owned() }))
}

/// Only Linux has CAN interfaces.
///
/// # Errors
/// Always fails.
#[cfg(not(target_os = "linux"))]
pub fn open(interface: &str) -> Result<Box<dyn Adapter>, Failure> {
    Err(Failure::Unusable(format!("--can {interface}: only Linux has CAN interfaces\n  use --slcan")))
}

#[cfg(target_os = "linux")]
mod linux {
    use std::time::Duration;

    use socketcan::{CanFrame, CanSocket, EmbeddedFrame, Frame as _, Socket, StandardId};
    use tater_wire::Frame;

    use super::super::adapter::{Adapter, is_timeout};

    pub struct Interface {
        pub socket: CanSocket,
        pub name: String,
    }

    impl Adapter for Interface {
        fn send(&mut self, frame: &Frame) -> Result<(), String> {
            let there = StandardId::new(frame.raw_id()).and_then(|id| CanFrame::new(id, frame.data()));
            // Both types hold 11 bits and at most eight bytes.
            let Some(there) = there else { return Ok(()) };
            self.socket.write_frame_insist(&there).map_err(|error| {
                format!("--can {}: sending failed: {error}\n  next: check the cable: without an acknowledge the queue fills", self.name)
            })
        }

        fn receive(&mut self, wait: Duration) -> Result<Option<Frame>, String> {
            let lost = |error: std::io::Error| {
                format!(
                    "--can {}: the interface is lost: {error}\n  next: check the adapter, set it up again (`ip link`), and \
                     download again; the board keeps its old application",
                    self.name
                )
            };
            self.socket.set_read_timeout(wait).map_err(lost)?;
            match self.socket.read_frame() {
                Ok(CanFrame::Data(data)) if !data.is_extended() => {
                    Ok(u16::try_from(data.raw_id()).ok().and_then(|id| Frame::from_raw(id, data.data())))
                }
                Ok(_) => Ok(None),
                Err(error) if is_timeout(error.kind()) => Ok(None),
                Err(error) => Err(lost(error)),
            }
        }
    }
}
