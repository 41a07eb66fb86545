//! The host's bytes become a line: echo, backspace, CR (manual 5.1.1; PROTOCOL 3).
//!
//! Every character is echoed in its own case, but the CR: what clients read back must be what they sent. LF ends a line as well, because
//! that is what a person's `nc` sends; both together, in either order, end one line.

use heapless::String;

use crate::io::{Io, NEVER};

/// Longest line: a sequence's length (manual 5.2.4) and a little more.
pub const LENGTH: usize = 160;

const CR: u8 = b'\r';
const LF: u8 = b'\n';
const BACKSPACE: u8 = 8;
const DELETE: u8 = 0x7F;

/// What a host has typed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Heard {
    /// A line without its end.
    Line(String<LENGTH>),
    /// A line that does not fit: none of it counts.
    TooLong,
    /// ^C.
    Abort,
}

/// Waits for a line.
pub(crate) async fn read(io: &Io) -> Heard {
    let mut line = String::new();
    let mut too_long = false;
    loop {
        let byte =
            io.wait_until(NEVER, || if io.take_abort() { Some(None) } else { io.try_read().map(Some) }).await;
        let is_other = io.is_second_line_end(byte.flatten().filter(|&byte| matches!(byte, CR | LF)));
        match byte.flatten() {
            None => return Heard::Abort,
            Some(CR | LF) if is_other => {}
            Some(CR | LF) if too_long => return Heard::TooLong,
            Some(CR | LF) => return Heard::Line(line),
            Some(BACKSPACE | DELETE) => {
                if line.pop().is_some() {
                    io.write(b"\x08 \x08").await;
                }
            }
            // Printable, and white space; everything else means nothing here.
            Some(byte @ (b' '..=b'~' | b'\t')) => {
                too_long |= line.push(char::from(byte)).is_err();
                io.write(&[byte]).await;
            }
            Some(_) => {}
        }
    }
}
