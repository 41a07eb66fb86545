//! The host program of the walk-through, GrasperTest (manual 3): turns each entry into lines for the hand.
//!
//! `M`, `C` and `O` are commands of this program: they ask for motors, and M for a position, and become lines of the lower
//! grammar, in hall counts. As the manual's functions move, close and open (7) they move a link's tip along; the open and closed
//! positions are the defaults of OT and CT. Every other entry goes to the hand unchanged. After a move command (`4 S M 5`) the
//! console waits until each motor has reported its end (`4 MODE=3`), as the manual's function command does.
//!
//! The walk-through has no HI: it starts with a hand that was homed once and stored its position with SAVE, as in step 17. Any
//! other hand takes its position at wake-up as 0; it moves, but does not trust a position that it SAVEs.
//!
//! No I/O: bytes from the hand and entries go in, lines and texts come out.

use std::collections::{BTreeMap, VecDeque};

use god::motors::{Motor, Motors};
use god::{line, parameter, units};
use tater_wire::Property;

use crate::experiment::input::BadInput;
use crate::experiment::packets;

/// Prompt of the hand, and of this program.
const PROMPT: &str = "=> ";

/// Longest line of the hand kept whole: several times its longest line.
const MAX_LINE: usize = 1024;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Question {
    Command,
    Motors(OwnCommand),
    Position(Motors),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum OwnCommand {
    Move,
    Close,
    Open,
}

/// State between a person and a hand.
#[derive(Debug)]
pub struct Console {
    question: Question,
    lines: VecDeque<String>,
    /// The line sent, until the hand prompts.
    awaiting: Option<String>,
    /// Whether the line has been echoed: then the next prompt ends its answer.
    echoed: bool,
    /// The hand's present line so far.
    input: String,
    /// Its present packet so far (`0 S REPLY 1`).
    packet: Vec<u8>,
    moving: Motors,
    had_error: bool,
}

impl Default for Console {
    fn default() -> Self {
        Self {
            question: Question::Command,
            // An empty line makes the hand prompt.
            lines: VecDeque::from([String::new()]),
            awaiting: None,
            echoed: false,
            input: String::new(),
            packet: Vec::new(),
            moving: Motors::NONE,
            had_error: false,
        }
    }
}

impl Console {
    /// The question to print; `None` while the hand is busy.
    #[must_use]
    pub fn question(&self) -> Option<&'static str> {
        let is_done = self.lines.is_empty() && self.awaiting.is_none() && self.moving.is_empty();
        is_done.then_some(match self.question {
            Question::Command => PROMPT,
            Question::Motors(_) => "Motors: ",
            Question::Position(_) => "Position: ",
        })
    }

    /// Whether an M, C or O is incomplete.
    #[must_use]
    pub fn is_incomplete(&self) -> bool {
        self.question != Question::Command
    }

    /// Whether the hand has reported an error so far.
    #[must_use]
    pub const fn had_error(&self) -> bool {
        self.had_error
    }

    /// Handles an entry. Returns the lines that it became, if they differ from the entry.
    ///
    /// # Errors
    /// The entry is invalid: nothing is sent, and the command is dropped.
    pub fn enter(&mut self, entry: &str) -> Result<Vec<String>, BadInput> {
        let entry = entry.trim();
        match std::mem::replace(&mut self.question, Question::Command) {
            Question::Command => self.command(entry).map(|()| Vec::new()),
            Question::Motors(own) => {
                let motors = motors(entry).ok_or_else(|| {
                    bad("invalid motors", entry, "motors from 1 to 7, such as 123".to_owned())
                })?;
                Ok(match own {
                    OwnCommand::Move => {
                        self.question = Question::Position(motors);
                        Vec::new()
                    }
                    OwnCommand::Close => self.move_to(motors, |motor| default("CT", motor)),
                    OwnCommand::Open => self.move_to(motors, |motor| default("OT", motor)),
                })
            }
            Question::Position(motors) => {
                let rules = Property::E.rules();
                let position = entry.parse().ok().filter(|&position| rules.admits(position));
                let expected =
                    || format!("a whole number of hall counts, {} to {}", rules.min(), rules.max());
                let position = position.ok_or_else(|| bad("invalid position", entry, expected()))?;
                Ok(self.move_to(motors, |_| position))
            }
        }
    }

    fn command(&mut self, entry: &str) -> Result<(), BadInput> {
        let own = match &*entry.to_ascii_uppercase() {
            "M" => OwnCommand::Move,
            "C" => OwnCommand::Close,
            "O" => OwnCommand::Open,
            name if name.ends_with("LOOP") => {
                let expected =
                    "a command that ends with a prompt; RealTime control is for programs".to_owned();
                return Err(bad("LOOP is not available here", entry, expected));
            }
            _ if entry.len() > line::LENGTH || !entry.bytes().all(|byte| matches!(byte, b' '..=b'~')) => {
                let expected = format!("up to {} characters of ASCII", line::LENGTH);
                return Err(bad("the hand does not take this line", entry, expected));
            }
            _ => {
                self.lines.push_back(entry.to_owned());
                return Ok(());
            }
        };
        self.question = Question::Motors(own);
        Ok(())
    }

    /// Goals are in hall counts. The tip of a link moves along with it.
    fn move_to(&mut self, motors: Motors, goal: impl Fn(Motor) -> i64) -> Vec<String> {
        let along = |link: Motor| Some((link.tip()?, units::tip_travel_along(goal(link))));
        // A tip that is named comes later in the chain, so that its own goal replaces its link's.
        let goals = motors.iter().filter_map(along).chain(motors.iter().map(|motor| (motor, goal(motor))));
        let goals: BTreeMap<Motor, i64> = goals.collect();
        let mut nodes: Vec<(i64, String)> = Vec::new();
        for (motor, goal) in &goals {
            let number = motor.number().to_string();
            match nodes.iter_mut().find(|(other, _)| other == goal) {
                Some((_, nodes)) => nodes.push_str(&number),
                None => nodes.push((*goal, number)),
            }
        }
        let mut lines: Vec<String> =
            nodes.iter().map(|(goal, nodes)| format!("{nodes} S E {goal}")).collect();
        let all: String = goals.keys().map(|motor| motor.number().to_string()).collect();
        lines.push(format!("{all} S M 5"));
        self.lines.extend(lines.clone());
        lines
    }

    /// The next line for the hand, with its line end, if the hand is waiting for one.
    pub fn next_line(&mut self) -> Option<String> {
        if self.awaiting.is_some() || !self.moving.is_empty() {
            return None;
        }
        let line = self.lines.pop_front()?;
        self.moving = started_by(&line);
        // The hand may have prompted before the connection was made.
        self.echoed = line.is_empty();
        let with_end = format!("{line}\r");
        self.awaiting = Some(line);
        Some(with_end)
    }

    /// A byte from the hand. Returns each complete line for display, and each packet as a line.
    pub fn push_byte(&mut self, byte: u8) -> Option<String> {
        if !self.packet.is_empty() || packets::is_head(byte) {
            return self.push_packet(byte);
        }
        match byte {
            b'\r' => return None,
            b'\n' => return self.line(),
            byte => self.input.push(char::from(byte)),
        }
        if self.input == PROMPT && self.echoed {
            self.awaiting = None;
        }
        (self.input.len() >= MAX_LINE).then(|| self.line()).flatten()
    }

    fn push_packet(&mut self, byte: u8) -> Option<String> {
        if self.packet.is_empty() {
            // The echo of the line that it answers ends where it begins.
            self.end_prompt();
        }
        self.packet.push(byte);
        packets::len(&self.packet)?;
        let packet = std::mem::take(&mut self.packet);
        if let Some(meaning) = packets::meaning(&packet) {
            self.note_end(&meaning);
        }
        Some(packets::text(&packet))
    }

    /// Ends a prompt, with the echo after it or nothing. Returns whether there was one.
    fn end_prompt(&mut self) -> bool {
        let Some(echo) = self.input.strip_prefix(PROMPT) else { return false };
        // Nothing after the prompt: what follows is unsolicited.
        self.echoed |= self.awaiting.as_deref() == Some(echo);
        self.input.clear();
        true
    }

    fn note_end(&mut self, line: &str) {
        if let Some((motor, _)) = line.split_once(" MODE=")
            && let Some(motor) = motors(motor)
        {
            self.moving = self.moving.difference(motor);
        }
    }

    fn line(&mut self) -> Option<String> {
        if self.end_prompt() {
            return None;
        }
        let line = std::mem::take(&mut self.input);
        self.note_end(&line);
        if line.starts_with("ERR ") {
            self.had_error = true;
            self.moving = Motors::NONE;
            // Motors whose goal was not set must not start.
            self.lines.clear();
        }
        Some(line).filter(|line| !line.is_empty())
    }
}

/// Hall counts.
fn default(name: &str, motor: Motor) -> i64 {
    units::halls_from_gcl(parameter::motor(name).map_or(0, |row| row.default_for(motor.kind())))
}

/// Parses `123`.
fn motors(entry: &str) -> Option<Motors> {
    let motor = |digit: char| Motor::new(u8::try_from(digit.to_digit(10)?).ok()?);
    let motors = entry.chars().filter(|c| !c.is_whitespace()).map(motor).collect::<Option<Motors>>()?;
    (!motors.is_empty()).then_some(motors)
}

/// The motors that a line starts on a move of mode 5: `4 S M 5`.
fn started_by(line: &str) -> Motors {
    let line = line.to_ascii_uppercase();
    let words: Vec<&str> = line.split_whitespace().collect();
    match words[..] {
        [nodes, "S", "M" | "MODE", "5"] => motors(nodes).unwrap_or_default(),
        _ => Motors::NONE,
    }
}

fn bad(problem: &str, found: &str, expected: String) -> BadInput {
    BadInput {
        place: "entry".to_owned(),
        problem: problem.to_owned(),
        found: format!("{found:?}"),
        expected,
        next: "enter the command again".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn console() -> Console {
        let mut console = Console::default();
        assert_eq!(console.next_line().as_deref(), Some("\r"));
        feed(&mut console, "\r\n\r=> ");
        console
    }

    fn feed(console: &mut Console, text: &str) -> Vec<String> {
        let byte = |c: char| u8::try_from(c).expect("Latin-1");
        text.chars().filter_map(|c| console.push_byte(byte(c))).collect()
    }

    /// The lines that entries become if the hand answers each correctly.
    fn lines(entries: &[&str]) -> Vec<String> {
        let mut console = console();
        let mut lines = Vec::new();
        for entry in entries {
            assert!(console.question().is_some(), "{entry}");
            let made = console.enter(entry).expect("valid");
            let from = lines.len();
            while let Some(line) = console.next_line() {
                let line = line.trim_end();
                feed(&mut console, &format!("{line}\r\n\r=> "));
                for motor in console.moving.iter().collect::<Vec<_>>() {
                    assert_eq!((console.next_line(), console.question()), (None, None), "moving");
                    let report = format!("{} MODE=0", motor.number());
                    assert_eq!(feed(&mut console, &format!("\r\n\r{report}\r\n\r=> ")), [report]);
                }
                lines.push(line.to_owned());
            }
            assert!(made.is_empty() || made == lines[from..], "{made:?}");
        }
        lines
    }

    #[test]
    fn valid_entry_becomes_lines() {
        for (entries, expected) in [
            (&["WAKE"][..], &["WAKE"][..]),
            (&[" 4 S E 82 ", "4 s mode 5"], &["4 S E 82", "4 s mode 5"]),
            (&["M", "123", "100"], &["123 S E 100", "567 S E 27", "123567 S M 5"]),
            (&["m", "3 1", " -20 "], &["13 S E -20", "57 S E -5", "1357 S M 5"]),
            (&["M", "16", "100"], &["16 S E 100", "5 S E 27", "156 S M 5"]),
            (&["M", "15", "100"], &["15 S E 100", "15 S M 5"]),
            // 18200 and 9300 counts are 331 and 169 hall counts; the tip moves a third of its link's angle.
            (&["C", "1"], &["1 S E 331", "5 S E 88", "15 S M 5"]),
            (&["C", "47"], &["4 S E 169", "7 S E 331", "47 S M 5"]),
            (&["O", "1"], &["15 S E 0", "15 S M 5"]),
            (&["C", "1", "WAKE"], &["1 S E 331", "5 S E 88", "15 S M 5", "WAKE"]),
            (&[""], &[""]),
        ] {
            assert_eq!(lines(entries), expected, "{entries:?}");
        }
    }

    #[test]
    fn invalid_entry_drops_the_command() {
        let long = "x".repeat(161);
        for entries in [
            &["M", ""][..],
            &["M", "8"],
            &["M", "0"],
            &["M", "1,2"],
            &["M", "all"],
            &["C", "12x"],
            &["M", "123", ""],
            &["M", "123", "1.5"],
            &["M", "123", "far"],
            &["M", "123", "32768"],
            &["M", "123", "99999999999999999999"],
            &["12LOOP"],
            &["1 S É"],
            &["1\tS"],
            &[&long],
        ] {
            let mut console = console();
            let (last, first) = entries.split_last().expect("one at least");
            first.iter().for_each(|entry| assert_eq!(console.enter(entry).expect("good"), [""; 0]));
            let error = console.enter(last).expect_err("invalid");
            assert_eq!(error.found, format!("{last:?}"));
            assert_eq!((console.next_line(), console.question()), (None, Some(PROMPT)), "{entries:?}");
        }
    }

    #[test]
    fn error_drops_pending_lines() {
        for (wrong, answers) in [(0, "ERR 8192"), (1, "ERR 1"), (2, "ERR 8192")] {
            let mut console = console();
            console.enter("C").expect("good");
            console.enter("1").expect("good");
            for place in 0..=wrong {
                let line = console.next_line().expect("a line").trim_end().to_owned();
                let answer = if place == wrong { format!("\r\n\r{answers}") } else { String::new() };
                assert!(!console.had_error());
                feed(&mut console, &format!("{line}{answer}\r\n\r=> "));
            }
            assert_eq!((console.next_line(), console.question()), (None, Some(PROMPT)), "{wrong}");
            assert!(console.had_error());
        }
    }

    /// A report that was under way when a line was sent precedes its echo.
    #[test]
    fn prompt_of_a_report_does_not_end_a_line() {
        let mut console = console();
        console.enter("1 G P").expect("good");
        assert_eq!(console.next_line().as_deref(), Some("1 G P\r"));
        assert_eq!(feed(&mut console, "\r\n\r4 MODE=3\r\n\r=> "), ["4 MODE=3"]);
        assert_eq!(console.question(), None, "no answer yet");
        assert_eq!(feed(&mut console, "1 G P\r\n\r1 P=0\r\n\r=> "), ["1 P=0"]);
        assert_eq!(console.question(), Some(PROMPT));
    }

    /// `0 S REPLY 1`: reports are packets, and so are answers; any byte may be in them.
    #[test]
    fn packets_are_shown_and_end_waits() {
        let mut console = console();
        for entry in ["4 S M 5", "4 G M"] {
            console.enter(entry).expect("good");
        }
        assert_eq!(console.next_line().as_deref(), Some("4 S M 5\r"));
        feed(&mut console, "4 S M 5\r\n\r=> ");
        assert_eq!(console.next_line(), None, "it moves");
        let shown = feed(&mut console, "\x04\u{86}\x04\u{88}\0\x03\0\r\n\r=> ");
        assert_eq!(shown, ["04 86 04 88 00 03 00 (4 MODE=3)"]);
        assert_eq!(console.next_line().as_deref(), Some("4 G M\r"));
        let shown = feed(&mut console, "4 G M\x04\u{86}\x04\u{88}\0\x0A\0\r\n\r=> ");
        assert_eq!(shown, ["04 86 04 88 00 0A 00 (4 MODE=10)"]);
        assert_eq!(console.question(), Some(PROMPT));
    }

    #[test]
    fn endless_line_is_shown_in_pieces() {
        let mut console = console();
        let shown = feed(&mut console, &"x".repeat(10 * MAX_LINE));
        assert!(shown.len() >= 9 && console.input.len() < MAX_LINE, "{}", shown.len());
    }
}
