//! The host's program of the walk-through, GrasperTest (manual 3): what a person enters, a line at a time, becomes lines for the hand.
//!
//! `M`, `C` and `O` are this program's own: they ask for motors, and M for a position, and become lines of the lower grammar, in hall
//! counts. As the manual's functions move, close and open (7) they take a link's tip along; what is closed and open are the
//! defaults of CT and OT. Every other entry goes to the hand as it is. Who has sent motors on a move (`4 S M 5`) waits until each has
//! said that it has ended (`4 MODE=3`), as the manual's function command does.
//!
//! The walk-through has no HI: it begins with a hand that knows where it is, because it was homed once and put away with SAVE, as in
//! step 17. One that does not know takes the place where it woke up for 0, and moves all the same; but what it SAVEs it will not trust.
//!
//! Nothing here reads or writes: bytes of the hand and entries of the person go in, lines and texts come out.

use std::collections::{BTreeMap, VecDeque};

use god::motors::{Motor, Motors};
use god::{line, parameter, units};
use tater_wire::Property;

use crate::experiment::input::BadInput;

/// What the hand says when it waits for a line, and this program too.
const PROMPT: &str = "=> ";

/// Longest line of the hand that is kept whole: some times what it says at once.
const LONGEST: usize = 1024;

/// What a person is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Question {
    Command,
    Motors(Own),
    Position(Motors),
}

/// The commands that this program has itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Own {
    Move,
    Close,
    Open,
}

/// Between a person and a hand.
#[derive(Debug)]
pub struct Console {
    question: Question,
    /// What the hand is still to be told.
    lines: VecDeque<String>,
    /// What it has been told, until its prompt comes.
    said: Option<String>,
    /// That has been echoed: the next prompt is its.
    echoed: bool,
    /// The hand's line, as far as it has come.
    heard: String,
    /// Who has not said yet that its motion has ended.
    moving: Motors,
    went_wrong: bool,
}

impl Default for Console {
    fn default() -> Self {
        Self {
            question: Question::Command,
            // An empty line gets the prompt.
            lines: VecDeque::from([String::new()]),
            said: None,
            echoed: false,
            heard: String::new(),
            moving: Motors::NONE,
            went_wrong: false,
        }
    }
}

impl Console {
    /// What the person is asked, if it is the person's turn.
    #[must_use]
    pub fn asks(&self) -> Option<&'static str> {
        let is_done = self.lines.is_empty() && self.said.is_none() && self.moving.is_empty();
        is_done.then_some(match self.question {
            Question::Command => PROMPT,
            Question::Motors(_) => "Motors: ",
            Question::Position(_) => "Position: ",
        })
    }

    /// Whether the person is in the middle of M, C or O.
    #[must_use]
    pub fn is_asking(&self) -> bool {
        self.question != Question::Command
    }

    /// Whether the hand has told an error so far.
    #[must_use]
    pub const fn went_wrong(&self) -> bool {
        self.went_wrong
    }

    /// The person's answer. Returns the lines that it comes to, if they are not the entry itself.
    ///
    /// # Errors
    /// It is none; then nothing is told to the hand, and the command is forgotten.
    pub fn enter(&mut self, entry: &str) -> Result<Vec<String>, BadInput> {
        let entry = entry.trim();
        match std::mem::replace(&mut self.question, Question::Command) {
            Question::Command => self.command(entry).map(|()| Vec::new()),
            Question::Motors(own) => {
                let motors = motors(entry).ok_or_else(|| {
                    bad("these are no motors", entry, "motors from 1 to 7, such as 123".to_owned())
                })?;
                Ok(match own {
                    Own::Move => {
                        self.question = Question::Position(motors);
                        Vec::new()
                    }
                    Own::Close => self.go(motors, |motor| default("CT", motor)),
                    Own::Open => self.go(motors, |motor| default("OT", motor)),
                })
            }
            Question::Position(motors) => {
                let rules = Property::E.rules();
                let position = entry.parse().ok().filter(|&position| rules.admits(position));
                let expected =
                    || format!("a whole number of hall counts, {} to {}", rules.min(), rules.max());
                let position = position.ok_or_else(|| bad("this is no position", entry, expected()))?;
                Ok(self.go(motors, |_| position))
            }
        }
    }

    fn command(&mut self, entry: &str) -> Result<(), BadInput> {
        let own = match &*entry.to_ascii_uppercase() {
            "M" => Own::Move,
            "C" => Own::Close,
            "O" => Own::Open,
            name if name.ends_with("LOOP") => {
                let expected = "commands that end with a prompt; RealTime control is for programs".to_owned();
                return Err(bad("this cannot be entered", entry, expected));
            }
            _ if entry.len() > line::LENGTH || !entry.bytes().all(|byte| matches!(byte, b' '..=b'~')) => {
                let expected = format!("up to {} characters of ASCII", line::LENGTH);
                return Err(bad("this is no line for the hand", entry, expected));
            }
            _ => {
                self.lines.push_back(entry.to_owned());
                return Ok(());
            }
        };
        self.question = Question::Motors(own);
        Ok(())
    }

    /// Motors, and the tips of links among them, are to go to their goals, hall counts. Returns the lines that say so.
    fn go(&mut self, motors: Motors, goal: impl Fn(Motor) -> i64) -> Vec<String> {
        let along = |link: Motor| Some((link.tip()?, units::of_tip_along(goal(link))));
        // A tip that is named itself comes later, and goes by its own.
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

    /// The next line for the hand, with its end, if it waits for one.
    pub fn says(&mut self) -> Option<String> {
        if self.said.is_some() || !self.moving.is_empty() {
            return None;
        }
        let line = self.lines.pop_front()?;
        self.moving = sent(&line);
        // The prompt before the first line may have come before we did.
        self.echoed = line.is_empty();
        let with_end = format!("{line}\r");
        self.said = Some(line);
        Some(with_end)
    }

    /// A byte from the hand. Returns a line for the person, whenever one is complete.
    pub fn hears(&mut self, byte: u8) -> Option<String> {
        match byte {
            b'\r' => return None,
            b'\n' => return self.line(),
            byte => self.heard.push(char::from(byte)),
        }
        if self.heard == PROMPT && self.echoed {
            self.said = None;
        }
        (self.heard.len() >= LONGEST).then(|| self.line()).flatten()
    }

    /// The hand has ended a line.
    fn line(&mut self) -> Option<String> {
        let line = std::mem::take(&mut self.heard);
        if let Some(echo) = line.strip_prefix(PROMPT) {
            // Nothing after it: what comes next was not asked for.
            self.echoed |= self.said.as_deref() == Some(echo);
            return None;
        }
        if let Some((motor, _)) = line.split_once(" MODE=")
            && let Some(motor) = motors(motor)
        {
            self.moving = self.moving.difference(motor);
        }
        if line.starts_with("ERR ") {
            self.went_wrong = true;
            self.moving = Motors::NONE;
            // Whoever is not told where to go does not start.
            self.lines.clear();
        }
        Some(line).filter(|line| !line.is_empty())
    }
}

/// A motor's parameter that nobody has set, in hall counts.
fn default(name: &str, motor: Motor) -> i64 {
    units::halls(parameter::motor(name).map_or(0, |row| row.default_for(motor.kind())))
}

/// `123`.
fn motors(entry: &str) -> Option<Motors> {
    let motor = |digit: char| Motor::new(u8::try_from(digit.to_digit(10)?).ok()?);
    let motors = entry.chars().filter(|c| !c.is_whitespace()).map(motor).collect::<Option<Motors>>()?;
    (!motors.is_empty()).then_some(motors)
}

/// Those that a line sends on a move of mode 5: `4 S M 5`.
fn sent(line: &str) -> Motors {
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

    /// A console whose hand has prompted.
    fn console() -> Console {
        let mut console = Console::default();
        assert_eq!(console.says().as_deref(), Some("\r"));
        hear(&mut console, "\r\n\r=> ");
        console
    }

    /// What the hand says; what the person sees of it.
    fn hear(console: &mut Console, text: &str) -> Vec<String> {
        text.bytes().filter_map(|byte| console.hears(byte)).collect()
    }

    /// The lines that entries come to, if each is answered as it should be.
    fn lines(entries: &[&str]) -> Vec<String> {
        let mut console = console();
        let mut lines = Vec::new();
        for entry in entries {
            assert!(console.asks().is_some(), "{entry}");
            let made = console.enter(entry).expect("it is good");
            let from = lines.len();
            while let Some(line) = console.says() {
                let line = line.trim_end();
                hear(&mut console, &format!("{line}\r\n\r=> "));
                for motor in console.moving.iter().collect::<Vec<_>>() {
                    assert_eq!((console.says(), console.asks()), (None, None), "it moves");
                    let report = format!("{} MODE=0", motor.number());
                    assert_eq!(hear(&mut console, &format!("\r\n\r{report}\r\n\r=> ")), [report]);
                }
                lines.push(line.to_owned());
            }
            assert!(made.is_empty() || made == lines[from..], "{made:?}");
        }
        lines
    }

    #[test]
    fn entries_become_lines() {
        for (entries, expected) in [
            (&["WAKE"][..], &["WAKE"][..]),
            (&[" 4 S E 82 ", "4 s mode 5"], &["4 S E 82", "4 s mode 5"]),
            (&["M", "123", "100"], &["123 S E 100", "567 S E 27", "123567 S M 5"]),
            (&["m", "3 1", " -20 "], &["13 S E -20", "57 S E -5", "1357 S M 5"]),
            // A tip that is named goes by its own.
            (&["M", "16", "100"], &["16 S E 100", "5 S E 27", "156 S M 5"]),
            (&["M", "15", "100"], &["15 S E 100", "15 S M 5"]),
            // 18200 and 9300 counts are 331 and 169 hall counts; the tip has a third of its link's angle.
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
    fn entries_that_are_none_are_refused_and_forgotten() {
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
            let error = console.enter(last).expect_err("it is none");
            assert_eq!(error.found, format!("{last:?}"));
            assert_eq!((console.says(), console.asks()), (None, Some(PROMPT)), "{entries:?}");
        }
    }

    /// Nobody starts who was not told where to.
    #[test]
    fn an_error_ends_what_goes_on() {
        for (wrong, answers) in [(0, "ERR 8192"), (1, "ERR 1"), (2, "ERR 8192")] {
            let mut console = console();
            console.enter("C").expect("good");
            console.enter("1").expect("good");
            for place in 0..=wrong {
                let line = console.says().expect("a line").trim_end().to_owned();
                let answer = if place == wrong { format!("\r\n\r{answers}") } else { String::new() };
                assert!(!console.went_wrong());
                hear(&mut console, &format!("{line}{answer}\r\n\r=> "));
            }
            assert_eq!((console.says(), console.asks()), (None, Some(PROMPT)), "{wrong}");
            assert!(console.went_wrong());
        }
    }

    /// A report that was on its way when a line was said comes before its echo.
    #[test]
    fn a_prompt_that_is_another_line_s_is_not_waited_for() {
        let mut console = console();
        console.enter("1 G P").expect("good");
        assert_eq!(console.says().as_deref(), Some("1 G P\r"));
        assert_eq!(hear(&mut console, "\r\n\r4 MODE=3\r\n\r=> "), ["4 MODE=3"]);
        assert_eq!(console.asks(), None, "its answer has not come");
        assert_eq!(hear(&mut console, "1 G P\r\n\r1 P=0\r\n\r=> "), ["1 P=0"]);
        assert_eq!(console.asks(), Some(PROMPT));
    }

    /// Whatever a hand says, it is shown in pieces, and forgotten.
    #[test]
    fn a_line_without_an_end_takes_no_room() {
        let mut console = console();
        let shown = hear(&mut console, &"x".repeat(10 * LONGEST));
        assert!(shown.len() >= 9 && console.heard.len() < LONGEST, "{}", shown.len());
    }
}
