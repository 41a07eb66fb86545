//! A host's side of Grasper Control Language: echo, answer, prompt, and packets between them.
//!
//! A call that ends without its prompt (its deadline is over) has sent ^C; the next call first finds the prompt again.

use std::collections::VecDeque;
use std::io::ErrorKind;
use std::ops::ControlFlow;
use std::time::Duration;

use god::Status;
use tater_wire::Frame;

use crate::deadline::Deadline;
use crate::error::{CallError, Failure, beginning};
use crate::port::{Event, Port, negotiates_telnet};

/// ^C, which aborts a command of the hand.
pub(crate) const ABORT: u8 = 3;

const PROMPT: &[u8] = b"\n\r=> ";

/// Longest line of the language.
const MAX_LINE: usize = 160;

/// Longest answer; the longest of the hand, FLISTAV, has under 4 KiB.
const MAX_ANSWER: usize = 1 << 16;

/// Most pieces that are received without waiting: a peer that sends without an end keeps no call.
const AT_ONCE: usize = 64;

/// Time for the prompt after ^C.
const CANCELLED: Duration = Duration::from_secs(1);

/// Limit of the last ^C.
const LAST: Duration = Duration::from_millis(100);

/// Interval of progress during a call.
const TICK: Duration = Duration::from_millis(50);

/// Unsolicited lines and frames kept: a host that does not fetch them loses the oldest.
const KEPT: usize = 256;

/// Called every 50 ms with the time since the call; [`ControlFlow::Break`] cancels the call.
pub(crate) type OnTick<'a> = &'a mut dyn FnMut(Duration) -> ControlFlow<()>;

/// The answer to a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Answer {
    /// Its lines, without ERR.
    pub lines: Vec<String>,
    /// The number after ERR; success without one.
    pub status: Status,
}

pub(crate) struct Session {
    port: Port,
    /// Received and not yet read.
    inbox: VecDeque<u8>,
    /// Text since the last prompt.
    text: Vec<u8>,
    packet: Vec<u8>,
    frames: VecDeque<Frame>,
    reports: VecDeque<String>,
    /// Whether a device server has negotiated options of Telnet before the first prompt; `None` after it.
    telnet: Option<bool>,
    /// Whether a prompt of an earlier call is still to come.
    is_behind: bool,
    /// Whether the caller has written a line without its CR.
    is_line_open: bool,
    /// Whether the caller has written bytes of its own since the last line of a call.
    has_own_bytes: bool,
    markers: u32,
}

impl Session {
    pub const fn new(port: Port) -> Self {
        Self {
            port,
            inbox: VecDeque::new(),
            text: Vec::new(),
            packet: Vec::new(),
            frames: VecDeque::new(),
            reports: VecDeque::new(),
            telnet: Some(false),
            is_behind: false,
            is_line_open: false,
            has_own_bytes: false,
            markers: 0,
        }
    }

    /// Whether a device server negotiates options of Telnet. Without that, whatever comes from now on is the hand's.
    pub fn negotiates_telnet(&mut self) -> bool {
        self.telnet.take() == Some(true)
    }

    pub const fn port(&self) -> &Port {
        &self.port
    }

    /// Takes the text since the last prompt, as received.
    pub fn take_text(&mut self) -> Vec<u8> {
        self.parse();
        std::mem::take(&mut self.text)
    }

    /// Takes the lines that the hand has printed unasked.
    pub fn take_reports(&mut self) -> Vec<String> {
        self.reports.drain(..).collect()
    }

    /// Writes bytes.
    ///
    /// # Errors
    /// The connection is lost, or takes nothing until the deadline.
    pub fn write(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), Failure> {
        self.port.write(bytes, deadline).map_err(|error| match error.kind() {
            ErrorKind::TimedOut => Failure::TimedOut(deadline.limit()),
            _ => Failure::Lost(error.to_string()),
        })
    }

    /// Writes bytes of the caller's own, which may leave a line without its CR.
    ///
    /// # Errors
    /// Those of [`Self::write`].
    pub fn write_raw(&mut self, bytes: &[u8], deadline: &Deadline) -> Result<(), Failure> {
        self.is_line_open = !matches!(bytes.last(), None | Some(b'\r' | &ABORT));
        self.has_own_bytes = true;
        self.write(bytes, deadline)
    }

    /// Receives until the deadline or the first bytes; `false` at the deadline, also if more has arrived.
    pub fn receive(&mut self, deadline: &Deadline) -> Result<bool, Failure> {
        if deadline.is_over() { Ok(false) } else { self.receive_next(deadline) }
    }

    /// Receives what has arrived.
    fn receive_arrived(&mut self) -> Result<(), Failure> {
        let mut pieces = 0;
        while pieces < AT_ONCE && self.receive_next(&Deadline::after(Duration::ZERO))? {
            pieces += 1;
        }
        Ok(())
    }

    fn receive_next(&mut self, deadline: &Deadline) -> Result<bool, Failure> {
        match self.port.receive(deadline) {
            Ok(Some(Event::Bytes(bytes))) => {
                self.inbox.extend(&bytes);
                if self.telnet.is_some() && negotiates_telnet(&bytes) {
                    self.telnet = Some(true);
                    return Err(Failure::Lost("a device server negotiates Telnet options".to_owned()));
                }
            }
            Ok(Some(Event::Frame(_) | Event::Gone(_) | Event::Woken)) => {}
            Ok(None) => return Ok(false),
            Err(why) => return Err(Failure::Lost(why)),
        }
        Ok(true)
    }

    /// The next byte of a block of RealTime.
    pub fn raw(&mut self, deadline: &Deadline) -> Result<u8, Failure> {
        loop {
            if let Some(byte) = self.inbox.pop_front() {
                return Ok(byte);
            }
            if !self.receive(deadline)? {
                return Err(Failure::TimedOut(deadline.limit()));
            }
        }
    }

    /// Bytes that were read as RealTime's and are text.
    pub fn put_back(&mut self, byte: u8) {
        self.inbox.push_front(byte);
    }

    /// Receives what has arrived.
    ///
    /// # Errors
    /// The connection is lost, or what arrives is too long for an answer.
    pub fn poll(&mut self) -> Result<(), Failure> {
        self.receive_arrived()?;
        while self.next_output().is_some_and(|output| self.report(&output)) {}
        self.check_length()
    }

    /// The oldest frame that boards have sent in a packet; `None` at the deadline.
    pub fn frame(&mut self, deadline: &Deadline) -> Result<Option<Frame>, Failure> {
        self.receive_arrived()?;
        loop {
            while self.next_output().is_some_and(|output| self.report(&output)) {}
            self.check_length()?;
            if let Some(frame) = self.frames.pop_front() {
                return Ok(Some(frame));
            }
            if deadline.is_over() || !self.receive(deadline)? {
                return Ok(None);
            }
        }
    }

    /// Takes the frames that something can be made of; the others stay.
    pub fn take_frames<T>(&mut self, take: impl Fn(&Frame) -> Option<T>) -> Vec<T> {
        let taken = self.frames.iter().filter_map(&take).collect();
        self.frames.retain(|frame| take(frame).is_none());
        taken
    }

    /// Keeps an output that belongs to no line. Returns `true`.
    fn report(&mut self, output: &[u8]) -> bool {
        let lines = answer(output).lines;
        self.reports.extend(lines);
        while self.reports.len() > KEPT {
            self.reports.pop_front();
        }
        true
    }

    /// Moves the inbox into text and frames, up to the end of the next prompt.
    fn parse(&mut self) {
        while !self.text.ends_with(PROMPT) {
            let Some(byte) = self.inbox.pop_front() else { return };
            if self.packet.is_empty() && !matches!(byte, 0 | 4) {
                self.text.push(byte);
                continue;
            }
            self.packet.push(byte);
            let [high, low, len, data @ ..] = &*self.packet else { continue };
            if data.len() >= usize::from(*len).min(8) {
                let id = u16::from(*high) << 8 | u16::from(*low);
                self.frames.extend(Frame::from_raw(id, data));
                while self.frames.len() > KEPT {
                    self.frames.pop_front();
                }
                self.packet.clear();
            }
        }
    }

    /// The next output up to a prompt, without it.
    fn next_output(&mut self) -> Option<Vec<u8>> {
        self.parse();
        self.whole_output()
    }

    /// The text without the prompt that it ends with.
    fn whole_output(&mut self) -> Option<Vec<u8>> {
        let output = self.text.strip_suffix(PROMPT)?.to_vec();
        self.text.clear();
        Some(output)
    }

    /// More text than an answer has.
    fn check_length(&self) -> Result<(), Failure> {
        if self.text.len() > MAX_ANSWER { Err(Failure::Unexpected(beginning(&self.text))) } else { Ok(()) }
    }

    /// Sends a line and waits for its prompt.
    ///
    /// # Errors
    /// A line that the hand would not take; no prompt by the deadline, and then the command is aborted; cancelled; the connection is lost.
    pub fn run(&mut self, line: &str, limit: Duration, on_tick: OnTick) -> Result<Answer, CallError> {
        let deadline = Deadline::after(limit);
        let outcome = self.run_until(line, &deadline, true, on_tick).or_else(|failure| {
            if matches!(failure, Failure::TimedOut(_)) {
                self.abort()?;
            }
            Err(failure)
        });
        outcome.map_err(|failure| CallError { call: line.to_owned(), failure })
    }

    /// The same for a line that moves nothing: at the deadline and after a cancel nothing is aborted.
    ///
    /// # Errors
    /// The others.
    pub fn ask(&mut self, line: &str, limit: Duration, on_tick: OnTick) -> Result<Answer, CallError> {
        let outcome = self.run_until(line, &Deadline::after(limit), false, on_tick);
        outcome.map_err(|failure| CallError { call: line.to_owned(), failure })
    }

    fn run_until(
        &mut self,
        line: &str,
        deadline: &Deadline,
        cancel_aborts: bool,
        on_tick: OnTick,
    ) -> Result<Answer, Failure> {
        let line = &*blanks(line);
        check(line)?;
        self.catch_up(deadline)?;
        // Until its prompt has come.
        self.is_behind = true;
        self.has_own_bytes = false;
        self.write(format!("{line}\r").as_bytes(), deadline)?;
        let (mut is_cancelled, mut deadline) = (false, *deadline);
        loop {
            while let Some(output) = self.next_output() {
                // A report is printed on a new line, and not before a prompt.
                let Some(rest) = output.strip_prefix(line.as_bytes()) else {
                    self.report(&output);
                    continue;
                };
                self.is_behind = false;
                let answer = answer(rest);
                if answer.lines.last().is_some_and(|line| line.starts_with("ERR ")) {
                    return Err(Failure::Unexpected(beginning(rest)));
                }
                return match answer.status.has(Status::ABORTED) {
                    true => Err(Failure::Cancelled),
                    false => Ok(answer),
                };
            }
            self.check_length()?;
            if deadline.is_over() {
                return Err(match is_cancelled {
                    true => Failure::Cancelled,
                    false => Failure::TimedOut(deadline.limit()),
                });
            }
            let is_tick = !self.receive(&deadline.within(TICK))?;
            if is_tick && !is_cancelled && on_tick(deadline.elapsed()).is_break() {
                if !cancel_aborts {
                    return Err(Failure::Cancelled);
                }
                is_cancelled = true;
                deadline = deadline.within(CANCELLED);
                self.write(&[ABORT], &deadline)?;
            }
        }
    }

    /// Sends ^C at the end of a connection, so that motors stop, unless the caller's own bytes may still be on their way: a hand takes them, and
    /// then the end.
    pub fn hang_up(&mut self) {
        if !self.has_own_bytes {
            // Nobody is told any more.
            let _ = self.write(&[ABORT], &Deadline::after(LAST));
        }
    }

    /// Sends ^C without waiting: the next call finds its prompt.
    pub fn abort(&mut self) -> Result<(), Failure> {
        self.is_behind = true;
        self.write(&[ABORT], &Deadline::after(Duration::from_millis(1)))
    }

    /// Finds the prompt again after a call that did not wait for it: everything before the answer to a line that was not sent before is late.
    /// Ends a line of the caller's own, whose answer is a report.
    pub fn catch_up(&mut self, deadline: &Deadline) -> Result<(), Failure> {
        let is_line_open = std::mem::take(&mut self.is_line_open);
        if !self.is_behind && !is_line_open {
            return Ok(());
        }
        self.is_behind = true;
        self.markers += 1;
        // VERS takes no argument: ERR 1024.
        let marker = format!("VERS {}", self.markers);
        let open = if is_line_open { "\r" } else { "" };
        self.write(format!("{open}{marker}\r").as_bytes(), deadline)?;
        loop {
            while let Some(output) = self.next_output() {
                if output.ends_with(format!("{marker}\r\n\rERR 1024\r").as_bytes()) {
                    self.is_behind = false;
                    return Ok(());
                }
                if is_line_open {
                    self.report(&output);
                }
            }
            self.check_length()?;
            if !self.receive(deadline)? {
                return Err(Failure::TimedOut(deadline.limit()));
            }
        }
    }

    /// Waits for LOOP's first `*`, which is no text any more. Returns an error's answer instead if there is one.
    pub fn enter_realtime(&mut self, line: &str, deadline: &Deadline) -> Result<Option<Answer>, Failure> {
        check(line)?;
        self.catch_up(deadline)?;
        self.write(format!("{line}\r").as_bytes(), deadline)?;
        let started = format!("{line}*");
        loop {
            // Byte by byte: what follows the `*` is no text.
            while let Some(byte) = self.inbox.pop_front() {
                self.text.push(byte);
                if self.text.ends_with(started.as_bytes()) {
                    self.text.clear();
                    return Ok(None);
                }
                if let Some(output) = self.whole_output() {
                    match output.strip_prefix(line.as_bytes()) {
                        Some(rest) => return Ok(Some(answer(rest))),
                        None => _ = self.report(&output),
                    }
                }
            }
            self.check_length()?;
            if !self.receive(deadline)? {
                self.abort()?;
                return Err(Failure::TimedOut(deadline.limit()));
            }
        }
    }

    /// The output up to the next prompt, of whatever call.
    ///
    /// # Errors
    /// None comes until the deadline; the connection is lost.
    pub fn until_prompt(&mut self, deadline: &Deadline) -> Result<Answer, Failure> {
        loop {
            if let Some(output) = self.next_output() {
                return Ok(answer(&output));
            }
            self.check_length()?;
            if !self.receive(deadline)? {
                return Err(Failure::TimedOut(deadline.limit()));
            }
        }
    }
}

/// A line whose tabs are blanks: white space is free in both grammars, and the hand echoes no tab.
fn blanks(line: &str) -> String {
    line.replace('\t', " ")
}

/// Refuses what the hand would drop or read as something else.
fn check(line: &str) -> Result<(), Failure> {
    let is_text = line.bytes().all(|byte| matches!(byte, b' '..=b'~'));
    match is_text && line.len() <= MAX_LINE {
        true => Ok(()),
        false => Err(Failure::Invalid(format!("at most {MAX_LINE} printable ASCII characters"))),
    }
}

fn answer(output: &[u8]) -> Answer {
    let text: String = output.iter().map(|&byte| char::from(byte)).collect();
    let mut lines: Vec<String> =
        text.split(['\r', '\n']).filter(|line| !line.is_empty()).map(str::to_owned).collect();
    let code = lines.last().and_then(|line| line.strip_prefix("ERR ")?.parse().ok());
    if code.is_some() {
        lines.pop();
    }
    Answer { lines, status: code.map_or(Status::OK, Status::of) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answer_is_its_lines_and_the_sum_after_err() {
        let of = |text: &str| answer(text.as_bytes());
        assert_eq!(of(""), Answer { lines: vec![], status: Status::OK });
        assert_eq!(of("\r\n\r600\r"), Answer { lines: vec!["600".to_owned()], status: Status::OK });
        assert_eq!(
            of("\r\n\r1 STAT=2\r\n\rERR 1\r"),
            Answer { lines: vec!["1 STAT=2".to_owned()], status: Status::NO_BOARD }
        );
        assert_eq!(of("\r\n\rERR X\r").lines, ["ERR X"]);
    }

    #[test]
    fn line_that_the_hand_would_misread_is_refused() {
        for line in ["HI\r", "\u{3}", "é", &"x".repeat(161)] {
            assert!(matches!(check(line), Err(Failure::Invalid(_))), "{line:?}");
        }
        assert_eq!(check(&"x".repeat(160)), Ok(()));
    }
}
