//! The link to the motor boards: questions with their answers, orders, and what boards report unasked.
//!
//! Every wait ends: a question is asked up to three times with 60 ms each, and once only while the bus is down.
//!
//! **Two boards with one number** both obey its orders and answer its questions (decision 0078). The first answer counts. A second one with another
//! value makes the number suspect, and the serial numbers of its boards decide: [`Boards::find_doubled`].

use core::cell::Cell;

use tater_wire::{Body, Destination, FaultCode, Frame, Group, Message, Property};

use crate::events::EventKind;
use crate::io::Io;
use crate::motors::{COUNT, Motor, Motors};
use crate::shared::Shared;
use crate::status::Status;

/// Time limit of an answer, µs: it takes half a millisecond, and 40 ms while the board erases a page (docs/wire.md). What the owner's way to the
/// bus takes comes on top ([`Io::set_link_us`]).
const ANSWER_US: u64 = 60_000;

const TRIES: usize = 3;

/// Time limit of waking a board, which may be off the bus for a second (docs/wire.md), and the poll interval meanwhile, µs.
const WAKE_US: u64 = 1_500_000;
const WAKE_POLL_US: u64 = 20_000;

/// Time that a board needs to write a SAVE, µs: it erases up to two pages, 40 ms each, and writes a record.
const STORE_US: u64 = 100_000;

/// Time in which a second board's answer follows the first one, µs: 16 times a frame of 52 bits, its error frame of 20 and 3 bits between for each of
/// seven numbers, until both boards are error passive (ISO 11898-1), and their frames. One that erases a page comes too late, and is found the next time.
const SECOND_US: u64 = 10_000;

/// LFLAGS: report ends of motions and breakaways.
pub(crate) const REPORTS: i64 = 3;

/// A value of each motor that has one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Answers([Option<i64>; COUNT]);

impl Answers {
    /// The value that `value` returns for each of those motors.
    #[must_use]
    pub fn from_fn(motors: Motors, value: impl Fn(Motor) -> Option<i64>) -> Self {
        let mut answers = Self::default();
        for motor in motors.iter() {
            if let Some(value) = value(motor) {
                answers.set(motor, value);
            }
        }
        answers
    }

    /// The same value for each of those motors.
    #[must_use]
    pub fn uniform(motors: Motors, value: i64) -> Self {
        Self::from_fn(motors, |_| Some(value))
    }

    /// A motor's value.
    #[must_use]
    pub fn get(&self, motor: Motor) -> Option<i64> {
        self.0.get(motor.index()).copied().flatten()
    }

    /// Sets a motor's value.
    pub fn set(&mut self, motor: Motor, value: i64) {
        if let Some(place) = self.0.get_mut(motor.index()) {
            *place = Some(value);
        }
    }

    /// These values, replaced by those of `other` where it has one.
    #[must_use]
    pub fn overridden_by(&self, other: &Self) -> Self {
        Self::from_fn(Motors::ALL, |motor| other.get(motor).or(self.get(motor)))
    }

    /// The values that differ from those of `other`, or that it lacks.
    #[must_use]
    pub fn different_from(&self, other: &Self) -> Self {
        Self::from_fn(Motors::ALL, |motor| self.get(motor).filter(|&value| other.get(motor) != Some(value)))
    }

    /// The same motors with other values.
    #[must_use]
    pub fn map(&self, to: impl Fn(Motor, i64) -> i64) -> Self {
        Self::from_fn(Motors::ALL, |motor| Some(to(motor, self.get(motor)?)))
    }

    /// The motors that have a value.
    #[must_use]
    pub fn motors(&self) -> Motors {
        self.filter(|_| true)
    }

    /// The motors whose value satisfies `is`.
    #[must_use]
    pub fn filter(&self, is: impl Fn(i64) -> bool) -> Motors {
        Motors::ALL.iter().filter(|&motor| self.get(motor).is_some_and(&is)).collect()
    }
}

/// MODE and END of a board as it answered or reported them since [`Boards::take_reported`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reported {
    /// MODE.
    pub mode: Option<i64>,
    /// END: 0 during a motion.
    pub end: Option<i64>,
}

/// One item for each property that is requested ahead of its use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ahead<T> {
    /// P.
    pub position: T,
    /// VEL, the velocity that there is: V is the commanded one in mode 4.
    pub velocity: T,
    /// SG.
    pub strain: T,
}

impl<T> Ahead<T> {
    fn get_mut(&mut self, property: Property) -> Option<&mut T> {
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
    /// The values, with 0 for those that are not wanted; `None` while a wanted one is missing.
    fn complete(self, wanted: Ahead<bool>) -> Option<Ahead<i64>> {
        let value = |wanted: bool, value: Option<i64>| if wanted { value } else { Some(0) };
        Some(Ahead {
            position: value(wanted.position, self.position)?,
            velocity: value(wanted.velocity, self.velocity)?,
            strain: value(wanted.strain, self.strain)?,
        })
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Board {
    reported: Reported,
    logged_mode: Option<i64>,
    /// Answers to [`Boards::ask_ahead`].
    ahead: Ahead<Option<i64>>,
    /// The last answers of all.
    latest: Ahead<Option<i64>>,
    /// The last answer to a question of [`Boards::get`], until the next question.
    answered: Option<(Property, i64)>,
    /// Since when [`Boards::ask_latest`] has waited for an answer, µs.
    asked_us: Ahead<Option<u64>>,
    received_us: u64,
}

/// The boards on the bus.
#[derive(Debug)]
pub struct Boards<'a> {
    io: &'a Io,
    boards: Shared<[Board; COUNT]>,
    asked_us: Cell<u64>,
    /// Motors whose number may have two boards: see [`Self::find_doubled`].
    suspects: Cell<Motors>,
}

/// The serial numbers of two boards with one number.
pub type Doubles = (Answers, Answers);

impl<'a> Boards<'a> {
    /// The boards of a bus.
    #[must_use]
    pub fn new(io: &'a Io) -> Self {
        Self { io, boards: Shared::default(), asked_us: Cell::new(0), suspects: Cell::new(Motors::NONE) }
    }

    /// Asks for a property and waits. Boards that do not answer in time have no value. Of MODE and END a board may send two values meanwhile,
    /// its answer and the report of an end: the first is taken, the second is noted as a report.
    pub async fn get(&self, motors: Motors, property: Property) -> Answers {
        let mut answers = Answers::default();
        for _ in 0..TRIES {
            let missing = motors.difference(answers.motors());
            if missing.is_empty() {
                break;
            }
            self.drain();
            self.ask(missing, property).await;
            let deadline = self.io.after_us(self.answer_us());
            while !motors.difference(answers.motors()).is_empty() {
                let Some(frame) = self.io.receive(deadline).await else { break };
                match parse_report(&frame) {
                    Some((motor, id, value))
                        if id == property && motors.has(motor) && answers.get(motor).is_none() =>
                    {
                        self.log_answer(motor, property, value);
                        answers.set(motor, value);
                        self.expect_no_other(motor, Some((property, value)));
                    }
                    _ => self.note(&frame),
                }
            }
            if self.io.is_bus_down() {
                break;
            }
        }
        for motor in motors.difference(answers.motors()).iter() {
            self.io.record(EventKind::NoAnswer { motor, property });
        }
        answers
    }

    /// Asks for a property and does not wait: [`Self::take_reported`] has the answers.
    pub async fn ask(&self, motors: Motors, property: Property) {
        for motor in motors.iter() {
            self.expect_no_other(motor, None);
            self.send(Message::get(Destination::Node(motor.node()), property)).await;
        }
    }

    /// The motors whose number two boards have, by their serial numbers: the first and the second one. Boards with the same serial number are not told apart.
    pub async fn find_doubled(&self, motors: Motors) -> Doubles {
        self.drain();
        self.ask(motors, Property::SN).await;
        let (mut first, mut second) = (Answers::default(), Answers::default());
        let mut deadline = self.io.after_us(self.answer_us());
        while let Some(frame) = self.io.receive(deadline).await {
            match parse_report(&frame) {
                Some((motor, Property::SN, value)) if motors.has(motor) => match first.get(motor) {
                    None => {
                        first.set(motor, value);
                        if first.motors() == motors {
                            deadline = self.io.after_us(SECOND_US.saturating_add(self.io.link_us()));
                        }
                    }
                    Some(known) if known != value => second.set(motor, value),
                    Some(_) => {}
                },
                _ => self.note(&frame),
            }
        }
        let doubled = second.motors();
        for motor in doubled.iter() {
            self.io.record(EventKind::Doubled { motor });
        }
        self.suspects.set(self.suspects.get().difference(motors).union(doubled));
        (Answers::from_fn(doubled, |motor| first.get(motor)), second)
    }

    /// The motors whose number has two boards, or may have: boards have answered one question with two values.
    pub(crate) fn suspects(&self) -> Motors {
        self.drain();
        self.suspects.get()
    }

    /// Notes an answer that is the only one to its question, or that a question is asked.
    fn expect_no_other(&self, motor: Motor, answer: Option<(Property, i64)>) {
        // A report of MODE and END may follow the answer.
        let answer = answer.filter(|(property, _)| !matches!(property, Property::MODE | Property::END));
        self.with(motor, |board| board.answered = answer);
    }

    /// As [`Self::ask`], for what is read as the latest answer. A board that still owes an answer is not asked again: on a loaded bus the answers of those with
    /// high numbers are late, and come together then.
    pub async fn ask_latest(&self, motors: Motors, property: Property) {
        self.drain();
        for motor in motors.iter().filter(|&motor| self.is_to_be_asked(motor, property)) {
            self.ask(Motors::only(motor), property).await;
        }
    }

    /// Time limit of an answer, µs.
    pub(crate) const fn answer_us(&self) -> u64 {
        ANSWER_US.saturating_add(self.io.link_us())
    }

    /// Marks the question as asked, unless it has been for less than [`Self::answer_us`].
    fn is_to_be_asked(&self, motor: Motor, property: Property) -> bool {
        let now_us = self.io.now_us();
        let is_owed = self.with(motor, |board| {
            let Some(asked_us) = board.asked_us.get_mut(property) else { return false };
            let is_owed = asked_us.is_some_and(|asked_us| now_us < asked_us.saturating_add(self.answer_us()));
            if !is_owed {
                *asked_us = Some(now_us);
            }
            is_owed
        });
        !is_owed
    }

    /// What `act` makes of a motor's board.
    fn with<R: Default>(&self, motor: Motor, act: impl FnOnce(&mut Board) -> R) -> R {
        self.boards.with(|boards| boards.get_mut(motor.index()).map_or_else(R::default, act))
    }

    /// Asks for what [`Self::answer_of`] is to wait for later. All seven boards are asked at once, by their group.
    pub async fn ask_ahead(&self, motors: Motors, wanted: Ahead<bool>) {
        self.drain();
        self.boards.with(|boards| {
            for board in boards {
                (board.ahead, board.answered) = (Ahead::default(), None);
            }
        });
        self.asked_us.set(self.io.now_us());
        if motors == Motors::ALL {
            for property in wanted.properties() {
                self.send(Message::get(Destination::Group(Group::TATERS), property)).await;
            }
            return;
        }
        for motor in motors.iter() {
            for property in wanted.properties() {
                self.ask(Motors::only(motor), property).await;
            }
        }
    }

    /// A board's answers since [`Self::ask_ahead`]. Asks once more if they are late and the bus is up. `None` if some are still missing.
    pub async fn answer_of(&self, motor: Motor, wanted: Ahead<bool>) -> Option<Ahead<i64>> {
        // All boards were asked at that time.
        let mut deadline = self.asked_us.get().saturating_add(self.answer_us());
        for is_first in [true, false] {
            loop {
                let found = self.with(motor, |board| board.ahead.complete(wanted));
                if found.is_some() {
                    return found;
                }
                let Some(frame) = self.io.receive(deadline).await else { break };
                self.note(&frame);
            }
            if !is_first || self.io.is_bus_down() {
                break;
            }
            for property in wanted.properties() {
                self.ask(Motors::only(motor), property).await;
            }
            deadline = self.io.after_us(self.answer_us());
        }
        for property in wanted.properties() {
            self.io.record(EventKind::NoAnswer { motor, property });
        }
        None
    }

    /// Sets a property of each motor that has a value there. A board does not acknowledge.
    pub async fn set_each(&self, property: Property, values: &Answers) {
        for motor in values.motors().iter() {
            let value = values.get(motor).unwrap_or(0);
            if let Some(message) = Message::set(Destination::Node(motor.node()), property, value) {
                // In RealTime these come hundreds of times a second.
                if !matches!(property, Property::V | Property::KPV) {
                    self.io.record(EventKind::Sent { motor, property, value });
                }
                self.send(message).await;
            }
        }
    }

    /// Sets a property to the same value on all of those boards.
    pub async fn set(&self, motors: Motors, property: Property, value: i64) {
        self.set_each(property, &Answers::uniform(motors, value)).await;
    }

    /// SAVEs values of a property, one after another, and waits until the boards have written them to flash. Returns the sum of
    /// [`Status::NO_BOARD`] and [`Status::NOT_STORED`] where they apply.
    pub async fn save(&self, motors: Motors, values: impl Iterator<Item = i64>) -> Status {
        // An earlier failure of the flash is cleared first. While a board has a fault of another kind, ERROR does not show this one.
        let is_storage = |code| FaultCode::of(code) == Some(FaultCode::Storage);
        self.set(self.get(motors, Property::ERROR).await.filter(is_storage), Property::STAT, 2).await;
        for value in values {
            self.set(motors, Property::SAVE, value).await;
        }
        self.listen_until(self.io.after_us(STORE_US)).await;
        let errors = self.get(motors, Property::ERROR).await;
        let silent = motors.difference(errors.motors());
        let answered = if silent.is_empty() { Status::OK } else { Status::NO_BOARD };
        let stored = if errors.filter(is_storage).is_empty() { Status::OK } else { Status::NOT_STORED };
        answered | stored
    }

    /// Wakes the boards that are in their monitor. Returns the motors whose application runs.
    pub async fn wake(&self, motors: Motors) -> Motors {
        let stat = self.get(motors, Property::STAT).await;
        let asleep = stat.filter(|stat| stat == 0);
        let mut awake = stat.filter(|stat| stat == 2);
        if !asleep.is_empty() {
            self.set(asleep, Property::STAT, 2).await;
            let deadline = self.io.after_us(WAKE_US);
            let mut left = asleep;
            while !left.is_empty() && self.io.now_us() < deadline {
                self.listen_until(self.io.after_us(WAKE_POLL_US)).await;
                left = left.difference(self.get(left, Property::STAT).await.filter(|stat| stat == 2));
            }
            let woken = asleep.difference(left);
            self.set(woken, Property::LFLAGS, REPORTS).await;
            self.set_own_units(woken).await;
            awake = awake.union(woken);
        }
        awake
    }

    /// Makes boards speak this project's units until their next start, whatever HOSTUNITS they have stored for another host.
    pub async fn set_own_units(&self, motors: Motors) {
        self.set(motors, Property::HOSTUNITS, 0).await;
    }

    /// Returns MODE and END as a motor's board stated them since the last call.
    pub fn take_reported(&self, motor: Motor) -> Reported {
        self.drain();
        self.with(motor, |board| core::mem::take(&mut board.reported))
    }

    /// The last answers for what [`Self::ask_ahead`] asks for, however old.
    pub(crate) fn latest(&self, motor: Motor) -> Ahead<Option<i64>> {
        self.drain();
        self.with(motor, |board| board.latest)
    }

    pub(crate) fn received_us(&self, motor: Motor) -> u64 {
        self.with(motor, |board| board.received_us)
    }

    /// Waits for a frame until a deadline, and notes what it reports.
    pub async fn wait_for_report(&self, deadline_us: u64) {
        if let Some(frame) = self.io.receive(deadline_us).await {
            self.note(&frame);
            self.drain();
        }
    }

    /// Waits until then, and notes what the boards report meanwhile.
    pub async fn listen_until(&self, deadline_us: u64) {
        while let Some(frame) = self.io.receive(deadline_us).await {
            self.note(&frame);
        }
    }

    pub(crate) fn drain(&self) {
        while let Some(frame) = self.io.try_receive() {
            self.note(&frame);
        }
    }

    async fn send(&self, message: Message) {
        // A dead bus shows as boards that do not answer.
        let _ = self.io.send(message.frame()).await;
    }

    pub(crate) fn note(&self, frame: &Frame) {
        let Some((motor, property, value)) = parse_report(frame) else { return };
        self.log_answer(motor, property, value);
        self.with(motor, |board| {
            if board.answered.is_some_and(|(of, answer)| of == property && answer != value) {
                self.suspects.set(self.suspects.get().union(Motors::only(motor)));
            }
            if let Some(ahead) = board.ahead.get_mut(property) {
                *ahead = Some(value);
            }
            if let Some(latest) = board.latest.get_mut(property) {
                *latest = Some(value);
            }
            if let Some(asked_us) = board.asked_us.get_mut(property) {
                *asked_us = None;
            }
            match property {
                Property::MODE => board.reported.mode = Some(value),
                Property::END => board.reported.end = Some(value),
                _ => {}
            }
        });
    }

    fn log_answer(&self, motor: Motor, property: Property, value: i64) {
        self.with(motor, |board| {
            board.received_us = self.io.now_us();
            match property {
                Property::ERROR if value != 0 => self.io.record(EventKind::Fault { motor, code: value }),
                Property::END if value != 0 => self.io.record(EventKind::Ended { motor, end: value }),
                Property::MODE if board.logged_mode != Some(value) => {
                    board.logged_mode = Some(value);
                    self.io.record(EventKind::Mode { motor, mode: value });
                }
                _ => {}
            }
        });
    }
}

/// The motor, property and value that a board's frame states, if it is an answer or a report.
#[must_use]
pub fn parse_report(frame: &Frame) -> Option<(Motor, Property, i64)> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io;
    use core::pin::pin;
    use std::vec::Vec;
    use tater_wire::Node;

    fn motor(number: u8) -> Motor {
        Motor::new(number).expect("a motor")
    }

    fn report(number: u8, property: Property, value: i64) -> Frame {
        let node = Node::new(number).expect("a node");
        Message::reply(node, property, value).expect("it fits").frame()
    }

    /// Runs what does not wait, at a time. Returns the motors and properties that were asked for.
    fn asked(io: &Io, now_us: u64, work: impl Future<Output = ()>) -> Vec<(u16, u8)> {
        io::poll(pin!(work), io, now_us);
        core::iter::from_fn(|| io.pop_frame()).map(|frame| (frame.raw_id(), frame.data()[0])).collect()
    }

    #[test]
    fn answers_combine_motor_by_motor() {
        let (links, tips) = (Motors::LINKS, Motors::TIPS);
        let mut some = Answers::uniform(links, 5);
        some.set(motor(2), 7);
        assert_eq!((some.get(motor(1)), some.get(motor(2)), some.get(motor(4))), (Some(5), Some(7), None));
        assert_eq!((some.motors(), some.filter(|value| value > 5)), (links, Motors::only(motor(2))));
        let other = Answers::uniform(links.without(motor(3)).union(tips), 7);
        let all = some.overridden_by(&other);
        assert_eq!([1, 2, 3, 5].map(|number| all.get(motor(number))), [Some(7), Some(7), Some(5), Some(7)]);
        assert_eq!(some.different_from(&other).motors(), links.without(motor(2)));
        let mapped = some.map(|motor, value| value * i64::from(motor.number()));
        assert_eq!([1, 2, 3, 4].map(|number| mapped.get(motor(number))), [Some(5), Some(14), Some(15), None]);
    }

    #[test]
    fn owed_answer_is_asked_for_again_after_60_ms() {
        let io = Io::default();
        let boards = Boards::new(&io);
        let one = Motors::only(motor(1));
        let ask = |now_us, property| asked(&io, now_us, boards.ask_latest(one, property));
        assert_eq!(ask(1000, Property::P), [(1, Property::P.id())]);
        assert_eq!(ask(1000, Property::VEL), [(1, Property::VEL.id())]);
        assert_eq!(ask(60_999, Property::P), []);
        assert_eq!(ask(61_000, Property::P), [(1, Property::P.id())]);
        io.push_frame(&report(1, Property::P, -5));
        assert_eq!(ask(61_001, Property::VEL), [(1, Property::VEL.id())]);
        assert_eq!(ask(61_002, Property::P), [(1, Property::P.id())], "it has answered");
        assert_eq!(boards.latest(motor(1)), Ahead { position: Some(-5), velocity: None, strain: None });
        // Of no other property an answer is owed.
        assert_eq!(ask(61_003, Property::MODE), [(1, Property::MODE.id())]);
        assert_eq!(ask(61_003, Property::MODE), [(1, Property::MODE.id())]);
    }

    #[test]
    fn second_value_of_a_motor_while_others_are_awaited_is_a_report() {
        let io = Io::default();
        let boards = Boards::new(&io);
        let answers = Cell::new(None);
        let two = Motors::only(motor(1)).union(Motors::only(motor(2)));
        let mut question = pin!(async { answers.set(Some(boards.get(two, Property::MODE).await)) });
        io::poll(question.as_mut(), &io, 0);
        for (number, mode) in [(1, 5), (1, 3), (2, 5)] {
            io.push_frame(&report(number, Property::MODE, mode));
        }
        io::poll(question.as_mut(), &io, 1000);
        let answers = answers.take().expect("both have answered");
        assert_eq!([1, 2].map(|number| answers.get(motor(number))), [Some(5), Some(5)]);
        assert_eq!([1, 2].map(|number| boards.take_reported(motor(number)).mode), [Some(3), None]);
    }

    #[test]
    fn second_value_of_a_question_makes_a_number_suspect_and_serial_numbers_decide() {
        let io = Io::default();
        let boards = Boards::new(&io);
        let (one, both) = (Motors::only(motor(1)), Motors::only(motor(1)).union(Motors::only(motor(2))));
        let answer = |frames: &[Frame]| frames.iter().for_each(|frame| io.push_frame(frame));
        let ask = |now_us, property, frames: &[Frame]| {
            let mut question = pin!(boards.get(both, property));
            io::poll(question.as_mut(), &io, now_us);
            answer(frames);
            io::poll(question, &io, now_us + 1);
            boards.suspects()
        };
        let temp = |number, value| report(number, Property::TEMP, value);
        assert_eq!(ask(0, Property::TEMP, &[temp(1, 350), temp(2, 340), temp(2, 340)]), Motors::NONE);
        assert_eq!(ask(10, Property::TEMP, &[temp(1, 350), temp(1, 351), temp(2, 340)]), one);
        let identify = |now_us, frames: &[Frame]| {
            let found = Cell::new(None);
            let mut question = pin!(async { found.set(Some(boards.find_doubled(both).await)) });
            io::poll(question.as_mut(), &io, now_us);
            answer(frames);
            io::poll(question.as_mut(), &io, now_us + 1);
            io::poll(question, &io, now_us + 1 + SECOND_US);
            found.take().expect("it ends")
        };
        let sn = |number, value| report(number, Property::SN, value);
        let (first, second) = identify(20_000, &[sn(2, 8), sn(1, 7), sn(2, 9), sn(1, 7)]);
        assert_eq!((second.motors(), first.motors()), (Motors::only(motor(2)), Motors::only(motor(2))));
        assert_eq!((first.get(motor(2)), second.get(motor(2))), (Some(8), Some(9)));
        assert_eq!(boards.suspects(), Motors::only(motor(2)), "1 is cleared");
        identify(60_000, &[sn(1, 7), sn(2, 9)]);
        assert_eq!(boards.suspects(), Motors::NONE, "one of the two was unplugged");
    }

    #[test]
    fn link_of_the_owner_gives_boards_more_time() {
        let io = Io::default();
        io.set_link_us(250_000);
        let boards = Boards::new(&io);
        let one = Motors::only(motor(1));
        let mut question = pin!(boards.get(one, Property::P));
        assert_eq!(io::poll(question.as_mut(), &io, 1000), 1000 + io::SEND_US, "the frame has to leave");
        assert!(io.pop_frame().is_some());
        assert_eq!(io::poll(question.as_mut(), &io, 61_000), 311_000);
        io.push_frame(&report(1, Property::P, -5));
        io::poll(question, &io, 310_999);
        assert_eq!(io.pop_frame(), None, "it has not asked again");
    }

    #[test]
    fn answers_ahead_are_complete_with_all_that_is_wanted() {
        let wanted = |position, velocity, strain| Ahead { position, velocity, strain };
        let found = Ahead { position: Some(1), velocity: Some(2), strain: None };
        assert_eq!(found.complete(wanted(true, true, true)), None);
        assert_eq!(
            found.complete(wanted(true, false, false)),
            Some(Ahead { position: 1, velocity: 0, strain: 0 })
        );
        assert_eq!(Ahead::default().complete(wanted(false, true, false)), None);
        assert_eq!(Ahead::default().complete(wanted(true, false, false)), None);
        assert_eq!(Ahead::default().complete(wanted(false, false, false)), Some(Ahead::default()));
    }

    #[test]
    fn reports_are_taken_once_and_stamped() {
        let io = Io::default();
        let boards = Boards::new(&io);
        io::poll(pin!(io.sleep_until(io::NEVER)), &io, 77);
        for (property, value) in [(Property::MODE, 3), (Property::END, 1), (Property::SG, 9)] {
            io.push_frame(&report(4, property, value));
        }
        assert_eq!((boards.received_us(motor(4)), boards.received_us(motor(3))), (0, 0));
        assert_eq!(boards.take_reported(motor(4)), Reported { mode: Some(3), end: Some(1) });
        assert_eq!(boards.take_reported(motor(4)), Reported::default());
        assert_eq!((boards.received_us(motor(4)), boards.received_us(motor(3))), (77, 0));
        assert_eq!(boards.latest(motor(4)).strain, Some(9));
    }

    #[test]
    fn only_sets_and_positions_of_the_seven_are_reports() {
        let of = |id, data: &[u8]| parse_report(&Frame::from_raw(id, data).expect("a frame"));
        assert_eq!(of(0x486, &[0x88, 0, 3, 0]), Some((motor(4), Property::MODE, 3)));
        assert_eq!(of(0x483, &[0xBF, 0xFF, 0xFE]), Some((motor(4), Property::P, -2)));
        assert_eq!(of(0x406, &[0x88, 0, 3, 0]), None, "the host's");
        assert_eq!(of(0x506, &[0x88, 0, 3, 0]), None, "node 8");
        assert_eq!(of(0x486, &[0x08]), None, "a GET");
        assert_eq!(of(0x486, &[0x86, 0, 3, 0]), None, "no property");
        assert_eq!(of(0x486, &[0x88, 0]), None, "no message");
    }
}
