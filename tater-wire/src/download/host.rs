//! The host's side of a download, without I/O and clock: frames in, frames out, time passed in.
//!
//! It resets a board that runs its application into its monitor, starts numbered frames, or single characters if the board does not
//! know them, answers the board's requests, and wakes it. The file is sent as it is: verify it before.

use core::fmt;

use heapless::Deque;

use super::numbered::{CHARACTERS, START, START_NUMBERED, pack};
use crate::{Body, Destination, FaultCode, Frame, Group, Identifier, Message, Node, Property};

/// Interval of asking a board for its state, µs: it may be busy for the 40 ms of a page.
const POLL_US: u64 = 100_000;

/// Timeout for the board to reach its monitor, µs: it may be off the bus for 1 s; twice that.
const RESET_US: u64 = 2_000_000;

/// Timeout for the first request, µs: an owed copy comes first, with 52 pages of 40 ms and 26,624 half-words
/// of 52 µs.
const BEGIN_US: u64 = 5_000_000;

/// Silence after which ERROR is read from a board that has all characters or should request more, µs:
/// monitors repeat a request after 200 ms.
const QUIET_US: u64 = 600_000;

/// Silence after which the board counts as gone, µs: monitors give up after 10 s.
const GONE_US: u64 = 12_000_000;

/// Timeout for copy, last check and start, µs: the copy of [`BEGIN_US`], the check, 1 s off the bus; twice.
const WAKE_US: u64 = 12_000_000;

/// The next action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Send this frame.
    Send(Frame),
    /// Wait for a frame, at most until this time, µs.
    Wait(u64),
    /// The new application runs.
    Done,
    /// The download failed.
    Failed(DownloadError),
}

/// Reason of a failed download; the old application is still valid, unless ERROR says otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DownloadError {
    /// No board has answered.
    NoBoard {
        /// Its node.
        node: Node,
    },
    /// The board answers, but does not enter its monitor.
    NotReset {
        /// Its STAT.
        stat: i64,
    },
    /// It is in its monitor, but requests nothing.
    NoRequest,
    /// It has stopped requesting.
    Gone {
        /// Characters sent.
        sent: u32,
        /// Total characters.
        len: u32,
    },
    /// It reports an ERROR.
    Refused {
        /// ERROR.
        error: i64,
    },
    /// Everything is sent and ERROR is 0, but the application does not start.
    NotStarted,
}

impl DownloadError {
    /// The next step of a user.
    #[must_use]
    pub fn next_step(&self) -> &'static str {
        match *self {
            Self::NoBoard { .. } => {
                "check its number, the cable and the power; GET STAT to nodes 1 to 31 finds all boards"
            }
            Self::NotReset { .. } => "switch it off and on",
            Self::NoRequest => "read its ERROR, switch it off and on",
            Self::Gone { .. } => {
                "check the cable and the power, and download again; the old application is still there"
            }
            Self::Refused { error } => FaultCode::of(error).map_or("download again", |code| code.row().next),
            Self::NotStarted => "read STAT and ERROR, and download again",
        }
    }
}

impl fmt::Display for DownloadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::NoBoard { node } => write!(f, "no board of node {} answers", node.number()),
            Self::NotReset { stat } => {
                write!(f, "the board stays out of its monitor: found STAT {stat}, expected 0")
            }
            Self::NoRequest => f.write_str("the board is in its monitor, but does not ask for the file"),
            Self::Gone { sent, len } => {
                write!(f, "the board has stopped asking after {sent} of {len} characters")
            }
            Self::Refused { error } => match FaultCode::of(error) {
                Some(code) => write!(f, "ERROR {error} ({}): {}", code.row().name, code.row().cause),
                None => write!(f, "found ERROR {error}, which is none that is known"),
            },
            Self::NotStarted => f.write_str("the board has taken the file, but does not start it"),
        }
    }
}

impl core::error::Error for DownloadError {}

/// The characters of a file to send: of each line those after the first (`%`) up to the first one below '0'.
#[derive(Clone, Debug)]
pub struct Characters<'a> {
    file: &'a [u8],
    place: Place,
}

#[derive(Clone, Copy, Debug)]
enum Place {
    /// Before the first character of a line.
    Start,
    Inside,
    /// After the last character to send.
    Behind,
}

impl<'a> Characters<'a> {
    /// Characters of this file.
    #[must_use]
    pub const fn new(file: &'a [u8]) -> Self {
        Self { file, place: Place::Start }
    }
}

impl Iterator for Characters<'_> {
    type Item = u8;

    fn next(&mut self) -> Option<u8> {
        while let Some((&character, rest)) = self.file.split_first() {
            self.file = rest;
            self.place = match (self.place, character) {
                (_, b'\n') => Place::Start,
                (Place::Start, _) => Place::Inside,
                (Place::Inside, b'0'..) => return Some(character),
                (Place::Inside | Place::Behind, _) => Place::Behind,
            };
        }
        None
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// The board's last STAT.
    Reset(Option<i64>),
    Begin,
    Send,
    /// The board has the file and is being woken.
    Wake,
    End(Result<(), DownloadError>),
}

/// A download.
#[derive(Clone, Debug)]
pub struct Downloader<'a> {
    node: Node,
    file: &'a [u8],
    rest: Characters<'a>,
    len: u32,
    sent: u32,
    numbered: bool,
    /// Number of frames that the board waits for.
    granted: u8,
    phase: Phase,
    deadline_us: u64,
    poll_us: u64,
    out: Deque<Frame, 4>,
}

impl<'a> Downloader<'a> {
    /// Starts a download of a file to a board.
    #[must_use]
    pub fn new(node: Node, file: &'a [u8], now_us: u64) -> Self {
        Self {
            node,
            file,
            rest: Characters::new(file),
            len: u32::try_from(Characters::new(file).count()).unwrap_or(u32::MAX),
            sent: 0,
            numbered: true,
            granted: 0,
            phase: Phase::Reset(None),
            deadline_us: now_us.saturating_add(RESET_US),
            poll_us: now_us,
            out: Deque::new(),
        }
    }

    /// Characters sent, and the total. After a repetition it may be less than before.
    #[must_use]
    pub const fn progress(&self) -> (u32, u32) {
        (self.sent, self.len)
    }

    /// The action at `now_us`: call it after every frame, and when the wait is over.
    pub fn next(&mut self, now_us: u64) -> Next {
        if now_us >= self.deadline_us {
            self.late(now_us);
        } else if now_us >= self.poll_us {
            self.poll_us = now_us.saturating_add(POLL_US);
            self.poll();
        }
        match self.phase {
            Phase::End(Ok(())) => return Next::Done,
            Phase::End(Err(error)) => return Next::Failed(error),
            Phase::Reset(_) | Phase::Begin | Phase::Send | Phase::Wake => {}
        }
        match self.out.pop_front().or_else(|| self.granted(now_us)) {
            Some(frame) => Next::Send(frame),
            None => Next::Wait(self.deadline_us.min(self.poll_us)),
        }
    }

    /// Takes any frame from the bus.
    pub fn receive(&mut self, frame: &Frame, now_us: u64) {
        let Some(Message { from, to, body }) = Message::parse(frame) else { return };
        if from != self.node {
            return;
        }
        let to_host = to == Destination::Node(Node::HOST);
        match body {
            Body::More { frames, received } if to_host => self.asked(true, frames, received, now_us),
            Body::Get(id) if to_host && id == Property::VERS.id() => self.asked(false, 1, self.sent, now_us),
            Body::Set { property, value } if to == Destination::Group(Group::REPLIES) => {
                match Property::of(property) {
                    Some(Property::STAT) => self.stat(Property::STAT.read(value), now_us),
                    Some(Property::ERROR) => self.error(Property::ERROR.read(value), now_us),
                    _ => {}
                }
            }
            _ => {}
        }
    }

    fn asked(&mut self, numbered: bool, frames: u8, from: u32, now_us: u64) {
        if !matches!(self.phase, Phase::Begin | Phase::Send) {
            return;
        }
        self.phase = Phase::Send;
        (self.numbered, self.granted) = (numbered, frames);
        if from != self.sent {
            // Frames were lost. A board with numbered frames reports from where: continue there.
            self.rest = Characters::new(self.file);
            let skipped = self.rest.by_ref().take(usize::try_from(from).unwrap_or(usize::MAX)).count();
            self.sent = u32::try_from(skipped).unwrap_or(u32::MAX);
        }
        self.heard(now_us);
    }

    const fn heard(&mut self, now_us: u64) {
        self.deadline_us = now_us.saturating_add(GONE_US);
        self.poll_us = now_us.saturating_add(QUIET_US);
    }

    fn granted(&mut self, now_us: u64) -> Option<Frame> {
        if self.phase != Phase::Send || self.granted == 0 {
            return None;
        }
        let [number, ..] = (self.sent / 8).to_le_bytes();
        let mut characters = [0; CHARACTERS];
        let len = if self.numbered { CHARACTERS } else { 1 };
        let mut taken = 0;
        for (slot, character) in characters.iter_mut().take(len).zip(&mut self.rest) {
            *slot = character;
            taken += 1;
        }
        if taken == 0 {
            self.granted = 0;
            return None;
        }
        self.granted -= 1;
        self.sent = self.sent.saturating_add(taken);
        self.heard(now_us);
        let id = Identifier { from: Node::HOST, to: Destination::Node(self.node) };
        let packed = pack(number, &characters);
        Frame::new(id, if self.numbered { &packed } else { characters.get(..1)? })
    }

    fn stat(&mut self, stat: i64, now_us: u64) {
        match (self.phase, stat) {
            // In its monitor, perhaps in the download of a host that is gone, which SET VERS ends. A reset from here could not be told from
            // one that is still to come, and would drop SET VERS.
            (Phase::Reset(_), 0) => self.begin(START_NUMBERED, now_us),
            (Phase::Reset(_), stat) => {
                self.phase = Phase::Reset(Some(stat));
                self.set(Property::STAT, 0);
            }
            (Phase::Wake, 2) => self.phase = Phase::End(Ok(())),
            _ => {}
        }
    }

    fn error(&mut self, error: i64, now_us: u64) {
        match self.phase {
            Phase::Send | Phase::Wake if error != 0 => {
                self.phase = Phase::End(Err(DownloadError::Refused { error }));
            }
            Phase::Send if self.sent == self.len => {
                self.phase = Phase::Wake;
                self.deadline_us = now_us.saturating_add(WAKE_US);
                self.set(Property::STAT, 2);
            }
            _ => {}
        }
    }

    fn begin(&mut self, style: u16, now_us: u64) {
        self.phase = Phase::Begin;
        self.numbered = style == START_NUMBERED;
        self.deadline_us = now_us.saturating_add(BEGIN_US);
        self.poll_us = self.deadline_us;
        self.set(Property::VERS, i64::from(style));
    }

    fn poll(&mut self) {
        match self.phase {
            Phase::Reset(_) => self.get(Property::STAT),
            // A monitor that waits for single characters would take this frame for one.
            Phase::Send if self.numbered || self.sent == self.len => self.get(Property::ERROR),
            Phase::Wake => {
                self.get(Property::STAT);
                self.get(Property::ERROR);
            }
            Phase::Begin | Phase::Send | Phase::End(_) => {}
        }
    }

    fn late(&mut self, now_us: u64) {
        let error = match self.phase {
            Phase::Reset(None) => DownloadError::NoBoard { node: self.node },
            Phase::Reset(Some(stat)) => DownloadError::NotReset { stat },
            Phase::Begin if self.numbered => return self.begin(START, now_us),
            Phase::Begin => DownloadError::NoRequest,
            Phase::Send => DownloadError::Gone { sent: self.sent, len: self.len },
            Phase::Wake => DownloadError::NotStarted,
            Phase::End(_) => return,
        };
        self.phase = Phase::End(Err(error));
    }

    fn get(&mut self, property: Property) {
        self.say(Message::get(Destination::Node(self.node), property));
    }

    fn set(&mut self, property: Property, value: i64) {
        if let Some(message) = Message::set(Destination::Node(self.node), property, value) {
            self.say(message);
        }
    }

    fn say(&mut self, message: Message) {
        // At most two are queued; one that finds no room is repeated at the next poll.
        let _ = self.out.push_back(message.frame());
    }
}

#[cfg(test)]
mod tests;
