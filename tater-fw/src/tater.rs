//! The application of a motor board: what each interrupt and task of it does.
//!
//! | when | what |
//! |---|---|
//! | a hall line changes | [`Tater::hall`]: commutate at once |
//! | the break input has tripped | [`Tater::bridge_fault`]: nothing is driven any more |
//! | each millisecond | [`Tater::tick`]: sense, servo, drive |
//! | a frame comes | [`Tater::receive`]: answer, or obey |
//! | ten times a second | [`Tater::slow`]: temperatures, counters, watchdog |
//! | else | [`Tater::store`]: one flash operation, if one is due |

mod commands;
mod kept;
mod outbox;
mod properties;
mod storing;
#[cfg(test)]
mod tests;

use self::kept::Kept;
use crate::board::Board;
use crate::lock::Lock;
use crate::motion::motor;
use crate::storage::{Progress, Store};
use heapless::Deque;
use servo_core::mode::Mode;
use servo_core::sense::commutation::{Bridge, Commutator};
use servo_core::sense::hall::{HallEvent, Wiring};
use servo_core::units::{Micros, Torque};
use servo_core::{Command, Config, Drive, Event, Refusal, Sense, Servo, Telemetry};
use tater_wire::property::{Access, Kind};
use tater_wire::{Body, Destination, Frame, Group, Identifier, Message, Node, Property};

/// Frames that wait for the CAN controller: answers to a host that asks faster than the bus carries. An answer that
/// finds no room is not given: [`Refused::Busy`], and counted in [`Tater::unsent`].
const OUTBOX: usize = 16;

/// Events kept for an observer (a log); the oldest is dropped.
const EVENTS: usize = 8;

/// Ticks of 1 ms without a frame after which a host that steers (modes 2 and 4) is lost: hosts poll at 10 Hz and faster.
const HOST_LOST_MS: u16 = 500;

/// Ticks of 1 ms, without power and without a change of the halls, after which the rotor stands. One that turns slower than
/// this tells of, 5 counts/s, makes no two counts while a page is erased (40 ms): none is lost.
const STILL_MS: u8 = 200;

/// Flash operations that a reset waits for, so that a SAVE just before it is kept: a page holds 512 half-words.
const LAST_OPERATIONS: usize = 1024;

/// Bridge off, brake engaged.
const OFF: Drive = Drive { duty: None, brake_released: false };

/// Why a frame changed nothing. Nobody is told on the bus; logs and simulations are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The frame means nothing.
    Unknown,
    /// Not a property that may be written, or read, or not by this board, or not now (LOCK).
    Access(Property),
    /// The value is out of its range.
    Range(Property),
    /// The board has no number on the bus yet, and so does not move.
    Unnamed,
    /// The servo says no.
    Servo(Refusal),
    /// The answer found no room in the outbox.
    Busy(Property),
}

/// A motor board's application.
#[derive(Debug)]
pub struct Tater<B: Board> {
    board: B,
    node: Node,
    servo: Servo,
    commutator: Commutator,
    /// The lines after an edge that the last tick has seen and left to the interrupt, which has not come since.
    left_edge: Option<u8>,
    /// HALLH: three bits a code, the newest lowest.
    hall_history: u32,
    drive: Drive,
    kept: Kept,
    lock: Lock,
    store: Store,
    /// The decoder's count at which the stored position is true, while its mark is unconsumed.
    trusted_at: Option<i32>,
    /// The flash has failed, and STAT 2 has not cleared it. Whether to try again is the store's to know.
    storage_error: bool,
    breakaway_position: i32,
    outbox: Deque<Frame, OUTBOX>,
    unsent: u32,
    events: Deque<Event, EVENTS>,
    /// Ticks for which the host may stay silent: from [`HOST_LOST_MS`] at a frame to this board or its groups down to 0.
    patience_ms: u16,
    /// Ticks in idle since a hall line changed last; from [`STILL_MS`] on it may be more.
    still_ms: u8,
    /// Whether the tick, whoever handles the bus, and who has nothing else to do have run since the watchdog was fed last.
    ticked: bool,
    bus_served: bool,
    idled: bool,
    /// Of the last [`Self::slow`], and time since then that is no whole second.
    slow_at: Micros,
    slow_us: u32,
    /// Counts travelled that are no whole thousand.
    travelled: u32,
}

impl<B: Board> Tater<B> {
    /// After the monitor has started it: awake, STAT 2, in idle, with what is stored. The node is the stored ID, or the
    /// straps'; a board that has neither obeys groups, so that it can be given an ID, says nothing and does not move.
    pub fn new(board: B, now: Micros) -> Self {
        let mut tater = Self::asleep(board, now);
        tater.wake();
        tater
    }

    /// The first half of [`Self::new`], for a board that has no stack for both at a time; [`Self::wake`] must follow.
    pub fn asleep(mut board: B, now: Micros) -> Self {
        let store = Store::open(board.flash());
        board.bridge(Bridge::Off);
        board.brake(false);
        let id = store.get(Property::ID);
        let node = id.and_then(|id| Node::new(u8::try_from(id).ok()?)).unwrap_or_else(|| board.straps());
        let code = board.halls() & 7;
        let stored = store.trusted_position();
        let trusted = stored.filter(|&(_, at)| at == code).map(|(position, _)| position);
        let count = trusted.unwrap_or(0);
        Self {
            servo: Servo::for_motor(motor(Kind::of(node)), count),
            commutator: Commutator::new(Wiring::STANDARD, code, count),
            left_edge: None,
            hall_history: u32::from(code),
            drive: OFF,
            kept: Kept::default(),
            lock: Lock::default(),
            trusted_at: stored.map(|_| count),
            storage_error: false,
            breakaway_position: 0,
            outbox: Deque::new(),
            unsent: 0,
            events: Deque::new(),
            patience_ms: HOST_LOST_MS,
            still_ms: 0,
            ticked: false,
            bus_served: false,
            idled: false,
            slow_at: now,
            slow_us: 0,
            travelled: 0,
            board,
            node,
            store,
        }
    }

    /// Takes what is stored.
    pub fn wake(&mut self) {
        match self.store.trusted_position() {
            Some((_, at)) if u32::from(at) == self.hall_history => self.servo.trust_position(),
            // The lines say that the rotor is elsewhere: the mark is false for good.
            _ => self.distrust(),
        }
        self.load_all(true);
        // E is 0 until it is set, wherever the motor stands; in range, so it is taken.
        let _ = self.servo.command(Command::End(0));
    }

    /// A hall line changed: commutates at once.
    #[inline(always)]
    pub fn hall(&mut self, now: Micros) {
        let code = self.board.halls() & 7;
        if self.commutator.is_settled(code) {
            return;
        }
        // First of all, before anything is counted: the legs are wrong. A glitch leaves them as they are.
        if let Some(bridge) = self.commutator.ahead(code, now) {
            self.board.bridge(bridge);
        }
        self.turned(code, now);
    }

    /// The lines have changed, or wait for time to pass. The bridge is the caller's to set.
    #[inline(never)]
    fn turned(&mut self, code: u8, now: Micros) {
        self.left_edge = None;
        if u32::from(code) != self.hall_history & 7 {
            self.still_ms = 0;
            self.hall_history = self.hall_history << 3 & 0x3FFF_FFFF | u32::from(code);
        }
        if let Some(event) = self.commutator.sample(code, now) {
            if let HallEvent::Step(edge) = event {
                self.travelled = self.travelled.saturating_add(u32::from(edge.steps));
                self.servo.edge(&edge);
            } else {
                self.servo.hall(&event);
            }
        }
    }

    /// A tick has seen the lines elsewhere, or waits for time to pass. An edge that the filter of the interrupt has yet to let
    /// through is left to it, which comes as soon as this tick is over; one that was there at a tick before is not on its way. Lines
    /// that are elsewhere again at each tick are spikes that keep time with it.
    #[inline(never)]
    fn unsettled(&mut self, now: Micros) {
        let code = self.board.halls() & 7;
        if self.commutator.is_settled(code) {
            self.left_edge = None;
        } else if self.commutator.is_quiet() && self.left_edge != Some(code) {
            self.left_edge = Some(code);
        } else {
            self.turned(code, now);
        }
    }

    /// The break input has tripped, and the hardware has switched the bridge off: no hall edge may switch it on again
    /// before the next tick has told the servo.
    pub fn bridge_fault(&mut self) {
        self.servo.bridge_fault();
        self.commutator.set(None);
        self.board.bridge(Bridge::Off);
    }

    /// The control tick, 1 ms after the last. Returns whether the servo has something to report: then [`Self::flush`] is to
    /// follow, as soon as nothing more urgent waits.
    pub fn tick(&mut self, now: Micros) -> bool {
        self.ticked = true;
        let analog = self.board.analog();
        if self.commutator.is_settled(self.board.glance()) {
            self.left_edge = None;
        } else {
            self.unsettled(now);
        }
        let host_lost = self.patience_ms == 0;
        if !host_lost {
            self.patience_ms = self.patience_ms.wrapping_sub(1);
        }
        let mut drive = self.servo.tick(&Sense {
            now,
            // It has been told of all at once.
            halls: &[],
            bus: analog.bus,
            current: analog.current,
            motor_temp: analog.motor_temp,
            strain: analog.strain,
            bridge_fault: analog.bridge_fault,
            host_lost,
        });
        if let Some(count) = self.trusted_at
            && (drive.duty.is_some() || self.commutator.count() != count || !self.servo.telemetry().homed)
        {
            self.distrust();
            if self.trusted_at.is_some() {
                // The mark could not be consumed.
                drive = OFF;
            }
        }
        self.still_ms = if drive == OFF { self.still_ms.saturating_add(1) } else { 0 };
        self.drive = drive;
        self.commutator.set(drive.duty);
        self.board.bridge(self.commutator.bridge());
        self.board.brake(drive.brake_released);
        self.servo.has_event()
    }

    /// A frame from the bus, any frame: those for other nodes are skipped.
    ///
    /// # Errors
    /// Why it changed nothing and is not answered.
    pub fn receive(&mut self, frame: &Frame, _now: Micros) -> Result<(), Refused> {
        self.bus_served = true;
        let Identifier { from, to } = frame.id();
        if !self.hears(to) {
            return Ok(());
        }
        self.patience_ms = HOST_LOST_MS;
        if self.servo.has_event() {
            // The frame may ask for what the last tick has to report.
            self.report();
        }
        let obeyed = match Message::parse(frame).map(|message| message.body) {
            Some(Body::Get(id)) => self.get(id, from),
            Some(Body::Set { property, value }) => {
                if property != Property::LOCK.id() {
                    self.lock.interrupt();
                }
                match Property::of(property) {
                    Some(property) => self.set(property, property.read(value)),
                    None => Err(Refused::Unknown),
                }
            }
            Some(Body::Torques(torques)) => {
                self.lock.interrupt();
                let most = i16::try_from(self.servo.config().mt).unwrap_or(i16::MAX);
                match torques.slot(self.kept.pidx) {
                    Some(torque) => self.command(Command::Torque(Torque(torque).clamp_abs(Torque(most)))),
                    None => Err(Refused::Range(Property::T)),
                }
            }
            Some(Body::Position(_) | Body::More { .. }) | None => Err(Refused::Unknown),
        };
        self.report();
        self.send();
        obeyed
    }

    /// Whether a frame concerns this board.
    fn hears(&self, to: Destination) -> bool {
        match to {
            Destination::Node(node) => node == self.node && node != Node::HOST,
            Destination::Group(group) => group == Group::ALL || self.groups().contains(&Some(group)),
        }
    }

    /// GRPA, GRPB and GRPC, as far as boards may listen to them.
    fn groups(&self) -> [Option<Group>; 3] {
        let Kept { grpa, grpb, grpc, .. } = self.kept;
        [grpa, grpb, grpc].map(|number| Group::new(number).filter(|group| group.is_for_boards()))
    }

    /// Tells the CAN controller what concerns this board: to be called whenever the groups have changed.
    fn listen(&mut self) {
        let groups = self.groups();
        self.board.listen(self.node, groups);
    }

    fn get(&mut self, id: u8, from: Node) -> Result<(), Refused> {
        let property = Property::of(id).ok_or(Refused::Unknown)?;
        let value = self.read(property).ok_or(Refused::Access(property))?;
        self.say(from, property, value)
    }

    fn set(&mut self, property: Property, value: i64) -> Result<(), Refused> {
        if property == Property::LOCK {
            self.lock.key(value);
        }
        match property.rules().access {
            Access::ReadOnly => Err(Refused::Access(property)),
            Access::ReadWrite | Access::WriteOnly => self.write(property, value),
            Access::Locked => self.unlock(property).and_then(|()| self.write(property, value)),
        }
    }

    /// Ten times a second: temperatures, counters, watchdog. The watchdog is fed only if the tick, the bus ([`Self::receive`] or
    /// [`Self::flush`]) and the storage ([`Self::store`]) have been served since the last time.
    pub fn slow(&mut self, now: Micros) {
        let us = now.wrapping_since(self.slow_at).0.saturating_add(self.slow_us);
        self.slow_at = now;
        self.slow_us = us % 1_000_000;
        let board_temp = self.board.analog().board_temp.0;
        let mut counters = self.store.counters();
        counters.upsecs = counters.upsecs.saturating_add(us / 1_000_000);
        counters.odometer = counters.odometer.saturating_add(self.travelled / 1000);
        // `count` lets none go back.
        counters.ptemp = board_temp;
        self.travelled %= 1000;
        self.store.count(counters);
        if self.ticked && self.bus_served && self.idled {
            self.ticked = false;
            self.bus_served = false;
            self.idled = false;
            self.board.feed();
        }
    }

    /// Whether the rotor stands: without power for so long that it has stopped coasting, and no motion has been asked for.
    fn stands(&self) -> bool {
        self.still_ms >= STILL_MS && self.servo.telemetry().mode == Mode::Idle
    }

    /// One flash operation, if one is due: to be called when there is nothing else to do. Pages are erased only while the
    /// rotor stands, because nobody sees the halls meanwhile; the bridge stays off, because only [`Self::tick`] switches it
    /// on.
    pub fn store(&mut self) -> Progress {
        let stands = self.stands();
        self.idled = true;
        self.step_store(stands)
    }

    fn step_store(&mut self, may_erase: bool) -> Progress {
        let progress = self.store.step(self.board.flash(), may_erase);
        if let Progress::Failed(_) = progress {
            self.storage_error = true;
        }
        progress
    }

    /// Into the monitor: bridge off first; what is to be stored is stored, and so are the
    /// counters.
    fn reset(&mut self) {
        let _ = self.servo.command(Command::Terminate);
        self.drive = OFF;
        self.commutator.set(None);
        self.board.bridge(Bridge::Off);
        self.board.brake(false);
        if !self.stands() {
            self.distrust();
        }
        // All that they have come to, not only what is due.
        self.store.reset_counters(self.store.counters());
        // From now on nobody follows the halls: there is nothing to lose by erasing pages while it coasts.
        for _ in 0..LAST_OPERATIONS {
            // Eight pages and more may be due: longer than the watchdog waits.
            self.board.feed();
            if matches!(self.step_store(true), Progress::Done | Progress::Waiting) {
                break;
            }
        }
        // The last that is heard of it: the move that this has ended, if anybody wants to know.
        self.report();
        self.send();
        self.outbox.clear();
        self.board.reset();
    }

    /// The node that it is on the bus, until the next start.
    #[must_use]
    pub const fn node(&self) -> Node {
        self.node
    }

    /// What the servo says: for logs and simulations.
    #[must_use]
    pub fn status(&self) -> Telemetry {
        self.servo.telemetry()
    }

    /// The servo's configuration: for logs and simulations.
    #[must_use]
    pub fn config(&self) -> &Config {
        self.servo.config()
    }

    /// The hall count since the start: for logs and simulations.
    #[must_use]
    pub const fn count(&self) -> i32 {
        self.commutator.count()
    }

    /// What is driven: for logs and simulations.
    #[must_use]
    pub const fn drive(&self) -> Drive {
        self.drive
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

    /// The hardware, for the monitor after a reset.
    pub fn into_board(self) -> B {
        self.board
    }
}
