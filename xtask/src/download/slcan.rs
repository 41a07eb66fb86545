//! The host's side of Lawicel SLCAN over TCP: as little of it as a download needs.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use tater_wire::Frame;

use super::Adapter;
use crate::Failure;

/// How long an adapter may take to be reached, or to take a frame.
const PATIENCE: Duration = Duration::from_secs(5);

/// Characters of the longest line that means something: a frame of eight bytes with a time-stamp, or a refusal in words.
const LONGEST: usize = 200;

/// An SLCAN adapter.
pub struct Slcan {
    stream: TcpStream,
    address: String,
    /// What has come of a line.
    line: Vec<u8>,
    /// What has come after it.
    read: VecDeque<u8>,
    /// Channel open: from here on BEL means that a frame was refused.
    open: bool,
}

impl Slcan {
    /// Connects, and opens the channel at 1 Mbit/s.
    ///
    /// # Errors
    /// Nobody listens there, or the adapter is in use.
    pub fn connect(address: &str) -> Result<Self, Failure> {
        let unusable = |error: std::io::Error| {
            Failure::Unusable(format!(
                "--slcan {address}: {error}\n  expected an SLCAN adapter, such as `hil-sim bus --node 4 --slcan {address}`"
            ))
        };
        let target = address.to_socket_addrs().map_err(unusable)?.next();
        let target = target.ok_or_else(|| unusable(ErrorKind::AddrNotAvailable.into()))?;
        let stream = TcpStream::connect_timeout(&target, PATIENCE).map_err(unusable)?;
        stream.set_nodelay(true).map_err(unusable)?;
        stream.set_write_timeout(Some(PATIENCE)).map_err(unusable)?;
        let (line, read) = (Vec::new(), VecDeque::new());
        let mut this = Self { stream, address: address.to_owned(), line, read, open: false };
        // Whatever was open is closed: refused if nothing was. The version ends what is answered to that.
        this.write(b"\rC\rS8\rO\rV\r").map_err(Failure::Unusable)?;
        let begun = Instant::now();
        while !this.open {
            // What comes without an end, or is a frame of the bus, is not the answer.
            this.receive(PATIENCE).map_err(Failure::Unusable)?;
            if !this.open && begun.elapsed() >= PATIENCE {
                let found = format!("--slcan {address}: connected, but no SLCAN adapter answers within 5 s");
                return Err(Failure::Unusable(format!("{found}\n  check what listens there")));
            }
        }
        Ok(this)
    }

    fn write(&mut self, text: &[u8]) -> Result<(), String> {
        self.stream.write_all(text).map_err(|error| self.lost(&error.to_string()))
    }

    fn lost(&self, why: &str) -> String {
        format!("--slcan {}: the adapter is lost: {why}", self.address)
    }

    /// Takes the bytes that have come up to the next frame.
    fn frame(&mut self) -> Result<Option<Frame>, String> {
        while let Some(byte) = self.read.pop_front() {
            match byte {
                b'\r' => {
                    let line = std::mem::take(&mut self.line);
                    if line.starts_with(b"error: ") {
                        return Err(format!("--slcan {}: {}", self.address, String::from_utf8_lossy(&line)));
                    }
                    self.open |= line.starts_with(b"V");
                    let frame = parse(&line);
                    if frame.is_some() {
                        return Ok(frame);
                    }
                }
                7 if self.open => {
                    return Err(format!("--slcan {}: the adapter refuses a frame", self.address));
                }
                7 => self.line.clear(),
                _ if self.line.len() < LONGEST => self.line.push(byte),
                _ => {}
            }
        }
        Ok(None)
    }
}

impl Adapter for Slcan {
    fn send(&mut self, frame: &Frame) -> Result<(), String> {
        let mut text = format!("t{:03X}{}", frame.raw_id(), frame.data().len());
        frame.data().iter().for_each(|byte| text.push_str(&format!("{byte:02X}")));
        text.push('\r');
        self.write(text.as_bytes())
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Frame>, String> {
        if let Some(frame) = self.frame()? {
            return Ok(Some(frame));
        }
        let mut bytes = [0; 1024];
        let set = self.stream.set_read_timeout(Some(wait));
        match set.and_then(|()| self.stream.read(&mut bytes)) {
            Ok(0) => Err(self.lost("it has hung up")),
            Ok(len) => {
                self.read.extend(&bytes[..len]);
                self.frame()
            }
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) =>
            {
                Ok(None)
            }
            Err(error) => Err(self.lost(&error.to_string())),
        }
    }
}

/// `tiiildd...`, perhaps with a time-stamp; anything else is no frame for us.
fn parse(line: &[u8]) -> Option<Frame> {
    let text = std::str::from_utf8(line).ok()?.strip_prefix('t')?;
    let id = u16::from_str_radix(text.get(..3)?, 16).ok()?;
    let len: usize = text.get(3..4)?.parse().ok()?;
    let digits = text.get(4..4 + 2 * len)?;
    let byte = |at| u8::from_str_radix(digits.get(at..at + 2)?, 16).ok();
    let data: Option<Vec<u8>> = (0..2 * len).step_by(2).map(byte).collect();
    Frame::from_raw(id, &data?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_frames_or_nothing() {
        let frame = Frame::from_raw(0x486, &[0x85, 0, 2, 0]);
        assert_eq!(parse(b"t486485000200"), frame);
        assert_eq!(parse(b"t4864850002001F2A"), frame, "with a time-stamp");
        for line in [
            &b""[..],
            b"z",
            b"V0100",
            b"t4864850002",
            b"t8000",
            b"t0019000000000000000000",
            b"t48\xC3\xA9",
            b"T",
        ] {
            assert_eq!(parse(line), None, "{line:?}");
        }
    }
}
