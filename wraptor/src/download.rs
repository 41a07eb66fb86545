//! Downloads of firmware (the manual's downloadFirmware), over a hand's packets or a bus: `tater_wire::download` with a connection, a clock
//! and limits. The board keeps its old application until the new one is whole, so that a lost connection, a cancel or a limit do no harm.

use std::ops::ControlFlow;
use std::time::Duration;

use tater_wire::download::{Downloader, Next};
use tater_wire::{Frame, Node};

use crate::deadline::Deadline;
use crate::error::Failure;
use crate::firmware::Firmware;

/// Longest time between two calls of progress.
const TICK: Duration = Duration::from_millis(200);

/// How far a download has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DownloadProgress {
    /// The board.
    pub node: Node,
    /// Time since the start of the call.
    pub elapsed: Duration,
    /// Characters sent; fewer than before after a repetition. All of them: the board copies, checks and starts the application.
    pub characters: u32,
    /// Characters of the file.
    pub of: u32,
}

impl DownloadProgress {
    /// Percent sent, 0 to 100.
    #[must_use]
    pub fn percent(&self) -> u32 {
        let percent = u64::from(self.characters) * 100 / u64::from(self.of.max(1));
        u32::try_from(percent).unwrap_or(100)
    }
}

/// Called at least every 200 ms during a download; [`ControlFlow::Break`] cancels it.
pub type OnDownload<'a> = &'a mut dyn FnMut(&DownloadProgress) -> ControlFlow<()>;

/// What carries frames to boards.
pub(crate) trait Link {
    fn send(&mut self, frame: &Frame, deadline: &Deadline) -> Result<(), Failure>;

    /// The next frame; `None` at the deadline.
    fn receive(&mut self, deadline: &Deadline) -> Result<Option<Frame>, Failure>;
}

/// Downloads to one board and waits until it runs the new application.
pub(crate) fn download(
    link: &mut dyn Link,
    node: Node,
    firmware: &Firmware,
    deadline: &Deadline,
    progress: OnDownload,
) -> Result<(), Failure> {
    let start = Deadline::after(deadline.remaining());
    let now = || u64::try_from(start.elapsed().as_micros()).unwrap_or(u64::MAX);
    let mut host = Downloader::new(node, firmware.text(), now());
    let mut told = Duration::ZERO;
    loop {
        if deadline.is_over() {
            return Err(Failure::TimedOut(deadline.limit()));
        }
        match host.next(now()) {
            Next::Send(frame) => link.send(&frame, deadline)?,
            Next::Wait(until) => {
                let wait = Duration::from_micros(until.saturating_sub(now()).max(1)).min(TICK);
                let heard = link.receive(&deadline.within(wait))?;
                if let Some(frame) = &heard {
                    host.receive(frame, now());
                }
                // A board that requests quickly would call it thousands of times a second.
                if heard.is_some() && start.elapsed() < told + TICK / 10 {
                    continue;
                }
                told = start.elapsed();
                let (characters, of) = host.progress();
                if progress(&DownloadProgress { node, elapsed: deadline.elapsed(), characters, of })
                    .is_break()
                {
                    return Err(Failure::Cancelled);
                }
            }
            Next::Done => return Ok(()),
            Next::Failed(error) => return Err(Failure::Download { node, error }),
        }
    }
}
