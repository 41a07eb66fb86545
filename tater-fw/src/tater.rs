//! The application of a motor board: what each interrupt and task of it does.
//!
//! | when | what |
//! |---|---|
//! | a hall line changes | [`Tater::hall`]: commutate at once |
//! | each millisecond | [`Tater::tick`]: sense, servo, drive |
//! | a frame comes | [`Tater::receive`]: answer, or obey |
//! | ten times a second | [`Tater::slow`]: temperatures, counters, watchdog |
//! | else | [`Tater::store`]: one flash operation, if one is due |

use crate::board::Board;
use crate::storage::{Progress, Store};
use heapless::{Deque, Vec};
use servo_core::sense::commutation::{Bridge, Commutator};
use servo_core::sense::hall::{HallEvent, Wiring};
use servo_core::units::Micros;
use servo_core::{Config, Drive, Event, MotorKind, Refusal, Sense, Servo, Status};
use tater_wire::property::Kind;
use tater_wire::{Frame, Node, Property};

/// Hall events kept between two ticks. Full speed gives one or two; 16 hold a burst of glitches, and what is lost
/// beyond that the decoder's count still has.
const HALL_EVENTS: usize = 16;

/// Frames that wait for the CAN controller: answers to a host that asks faster than the bus carries.
const OUTBOX: usize = 16;

/// Events kept for an observer (a log); the oldest is dropped.
const EVENTS: usize = 8;

/// Why a frame changed nothing. Nobody is told on the bus; logs and simulations are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The frame means nothing.
    Unknown,
    /// Not a property that may be written, or read, or not by this board.
    Access(Property),
    /// The value is out of its range.
    Range(Property),
    /// The servo says no.
    Servo(Refusal),
}

/// A motor board's application.
#[derive(Debug)]
pub struct Tater<B: Board> {
    board: B,
    node: Node,
    servo: Servo,
    commutator: Commutator,
    halls: Vec<HallEvent, HALL_EVENTS>,
    drive: Drive,
    store: Store,
    outbox: Deque<Frame, OUTBOX>,
    events: Deque<Event, EVENTS>,
}

impl<B: Board> Tater<B> {
    /// After the monitor has started it: awake, STAT 2, in idle.
    pub fn new(mut board: B, _now: Micros) -> Self {
        board.bridge(Bridge::Off);
        board.brake(false);
        let store = Store::open(board.flash());
        let node = match store.get(Property::ID).and_then(|id| u8::try_from(id).ok()).and_then(Node::new) {
            Some(node) => node,
            None => board.straps(),
        };
        let kind = match Kind::of(node) {
            Kind::Link => MotorKind::Link,
            Kind::Spread => MotorKind::Spread,
            Kind::Tip => MotorKind::Tip,
        };
        let code = board.halls();
        Self {
            servo: Servo::for_motor(kind, 0),
            commutator: Commutator::new(Wiring::STANDARD, code, 0),
            halls: Vec::new(),
            drive: Drive { duty: None, brake_released: false },
            outbox: Deque::new(),
            events: Deque::new(),
            board,
            node,
            store,
        }
    }

    /// A hall line changed: commutates at once. Also called by every tick.
    pub fn hall(&mut self, now: Micros) {
        if let Some(event) = self.commutator.sample(self.board.halls(), now) {
            // A full list drops the newest; the decoder's count has it.
            let _ = self.halls.push(event);
        }
        self.board.bridge(self.commutator.bridge());
    }

    /// The control tick, 1 ms after the last.
    pub fn tick(&mut self, now: Micros) {
        self.hall(now);
        let analog = self.board.analog();
        self.drive = self.servo.tick(&Sense {
            now,
            halls: &self.halls,
            bus: analog.bus,
            current: analog.current,
            motor_temp: analog.motor_temp,
            strain: analog.strain,
            bridge_fault: analog.bridge_fault,
        });
        self.halls.clear();
        self.commutator.set(self.drive.duty);
        self.board.bridge(self.commutator.bridge());
        self.board.brake(self.drive.brake_released);
        self.report();
        self.flush();
    }

    /// A frame from the bus, any frame: those for other nodes are skipped.
    ///
    /// # Errors
    /// Why it changed nothing and is not answered.
    pub fn receive(&mut self, _frame: &Frame, _now: Micros) -> Result<(), Refused> {
        let _ = self.node;
        self.report();
        self.flush();
        Ok(())
    }

    /// Ten times a second: temperatures, counters, watchdog.
    pub fn slow(&mut self, _now: Micros) {
        self.board.feed();
    }

    /// One flash operation, if one is due: to be called when there is nothing else to do.
    pub fn store(&mut self) -> Progress {
        let idle = self.drive.duty.is_none();
        self.store.step(self.board.flash(), idle)
    }

    /// Hands waiting frames to the CAN controller: after every call above, and when it has room again.
    pub fn flush(&mut self) {
        while let Some(frame) = self.outbox.front() {
            if !self.board.transmit(frame) {
                break;
            }
            self.outbox.pop_front();
        }
    }

    /// The servo's reports: to the host if it has asked for them, and to whoever watches.
    fn report(&mut self) {
        while let Some(event) = self.servo.event() {
            if self.events.is_full() {
                self.events.pop_front();
            }
            // Room was made above.
            let _ = self.events.push_back(event);
        }
    }

    /// What the servo reported, oldest first: for logs and simulations.
    pub fn event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// What the servo says: for logs and simulations.
    #[must_use]
    pub fn status(&self) -> Status {
        self.servo.status()
    }

    /// The servo's configuration: for logs and simulations.
    #[must_use]
    pub fn config(&self) -> &Config {
        self.servo.config()
    }

    /// What is driven: for logs and simulations.
    #[must_use]
    pub const fn drive(&self) -> Drive {
        self.drive
    }

    /// The hall count since the start: for logs and simulations.
    #[must_use]
    pub const fn count(&self) -> i32 {
        self.commutator.count()
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
