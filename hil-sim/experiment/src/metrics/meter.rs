//! Observes a run tick by tick and computes its metrics.

use servo_core::mode::Mode;
use servo_core::{Command, EndReason, Event};

use super::Metrics;
use hil_world::node::Sample;

/// A set-point counts as constant after this time, ms: a velocity loop with the manual's gains has followed it by then.
const CONSTANT_MS: u32 = 100;

/// Distance from E that counts as settled, counts.
const SETTLED: f64 = 1.0;

/// A tick, s.
const TICK_S: f64 = 0.001;

/// Delay from a move's end to the measurement of its final error, ms; the manual's defaults settle well within.
const SETTLE_MS: u32 = 200;

/// Goal of a move, in the plant's counts.
#[derive(Clone, Copy, Debug, Default)]
struct Target {
    end: f64,
    /// Direction of travel, +1 or −1.
    direction: f64,
    overshoot: f64,
    /// Where the rotor was when E was given.
    from: f64,
    /// When a re-plan gave E; none: the move began with it.
    since_ms: Option<u32>,
    /// The first ticks at which a tenth and nine tenths of the way were behind the rotor.
    tenths_ms: [Option<u32>; 2],
    /// The last tick farther than [`SETTLED`] from E.
    unsettled_ms: Option<u32>,
    iae: f64,
    itae: f64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Move {
    /// Its first driven tick, if it had one.
    since_ms: Option<u32>,
    end: Option<End>,
    /// For a move to E.
    target: Option<Target>,
    final_error: Option<f64>,
    /// Distances from the set-point.
    lag: Sums,
}

impl Target {
    /// Follows the move from its beginning, and measures peaks and sums in the window.
    fn follow(&mut self, sample: &Sample, driven_ms: Option<u32>, is_measured: bool) {
        let off = sample.truth.counts - self.end;
        if is_measured {
            self.overshoot = self.overshoot.max(off * self.direction);
        }
        let Some(since_ms) = self.begun_ms(driven_ms) else { return };
        if is_measured {
            let seconds = f64::from(sample.ms - since_ms) * TICK_S;
            self.iae += off.abs() * TICK_S;
            self.itae += seconds * off.abs() * TICK_S;
        }
        if off.abs() > SETTLED {
            self.unsettled_ms = Some(sample.ms);
        }
        let way = (self.end - self.from).abs();
        let gone = way - off.abs() * if off * self.direction > 0.0 { -1.0 } else { 1.0 };
        for (place, share) in [0.1, 0.9].into_iter().enumerate() {
            if gone >= share * way {
                self.tenths_ms[place].get_or_insert(sample.ms);
            }
        }
    }

    /// t = 0, if the move has driven.
    fn begun_ms(&self, driven_ms: Option<u32>) -> Option<u32> {
        driven_ms.map(|ms| self.since_ms.map_or(ms, |replanned_ms| replanned_ms.max(ms)))
    }
}

#[derive(Clone, Copy, Debug)]
struct End {
    reason: EndReason,
    ms: u32,
    after_last_count_ms: f64,
    /// Speed a tick before: with its bridge off, a rotor may spring back from a stop at once.
    speed: f64,
}

/// The part of a run that is measured, ms, both ends included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First tick.
    pub from_ms: u32,
    /// Last tick.
    pub to_ms: u32,
}

impl Window {
    /// A whole run.
    pub const ALL: Self = Self { from_ms: 0, to_ms: u32::MAX };

    const fn has(&self, ms: u32) -> bool {
        self.from_ms <= ms && ms <= self.to_ms
    }

    const fn is_over(&self, ms: u32) -> bool {
        ms > self.to_ms
    }
}

/// Sums of a quantity, for its mean and its variance.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    ticks: f64,
    sum: f64,
    squares: f64,
}

impl Sums {
    fn add(&mut self, value: f64) {
        self.ticks += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    /// Sum of the squared distances from the mean.
    fn spread(&self) -> f64 {
        if self.ticks > 0.0 { (self.squares - self.sum * self.sum / self.ticks).max(0.0) } else { 0.0 }
    }

    fn mean(&self) -> Option<f64> {
        (self.ticks > 0.0).then(|| self.sum / self.ticks)
    }

    fn rms(&self) -> Option<f64> {
        (self.ticks > 0.0).then(|| (self.squares / self.ticks).sqrt())
    }
}

/// True velocities while the velocity set-point is constant.
#[derive(Clone, Copy, Debug, Default)]
struct Ripple {
    set_point: f64,
    constant_ms: u32,
    /// Of the present set-point, and of all: their ticks, and the squares from the mean of each.
    present: Sums,
    all: Sums,
    spread: f64,
}

impl Ripple {
    fn tick(&mut self, sample: &Sample, is_measured: bool) {
        let set_point = sample.status.setpoint_velocity.0.to_num::<f64>();
        if set_point != self.set_point || !sample.driven {
            self.spread += std::mem::take(&mut self.present).spread();
            (self.set_point, self.constant_ms) = (set_point, 0);
        }
        self.constant_ms = self.constant_ms.saturating_add(1);
        if is_measured && set_point != 0.0 && self.constant_ms > CONSTANT_MS {
            self.present.add(sample.truth.counts_per_s);
            self.all.add(sample.truth.counts_per_s);
        }
    }

    fn rms(&self) -> Option<f64> {
        let spread = self.spread + self.present.spread();
        (self.all.ticks > 0.0).then(|| (spread / self.all.ticks).sqrt())
    }
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
    window: Window,
    /// The last tick of the window.
    last: Sample,
    /// Speed and torque a tick ago; the torque while driven.
    last_speed: f64,
    last_torque: Option<f64>,
    ripple: Ripple,
    steps: Sums,
    /// Heat in the winding when the window began, J.
    heat_from_j: Option<f64>,
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
            window: Window::ALL,
            last: *start,
            last_speed: 0.0,
            last_torque: None,
            ripple: Ripple::default(),
            steps: Sums::default(),
            heat_from_j: None,
        }
    }

    /// Measures only that part of the run; moves are followed from their beginning.
    #[must_use]
    pub const fn within(mut self, window: Window) -> Self {
        self.window = window;
        self
    }

    /// Records a command given in the state `last`; `accepted` if the servo accepted it. The servo's report
    /// of it (a move cut short) comes before, through [`Self::event`].
    pub fn command(&mut self, command: &Command, accepted: bool, last: &Sample, position_after: f64) {
        // It acts from the next tick on.
        let ms = last.ms.saturating_add(1);
        if self.window.is_over(ms) {
            return;
        }
        if !accepted {
            self.metrics.refusals += u32::from(self.window.has(ms));
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
        Target { end, direction, from: last.truth.counts, ..Target::default() }
    }

    /// Only a new E changes the goal; writing the present E again does nothing, wherever the rotor is.
    fn replan(&mut self, last: &Sample) {
        let target = Target { since_ms: Some(last.ms), ..self.target(last) };
        if let Some(present) = &mut self.last_move
            && present.target.is_none_or(|old| old.end != target.end)
        {
            present.target = Some(target);
        }
    }

    /// Records a tick.
    pub fn tick(&mut self, sample: &Sample, events: impl Iterator<Item = Event>) {
        if self.window.is_over(sample.ms) {
            return;
        }
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
        self.measure(sample);
        self.last_speed = sample.truth.counts_per_s.abs();
        self.last_torque = sample.driven.then(|| f64::from(sample.status.torque.0));
    }

    fn measure(&mut self, sample: &Sample) {
        let is_measured = self.window.has(sample.ms);
        self.ripple.tick(sample, is_measured);
        if !is_measured {
            return;
        }
        self.last = *sample;
        self.heat_from_j.get_or_insert(sample.truth.ledger.copper_j);
        let torque = f64::from(sample.status.torque.0);
        if let (true, Some(before)) = (sample.driven, self.last_torque) {
            self.steps.add(torque - before);
        }
        let m = &mut self.metrics;
        m.peak_torque = m.peak_torque.max(torque.abs());
        m.peak_current_a = m.peak_current_a.max(sample.truth.peak_phase_a);
        m.peak_winding_c = m.peak_winding_c.max(sample.truth.winding_c);
        m.peak_speed_counts_s = m.peak_speed_counts_s.max(sample.truth.counts_per_s.abs());
        m.hold_error_counts = None;
        if sample.status.mode == Mode::Pid && sample.driven {
            let held = sample.setpoint_counts() + self.origin;
            let error = (sample.truth.counts - held).abs();
            m.hold_error_counts = Some(error);
            m.peak_hold_error_counts = Some(m.peak_hold_error_counts.unwrap_or(0.0).max(error));
        }
    }

    fn follow_move(&mut self, sample: &Sample) {
        let is_measured = self.window.has(sample.ms);
        let Some(present) = &mut self.last_move else { return };
        if is_measured && present.end.is_none() && sample.status.mode == Mode::Trapezoidal && sample.driven {
            present.lag.add(sample.truth.counts - sample.setpoint_counts() - self.origin);
        }
        if let Some(target) = &mut present.target {
            target.follow(sample, present.since_ms, is_measured);
            if present.end.is_some_and(|end| sample.ms == end.ms + SETTLE_MS) {
                present.final_error = Some((sample.truth.counts - target.end).abs());
            }
        }
    }

    /// Records an event that the servo reported in the state `sample`.
    pub fn event(&mut self, event: &Event, sample: &Sample) {
        if self.window.is_over(sample.ms) {
            return;
        }
        let is_measured = self.window.has(sample.ms);
        match *event {
            Event::Ended { reason, .. } => self.ended(reason, sample),
            Event::Breakaway { position, .. } => {
                self.metrics.breakaway_counts = Some(f64::from(position) + self.origin);
            }
            Event::Fault(fault) if is_measured => self.metrics.faults.push(fault),
            Event::Glitch(_) if is_measured => self.metrics.glitches += 1,
            Event::Fault(_) | Event::Glitch(_) => {}
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
        self.metrics.ends += u32::from(self.window.has(sample.ms));
        let after_last_count_ms = f64::from(sample.ms) - sample.last_count_us as f64 / 1000.0;
        present.end = Some(End { reason, ms: sample.ms, after_last_count_ms, speed: self.last_speed });
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

    /// The metrics of the run that ended with `last`, or of its window.
    #[must_use]
    pub fn finish(mut self, last: &Sample) -> Metrics {
        if self.window.has(last.ms) {
            self.last = *last;
        }
        let of = self.last_move.unwrap_or_default();
        let last = &self.last;
        let since = |ms: u32| of.since_ms.map(|since_ms| f64::from(ms.saturating_sub(since_ms)));
        let settled = |target: &Target| {
            let is_there = (last.truth.counts - target.end).abs() <= SETTLED;
            let begun_ms = target.begun_ms(of.since_ms)?;
            let settled_ms = target.unsettled_ms.map_or(begun_ms, |ms| ms + 1);
            is_there.then(|| f64::from(settled_ms.saturating_sub(begun_ms)))
        };
        let rise = |target: &Target| match target.tenths_ms {
            [Some(first), Some(last)] => Some(f64::from(last - first)),
            _ => None,
        };
        let integral = |of_target: fn(&Target) -> f64| {
            of.target.as_ref().filter(|_| of.since_ms.is_some()).map(of_target)
        };
        Metrics {
            end_reason: of.end.map(|end| end.reason),
            end_ms: of.end.and_then(|end| since(end.ms)),
            overshoot_counts: of.target.map(|target| target.overshoot),
            final_error_counts: of.final_error,
            tracking_rms_counts: of.lag.rms(),
            settling_ms: of.target.as_ref().and_then(settled),
            rise_ms: of.target.as_ref().and_then(rise),
            iae: integral(|target| target.iae),
            itae: integral(|target| target.itae),
            speed_at_end_counts_s: of.end.map(|end| end.speed),
            ripple_counts_s: self.ripple.rms(),
            mean_velocity_counts_s: self.ripple.all.mean(),
            chatter: self.steps.rms(),
            heat_j: last.truth.ledger.copper_j - self.heat_from_j.unwrap_or(last.truth.ledger.copper_j),
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

/// A meter of the whole run, and one for each window of it.
#[derive(Clone, Debug)]
pub struct Meters {
    whole: Meter,
    windows: Vec<Meter>,
}

impl Meters {
    /// Meters of the run that starts with `start`.
    #[must_use]
    pub fn new(start: &Sample, windows: &[Window]) -> Self {
        let whole = Meter::new(start);
        let windows = windows.iter().map(|&window| whole.clone().within(window)).collect();
        Self { whole, windows }
    }

    fn each(&mut self, act: impl FnMut(&mut Meter)) {
        std::iter::once(&mut self.whole).chain(&mut self.windows).for_each(act);
    }

    /// As [`Meter::command`].
    pub fn command(&mut self, command: &Command, accepted: bool, last: &Sample, position_after: f64) {
        self.each(|meter| meter.command(command, accepted, last, position_after));
    }

    /// As [`Meter::tick`].
    pub fn tick(&mut self, sample: &Sample, events: impl Iterator<Item = Event>) {
        let events: Vec<Event> = events.collect();
        self.each(|meter| meter.tick(sample, events.iter().copied()));
    }

    /// As [`Meter::event`].
    pub fn event(&mut self, event: &Event, sample: &Sample) {
        self.each(|meter| meter.event(event, sample));
    }

    /// As [`Meter::zero_counts`].
    #[must_use]
    pub fn zero_counts(&self) -> f64 {
        self.whole.zero_counts()
    }

    /// The metrics of the run that ended with `last`, and those of its windows.
    #[must_use]
    pub fn finish(self, last: &Sample) -> (Metrics, Vec<(Window, Metrics)>) {
        let windows = self.windows.into_iter().map(|meter| (meter.window, meter.finish(last))).collect();
        (self.whole.finish(last), windows)
    }
}
