//! Assembles lines and packets from the host's bytes: echo, backspace, line ends (manual 5.1.1, decision 0025).
//!
//! Every character but CR and LF is echoed in its own case: clients compare the echo with what they sent. LF ends a line as well, because a
//! person's `nc` sends it; CR LF and LF CR end one line.

use heapless::String;

use crate::framing::Packet;
use crate::io::{Io, NEVER, Rx};

/// Longest line: the length of a sequence (manual 5.2.4) and a few more.
pub const LENGTH: usize = 160;

const CR: u8 = b'\r';
const LF: u8 = b'\n';
const BACKSPACE: u8 = 8;
const DELETE: u8 = 0x7F;

/// Input of the host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Input {
    /// A line without its end.
    Line(String<LENGTH>),
    /// A line that does not fit; all of it is dropped.
    TooLong,
    /// ^C.
    Abort,
    /// A whole packet.
    Packet(Packet),
    /// A packet that broke off, or whose length is wrong.
    BrokenPacket,
}

pub(crate) async fn read(io: &Io) -> Input {
    let mut line = String::new();
    let mut too_long = false;
    loop {
        let byte = match read_rx(io).await {
            None => return Input::Abort,
            Some(Rx::Text(byte)) => byte,
            Some(Rx::Head(head)) => {
                io.is_second_line_end(None);
                match read_packet(io, head).await {
                    Some(input) => return input,
                    None => continue,
                }
            }
            // Its head is gone: only after bytes were lost.
            Some(Rx::Data(_)) => continue,
            Some(Rx::Broken) => return Input::BrokenPacket,
        };
        let is_second = io.is_second_line_end(Some(byte).filter(|&byte| matches!(byte, CR | LF)));
        match byte {
            CR | LF if is_second => {}
            CR | LF if too_long => return Input::TooLong,
            CR | LF => return Input::Line(line),
            BACKSPACE | DELETE if line.pop().is_none() => {}
            BACKSPACE | DELETE => io.write(b"\x08 \x08").await,
            // Printable characters and white space; other bytes are ignored.
            byte @ (b' '..=b'~' | b'\t') => {
                too_long |= line.push(char::from(byte)).is_err();
                io.write(&[byte]).await;
            }
            _ => {}
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

/// Reads the rest of a packet, which comes or breaks off (`Io::end_broken_packet`). `None`: a head alone, which a serial line's break looks
/// like; it is ignored.
async fn read_packet(io: &Io, head: u8) -> Option<Input> {
    let mut packet = Packet::new();
    let mut byte = head;
    loop {
        // The framing admits no longer one.
        let _ = packet.push(byte);
        if packet.get(2).is_some_and(|&len| packet.len() == 3 + usize::from(len)) {
            return Some(Input::Packet(packet));
        }
        byte = match read_rx(io).await {
            None => return Some(Input::Abort),
            Some(Rx::Data(byte)) => byte,
            Some(Rx::Broken) if packet.len() == 1 => return None,
            // A head or text: only after bytes were lost.
            Some(_) => return Some(Input::BrokenPacket),
        };
    }
}
