//! An SLCAN adapter (Lawicel CAN232/CANUSB manuals) from the host's side: commands out, frames and answers in.

use std::collections::VecDeque;

use tater_wire::Frame;

use crate::deadline::Deadline;
use crate::error::{Cause, Failure, beginning};
use crate::port::{Event, Port, Waker};

/// Longest valid line, bytes: a frame of eight bytes with a time-stamp, or an error text.
const LONGEST: usize = 200;

const BEL: u8 = 7;

/// An adapter with an open channel at 1 Mbit/s.
pub(crate) struct Slcan {
    port: Port,
    line: Vec<u8>,
    /// Received lines; `None`: BEL.
    lines: VecDeque<Option<Vec<u8>>>,
    /// Whether the adapter has refused a frame since the last question.
    pub has_refused: bool,
}

impl Slcan {
    /// Opens the channel at 1 Mbit/s.
    ///
    /// # Errors
    /// The cause.
    pub fn open(port: Port, deadline: &Deadline) -> Result<Self, Cause> {
        let mut slcan = Self { port, line: Vec::new(), lines: VecDeque::new(), has_refused: false };
        // Close the channel (BEL if none was open) and drop earlier frames: the version ends these answers.
        for (command, name) in [("\rC\rV\r", "V"), ("S8\r", "S8 (1 Mbit/s)"), ("O\r", "O")] {
            // An adapter that refuses a second host may have closed already: what it said comes first.
            let written = slcan.port.write(command.as_bytes(), deadline);
            let mut received = Vec::new();
            loop {
                match slcan.next_line(deadline) {
                    // An echo is no answer.
                    Ok(Some(Some(line)))
                        if line.len() > 1 && name.as_bytes().starts_with(&line)
                            || line == name.as_bytes() =>
                    {
                        return Err(Cause::NotAHand(beginning(&line)));
                    }
                    Ok(Some(Some(line))) if name != "V" || line.starts_with(b"V") => break,
                    Ok(Some(None)) if name != "V" => return Err(Cause::Refused(name.to_owned())),
                    Ok(Some(_)) if deadline.is_over() => return Err(Cause::NotAHand(beginning(&received))),
                    Ok(Some(line)) if received.len() < LONGEST => received.extend(line.unwrap_or_default()),
                    Ok(Some(_)) => {}
                    Ok(None) if received.is_empty() && slcan.line.is_empty() => {
                        return Err(Cause::Silent(deadline.limit()));
                    }
                    Ok(None) => {
                        received.extend(&slcan.line);
                        return Err(Cause::NotAHand(beginning(&received)));
                    }
                    Err(Gone::Refused(why)) => return Err(Cause::InUse(why)),
                    Err(Gone::Lost(why)) => {
                        return Err(Cause::HungUp(written.err().map_or(why, |error| error.to_string())));
                    }
                }
            }
        }
        Ok(slcan)
    }

    /// What ends a wait of [`Self::receive`] from another thread.
    pub fn waker(&self) -> Waker {
        self.port.waker()
    }

    /// Sends a frame. A refusal shows up later, in [`Self::has_refused`].
    ///
    /// # Errors
    /// The adapter is gone, or takes nothing until the deadline.
    pub fn send(&mut self, frame: &Frame, deadline: &Deadline) -> std::io::Result<()> {
        self.port.write(format(frame).as_bytes(), deadline)
    }

    /// The next frame; `None` at the deadline.
    ///
    /// # Errors
    /// The adapter is gone.
    pub fn receive(&mut self, deadline: &Deadline) -> Result<Option<Frame>, Failure> {
        loop {
            match self.next_line(deadline) {
                Ok(Some(Some(line))) => {
                    if let Some(frame) = parse(&line) {
                        return Ok(Some(frame));
                    }
                }
                Ok(Some(None)) => self.has_refused = true,
                Ok(None) => return Ok(None),
                Err(Gone::Refused(why) | Gone::Lost(why)) => return Err(Failure::Lost(why)),
            }
            // An adapter that sends without an end keeps no call.
            if deadline.is_over() && self.lines.is_empty() {
                return Ok(None);
            }
        }
    }

    fn next_line(&mut self, deadline: &Deadline) -> Result<Option<Option<Vec<u8>>>, Gone> {
        while self.lines.is_empty() {
            match self.port.receive(deadline) {
                Ok(Some(Event::Bytes(bytes))) => self.push(&bytes)?,
                Ok(Some(_)) => {}
                Ok(None) => return Ok(None),
                Err(why) => return Err(Gone::Lost(why)),
            }
            if deadline.is_over() && self.lines.is_empty() {
                return Ok(None);
            }
        }
        Ok(self.lines.pop_front())
    }

    fn push(&mut self, bytes: &[u8]) -> Result<(), Gone> {
        for byte in bytes {
            match byte {
                b'\r' => {
                    let line = std::mem::take(&mut self.line);
                    // A simulated bus explains a hang-up in such a line.
                    if let Some(why) = line.strip_prefix(b"error: ") {
                        return Err(Gone::Refused(String::from_utf8_lossy(why).into_owned()));
                    }
                    self.lines.push_back(Some(line));
                }
                &BEL => {
                    self.line.clear();
                    self.lines.push_back(None);
                }
                _ if self.line.len() < LONGEST => self.line.push(*byte),
                _ => {}
            }
        }
        Ok(())
    }
}

enum Gone {
    /// The adapter says why it hangs up.
    Refused(String),
    Lost(String),
}

fn format(frame: &Frame) -> String {
    let mut text = format!("t{:03X}{}", frame.raw_id(), frame.data().len());
    frame.data().iter().for_each(|byte| text.push_str(&format!("{byte:02X}")));
    text.push('\r');
    text
}

/// Parses `tiiildd...`, with or without a time-stamp; `None` for other lines.
fn parse(line: &[u8]) -> Option<Frame> {
    let text = std::str::from_utf8(line).ok()?;
    // `z` acknowledges a sent frame; some adapters leave out its CR.
    let text = text.strip_prefix('z').unwrap_or(text).strip_prefix('t')?;
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
    fn frame_round_trips_and_other_lines_are_none() {
        let frame = Frame::from_raw(0x486, &[0x85, 0, 2, 0]).expect("a classic frame");
        assert_eq!(format(&frame), "t486485000200\r");
        for line in [&b"t486485000200"[..], b"t4864850002001F2A", b"zt486485000200"] {
            assert_eq!(parse(line), Some(frame));
        }
        for line in [&b""[..], b"z", b"V0100", b"t4864850002", b"t8000", b"t48\xC3\xA9", b"T"] {
            assert_eq!(parse(line), None, "{line:?}");
        }
    }
}
