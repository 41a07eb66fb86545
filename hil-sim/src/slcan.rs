//! Lawicel SLCAN, the text protocol of serial CAN adapters (CAN232/CANUSB manuals, Lawicel AB), from the adapter's side and
//! without I/O: bytes in, frames and answers out. CR acknowledges a command, BEL refuses it. The grammar of a frame is the host library's,
//! for both sides ([`wraptor::slcan::line`]).
//!
//! The simulated bus runs at 1 Mbit/s and carries data frames with 11-bit identifiers. Other bit rates (S0 to S7, other `s`
//! registers), extended and remote frames (T, R, r) and acceptance masks that would hide a frame (m) get BEL and change nothing:
//! a tool that tries other rates first, or ignores the answer, is served at 1 Mbit/s. Frames are forwarded unasked, as after X1;
//! there is no polling.

use tater_wire::Frame;
use wraptor::slcan::line::{self, hex};

use hil_world::bus::Stamped;

/// One more than the longest command, a `t` with eight bytes, so that a longer line is refused.
const MAX_LINE: usize = 1 + 3 + 1 + 16 + 1;

const CR: u8 = b'\r';
const BEL: u8 = 7;

/// Time stamps wrap after a minute (CAN232 manual: 0 to 0xEA5F ms).
const STAMP_MS: u64 = 60_000;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Channel {
    #[default]
    Closed,
    Open,
    Listening,
}

/// An adapter's state.
#[derive(Clone, Debug, Default)]
pub struct Slcan {
    line: Vec<u8>,
    channel: Channel,
    stamps: bool,
    is_listener: bool,
}

impl Slcan {
    /// An adapter on a bus that already has its host: it opens like any other, but answers `t` with BEL.
    #[must_use]
    pub fn listener() -> Self {
        Self { is_listener: true, ..Self::default() }
    }

    /// Handles a byte from the host. Appends the answer to `out` if the byte ends a command; returns a frame to send, if any.
    /// Skips LF: some tools end lines with CR LF.
    pub fn push(&mut self, byte: u8, out: &mut Vec<u8>) -> Option<Frame> {
        match byte {
            CR => {
                let line = std::mem::take(&mut self.line);
                let frame = self.command(&line, out);
                // Reuse the allocation.
                self.line = line;
                self.line.clear();
                return frame;
            }
            b'\n' => {}
            _ if self.line.len() < MAX_LINE => self.line.push(byte),
            _ => {}
        }
        None
    }

    /// Appends a frame from the bus for the host; nothing while the channel is closed.
    pub fn frame(&self, stamped: &Stamped, out: &mut Vec<u8>) {
        if self.channel == Channel::Closed {
            return;
        }
        let ms = u16::try_from(stamped.at_us / 1000 % STAMP_MS).ok().filter(|_| self.stamps);
        out.extend(line::format(&stamped.frame, ms).bytes());
        out.push(CR);
    }

    fn command(&mut self, line: &[u8], out: &mut Vec<u8>) -> Option<Frame> {
        let closed = self.channel == Channel::Closed;
        let answer: Option<&str> = match *line {
            // An empty line clears the input of an earlier program; python-can sends one as its data bit rate.
            [] => Some(""),
            [b'S', b'8'] if closed => Some(""),
            [b's', ref registers @ ..] if closed && is_1_mbit(registers) => Some(""),
            [b'O'] if closed => {
                self.channel = if self.is_listener { Channel::Listening } else { Channel::Open };
                Some("")
            }
            [b'L'] if closed => {
                self.channel = Channel::Listening;
                Some("")
            }
            [b'C'] if !closed => {
                self.channel = Channel::Closed;
                Some("")
            }
            [b't', ..] if self.channel == Channel::Open => {
                let frame = line::frame(line);
                out.extend(if frame.is_some() { &b"z\r"[..] } else { &[BEL] });
                return frame;
            }
            // Status flags: no full queue, no error.
            [b'F'] if !closed => Some("F00"),
            [b'V'] => Some("V0100"),
            [b'N'] => Some("NTATR"),
            [b'Z', on @ (b'0' | b'1')] if closed => {
                self.stamps = on == b'1';
                Some("")
            }
            // The mask makes the code irrelevant.
            [b'M', ref code @ ..] if closed && code.len() == 8 && hex(code).is_some() => Some(""),
            [b'm', ref mask @ ..] if closed && mask.len() == 8 && hex(mask) == Some(0xFFFF_FFFF) => Some(""),
            [b'X', b'0' | b'1'] if closed => Some(""),
            _ => None,
        };
        match answer {
            Some(text) => {
                out.extend(text.bytes());
                out.push(CR);
            }
            None => out.push(BEL),
        }
        None
    }
}

/// Whether BTR0 and BTR1 of an SJA1000 at 16 MHz, as four digits, make 1 Mbit/s: eight quanta of 125 ns.
fn is_1_mbit(registers: &[u8]) -> bool {
    let Some(value) = hex(registers).filter(|_| registers.len() == 4) else { return false };
    let (prescaler, first, second) = ((value >> 8 & 0x3F) + 1, (value & 0xF) + 1, (value >> 4 & 7) + 1);
    prescaler * (1 + first + second) == 8
}

#[cfg(test)]
mod tests;
