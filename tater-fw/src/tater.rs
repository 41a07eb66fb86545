//! The application of a motor board: what each interrupt and task of it does.
//!
//! | when | what |
//! |---|---|
//! | a hall line changes | [`Tater::hall`]: commutate at once |
//! | the break input has tripped | [`Tater::bridge_fault`]: nothing is driven any more |
//! | each millisecond | [`Tater::tick`]: sense, servo, drive |
//! | a frame comes | [`Tater::receive`]: answer, or obey |
//! | ten times a second | [`Tater::housekeeping`]: temperatures, counters, watchdog |
//! | else | [`Tater::store`]: one flash operation, if one is due |

mod find;
mod finding;
pub mod heat;
mod settings;
#[cfg(test)]
mod tests;

use self::finding::Finding;
use self::settings::{Settings, settings};
use crate::board::Board;
use crate::codes::{self, end_code, fault_code, mode_code};
use crate::events::{BoardEvent, Entry, Events};
use crate::motion::{self, motion};
use crate::set_error::SetError;
use boot::FlashError;
use boot::identity::{self, Identifying};
use boot::lock::Lock;
use boot::storage::{Progress, Store};
use heapless::Deque;
use servo_core::guard::thermal::Start;
use servo_core::mode::Mode;
use servo_core::motor::Motor;
use servo_core::num::{low_word, saturating_i16, saturating_signed};
use servo_core::sense::commutation::{Bridge, Commutator};
use servo_core::sense::hall::{HallEvent, Wiring};
use servo_core::units::{CountsPerSec, Micros, Torque};
use servo_core::way::Way;
use servo_core::{Command, Config, Drive, EndReason, Event, Refusal, Sense, Servo, Telemetry};
use tater_wire::property::{Access, Range, Rules, Stored, host_units};
use tater_wire::{
    Body, Cmd, Destination, FaultCode, Frame, Group, Identifier, Message, MotorKind, Node, Property, Torques,
    Value,
};

/// Frames waiting for a CAN mailbox. When full, an answer is dropped ([`SetError::Busy`]) and counted in [`Tater::unsent`].
const OUTBOX: usize = 16;

/// Servo reports handled in one call.
const REPORTS: usize = 8;

/// The rotor counts as standing still after this many ms without power and hall change (decision 0012). Below 5 counts/s it
/// makes no two counts during a page erase (40 ms), so none is lost.
const STANDSTILL_MS: u8 = 200;

/// Most flash operations before a reset, so that a SAVE just before it is not lost: a page holds 512 half-words.
const LAST_OPERATIONS: usize = 1024;

/// LFLAGS bits.
const REPORT_ENDS: u8 = 1;

const REPORT_BREAKAWAYS: u8 = 2;

/// STAT of a board that is awake. A SET of it clears ERROR.
const READY: i32 = 2;

/// The STAT that resets the board into the monitor.
const MONITOR: i32 = 0;

/// The value of SAVE, LOAD and DEF that stands for all properties.
const ALL: i32 = -1;

const OFF: Drive = Drive { duty: None, brake_released: false };

/// Ticks until the host counts as lost (decision 0013); reloaded by each frame to this board or its groups.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct HostTimer(u32);

impl HostTimer {
    /// The host counts as lost. 0 never counts.
    const LOST: u32 = 1;

    fn reloaded(hostms: u16) -> Self {
        match hostms {
            0 => Self(0),
            ms => Self(u32::from(ms) + Self::LOST),
        }
    }

    /// One tick of 1 ms. Returns whether the host counts as lost.
    const fn tick(&mut self) -> bool {
        let lost = self.0 == Self::LOST;
        if self.0 > Self::LOST {
            self.0 = self.0.wrapping_sub(1);
        }
        lost
    }
}

/// A motor board's application.
#[derive(Debug)]
pub struct Tater<B: Board> {
    board: B,
    node: Node,
    kind: MotorKind,
    servo: Servo,
    commutator: Commutator,
    /// The hall code of the last edge interrupt or, if that was before it, of the last tick: unsettled.
    pending_code: Option<u8>,
    /// HALLH: three bits per code, the newest in the lowest.
    hall_history: u32,
    drive: Drive,
    settings: Settings,
    lock: Lock,
    store: Store,
    /// The decoder's count at which the stored position holds, while its mark is not consumed.
    trusted_at: Option<i32>,
    /// The flash has failed, and STAT 2 has not cleared the error. The store decides whether to retry.
    storage_error: bool,
    breakaway_position: i32,
    outbox: Deque<Frame, OUTBOX>,
    unsent: u32,
    /// END of a motion that was refused, until the next motion.
    refused_end: Option<EndReason>,
    /// E is not what the host last asked for: MODE 5 is refused until it is (decision 0068).
    goal_refused: bool,
    finding: Finding,
    events: Events,
    recorded_mode: Mode,
    /// The time of the last tick or frame.
    now: Micros,
    host_timer: HostTimer,
    /// Ticks in idle since the last hall change; saturates at or above [`STANDSTILL_MS`].
    standstill_ms: u8,
    /// Set when served; cleared when the watchdog is fed.
    tick_ran: bool,
    bus_served: bool,
    storage_served: bool,
    housekeeping_at: Micros,
    second_us: u32,
    /// Counts traveled that are not a whole revolution yet.
    traveled: u32,
}

impl<B: Board> Tater<B> {
    /// A board that is awake (STAT 2) and idle, with its stored properties. Without a stored ID or straps it obeys groups, so
    /// that it can be given an ID, answers nothing and does not move (decision 0015).
    pub fn new(board: B, now: Micros) -> Self {
        let mut tater = Self::asleep(board, now);
        tater.wake();
        tater
    }

    /// The first half of [`Self::new`], for a board without stack for both at once; [`Self::wake`] must follow.
    pub fn asleep(mut board: B, now: Micros) -> Self {
        let mut store = Store::open(board.flash());
        store.convert_odometer();
        board.bridge(Bridge::Off);
        board.brake(false);
        let node = identity::node(&Identifying::all(&board, &store));
        let kind = identity::kind(&board, &store, node);
        let code = board.halls() & 7;
        let stored = store.trusted_position();
        let trusted = stored.filter(|&(_, at)| at == code).map(|(position, _)| position);
        let count = trusted.unwrap_or(0);
        Self {
            servo: Servo::new(motion::unconfigured(kind, &B::FIGURES), count),
            commutator: Commutator::new(Wiring::STANDARD, code, count),
            pending_code: None,
            hall_history: u32::from(code),
            drive: OFF,
            settings: Settings::default(),
            lock: Lock::default(),
            trusted_at: stored.map(|_| count),
            storage_error: false,
            breakaway_position: 0,
            outbox: Deque::new(),
            unsent: 0,
            refused_end: None,
            goal_refused: false,
            finding: Finding::Nothing,
            events: Events::default(),
            recorded_mode: Mode::Idle,
            now,
            host_timer: HostTimer::default(),
            standstill_ms: 0,
            tick_ran: false,
            bus_served: false,
            storage_served: false,
            housekeeping_at: now,
            second_us: 0,
            traveled: 0,
            board,
            node,
            kind,
            store,
        }
    }

    /// Loads the stored properties.
    pub fn wake(&mut self) {
        self.start_warm();
        match self.store.trusted_position() {
            Some((_, at)) if u32::from(at) == self.hall_history => self.servo.trust_position(),
            // The halls show another position: the mark is void.
            _ => self.distrust(),
        }
        self.load_all(true);
        self.rewire();
        if self.store.is_damaged(self.board.flash()) {
            self.flash_failed(FlashError::Failed);
        }
        // E is 0 until it is set, wherever the motor stands. 0 is in range.
        let _ = self.servo.command(Command::End(0));
    }

    /// A hall line changed: commutates at once.
    #[inline(always)]
    pub fn hall(&mut self, now: Micros) {
        let code = self.board.halls() & 7;
        if self.commutator.is_settled(code) {
            return;
        }
        // The legs are wrong until this is done; counting comes after (decision 0021). A glitch leaves them.
        if let Some(bridge) = self.commutator.ahead(code, now) {
            self.board.bridge(bridge);
        }
        self.halls_changed(code, now);
    }

    /// The caller sets the bridge.
    #[inline(never)]
    fn halls_changed(&mut self, code: u8, now: Micros) {
        self.pending_code = Some(code);
        if u32::from(code) != self.hall_history & 7 {
            self.standstill_ms = 0;
            self.hall_history = self.hall_history << 3 & 0x3FFF_FFFF | u32::from(code);
        }
        if let Some(event) = self.commutator.sample(code, now) {
            if let HallEvent::Step(edge) = event {
                self.traveled = self.traveled.saturating_add(u32::from(edge.steps));
                self.servo.edge(&edge);
            } else {
                self.servo.hall(&event);
            }
        }
    }

    /// Leaves an unsettled hall code to the edge interrupt, whose filter may not have passed it yet, unless that interrupt or the tick just
    /// before this one saw the same code. A different code at each tick is a spike in step with the tick.
    #[inline(never)]
    fn resolve_halls(&mut self, now: Micros) {
        let code = self.board.halls() & 7;
        if self.commutator.is_settled(code) {
            self.pending_code = None;
        } else if self.pending_code.replace(code) == Some(code) {
            self.halls_changed(code, now);
        }
    }

    /// The break input switched the bridge off in hardware. No hall edge may switch it on again before the servo's next tick.
    pub fn bridge_fault(&mut self) {
        self.servo.bridge_fault();
        self.commutator.set(None);
        self.board.bridge(Bridge::Off);
    }

    /// The control tick, every 1 ms. Returns `true` if the servo has a report: then call [`Self::flush`] soon.
    pub fn tick(&mut self, now: Micros) -> bool {
        self.tick_ran = true;
        self.now = now;
        let analog = self.board.analog();
        if self.commutator.is_settled(self.board.raw_halls()) {
            self.pending_code = None;
        } else {
            self.resolve_halls(now);
        }
        let host_lost = self.host_timer.tick();
        if analog.bridge_fault {
            self.servo.bridge_fault();
        }
        if matches!(self.finding, Finding::Learning(_)) {
            self.step_find(analog.current);
        }
        let mut drive = self.servo.tick(&Sense {
            now,
            bus: analog.bus,
            current: analog.current,
            motor_temp: analog.motor_temp,
            strain: analog.strain,
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
        self.standstill_ms = if drive == OFF { self.standstill_ms.saturating_add(1) } else { 0 };
        self.drive = drive;
        self.commutator.set(drive.duty);
        self.board.bridge(self.commutator.bridge());
        self.board.brake(drive.brake_released);
        // Last: it proves that the whole tick ran.
        self.board.feed_tick_watchdog();
        self.servo.has_event()
    }

    /// Handles any frame from the bus; frames to other nodes are ignored.
    ///
    /// # Errors
    /// The frame changed nothing and is not answered.
    pub fn receive(&mut self, frame: &Frame, now: Micros) -> Result<(), SetError> {
        self.bus_served = true;
        let Identifier { from, to } = frame.id();
        if !self.is_addressed(to) {
            return Ok(());
        }
        if self.servo.has_event() {
            // The frame may ask for the state that these reports change.
            self.drain_events();
        }
        self.now = now;
        let message = Message::parse(frame).map(|message| message.body);
        let result = match message {
            Some(Body::Get(id)) => self.get(id, from),
            Some(Body::Set { property, value }) => self.set_by_number(property, value),
            Some(Body::Torques(torques)) => self.set_torques(torques),
            Some(Body::Position(_) | Body::More { .. }) | None => Err(SetError::Unknown),
        };
        if let Err(error) = result {
            let property = match message {
                Some(Body::Get(property) | Body::Set { property, .. }) => Some(property),
                Some(Body::Torques(_)) => Some(Property::T.id()),
                Some(Body::Position(_) | Body::More { .. }) | None => None,
            };
            self.record(BoardEvent::Refused { property, error });
        }
        // After the order, which may have set HOSTMS.
        self.host_timer = HostTimer::reloaded(self.settings.hostms);
        self.drain_events();
        self.transmit();
        result
    }

    fn set_by_number(&mut self, number: u8, value: Value) -> Result<(), SetError> {
        if number != Property::LOCK.id() {
            self.lock.interrupt();
        }
        let property = Property::of(number).ok_or(SetError::Unknown)?;
        let value = self.host_value(property, property.read(value));
        self.set(property, value)?;
        if !matches!(property, Property::T | Property::V | Property::LOCK) {
            // Every property's range is within 32 bits.
            let value = i32::try_from(value).unwrap_or(i32::MAX);
            self.record(BoardEvent::Order { property, value });
        }
        Ok(())
    }

    fn set_torques(&mut self, torques: Torques) -> Result<(), SetError> {
        self.lock.interrupt();
        let most = i16::try_from(self.servo.config().mt).unwrap_or(i16::MAX);
        let torque = torques.slot(self.settings.pidx).ok_or(SetError::Range(Property::T))?;
        let torque = self.host_value(Property::T, torque.into()).max(i16::MIN.into()).min(i16::MAX.into());
        let torque = saturating_i16(low_word(torque));
        self.command(Command::Torque(Torque(torque).clamp_abs(Torque(most))))
    }

    /// A value from the bus in the board's own units.
    #[inline(never)]
    fn host_value(&self, property: Property, value: i64) -> i64 {
        if self.has_foreign_units() { host_units::to_board(property, self.kind, value) } else { value }
    }

    /// Values on the bus are a BH8-280's.
    fn has_foreign_units(&self) -> bool {
        i64::from(self.settings.hostunits) == host_units::BH8_280
    }

    fn is_addressed(&self, to: Destination) -> bool {
        match to {
            Destination::Node(node) => node == self.node && node != Node::HOST,
            Destination::Group(group) => group == Group::ALL || self.groups().contains(&Some(group)),
        }
    }

    fn groups(&self) -> [Option<Group>; 3] {
        let Settings { grpa, grpb, grpc, .. } = self.settings;
        [grpa, grpb, grpc].map(|number| identity::group(number.into()))
    }

    /// Must be called after each change of the groups.
    fn update_filters(&mut self) {
        let groups = self.groups();
        self.board.set_filters(self.node, groups);
    }

    fn get(&mut self, id: u8, from: Node) -> Result<(), SetError> {
        match Property::of(id) {
            // What can only be set reads 0.
            Some(property) => self.answer(from, property, self.read(property).unwrap_or(0)),
            None => {
                let answer = Message::absent(self.node, from, id).ok_or(SetError::Unknown)?;
                self.push(answer, SetError::Unknown)
            }
        }
    }

    fn set(&mut self, property: Property, value: i64) -> Result<(), SetError> {
        if property == Property::LOCK {
            self.lock.key(value);
        }
        let result = match property.find_rules().access {
            Access::ReadOnly => Err(SetError::Access(property)),
            Access::ReadWrite | Access::WriteOnly => self.write(property, value),
            Access::Locked => self.unlock(property).and_then(|()| self.write(property, value)),
        };
        if matches!(property, Property::E | Property::M | Property::P)
            && let Err(error) = result
        {
            self.goal_refused = true;
            if property == Property::M && matches!(error, SetError::Range(_)) {
                self.end_refused(Refusal::Range);
            }
        }
        result
    }

    // --- properties --------------------------------------------------------------------------------------------

    /// The value of a property, within its row's range; `None` if it can only be set.
    fn read(&self, property: Property) -> Option<i64> {
        match property {
            motion!() => motion::get(self.servo.config(), property).map(i64::from),
            // The ID of a board without one is 0.
            settings!() => settings::get(&self.settings, property).map(i64::from),
            // Kept apart because it reads inputs, which a SAVE of all need not do for each property.
            _ => self.observe(property),
        }
    }

    fn observe(&self, property: Property) -> Option<i64> {
        use Property as P;
        let status = self.servo.telemetry();
        let analog = self.board.analog();
        let counters = self.store.counters();
        let value = match property {
            P::VERS => const { low_word(Property::VERS.rules().min()) },
            P::CTS => self.turn().cast_signed(),
            P::IPNM => self.motor().units_per_n_m().cast_signed(),
            P::FIT => self.servo.unfit().map_or(0, |unfit| i32::from(unfit.code())),
            P::MKT => self.motor().mkt().cast_signed(),
            P::MJ => saturating_signed(self.motor().mj()),
            P::ML => self.motor().ml().cast_signed(),
            P::ERROR => self.error().map_or(0, |fault| i32::from(fault.code())),
            P::STAT => READY,
            P::MODE => low_word(mode_code(status.mode).into()),
            P::TEMP => i32::from(analog.board_temp.0),
            P::PTEMP => i32::from(counters.ptemp),
            P::B => i32::from(self.drive.brake_released),
            P::ANA0 => i32::from(analog.raw[0]),
            P::ANA1 => i32::from(analog.raw[1]),
            P::THERM => i32::from(analog.motor_temp.0),
            P::VBUS => (i32::from(analog.bus.0) + 50) / 100,
            P::IMOTOR => i32::from(analog.current.0),
            P::SG => i32::from(analog.strain),
            P::T => i32::from(self.servo.torque().0),
            P::V if status.mode == Mode::Velocity => status.setpoint_velocity.round().into(),
            P::V | P::VEL => status.velocity.round().into(),
            P::VSET => self.servo.velocity_wanted().round().into(),
            // Sent in 22 bits, beyond the range of a SET.
            P::P => return Some(i64::from(status.position.round())),
            P::E => self.servo.end(),
            P::UPSECS => return Some(counters.upsecs.into()),
            P::OD => return Some(counters.odometer.into()),
            P::MECH => self.commutator.count().rem_euclid(self.turn().cast_signed()),
            P::HALLS => i32::from(self.board.halls() & 7),
            // Ten codes are 30 bits; bit 30 tells GOD whether HI is needed.
            P::HALLH => (self.hall_history | u32::from(status.homed) << 30).cast_signed(),
            P::BD => i32::from(status.breakaway.is_some()),
            P::BP => self.breakaway_position,
            P::FIND => low_word(self.found()),
            P::END => self.refused_end.or(status.end).map_or(0, |reason| low_word(end_code(reason).into())),
            P::LOCK | P::CMD | P::SAVE | P::LOAD | P::DEF | P::M | motion!() | settings!() => return None,
        };
        let rules = property.find_rules();
        Some(i64::from(value).max(rules.min()).min(rules.max()))
    }

    /// Changes nothing on error.
    fn write(&mut self, property: Property, value: i64) -> Result<(), SetError> {
        use Property as P;
        let out_of_range = SetError::Range(property);
        if !property.find_rules().admits(value) {
            return Err(out_of_range);
        }
        // In its range.
        let word = low_word(value);
        match property {
            motion!() | settings!() | P::P | P::MKT | P::MJ | P::ML => self.set_stored(property, word),
            P::PTEMP | P::UPSECS | P::OD => {
                self.set_counter(property, word);
                Ok(())
            }
            P::STAT if word == READY => {
                self.storage_error = false;
                self.command(Command::ClearFault)
            }
            P::STAT if word == MONITOR => {
                self.reset();
                Ok(())
            }
            P::MODE => {
                let mode = codes::mode(value).ok_or(out_of_range)?;
                // A BH8-280's hosts wait for mode 0 where HOLD is 0 (decision 0070).
                let follows_hold = mode == Mode::Trapezoidal && self.has_foreign_units();
                self.command(if follows_hold { Command::MoveToEnd } else { Command::Mode(mode) })
            }
            P::T => self.command(Command::Torque(Torque(saturating_i16(word)))),
            P::V => self.command(Command::Velocity(CountsPerSec::from_int(saturating_i16(word)))),
            P::E => {
                let end = self.goal(property, word)?;
                self.command(Command::End(end))
            }
            P::M => {
                let end = self.goal(property, word)?;
                self.command(Command::Move(end))
            }
            P::CMD => self.run_cmd(value),
            P::FIND => self.find(value),
            P::SAVE => self.save(word),
            P::LOAD => self.load(word),
            P::DEF => self.restore_default(word),
            // `set` has handled it, also for numbers out of range.
            P::LOCK => Ok(()),
            P::STAT => Err(out_of_range),
            P::VERS
            | P::ERROR
            | P::TEMP
            | P::B
            | P::ANA0
            | P::ANA1
            | P::THERM
            | P::VBUS
            | P::IMOTOR
            | P::SG => Err(SetError::Access(property)),
            P::MECH
            | P::CTS
            | P::IPNM
            | P::HALLS
            | P::HALLH
            | P::FIT
            | P::BD
            | P::BP
            | P::END
            | P::VEL
            | P::VSET => Err(SetError::Access(property)),
        }
    }

    /// Takes a value in the property's range. LOAD and DEF call this, not [`Self::write`], which calls them: the recursion
    /// would have no bound on its stack.
    fn set_stored(&mut self, property: Property, value: i32) -> Result<(), SetError> {
        use Property as P;
        let out_of_range = SetError::Range(property);
        let value = self.range().bounded(property, value);
        match property {
            motion!() | P::MKT | P::MJ | P::ML => self.configure(property, value),
            settings!() if property == P::WIRING => self.set_wiring(value),
            settings!() if settings::set(&mut self.settings, property, value) => {
                if matches!(property, P::GRPA | P::GRPB | P::GRPC) {
                    self.update_filters();
                }
                Ok(())
            }
            P::P => {
                let position = self.goal(property, value)?;
                self.set_position(position)
            }
            P::PTEMP | P::UPSECS | P::OD => {
                self.set_counter(property, value);
                Ok(())
            }
            _ => Err(out_of_range),
        }
    }

    fn motor(&self) -> &Motor {
        &self.servo.config().motor
    }

    /// Hall counts a motor revolution: six steps for each pair of poles (manual 1.3.3).
    fn turn(&self) -> u32 {
        3 * u32::from(self.motor().poles.max(2))
    }

    /// The joint's range. One that is empty has no goal.
    fn range(&self) -> Range {
        let Settings { jlo, jhi, .. } = self.settings;
        Range { low: jlo, high: jhi }
    }

    /// Takes a property of the servo or a figure of the motor's data sheet. What the data sheet says stays as it is when the unit of torque or a
    /// count becomes another.
    #[inline(never)]
    fn configure(&mut self, property: Property, value: i32) -> Result<(), SetError> {
        use Property as P;
        let mut config = *self.servo.config();
        let old = config.motor;
        let is_set = motion::set(&mut config, property, value);
        if !is_set || matches!(property, P::MR | P::MPK | P::POLES) {
            let given = |of: P, old: u32| if of == property { value.cast_unsigned() } else { old };
            config.motor.set_mkt(given(P::MKT, old.mkt()));
            config.motor.set_mj(given(P::MJ, old.mj()));
            config.motor.set_ml(given(P::ML, old.ml()));
        }
        self.command(Command::Configure(config))
    }

    fn command(&mut self, command: Command) -> Result<(), SetError> {
        // A board without a node cannot be stopped on its own.
        if self.node == Node::HOST && command.moves() {
            return Err(SetError::Unnamed);
        }
        if self.goal_refused && matches!(command, Command::Mode(Mode::Trapezoidal) | Command::MoveToEnd) {
            let fault = self.servo.telemetry().fault;
            self.end_refused(fault.map_or(Refusal::Range, Refusal::Fault));
            return Err(SetError::Range(Property::E));
        }
        let result = self.servo.command(command);
        match result {
            Ok(()) if command.moves() => self.refused_end = None,
            Err(refusal) if starts_motion(&command) => self.end_refused(refusal),
            Ok(()) | Err(_) => {}
        }
        if result.is_ok() && matches!(command, Command::Move(_) | Command::End(_) | Command::Position(_)) {
            self.goal_refused = false;
        }
        result.map_err(SetError::Servo)
    }

    /// Sets END for a refused motion, or its host would wait forever (decision 0036). A motion under way keeps its own END.
    fn end_refused(&mut self, refusal: Refusal) {
        let Telemetry { mode, end, .. } = self.servo.telemetry();
        if matches!(mode, Mode::Velocity | Mode::Trapezoidal) && end.is_none() {
            return;
        }
        let reason = if let Refusal::Fault(_) = refusal { EndReason::Fault } else { EndReason::Aborted };
        self.refused_end = Some(reason);
        self.handle_event(Event::Ended { reason, mode });
    }

    /// In idle it renames the position, which a host in mode 3 whose motor a fault has idled does not mean.
    fn set_position(&mut self, position: i32) -> Result<(), SetError> {
        match self.error() {
            Some(fault) if self.servo.telemetry().mode == Mode::Idle => Err(SetError::Fault(fault)),
            _ => self.command(Command::Position(position)),
        }
    }

    /// Takes the bits of a value in its range.
    fn set_counter(&mut self, property: Property, value: i32) {
        let mut counters = self.store.counters();
        match property {
            Property::PTEMP => counters.ptemp = saturating_i16(value),
            Property::UPSECS => counters.upsecs = value.cast_unsigned(),
            _ => counters.odometer = value.cast_unsigned(),
        }
        self.store.reset_counters(counters);
    }

    /// A fault of the servo goes before one of the flash, which does not stop the motor.
    fn error(&self) -> Option<FaultCode> {
        let storage = self.storage_error.then_some(FaultCode::Storage);
        self.servo.telemetry().fault.map(fault_code).or(storage)
    }

    fn run_cmd(&mut self, number: i64) -> Result<(), SetError> {
        let cmd = Cmd::of(number).ok_or(SetError::Range(Property::CMD))?;
        self.servo.host_is_back();
        match cmd {
            Cmd::Load => self.load(ALL),
            Cmd::Save => self.save(ALL),
            Cmd::Reset => {
                self.reset();
                Ok(())
            }
            Cmd::Def => self.restore_default(ALL),
            Cmd::Home => self.command(Command::Move(0)),
            // HI clears an old BD too (manual 5.3.2 names only O).
            Cmd::Hi => self.command(Command::Home).and_then(|()| self.command(Command::ClearBreakaway)),
            Cmd::Ic => self.step_by(i32::from(self.settings.ds)),
            Cmd::Io => self.step_by(-i32::from(self.settings.ds)),
            Cmd::Tc => self.command(Command::TorqueControlled { way: Way::Closing }),
            Cmd::To => self.command(Command::TorqueControlled { way: Way::Opening }),
            Cmd::C => self.move_to(self.settings.ct),
            Cmd::M => self.move_to(self.settings.dp),
            Cmd::O => self.move_to(self.settings.ot).and_then(|()| self.command(Command::ClearBreakaway)),
            Cmd::T => self.command(Command::Terminate),
        }
    }

    /// To a stored target, which JLO and JHI bound as they are now.
    fn move_to(&mut self, target: i32) -> Result<(), SetError> {
        let [low, high] = self.range().goals().map(i32::from);
        self.command(Command::Move(target.min(high).max(low)))
    }

    /// A place that a host has ordered, or refused: a host with another hand's units would drive the joint to its stop.
    fn goal(&self, property: Property, counts: i32) -> Result<i32, SetError> {
        let [low, high] = self.range().goals().map(i32::from);
        if low <= counts && counts <= high { Ok(counts) } else { Err(SetError::Range(property)) }
    }

    /// IC and IO: relative to the present position, also during a move (manual 5.2), and not beyond the goals. A joint whose zero is not
    /// known may be beyond them: it steps inwards only.
    fn step_by(&mut self, counts: i32) -> Result<(), SetError> {
        let at = self.servo.telemetry().position.round();
        let [low, high] = self.range().goals().map(i32::from);
        let end = at.saturating_add(counts).max(low.min(at)).min(high.max(at));
        self.command(Command::Move(end))
    }

    // --- SAVE, LOAD and DEF ------------------------------------------------------------------------------------

    /// SAVE: takes effect in RAM now; [`Tater::store`] puts it into flash.
    fn save(&mut self, id: i32) -> Result<(), SetError> {
        let saved = stored_property(Property::SAVE, id)?;
        self.update_counters(self.now);
        self.store.save_counters();
        match saved {
            Some(property) => self.save_one(property),
            None => {
                motion::each(self.servo.config(), |property, value| {
                    self.store.set_by(property.find_rules(), value)
                });
                settings::each(&self.settings, |property, value| {
                    let rules = property.find_rules();
                    if rules.access != Access::Locked {
                        self.store.set_by(rules, value);
                    }
                });
                self.save_one(Property::P);
                for mut own in Identifying::all(&self.board, &self.store) {
                    own.value = settings::get(&self.settings, own.rules.property).unwrap_or(own.default);
                    if own.is_saved(&self.store) {
                        self.save_one(own.rules.property);
                    }
                }
            }
        }
        Ok(())
    }

    fn save_one(&mut self, property: Property) {
        let Some(value) = self.read(property) else { return };
        if property == Property::P
            && self.position_is_known()
            && property.find_rules().admits(value)
            && let Ok(position) = i32::try_from(value)
        {
            self.store.save_position(position, self.board.halls() & 7);
            self.trusted_at = Some(self.commutator.count());
            return;
        }
        // Ignores values out of range (an unset ID, a position outside any joint) and properties that are always stored.
        self.store.set(property, value);
    }

    /// A stored position is trusted at the next start only if the motor is homed and stands still (manual 7, saveParameters).
    fn position_is_known(&self) -> bool {
        self.servo.telemetry().homed && self.stands_still()
    }

    /// LOAD: the stored value, or the default where there is none. The position only in idle.
    fn load(&mut self, id: i32) -> Result<(), SetError> {
        match stored_property(Property::LOAD, id)? {
            Some(property) => {
                self.unlock(property)?;
                // A property that is always stored has no other value.
                if property.find_rules().stored == Stored::Always { Ok(()) } else { self.load_one(property) }
            }
            None => {
                self.load_all(false);
                // Nothing has moved since it was stored, so this only undoes a SET of P.
                match self.store.trusted_position() {
                    Some((position, _)) if self.servo.telemetry().mode == Mode::Idle => {
                        self.command(Command::Position(position))
                    }
                    _ => Ok(()),
                }
            }
        }
    }

    /// DEF: restores the default and forgets the stored value. DEF of all leaves locked properties and the present position.
    fn restore_default(&mut self, id: i32) -> Result<(), SetError> {
        match stored_property(Property::DEF, id)? {
            Some(property) => {
                self.unlock(property)?;
                // A board without straps would have no number.
                if self.unstored(property.find_rules()).is_none() {
                    return Err(SetError::Range(property));
                }
                if property == Property::P {
                    self.in_idle()?;
                    self.distrust();
                }
                self.store.forget(property);
                self.load_one(property)
            }
            None => {
                self.distrust();
                self.store.forget_open();
                self.load_all(false);
                Ok(())
            }
        }
    }

    /// Loads stored values or defaults of all properties but the position; `locked`: locked ones too.
    #[inline(never)]
    fn load_all(&mut self, locked: bool) {
        // The others are bounded by the joint's range.
        for property in [Property::JLO, Property::JHI] {
            if let Some(value) = self.stored(property.find_rules()) {
                let _ = settings::set(&mut self.settings, property, value);
            }
        }
        let mut config = *self.servo.config();
        // Defaults are in range, and `stored` gives nothing else.
        motion::fill(&mut config, |property| self.stored(property.find_rules()));
        let _ = self.servo.command(Command::Configure(config));
        let mut settings = self.settings;
        settings::fill(&mut settings, |property| {
            let rules = property.find_rules();
            let wanted = rules.stored == Stored::Yes && (locked || rules.access != Access::Locked);
            if wanted { self.stored(rules) } else { None }
        });
        self.settings = settings;
        self.update_filters();
    }

    fn load_one(&mut self, property: Property) -> Result<(), SetError> {
        let value = self.stored(property.find_rules()).ok_or(SetError::Range(property))?;
        if property == Property::P {
            self.in_idle()?;
        }
        self.set_stored(property, value)?;
        if property == Property::P && self.trusted_at.is_none() {
            // Nothing has confirmed the loaded position.
            self.servo.doubt_position();
        }
        Ok(())
    }

    fn stored(&self, rules: &Rules) -> Option<i32> {
        let value = self.store.get_by(rules).or_else(|| self.unstored(rules))?;
        Some(self.range().bounded(rules.property, value))
    }

    /// The value where nothing is stored, always in range; `None` for the ID of a board without straps.
    fn unstored(&self, rules: &Rules) -> Option<i32> {
        match rules.property {
            Property::ID | Property::SN => {
                let own = Identifying::all(&self.board, &self.store);
                let own = own.iter().find(|own| own.rules.property == rules.property);
                own.map(|own| own.default).filter(|&value| rules.admits_word(value))
            }
            Property::KIND => Some(identity::default_kind(&self.board, self.node).code().into()),
            _ => rules.default_word(self.node, self.kind),
        }
    }

    /// An open LOCK admits one SET of a locked property.
    fn unlock(&mut self, property: Property) -> Result<(), SetError> {
        match property.find_rules().access {
            Access::Locked if !self.lock.take() => Err(SetError::Access(property)),
            Access::Locked | Access::ReadWrite | Access::WriteOnly | Access::ReadOnly => Ok(()),
        }
    }

    /// P means something else in other modes.
    fn in_idle(&self) -> Result<(), SetError> {
        match self.servo.telemetry().mode {
            Mode::Idle => Ok(()),
            mode => Err(SetError::Servo(Refusal::Mode(mode))),
        }
    }

    /// Consumes the mark of the stored position. If the flash fails, the motor must not move, or the next start would trust a
    /// wrong position (decision 0010).
    fn distrust(&mut self) {
        if self.trusted_at.is_none() {
            return;
        }
        match self.store.distrust(self.board.flash()) {
            Ok(()) => self.trusted_at = None,
            Err(error) => {
                self.flash_failed(error);
                self.drive = OFF;
                let _ = self.servo.command(Command::Terminate);
            }
        }
    }

    // --- answers and reports -----------------------------------------------------------------------------------

    /// Sends a value to a node: to the host as a reply, to another board as a SET of VALUE.
    fn answer(&mut self, to: Node, property: Property, value: i64) -> Result<(), SetError> {
        let value =
            if self.has_foreign_units() { host_units::to_host(property, self.kind, value) } else { value };
        // Every readable value fits 32 bits.
        let message =
            Message::answer(self.node, to, property.find_rules(), value).ok_or(SetError::Range(property))?;
        self.push(message, SetError::Busy(property))
    }

    /// A board without a number sends nothing.
    fn push(&mut self, message: Message, full: SetError) -> Result<(), SetError> {
        if self.node == Node::HOST {
            return Ok(());
        }
        self.outbox.push_back(message.frame()).map_err(|_| {
            self.unsent = self.unsent.saturating_add(1);
            full
        })
    }

    /// Sends reports and waiting frames. Must be called when the CAN controller has room again, when [`Self::tick`] returns `true`,
    /// and at least ten times a second.
    pub fn flush(&mut self) {
        self.bus_served = true;
        self.drain_events();
        self.transmit();
    }

    fn transmit(&mut self) {
        for _ in 0..OUTBOX {
            match self.outbox.front() {
                Some(frame) if self.board.transmit(frame) => self.outbox.pop_front(),
                _ => break,
            };
        }
    }

    /// Frames dropped because the outbox was full.
    #[must_use]
    pub const fn unsent(&self) -> u32 {
        self.unsent
    }

    fn drain_events(&mut self) {
        for _ in 0..REPORTS {
            let Some(event) = self.servo.event() else { break };
            self.handle_event(event);
        }
        let mode = self.servo.telemetry().mode;
        if mode != self.recorded_mode {
            self.recorded_mode = mode;
            self.record(BoardEvent::Mode(mode));
        }
    }

    /// A report that finds no room in the outbox counts as unsent.
    fn handle_event(&mut self, event: Event) {
        let flags = self.settings.lflags;
        match event {
            Event::Ended { reason, mode } if flags & REPORT_ENDS != 0 => {
                let _ = self.answer(Node::HOST, Property::MODE, mode_code(mode).into());
                let _ = self.answer(Node::HOST, Property::END, end_code(reason).into());
            }
            Event::Breakaway { position, .. } => {
                self.breakaway_position = position;
                if flags & REPORT_BREAKAWAYS != 0 {
                    let _ = self.answer(Node::HOST, Property::BD, 1);
                }
            }
            Event::Ended { .. } | Event::Fault(_) | Event::Glitch(_) | Event::Homed => {}
        }
        self.record(BoardEvent::Motor(event));
    }

    fn record(&mut self, event: BoardEvent) {
        self.events.push(self.now, event);
    }

    /// The next entry of [`Self::events`] that has not been taken: for logs and simulations.
    pub fn next_event(&mut self) -> Option<Entry> {
        self.events.take_next()
    }

    /// The last [`CAPACITY`](crate::events::CAPACITY) entries, oldest first: for logs and simulations.
    pub fn events(&self) -> impl Iterator<Item = &Entry> {
        self.events.iter()
    }

    // --- housekeeping, flash and reset -------------------------------------------------------------------------

    /// Updates counters and temperature ten times a second. Feeds the watchdog only if the tick, the bus ([`Self::receive`] or
    /// [`Self::flush`]) and the storage ([`Self::store`]) ran since the last call.
    pub fn housekeeping(&mut self, now: Micros) {
        self.commutator.age(now);
        self.update_counters(now);
        self.retain_rise(Start::Interrupted);
        if self.tick_ran && self.bus_served && self.storage_served {
            self.tick_ran = false;
            self.bus_served = false;
            self.storage_served = false;
            self.board.feed_watchdog();
        }
    }

    fn update_counters(&mut self, now: Micros) {
        let us = now.wrapping_since(self.housekeeping_at).0.saturating_add(self.second_us);
        self.housekeeping_at = now;
        self.second_us = us % 1_000_000;
        let board_temp = self.board.analog().board_temp.0;
        let mut counters = self.store.counters();
        counters.upsecs = counters.upsecs.saturating_add(us / 1_000_000);
        counters.odometer = counters.odometer.saturating_add(self.traveled / self.turn());
        // `count` keeps the maximum.
        counters.ptemp = board_temp;
        self.traveled %= self.turn();
        self.store.count(counters);
    }

    /// Without power for long enough to stop coasting, and no motion is ordered.
    fn stands_still(&self) -> bool {
        self.standstill_ms >= STANDSTILL_MS && self.servo.telemetry().mode == Mode::Idle
    }

    /// Performs one flash operation, if one is due. Pages are erased only while the rotor stands still, because hall edges are
    /// lost meanwhile. The bridge stays off: only [`Self::tick`] switches it on.
    pub fn store(&mut self) -> Progress {
        let stands = self.stands_still();
        self.storage_served = true;
        self.step_store(stands)
    }

    fn step_store(&mut self, may_erase: bool) -> Progress {
        self.update_hot_mark();
        if may_erase {
            // No tick runs for the 40 ms of an erase.
            self.board.feed_tick_watchdog();
        }
        let progress = self.store.step(self.board.flash(), may_erase);
        if let Progress::Failed(error) = progress {
            self.flash_failed(error);
        }
        self.update_hot_mark();
        progress
    }

    /// ERROR 8, recorded once until SET STAT 2 clears it.
    fn flash_failed(&mut self, error: FlashError) {
        if !self.storage_error {
            self.storage_error = true;
            self.record(BoardEvent::Flash(error));
        }
    }

    /// Resets into the monitor: switches the bridge off, then stores pending values and counters.
    fn reset(&mut self) {
        let _ = self.servo.command(Command::Terminate);
        self.drive = OFF;
        self.commutator.set(None);
        self.board.bridge(Bridge::Off);
        self.board.brake(false);
        if !self.stands_still() {
            self.distrust();
        }
        self.retain_rise(Start::Reset);
        self.update_counters(self.now);
        // Also the amounts that are not due yet.
        self.store.save_counters();
        // Halls are not followed any more, so pages may be erased while the rotor coasts.
        for _ in 0..LAST_OPERATIONS {
            // Eight page erases take longer than the watchdog's timeout.
            self.board.feed_watchdog();
            if matches!(self.step_store(true), Progress::Done | Progress::Waiting) {
                break;
            }
        }
        // Report the motion that this ended, if LFLAGS asks for it.
        self.drain_events();
        self.transmit();
        self.outbox.clear();
        self.board.reset();
    }

    /// The node on the bus; a new ID counts from the next start.
    #[must_use]
    pub const fn node(&self) -> Node {
        self.node
    }

    /// The value of a property as GET answers it; `None` if it can only be set: for logs and simulations.
    #[must_use]
    pub fn property(&self, property: Property) -> Option<i64> {
        self.read(property)
    }

    /// The servo's telemetry: for logs and simulations.
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

    /// Whether the flash has the hot mark: for simulations.
    #[must_use]
    pub fn is_marked_hot(&self) -> bool {
        self.store.is_hot()
    }

    /// The present drive: for logs and simulations.
    #[must_use]
    pub const fn drive(&self) -> Drive {
        self.drive
    }

    /// Marks the motor's direction as seen to be right: for simulations that begin after a motion.
    pub fn trust_direction(&mut self) {
        self.servo.trust_direction();
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

/// Whether a command starts a motion that ends by itself, or a mode that moves.
const fn starts_motion(command: &Command) -> bool {
    command.moves() && !matches!(command, Command::Torque(_))
}

/// `None` for all.
fn stored_property(by: Property, id: i32) -> Result<Option<Property>, SetError> {
    if id == ALL {
        return Ok(None);
    }
    let property = u8::try_from(id).ok().and_then(Property::of).ok_or(SetError::Range(by))?;
    if property.find_rules().stored == Stored::No {
        Err(SetError::Access(property))
    } else {
        Ok(Some(property))
    }
}
