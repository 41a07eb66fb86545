//! Lines of Grasper Control Language typed at a hand, as fast as it answers, in simulated time.

use god::god::LINE_END;
use god::io::ABORT;
use serde::Serialize;

use crate::world::hand::Hand;

/// What ends an answer: GOD's prompt at the beginning of a line.
const PROMPT: &str = "\n\r=> ";

/// How often what is said is looked at, us: a line's time is known so well.
const LOOK_US: u64 = 1_000;

/// Longest that a line may take beside what it WAITs, us: HI takes some seconds, a sequence of ten moves a minute.
const MOST_US: u64 = 600_000_000;

/// A line and what came of it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Answered {
    /// The line, as typed.
    pub line: String,
    /// What was said after the echo, without the prompt; lines end in LF.
    pub answer: String,
    /// The number after ERR (manual, table 4); 0 if there was none.
    pub status: u32,
    /// What was said between the last line's prompt and this line: ends of motions of the lower grammar.
    pub unasked: Vec<String>,
    /// From the line's end to the prompt, ms of simulated time.
    pub ms: f64,
}

/// What a line may wait by itself, us: WAIT's number.
fn waits_us(line: &str) -> u64 {
    let number = line.trim_start().get(..4).filter(|word| word.eq_ignore_ascii_case("WAIT"));
    let ms = number.and_then(|_| line.trim_start().get(4..)?.trim().parse().ok());
    ms.map_or(0, |ms: u32| 1_000 * u64::from(ms))
}

/// GOD did not prompt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NoPrompt {
    /// The line.
    pub line: String,
    /// How long it had, s of simulated time.
    pub seconds: u64,
    /// What it said meanwhile.
    pub said: String,
}

impl std::fmt::Display for NoPrompt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        // The line may be long, and is most of what was said then.
        let short = |text: &str| text.chars().take(60).collect::<String>();
        write!(f, "{:?} after {:?}", short(&self.said), short(&self.line))
    }
}

impl std::error::Error for NoPrompt {}

/// A host that types a line and waits for the prompt.
pub struct Typist {
    hand: Hand,
    /// What it has said since its last prompt.
    said: Vec<u8>,
    /// What it has said unasked, and nobody has been told.
    unasked: Vec<String>,
}

impl Typist {
    /// Takes a hand whose power has just come on. Returns what it said up to its first prompt.
    ///
    /// # Errors
    /// It never prompted.
    pub fn new(hand: Hand) -> Result<(Self, String), NoPrompt> {
        let mut typist = Self { hand, said: Vec::new(), unasked: Vec::new() };
        let said = typist.until_prompt("")?;
        Ok((typist, said))
    }

    /// The hand.
    #[must_use]
    pub const fn hand(&self) -> &Hand {
        &self.hand
    }

    /// Types a line and a CR, and waits for the prompt. A line that ends in ^C ends there. LOOP has no prompt: its `*` is answered
    /// with ^C.
    ///
    /// # Errors
    /// There was no prompt: nothing more can be typed.
    pub fn line(&mut self, line: &str) -> Result<Answered, NoPrompt> {
        for byte in line.bytes() {
            self.hear(byte);
        }
        let begun_us = self.hand.now_us();
        if !line.ends_with(char::from(ABORT)) {
            self.hear(b'\r');
        }
        let said = self.until_prompt(line)?;
        let ms = (self.hand.now_us() - begun_us) as f64 / 1000.0;
        let echo = line.trim_end_matches(char::from(ABORT));
        let answer = answer(said.strip_prefix(echo).unwrap_or(&said));
        let status = answer.lines().rev().find_map(|line| line.strip_prefix("ERR ")?.trim().parse().ok());
        let unasked = std::mem::take(&mut self.unasked);
        Ok(Answered { line: line.to_owned(), answer, status: status.unwrap_or(0), unasked, ms })
    }

    /// What is said now without being asked.
    pub fn unasked(&mut self) -> Vec<String> {
        self.hand.run_until(self.hand.now_us() + LOOK_US);
        self.said.extend(self.hand.take_tx());
        while let Some(said) = self.up_to_prompt() {
            self.unasked.push(answer(&said));
        }
        std::mem::take(&mut self.unasked)
    }

    /// What has been said up to the next prompt, if there is one.
    fn up_to_prompt(&mut self) -> Option<String> {
        let at = self.said.windows(PROMPT.len()).position(|text| text == PROMPT.as_bytes())?;
        let said = text(&self.said[..at]);
        self.said.drain(..at + PROMPT.len());
        Some(said)
    }

    /// A byte, when there is room for it.
    fn hear(&mut self, byte: u8) {
        if self.hand.io().rx_room() == 0 {
            // GOD takes all that it can at once, if it can say the echo.
            self.said.extend(self.hand.take_tx());
            self.hand.run_until(self.hand.now_us() + 1);
        }
        self.hand.push_rx(&[byte]);
    }

    fn until_prompt(&mut self, line: &str) -> Result<String, NoPrompt> {
        // The banner is a line of its own, too.
        let is_first = self.hand.now_us() == 0;
        let most_us = MOST_US + waits_us(line);
        let end_us = self.hand.now_us() + most_us;
        while self.hand.now_us() < end_us {
            self.hand.run_until(self.hand.now_us() + LOOK_US);
            self.said.extend(self.hand.take_tx());
            while let Some(said) = self.up_to_prompt() {
                // An end of a motion begins a line of its own, before what has been typed; an error's is the line's that it ends.
                if !is_first && said.starts_with(LINE_END) && !said[LINE_END.len()..].starts_with("ERR") {
                    self.unasked.push(answer(&said));
                } else {
                    return Ok(said);
                }
            }
            // RealTime wants blocks, and a script has none.
            if self.said.ends_with(b"*")
                && self.said.len() == line.len() + 1
                && line.trim_end().to_ascii_uppercase().ends_with("LOOP")
            {
                self.hand.push_rx(&[ABORT]);
            }
        }
        let seconds = most_us / 1_000_000;
        Err(NoPrompt { line: line.to_owned(), seconds, said: text(&self.said) })
    }
}

/// What was said, without line ends at its edges; lines end in LF.
fn answer(said: &str) -> String {
    said.trim().replace('\r', "")
}

/// Latin-1: any byte is a character.
fn text(said: &[u8]) -> String {
    said.iter().map(|&byte| char::from(byte)).collect()
}
