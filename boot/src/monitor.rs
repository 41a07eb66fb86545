//! The monitor: the program after a reset. It has neither bridge nor brake: they are off as the reset leaves them, and no motor moves.
//!
//! It answers for the few properties that identify a board, takes downloads into staging, copies them over
//! the application, and starts the application if it is whole. `docs/download.md` describes the protocol.
//!
//! A valid image in staging is a copy that is owed: it is made before anything else, also after a power failure. Staging
//! becomes invalid only when the application has been verified. So from the first good download on there is always a valid
//! image.

mod check;
mod copy;
mod download;
mod locked;
#[cfg(test)]
mod tests;

use crate::chip::{self, Chip, Flash};
use crate::identity::{self, Identifying};
use crate::storage::{Progress, Store};
use check::Check;
use copy::Copy;
use download::{Download, Step};
use heapless::Deque;
use locked::Locked;
use servo_core::units::Micros;
use tater_wire::download::{START, START_NUMBERED};
use tater_wire::image::MAGIC_AT;
use tater_wire::map::Map;
use tater_wire::property::Rules;
use tater_wire::{Body, Destination, FaultCode, Frame, Group, Message, MotorKind, Node, Property, Value};

/// VERS of the monitor.
const VERSION: i64 = Property::VERS.rules().max();

/// The groups that are received beside group 0.
const GROUPS: [&Rules; 3] = [Property::GRPA.rules(), Property::GRPB.rules(), Property::GRPC.rules()];

const VERS: u8 = Property::VERS.id();
const ERROR: u8 = Property::ERROR.id();
const STAT: u8 = Property::STAT.id();

/// Barrett's numbers for a look at memory. They read 0.
const ADDR: u8 = 6;
const VALUE: u8 = 7;

/// Properties that have other numbers in the monitor than in the application (Barrett's table of the RESET state).
const LOCK: u8 = 8;
const SAVE: u8 = 9;
const LOAD: u8 = 10;

/// Frames queued for the CAN controller: a GET of each property, and a request.
const OUTBOX: usize = 8;

/// Result of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// The monitor continues.
    Stay,
    /// There is a verified application, and a host ordered its start: jump to it.
    Start,
}

/// A host's order, executed when no copy is owed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wish {
    Start,
    Download { numbered: bool },
    Reset,
}

/// The purpose of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Then {
    /// Staging, where a copy may be owed.
    Copy,
    /// Staging, after a download.
    Received,
    /// The application, after a copy.
    Copied,
    /// The application, to start it.
    Start,
}

#[derive(Debug)]
#[allow(clippy::large_enum_variant, reason = "there is no heap to put the download on")]
enum Phase {
    /// Idle: it answers, and stores pending values, also before a download that is waiting.
    Idle,
    Check(Check, Then),
    Download(Download),
    Copy(Copy),
    Forget,
    /// Leaves the monitor as soon as everything is stored.
    Start,
}

/// The monitor on a board.
#[derive(Debug)]
pub struct Monitor<B: Chip> {
    board: B,
    store: Store,
    node: Node,
    groups: [Option<Group>; GROUPS.len()],
    locked: Locked,
    phase: Phase,
    wish: Option<Wish>,
    /// A SAVE is being stored. Only then does the store work: its operations take the board off the bus.
    saving: bool,
    copy_failed: bool,
    /// Initially the reason for the reset, unless it was ordered.
    error: Option<FaultCode>,
    outbox: Deque<Frame, OUTBOX>,
}

impl<B: Chip> Monitor<B> {
    /// After a reset. If a copy is owed, it is made before anything else.
    pub fn new(mut board: B) -> Self {
        let store = Store::open(board.flash());
        let own = Identifying::all(&board, &store);
        let node = identity::node(&own);
        let groups = GROUPS.map(|rules| {
            identity::group(store.get_by(rules).or_else(|| rules.default_word(node, MotorKind::of(node)))?)
        });
        board.set_filters(node, groups);
        let error = board.reset_cause();
        let phase = match Check::of_staging(board.flash()) {
            Some(check) => Phase::Check(check, Then::Copy),
            None => Phase::Idle,
        };
        Self {
            board,
            store,
            node,
            groups,
            locked: Locked::new(own),
            phase,
            wish: None,
            saving: false,
            copy_failed: false,
            error,
            outbox: Deque::new(),
        }
    }

    /// Takes any frame from the bus; frames for other nodes are skipped.
    pub fn receive(&mut self, frame: &Frame, now: Micros) {
        let id = frame.id();
        // Node 0 is the host: a board without a node receives groups only, and sends nothing.
        let mine = self.node != Node::HOST && id.to == Destination::Node(self.node);
        let host = id.from == Node::HOST;
        if mine
            && host
            && let Phase::Download(download) = &mut self.phase
            && download.take(frame.data(), now)
        {
            return;
        }
        let heard = mine
            || matches!(id.to, Destination::Group(group)
                if group == Group::ALL || self.groups.contains(&Some(group)));
        if !heard {
            return;
        }
        match Message::parse(frame).map(|message| message.body) {
            Some(Body::Get(property)) => self.answer(id.from, property),
            Some(Body::Torques(_)) => self.locked.lock.interrupt(),
            Some(Body::Set { property, value }) => {
                if property != LOCK {
                    self.locked.lock.interrupt();
                }
                let value = match value {
                    Value::Short(bits) => i32::from(bits.cast_signed()),
                    Value::Long(bits) => bits.cast_signed(),
                };
                // Two boards that requested characters at once would get each other's.
                if property == VERS && mine && host {
                    self.set_vers(value, now);
                } else {
                    self.set(property, value, now);
                }
            }
            _ => {}
        }
        self.flush();
    }

    #[inline(never)]
    fn answer(&mut self, asker: Node, number: u8) {
        let answer = match number {
            VERS => Some((Property::VERS.rules(), VERSION)),
            ERROR => Some((Property::ERROR.rules(), self.error.map_or(0, |error| i64::from(error.code())))),
            STAT => Some((Property::STAT.rules(), 0)),
            _ => self.locked.get(number).map(|(rules, value)| (rules, i64::from(value))),
        };
        let message = match answer {
            Some((rules, value)) => Message::answer(self.node, asker, rules, value),
            // LOCK, SAVE and LOAD are not answered: a host that takes the board for awake would take 0 for MODE, TEMP and PTEMP.
            None if matches!(number, ADDR | VALUE) => Message::absent(self.node, asker, number),
            None => None,
        };
        if let Some(message) = message {
            self.send(message);
        }
    }

    fn set(&mut self, property: u8, value: i32, now: Micros) {
        match property {
            LOCK => self.locked.lock.key(value.into()),
            SAVE => {
                self.locked.save(&mut self.store, value);
                self.saving = true;
            }
            LOAD => self.locked.load(&self.store, value),
            STAT => match value {
                0 => self.order(Wish::Reset, now),
                2 => self.order(Wish::Start, now),
                _ => {}
            },
            id => self.locked.set(id, value),
        }
    }

    fn set_vers(&mut self, value: i32, now: Micros) {
        let numbered = value == i32::from(START_NUMBERED);
        if numbered || value == i32::from(START) {
            self.order(Wish::Download { numbered }, now);
        }
    }

    /// A new order replaces the last, and ends a download. An owed copy comes first.
    fn order(&mut self, wish: Wish, now: Micros) {
        self.error = None;
        if wish == Wish::Start && matches!(self.phase, Phase::Start | Phase::Check(_, Then::Start)) {
            // A host that repeats its order must not restart it.
            return;
        }
        self.wish = Some(wish);
        match self.phase {
            Phase::Idle | Phase::Start | Phase::Check(_, Then::Start) => {
                match Check::of_staging(self.board.flash()) {
                    Some(check) => self.phase = Phase::Check(check, Then::Copy),
                    None => self.obey(now),
                }
            }
            Phase::Download(_) => self.phase = Phase::Forget,
            Phase::Check(..) | Phase::Copy(_) | Phase::Forget => {}
        }
    }

    /// Executes the order; no copy may be owed.
    fn obey(&mut self, now: Micros) {
        self.phase = match self.wish.take() {
            None => Phase::Idle,
            // First store pending values: during a download, which takes minutes, the store does not work.
            Some(wish @ (Wish::Download { .. } | Wish::Reset)) if self.saving => {
                self.wish = Some(wish);
                Phase::Idle
            }
            Some(Wish::Download { numbered }) => {
                // Perhaps of the copy that this download is to repair.
                self.error = None;
                self.copy_failed = false;
                Phase::Download(Download::new(numbered, now))
            }
            Some(Wish::Reset) => {
                self.board.reset();
                Phase::Idle
            }
            Some(Wish::Start) => match Check::of_application(self.board.flash()) {
                Some(check) => Phase::Check(check, Then::Start),
                None => {
                    self.fail(FaultCode::NoApplication);
                    Phase::Idle
                }
            },
        };
    }

    /// Sets ERROR and cancels a start: a host must order it again, and may have read ERROR by then.
    fn fail(&mut self, error: FaultCode) {
        self.error = Some(error);
        if self.wish == Some(Wish::Start) {
            self.wish = None;
        }
    }

    /// One step: at most one flash operation, a request, a timeout. Call it repeatedly.
    pub fn step(&mut self, now: Micros) -> Next {
        self.board.feed_watchdog();
        match &mut self.phase {
            Phase::Idle => {
                if self.keep() && self.wish.is_some() {
                    self.obey(now);
                }
            }
            Phase::Start => {
                if self.keep() {
                    return Next::Start;
                }
            }
            Phase::Check(check, then) => {
                let then = *then;
                if let Some(good) = check.step(self.board.flash()) {
                    let len = check.len();
                    self.checked(then, good, len, now);
                }
            }
            Phase::Download(download) => match download.step(self.board.flash(), now) {
                Ok(Step::Working) => {}
                Ok(Step::Ask(body)) => {
                    self.send(Message { from: self.node, to: Destination::Node(Node::HOST), body });
                }
                Ok(Step::Dropped) => self.phase = Phase::Forget,
                Ok(Step::Whole(len)) => match Check::of_staging(self.board.flash()) {
                    Some(check) if check.len() == len => self.phase = Phase::Check(check, Then::Received),
                    _ => self.refuse(FaultCode::BadImage, now),
                },
                Err(error) => self.refuse(error, now),
            },
            Phase::Copy(copy) => match copy.step(self.board.flash()) {
                Ok(false) => {}
                Ok(true) => match Check::of_application(self.board.flash()) {
                    Some(check) => self.phase = Phase::Check(check, Then::Copied),
                    None => self.give_up(now),
                },
                Err(_) => self.give_up(now),
            },
            Phase::Forget => self.forget(now),
        }
        self.flush();
        Next::Stay
    }

    fn checked(&mut self, then: Then, good: bool, len: u32, now: Micros) {
        match (then, good) {
            (Then::Copy | Then::Received, true) => self.phase = Phase::Copy(Copy::new(len)),
            // Remains of an interrupted download.
            (Then::Copy, false) => self.obey(now),
            (Then::Received, false) => self.refuse(FaultCode::BadImage, now),
            (Then::Copied, true) => self.phase = Phase::Forget,
            (Then::Copied, false) => self.give_up(now),
            (Then::Start, true) => self.phase = Phase::Start,
            (Then::Start, false) => {
                self.fail(FaultCode::NoApplication);
                self.phase = Phase::Idle;
            }
        }
    }

    #[inline(never)]
    fn refuse(&mut self, error: FaultCode, now: Micros) {
        self.fail(error);
        if let Phase::Download(download) = &mut self.phase
            && download.refuse(error, now)
        {
            return;
        }
        self.phase = Phase::Forget;
    }

    /// The copy stays owed: the next SET STAT 2 or reset repeats it. A download overwrites staging, the only good image, only
    /// after two failures.
    fn give_up(&mut self, now: Micros) {
        self.fail(FaultCode::FlashWrite);
        let again = !core::mem::replace(&mut self.copy_failed, true) && self.wish.is_some();
        match Check::of_staging(self.board.flash()) {
            Some(check) if again => self.phase = Phase::Check(check, Then::Copy),
            _ => self.obey(now),
        }
    }

    /// Makes staging invalid: 0 may be programmed over any value.
    fn forget(&mut self, now: Micros) {
        let flash = self.board.flash();
        let Map { of, staging, .. } = B::Flash::MAP;
        let magic = [staging.start + MAGIC_AT, staging.start + MAGIC_AT + 2];
        if let Some(&address) = magic.iter().find(|&&address| flash.half_word(address) != 0)
            && chip::void(flash, address - address % of.unit).is_ok()
        {
            return;
        }
        self.obey(now);
    }

    /// One flash operation for the store, if one is due; returns whether there is nothing more to do.
    fn keep(&mut self) -> bool {
        if self.saving {
            self.saving = match self.store.step_in_monitor(self.board.flash()) {
                Progress::Done => false,
                Progress::More | Progress::Waiting => true,
                Progress::Failed(_) => {
                    self.error = Some(FaultCode::Storage);
                    false
                }
            };
        }
        !self.saving
    }

    fn send(&mut self, message: Message) {
        if self.node != Node::HOST {
            // Full only if nobody acknowledges; hosts repeat their GETs, and the board its requests.
            let _ = self.outbox.push_back(message.frame());
        }
    }

    fn flush(&mut self) {
        while let Some(frame) = self.outbox.front() {
            if !self.board.transmit(frame) {
                break;
            }
            self.outbox.pop_front();
        }
    }

    /// The node that the board answers as.
    #[must_use]
    pub const fn node(&self) -> Node {
        self.node
    }

    /// The value of ERROR.
    #[must_use]
    pub const fn error(&self) -> Option<FaultCode> {
        self.error
    }

    /// Whether only answers are left to do: no check, download, copy or SAVE.
    #[must_use]
    pub const fn is_idle(&self) -> bool {
        matches!(self.phase, Phase::Idle) && !self.saving
    }

    /// Whether the next step checks a slice of an image.
    #[must_use]
    pub const fn is_checking(&self) -> bool {
        matches!(self.phase, Phase::Check(..))
    }

    /// The hardware.
    #[must_use]
    pub const fn board(&self) -> &B {
        &self.board
    }

    /// The hardware.
    pub const fn board_mut(&mut self) -> &mut B {
        &mut self.board
    }

    /// The hardware, for the application.
    pub fn into_board(self) -> B {
        self.board
    }
}
