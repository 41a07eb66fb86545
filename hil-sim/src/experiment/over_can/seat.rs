//! One board as its host knows it: what it is asked, what it has said, and the figures that come of both.

use std::collections::VecDeque;

use servo_core::mode::Mode;
use servo_core::units::{Counts, CountsPerSec, Duty, Torque};
use servo_core::{Command, EndReason, Event, Telemetry};
use tater_fw::{Analog, codes};
use tater_wire::{Frame, Property};

use super::compare::Path;
use super::talk::{ANSWER_US, answer};
use super::{Job, OverCan, Ran, Watched};
use crate::experiment::metrics::Meter;
use crate::experiment::run::{MotorRun, event_words};
use crate::world::node::Sample;

/// From a command's SET until all that it has led to at once has been reported, us: the SET (110), the board (50) and two
/// reports (190).
const DONE_US: u64 = 400;

/// What a host wants of a board.
pub(super) enum Ask {
    /// A property's value.
    Get(Property),
    /// A property set.
    Set(Property, i64),
    /// A command, and where a host sees that it is obeyed.
    Command { command: Command, property: Property, value: i64, echo: (Property, Option<i64>) },
}

/// A command that has been sent.
struct Doing {
    command: Command,
    /// What was known before.
    before: Sample,
    echo: (Property, Option<i64>),
    /// What the board says of the echo's property.
    read: Option<Option<i64>>,
    due_us: u64,
}

/// What the board has said.
struct Known {
    mode: Mode,
    position: i32,
    torque: i16,
    /// The position at the beginning of the hold.
    held: Option<i32>,
    homed: bool,
    error: i64,
}

/// A board and its host's knowledge of it.
pub(super) struct Seat {
    job: Job,
    begin_us: u64,
    asks: VecDeque<Ask>,
    /// The property that was asked for, and until when.
    waiting: Option<(Property, u64)>,
    doing: Option<Doing>,
    known: Known,
    /// Until then T may be what was commanded and not yet bounded, us.
    torque_due_us: u64,
    /// HI is under way.
    homing: bool,
    /// HI has ended, and the position that it gave is not known yet.
    zero_due: bool,
    events: Vec<Event>,
    meter: Meter,
    /// The last whole millisecond, with what the rig said then.
    last: Sample,
    /// Whether the meter has had it.
    metered: bool,
    log: Vec<(u32, String)>,
    path: Path,
    unanswered: u32,
}

impl Seat {
    /// A board in idle, at the beginning of a run.
    pub(super) fn new(job: Job, station: &impl Watched, begin_us: u64) -> Self {
        let position = job.rig.truth().counts.round() as i32;
        let known = Known { mode: Mode::Idle, position, torque: 0, held: None, homed: false, error: 0 };
        let last = look(0, begin_us, station, &known);
        Self {
            meter: Meter::new(&last),
            job,
            begin_us,
            asks: VecDeque::new(),
            waiting: None,
            doing: None,
            known,
            torque_due_us: begin_us,
            homing: false,
            zero_due: false,
            events: Vec::new(),
            last,
            metered: true,
            log: Vec::new(),
            path: Path::new(begin_us, station.rig().truth().counts),
            unanswered: 0,
        }
    }

    /// The mode by the last answer.
    pub(super) const fn mode(&self) -> Mode {
        self.known.mode
    }

    /// Whether a move is to end in a hold.
    pub(super) const fn holds(&self) -> bool {
        self.job.case.config.hold
    }

    /// Wants something of the board, after all that is wanted of it already.
    pub(super) fn ask(&mut self, ask: Ask) {
        self.asks.push_back(ask);
    }

    /// Wants values, unless the board is behind already.
    pub(super) fn poll(&mut self, properties: &[Property]) {
        if self.asks.iter().all(|ask| !matches!(ask, Ask::Get(_))) {
            self.asks.extend(properties.iter().copied().map(Ask::Get));
        }
    }

    /// Sends what may go out now: one question at a time, so that answers cannot be mistaken.
    pub(super) fn pump<S: Watched>(&mut self, host: &mut OverCan<S>, now_us: u64) -> Result<(), String> {
        loop {
            if self.waiting.is_some_and(|(_, until)| until > now_us) {
                return Ok(());
            }
            if self.waiting.take().is_some() {
                self.unanswered += 1;
                if let Some(doing) = &mut self.doing {
                    doing.read.get_or_insert(None);
                }
            }
            if self.doing.as_ref().is_some_and(|doing| doing.due_us > now_us) {
                return Ok(());
            }
            if let Some(doing) = self.doing.take() {
                self.did(&doing);
            }
            let node = self.job.node;
            match self.asks.pop_front() {
                None => return Ok(()),
                Some(Ask::Set(property, value)) => host.set(node, property, value)?,
                Some(Ask::Get(property)) => self.get(host, property, now_us),
                Some(Ask::Command { command, property, value, echo }) => {
                    let before = refreshed(&self.last, &self.known);
                    let due_us = now_us + DONE_US;
                    self.doing = Some(Doing { command, before, echo, read: None, due_us });
                    // Limits are known after the next tick.
                    self.torque_due_us = now_us + DONE_US + 1000;
                    host.set(node, property, value)?;
                    self.get(host, echo.0, now_us);
                }
            }
        }
    }

    fn get<S: Watched>(&mut self, host: &mut OverCan<S>, property: Property, now_us: u64) {
        host.send_get(self.job.node, property);
        self.waiting = Some((property, now_us + ANSWER_US));
    }

    /// When [`Self::pump`] may next do something by itself.
    pub(super) fn due_us(&self) -> Option<u64> {
        let waits = self.waiting.map(|(_, until)| until);
        waits.or_else(|| self.doing.as_ref().map(|doing| doing.due_us))
    }

    /// A command has been obeyed, or has not.
    fn did(&mut self, doing: &Doing) {
        let Doing { command, before, echo, read, .. } = doing;
        let read = read.flatten();
        let obeyed = read.is_some() && (echo.1.is_none() || read == echo.1);
        if !obeyed {
            let what = format!("not obeyed: {command:?}; {:?} is {read:?}, expected {:?}", echo.0, echo.1);
            self.log.push((before.ms, what));
        }
        // First what was before it and what it ended, then what it began.
        self.meter_now(*before);
        self.meter.command(command, obeyed, before, f64::from(self.known.position));
        if obeyed {
            match *command {
                Command::Home => (self.homing, self.known.homed) = (true, false),
                Command::Position(counts) if self.known.mode == Mode::Pid => self.known.held = Some(counts),
                Command::End(_) => {}
                _ => self.homing = false,
            }
            self.path.command(command, self.begin_us + 1000 * u64::from(before.ms));
        }
    }

    /// A frame that the host has received.
    pub(super) fn hear(&mut self, frame: &Frame, at_us: u64) {
        let Some((from, property, value)) = answer(frame) else { return };
        if from != self.job.node {
            return;
        }
        self.learn(property, value, at_us);
        if self.waiting.is_some_and(|(asked, _)| asked == property) {
            self.waiting = None;
            if let Some(doing) = &mut self.doing {
                doing.read = Some(Some(value));
            }
        }
    }

    fn learn(&mut self, property: Property, value: i64, at_us: u64) {
        let known = &mut self.known;
        match property {
            Property::MODE => {
                let mode = codes::mode(value).unwrap_or(known.mode);
                if mode != known.mode {
                    known.held = None;
                }
                known.mode = mode;
            }
            Property::P => {
                known.position = value as i32;
                if known.mode == Mode::Pid {
                    known.held.get_or_insert(known.position);
                }
                if std::mem::take(&mut self.zero_due) {
                    self.event(Event::Homed);
                }
            }
            Property::T if at_us > self.torque_due_us => known.torque = value as i16,
            Property::ERROR => {
                let is_new = value != 0 && value != known.error;
                known.error = value;
                if let Some(fault) = codes::fault(value).filter(|_| is_new) {
                    self.event(Event::Fault(fault));
                }
            }
            Property::BD if value == 1 => self.asks.push_front(Ask::Get(Property::BP)),
            Property::BP => self.event(Event::Breakaway { position: value as i32, stop_tip: false }),
            Property::END => self.ended(value, at_us),
            _ => {}
        }
    }

    fn ended(&mut self, value: i64, at_us: u64) {
        let Some(reason) = codes::end_reason(value) else { return };
        if std::mem::take(&mut self.homing) && reason == EndReason::Arrived {
            // Only HI that has left the stop arrives, and then zero is where it is.
            self.known.homed = true;
            self.zero_due = true;
            self.asks.push_front(Ask::Get(Property::P));
        }
        if reason == EndReason::Fault {
            self.asks.push_front(Ask::Get(Property::ERROR));
        }
        self.path.end(at_us);
        self.event(Event::Ended { reason, mode: self.known.mode });
    }

    fn event(&mut self, event: Event) {
        self.log.push((self.last.ms, event_words(&event)));
        self.events.push(event);
    }

    /// Gives the meter the last millisecond, if it has not had it, with what has been reported since.
    fn meter_now(&mut self, sample: Sample) {
        if self.metered {
            for event in std::mem::take(&mut self.events) {
                self.meter.event(&event, &sample);
            }
        } else {
            self.meter.tick(&sample, std::mem::take(&mut self.events).into_iter());
            self.metered = true;
        }
    }

    /// A millisecond is over: the one that began at `ms`.
    pub(super) fn tick(&mut self, ms: u32, station: &impl Watched) {
        // What was polled after a tick is the state that it left.
        self.meter_now(refreshed(&self.last, &self.known));
        self.last = look(ms + 1, self.begin_us, station, &self.known);
        self.metered = false;
        self.path.follow(station.rig().truth(), station.driven_since_us());
    }

    /// The run is over.
    pub(super) fn close(&mut self, ms: u32) {
        self.last.ms = ms;
        self.meter_now(refreshed(&self.last, &self.known));
    }

    /// What came of it.
    pub(super) fn finish(self) -> Ran {
        let mut metrics = self.meter.finish(&refreshed(&self.last, &self.known));
        metrics.tracking_rms_counts = None;
        let run = MotorRun { motor: self.job.case.motor, metrics, trace: None, log: self.log };
        let (node, judged) = (self.job.node, self.job.judged);
        Ran { node, run, path: self.path, unanswered: self.unanswered, judged }
    }
}

/// What the rig says now, and what is known of the servo.
fn look(ms: u32, begin_us: u64, station: &impl Watched, known: &Known) -> Sample {
    let (rig, position) = (station.rig(), Counts::from_int(known.position));
    let status = Telemetry {
        mode: known.mode,
        position,
        velocity: CountsPerSec::ZERO,
        setpoint: position,
        setpoint_velocity: CountsPerSec::ZERO,
        torque: Torque(known.torque),
        duty: Duty::ZERO,
        fault: None,
        limit: None,
        end: None,
        homed: known.homed,
        breakaway: None,
    };
    Sample {
        ms,
        status,
        driven: station.driven_since_us().is_some(),
        brake_released: station.is_brake_released(),
        truth: rig.truth(),
        halls: rig.halls(),
        analog: Analog::default(),
        last_count_us: rig.last_edge_us().saturating_sub(begin_us),
        zero_counts: 0.0,
    }
}

/// A sample with what has been said since.
fn refreshed(sample: &Sample, known: &Known) -> Sample {
    let mut sample = *sample;
    let status = &mut sample.status;
    status.mode = known.mode;
    status.position = Counts::from_int(known.position);
    status.setpoint = Counts::from_int(known.held.unwrap_or(known.position));
    status.torque = Torque(known.torque);
    status.homed = known.homed;
    sample
}
