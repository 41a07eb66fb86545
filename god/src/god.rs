//! The context that all commands share: ports, memory, boards, session; and how an answer is printed.

use core::cell::Cell;

use heapless::String;

use crate::boards::Boards;
use crate::io::{Io, TEXT};
use crate::memory::Memory;
use crate::session::Session;
use crate::words::{Word, append, words};

/// Precedes an answer, an error and the prompt: some clients look for LF CR, others for CR LF; this has both (decision 0025).
pub const LINE_END: &str = "\r\n\r";

/// The prompt.
pub const PROMPT: &str = "=> ";

/// Printed at the start, before a line with the version. After RESET Barrett's own library searches for "BarrettHand Firmware" with LF behind
/// it, in an answer whose end it has trimmed: more than white space has to follow.
pub const BANNER: &str = "GOD of a BarrettWraptor, as BarrettHand Firmware";

/// Between the banner's lines: LF alone is what that library accepts, LF CR what the hand it was written for sends.
const BANNER_LINE_END: &str = "\n\r";

/// The version of GOD's software: that of the boards it is made for.
pub const VERSION: u16 = 600;

pub(crate) type Text = String<TEXT>;

/// State shared by all commands.
pub struct God<'a> {
    pub(crate) io: &'a Io,
    pub(crate) memory: &'a Memory,
    pub(crate) boards: Boards<'a>,
    pub(crate) session: Session,
    /// UPSECS includes the time up to this, µs.
    pub(crate) counted_us: Cell<u64>,
}

impl<'a> God<'a> {
    pub(crate) fn new(io: &'a Io, memory: &'a Memory) -> Self {
        let stored = memory.read(|stored| stored.parameters);
        memory.change_parameters(|parameters| *parameters = stored);
        Self {
            io,
            memory,
            boards: Boards::new(io),
            session: Session::default(),
            counted_us: Cell::new(io.now_us()),
        }
    }

    pub(crate) async fn print_line(&self, line: &[Word<'_>]) {
        let mut text = Text::new();
        append(&mut text, words![LINE_END]);
        append(&mut text, line);
        self.io.write(text.as_bytes()).await;
    }

    pub(crate) async fn banner(&self) {
        self.print_line(words![BANNER, BANNER_LINE_END, "Version ", VERSION]).await;
    }

    pub(crate) async fn prompt(&self) {
        self.print_line(words![PROMPT]).await;
    }
}
