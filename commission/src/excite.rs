//! The move that shows what a motor is (docs/identify.md), over the bus alone: as a host orders it and reads what the board tells.
//!
//! The board limits torque, current, heat and supply as always. The host keeps the motor within its range (OT to CT), has a deadline for each
//! wait, and ends in idle with the board's properties as they were, whatever happens.

use std::error::Error;
use std::fmt;

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_wire::{Destination, Frame, Message, MotorKind, Node, Property};

use traces::input::BadInput;

/// What carries frames to a board, and the time.
pub trait Link {
    /// Time since some start, µs.
    fn now_us(&self) -> u64;

    /// Sends a frame.
    ///
    /// # Errors
    /// The adapter is lost, and the next step.
    fn send(&mut self, frame: &Frame) -> Result<(), String>;

    /// The next frame with the time of its arrival, µs, or `None` at `until_us`.
    ///
    /// # Errors
    /// The adapter is lost, and the next step.
    fn receive(&mut self, until_us: u64) -> Result<Option<(u64, Frame)>, String>;

    /// Whether the user wants to end.
    fn is_interrupted(&self) -> bool;

    /// Frames received damaged so far.
    fn damaged(&self) -> u64 {
        0
    }

    /// What it has not carried at the first attempt, for the user.
    fn remark(&self) -> Option<String> {
        None
    }
}

/// Why no recording was made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The user ended it.
    Interrupted,
    /// The problem, and the next step.
    Failed(String),
}

impl From<String> for Failure {
    fn from(text: String) -> Self {
        Self::Failed(text)
    }
}

impl From<BadInput> for Failure {
    fn from(bad: BadInput) -> Self {
        Self::Failed(bad.to_string())
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Interrupted => f.write_str("interrupted"),
            Self::Failed(text) => f.write_str(text),
        }
    }
}

impl Error for Failure {}

/// Time limit of an answer, µs: a board that erases a page answers after 41 ms.
const ANSWER_US: u64 = 100_000;

/// Tries of a question.
const TRIES: u32 = 3;

/// Time limits, µs: from STAT 2 to an awake board, of HI, of a move, of a stop.
const WAKE_US: u64 = 2_000_000;
const HOME_US: u64 = 30_000_000;
const MOVE_US: u64 = 10_000_000;
const STOP_US: u64 = 1_000_000;

/// Time in which the last frames leave, µs.
const LEAVE_US: u64 = 20_000;

/// Longest pause before a row, µs: half a count at full speed.
const DITHER_US: u64 = 500;

/// Longest cruise, µs.
const CRUISE_US: u64 = 500_000;

/// HOSTMS during the recording: the board idles so soon after its host has gone, ms.
const HOST_MS: i64 = 300;

/// TSTOP during the recording, ms: the push at the stop lasts 0.5 s.
const TSTOP_MS: i64 = 1000;

/// Full torque: the duty is then at its limit, and known.
const FULL: i64 = 990;

/// The duty limit (decision 0005).
const MOST_DUTY: f64 = 31_680.0 / 32_768.0;

/// Time in which a torque has risen in full, ms: 32 units a ms beyond 480 (decision 0053).
const FULL_AFTER_MS: f64 = 45.0;

/// Time after a new torque from which a rotor without an edge rests, ms: a free one passes an edge 13 ms after T 150.
const REST_AFTER_MS: f64 = 25.0;

/// Torque that brakes, and the deceleration that it gives at least, counts/s²: MKA's 1454/16 less 60 %.
const BRAKE: i64 = 700;
const BRAKE_COUNTS_S2: f64 = 25_000.0;

/// Speeds from which the motor coasts, counts/s, one for each pass in both directions; the torque that accelerates; and the room for it, counts:
/// a heavy motor with little friction needs 80 counts to come to rest from 500, and is braked at the end of the range from 800. Two speeds
/// tell viscous friction from Coulomb's.
const COASTS: [f64; 8] = [500.0, 800.0, 500.0, 800.0, 500.0, 800.0, 500.0, 800.0];
const COAST_TORQUE: i64 = 150;
const COAST_COUNTS: i64 = 140;

/// Rows of a coast of which one reads all: no current flows, so that the halls alone matter, and come three times as often.
const COAST_ROWS: usize = 8;

/// ACCEL of the ramps, 2200 counts/s²: slow enough for the torque to follow from the bus current without the duty. Passes with ramps.
const RAMP_ACCEL: i64 = 48;
const RAMPS: usize = 3;

/// Time constant of the speed, ms.
const SPEED_MS: f64 = 2.8;

/// Margin to the ends of the range, counts.
const MARGIN: i64 = 8;

/// Rows between two readings of temperature and ERROR.
const SLOW_ROWS: usize = 32;

/// Longest period of rows, ms.
const MOST_ROW_MS: f64 = 9.0;

/// A row of the recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Row {
    /// When the hall code was read, ms from the start.
    pub time_ms: f64,
    /// MODE as ordered.
    pub mode: i64,
    /// P; `None` before HI has ended, which gives it another meaning.
    pub position: Option<i64>,
    /// T.
    pub torque: i64,
    /// Duty where the board's law leaves no doubt, percent.
    pub duty_percent: Option<f64>,
    /// VBUS, V.
    pub bus_v: f64,
    /// IMOTOR, A.
    pub bus_a: f64,
    /// HALLS.
    pub halls: i64,
    /// THERM, °C.
    pub thermistor_c: f64,
}

/// What a board told during the move.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// The kind of motor.
    pub motor: MotorKind,
    /// The rows in order of time.
    pub rows: Vec<Row>,
}

/// A recording as CSV: the columns of a trace that a board gives over the bus.
#[must_use]
pub fn csv(recorded: &Recorded) -> String {
    let motor = recorded.motor.first_node();
    let mut text = "time_ms,motor,mode,position_estimated_counts,torque_per_1024,duty_percent,bus_v,bus_a,halls_code,thermistor_c,bridge_on\n".to_owned();
    for row in &recorded.rows {
        let duty = row.duty_percent.map_or_else(String::new, |duty| format!("{duty:.3}"));
        let position = row.position.map_or_else(String::new, |position| position.to_string());
        text.push_str(&format!(
            "{:.3},{motor},{},{},{},{duty},{:.1},{:.3},{},{:.1},{}\n",
            row.time_ms,
            row.mode,
            position,
            row.torque,
            row.bus_v,
            row.bus_a,
            row.halls,
            row.thermistor_c,
            u8::from(row.mode != 0)
        ));
    }
    text
}

/// The host of one board.
struct Host<'a> {
    link: &'a mut dyn Link,
    node: Node,
    start_us: u64,
    rows: Vec<Row>,
    mode: i64,
    ordered: i64,
    thermistor_c: f64,
    /// Properties as they were.
    before: Vec<(Property, i64)>,
    /// OT and CT, in order.
    range: (i64, i64),
    /// Smoothed counts/s.
    speed: f64,
    /// P counts from the stop.
    is_homed: bool,
    kind: MotorKind,
    dither: Pcg64Mcg,
    /// P in the last row.
    position: i64,
    /// When the torque was ordered, ms from the start.
    ordered_ms: f64,
    /// `None` until the board has told its motor.
    scale: Option<Scale>,
}

/// Runs the move on a board and returns what it told.
///
/// # Errors
/// Interrupted, no answer, ERROR, or a motor that does not go where it should; the board is then idle.
pub fn excite(link: &mut dyn Link, node: Node, progress: &mut dyn FnMut(&str)) -> Result<Recorded, Failure> {
    let start_us = link.now_us();
    let mut host = Host {
        link,
        node,
        start_us,
        rows: Vec::new(),
        mode: 0,
        ordered: 0,
        thermistor_c: 25.0,
        before: Vec::new(),
        range: (0, 0),
        speed: 0.0,
        is_homed: false,
        kind: MotorKind::Link,
        dither: Pcg64Mcg::new(0xd17),
        position: 0,
        ordered_ms: 0.0,
        scale: None,
    };
    let done = host.whole(progress);
    // Idle first; then what was changed, also after a failure.
    let mut restored = host.set(Property::MODE, 0);
    for (property, value) in std::mem::take(&mut host.before) {
        restored = restored.and(host.set(property, value));
    }
    // The last frames leave before the adapter closes.
    restored = restored.and(host.pause(LEAVE_US));
    done.and(restored)?;
    Ok(Recorded { motor: host.kind, rows: host.rows })
}

impl Host<'_> {
    fn failed<T>(&self, what: &str, next: &str) -> Result<T, Failure> {
        Err(Failure::Failed(format!("node {}: {what}\n  next: {next}", self.node.number())))
    }

    fn set(&mut self, property: Property, value: i64) -> Result<(), Failure> {
        if let Some(message) = Message::set(Destination::Node(self.node), property, value) {
            self.link.send(&message.frame())?;
        }
        Ok(())
    }

    /// The value of a property and when it arrived.
    fn read(&mut self, property: Property) -> Result<(i64, u64), Failure> {
        for _ in 0..TRIES {
            if self.link.is_interrupted() {
                return Err(Failure::Interrupted);
            }
            self.link.send(&Message::get(Destination::Node(self.node), property).frame())?;
            let until_us = self.link.now_us() + ANSWER_US;
            while let Some((at_us, frame)) = self.link.receive(until_us)? {
                if let Some((from, of, value)) = answer(&frame)
                    && (from, of) == (self.node, property)
                {
                    return Ok((value, at_us));
                }
                if self.link.now_us() >= until_us {
                    break;
                }
            }
        }
        self.failed(
            &format!("no answer about {property:?} after {TRIES} tries"),
            "check the node's number, its power and the CAN cable",
        )
    }

    fn get(&mut self, property: Property) -> Result<i64, Failure> {
        Ok(self.read(property)?.0)
    }

    /// All three as an excitation sets them: one was killed before it could restore them. The board's saved values take their place.
    fn put_back(&mut self) -> Result<(), Failure> {
        let set = [(Property::HOSTMS, HOST_MS), (Property::TSTOP, TSTOP_MS), (Property::MT, FULL)];
        for (property, value) in set {
            if self.get(property)? != value {
                return Ok(());
            }
        }
        for (property, _) in set {
            self.set(Property::LOAD, i64::from(property.id()))?;
            // The board loads before it answers again.
            self.get(property)?;
        }
        Ok(())
    }

    /// Sets a property and verifies it; it is restored at the end.
    fn borrow(&mut self, property: Property, value: i64) -> Result<(), Failure> {
        let old = self.get(property)?;
        self.before.push((property, old));
        self.set(property, value)?;
        if self.get(property)? != value {
            return self.failed(&format!("{property:?} did not become {value}"), "check the board's ERROR");
        }
        Ok(())
    }

    /// Waits until a property has a value.
    fn until(
        &mut self,
        property: Property,
        is_done: &dyn Fn(i64) -> bool,
        for_us: u64,
        what: &str,
    ) -> Result<i64, Failure> {
        let deadline_us = self.link.now_us() + for_us;
        loop {
            let value = self.get(property)?;
            if is_done(value) {
                return Ok(value);
            }
            if self.link.now_us() >= deadline_us {
                return self.failed(
                    &format!("{what} took longer than {} ms; {property:?} is {value}", for_us / 1000),
                    "look ERROR up in docs/properties.md, and check that the joint is free",
                );
            }
            self.pause(5_000)?;
        }
    }

    fn pause(&mut self, us: u64) -> Result<(), Failure> {
        let until_us = self.link.now_us() + us;
        while self.link.now_us() < until_us {
            if self.link.receive(until_us)?.is_none() {
                break;
            }
        }
        Ok(())
    }

    fn check_error(&mut self) -> Result<(), Failure> {
        match self.get(Property::ERROR)? {
            0 => Ok(()),
            error => self.failed(
                &format!("ERROR {error}"),
                "look it up in docs/properties.md, correct its cause, and clear it by SET STAT 2",
            ),
        }
    }

    fn whole(&mut self, progress: &mut dyn FnMut(&str)) -> Result<(), Failure> {
        if self.get(Property::STAT)? != 2 {
            self.set(Property::STAT, 2)?;
            self.pause(WAKE_US / 2)?;
            self.until(Property::STAT, &|stat| stat == 2, WAKE_US, "waking")?;
        }
        self.check_error()?;
        if self.get(Property::WIRING)? == 0 {
            return self.failed("it does not know how its motor is wired", "let it learn that: SET FIND 1");
        }
        self.kind = match self.get(Property::KIND)? {
            2 => MotorKind::Spread,
            3 => MotorKind::Tip,
            _ => MotorKind::Link,
        };
        let [mr, mpk, mte] = [Property::MR, Property::MPK, Property::MTE].map(|of| self.get(of));
        self.scale = Some(Scale::new(mr?, mpk?, mte?));
        let (open, close) = (self.get(Property::OT)?, self.get(Property::CT)?);
        self.range = (open.min(close), open.max(close));
        if self.range.1 - self.range.0 < 100 {
            return self
                .failed("OT and CT are less than 100 counts apart", "set them to the ends of the range");
        }
        self.put_back()?;
        self.borrow(Property::HOSTMS, HOST_MS)?;
        progress("finding the stop");
        let velocity = self.get(Property::IVEL)?;
        self.home()?;
        self.borrow(Property::TSTOP, TSTOP_MS)?;
        self.borrow(Property::MT, FULL)?;
        let direction = if velocity < 0 { -1 } else { 1 };
        progress("pushing at the stop");
        self.push(direction)?;
        progress("running at full duty");
        for _ in 0..3 {
            self.dash(-direction, FULL)?;
            self.dash(direction, FULL)?;
        }
        // The spread's brake would stop it.
        if self.kind != MotorKind::Spread {
            progress("coasting");
            for speed in COASTS {
                self.coasts(-direction, speed)?;
                self.coasts(direction, speed)?;
            }
        }
        progress("cruising");
        for speed in [150, 250, 400, 600] {
            self.cruise(-direction * speed)?;
            self.cruise(direction * speed)?;
        }
        progress("ramping");
        self.borrow(Property::ACCEL, RAMP_ACCEL)?;
        for _ in 0..RAMPS {
            self.ramp(-direction)?;
            self.ramp(direction)?;
        }
        Ok(())
    }

    /// HI, recorded too: it warms the winding.
    fn home(&mut self) -> Result<(), Failure> {
        let deadline_us = self.link.now_us() + HOME_US;
        self.set(Property::CMD, i64::from(tater_wire::Cmd::Hi.number()))?;
        // HI is a motion of mode 4.
        self.mode = 4;
        loop {
            self.row()?;
            if self.rows.len().is_multiple_of(SLOW_ROWS) && self.get(Property::END)? != 0 {
                break;
            }
            if self.link.now_us() > deadline_us {
                return self.failed("HI has not ended", "check IVEL, and that the joint is free");
            }
        }
        self.mode = 0;
        self.check_error()?;
        match self.get(Property::END)? {
            1 => {}
            end => {
                return self.failed(
                    &format!("HI ended with END {end}"),
                    "free the joint, and see END in docs/properties.md",
                );
            }
        }
        self.is_homed = true;
        Ok(())
    }

    fn order(&mut self, mode: i64, property: Property, value: i64) -> Result<(), Failure> {
        if self.mode != mode {
            self.set(Property::MODE, mode)?;
            self.mode = mode;
        }
        if mode == 2 {
            self.ordered = value;
            self.ordered_ms = (self.link.now_us() - self.start_us) as f64 / 1000.0;
        }
        self.set(property, value)
    }

    /// One row of the recording. Rows of one period would meet the edges of a steady rotor in step, always early or always late.
    fn row(&mut self) -> Result<Row, Failure> {
        let coasting =
            self.rows.last().copied().filter(|last| self.mode == 0 && last.mode == 0 && self.is_homed);
        let coasting = coasting.filter(|_| !self.rows.len().is_multiple_of(COAST_ROWS));
        let us = self.dither.random_range(0..if coasting.is_some() { DITHER_US / 4 } else { DITHER_US });
        self.pause(us)?;
        let (halls, at_us) = self.read(Property::HALLS)?;
        let position = self.get(Property::P)?;
        let (bus_v, bus_a, torque) = match coasting {
            Some(last) => (last.bus_v, last.bus_a, last.torque),
            None => self.supply()?,
        };
        if self.rows.len().is_multiple_of(SLOW_ROWS) {
            self.thermistor_c = self.get(Property::THERM)? as f64 / 10.0;
        } else if self.rows.len() % SLOW_ROWS == SLOW_ROWS / 2 {
            self.check_error()?;
        }
        let time_ms = (at_us - self.start_us) as f64 / 1000.0;
        if let Some(last) = self.rows.last() {
            let dt = time_ms - last.time_ms;
            if dt > MOST_ROW_MS {
                return self.failed(
                    &format!("a row took {dt:.1} ms; the recording needs one every {MOST_ROW_MS} ms"),
                    "use a faster adapter, or end other programs on the bus",
                );
            }
            self.speed += (1e3 * (position - self.position) as f64 - self.speed * dt) / (dt + SPEED_MS);
        }
        self.position = position;
        if self.is_homed && (position < self.range.0 - 60 || position > self.range.1 + 60) {
            return self
                .failed(&format!("P is {position}, outside its range"), "check OT and CT, and home again");
        }
        let row = Row {
            time_ms,
            mode: self.mode,
            position: self.is_homed.then_some(position),
            torque,
            duty_percent: self.duty(torque, bus_v, time_ms).map(|duty| 100.0 * duty),
            bus_v,
            bus_a,
            halls,
            thermistor_c: self.thermistor_c,
        };
        self.rows.push(row);
        Ok(row)
    }

    /// VBUS, V; IMOTOR, A; and T.
    fn supply(&mut self) -> Result<(f64, f64, i64), Failure> {
        let bus_v = self.get(Property::VBUS)? as f64 / 10.0;
        // The mean of the tick before: read late in the row, it belongs to the time before the hall code.
        let bus_a = self.get(Property::IMOTOR)? as f64 / 1000.0;
        Ok((bus_v, bus_a, self.get(Property::T)?))
    }

    /// The duty where decision 0005 leaves no doubt: at rest, without EMF, and at its limit, which the torque then falls short of.
    fn duty(&self, torque: i64, bus_v: f64, now_ms: f64) -> Option<f64> {
        if self.mode == 0 {
            return Some(0.0);
        }
        if self.mode != 2 {
            return None;
        }
        let scale = self.scale?;
        let recent = &self.rows[self.rows.len().saturating_sub(30)..];
        let rests = recent.len() == 30 && recent.iter().all(|row| row.halls == recent[0].halls);
        if rests && torque == self.ordered && torque != 0 && now_ms - self.ordered_ms > REST_AFTER_MS {
            return Some(scale.duty(torque as f64, torque as f64, bus_v));
        }
        let sign = self.ordered.signum() as f64;
        let is_limited =
            self.ordered.abs() == FULL && (self.ordered - torque).abs() > 40 && self.speed * sign > 150.0;
        // The supply's guard has then raised the torque in full.
        let is_full = is_limited && now_ms - self.ordered_ms > FULL_AFTER_MS;
        is_full.then(|| scale.duty(sign * (scale.full(bus_v) - 0.5), torque as f64, bus_v))
    }

    fn record_for(&mut self, ms: f64) -> Result<(), Failure> {
        let end_ms = (self.link.now_us() - self.start_us) as f64 / 1000.0 + ms;
        while self.row()?.time_ms < end_ms {}
        Ok(())
    }

    /// From near the stop slowly onto it, then with some torques.
    fn push(&mut self, direction: i64) -> Result<(), Failure> {
        let begin_us = self.link.now_us();
        self.order(4, Property::V, direction * 100)?;
        let mut still = (i64::MAX, 0.0);
        loop {
            let row = self.row()?;
            if self.position != still.0 {
                still = (self.position, row.time_ms);
            } else if row.time_ms - still.1 > 80.0 {
                break;
            }
            if self.link.now_us() - begin_us > MOVE_US {
                return self.failed("it did not reach its stop", "check IVEL and IOFF, and home again");
            }
        }
        for torque in [150, 300, 400, 300, 200, 400] {
            self.order(2, Property::T, direction * torque)?;
            self.record_for(90.0)?;
        }
        self.rest()
    }

    fn rest(&mut self) -> Result<(), Failure> {
        self.order(2, Property::T, 0)?;
        let deadline_us = self.link.now_us() + STOP_US;
        while self.link.now_us() < deadline_us {
            self.row()?;
            if self.speed.abs() < 5.0 {
                return Ok(());
            }
        }
        self.failed("it does not stop", "check that nothing turns the joint")
    }

    /// How far the motor can still go in a direction, counts.
    fn left(&self, direction: i64) -> i64 {
        if direction > 0 {
            self.range.1 - MARGIN - self.position
        } else {
            self.position - self.range.0 - MARGIN
        }
    }

    /// Counts that it takes to stop: what passes in two rows, and the braking.
    fn way(&self) -> f64 {
        let rows = &self.rows[self.rows.len().saturating_sub(20)..];
        let span = rows.first().zip(rows.last()).map_or(10.0, |(first, last)| last.time_ms - first.time_ms);
        let late_s = 1e-3 * (2.0 * span / (rows.len().max(2) - 1) as f64 + 3.0);
        let speed = self.speed.abs() * 1.15;
        speed * late_s + speed * speed / (2.0 * BRAKE_COUNTS_S2)
    }

    /// Accelerates by a torque towards one end of the range, brakes before it, and rests.
    fn dash(&mut self, direction: i64, torque: i64) -> Result<(), Failure> {
        let deadline_us = self.link.now_us() + MOVE_US;
        self.order(2, Property::T, direction * torque)?;
        loop {
            self.row()?;
            if (self.left(direction) as f64) < self.way() {
                break;
            }
            if self.link.now_us() > deadline_us {
                return self.failed("it did not turn", "check that the joint is free, and MT");
            }
        }
        self.brake(direction)
    }

    /// Goes to one end of the range by accelerating and coasting to rest, as often as there is room.
    fn coasts(&mut self, direction: i64, speed: f64) -> Result<(), Failure> {
        while self.left(direction) > COAST_COUNTS {
            let deadline_us = self.link.now_us() + MOVE_US;
            self.order(2, Property::T, direction * COAST_TORQUE)?;
            while self.speed * (direction as f64) < speed && self.left(direction) > COAST_COUNTS / 2 {
                self.row()?;
                if self.link.now_us() > deadline_us {
                    return self.failed("it did not turn", "check that the joint is free, and MT");
                }
            }
            self.set(Property::MODE, 0)?;
            self.mode = 0;
            let deadline_us = self.link.now_us() + STOP_US;
            while self.speed.abs() > 5.0 {
                self.row()?;
                if (self.left(direction) as f64) < self.way() {
                    self.brake(direction)?;
                }
                if self.link.now_us() > deadline_us {
                    return self.failed("it does not stop", "check that nothing turns the joint");
                }
            }
        }
        self.rest()
    }

    fn brake(&mut self, direction: i64) -> Result<(), Failure> {
        let deadline_us = self.link.now_us() + STOP_US;
        self.order(2, Property::T, -direction * BRAKE)?;
        // Friction stops it from here.
        while self.speed * direction as f64 > 120.0 {
            self.row()?;
            if self.link.now_us() > deadline_us {
                return self
                    .failed("it does not brake", "check the supply: it must take what a motor returns");
            }
        }
        self.rest()
    }

    /// Moves to one end of the range with the acceleration of the ramps, up and down.
    fn ramp(&mut self, direction: i64) -> Result<(), Failure> {
        let end = if direction > 0 { self.range.1 - MARGIN } else { self.range.0 + MARGIN };
        let deadline_us = self.link.now_us() + MOVE_US;
        self.set(Property::M, end)?;
        self.mode = 5;
        loop {
            self.row()?;
            if self.rows.len().is_multiple_of(SLOW_ROWS) && self.get(Property::END)? != 0 {
                return Ok(());
            }
            if self.link.now_us() > deadline_us {
                return self.failed("the move has not ended", "check that the joint is free, and MT");
            }
        }
    }

    /// Cruises to one end of the range.
    fn cruise(&mut self, speed: i64) -> Result<(), Failure> {
        let begin_us = self.link.now_us();
        let deadline_us = begin_us + MOVE_US;
        self.order(4, Property::V, speed)?;
        loop {
            self.row()?;
            if (self.left(speed.signum()) as f64) < self.way() || self.link.now_us() > begin_us + CRUISE_US {
                break;
            }
            if self.link.now_us() > deadline_us {
                return self.failed("it did not turn", "check that the joint is free, and MT");
            }
        }
        self.brake(speed.signum())
    }
}

/// What a board's duty depends on, of its motor.
#[derive(Clone, Copy, Debug)]
pub struct Scale {
    /// Volts of a torque unit.
    unit_v: f64,
    /// Ripple of the current, torque units, over |U|·(1 − |duty|).
    ripple: f64,
}

impl Scale {
    /// Of the properties MR, MPK and MTE.
    #[must_use]
    pub const fn new(mr: i64, mpk: i64, mte: i64) -> Self {
        // The board rounds R·MPK, in µV, to 10 mV. Half a period of its PWM is 25 µs.
        let full_v = ((mr * mpk + 5000) / 10_000) as f64 / 100.0;
        let ripple = 25.0 / if mte > 25 { mte as f64 } else { 25.0 };
        Self { unit_v: full_v / 1024.0, ripple }
    }

    /// Torque units at the limit of the duty without EMF, at a bus of `bus_v`.
    fn full(self, bus_v: f64) -> f64 {
        MOST_DUTY * bus_v / self.unit_v
    }

    /// The board's duty for a voltage and a torque, in torque units, at a bus of `bus_v`: with what its dead time takes, within the limit.
    ///
    /// The law is that of `servo-core/src/guard/limits.rs`, which no host imports; `tests/identify.rs` holds both together.
    #[must_use]
    pub fn duty(self, volts: f64, torque: f64, bus_v: f64) -> f64 {
        let bare = volts * self.unit_v / bus_v;
        let ripple = self.ripple * volts.abs() * (1.0 - bare.abs());
        let share = ((torque.abs() - ripple) * 83.0 / 256.0 + 0.5).clamp(0.0, 1.0);
        let dead = share * 0.01 * (1.0 + 1.6 / bus_v);
        // f64's signum of 0 is 1.
        let sign = if torque == 0.0 { 0.0 } else { torque.signum() };
        (bare + dead * sign).clamp(-MOST_DUTY, MOST_DUTY)
    }
}

/// A board's answer; one that is damaged is none, so that the question is repeated.
fn answer(frame: &Frame) -> Option<(Node, Property, i64)> {
    let (from, of, value) = Message::parse(frame)?.answered()?;
    Some((from, of, value?))
}
