//! What a run is judged by: figures of the true rotor, which the servo never sees.
//!
//! A *move* begins with the first driven tick of a motion (after the brake has released) that started from
//! rest, that is from idle or hold; a re-plan does not begin another. Metrics of a move are of the last one.

use servo_core::guard::fault::Fault;
use servo_core::mode::Mode;
use servo_core::{Command, EndReason, Event};

use crate::board::Sample;

#[cfg(test)]
mod tests;

/// How long after the end of a move its final error is taken, ms (manual defaults settle well within).
const SETTLE_MS: u32 = 200;

/// The figures of a run. Positions are of the true rotor, in hall counts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Metrics {
    /// Why the last move ended.
    pub end_reason: Option<EndReason>,
    /// From the move's first driven tick to its end.
    pub end_ms: Option<f64>,
    /// Farthest past E in the direction of travel, 0 if never past it.
    pub overshoot_counts: Option<f64>,
    /// Distance from E 200 ms after the end.
    pub final_error_counts: Option<f64>,
    /// Root mean square distance from the set-point during the move (mode 5).
    pub tracking_rms_counts: Option<f64>,
    /// Largest applied torque, 1/1024 of peak.
    pub peak_torque: f64,
    /// Largest phase current at any tick.
    pub peak_current_a: f64,
    /// Highest winding temperature.
    pub peak_winding_c: f64,
    /// Distance from the held position at the end of the run, if one is held.
    pub hold_error_counts: Option<f64>,
    /// Largest distance from the held position while holding.
    pub peak_hold_error_counts: Option<f64>,
    /// Faults in the order in which they latched.
    pub faults: Vec<Fault>,
    /// Simulated time.
    pub sim_s: f64,
    /// From the last hall count to the end of the move.
    pub end_after_last_count_ms: Option<f64>,
    /// Moves that ended.
    pub ends: u32,
    /// Commands that the servo refused.
    pub refusals: u32,
    /// Hall glitches reported.
    pub glitches: u32,
    /// Whether HI has found zero.
    pub homed: bool,
    /// Mode at the end of the run.
    pub mode: Mode,
    /// Position at the end of the run.
    pub position_counts: f64,
    /// Velocity at the end of the run, counts/s.
    pub velocity_counts_s: f64,
    /// Largest speed of the run, counts/s.
    pub peak_speed_counts_s: f64,
    /// |P as read − true position| at the end of the run: up to half a count plus the halls' placement while
    /// no count has been lost.
    pub count_error_counts: f64,
    /// BP of the last breakaway.
    pub breakaway_counts: Option<f64>,
}

impl Metrics {
    /// `end_ms` of a move that arrived.
    #[must_use]
    pub fn arrival_ms(&self) -> Option<f64> {
        self.end_ms.filter(|_| self.end_reason == Some(EndReason::Arrived))
    }

    /// The worse of two motors' figures, for a scenario that runs several.
    #[must_use]
    pub fn worst(self, other: Self) -> Self {
        let most = |a: Option<f64>, b: Option<f64>| a.zip(b).map_or(a.or(b), |(a, b)| Some(a.max(b)));
        let same = self.end_reason == other.end_reason;
        let mut faults = self.faults;
        faults.extend(other.faults);
        Self {
            end_reason: self.end_reason.filter(|_| same),
            end_ms: most(self.end_ms, other.end_ms),
            overshoot_counts: most(self.overshoot_counts, other.overshoot_counts),
            final_error_counts: most(self.final_error_counts, other.final_error_counts),
            tracking_rms_counts: most(self.tracking_rms_counts, other.tracking_rms_counts),
            peak_torque: self.peak_torque.max(other.peak_torque),
            peak_current_a: self.peak_current_a.max(other.peak_current_a),
            peak_winding_c: self.peak_winding_c.max(other.peak_winding_c),
            hold_error_counts: most(self.hold_error_counts, other.hold_error_counts),
            peak_hold_error_counts: most(self.peak_hold_error_counts, other.peak_hold_error_counts),
            faults,
            sim_s: self.sim_s + other.sim_s,
            end_after_last_count_ms: most(self.end_after_last_count_ms, other.end_after_last_count_ms),
            ends: self.ends + other.ends,
            refusals: self.refusals + other.refusals,
            glitches: self.glitches + other.glitches,
            homed: self.homed && other.homed,
            mode: other.mode,
            position_counts: larger(self.position_counts, other.position_counts),
            velocity_counts_s: larger(self.velocity_counts_s, other.velocity_counts_s),
            peak_speed_counts_s: self.peak_speed_counts_s.max(other.peak_speed_counts_s),
            count_error_counts: self.count_error_counts.max(other.count_error_counts),
            breakaway_counts: most(self.breakaway_counts, other.breakaway_counts),
        }
    }
}

fn larger(a: f64, b: f64) -> f64 {
    if a.abs() >= b.abs() { a } else { b }
}

/// The word for an end.
#[must_use]
pub fn end_word(reason: EndReason) -> &'static str {
    match reason {
        EndReason::Arrived => "arrived",
        EndReason::Stalled => "stalled",
        EndReason::Aborted => "aborted",
        EndReason::Strain => "strain",
        EndReason::Breakaway => "breakaway",
        EndReason::Fault => "fault",
    }
}

/// The word for a fault.
#[must_use]
pub fn fault_word(fault: Fault) -> &'static str {
    match fault {
        Fault::Halls => "halls",
        Fault::OverCurrent => "over-current",
        Fault::OverTemperature => "over-temperature",
        Fault::OverVoltage => "over-voltage",
        Fault::UnderVoltage => "under-voltage",
        Fault::Bridge => "bridge",
    }
}

/// The word for a mode.
#[must_use]
pub fn mode_word(mode: Mode) -> &'static str {
    match mode {
        Mode::Idle => "idle",
        Mode::Torque => "torque",
        Mode::Pid => "pid",
        Mode::Velocity => "velocity",
        Mode::Trapezoidal => "trapezoidal",
    }
}

/// A metric's value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// A finite number.
    Number(f64),
    /// A word.
    Text(String),
    /// The run had none (no move, no end, not held).
    Absent,
}

impl From<f64> for Value {
    fn from(value: f64) -> Self {
        if value.is_finite() { Self::Number(value) } else { Self::Absent }
    }
}

impl From<u32> for Value {
    fn from(value: u32) -> Self {
        Self::Number(f64::from(value))
    }
}

impl From<Option<f64>> for Value {
    fn from(value: Option<f64>) -> Self {
        value.map_or(Self::Absent, Self::from)
    }
}

impl From<&str> for Value {
    fn from(value: &str) -> Self {
        Self::Text(value.to_owned())
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(value) if *value == value.trunc() => write!(f, "{value:.0}"),
            Self::Number(value) => write!(f, "{value:.3}"),
            Self::Text(text) => f.write_str(text),
            Self::Absent => f.write_str("–"),
        }
    }
}

/// One metric by name.
pub struct Metric {
    /// Name as in an expectation; its end is the unit.
    pub name: &'static str,
    /// What it is, for the report.
    pub about: &'static str,
    /// Reads it.
    pub get: fn(&Metrics) -> Value,
    /// Whether the value is a word.
    pub word: bool,
}

impl std::fmt::Debug for Metric {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

macro_rules! metric {
    ($name:ident, $about:literal) => {
        Metric { name: stringify!($name), about: $about, get: |m| m.$name.into(), word: false }
    };
    ($name:ident, $about:literal, number $get:expr) => {
        Metric { name: stringify!($name), about: $about, get: $get, word: false }
    };
    ($name:ident, $about:literal, word $get:expr) => {
        Metric { name: stringify!($name), about: $about, get: $get, word: true }
    };
}

/// Every metric that an expectation can name.
pub const METRICS: [Metric; 24] = [
    metric!(end_reason, "why the last move ended", word | m | m.end_reason.map_or("none", end_word).into()),
    metric!(end_ms, "from the move's first driven tick to its end"),
    metric!(arrival_ms, "the same, of a move that arrived", number | m | m.arrival_ms().into()),
    metric!(overshoot_counts, "true rotor past the end position"),
    metric!(final_error_counts, "distance from the end position 200 ms after the end"),
    metric!(tracking_rms_counts, "RMS distance from the set-point during the move"),
    metric!(peak_torque, "largest applied torque, 1/1024 of peak"),
    metric!(peak_current_a, "largest phase current"),
    metric!(peak_winding_c, "highest winding temperature"),
    metric!(hold_error_counts, "distance from the held position at the end of the run"),
    metric!(peak_hold_error_counts, "largest distance from the held position while holding"),
    metric!(
        faults,
        "faults that latched",
        word | m
            | match m.faults.as_slice() {
                [] => "none".into(),
                faults => Value::Text(faults.iter().map(|f| fault_word(*f)).collect::<Vec<_>>().join(", ")),
            }
    ),
    metric!(end_after_last_count_ms, "from the last hall count to the end of the move"),
    metric!(ends, "moves that ended"),
    metric!(refusals, "commands that were refused"),
    metric!(glitches, "hall glitches reported"),
    metric!(homed, "1 if HI has found zero", number | m | f64::from(u8::from(m.homed)).into()),
    metric!(mode, "mode at the end of the run", word | m | mode_word(m.mode).into()),
    metric!(position_counts, "true position at the end of the run"),
    metric!(velocity_counts_s, "true velocity at the end of the run"),
    metric!(peak_speed_counts_s, "largest true speed"),
    metric!(count_error_counts, "|P as read − true position| at the end of the run"),
    metric!(breakaway_counts, "where the link broke away (BP)"),
    metric!(sim_s, "simulated time"),
];

/// The metric of that name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Metric> {
    const ROWS: &[Metric] = &METRICS;
    ROWS.iter().find(|metric| metric.name == name)
}

/// Where a move is going, in the plant's counts.
#[derive(Clone, Copy, Debug)]
struct Target {
    end: f64,
    /// Direction of travel, +1 or −1.
    direction: f64,
}

/// The present move.
#[derive(Clone, Copy, Debug)]
struct Move {
    since_ms: u32,
    ended_ms: Option<u32>,
    squares: f64,
    ticks: u32,
}

/// Watches a run, a tick at a time.
#[derive(Debug, Default)]
pub struct Meter {
    metrics: Metrics,
    /// Plant's count that the servo calls 0.
    origin: f64,
    /// HI is running; it re-names positions at the stop and at its end.
    homing: bool,
    last_mode: Mode,
    target: Option<Target>,
    present: Option<Move>,
    was_moving: bool,
}

impl Meter {
    /// A command was given in the state `last`; `accepted` if the servo took it.
    pub fn command(&mut self, command: &Command, accepted: bool, last: &Sample, position_after: f64) {
        if !accepted {
            self.metrics.refusals += 1;
            return;
        }
        match command {
            Command::Move(end) | Command::End(end) => {
                let end = f64::from(*end) + self.origin;
                let direction = if end >= last.truth.counts { 1.0 } else { -1.0 };
                self.target = Some(Target { end, direction });
                self.metrics.overshoot_counts = Some(0.0);
                self.metrics.final_error_counts = None;
            }
            Command::TorqueControlled { .. } | Command::Home => {
                self.target = None;
                self.homing = *command == Command::Home;
                self.metrics.overshoot_counts = None;
            }
            Command::Position(_) if last.status.mode != Mode::Pid => {
                self.origin = (last.truth.counts - position_after).round();
            }
            _ => {}
        }
    }

    /// A tick has run.
    pub fn tick(&mut self, sample: &Sample, events: impl Iterator<Item = Event>) {
        let mode = sample.status.mode;
        let moving = sample.driven && matches!(mode, Mode::Torque | Mode::Velocity | Mode::Trapezoidal);
        if moving && !self.was_moving {
            self.present = Some(Move { since_ms: sample.ms, ended_ms: None, squares: 0.0, ticks: 0 });
            self.metrics.end_reason = None;
            self.metrics.end_ms = None;
            self.metrics.final_error_counts = None;
            self.metrics.tracking_rms_counts = None;
        }
        self.was_moving = moving;
        if self.homing && self.last_mode == Mode::Velocity && mode == Mode::Trapezoidal {
            self.follow_zero(sample);
        }
        self.last_mode = mode;
        for event in events {
            self.event(event, sample);
        }
        self.follow_move(sample);
        let m = &mut self.metrics;
        m.peak_torque = m.peak_torque.max(f64::from(sample.status.torque.0).abs());
        for current in sample.truth.phase_a {
            m.peak_current_a = m.peak_current_a.max(current.abs());
        }
        m.peak_winding_c = m.peak_winding_c.max(sample.truth.winding_c);
        m.peak_speed_counts_s = m.peak_speed_counts_s.max(sample.truth.counts_per_s.abs());
        m.hold_error_counts = None;
        if mode == Mode::Pid && sample.driven {
            let held = sample.setpoint_counts() + self.origin;
            let error = (sample.truth.counts - held).abs();
            m.hold_error_counts = Some(error);
            m.peak_hold_error_counts = Some(m.peak_hold_error_counts.unwrap_or(0.0).max(error));
        }
    }

    fn follow_move(&mut self, sample: &Sample) {
        let Some(present) = &mut self.present else { return };
        if present.ended_ms.is_none() && sample.status.mode == Mode::Trapezoidal && sample.driven {
            let error = sample.truth.counts - sample.setpoint_counts() - self.origin;
            present.squares += error * error;
            present.ticks += 1;
            self.metrics.tracking_rms_counts = Some((present.squares / f64::from(present.ticks)).sqrt());
        }
        if let Some(target) = self.target {
            let past = (sample.truth.counts - target.end) * target.direction;
            self.metrics.overshoot_counts = Some(self.metrics.overshoot_counts.unwrap_or(0.0).max(past));
            if present.ended_ms.is_some_and(|ended| sample.ms == ended + SETTLE_MS) {
                self.metrics.final_error_counts = Some((sample.truth.counts - target.end).abs());
            }
        }
    }

    fn event(&mut self, event: Event, sample: &Sample) {
        let m = &mut self.metrics;
        match event {
            Event::Ended { reason, .. } => {
                m.ends += 1;
                m.end_reason = Some(reason);
                if let Some(present) = &mut self.present {
                    present.ended_ms = Some(sample.ms);
                    m.end_ms = Some(f64::from(sample.ms - present.since_ms));
                }
                m.end_after_last_count_ms = Some(f64::from(sample.ms) - sample.last_count_us as f64 / 1000.0);
            }
            Event::Breakaway { position, .. } => {
                m.breakaway_counts = Some(f64::from(position) + self.origin);
            }
            Event::Fault(fault) => m.faults.push(fault),
            Event::Glitch(_) => m.glitches += 1,
            Event::Homed => {
                self.homing = false;
                self.follow_zero(sample);
            }
        }
    }

    /// The servo has put its zero elsewhere, by whole counts: finds where from the true rotor.
    fn follow_zero(&mut self, sample: &Sample) {
        self.origin = (sample.truth.counts - sample.estimated_counts()).round();
    }

    /// The plant's count that the servo calls 0.
    #[must_use]
    pub fn zero_counts(&self) -> f64 {
        self.origin
    }

    /// The figures of the run that ended with `last`.
    #[must_use]
    pub fn finish(self, last: &Sample) -> Metrics {
        Metrics {
            sim_s: f64::from(last.ms) / 1000.0,
            homed: last.status.homed,
            mode: last.status.mode,
            position_counts: last.truth.counts,
            velocity_counts_s: last.truth.counts_per_s,
            count_error_counts: (f64::from(last.status.position.round()) + self.origin - last.truth.counts)
                .abs(),
            ..self.metrics
        }
    }
}
