//! GOD with its boards, from the host's bytes to the motors.

mod administration;
mod asleep;
mod bus_down;
mod deadlines;
mod enabled;
mod faults;
mod garbage;
mod golden;
mod heat;

mod movement;
mod packets;
mod program;
mod prompt;
mod realtime;
mod same_number;
mod sequences;
mod settings;
mod state;
mod tables;
mod two_grammars;
mod walk_through_grammar;
mod world;

use god::Memory;
use hil_world::board::SimBoard;
use hil_world::hand::Hand;
use hil_world::node::Node;
use hil_world::plant::Model;
use tater_wire::Node as Id;

pub struct Session {
    pub hand: Hand,
    pub transcript: String,
}

type Exchange = (&'static str, &'static str);

/// Timeout of a command in simulated time, us.
const COMMAND_US: u64 = 120_000_000;

/// Time after which a command whose boards are awake has begun, us.
const START_US: u64 = 500_000;

impl Session {
    pub fn new() -> Self {
        Self::with_memory(Memory::default())
    }

    pub fn with_memory(memory: Memory) -> Self {
        Self::from_hand(Hand::new(Model::Averaged, 1, memory))
    }

    pub fn with_boards(board: impl Fn(u8, Id) -> SimBoard) -> Self {
        let boards = (1..=7).map(|number| Node::new(board(number, Id::new(number).expect("a node"))));
        Self::from_hand(Hand::with(boards.collect(), Memory::default()))
    }

    pub fn from_hand(hand: Hand) -> Self {
        let mut session = Self { hand, transcript: String::new() };
        session.read_to_prompt();
        session
    }

    /// Types a line and waits for the prompt. Returns the answer: the text between echo and prompt, without line ends at its edges.
    pub fn run(&mut self, line: &str) -> String {
        self.type_line(line);
        answer(line, &self.read_to_prompt())
    }

    /// As [`Self::run`], with a timeout. Returns the answer and the time from the end of the line to the prompt, us.
    ///
    /// # Errors
    /// No prompt in time: the text so far and the state of the motors.
    pub fn try_run(&mut self, line: &str, within_us: u64) -> Result<(String, u64), String> {
        self.type_line(line);
        let (text, us) = self.try_read_to_prompt(within_us).map_err(|hang| format!("{line}: {hang}"))?;
        Ok((answer(line, &text), us))
    }

    /// Types a line that ends only by further input, and lets it run for [`START_US`]. Returns the text so far.
    pub fn start(&mut self, line: &str) -> String {
        self.type_line(line);
        self.wait_us(START_US);
        let text: String = self.hand.take_tx().into_iter().map(char::from).collect();
        self.transcript.push_str(&text);
        text
    }

    /// As [`Self::start`]; then sends `input` and waits for the prompt. Returns the answer.
    pub fn run_with_input(&mut self, line: &str, input: &[u8]) -> String {
        let text = self.start(line);
        self.hand.push_rx(input);
        answer(line, &(text + &self.read_to_prompt()))
    }

    pub fn type_line(&mut self, line: &str) {
        self.hand.push_rx(line.as_bytes());
        self.hand.push_rx(b"\r");
    }

    pub fn read_to_prompt(&mut self) -> String {
        self.try_read_to_prompt(COMMAND_US).unwrap_or_else(|hang| panic!("{hang}")).0
    }

    /// As [`Self::read_to_prompt`], with a timeout. Returns the time as well, us.
    ///
    /// # Errors
    /// No prompt in time: the text so far and the state of the motors.
    pub fn try_read_to_prompt(&mut self, within_us: u64) -> Result<(String, u64), String> {
        let start_us = self.hand.now_us();
        let mut text = String::new();
        while !text.ends_with("\n\r=> ") {
            if self.hand.now_us() - start_us > within_us {
                return Err(format!(
                    "no prompt within {} ms, only {text:?}; {}",
                    within_us / 1000,
                    self.motors()
                ));
            }
            self.wait_us(1000);
            text.extend(self.hand.take_tx().into_iter().map(char::from));
        }
        self.transcript.push_str(&text);
        Ok((text, self.hand.now_us() - start_us))
    }

    pub fn motors(&self) -> String {
        let motor = |node: &Node| {
            node.application().map_or("asleep".to_owned(), |tater| {
                let telemetry = tater.status();
                format!("{:?} {:?} {:?}", telemetry.mode, telemetry.end, telemetry.fault)
            })
        };
        let motors: Vec<String> = self.hand.bus().stations().map(motor).collect();
        format!("motors: {}", motors.join(", "))
    }

    pub fn wait_us(&mut self, us: u64) {
        self.hand.run_until(self.hand.now_us() + us);
    }
}

fn answer(line: &str, text: &str) -> String {
    let text = text.strip_prefix(line).unwrap_or_else(|| panic!("no echo of {line:?} in {text:?}"));
    text.strip_suffix("=> ").expect("it ends with the prompt").trim().replace("\r\n\r", "\n")
}

fn assert_answers(session: &mut Session, exchanges: &[(&str, &str)]) {
    for (line, answer) in exchanges {
        assert_eq!(session.run(line), *answer, "{line}");
    }
}
