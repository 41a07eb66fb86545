//! A CAN adapter of this computer, for a host of one real or served board: SLCAN over TCP, or a CAN interface of Linux.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use tater_wire::Frame;

use super::interrupt;
use crate::tuning::excite::Link;

/// Time limit of a connection and of the adapter's answers.
const PATIENCE: Duration = Duration::from_secs(5);

/// Longest valid line: a frame of eight bytes with a time-stamp, or an error text.
const LONGEST: usize = 200;

/// Real time since the program started.
type Clock<'a> = &'a dyn Fn() -> Duration;

fn us(clock: Clock) -> u64 {
    u64::try_from(clock().as_micros()).unwrap_or(u64::MAX)
}

const fn is_timeout(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

/// An SLCAN (Lawicel) adapter over TCP.
pub struct Slcan<'a> {
    stream: TcpStream,
    address: String,
    line: Vec<u8>,
    clock: Clock<'a>,
}

impl<'a> Slcan<'a> {
    /// Connects, and opens the channel at 1 Mbit/s.
    ///
    /// # Errors
    /// No listener, or an adapter that does not answer.
    pub fn connect(address: &str, clock: Clock<'a>) -> Result<Self, String> {
        let failed = |error: std::io::Error| {
            format!(
                "--slcan {address}: {error}\n  next: give HOST:PORT of an SLCAN adapter, such as `hil-sim bus --node 4 --slcan {address}`"
            )
        };
        let target = address.to_socket_addrs().map_err(failed)?.next();
        let target = target.ok_or_else(|| failed(ErrorKind::AddrNotAvailable.into()))?;
        let stream = TcpStream::connect_timeout(&target, PATIENCE).map_err(failed)?;
        stream.set_nodelay(true).map_err(failed)?;
        stream.set_write_timeout(Some(PATIENCE)).map_err(failed)?;
        let mut this = Self { stream, address: address.to_owned(), line: Vec::new(), clock };
        this.open()?;
        Ok(this)
    }

    fn open(&mut self) -> Result<(), String> {
        // The version's answer ends those of earlier commands.
        self.write(b"\rC\rV\r")?;
        let until_us = us(self.clock) + PATIENCE.as_micros() as u64;
        while !self.line(until_us)?.is_some_and(|line| line.starts_with(b"V")) {
            if us(self.clock) >= until_us {
                return Err(format!(
                    "--slcan {}: no SLCAN adapter answers\n  next: check what listens there",
                    self.address
                ));
            }
        }
        self.write(b"S8\rO\r")
    }

    fn write(&mut self, text: &[u8]) -> Result<(), String> {
        self.stream.write_all(text).map_err(|error| self.lost(&error.to_string()))
    }

    fn lost(&self, why: &str) -> String {
        format!(
            "--slcan {}: the adapter is lost: {why}\n  next: check its cable and power; the board idles by itself after HOSTMS",
            self.address
        )
    }

    /// The next line, or `None` at a time.
    fn line(&mut self, until_us: u64) -> Result<Option<Vec<u8>>, String> {
        let mut byte = [0];
        loop {
            let left_us = until_us.saturating_sub(us(self.clock));
            if left_us == 0 {
                return Ok(None);
            }
            let set = self.stream.set_read_timeout(Some(Duration::from_micros(left_us)));
            match set.and_then(|()| self.stream.read(&mut byte)) {
                Ok(0) => return Err(self.lost("it has hung up")),
                Ok(_) if byte[0] == b'\r' || byte[0] == 7 => {
                    let line = std::mem::take(&mut self.line);
                    return match line.strip_prefix(b"error: ") {
                        Some(why) => Err(self.lost(&String::from_utf8_lossy(why))),
                        None => Ok(Some(line)),
                    };
                }
                Ok(_) if self.line.len() < LONGEST => self.line.push(byte[0]),
                Ok(_) => {}
                Err(error) if is_timeout(error.kind()) => {}
                Err(error) => return Err(self.lost(&error.to_string())),
            }
        }
    }
}

impl Link for Slcan<'_> {
    fn now_us(&self) -> u64 {
        us(self.clock)
    }

    fn send(&mut self, frame: &Frame) -> Result<(), String> {
        let mut text = format!("t{:03X}{}", frame.raw_id(), frame.data().len());
        frame.data().iter().for_each(|byte| text.push_str(&format!("{byte:02X}")));
        text.push('\r');
        self.write(text.as_bytes())
    }

    fn receive(&mut self, until_us: u64) -> Result<Option<(u64, Frame)>, String> {
        while let Some(line) = self.line(until_us)? {
            if let Some(frame) = parse(&line) {
                return Ok(Some((us(self.clock), frame)));
            }
        }
        Ok(None)
    }

    fn is_interrupted(&self) -> bool {
        interrupt::interrupted()
    }
}

/// Parses `tiiildd...`, with or without a time-stamp; `None` for anything else.
fn parse(line: &[u8]) -> Option<Frame> {
    let text = std::str::from_utf8(line).ok()?;
    let text = &text[text.find('t')?..];
    let id = u16::from_str_radix(text.get(1..4)?, 16).ok()?;
    let len: usize = text.get(4..5)?.parse().ok()?;
    let digits = text.get(5..5 + 2 * len)?;
    let byte = |at| u8::from_str_radix(digits.get(at..at + 2)?, 16).ok();
    let data: Option<Vec<u8>> = (0..2 * len).step_by(2).map(byte).collect();
    Frame::from_raw(id, &data?)
}

/// A CAN interface of Linux.
///
/// # Errors
/// No interface of that name.
#[cfg(target_os = "linux")]
pub fn interface<'a>(name: &str, clock: Clock<'a>) -> Result<Box<dyn Link + 'a>, String> {
    use socketcan::{CanSocket, Socket};
    let socket = CanSocket::open(name).map_err(|error| {
        format!("--can {name}: {error}\n  next: set the interface up: `sudo ip link set {name} up type can bitrate 1000000`")
    })?;
    Ok(Box::new(linux::Interface { socket, name: name.to_owned(), clock }))
}

/// Only Linux has CAN interfaces.
///
/// # Errors
/// Always fails.
#[cfg(not(target_os = "linux"))]
pub fn interface<'a>(name: &str, _: Clock<'a>) -> Result<Box<dyn Link + 'a>, String> {
    Err(format!("--can {name}: only Linux has CAN interfaces\n  next: use --slcan"))
}

#[cfg(target_os = "linux")]
mod linux {
    use std::time::Duration;

    use socketcan::{CanFrame, CanSocket, EmbeddedFrame, Frame as _, Socket, StandardId};
    use tater_wire::Frame;

    use super::super::interrupt;
    use super::{Clock, is_timeout, us};
    use crate::tuning::excite::Link;

    pub struct Interface<'a> {
        pub socket: CanSocket,
        pub name: String,
        pub clock: Clock<'a>,
    }

    impl Link for Interface<'_> {
        fn now_us(&self) -> u64 {
            us(self.clock)
        }

        fn send(&mut self, frame: &Frame) -> Result<(), String> {
            let there = StandardId::new(frame.raw_id()).and_then(|id| CanFrame::new(id, frame.data()));
            // Both types hold 11 bits and at most eight bytes.
            let Some(there) = there else { return Ok(()) };
            self.socket.write_frame(&there).map_err(|error| {
                let name = &self.name;
                format!("--can {name}: sending failed: {error}\n  next: check the cable: without an acknowledge the queue fills")
            })
        }

        fn receive(&mut self, until_us: u64) -> Result<Option<(u64, Frame)>, String> {
            loop {
                let left_us = until_us.saturating_sub(self.now_us());
                if left_us == 0 {
                    return Ok(None);
                }
                let set = self.socket.set_read_timeout(Duration::from_micros(left_us));
                match set.and_then(|()| self.socket.read_frame()) {
                    Ok(CanFrame::Data(data)) if !data.is_extended() => {
                        let frame = u16::try_from(data.raw_id()).ok();
                        if let Some(frame) = frame.and_then(|id| Frame::from_raw(id, data.data())) {
                            return Ok(Some((self.now_us(), frame)));
                        }
                    }
                    Ok(_) => {}
                    Err(error) if is_timeout(error.kind()) => {}
                    Err(error) => {
                        let name = &self.name;
                        return Err(format!(
                            "--can {name}: the interface is lost: {error}\n  next: check the adapter"
                        ));
                    }
                }
            }
        }

        fn is_interrupted(&self) -> bool {
            interrupt::interrupted()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_standard_data_frames_are_parsed() {
        let frame = Frame::from_raw(0x486, &[0x85, 0, 2, 0]);
        assert_eq!(parse(b"t486485000200"), frame);
        assert_eq!(parse(b"zt4864850002001F2A"), frame, "after an acknowledge, with a time-stamp");
        for line in
            [&b""[..], b"z", b"V0100", b"t4864850002", b"t0019000000000000000000", b"t48\xC3\xA9", b"T"]
        {
            assert_eq!(parse(line), None, "{line:?}");
        }
    }
}
