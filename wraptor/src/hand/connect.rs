//! Connecting to a hand: each step that can fail names its cause.

use std::sync::Arc;
use std::time::Duration;

use tater_wire::{Destination, Group, Message, Node, Property};

use super::{BoardState, Hand};
use crate::adapter::Adapter;
use crate::deadline::Deadline;
use crate::error::{CallError, Cause, ConnectError, Failure, beginning};
use crate::interpreter;
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

/// Time of an adapter to refuse a frame: a network's way there and back.
const REFUSED: Duration = Duration::from_millis(100);

enum Line {
    Tcp,
    Serial(u32),
    Can,
}

/// Baud rate of a serial adapter whose place has none. Adapters on USB have none of their own.
#[cfg(unix)]
const BAUD: u32 = 115_200;

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

    /// Over a serial port such as `/dev/ttyUSB0`; the hand's default is 9600 baud (parameter BAUD). On Windows it fails.
    #[must_use]
    pub fn serial(path: &str, baud: u32) -> Self {
        Self { place: path.to_owned(), line: Line::Serial(baud), boards: Boards::Wake }
    }

    /// Over CAN, without GOD: this program interprets the hand's language itself, and is the bus's one host. `place` is a CAN interface of Linux that
    /// is up at 1 Mbit/s (`can0`), or an SLCAN adapter over TCP (`HOST:PORT`) or on a serial port (`/dev/ttyACM0`, `/dev/ttyUSB0@57600`).
    #[must_use]
    pub fn can(place: &str) -> Self {
        Self { place: place.to_owned(), line: Line::Can, boards: Boards::Wake }
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
        let has_god = !matches!(self.line, Line::Can);
        let (place, was_cancelled) = (self.place.clone(), Arc::default());
        let mut hand = Hand { session, place, version: 0, has_god, was_cancelled };
        hand.version = version(&mut hand, &deadline).map_err(failed)?;
        prepare(&mut hand, self.boards, &deadline).map_err(failed)?;
        Ok(hand)
    }

    /// Opens the line and finds the prompt.
    fn open(&self, deadline: &Deadline) -> Result<Session, Cause> {
        loop {
            let port = match self.line {
                Line::Tcp => Port::tcp(&self.place, deadline)?,
                Line::Serial(baud) => Port::tty(&self.place, baud)?,
                Line::Can => {
                    let mut adapter = adapter(&self.place, deadline)?;
                    require_right_to_send(&mut adapter, deadline)?;
                    interpreter::start(adapter)?
                }
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

/// Opens an adapter or an interface.
fn adapter(place: &str, deadline: &Deadline) -> Result<Adapter, Cause> {
    #[cfg(unix)]
    if place.contains('/') {
        let (path, baud) = place.rsplit_once('@').unwrap_or((place, ""));
        return match (baud, baud.parse()) {
            ("", _) => Adapter::slcan_serial(path, BAUD, deadline),
            (_, Ok(baud)) => Adapter::slcan_serial(path, baud, deadline),
            (_, Err(_)) => Err(Cause::BadAddress(format!("expected a baud rate after @, found {baud:?}"))),
        };
    }
    #[cfg(target_os = "linux")]
    if !place.contains(':') {
        return Adapter::can(place);
    }
    Adapter::slcan(place, deadline)
}

/// Asks all boards for STAT: an adapter beside a hand's GOD refuses that, and nothing else would tell.
fn require_right_to_send(adapter: &mut Adapter, deadline: &Deadline) -> Result<(), Cause> {
    let gone = |failure: Failure| match failure {
        Failure::TimedOut(limit) => Cause::Silent(limit),
        Failure::Lost(why) => Cause::HungUp(why),
        failure => Cause::HungUp(failure.to_string()),
    };
    let question = Message::get(Destination::Group(Group::TATERS), Property::STAT).frame();
    adapter.set_refused(false);
    adapter.send(&question, deadline).map_err(gone)?;
    // Others may talk on the bus meanwhile.
    let answered = deadline.within(REFUSED);
    while adapter.receive(&answered).map_err(gone)?.is_some() && !answered.is_over() {}
    match adapter.set_refused(false) {
        true => Err(Cause::InUse("the adapter refuses frames, because the bus has another host".to_owned())),
        false => Ok(()),
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
    if boards == Boards::Wake {
        // ERR 1: the states tell which.
        if let Err(error) = hand.wake(deadline.remaining())
            && !matches!(error.failure, Failure::Status(_))
        {
            return Err(of_call(error, deadline));
        }
    }
    let states = hand.boards(deadline.remaining()).map_err(|error| of_call(error, deadline))?;
    // Before the silent ones: a board with a wrong number is both.
    let doubled = hand.doubled(deadline.remaining()).map_err(|error| of_call(error, deadline))?;
    if doubled.is_empty() { of_states(&states) } else { Err(Cause::TwoBoards(doubled)) }
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
