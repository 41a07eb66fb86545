//! Assembles lines from the host's bytes: echo, backspace, line ends (manual 5.1.1, decision 0025).
//!
//! Every character but CR and LF is echoed in its own case: clients compare the echo with what they sent. LF ends a line as well, because a
//! person's `nc` sends it; CR LF and LF CR end one line.

use heapless::String;

use crate::io::{Io, NEVER};

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
}

pub(crate) async fn read(io: &Io) -> Input {
    let mut line = String::new();
    let mut too_long = false;
    loop {
        let byte =
            io.wait_until(NEVER, || if io.take_abort() { Some(None) } else { io.try_read().map(Some) }).await;
        let is_second = io.is_second_line_end(byte.flatten().filter(|&byte| matches!(byte, CR | LF)));
        match byte.flatten() {
            None => return Input::Abort,
            Some(CR | LF) if is_second => {}
            Some(CR | LF) if too_long => return Input::TooLong,
            Some(CR | LF) => return Input::Line(line),
            Some(BACKSPACE | DELETE) => {
                if line.pop().is_some() {
                    io.write(b"\x08 \x08").await;
                }
            }
            // Printable characters and white space; other bytes are ignored.
            Some(byte @ (b' '..=b'~' | b'\t')) => {
                too_long |= line.push(char::from(byte)).is_err();
                io.write(&[byte]).await;
            }
            Some(_) => {}
        }
    }
}
