//! A download as Barrett's host software does it: one character per frame, each on the board's request (docs/download.md).

use tater_wire::download::START;
use tater_wire::{Destination, Frame, Identifier, Node as Id, Property};

use super::{ObservedBoard, OverCan};

/// Characters of a line that Barrett's software reads.
const LINE: usize = 98;

/// Time limit for a board's request, us: it may erase a page of the staging area first. Barrett's software waits forever.
const ASKS_US: u64 = 30_000_000;

/// Time limit from the last character to an answering monitor, us: it checks the whole image first.
const CHECK_US: u64 = 5_000_000;

/// Characters between two progress reports.
const TOLD: u64 = 1024;

impl<S: ObservedBoard> OverCan<S> {
    /// Downloads a `.tek` file to a board whose monitor runs.
    ///
    /// # Errors
    /// The board stops requesting, or refuses the file, with the reason in ERROR.
    pub fn download(&mut self, node: Id, tek: &[u8]) -> Result<(), String> {
        self.set(node, Property::VERS, i64::from(START))?;
        let to = Identifier { from: Id::HOST, to: Destination::Node(node) };
        let mut done = 0;
        // The first character of a line is skipped, and one below '0' ends it.
        for line in tek.split_inclusive(|&byte| byte == b'\n').flat_map(|line| line.chunks(LINE)) {
            for &character in line.iter().skip(1).take_while(|&&character| character >= b'0') {
                // Any frame of the board is a request.
                let deadline = self.bus.now_us() + ASKS_US;
                let asked = std::iter::from_fn(|| self.bus.wait(deadline)).any(|s| s.frame.id().from == node);
                self.check()?;
                if !asked {
                    return Err(format!(
                        "node {}: asked for no more after {done} characters of the download\n  next: is its monitor running?",
                        node.number()
                    ));
                }
                // One byte fits a frame, and the host is connected.
                let _ = self.bus.send(Frame::new(to, &[character]).unwrap_or(Frame::EMPTY));
                done += 1;
                if done % TOLD == 0 {
                    self.report_progress("download", done, tek.len() as u64);
                }
            }
        }
        self.until(node, Property::STAT, 0, CHECK_US)?;
        self.until(node, Property::ERROR, 0, CHECK_US)
    }
}
