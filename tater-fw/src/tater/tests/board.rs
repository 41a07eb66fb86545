//! A fake motor board, and a bench that runs a [`Tater`] on it and exchanges frames with it.

use boot::storage::{Progress, Store};
use boot::{Chip, Flash, FlashError};
use servo_core::Drive;
use servo_core::mode::Mode;
use servo_core::motor::BoardFigures;
use servo_core::sense::commutation::Bridge;
use servo_core::units::{DeciCelsius, Micros, MilliAmps, MilliVolts};
use std::vec::Vec;
use tater_fw::SetError;
use tater_fw::tater::heat::COLD;
use tater_fw::{Analog, Board, Tater};
use tater_wire::map::{Area, Map, Memories};
use tater_wire::{Body, Destination, FaultCode, Frame, Group, Message, Node, Property, Value};

/// Hall codes of sectors 0 to 5 (decision 0003).
const CODES: [u8; 6] = [2, 6, 4, 5, 1, 3];

const FLASH: Area = Area { start: 0x0800_0000, len: 128 * 1024 };
const PAGE: u32 = 1024;
const RAM: Area = Area { start: 0x2000_0000, len: 20 * 1024 };

pub const SERIAL: u16 = 12_345;

/// Flash that fails on request, and counts violations.
#[derive(Debug)]
pub struct FakeFlash {
    words: Vec<u16>,
    pub broken: bool,
    pub operations: u32,
    pub erases: u32,
    pub erased_while_driven: u32,
    driven: bool,
}

impl Flash for FakeFlash {
    const MAP: Map = Map::new(Memories { flash: FLASH, page: PAGE, unit: 2, ram: RAM }, 16 * 1024, 8 * 1024);

    fn half_word(&self, address: u32) -> u16 {
        let index = address.wrapping_sub(FLASH.start) as usize / 2;
        self.words.get(index).copied().unwrap_or(u16::MAX)
    }

    fn program(&mut self, address: u32, unit: &[u16]) -> Result<(), FlashError> {
        let &[value] = unit else { return Err(FlashError::Address) };
        self.operations += 1;
        let index = address.wrapping_sub(FLASH.start) as usize / 2;
        let word = self.words.get_mut(index).ok_or(FlashError::Address)?;
        if self.broken {
            return Err(FlashError::Verify);
        }
        if *word != u16::MAX && value != 0 {
            return Err(FlashError::NotErased);
        }
        *word = value;
        Ok(())
    }

    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        self.operations += 1;
        self.erases += 1;
        self.erased_while_driven += u32::from(self.driven);
        let start = page.wrapping_sub(FLASH.start) as usize / 2;
        let words = self.words.get_mut(start..start + PAGE as usize / 2).ok_or(FlashError::Address)?;
        if self.broken {
            return Err(FlashError::Verify);
        }
        words.fill(u16::MAX);
        Ok(())
    }
}

#[derive(Debug)]
pub struct FakeBoard {
    pub flash: FakeFlash,
    pub halls: u8,
    pub analog: Analog,
    pub straps: Node,
    pub listened: Vec<(Node, [Option<Group>; 3])>,
    pub bridge: Bridge,
    pub brake_released: bool,
    pub sent: Vec<Frame>,
    pub room: usize,
    pub feeds: u32,
    pub tick_feeds: u32,
    /// Kept over a reset.
    pub retained: u32,
    /// Resets, each with whether the bridge was on and the brake released.
    pub resets: Vec<(bool, bool)>,
    pub sent_at_reset: usize,
    /// Flash operations done before the bridge was switched on first.
    pub operations_at_drive: Option<u32>,
}

impl FakeBoard {
    /// A healthy board with the standard wiring stored, as it is shipped, and its rotor at count 0.
    pub fn new(straps: u8) -> Self {
        let mut board = Self::unwired(straps);
        let mut store = Store::open(&board.flash);
        store.set(Property::WIRING, 2);
        let stored = (0..100).any(|_| store.step(&mut board.flash, true) == Progress::Done);
        assert!(stored, "one property is stored within 100 half-words");
        (board.flash.operations, board.flash.erases) = (0, 0);
        board
    }

    /// The same with blank flash.
    pub fn unwired(straps: u8) -> Self {
        Self {
            flash: FakeFlash {
                words: std::vec![u16::MAX; FLASH.len as usize / 2],
                broken: false,
                operations: 0,
                erases: 0,
                erased_while_driven: 0,
                driven: false,
            },
            halls: CODES[0],
            analog: Analog {
                bus: MilliVolts(24_000),
                current: MilliAmps(0),
                motor_temp: DeciCelsius(310),
                board_temp: DeciCelsius(290),
                strain: 100,
                raw: [1234, 2345],
                bridge_fault: false,
            },
            straps: Node::new(straps).expect("0 to 31"),
            listened: Vec::new(),
            bridge: Bridge::Off,
            brake_released: false,
            sent: Vec::new(),
            room: usize::MAX,
            feeds: 0,
            tick_feeds: 0,
            retained: COLD,
            resets: Vec::new(),
            sent_at_reset: 0,
            operations_at_drive: None,
        }
    }

    pub const fn analog_mut(&mut self) -> &mut Analog {
        &mut self.analog
    }

    pub fn turn_to(&mut self, count: i32) {
        self.halls = CODES[count.rem_euclid(6) as usize];
    }
}

impl Chip for FakeBoard {
    type Flash = FakeFlash;

    fn transmit(&mut self, frame: &Frame) -> bool {
        if self.room == 0 {
            return false;
        }
        self.room -= 1;
        self.sent.push(*frame);
        true
    }

    fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]) {
        self.listened.push((node, groups));
    }

    fn flash(&mut self) -> &mut FakeFlash {
        &mut self.flash
    }

    fn feed_watchdog(&mut self) {
        self.feeds += 1;
    }

    fn reset(&mut self) {
        self.sent_at_reset = self.sent.len();
        self.resets.push((self.bridge != Bridge::Off, self.brake_released));
    }

    fn reset_cause(&self) -> Option<FaultCode> {
        None
    }

    fn straps(&self) -> Node {
        self.straps
    }

    fn serial_number(&self) -> u16 {
        SERIAL
    }
}

impl Board for FakeBoard {
    const FIGURES: BoardFigures = BoardFigures::TATER;

    fn bridge(&mut self, bridge: Bridge) {
        self.bridge = bridge;
        self.flash.driven = bridge != Bridge::Off;
        if self.flash.driven && self.operations_at_drive.is_none() {
            self.operations_at_drive = Some(self.flash.operations);
        }
    }

    fn brake(&mut self, released: bool) {
        self.brake_released = released;
    }

    fn halls(&self) -> u8 {
        self.halls
    }

    fn analog(&self) -> Analog {
        self.analog
    }

    fn feed_tick_watchdog(&mut self) {
        self.tick_feeds += 1;
    }

    fn retained(&self) -> u32 {
        self.retained
    }

    fn retain(&mut self, word: u32) {
        self.retained = word;
    }
}

#[derive(Debug)]
pub struct Bench {
    pub tater: Tater<FakeBoard>,
    pub now: Micros,
    pub count: i32,
}

impl Bench {
    pub fn new(straps: u8) -> Self {
        Self::on(FakeBoard::new(straps), 0)
    }

    pub fn on(mut board: FakeBoard, count: i32) -> Self {
        board.turn_to(count);
        // The clock wraps during the test.
        let now = Micros(u32::MAX - 50_000);
        let mut tater = Tater::new(board, now);
        // The rotor here follows no torque.
        tater.trust_direction();
        Self { tater, now, count }
    }

    pub fn board(&mut self) -> &mut FakeBoard {
        self.tater.board_mut()
    }

    /// One tick in which the rotor moves to a count, edge by edge.
    pub fn tick_to(&mut self, count: i32) -> Drive {
        while self.count != count {
            self.count += (count - self.count).signum();
            let count = self.count;
            self.board().turn_to(count);
            self.now = self.now.wrapping_add(Micros(100));
            let now = self.now;
            self.tater.hall(now);
        }
        if self.tick_alone() {
            self.tater.flush();
        }
        self.tater.drive()
    }

    /// A tick without the flush that it may request.
    pub fn tick_alone(&mut self) -> bool {
        self.now = self.now.wrapping_add(Micros(1000));
        self.tater.tick(self.now)
    }

    pub const fn now(&self) -> Micros {
        self.now
    }

    pub fn tick(&mut self) -> Drive {
        self.tick_to(self.count)
    }

    pub fn ticks(&mut self, ticks: usize) {
        for _ in 0..ticks {
            self.tick();
        }
    }

    /// Ticks, with a rotor that follows the set-point exactly, until idle or for a number of ticks.
    pub fn follow(&mut self, most: usize) {
        let offset = self.count - self.tater.status().position.round();
        for _ in 0..most {
            let goal = self.tater.status().setpoint.round() + offset;
            self.tick_to(goal.clamp(self.count - 4, self.count + 4));
            if self.tater.status().mode == Mode::Idle {
                return;
            }
        }
    }

    /// Runs until everything is stored; pages are erased only after the rotor has stood for a while.
    pub fn settle(&mut self) {
        for _ in 0..20_000 {
            match self.tater.store() {
                Progress::Done => return,
                Progress::More => {}
                Progress::Waiting => {
                    self.tick();
                }
                progress @ Progress::Failed(_) => panic!("{progress:?}"),
            }
        }
        panic!("storing does not end");
    }

    pub fn restart(self) -> Self {
        let Self { tater, count, .. } = self;
        let mut board = tater.into_board();
        board.operations_at_drive = None;
        Self::on(board, count)
    }

    pub fn send(&mut self, frame: &Frame) -> Result<(), SetError> {
        let now = self.now;
        self.tater.receive(frame, now)
    }

    pub fn say(&mut self, to: Destination, from: u8, body: Body) -> Result<(), SetError> {
        let from = Node::new(from).expect("a node");
        self.send(&Message { from, to, body }.frame())
    }

    pub fn own(&self) -> Destination {
        Destination::Node(self.tater.node())
    }

    pub fn set(&mut self, property: Property, value: i64) -> Result<(), SetError> {
        let value = property.write(value).expect("fits 32 bits");
        self.say(self.own(), 0, Body::Set { property: property.id(), value })
    }

    /// The frames that the board has sent since the last call, decoded.
    pub fn said(&mut self) -> Vec<Message> {
        let sent = std::mem::take(&mut self.board().sent);
        sent.iter().map(|frame| Message::parse(frame).expect("boards speak plainly")).collect()
    }

    /// Asserts at most one answer, from this node, to the right group.
    pub fn get(&mut self, property: Property) -> Option<i64> {
        self.said();
        let answered = self.say(self.own(), 0, Body::Get(property.id()));
        let said = self.said();
        assert_eq!(answered.is_ok(), said.len() == 1, "{property:?}: {answered:?} {said:?}");
        let message = said.first()?;
        assert_eq!(message.from, self.tater.node());
        Some(match message.body {
            Body::Position(counts) => {
                assert_eq!((property, message.to), (Property::P, Destination::Group(Group::POSITIONS)));
                i64::from(counts)
            }
            Body::Set { property: id, value } => {
                assert_eq!((id, message.to), (property.id(), Destination::Group(Group::REPLIES)));
                let wide = property.row().bits == 32 || i16::try_from(property.read(value)).is_err();
                assert_eq!(matches!(value, Value::Long(_)), wide, "{property:?}");
                property.read(value)
            }
            body => panic!("{property:?} is answered by {body:?}"),
        })
    }

    pub fn unlock(&mut self) {
        for key in [18384, 23, 3145, 1024, 1] {
            self.set(Property::LOCK, key).expect("keys are taken");
        }
    }

    /// HI to its end, on a rotor that stands against its stop: in mode 4 it turns 200 counts/s away from it and back.
    pub fn home(&mut self) {
        self.set(Property::CMD, 13).expect("HI");
        self.tick();
        let stop = self.count;
        let side = self.tater.status().setpoint_velocity.round().signum();
        for ms in 0..60_000 {
            let status = self.tater.status();
            if status.mode != Mode::Velocity {
                break;
            }
            let step = if ms % 5 == 0 { status.setpoint_velocity.round().signum() } else { 0 };
            let count = self.count + i32::from(step);
            self.tick_to(if (count - stop) * i32::from(side) > 0 { stop } else { count });
        }
        self.follow(5_000);
        assert!(self.tater.status().homed, "{:?}", self.tater.status());
        self.set(Property::CMD, 21).expect("T");
        self.ticks(400);
    }
}
