//! Talks to the motor boards: questions with their answers, orders, and what they report unasked.

use core::cell::RefCell;

use tater_wire::{Body, Destination, FaultCode, Frame, Group, Message, Property};

use crate::io::Io;
use crate::motors::{COUNT, Motor, Motors};
use crate::status::Status;

/// How long an answer may take: half a millisecond, and 40 ms where the board erases a page (DESIGN 4.3).
const ANSWER_US: u64 = 60_000;

/// How often a question is asked before its board is taken for none.
const TRIES: usize = 3;

/// How long a board may be off the bus when it is woken (PROTOCOL 1), and how often it is asked meanwhile.
const WAKE_US: u64 = 1_500_000;
const WAKE_ASK_US: u64 = 20_000;

/// How long a board has, after a SAVE, to put it into its flash: two pages to erase, 40 ms each, and a record (DESIGN 4.3).
const STORE_US: u64 = 100_000;

/// MODE: without power, holds a position, goes by velocity.
pub(crate) const IDLE: i64 = 0;
pub(crate) const HOLDS: i64 = 3;
pub(crate) const VELOCITY: i64 = 4;

/// END: there; nothing turns any more; told to; the link broke away; a fault.
pub(crate) const ARRIVED: i64 = 1;
pub(crate) const STALLED: i64 = 2;
pub(crate) const ABORTED: i64 = 3;
pub(crate) const BROKE_AWAY: i64 = 5;
pub(crate) const FAULT: i64 = 6;

/// LFLAGS: ends of motions and breakaways are reported.
pub(crate) const REPORTS: i64 = 3;

/// A value of each motor that has given one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Answers([Option<i64>; COUNT]);

impl Answers {
    /// A motor's.
    #[must_use]
    pub fn of(&self, motor: Motor) -> Option<i64> {
        self.0.get(motor.index()).copied().flatten()
    }

    /// Puts one in.
    pub fn put(&mut self, motor: Motor, value: i64) {
        if let Some(place) = self.0.get_mut(motor.index()) {
            *place = Some(value);
        }
    }

    /// These, and those in their place where they have one.
    #[must_use]
    pub fn and(&self, those: &Self) -> Self {
        Self(core::array::from_fn(|place| {
            let of = |answers: &Self| answers.0.get(place).copied().flatten();
            of(those).or(of(self))
        }))
    }

    /// Those of these that are others there, or missing.
    #[must_use]
    pub fn differing(&self, those: &Self) -> Self {
        Self(core::array::from_fn(|place| {
            let of = |answers: &Self| answers.0.get(place).copied().flatten();
            of(self).filter(|&value| of(those) != Some(value))
        }))
    }

    /// The motors that have one.
    #[must_use]
    pub fn motors(&self) -> Motors {
        Motors::ALL.iter().filter(|&motor| self.of(motor).is_some()).collect()
    }

    /// The motors whose value is such.
    #[must_use]
    pub fn which(&self, is: impl Fn(i64) -> bool) -> Motors {
        Motors::ALL.iter().filter(|&motor| self.of(motor).is_some_and(&is)).collect()
    }
}

/// What a board has reported unasked since it was last asked for that (LFLAGS).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reported {
    /// Mode after a motion's end.
    pub mode: Option<i64>,
    /// Why it ended (END).
    pub end: Option<i64>,
}

/// One thing for each property that is asked for ahead of its use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ahead<T> {
    /// P.
    pub position: T,
    /// VEL: V is what a board in mode 4 is told.
    pub velocity: T,
    /// SG.
    pub strain: T,
}

impl<T> Ahead<T> {
    fn of(&mut self, property: Property) -> Option<&mut T> {
        match property {
            Property::P => Some(&mut self.position),
            Property::VEL => Some(&mut self.velocity),
            Property::SG => Some(&mut self.strain),
            _ => None,
        }
    }
}

impl Ahead<bool> {
    fn properties(self) -> impl Iterator<Item = Property> {
        [(self.position, Property::P), (self.velocity, Property::VEL), (self.strain, Property::SG)]
            .into_iter()
            .filter_map(|(wanted, property)| wanted.then_some(property))
    }
}

impl Ahead<Option<i64>> {
    /// The values, 0 where none is wanted; `None` while one is missing.
    fn complete(self, wanted: Ahead<bool>) -> Option<Ahead<i64>> {
        let value = |wanted: bool, value: Option<i64>| if wanted { value } else { Some(0) };
        Some(Ahead {
            position: value(wanted.position, self.position)?,
            velocity: value(wanted.velocity, self.velocity)?,
            strain: value(wanted.strain, self.strain)?,
        })
    }
}

/// The boards on the bus.
#[derive(Debug)]
pub struct Boards<'a> {
    io: &'a Io,
    reported: RefCell<[Reported; COUNT]>,
    /// What has been asked for ahead, and answered.
    ahead: RefCell<[Ahead<Option<i64>>; COUNT]>,
}

impl<'a> Boards<'a> {
    /// Nothing is known of them.
    #[must_use]
    pub fn new(io: &'a Io) -> Self {
        Self { io, reported: RefCell::default(), ahead: RefCell::default() }
    }

    /// Asks for a property. Boards that do not answer in time, asked again twice, have no value.
    pub async fn get(&self, motors: Motors, property: Property) -> Answers {
        let mut answers = Answers::default();
        for _ in 0..TRIES {
            let missing = motors.but(answers.motors());
            if missing.is_empty() {
                break;
            }
            self.listen();
            for motor in missing.iter() {
                self.io.send(Message::get(Destination::Node(motor.node()), property).frame()).await;
            }
            let deadline = self.io.now_us().saturating_add(ANSWER_US);
            while !motors.but(answers.motors()).is_empty() {
                let Some(frame) = self.io.receives(deadline).await else { break };
                match said(&frame) {
                    Some((motor, id, value)) if id == property && motors.has(motor) => {
                        answers.put(motor, value);
                    }
                    _ => self.note(&frame),
                }
            }
        }
        answers
    }

    /// Asks for what [`Self::answer_of`] is to wait for later. All seven boards are asked at once, by their group.
    pub async fn ask_ahead(&self, motors: Motors, wanted: Ahead<bool>) {
        self.listen();
        *self.ahead.borrow_mut() = Default::default();
        if motors == Motors::ALL {
            for property in wanted.properties() {
                self.io.send(Message::get(Destination::Group(Group::TATERS), property).frame()).await;
            }
            return;
        }
        for motor in motors.iter() {
            for property in wanted.properties() {
                self.io.send(Message::get(Destination::Node(motor.node()), property).frame()).await;
            }
        }
    }

    /// What a board has answered since [`Self::ask_ahead`]; asked once more if it has not in time, and then `None`.
    pub async fn answer_of(&self, motor: Motor, wanted: Ahead<bool>) -> Option<Ahead<i64>> {
        for again in [true, false] {
            let deadline = self.io.now_us().saturating_add(ANSWER_US);
            loop {
                let found = self.ahead.borrow().get(motor.index()).and_then(|ahead| ahead.complete(wanted));
                if found.is_some() {
                    return found;
                }
                let Some(frame) = self.io.receives(deadline).await else { break };
                self.note(&frame);
            }
            if again {
                for property in wanted.properties() {
                    self.io.send(Message::get(Destination::Node(motor.node()), property).frame()).await;
                }
            }
        }
        None
    }

    /// Sets a property of each motor that has a value there. A board does not acknowledge.
    pub async fn set_each(&self, property: Property, values: &Answers) {
        for motor in values.motors().iter() {
            let value = values.of(motor).unwrap_or(0);
            if let Some(message) = Message::set(Destination::Node(motor.node()), property, value) {
                self.io.send(message.frame()).await;
            }
        }
    }

    /// Sets a property to the same value everywhere.
    pub async fn set(&self, motors: Motors, property: Property, value: i64) {
        let mut values = Answers::default();
        motors.iter().for_each(|motor| values.put(motor, value));
        self.set_each(property, &values).await;
    }

    /// SAVEs values of a property, one after another, and lets boards put them into their flash, so that the power may go off after it.
    /// Returns what that came to: [`Status::NO_BOARD`], [`Status::NOT_STORED`].
    pub async fn save(&self, motors: Motors, what: impl Iterator<Item = i64>) -> Status {
        // What their flash has not taken at other times is not this one's; with a fault of another kind ERROR does not tell.
        let storage = |code| FaultCode::of(code) == Some(FaultCode::Storage);
        self.set(self.get(motors, Property::ERROR).await.which(storage), Property::STAT, 2).await;
        for value in what {
            self.set(motors, Property::SAVE, value).await;
        }
        self.io.sleep_until(self.io.now_us().saturating_add(STORE_US)).await;
        let errors = self.get(motors, Property::ERROR).await;
        let silent = motors.but(errors.motors());
        let answered = if silent.is_empty() { Status::OK } else { Status::NO_BOARD };
        let stored = if errors.which(storage).is_empty() { Status::OK } else { Status::NOT_STORED };
        answered | stored
    }

    /// Wakes those that are in their monitor. Returns those whose application runs.
    pub async fn wake(&self, motors: Motors) -> Motors {
        let stat = self.get(motors, Property::STAT).await;
        let asleep = stat.which(|stat| stat == 0);
        let mut awake = stat.which(|stat| stat == 2);
        if !asleep.is_empty() {
            self.set(asleep, Property::STAT, 2).await;
            let deadline = self.io.now_us().saturating_add(WAKE_US);
            let mut left = asleep;
            while !left.is_empty() && self.io.now_us() < deadline {
                self.io.sleep_until(self.io.now_us().saturating_add(WAKE_ASK_US)).await;
                left = left.but(self.get(left, Property::STAT).await.which(|stat| stat == 2));
            }
            // Ends of motions and breakaways are to be told at once.
            self.set(asleep.but(left), Property::LFLAGS, REPORTS).await;
            awake = awake.and(asleep.but(left));
        }
        awake
    }

    /// What a motor's board has reported since this was last asked.
    pub fn takes(&self, motor: Motor) -> Reported {
        self.listen();
        self.reported.borrow_mut().get_mut(motor.index()).map(core::mem::take).unwrap_or_default()
    }

    /// Waits for a frame until a deadline, and takes note of what it reports.
    pub async fn hear(&self, deadline_us: u64) {
        if let Some(frame) = self.io.receives(deadline_us).await {
            self.note(&frame);
            self.listen();
        }
    }

    /// Takes note of all frames that are there.
    pub(crate) fn listen(&self) {
        while let Some(frame) = self.io.received() {
            self.note(&frame);
        }
    }

    fn note(&self, frame: &Frame) {
        let Some((motor, property, value)) = said(frame) else { return };
        if let Some(ahead) =
            self.ahead.borrow_mut().get_mut(motor.index()).and_then(|ahead| ahead.of(property))
        {
            *ahead = Some(value);
        }
        let mut reported = self.reported.borrow_mut();
        let Some(reported) = reported.get_mut(motor.index()) else { return };
        match property {
            Property::MODE => reported.mode = Some(value),
            Property::END => reported.end = Some(value),
            _ => {}
        }
    }
}

/// Which board says what of which property, if a frame is that.
#[must_use]
pub fn said(frame: &Frame) -> Option<(Motor, Property, i64)> {
    let message = Message::parse(frame)?;
    let motor = Motor::new(message.from.number())?;
    match message.body {
        Body::Position(counts) => Some((motor, Property::P, counts.into())),
        Body::Set { property, value } => {
            let property = Property::of(property)?;
            Some((motor, property, property.read(value)))
        }
        Body::Get(_) | Body::Torques(_) | Body::More { .. } => None,
    }
}
