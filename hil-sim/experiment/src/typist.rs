//! A host that types lines of Grasper Control Language and waits for the prompt, in simulated time.

use god::god::LINE_END;
use god::io::ABORT;
use serde::Serialize;

use super::packets;
use hil_world::hand::Hand;

const PROMPT: &str = "\n\r=> ";

/// Poll interval, us; the resolution of a line's duration.
const POLL_US: u64 = 1_000;

/// Time limit of a line on top of its WAIT, us: HI takes seconds, a sequence of ten moves a minute, and TSTOP at most 65 s a move.
const LIMIT_US: u64 = 600_000_000;

/// A line and its answer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reply {
    /// The line, as typed.
    pub line: String,
    /// The answer between echo and prompt; lines end in LF.
    pub answer: String,
    /// The number after ERR (manual, table 4); 0 if there was none.
    pub status: u32,
    /// Unsolicited output before this line: reports of the lower grammar that a motion has ended.
    #[serde(rename = "unasked")]
    pub unsolicited: Vec<String>,
    /// From the line's end to the prompt, ms of simulated time.
    pub ms: f64,
}

fn wait_us(line: &str) -> u64 {
    let number = line.trim_start().get(..4).filter(|word| word.eq_ignore_ascii_case("WAIT"));
    let ms = number.and_then(|_| line.trim_start().get(4..)?.trim().parse().ok());
    ms.map_or(0, |ms: u32| 1_000 * u64::from(ms))
}

/// Simulated time for the prompt after ^C, us: motors stop within 0.3 s, and a command that stores takes longest.
const ABORT_US: u64 = 2_000_000;

/// GOD did not prompt in time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoPrompt {
    /// The line.
    pub line: String,
    /// The limit, s of simulated time.
    pub limit_s: u64,
    /// Its output meanwhile.
    pub output: String,
}

impl std::fmt::Display for NoPrompt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // A long line is also most of the output: its echo.
        let short = |text: &str| text.chars().take(60).collect::<String>();
        write!(f, "{:?} after {:?}", short(&self.output), short(&self.line))
    }
}

impl std::error::Error for NoPrompt {}

/// A hand and its typing host.
pub struct Typist {
    hand: Hand,
    output: Vec<u8>,
    unsolicited: Vec<String>,
}

impl Typist {
    /// Takes a hand at power-up; returns its output up to the first prompt.
    ///
    /// # Errors
    /// GOD did not prompt.
    pub fn new(hand: Hand) -> Result<(Self, String), NoPrompt> {
        let mut typist = Self { hand, output: Vec::new(), unsolicited: Vec::new() };
        let banner = typist.wait_for_prompt("", LIMIT_US, &mut || true)?;
        Ok((typist, banner))
    }

    /// The hand.
    #[must_use]
    pub const fn hand(&self) -> &Hand {
        &self.hand
    }

    /// The hand, to disturb it.
    pub const fn hand_mut(&mut self) -> &mut Hand {
        &mut self.hand
    }

    /// Advances time while the hand's output is collected: GOD waits while nobody takes it.
    pub fn advance(&mut self, until_us: u64) {
        while self.hand.now_us() < until_us {
            self.hand.run_until(until_us.min(self.hand.now_us() + POLL_US));
            self.output.extend(self.hand.take_tx());
        }
    }

    /// Advances time, and collects the output, until GOD waits for a line and has answered all that was typed. Returns whether it
    /// does so within the limit, us of simulated time; `goes_on` is asked once a simulated millisecond and may end the wait.
    pub fn wait_for_line(&mut self, limit_us: u64, goes_on: &mut dyn FnMut() -> bool) -> bool {
        let end_us = self.hand.now_us() + limit_us;
        loop {
            self.output.extend(self.hand.take_tx());
            let io = self.hand.io();
            if io.is_drained() && io.waits_for_line() {
                return true;
            }
            if self.hand.now_us() >= end_us || !goes_on() {
                return false;
            }
            self.advance(end_us.min(self.hand.now_us() + POLL_US));
        }
    }

    /// Types bytes as they are, without waiting.
    pub fn type_bytes(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.type_byte(*byte));
    }

    /// Takes the bytes that the hand has sent and that are in no reply.
    pub fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.output)
    }

    /// Aborts what is running by ^C, waits for its prompt, and drops the output.
    pub fn abort(&mut self) {
        self.hand.interrupt();
        let end_us = self.hand.now_us() + ABORT_US;
        while self.hand.now_us() < end_us && self.next_output().is_none() {
            self.advance(self.hand.now_us() + POLL_US);
        }
    }

    /// Types a line and CR and waits for the prompt. A line that ends in ^C gets no CR. LOOP does not prompt: its `*` is answered
    /// with ^C.
    ///
    /// # Errors
    /// No prompt within the limit; the hand accepts no further lines.
    pub fn run_line(&mut self, line: &str) -> Result<Reply, NoPrompt> {
        self.run_line_within(line, LIMIT_US + wait_us(line), &mut || true)
    }

    /// The same with a limit, us of simulated time; `goes_on` is asked once a simulated millisecond and may end the wait.
    ///
    /// # Errors
    /// No prompt within the limit, or not before `goes_on` was false. [`Self::abort`] makes room for further lines.
    pub fn run_line_within(
        &mut self,
        line: &str,
        limit_us: u64,
        goes_on: &mut dyn FnMut() -> bool,
    ) -> Result<Reply, NoPrompt> {
        self.type_bytes(line.as_bytes());
        let start_us = self.hand.now_us();
        if !line.ends_with(char::from(ABORT)) {
            self.type_byte(b'\r');
        }
        let output = self.wait_for_prompt(line, limit_us, goes_on)?;
        let ms = (self.hand.now_us() - start_us) as f64 / 1000.0;
        let echo = text(line.trim_end_matches(char::from(ABORT)).as_bytes());
        let answer = answer(output.strip_prefix(&echo).unwrap_or(&output));
        let status = answer.lines().rev().find_map(|line| line.strip_prefix("ERR ")?.trim().parse().ok());
        let unsolicited = std::mem::take(&mut self.unsolicited);
        Ok(Reply { line: line.to_owned(), answer, status: status.unwrap_or(0), unsolicited, ms })
    }

    /// Unsolicited output up to now.
    pub fn unsolicited(&mut self) -> Vec<String> {
        self.advance(self.hand.now_us() + POLL_US);
        while let Some(output) = self.next_output() {
            self.unsolicited.push(answer(&output));
        }
        std::mem::take(&mut self.unsolicited)
    }

    fn next_output(&mut self) -> Option<String> {
        let mut at = 0;
        while !self.output[at..].starts_with(PROMPT.as_bytes()) {
            at += match self.output.get(at) {
                Some(&head) if packets::is_head(head) => packets::len(&self.output[at..])?,
                _ => 1,
            };
            if at >= self.output.len() {
                return None;
            }
        }
        let output = text(&self.output[..at]);
        self.output.drain(..at + PROMPT.len());
        Some(output)
    }

    fn type_byte(&mut self, byte: u8) {
        if self.hand.io().rx_room() == 0 {
            // GOD reads again once its echo has room.
            self.output.extend(self.hand.take_tx());
            self.hand.run_until(self.hand.now_us() + 1);
        }
        self.hand.push_rx(&[byte]);
    }

    fn wait_for_prompt(
        &mut self,
        line: &str,
        limit_us: u64,
        goes_on: &mut dyn FnMut() -> bool,
    ) -> Result<String, NoPrompt> {
        let start_us = self.hand.now_us();
        // The banner starts on a new line as well, but is solicited.
        let is_first = start_us == 0;
        let end_us = start_us + limit_us;
        let mut has_aborted = false;
        while self.hand.now_us() < end_us && goes_on() {
            self.advance(end_us.min(self.hand.now_us() + POLL_US));
            while let Some(output) = self.next_output() {
                // A report that a motion has ended starts on a new line (a packet is shown on one), before the echo; ERR belongs to the
                // typed line.
                if !is_first && output.starts_with(LINE_END) && !output[LINE_END.len()..].starts_with("ERR") {
                    self.unsolicited.push(answer(&output));
                } else {
                    return Ok(output);
                }
            }
            // RealTime expects control blocks, and a script has none. One ^C: another would have a prompt of its own, which the next line would
            // take for its answer.
            if !has_aborted
                && self.output.ends_with(b"*")
                && self.output.len() == line.len() + 1
                && line.trim_end().to_ascii_uppercase().ends_with("LOOP")
            {
                self.hand.push_rx(&[ABORT]);
                has_aborted = true;
            }
        }
        let limit_s = limit_us / 1_000_000;
        Err(NoPrompt { line: line.to_owned(), limit_s, output: text(&self.output) })
    }
}

fn answer(output: &str) -> String {
    output.trim().replace('\r', "")
}

/// Latin-1: any byte of text is a character. Each packet is a line of hexadecimal digits.
fn text(mut output: &[u8]) -> String {
    let mut text = String::new();
    while let Some((&byte, rest)) = output.split_first() {
        match packets::len(output).filter(|_| packets::is_head(byte)) {
            Some(len) => {
                text += LINE_END;
                text += &packets::text(&output[..len]);
                output = &output[len..];
            }
            None => {
                text.push(char::from(byte));
                output = rest;
            }
        }
    }
    text
}
