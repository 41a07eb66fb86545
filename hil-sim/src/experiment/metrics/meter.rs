//! Observes a run tick by tick and computes its metrics.

use servo_core::mode::Mode;
use servo_core::{Command, EndReason, Event};

use super::Metrics;
use crate::world::node::Sample;

/// Delay from a move's end to the measurement of its final error, ms; the manual's defaults settle well within.
const SETTLE_MS: u32 = 200;

/// Goal of a move, in the plant's counts.
#[derive(Clone, Copy, Debug)]
struct Target {
    end: f64,
    /// Direction of travel, +1 or −1.
    direction: f64,
    overshoot: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Move {
    /// Its first driven tick, if it had one.
    since_ms: Option<u32>,
    end: Option<End>,
    /// For a move to E.
    target: Option<Target>,
    final_error: Option<f64>,
    squares: f64,
    ticks: u32,
}

#[derive(Clone, Copy, Debug)]
struct End {
    reason: EndReason,
    ms: u32,
    after_last_count_ms: f64,
}

/// Observes a run, one tick at a time.
#[derive(Clone, Debug)]
pub struct Meter {
    metrics: Metrics,
    /// The plant's count that the servo calls 0.
    origin: f64,
    /// Property E.
    end: i32,
    /// HI is running; it renames positions at the stop and at its end.
    homing: bool,
    last_mode: Mode,
    last_move: Option<Move>,
}

impl Meter {
    /// A meter of the run that starts with `start`.
    #[must_use]
    pub fn new(start: &Sample) -> Self {
        Self {
            metrics: Metrics::default(),
            origin: 0.0,
            // E defaults to the start position.
            end: start.status.position.round(),
            homing: false,
            last_mode: start.status.mode,
            last_move: None,
        }
    }

    /// Records a command given in the state `last`; `accepted` if the servo accepted it. The servo's report
    /// of it (a move cut short) comes before, through [`Self::event`].
    pub fn command(&mut self, command: &Command, accepted: bool, last: &Sample, position_after: f64) {
        if !accepted {
            self.metrics.refusals += 1;
            return;
        }
        let mode = last.status.mode;
        // HI's second half runs in mode 5 too, but not to E.
        let moving_to_end = mode == Mode::Trapezoidal && !self.homing;
        match *command {
            Command::Move(end) | Command::End(end) => {
                self.end = end;
                if moving_to_end {
                    self.replan(last);
                } else if matches!(command, Command::Move(_)) {
                    self.begin(Some(self.target(last)));
                }
            }
            Command::Mode(Mode::Trapezoidal) if mode != Mode::Trapezoidal => {
                self.begin(Some(self.target(last)));
            }
            Command::Mode(to) if to != mode && to != Mode::Idle => self.begin(None),
            Command::TorqueControlled { .. } => self.begin(None),
            Command::Home => {
                self.begin(None);
                self.homing = true;
            }
            Command::Position(_) if mode != Mode::Pid => {
                self.origin = (last.truth.counts - position_after).round();
            }
            _ => {}
        }
    }

    fn begin(&mut self, target: Option<Target>) {
        self.homing = false;
        self.last_move = Some(Move { target, ..Move::default() });
    }

    fn target(&self, last: &Sample) -> Target {
        let end = f64::from(self.end) + self.origin;
        let direction = if end >= last.truth.counts { 1.0 } else { -1.0 };
        Target { end, direction, overshoot: 0.0 }
    }

    /// Only a new E changes the goal; writing the present E again does nothing, wherever the rotor is.
    fn replan(&mut self, last: &Sample) {
        let target = self.target(last);
        if let Some(present) = &mut self.last_move
            && present.target.is_none_or(|old| old.end != target.end)
        {
            present.target = Some(target);
        }
    }

    /// Records a tick.
    pub fn tick(&mut self, sample: &Sample, events: impl Iterator<Item = Event>) {
        let mode = sample.status.mode;
        if let Some(present) = &mut self.last_move
            && present.end.is_none()
            && sample.driven
        {
            present.since_ms.get_or_insert(sample.ms);
        }
        if self.homing && self.last_mode == Mode::Velocity && mode == Mode::Trapezoidal {
            self.follow_zero(sample);
        }
        self.last_mode = mode;
        for event in events {
            self.event(&event, sample);
        }
        self.follow_move(sample);
        let m = &mut self.metrics;
        m.peak_torque = m.peak_torque.max(f64::from(sample.status.torque.0).abs());
        m.peak_current_a = m.peak_current_a.max(sample.truth.peak_phase_a);
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
        let Some(present) = &mut self.last_move else { return };
        if present.end.is_none() && sample.status.mode == Mode::Trapezoidal && sample.driven {
            let error = sample.truth.counts - sample.setpoint_counts() - self.origin;
            present.squares += error * error;
            present.ticks += 1;
        }
        if let Some(target) = &mut present.target {
            let off = sample.truth.counts - target.end;
            target.overshoot = target.overshoot.max(off * target.direction);
            if present.end.is_some_and(|end| sample.ms == end.ms + SETTLE_MS) {
                present.final_error = Some(off.abs());
            }
        }
    }

    /// Records an event that the servo reported in the state `sample`.
    pub fn event(&mut self, event: &Event, sample: &Sample) {
        match *event {
            Event::Ended { reason, .. } => self.ended(reason, sample),
            Event::Breakaway { position, .. } => {
                self.metrics.breakaway_counts = Some(f64::from(position) + self.origin);
            }
            Event::Fault(fault) => self.metrics.faults.push(fault),
            Event::Glitch(_) => self.metrics.glitches += 1,
            Event::Homed => {
                self.homing = false;
                self.follow_zero(sample);
            }
        }
    }

    /// End of the move. If it has ended already, a hold ended, which is no move.
    fn ended(&mut self, reason: EndReason, sample: &Sample) {
        self.homing = false;
        let Some(present) = self.last_move.as_mut().filter(|present| present.end.is_none()) else { return };
        self.metrics.ends += 1;
        let after_last_count_ms = f64::from(sample.ms) - sample.last_count_us as f64 / 1000.0;
        present.end = Some(End { reason, ms: sample.ms, after_last_count_ms });
        // A move can end by itself only after the brake has released, possibly in its first tick, which then
        // no longer drives.
        if !matches!(reason, EndReason::Aborted | EndReason::Fault) {
            present.since_ms.get_or_insert(sample.ms);
        }
    }

    /// The servo has moved its zero by whole counts: find the new zero from the true rotor.
    fn follow_zero(&mut self, sample: &Sample) {
        self.origin = (sample.truth.counts - sample.estimated_counts()).round();
    }

    /// The plant's count that the servo calls 0.
    #[must_use]
    pub fn zero_counts(&self) -> f64 {
        self.origin
    }

    /// The metrics of the run that ended with `last`.
    #[must_use]
    pub fn finish(self, last: &Sample) -> Metrics {
        let of = self.last_move.unwrap_or_default();
        Metrics {
            end_reason: of.end.map(|end| end.reason),
            end_ms: of.end.zip(of.since_ms).map(|(end, since_ms)| f64::from(end.ms.saturating_sub(since_ms))),
            overshoot_counts: of.target.map(|target| target.overshoot),
            final_error_counts: of.final_error,
            tracking_rms_counts: (of.ticks > 0).then(|| (of.squares / f64::from(of.ticks)).sqrt()),
            end_after_last_count_ms: of.end.map(|end| end.after_last_count_ms),
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
