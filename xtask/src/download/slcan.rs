//! SLCAN (Lawicel) over TCP, host side: the subset that a download needs.

use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::{Duration, Instant};

use tater_wire::Frame;

use super::adapter::{Adapter, is_timeout};
use crate::Failure;

/// Timeout for a connection or a sent frame.
const PATIENCE: Duration = Duration::from_secs(5);

/// Longest valid line: a frame of eight bytes with a time-stamp, or an error text.
const LONGEST: usize = 200;

/// This many rejected frames in a row are an error, not a full queue: as many as a board requests at once.
const REFUSED: u32 = 16;

pub struct Slcan {
    stream: TcpStream,
    address: String,
    /// Received part of a line.
    line: Vec<u8>,
    /// Received bytes after it.
    read: VecDeque<u8>,
    /// Frames rejected since the last other answer.
    refused: u32,
}

enum Heard {
    /// A line: a frame, or a result.
    Line(Vec<u8>),
    /// BEL: rejected.
    Refusal,
}

impl Slcan {
    /// Connects, and opens the channel at 1 Mbit/s.
    ///
    /// # Errors
    /// No listener, an adapter in use, or another bit rate.
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
        let mut this = Self { stream, address: address.to_owned(), line, read, refused: 0 };
        this.open().map_err(Failure::Unusable)?;
        Ok(this)
    }

    fn open(&mut self) -> Result<(), String> {
        // Close the channel (BEL if none was open) and drop earlier frames: the version ends these answers.
        self.ask(b"\rC\rV\r", |heard| matches!(heard, Heard::Line(line) if line.starts_with(b"V")))?;
        for (command, what) in [("S8", "1 Mbit/s (S8)"), ("O", "to open its channel (O)")] {
            if let Heard::Refusal = self.ask(format!("{command}\r").as_bytes(), |_| true)? {
                return Err(format!(
                    "--slcan {}: the adapter does not open at 1 Mbit/s: it refuses {what}\n  next: end other programs \
                     that use it, switch it off and on; or use one that can do 1 Mbit/s",
                    self.address
                ));
            }
        }
        Ok(())
    }

    fn ask(&mut self, text: &[u8], wanted: impl Fn(&Heard) -> bool) -> Result<Heard, String> {
        self.write(text)?;
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            if let Some(heard) = self.hear(PATIENCE)?.filter(&wanted) {
                return Ok(heard);
            }
        }
        let found = format!("--slcan {}: connected, but no SLCAN adapter answers within 5 s", self.address);
        Err(format!("{found}\n  next: check what listens there"))
    }

    fn write(&mut self, text: &[u8]) -> Result<(), String> {
        self.stream.write_all(text).map_err(|error| self.lost(&error.to_string()))
    }

    fn lost(&self, why: &str) -> String {
        format!(
            "--slcan {}: the adapter is lost: {why}\n  next: check its cable and power, and download again; the board \
             keeps its old application",
            self.address
        )
    }

    /// The next answer, within a time that is not 0.
    fn hear(&mut self, wait: Duration) -> Result<Option<Heard>, String> {
        if let Some(heard) = self.take()? {
            return Ok(Some(heard));
        }
        let mut bytes = [0; 1024];
        let set = self.stream.set_read_timeout(Some(wait));
        match set.and_then(|()| self.stream.read(&mut bytes)) {
            Ok(0) => Err(self.lost("it has hung up")),
            Ok(len) => {
                self.read.extend(&bytes[..len]);
                self.take()
            }
            Err(error) if is_timeout(error.kind()) => Ok(None),
            Err(error) => Err(self.lost(&error.to_string())),
        }
    }

    /// Takes received bytes up to the end of the next answer.
    fn take(&mut self) -> Result<Option<Heard>, String> {
        while let Some(byte) = self.read.pop_front() {
            match byte {
                b'\r' => {
                    let line = std::mem::take(&mut self.line);
                    // `hil-sim bus` explains a hang-up in such a line.
                    return match line.strip_prefix(b"error: ") {
                        Some(why) => {
                            Err(format!("--slcan {}: {}", self.address, String::from_utf8_lossy(why)))
                        }
                        None => Ok(Some(Heard::Line(line))),
                    };
                }
                7 => {
                    self.line.clear();
                    return Ok(Some(Heard::Refusal));
                }
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
        match self.hear(wait)? {
            Some(Heard::Line(line)) => {
                self.refused = 0;
                Ok(parse(&line))
            }
            // A full queue: the frame is lost and the protocol repeats it, unless all are rejected.
            Some(Heard::Refusal) if self.refused + 1 < REFUSED => {
                self.refused += 1;
                Ok(None)
            }
            Some(Heard::Refusal) => Err(format!(
                "--slcan {}: the adapter refuses {REFUSED} frames in a row\n  next: check that a board is on its bus \
                 (power, cable, termination), since its queue stays full while nobody answers; then download again",
                self.address
            )),
            None => Ok(None),
        }
    }
}

/// Parses `tiiildd...`, with or without a time-stamp; `None` for other frames.
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
    fn only_standard_data_frames_are_parsed() {
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
