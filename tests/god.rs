//! GOD with its boards, from the host's bytes to the motors.

mod administration;
mod bus_down;
mod deadlines;
mod faults;
mod garbage;
mod golden;
mod lower;
mod movement;
mod program;
mod prompt;
mod realtime;
mod sequences;
mod settings;
mod state;
mod tables;
mod walk_through;
mod world;

use god::Memory;
use hil_sim::board::SimBoard;
use hil_sim::hand::Hand;
use hil_sim::node::Node;
use hil_sim::plant::Model;
use tater_wire::Node as Id;

/// A hand and its host.
pub struct Session {
    pub hand: Hand,
    /// All that was said.
    pub heard: String,
}

/// Longest that a command of a test may take, us.
const MOST_US: u64 = 120_000_000;

/// A while, us: a command whose boards are awake has begun long before its end.
const WHILE_US: u64 = 500_000;

impl Session {
    /// A hand whose power has come on, its banner and its prompt said.
    pub fn new() -> Self {
        Self::with(Memory::default())
    }

    /// The same, with what has survived.
    pub fn with(memory: Memory) -> Self {
        Self::of(Hand::new(Model::Averaged, 1, memory))
    }

    /// The same with boards that a test makes, by their number.
    pub fn of_boards(board: impl Fn(u8, Id) -> SimBoard) -> Self {
        let boards = (1..=7).map(|number| Node::new(board(number, Id::new(number).expect("a node"))));
        Self::of(Hand::with(boards.collect(), Memory::default()))
    }

    pub fn of(hand: Hand) -> Self {
        let mut session = Self { hand, heard: String::new() };
        session.until_prompt();
        session
    }

    /// Types a line, and waits for the next prompt. Returns what came after the echo, without line ends at its edges and the prompt.
    pub fn line(&mut self, line: &str) -> String {
        self.hand.push_rx(line.as_bytes());
        self.hand.push_rx(b"\r");
        answer(line, &self.until_prompt())
    }

    /// Types a line, and waits for the prompt for so long. Returns the answer and the time from the end of the line to the prompt, us.
    ///
    /// # Errors
    /// There was no prompt: what was said, and what the motors do.
    pub fn try_line(&mut self, line: &str, within_us: u64) -> Result<(String, u64), String> {
        self.hand.push_rx(line.as_bytes());
        self.hand.push_rx(b"\r");
        let (said, us) = self.try_until_prompt(within_us).map_err(|hang| format!("{line}: {hang}"))?;
        Ok((answer(line, &said), us))
    }

    /// Waits for the prompt for so long. Returns what was said up to its end, and the time.
    ///
    /// # Errors
    /// There was no prompt: what was said, and what the motors do.
    pub fn try_until_prompt(&mut self, within_us: u64) -> Result<(String, u64), String> {
        let begun_us = self.hand.now_us();
        let mut said = String::new();
        while !said.ends_with("\n\r=> ") {
            if self.hand.now_us() - begun_us > within_us {
                return Err(format!(
                    "no prompt within {} ms, but {said:?}; {}",
                    within_us / 1000,
                    self.motors()
                ));
            }
            self.wait_us(1000);
            said.extend(self.hand.take_tx().into_iter().map(char::from));
        }
        self.heard.push_str(&said);
        Ok((said, self.hand.now_us() - begun_us))
    }

    /// Mode, end and fault of each motor, for messages.
    pub fn motors(&self) -> String {
        let motor = |node: &Node| {
            node.application().map_or("not awake".to_owned(), |tater| {
                let of = tater.status();
                format!("{:?} {:?} {:?}", of.mode, of.end, of.fault)
            })
        };
        let motors: Vec<String> = self.hand.bus().stations().map(motor).collect();
        format!("motors: {}", motors.join(", "))
    }

    /// Types a line that goes on until the host says more, and lets it go on for a while. Returns what was said.
    pub fn begin(&mut self, line: &str) -> String {
        self.hand.push_rx(line.as_bytes());
        self.hand.push_rx(b"\r");
        self.wait_us(WHILE_US);
        let said: String = self.hand.take_tx().into_iter().map(char::from).collect();
        self.heard.push_str(&said);
        said
    }

    /// The same; then says more, and waits for the prompt. Returns what came as [`Self::line`] does.
    pub fn line_and(&mut self, line: &str, more: &[u8]) -> String {
        let said = self.begin(line);
        self.hand.push_rx(more);
        answer(line, &(said + &self.until_prompt()))
    }

    /// Waits for the prompt; what was said up to its end.
    pub fn until_prompt(&mut self) -> String {
        let end = self.hand.now_us() + MOST_US;
        let mut said = String::new();
        while !said.ends_with("\n\r=> ") {
            assert!(self.hand.now_us() < end, "no prompt: {said:?}");
            self.wait_us(1000);
            said.extend(self.hand.take_tx().into_iter().map(char::from));
        }
        self.heard.push_str(&said);
        said
    }

    /// Lets time pass.
    pub fn wait_us(&mut self, us: u64) {
        self.hand.run_until(self.hand.now_us() + us);
    }
}

/// What was said between the echo of a line and the prompt, without line ends at its edges.
fn answer(line: &str, said: &str) -> String {
    let said = said.strip_prefix(line).unwrap_or_else(|| panic!("{line:?} is echoed: {said:?}"));
    said.strip_suffix("=> ").expect("it ends there").trim().replace("\r\n\r", "\n")
}
