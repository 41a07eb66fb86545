//! Why a connection or a call failed: cause, what was found, and the next step.

use std::fmt;
use std::time::Duration;

use god::Status;
use god::status;
use tater_wire::download::DownloadError;
use tater_wire::{FaultCode, Node};

/// Most characters of a caller's argument in an error's text: a line of the language has 160.
const SHOWN: usize = 160;

/// A hand, adapter or bus that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConnectError {
    /// The address, port or interface, as it was given.
    pub place: String,
    /// Why.
    pub cause: Cause,
}

/// Why a connection failed.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Cause {
    /// The address is none, or its name is unknown. Holds the resolver's or parser's words.
    BadAddress(String),
    /// The machine answers, and nothing listens at this port.
    NothingListens,
    /// Nothing answers at this address within the deadline.
    NoAnswer(Duration),
    /// The network has no way to this address.
    Unreachable(String),
    /// There is no such serial port or CAN interface.
    NoSuchPort(String),
    /// The user may not open the port.
    NotPermitted(String),
    /// Another program or host uses it. Holds who, as far as the other side tells.
    InUse(String),
    /// The connection opens, and nothing is sent for the whole deadline.
    Silent(Duration),
    /// The other side closes the connection, or it breaks, before the hand has answered. Holds how.
    HungUp(String),
    /// What answers is no hand. Holds the beginning of what it sent.
    NotAHand(String),
    /// A device server that speaks Telnet is between, which doubles 0xFF in packets and RealTime.
    Telnet,
    /// No SLCAN adapter can be reached at this address. Holds why.
    NoAdapter(String),
    /// The connection opens, and for the whole deadline neither an SLCAN adapter nor a board behind it answers.
    SilentAdapter(Duration),
    /// The adapter's connection ends before the adapter has opened. Holds how.
    AdapterGone(String),
    /// What answers is no SLCAN adapter. Holds the beginning of what it sent.
    NotAnAdapter(String),
    /// The hand's firmware is another. Holds what VERS printed.
    WrongFirmware {
        /// What VERS printed.
        found: String,
        /// The first version that this library knows.
        expected: u16,
    },
    /// These motor boards are in their monitors.
    Asleep(Vec<Node>),
    /// These motor boards do not answer, and others do.
    WithoutPower(Vec<Node>),
    /// Two boards each have these numbers: both obey, and their answers collide.
    TwoBoards(Vec<Node>),
    /// No motor board answers: no node acknowledges a frame.
    BusNotAcknowledged,
    /// The adapter refuses a command, such as the bit rate. Holds the command.
    Refused(String),
    /// The system refuses a thread, a pipe or a socket option. Holds its words.
    System(String),
}

impl Cause {
    /// The next step of a user.
    #[must_use]
    pub const fn next_step(&self) -> &'static str {
        match self {
            Self::BadAddress(_) => "give HOST:PORT, such as 127.0.0.1:11001",
            Self::NothingListens => {
                "check the port, and start the hand or its server (`hil-sim hand --listen`)"
            }
            Self::NoAnswer(_) => {
                "check the hand's power, its network cable and the address, or give it a longer limit"
            }
            Self::Unreachable(_) => "check this machine's network, and that the hand is in it",
            Self::NoSuchPort(_) => "check the cable and the port's name; `ip link` lists CAN interfaces",
            Self::NotPermitted(_) => "join the group that owns the port, such as dialout, and log in again",
            Self::InUse(_) => "end the other program, then connect again",
            Self::Silent(_) => {
                "check the port and the baud rate; if a hand is there, switch its power off and on"
            }
            Self::HungUp(_) => "check that this is the hand's port, and connect again",
            Self::Telnet => "set the device server's port to raw TCP, without Telnet (RFC 2217)",
            Self::NotAHand(_) | Self::NotAnAdapter(_) => {
                "check the address, the port and the baud rate: something else answers"
            }
            Self::NoAdapter(_) => {
                "check the address, and that the adapter or its server runs (`hil-sim bus --slcan`)"
            }
            Self::SilentAdapter(_) => {
                "check the port, the baud rate and the adapter's power; an adapter that answers no command needs a board that answers on its bus"
            }
            Self::AdapterGone(_) => "check that this is the adapter's port, and its cable, and connect again",
            Self::WrongFirmware { .. } => {
                "download this project's firmware, or use the library of that version"
            }
            Self::Asleep(_) => "call wake, or connect with Boards::Wake; do neither before a download",
            Self::WithoutPower(_) => {
                "check the supply and the CAN cable of these boards; Boards::Any connects without them"
            }
            Self::TwoBoards(_) => {
                "unplug one, or give both the number of their straps: docs/hand.md, Two boards with one number; Boards::Any connects, and ERR 1 names them"
            }
            Self::BusNotAcknowledged => {
                "check the hand's motor supply, the CAN cable, its termination and the bit rate of 1 Mbit/s"
            }
            Self::Refused(_) => {
                "end other programs that use the adapter, switch it off and on; or use one that can do 1 Mbit/s"
            }
            Self::System(_) => "end other programs, or raise the limit",
        }
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::BadAddress(why) => write!(f, "no valid address: {why}"),
            Self::NothingListens => write!(f, "nothing listens there"),
            Self::NoAnswer(limit) => write!(f, "no answer within {:?}", whole_ms(*limit)),
            Self::Unreachable(why) => write!(f, "unreachable: {why}"),
            Self::NoSuchPort(why) => write!(f, "no such port: {why}"),
            Self::NotPermitted(why) => write!(f, "not permitted: {why}"),
            Self::InUse(by) => write!(f, "in use: {by}"),
            Self::Silent(limit) => {
                write!(f, "connected, but nothing was received within {:?}", whole_ms(*limit))
            }
            Self::HungUp(why) => write!(f, "the connection ended: {why}"),
            Self::NotAHand(received) => write!(f, "no hand answers: received {received:?}"),
            Self::Telnet => write!(f, "a device server answers that negotiates Telnet options"),
            Self::NoAdapter(why) => write!(f, "no adapter can be reached: {why}"),
            Self::SilentAdapter(limit) => {
                write!(f, "connected, but no adapter has answered within {:?}", whole_ms(*limit))
            }
            Self::AdapterGone(why) => write!(f, "the connection to the adapter ended: {why}"),
            Self::NotAnAdapter(received) => write!(f, "no adapter answers: received {received:?}"),
            Self::WrongFirmware { found, expected } => {
                write!(f, "firmware {found:?}, expected {expected} or later")
            }
            Self::Asleep(nodes) => write!(f, "asleep: {}", Nodes(nodes)),
            Self::WithoutPower(nodes) => write!(f, "without power or off the bus: {}", Nodes(nodes)),
            Self::TwoBoards(nodes) => write!(f, "two boards with one number: {}", Nodes(nodes)),
            Self::BusNotAcknowledged => write!(f, "no motor board acknowledges a frame"),
            Self::Refused(command) => write!(f, "the adapter refuses {command}"),
            Self::System(why) => write!(f, "the system refuses: {why}"),
        }
    }
}

impl fmt::Display for ConnectError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}\n  next: {}", Shown(&self.place), self.cause, self.cause.next_step())
    }
}

impl std::error::Error for ConnectError {}

/// A call that failed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CallError {
    /// The call, as a line of the hand's language or in words.
    pub call: String,
    /// Why.
    pub failure: Failure,
}

/// Why a call failed.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Failure {
    /// An argument is wrong: nothing was sent. Holds what is expected.
    Invalid(String),
    /// The hand or the boards did not finish within the deadline. A motion or a line of the language was told to abort; reading and waiting for a
    /// value stop no motor.
    TimedOut(Duration),
    /// The connection is lost. Holds how.
    Lost(String),
    /// ^C, or the progress callback, ended it; motors stop as HOLD demands.
    Cancelled,
    /// The hand answered ERR.
    Status(Status),
    /// Boards do not answer.
    Silent(Vec<Node>),
    /// Boards are in their monitors, where they obey nothing else.
    Asleep(Vec<Node>),
    /// The adapter refuses to send: another host is on the bus, or the adapter's queue is full.
    Refused,
    /// A board does not hold the value that was set.
    NotTaken {
        /// The board.
        node: Node,
        /// What it holds instead.
        found: i64,
    },
    /// A motion ended early. Holds the board, END and ERROR.
    NotReached {
        /// The board.
        node: Node,
        /// END; 0: it has not begun.
        end: i64,
        /// The fault, if one stopped it.
        fault: Option<FaultCode>,
        /// The joint's own stop, hall counts, if it stands there: no object has stopped it.
        stop: Option<i64>,
    },
    /// A download ended without the new application. The old one is there, unless the error says otherwise.
    Download {
        /// The board.
        node: Node,
        /// Why.
        error: DownloadError,
    },
    /// The other side sent what the protocol does not allow. Holds the beginning.
    Unexpected(String),
}

impl Failure {
    /// The next step of a user.
    #[must_use]
    pub fn next_step(&self) -> String {
        match self {
            Self::Invalid(_) => "correct the argument; nothing was sent".to_owned(),
            Self::TimedOut(_) => "give it a longer limit; if a motor should have moved, read the boards' ERROR (1234567 G ERROR)".to_owned(),
            Self::Lost(_) => "check power and cable, and connect again".to_owned(),
            Self::Cancelled => "motors stand or hold by HOLD; the next call may follow".to_owned(),
            Self::Status(status) if status.has(Status::NOT_INITIALIZED) => "call init (HI)".to_owned(),
            Self::Status(status) if status.has(Status::FAULT) => "read the boards' ERROR (1234567 G ERROR), then wake them (WAKE)".to_owned(),
            Self::Status(status) if status.has(Status::NO_BOARD) => {
                "wake the boards (WAKE); if it comes back, type ERR 1, which names them, and check their power and CAN cable".to_owned()
            }
            Self::Status(_) => "correct the cause named above, and call again".to_owned(),
            Self::Silent(_) => "check the boards' power, the CAN cable and other hosts on the bus".to_owned(),
            Self::Asleep(_) => "wake them (WAKE)".to_owned(),
            Self::Refused => {
                "check that a board is on the bus, since the adapter's queue stays full while nobody acknowledges; end the bus's other \
                 host (a hand's GOD is one: through it, use Hand)"
                    .to_owned()
            }
            Self::NotTaken { .. } => {
                "see docs/properties.md for range and access: a locked property wants LOCK first, a sleeping board obeys few"
                    .to_owned()
            }
            Self::NotReached { fault: Some(fault), .. } => fault.row().next.to_owned(),
            Self::NotReached { stop: Some(_), .. } => "give it a position within its joint's range".to_owned(),
            Self::Download { error, .. } => error.next_step().to_owned(),
            Self::NotReached { .. } => "see docs/servo.md for the reason, and call again".to_owned(),
            Self::Unexpected(_) => "connect again; report it if it comes back".to_owned(),
        }
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Invalid(expected) => write!(f, "invalid: expected {expected}"),
            Self::TimedOut(limit) => write!(f, "not done within {:?}", whole_ms(*limit)),
            Self::Lost(why) => write!(f, "the connection is lost: {why}"),
            Self::Cancelled => write!(f, "cancelled"),
            Self::Status(sum) => {
                write!(f, "ERR {}", sum.code())?;
                let rows = status::ROWS.iter().filter(|row| sum.has(row.status));
                rows.enumerate()
                    .try_for_each(|(i, row)| write!(f, "{}{}", if i == 0 { ": " } else { "; " }, row.meaning))
            }
            Self::Silent(nodes) => write!(f, "no answer from {}", Nodes(nodes)),
            Self::Refused => write!(f, "the adapter refuses to send"),
            Self::NotTaken { node, found } => write!(f, "node {} holds {found}", node.number()),
            Self::Asleep(nodes) => write!(f, "asleep: {}", Nodes(nodes)),
            Self::NotReached { node, stop: Some(stop), .. } => {
                write!(
                    f,
                    "node {}: its joint's own stop ended the move, at {stop} hall counts",
                    node.number()
                )
            }
            Self::NotReached { node, end, fault, stop: None } => {
                let reason = tater_wire::end::ROWS.iter().find(|row| i64::from(row.code) == *end);
                let reason = reason.map_or("it has not begun", |row| row.meaning);
                write!(f, "node {}: {reason}", node.number())?;
                fault.map_or(Ok(()), |fault| write!(f, ": {}", fault.row().cause))
            }
            Self::Download { node, error } => write!(f, "node {}: {error}", node.number()),
            Self::Unexpected(received) => write!(f, "received {received:?}"),
        }
    }
}

impl fmt::Display for CallError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}\n  next: {}", Shown(&self.call), self.failure, self.failure.next_step())
    }
}

impl std::error::Error for CallError {}

/// The beginning of what a caller gave, without what a terminal obeys.
struct Shown<'a>(&'a str);

impl fmt::Display for Shown<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut characters = self.0.chars();
        for c in characters.by_ref().take(SHOWN) {
            if c.is_control() { write!(f, "{}", c.escape_default())? } else { write!(f, "{c}")? }
        }
        f.write_str(if characters.next().is_some() { "..." } else { "" })
    }
}

/// `nodes 1, 5`.
struct Nodes<'a>(&'a [Node]);

impl fmt::Display for Nodes<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.len() == 1 { "node" } else { "nodes" })?;
        self.0
            .iter()
            .enumerate()
            .try_for_each(|(i, node)| write!(f, "{}{}", if i == 0 { " " } else { ", " }, node.number()))
    }
}

/// A limit as a user gave it: what is left of one in the middle of a call has digits that nobody gave.
pub(crate) fn whole_ms(limit: Duration) -> Duration {
    u64::try_from(limit.as_nanos().div_ceil(1_000_000)).map_or(limit, Duration::from_millis)
}

/// The beginning of received bytes, for an error: any byte is a character.
pub(crate) fn beginning(bytes: &[u8]) -> String {
    bytes.iter().take(80).map(|&byte| char::from(byte)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_of_an_error_is_short_and_obeyed_by_no_terminal() {
        let text = |call: &str| CallError { call: call.to_owned(), failure: Failure::Refused }.to_string();
        assert!(text("1\u{1b}[2J\n G P").starts_with("1\\u{1b}[2J\\n G P: the adapter"));
        assert!(text(&"1".repeat(161)).starts_with(&format!("{}...: ", "1".repeat(160))));
        let error =
            CallError { call: "HI".to_owned(), failure: Failure::TimedOut(Duration::from_nanos(99_999_879)) };
        assert!(error.to_string().starts_with("HI: not done within 100ms\n"));
    }
}
