//! Assembles lines and packets from the host's bytes: echo, backspace, line ends (manual 5.1.1, decision 0025).
//!
//! Every character but CR and LF is echoed in its own case: clients compare the echo with what they sent. LF ends a line as well, because a
//! person's `nc` sends it; CR LF and LF CR end one line, and so does Telnet's CR NUL. No byte vanishes: one that the language has no use for
//! makes its line unreadable. Those from 0x80 on are echoed, because clients count the echo; control characters are not, because a 0x04
//! would look like a packet.

use heapless::{String, Vec};

use crate::framing::Packet;
use crate::io::{Io, NEVER, Rx};

/// Longest line: the length of a sequence (manual 5.2.4) and a few more.
pub const LENGTH: usize = 160;

const CR: u8 = b'\r';
const LF: u8 = b'\n';
const NUL: u8 = 0;
const BACKSPACE: u8 = 8;
const DELETE: u8 = 0x7F;

/// Input of the host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Input {
    /// A line without its end.
    Line(String<LENGTH>),
    /// A line that does not fit; all of it is dropped.
    TooLong,
    /// A line with a byte that is no character of the language: read without it, the line could mean something else (decision 0054).
    Unreadable,
    /// ^C.
    Abort,
    /// A whole packet.
    Packet(Packet),
    /// A packet that broke off, or whose length is wrong.
    BrokenPacket,
}

/// A line under way.
#[derive(Default)]
struct Draft {
    bytes: Vec<u8, LENGTH>,
    is_too_long: bool,
    /// It has a control character.
    is_unreadable: bool,
}

impl Draft {
    /// Removes the last character, of UTF-8 if its bytes are. Returns whether there was one.
    fn erase(&mut self) -> bool {
        let is_character = |&length: &usize| {
            let start = self.bytes.len().checked_sub(length);
            let text = start.and_then(|start| core::str::from_utf8(self.bytes.get(start..)?).ok());
            text.is_some_and(|text| text.chars().count() == 1)
        };
        let length = (1..=4).find(is_character).unwrap_or(1);
        (0..length).all(|_| self.bytes.pop().is_some())
    }

    fn end(self) -> Input {
        match core::str::from_utf8(&self.bytes) {
            _ if self.is_too_long => Input::TooLong,
            Ok(text) if text.is_ascii() && !self.is_unreadable => {
                // It is no longer than a line.
                text.try_into().map_or(Input::TooLong, Input::Line)
            }
            _ => Input::Unreadable,
        }
    }
}

pub(crate) async fn read(io: &Io) -> Input {
    let mut draft = Draft::default();
    loop {
        let byte = match read_rx(io).await {
            None => return Input::Abort,
            Some(Rx::Text(byte)) => byte,
            Some(Rx::Head(head)) => {
                io.is_second_line_end(None);
                match read_packet(io, head).await {
                    Headed::Input(input) => return input,
                    Headed::Text(byte) => byte,
                    Headed::Nothing => continue,
                }
            }
            // Its head is gone: only after bytes were lost.
            Some(Rx::Data(_)) => continue,
            Some(Rx::Broken) => return Input::BrokenPacket,
        };
        let is_second = io.is_second_line_end(Some(byte).filter(|&byte| matches!(byte, CR | LF)));
        match byte {
            CR | LF if is_second => {}
            CR | LF => return draft.end(),
            BACKSPACE | DELETE if !draft.erase() => {}
            BACKSPACE | DELETE => io.write(b"\x08 \x08").await,
            // A filler: it prints nothing and means nothing.
            NUL => {}
            byte @ (b' '..=b'~' | b'\t' | 0x80..) => {
                draft.is_too_long |= draft.bytes.push(byte).is_err();
                io.write(&[byte]).await;
            }
            _ => draft.is_unreadable = true,
        }
    }
}

/// Reads the next input; `None` is ^C.
async fn read_rx(io: &Io) -> Option<Rx> {
    let read = io.wait_until(NEVER, || {
        let found = if io.take_abort() { Some(None) } else { io.try_read_rx().map(Some) };
        found.or_else(|| io.wait_for_line(false))
    });
    read.await.flatten()
}

/// What a byte that may begin a packet was.
enum Headed {
    /// The first of a packet, whole or broken, or of what ends in ^C.
    Input(Input),
    /// A NUL, and the text behind it.
    Text(u8),
    /// Alone: a NUL, or a serial line's break to a port that cannot tell; it is ignored.
    Nothing,
}

/// Reads the rest of a packet, which comes or breaks off (`Io::end_broken_packet`).
async fn read_packet(io: &Io, head: u8) -> Headed {
    let mut packet = Packet::new();
    let mut byte = head;
    loop {
        // The framing admits no longer one.
        let _ = packet.push(byte);
        match *packet {
            // CR NUL CR NUL of Telnet: an empty line. As a packet it would be a frame without data, which nobody understands.
            [NUL, CR, 0] => return Headed::Input(Input::Line(String::new())),
            [_, _, len, ref data @ ..] if data.len() == usize::from(len) => {
                return Headed::Input(Input::Packet(packet));
            }
            _ => {}
        }
        byte = match read_rx(io).await {
            None => return Headed::Input(Input::Abort),
            Some(Rx::Data(byte)) => byte,
            Some(Rx::Broken) if packet.len() == 1 => return Headed::Nothing,
            Some(Rx::Text(byte)) if *packet == [NUL] => return Headed::Text(byte),
            Some(Rx::Head(NUL)) if *packet == [NUL] => {
                packet.clear();
                NUL
            }
            // A head or text: only after bytes were lost.
            Some(_) => return Headed::Input(Input::BrokenPacket),
        };
    }
}
