//! An SLCAN adapter from the host's side: commands out, frames and answers in ([`mod@line`] has the grammar of both sides).
//!
//! Adapters speak dialects. LAWICEL's acknowledge a command by CR and a frame by `z`, and refuse by BEL; CANable acknowledges nothing and
//! answers `V` with a hash; others end lines in CR LF, join `z` to the next line, send time stamps, or start anew when the port opens and are deaf for
//! 2 s. No profile says which: opening repeats until it has a sign that suffices, and sending learns from what comes back (decision 0071).
//! A time stamp that an adapter has stored is not turned off: the setting is its owner's.

use std::collections::VecDeque;
use std::io;
use std::time::Duration;

use tater_wire::{Destination, Frame, Group, Message, Property};

use crate::deadline::Deadline;
use crate::error::{Cause, Failure, beginning};
use crate::port::{Event, Port, Waker};

pub mod line;

use line::{Lines, Said};

/// Time for an answer in the first round of opening: an adapter takes 16 ms behind the slowest USB converter. Each round doubles it.
const ANSWER: Duration = Duration::from_millis(100);

/// The longest such time.
const ANSWER_MAX: Duration = Duration::from_secs(1);

/// The same when an open adapter is closed and opened.
const REOPEN: Duration = Duration::from_millis(30);

/// Least time between two such attempts.
const REOPEN_AFTER: Duration = Duration::from_millis(300);

/// Frames of a download that wait for their acknowledgment while none was refused.
const PIPELINE: usize = 32;

/// Frames of a download that are sent one by one after a refusal, since a board drops what follows a missing one and asks again only after 200 ms.
const ONE_BY_ONE: u32 = 64;

/// Time for an acknowledgment of an adapter that gives them.
const ACKNOWLEDGED: Duration = Duration::from_millis(100);

/// An adapter that has acknowledged commands and none of its first so many frames acknowledges no frame.
const UNACKNOWLEDGED: u32 = 3;

/// Time for the refusal of an adapter that has refused and acknowledges nothing: two frames of USB.
const REFUSED: Duration = Duration::from_millis(2);

/// Times that a frame is sent again at once. By chance alone, at 20 % refusals, one of 10^5 frames is refused so often.
const RESENDS: u8 = 7;

/// Most pieces that are taken without waiting: an adapter that sends without an end keeps no call.
const AT_ONCE: usize = 64;

/// Most received bytes kept for an error's text.
const KEPT: usize = 200;

/// What an adapter answers to a command.
#[derive(PartialEq, Eq)]
enum Answer {
    Nothing,
    Done,
    Refused,
    Text,
}

/// A frame that was sent and neither acknowledged nor refused.
struct Sent {
    frame: Frame,
    resends: u8,
}

/// An adapter with an open channel at 1 Mbit/s.
pub(crate) struct Slcan {
    port: Port,
    lines: Lines,
    said: VecDeque<Said>,
    frames: VecDeque<Frame>,
    /// The oldest first.
    flight: VecDeque<Sent>,
    /// What ends a command.
    end: &'static str,
    acknowledges: bool,
    /// Frames that it has not acknowledged; `None` after the first that it has.
    unacknowledged: Option<u32>,
    /// Whether frames of a download are sent, which need not arrive before the next.
    pub is_streaming: bool,
    /// Frames still to be sent one by one.
    careful: u32,
    /// Since it was closed and opened.
    reopened: Deadline,
    /// Whether the adapter has given up a frame since the last question.
    pub has_refused: bool,
    /// Frames that it has refused, each time counted.
    pub refusals: u64,
    /// Received lines that should be frames and are none.
    pub damaged: u64,
}

enum Gone {
    /// The adapter says why it hangs up.
    Refused(String),
    Lost(String),
}

impl From<Gone> for io::Error {
    fn from(gone: Gone) -> Self {
        let (Gone::Refused(why) | Gone::Lost(why)) = gone;
        Self::other(why)
    }
}

impl Slcan {
    /// Opens the channel at 1 Mbit/s, in rounds until the deadline.
    ///
    /// # Errors
    /// The cause.
    pub fn open(port: Port, deadline: &Deadline) -> Result<Self, Cause> {
        let mut slcan = Self {
            port,
            lines: Lines::default(),
            said: VecDeque::new(),
            frames: VecDeque::new(),
            flight: VecDeque::new(),
            end: "\r",
            acknowledges: false,
            unacknowledged: Some(0),
            is_streaming: false,
            careful: 0,
            reopened: Deadline::after(REOPEN_AFTER),
            has_refused: false,
            refusals: 0,
            damaged: 0,
        };
        let (mut wait, mut refused) = (ANSWER, None);
        let mut round = Round::default();
        for number in 1.. {
            // Every third round ends its commands as a terminal program may.
            let ends: &[&str] = if number % 3 == 0 { &["\r\n", "\r", "\r\n"] } else { &["\r"] };
            let before = refused.flatten();
            // An adapter that has just started acknowledges these ends too, and may not take the commands: the usual one comes before them.
            for (index, end) in ends.iter().enumerate() {
                slcan.end = end;
                let wait = if index == 1 { ANSWER } else { wait };
                refused = Some(slcan.round(&mut round, &deadline.within(wait * 5), wait)?);
                // The first shows whether anybody is there, the second decides for the usual end, the third for the other.
                if round.is_open == (index > 0) {
                    break;
                }
            }
            match (before, refused.flatten()) {
                // A late answer may belong to another command, so one refusal is none.
                (Some(before), Some(now)) if before == now => return Err(Cause::Refused(now.to_owned())),
                (_, None) if round.is_open => break,
                _ if !deadline.is_over() => wait = (2 * wait).min(ANSWER_MAX),
                (_, Some(command)) => return Err(Cause::Refused(command.to_owned())),
                _ if round.keep(slcan.lines.rest()) => return Err(Cause::SilentAdapter(deadline.limit())),
                _ => return Err(Cause::NotAnAdapter(beginning(&round.received))),
            }
        }
        slcan.damaged = 0;
        Ok(slcan)
    }

    /// One attempt. Returns the command that was refused.
    fn round(
        &mut self,
        round: &mut Round,
        deadline: &Deadline,
        wait: Duration,
    ) -> Result<Option<&'static str>, Cause> {
        round.is_open = false;
        // The end of a line drops what an earlier program has begun. The version comes first: a peer that echoes it is no adapter, and gets no more.
        let version = self.ask(round, "V", true, &deadline.within(wait))?;
        let closed = self.ask(round, "C", false, &deadline.within(wait))?;
        // Those of a channel that was open.
        self.frames.clear();
        let mut refused = None;
        let mut opened = Answer::Nothing;
        for (command, name) in [("S8", "S8 (1 Mbit/s)"), ("O", "O")] {
            opened = self.ask(round, command, false, &deadline.within(wait))?;
            if opened == Answer::Refused {
                refused = refused.or(Some(name));
            }
        }
        let answers = [&closed, &opened];
        if answers.contains(&&Answer::Text) {
            // A banner, or something else than an adapter.
            return Ok(refused);
        }
        self.acknowledges = opened == Answer::Done;
        round.is_open = opened == Answer::Done || version == Answer::Text || closed != Answer::Nothing;
        if !round.is_open && refused.is_none() {
            // It may acknowledge nothing and know no V: a board that answers is sign enough.
            let stat = Message::get(Destination::Group(Group::ALL), Property::STAT).frame();
            self.write(&line::format(&stat, None), deadline)
                .map_err(|error| Cause::AdapterGone(error.to_string()))?;
            let probe = deadline.within(wait);
            // What floods has a byte after the deadline too.
            while self.frames.is_empty() && !probe.is_over() && self.next(&probe).map_err(of_opening)? {
                while let Some(said) = self.said.pop_front() {
                    self.take(said);
                }
            }
            round.is_open = !self.frames.is_empty();
        }
        Ok(refused)
    }

    /// Sends a command and waits for its answer.
    fn ask(
        &mut self,
        round: &mut Round,
        command: &str,
        is_text: bool,
        deadline: &Deadline,
    ) -> Result<Answer, Cause> {
        let begin = if is_text { self.end } else { "" };
        // An adapter that refuses a second host may have closed already: what it said comes first.
        let written = self.write(&format!("{begin}{command}"), deadline);
        let mut answer = Answer::Nothing;
        loop {
            match self.next(deadline) {
                Ok(true) => {}
                Ok(false) => return Ok(answer),
                Err(Gone::Refused(why)) => return Err(Cause::InUse(why)),
                Err(Gone::Lost(why)) => {
                    return Err(Cause::AdapterGone(written.err().map_or(why, |error| error.to_string())));
                }
            }
            while let Some(said) = self.said.pop_front() {
                match said {
                    Said::Text(text) if text == command.as_bytes() => {
                        return Err(Cause::NotAnAdapter(beginning(&text)));
                    }
                    Said::Text(text) => {
                        round.keep(&text);
                        answer = Answer::Text;
                    }
                    Said::Frame(frame) => self.frames.push_back(frame),
                    // The answers to the line before V.
                    Said::Done | Said::Refused if is_text => {}
                    Said::Done if answer == Answer::Nothing => answer = Answer::Done,
                    Said::Refused if answer == Answer::Nothing => answer = Answer::Refused,
                    Said::Done | Said::Refused => {}
                    // A version of digits alone.
                    Said::Damaged if is_text => answer = Answer::Text,
                    Said::Damaged => {}
                }
            }
            let is_over = deadline.is_over();
            let is_answered = if is_text { answer == Answer::Text } else { answer != Answer::Nothing };
            if is_over || is_answered && self.lines.rest().is_empty() {
                return Ok(answer);
            }
        }
    }

    /// Closes and opens the channel, as an adapter that has left the bus (bus-off) needs it; nothing if it has just been done.
    ///
    /// # Errors
    /// The adapter is gone.
    pub fn reopen(&mut self, deadline: &Deadline) -> io::Result<()> {
        if !self.reopened.is_over() {
            return Ok(());
        }
        self.flight.clear();
        for command in ["C", "S8", "O"] {
            self.write(command, deadline)?;
            let wait = deadline.within(REOPEN);
            let mut is_answered = false;
            while !is_answered && !wait.is_over() && self.next(&wait)? {
                while let Some(said) = self.said.pop_front() {
                    is_answered |= matches!(said, Said::Done | Said::Refused);
                    self.take(said);
                }
            }
        }
        self.reopened = Deadline::after(REOPEN_AFTER);
        Ok(())
    }

    /// What ends a wait of [`Self::receive`] from another thread.
    pub fn waker(&self) -> Waker {
        self.port.waker()
    }

    /// Sends a frame, and waits until the adapter has taken it, if it says so. One that the adapter refuses is sent again; a refusal that stays shows up in [`Self::has_refused`].
    ///
    /// # Errors
    /// The adapter is gone, or takes nothing until the deadline.
    pub fn send(&mut self, frame: &Frame, deadline: &Deadline) -> io::Result<()> {
        // Refusals that have arrived come first: what they refused was to be sent before this frame.
        let mut pieces = 0;
        while pieces < AT_ONCE && self.next(&Deadline::after(Duration::ZERO))? {
            self.follow(deadline)?;
            pieces += 1;
        }
        self.put(Sent { frame: *frame, resends: 0 }, deadline)?;
        let patience = match (self.acknowledges, self.careful) {
            (true, _) => ACKNOWLEDGED,
            (false, 0) => Duration::ZERO,
            (false, _) => REFUSED,
        };
        let patience = deadline.within(patience);
        while self.flight.len() > if self.is_streaming && self.careful == 0 { PIPELINE } else { 0 } {
            // An adapter that says nothing keeps the last frame in flight, for its refusal.
            if patience.limit().is_zero() && self.flight.len() == 1 {
                break;
            }
            let has_more = self.next(&patience)?;
            self.follow(deadline)?;
            if (!has_more || patience.is_over()) && self.flight.pop_front().is_some() {
                // Taken, or its acknowledgment was lost.
                self.careful = self.careful.saturating_sub(1);
                self.unacknowledged = self.unacknowledged.map(|frames| frames + 1);
                self.acknowledges &= self.unacknowledged.is_none_or(|frames| frames < UNACKNOWLEDGED);
            }
        }
        Ok(())
    }

    fn put(&mut self, sent: Sent, deadline: &Deadline) -> io::Result<()> {
        self.write(&line::format(&sent.frame, None), deadline)?;
        self.flight.push_back(sent);
        Ok(())
    }

    fn write(&mut self, text: &str, deadline: &Deadline) -> io::Result<()> {
        self.port.write(format!("{text}{}", self.end).as_bytes(), deadline)
    }

    /// The next frame; `None` at the deadline.
    ///
    /// # Errors
    /// The adapter is gone.
    pub fn receive(&mut self, deadline: &Deadline) -> Result<Option<Frame>, Failure> {
        let lost = |error: io::Error| Failure::Lost(error.to_string());
        loop {
            if let Some(frame) = self.frames.pop_front() {
                return Ok(Some(frame));
            }
            // An adapter that sends without an end keeps no call.
            if !self.next(deadline).map_err(|gone| lost(gone.into()))? {
                return Ok(None);
            }
            // A frame that is sent again has its own time, so that none is lost at the end of a wait.
            self.follow(&Deadline::after(ACKNOWLEDGED)).map_err(lost)?;
            if self.frames.is_empty() && deadline.is_over() {
                return Ok(None);
            }
        }
    }

    /// Acts on what has arrived.
    fn follow(&mut self, deadline: &Deadline) -> io::Result<()> {
        while let Some(said) = self.said.pop_front() {
            match said {
                Said::Refused => self.refused(deadline)?,
                Said::Done => {
                    // An acknowledgment without a frame is that of an earlier command.
                    if self.flight.pop_front().is_some() {
                        self.acknowledges = true;
                        self.unacknowledged = None;
                        self.careful = self.careful.saturating_sub(1);
                    }
                }
                said => self.take(said),
            }
        }
        Ok(())
    }

    fn take(&mut self, said: Said) {
        match said {
            Said::Frame(frame) => self.frames.push_back(frame),
            Said::Damaged => self.damaged += 1,
            Said::Done | Said::Refused | Said::Text(_) => {}
        }
    }

    /// Sends the refused frame again: the oldest that is not acknowledged, or the last one of an adapter that acknowledges nothing.
    fn refused(&mut self, deadline: &Deadline) -> io::Result<()> {
        let sent = if self.acknowledges { self.flight.pop_front() } else { self.flight.pop_back() };
        let Some(Sent { frame, resends }) = sent else { return Ok(()) };
        self.refusals += 1;
        self.careful = ONE_BY_ONE;
        if resends == RESENDS / 2 {
            self.reopen(deadline)?;
        }
        if resends == RESENDS {
            self.has_refused = true;
            return Ok(());
        }
        self.put(Sent { frame, resends: resends + 1 }, deadline)
    }

    /// Waits until something arrives; `false` at the deadline.
    fn next(&mut self, deadline: &Deadline) -> Result<bool, Gone> {
        match self.port.receive(deadline) {
            Ok(Some(Event::Bytes(bytes))) => {
                for byte in bytes {
                    self.lines.push(byte, &mut |said| self.said.push_back(said));
                }
                // A simulated bus explains a hang-up in such a line.
                let why = self.said.iter().find_map(|said| match said {
                    Said::Text(text) => text.strip_prefix(b"error: "),
                    _ => None,
                });
                match why {
                    Some(why) => Err(Gone::Refused(String::from_utf8_lossy(why).into_owned())),
                    None => Ok(true),
                }
            }
            Ok(Some(_)) => Ok(true),
            Ok(None) => Ok(false),
            Err(why) => Err(Gone::Lost(why)),
        }
    }
}

/// What the rounds of an opening have shown.
#[derive(Default)]
struct Round {
    is_open: bool,
    /// The beginning of what was received and is no frame.
    received: Vec<u8>,
}

impl Round {
    /// Keeps what was received. Returns whether all of it is nothing.
    fn keep(&mut self, bytes: &[u8]) -> bool {
        self.received.extend(bytes.iter().take(KEPT - self.received.len().min(KEPT)));
        self.received.is_empty()
    }
}

fn of_opening(gone: Gone) -> Cause {
    match gone {
        Gone::Refused(why) => Cause::InUse(why),
        Gone::Lost(why) => Cause::AdapterGone(why),
    }
}
