//! Connecting to a hand: each step that can fail names its cause.

use std::sync::Arc;
use std::time::Duration;

use tater_wire::Node;

use super::{BoardState, Hand};
use crate::deadline::Deadline;
use crate::error::{CallError, Cause, ConnectError, Failure, beginning};
use crate::port::Port;
use crate::session::Session;

/// The first firmware version that this library knows.
pub const FIRST_VERSION: u16 = god::god::VERSION;

/// How long a refusal is retried: a hand notices the end of its last host with a delay.
const BUSY: Duration = Duration::from_millis(500);

/// Pause between two attempts.
const RETRY: Duration = Duration::from_millis(20);

/// How a hand begins to refuse a second host.
const REFUSAL: &str = "busy: ";

/// What the motor boards must be for a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Boards {
    /// They are woken, and all seven must be ready.
    Wake,
    /// All seven must be ready already: a sleeping one is [`Cause::Asleep`].
    Ready,
    /// They are not asked: for a download, or to find out what is wrong with them.
    Any,
}

enum Line {
    Tcp,
    #[cfg(unix)]
    Serial(u32),
}

/// How to connect to a hand.
pub struct Connect {
    place: String,
    line: Line,
    boards: Boards,
}

impl Connect {
    /// Over TCP, to `HOST:PORT`.
    #[must_use]
    pub fn tcp(address: &str) -> Self {
        Self { place: address.to_owned(), line: Line::Tcp, boards: Boards::Wake }
    }

    /// Over a serial port such as `/dev/ttyUSB0`; the hand's default is 9600 baud (parameter BAUD).
    #[cfg(unix)]
    #[must_use]
    pub fn serial(path: &str, baud: u32) -> Self {
        Self { place: path.to_owned(), line: Line::Serial(baud), boards: Boards::Wake }
    }

    /// What the motor boards must be; [`Boards::Wake`] unless it is called.
    #[must_use]
    pub const fn boards(mut self, boards: Boards) -> Self {
        self.boards = boards;
        self
    }

    /// Connects.
    ///
    /// # Errors
    /// The cause and the next step, within the limit.
    pub fn connect(&self, limit: Duration) -> Result<Hand, ConnectError> {
        let deadline = Deadline::after(limit);
        let failed = |cause| ConnectError { place: self.place.clone(), cause };
        let session = self.open(&deadline).map_err(failed)?;
        let mut hand = Hand { session, place: self.place.clone(), version: 0, was_cancelled: Arc::default() };
        hand.version = version(&mut hand, &deadline).map_err(failed)?;
        prepare(&mut hand, self.boards, &deadline).map_err(failed)?;
        Ok(hand)
    }

    /// Opens the line and finds the prompt.
    fn open(&self, deadline: &Deadline) -> Result<Session, Cause> {
        loop {
            let port = match self.line {
                Line::Tcp => Port::tcp(&self.place, deadline)?,
                #[cfg(unix)]
                Line::Serial(baud) => Port::tty(&self.place, baud)?,
            };
            let mut session = Session::new(port);
            match find_prompt(&mut session, deadline) {
                Ok(()) => return Ok(session),
                Err(Cause::InUse(_)) if deadline.elapsed() < BUSY && !deadline.is_over() => {
                    std::thread::park_timeout(RETRY.min(deadline.remaining()));
                }
                Err(cause) => return Err(cause),
            }
        }
    }
}

impl Hand {
    /// Connects over TCP to `HOST:PORT`, wakes the motor boards and requires all seven. See [`Connect`] for other ways.
    ///
    /// # Errors
    /// The cause and the next step.
    pub fn connect(address: &str, limit: Duration) -> Result<Self, ConnectError> {
        Connect::tcp(address).connect(limit)
    }
}

/// An empty line has a prompt for its answer.
fn find_prompt(session: &mut Session, deadline: &Deadline) -> Result<(), Cause> {
    // A hand that refuses may have closed already: what it said comes first.
    let written = session.write(b"\r", deadline);
    let outcome = session.until_prompt(deadline).map(drop);
    let text = session.take_text();
    let received = beginning(&text);
    if session.negotiates_telnet() {
        return Err(Cause::Telnet);
    }
    if let Some((_, by)) = received.split_once(REFUSAL) {
        return Err(Cause::InUse(by.trim().to_owned()));
    }
    match written.and(outcome) {
        Ok(()) => Ok(()),
        Err(Failure::TimedOut(limit)) if text.is_empty() => Err(Cause::Silent(limit)),
        Err(Failure::Lost(why)) if text.is_empty() => Err(Cause::HungUp(why)),
        Err(Failure::Unexpected(received)) => Err(Cause::NotAHand(received)),
        Err(_) => Err(Cause::NotAHand(received)),
    }
}

/// The cause of a call that failed during the connection.
fn of_call(CallError { failure, .. }: CallError, deadline: &Deadline) -> Cause {
    match failure {
        Failure::TimedOut(_) => Cause::Silent(deadline.limit()),
        Failure::Lost(why) => Cause::HungUp(why),
        failure => Cause::NotAHand(failure.to_string()),
    }
}

fn version(hand: &mut Hand, deadline: &Deadline) -> Result<u16, Cause> {
    let found =
        hand.command("VERS", deadline.remaining()).map_err(|error| of_call(error, deadline))?.join(" ");
    match found.parse() {
        Ok(version) if version >= FIRST_VERSION => Ok(version),
        _ => Err(Cause::WrongFirmware { found, expected: FIRST_VERSION }),
    }
}

/// Brings the boards into the state that the caller wants.
fn prepare(hand: &mut Hand, boards: Boards, deadline: &Deadline) -> Result<(), Cause> {
    if boards == Boards::Any {
        return Ok(());
    }
    let mut states = hand.boards(deadline.remaining()).map_err(|error| of_call(error, deadline))?;
    if boards == Boards::Wake && states.contains(&BoardState::Asleep) {
        // ERR 1: the states tell which.
        if let Err(error) = hand.wake(deadline.remaining())
            && !matches!(error.failure, Failure::Status(_))
        {
            return Err(of_call(error, deadline));
        }
        states = hand.boards(deadline.remaining()).map_err(|error| of_call(error, deadline))?;
    }
    of_states(&states)
}

/// The first cause among the boards' states, if any.
fn of_states(states: &[BoardState; 7]) -> Result<(), Cause> {
    let nodes = |is: fn(BoardState) -> bool| -> Vec<Node> {
        let numbered = (1..).zip(states).filter(|(_, state)| is(**state));
        numbered.filter_map(|(number, _)| Node::new(number)).collect()
    };
    let silent = nodes(|state| state == BoardState::Silent);
    let asleep = nodes(|state| matches!(state, BoardState::Asleep | BoardState::Unusable));
    match (silent.len(), asleep.is_empty()) {
        (7, _) => Err(Cause::BusNotAcknowledged),
        (1.., _) => Err(Cause::WithoutPower(silent)),
        (0, false) => Err(Cause::Asleep(asleep)),
        (0, true) => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silent_boards_are_named_before_sleeping_ones() {
        use BoardState::{Asleep, Ready, Silent};
        let node = |number| Node::new(number).expect("a node");
        assert_eq!(of_states(&[Ready; 7]), Ok(()));
        assert_eq!(of_states(&[Silent; 7]), Err(Cause::BusNotAcknowledged));
        let mut states = [Ready; 7];
        states[4] = Asleep;
        assert_eq!(of_states(&states), Err(Cause::Asleep(vec![node(5)])));
        states[0] = Silent;
        assert_eq!(of_states(&states), Err(Cause::WithoutPower(vec![node(1)])));
    }
}
