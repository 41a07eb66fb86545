//! A download as Barrett's host software does it: a character a frame, each after the board has asked for it.

use tater_wire::download::START;
use tater_wire::{Destination, Frame, Identifier, Node as Id, Property};

use super::{OverCan, Watched};

/// Characters of a line that Barrett's software reads.
const LINE: usize = 98;

/// How long the host waits for a board to ask on, us: it may erase a page of the staging first. The real one waits for ever.
const ASKS_US: u64 = 30_000_000;

/// From the last character to a monitor that answers again, us: it sums up the whole image.
const CHECK_US: u64 = 5_000_000;

/// Every so many characters progress is told.
const TOLD: u64 = 1024;

impl<S: Watched> OverCan<S> {
    /// Downloads a `.tek` file to a board whose monitor runs.
    ///
    /// # Errors
    /// The board does not ask on, or refuses the file: ERROR says why.
    pub fn download(&mut self, node: Id, tek: &[u8]) -> Result<(), String> {
        self.set(node, Property::VERS, i64::from(START))?;
        let to = Identifier { from: Id::HOST, to: Destination::Node(node) };
        let mut done = 0;
        // The first character of a line is skipped, and one below '0' ends it.
        for line in tek.split_inclusive(|&byte| byte == b'\n').flat_map(|line| line.chunks(LINE)) {
            for &character in line.iter().skip(1).take_while(|&&character| character >= b'0') {
                // Any frame of the board is the go-ahead.
                let deadline = self.bus.now_us() + ASKS_US;
                let asked = std::iter::from_fn(|| self.bus.wait(deadline)).any(|s| s.frame.id().from == node);
                self.check()?;
                if !asked {
                    return Err(format!(
                        "node {}: asked for no more after {done} characters of the download\n  next: is its monitor running?",
                        node.number()
                    ));
                }
                // One byte fits a frame, and the host is plugged since the beginning.
                let _ = self.bus.send(Frame::new(to, &[character]).unwrap_or(Frame::EMPTY));
                done += 1;
                if done % TOLD == 0 {
                    self.tell("download", done, tek.len() as u64);
                }
            }
        }
        self.until(node, Property::STAT, 0, CHECK_US)?;
        self.until(node, Property::ERROR, 0, CHECK_US)
    }
}
