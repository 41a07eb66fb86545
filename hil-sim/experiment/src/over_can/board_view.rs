//! One board as its host sees it: requests, answers, and the metrics derived from them.

use std::collections::VecDeque;

use servo_core::mode::Mode;
use servo_core::units::{Counts, CountsPerSec, Duty, Torque};
use servo_core::{Command, EndReason, Event, Telemetry};
use tater_fw::{Analog, codes};
use tater_wire::{Frame, Property};

use super::compare::Path;
use super::requests::{ANSWER_US, answer};
use super::{BoardResult, Job, ObservedBoard, OverCan};
use crate::events::motor_text;
use crate::metrics::Meters;
use crate::run::MotorRun;
use crate::scenario::Order;
use hil_world::node::Sample;

/// Time from a command's SET until its immediate reports have arrived, us: the SET (110), the board (50) and two reports (190).
const DONE_US: u64 = 400;

/// An order is verified by reading `echo` afterwards.
pub(super) enum Ask {
    Get(Property),
    Set(Property, i64),
    Order { order: Order, property: Property, value: i64, echo: (Property, Option<i64>) },
}

struct PendingOrder {
    order: Order,
    before: Sample,
    echo: (Property, Option<i64>),
    /// The answer for the echo's property.
    read: Option<Option<i64>>,
    due_us: u64,
}

/// The board's state as far as its answers show it.
struct KnownState {
    mode: Mode,
    position: i32,
    torque: i16,
    /// The position at the start of a hold.
    held: Option<i32>,
    homed: bool,
    error: i64,
}

pub(super) struct BoardView {
    job: Job,
    begin_us: u64,
    asks: VecDeque<Ask>,
    /// The property requested, and the time limit of its answer.
    waiting: Option<(Property, u64)>,
    pending: Option<PendingOrder>,
    known: KnownState,
    /// Until this time T may be the commanded value, before limits, us.
    torque_due_us: u64,
    homing: bool,
    /// HI has ended, and its new position has not been read.
    zero_due: bool,
    events: Vec<Event>,
    meters: Meters,
    /// The rig's state at the last whole millisecond.
    last: Sample,
    metered: bool,
    log: Vec<(u32, String)>,
    path: Path,
    unanswered: u32,
}

impl BoardView {
    pub(super) fn new(job: Job, station: &impl ObservedBoard, begin_us: u64) -> Self {
        let position = job.rig.truth().counts.round() as i32;
        let known = KnownState { mode: Mode::Idle, position, torque: 0, held: None, homed: false, error: 0 };
        let last = observe(0, begin_us, station, &known);
        Self {
            meters: Meters::new(&last, &job.windows),
            job,
            begin_us,
            asks: VecDeque::new(),
            waiting: None,
            pending: None,
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

    pub(super) const fn mode(&self) -> Mode {
        self.known.mode
    }

    pub(super) const fn holds(&self) -> bool {
        self.job.case.config.hold
    }

    pub(super) fn ask(&mut self, ask: Ask) {
        self.asks.push_back(ask);
    }

    /// Queues reads, unless earlier ones are still queued.
    pub(super) fn poll(&mut self, properties: &[Property]) {
        if self.asks.iter().all(|ask| !matches!(ask, Ask::Get(_))) {
            self.asks.extend(properties.iter().copied().map(Ask::Get));
        }
    }

    /// Sends what is due: one request at a time, so that answers are unambiguous.
    pub(super) fn pump<S: ObservedBoard>(
        &mut self,
        host: &mut OverCan<S>,
        now_us: u64,
    ) -> Result<(), String> {
        loop {
            if self.waiting.is_some_and(|(_, until)| until > now_us) {
                return Ok(());
            }
            if self.waiting.take().is_some() {
                self.unanswered += 1;
                if let Some(pending) = &mut self.pending {
                    pending.read.get_or_insert(None);
                }
            }
            if self.pending.as_ref().is_some_and(|pending| pending.due_us > now_us) {
                return Ok(());
            }
            if let Some(pending) = self.pending.take() {
                self.finish_order(&pending);
            }
            let node = self.job.node;
            match self.asks.pop_front() {
                None => return Ok(()),
                Some(Ask::Set(property, value)) => host.set(node, property, value)?,
                Some(Ask::Get(property)) => self.get(host, property, now_us),
                Some(Ask::Order { order, property, value, echo }) => {
                    let before = refreshed(&self.last, &self.known);
                    let due_us = now_us + DONE_US;
                    self.pending = Some(PendingOrder { order, before, echo, read: None, due_us });
                    // The limits apply from the next tick.
                    self.torque_due_us = now_us + DONE_US + 1000;
                    host.set(node, property, value)?;
                    self.get(host, echo.0, now_us);
                }
            }
        }
    }

    fn get<S: ObservedBoard>(&mut self, host: &mut OverCan<S>, property: Property, now_us: u64) {
        host.send_get(self.job.node, property);
        self.waiting = Some((property, now_us + ANSWER_US));
    }

    pub(super) fn due_us(&self) -> Option<u64> {
        let waits = self.waiting.map(|(_, until)| until);
        waits.or_else(|| self.pending.as_ref().map(|pending| pending.due_us))
    }

    fn finish_order(&mut self, pending: &PendingOrder) {
        let PendingOrder { order, before, echo, read, .. } = pending;
        let read = read.flatten();
        let obeyed = read.is_some() && (echo.1.is_none() || read == echo.1);
        if !obeyed {
            let what = format!("not obeyed: {order:?}; {:?} is {read:?}, expected {:?}", echo.0, echo.1);
            self.log.push((before.ms, what));
        }
        // The motion that the order ended comes before the one it started.
        self.meter_now(*before);
        let command = order.counts_as();
        self.meters.command(&command, obeyed, before, f64::from(self.known.position));
        if obeyed {
            match command {
                Command::Home => (self.homing, self.known.homed) = (true, false),
                Command::Position(counts) if self.known.mode == Mode::Pid => self.known.held = Some(counts),
                Command::End(_) => {}
                _ => self.homing = false,
            }
            self.path.command(&command, self.begin_us + 1000 * u64::from(before.ms));
        }
    }

    pub(super) fn receive(&mut self, frame: &Frame, at_us: u64) {
        let Some((from, property, value)) = answer(frame) else { return };
        if from != self.job.node {
            return;
        }
        self.update(property, value, at_us);
        if self.waiting.is_some_and(|(asked, _)| asked == property) {
            self.waiting = None;
            if let Some(pending) = &mut self.pending {
                pending.read = Some(Some(value));
            }
        }
    }

    fn update(&mut self, property: Property, value: i64, at_us: u64) {
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
            // HI arrives only after it has left the stop; zero is then known.
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
        self.log.push((self.last.ms, motor_text(&event)));
        self.events.push(event);
    }

    fn meter_now(&mut self, sample: Sample) {
        if self.metered {
            for event in std::mem::take(&mut self.events) {
                self.meters.event(&event, &sample);
            }
        } else {
            self.meters.tick(&sample, std::mem::take(&mut self.events).into_iter());
            self.metered = true;
        }
    }

    /// Ends the millisecond that started at `ms`.
    pub(super) fn tick(&mut self, ms: u32, station: &impl ObservedBoard) {
        // Answers after a tick show the state that the tick left.
        self.meter_now(refreshed(&self.last, &self.known));
        self.last = observe(ms + 1, self.begin_us, station, &self.known);
        self.metered = false;
        self.path.follow(station.rig().truth(), station.driven_since_us());
    }

    pub(super) fn close(&mut self, ms: u32) {
        self.last.ms = ms;
        self.meter_now(refreshed(&self.last, &self.known));
    }

    pub(super) fn finish(self) -> BoardResult {
        let (metrics, windows) = self.meters.finish(&refreshed(&self.last, &self.known));
        let (motor, log) = (self.job.case.motor, self.log);
        let run = MotorRun { motor, metrics, windows, trace: None, log, events: Vec::new() };
        let (node, judged) = (self.job.node, self.job.judged);
        BoardResult { node, run, path: self.path, unanswered: self.unanswered, judged }
    }
}

fn observe(ms: u32, begin_us: u64, station: &impl ObservedBoard, known: &KnownState) -> Sample {
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

fn refreshed(sample: &Sample, known: &KnownState) -> Sample {
    let mut sample = *sample;
    let status = &mut sample.status;
    status.mode = known.mode;
    status.position = Counts::from_int(known.position);
    status.setpoint = Counts::from_int(known.held.unwrap_or(known.position));
    status.torque = Torque(known.torque);
    status.homed = known.homed;
    sample
}
