//! Position and velocity of a shaft from its hall edges alone: recordings, and shafts that are turned from outside.
//!
//! Nothing is known of the torque, the marks or the number of poles. The servo has an estimator of its own ([`observer`](servo_core::sense::observer)),
//! which costs a microcontroller a few hundred instructions an edge; this one costs many times that.
//!
//! # Design
//!
//! Four Kalman filters of position x (counts) and velocity v (counts/s) run side by side as an interacting multiple model
//! (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, *Estimation with Applications to Tracking and Navigation*, Wiley 2001). They
//! differ in the acceleration noise q, (counts/s²)²·s, and in the deviation r of marks, counts:
//!
//! | model | q | r |
//! |---|---|---|
//! | steady, marks known | 1.7·10³ | 0.0125 |
//! | changing, marks known | 4·10⁴ | 0.0125 |
//! | steady, marks unknown | 1.7·10³ | 0.2 |
//! | maneuver, marks unknown | 2·10⁶ | 0.2 |
//!
//! All thresholds are thus ratios to a variance that the motion itself sets; there is no gate in milliseconds or counts/s.
//!
//! **Prediction** over t seconds, where f is the factor of the cell by its cogging (see [`marks`]):
//!
//! ```text
//! x = x + f·v·t                              P_xx = P_xx + 2·f·t·P_xv + (f·t)²·P_vv + q·(f·t)²·t/3
//! v = v                                      P_xv = P_xv + f·t·P_vv + q·f·t²/2        P_vv = P_vv + q·t
//! ```
//!
//! **An edge** says x = z, the place of a mark:
//!
//! ```text
//! S = P_xx + r² + (5 µs·v)²      y = z − x      K = [P_xx, P_xv]/S      [x, v] += K·y      P −= K·[P_xx, P_xv]
//! w = w · e^(−y²/2S) / √S        normalized; at least 10^-4
//! ```
//!
//! Before it, the models are mixed: a model stays itself with the probability 0.995. The state is signed, and a reversal is an
//! edge as any other: both velocity and its variance pass through it.
//!
//! **No edge yet** is information too. At a reading, x is normally distributed with the variance s² = P_xx + r² + (5 µs·v)², and
//! known to be between the two marks of its cell. With the mean μ and the probability Z of a normal variable between these:
//!
//! ```text
//! x = x + s·μ          v = v + P_xv/s·μ          weight w·Z
//! ```
//!
//! and the rotor may have stopped in its cell: weight (t/0.5 s)², v = 0, x in the middle. The square leaves a rotor of even
//! speed alone: a weight in proportion to t reads 100 counts/s 0.4 % low. While the next edge is overdue, Z falls, so velocity
//! goes to zero and position to the middle of the cell.
//!
//! **Marks** are learned from averages over laps by [`marks`].
//!
//! # Two readings
//!
//! [`RecordedShaft::at`] is the rotor. [`RecordedShaft::on_even_marks`] is what a ruler of falling marks reads that takes them for
//! even, as a recording's labels do: it knows no more of the rotor, and its ripple must not enter a control loop.
//!
//! # Formats
//!
//! [`Real`] (Q32.32, saturating) throughout; x relative to the boundary last crossed.

use fixed::types::{I16F16, I22F10};
use heapless::Vec;
use marks::{Interval, Pattern, difference, factor};
use real::{HALF, ONE, Real, ZERO, exp_neg, larger, ratio, root, seconds, truncated, whole, within};
use servo_core::sense::hall::HallEdge;
use servo_core::units::{Counts, CountsPerSec, Micros};

pub use tuning::Tuning;

/// A [`Real`] from its decimal text, parsed when it is compiled.
macro_rules! real {
    ($text:literal) => {
        const { fixed::Saturating(fixed::types::I32F32::lit($text)) }
    };
}

pub mod marks;
pub mod real;
#[cfg(test)]
mod tests;
pub mod tuning;

/// Standstill timeout: no edge for this long. A shaft of 2 counts/s has an edge in half of it.
pub const STANDSTILL: Micros = Micros(1_000_000);

/// Laps that are tried, in counts: 1, 2, 3, 5, 6, 10, 15 and 30 pairs of poles.
const LAPS: [u8; 8] = [6, 12, 18, 30, 36, 60, 90, 180];
/// Stamps kept; more than the longest lap and two.
const STAMPS: usize = 256;
/// An interval of this length is no part of a lap, µs.
const LAP_INTERVAL_MAX: u32 = 250_000;
/// Stamps out of order by up to this, µs, are simultaneous: the delay of rising edges reorders them by up to 400 µs.
const REORDERED: u32 = 10_000;
/// Least time between two edges, in seconds.
const INTERVAL_MIN: Real = real!("0.00001");
/// Largest |v|, counts/s, where estimates saturate: fifteen times the hand's motor.
pub const SPEED_MAX: Real = real!("16384");
/// Largest number of counts in a step; farther is as unknown.
const STEP_MAX: i32 = 64;
/// 1/3, for the three other models and the integral of t².
const THIRD: Real = real!("0.3333333333");
/// Weight of each model at first.
const QUARTER: Real = real!("0.25");
/// Variance of the position at the first edge, counts².
const FIRST_VARIANCE: Real = real!("0.001");
/// Farthest reading between two falling marks from the cell below the first, counts.
const RULER: Real = real!("2.5");
/// Least weight of a model, so that it can return.
const WEIGHT_MIN: Real = real!("0.0001");
/// Models of less weight are left out of a reading.
const WEIGHT_READ: Real = real!("0.001");
/// Uncertainty of a stamp, in seconds.
const STAMP: Real = real!("0.000005");
/// Least speed that cogging is related to, counts/s.
const COGGING_SPEED_MIN: Real = real!("20");

/// One Kalman filter, with its weight.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Model {
    /// x from the nominal place of the boundary last crossed.
    position: Real,
    velocity: Real,
    position_variance: Real,
    covariance: Real,
    velocity_variance: Real,
    weight: Real,
}

const NO_MODEL: Model = Model {
    position: ZERO,
    velocity: ZERO,
    position_variance: ZERO,
    covariance: ZERO,
    velocity_variance: ZERO,
    weight: ZERO,
};

impl Model {
    /// The state `time` seconds later, in a cell of the factor `f`.
    fn predict(&self, time: Real, q: Real, f: Real) -> Self {
        let way = f * time;
        let (kick, grown) = (q * time, way * self.velocity_variance);
        Self {
            position: self.position + way * self.velocity,
            position_variance: self.position_variance
                + way * (self.covariance + self.covariance + grown)
                + kick * way * way * THIRD,
            covariance: self.covariance + grown + kick * way * HALF,
            velocity_variance: self.velocity_variance + kick,
            ..*self
        }
    }

    /// Variance of the distance to a mark: S, and s² of a reading.
    fn mark_variance(&self, deviation: Real) -> Real {
        let stamp = STAMP * self.velocity;
        self.position_variance + deviation * deviation + stamp * stamp
    }

    /// The state after an edge at `place`, and y²/2S and S.
    fn update(&self, place: Real, deviation: Real) -> (Self, Real, Real) {
        let variance = self.mark_variance(deviation);
        let residual = place - self.position;
        let (by_position, by_velocity) =
            (ratio(self.position_variance, variance), ratio(self.covariance, variance));
        let after = Self {
            position: self.position + by_position * residual,
            velocity: within(self.velocity + by_velocity * residual, -SPEED_MAX, SPEED_MAX),
            position_variance: larger(self.position_variance - by_position * self.position_variance, ZERO),
            covariance: self.covariance - by_position * self.covariance,
            velocity_variance: larger(self.velocity_variance - by_velocity * self.covariance, ZERO),
            ..*self
        };
        (after, ratio(residual * residual * HALF, variance), variance)
    }

    /// Adds a share of another model's mean.
    fn add_mean(&mut self, share: Real, other: &Self) {
        self.position += share * other.position;
        self.velocity += share * other.velocity;
    }

    /// Adds a share of another model's variance around this mean.
    fn add_variance(&mut self, share: Real, other: &Self) {
        let (x, v) = (other.position - self.position, other.velocity - self.velocity);
        self.position_variance += share * (other.position_variance + x * x);
        self.covariance += share * (other.covariance + x * v);
        self.velocity_variance += share * (other.velocity_variance + v * v);
    }
}

/// State since the last edge; a glitch restores the one before.
#[derive(Clone, Copy, Debug)]
struct Motion {
    models: [Model; 4],
    /// Time of the last edge, less the delay.
    at: Micros,
    /// Its stamp.
    stamp: Micros,
    /// Number of the boundary last crossed, nominally at number − ½ counts.
    boundary: i32,
    /// +1 closing, −1 opening, 0 before the first edge.
    sign: i8,
    rising: bool,
    /// Standing for [`STANDSTILL`]; `at` then stays that far in the past.
    standing: bool,
    /// Number of the boundary and time of the last falling edge.
    fall: Option<(i32, Micros)>,
    /// Stamps of the edges in a row that lead here, in the same direction, each one count.
    row: u32,
    /// Number of the last of them.
    newest: u32,
}

/// Estimates position and velocity of a shaft, and learns what repeats with its laps of up to `N` counts.
#[derive(Clone, Debug)]
pub struct RecordedShaft<const N: usize> {
    count: i32,
    tuning: Tuning,
    motion: Motion,
    /// Before the last edge, restored if that edge was a glitch; then what that edge led to.
    previous: Motion,
    stamps: [Micros; STAMPS],
    patterns: Vec<Pattern<N>, 8>,
    /// Lap of the pattern in use.
    lap: Option<u8>,
    /// Mean square relative difference of intervals: the score of no pattern.
    plain_score: Real,
}

impl<const N: usize> RecordedShaft<N> {
    /// At rest in the middle of cell `count`, with nothing learned.
    #[must_use]
    pub fn new(count: i32) -> Self {
        Self::with_tuning(count, Tuning::DEFAULT)
    }

    /// [`Self::new`], with other constants.
    #[must_use]
    pub fn with_tuning(count: i32, tuning: Tuning) -> Self {
        let motion = Motion {
            models: [NO_MODEL; 4],
            at: Micros(0),
            stamp: Micros(0),
            boundary: count,
            sign: 0,
            rising: false,
            standing: false,
            fall: None,
            row: 0,
            newest: 0,
        };
        let laps = LAPS.into_iter().filter(|lap| N.is_multiple_of(usize::from(*lap)));
        Self {
            count,
            tuning,
            motion,
            previous: motion,
            stamps: [Micros(0); STAMPS],
            patterns: laps.map(|lap| Pattern::new(lap, &tuning)).collect(),
            lap: None,
            plain_score: ZERO,
        }
    }

    /// The learned delay of rising edges.
    #[must_use]
    pub fn delay(&self) -> Micros {
        let us = self.pattern().map_or(ZERO, Pattern::delay) * whole(1_000_000);
        Micros(us.0.to_num::<i32>().unsigned_abs())
    }

    /// The count after the last step.
    #[must_use]
    pub const fn count(&self) -> i32 {
        self.count
    }

    /// Counts of the lap whose pattern is in use, if any repeats.
    #[must_use]
    pub const fn lap(&self) -> Option<u8> {
        self.lap
    }

    /// Time since the last step, at most [`STANDSTILL`]; that before the first one.
    #[must_use]
    pub fn quiet(&self, now: Micros) -> Micros {
        if self.motion.sign == 0 { STANDSTILL } else { Micros(since(self.motion.at, now).min(STANDSTILL.0)) }
    }

    fn pattern(&self) -> Option<&Pattern<N>> {
        self.lap.and_then(|lap| self.patterns.iter().find(|pattern| pattern.lap() == lap))
    }

    /// Place of a mark, relative to its boundary's nominal place.
    fn place(&self, boundary: i32) -> Real {
        self.pattern().map_or(ZERO, |pattern| pattern.place(boundary))
    }

    /// f of the cell above a boundary.
    fn factor(&self, cell: i32) -> Real {
        let speed = larger(self.motion.speed(), COGGING_SPEED_MIN);
        self.pattern().map_or(ONE, |pattern| factor(pattern.cogging(cell), speed))
    }

    /// Processes a step of the count.
    pub fn edge(&mut self, edge: &HallEdge) {
        self.count = edge.count;
        if edge.bounce {
            // The step back restores the state; another bounce forward restores what it undid.
            core::mem::swap(&mut self.motion, &mut self.previous);
            return;
        }
        self.previous = self.motion;
        let before = self.motion;
        let sign = if edge.way.is_closing() { 1 } else { -1 };
        let (boundary, cell) = if sign > 0 {
            (edge.count, edge.count.wrapping_sub(1))
        } else {
            (edge.count.wrapping_add(1), edge.count.wrapping_add(1))
        };
        let late = if edge.rising { self.delay().0 } else { 0 };
        let at = Micros(edge.at.0.wrapping_sub(late));
        let elapsed = since(before.at, at);
        let moved = boundary.wrapping_sub(before.boundary).clamp(-STEP_MAX, STEP_MAX);
        let place = self.place(boundary);
        let known = before.sign != 0 && elapsed < STANDSTILL.0 && moved.abs() < STEP_MAX;
        self.motion.models = if known {
            let factor = self.factor(cell);
            self.after_edge(
                larger(seconds(Micros(elapsed)), INTERVAL_MIN),
                factor,
                place + whole(moved),
                whole(moved),
            )
        } else {
            self.first_models(place, sign)
        };
        let m = &mut self.motion;
        (m.at, m.stamp, m.boundary) = (at, edge.at, boundary);
        (m.sign, m.rising, m.standing) = (sign, edge.rising, false);
        m.fall = if edge.rising { m.fall } else { Some((boundary, at)) };
        let time = since(before.stamp, edge.at);
        let follows = before.sign == sign && before.rising != edge.rising && edge.steps == 1;
        m.row = if follows && known && time < LAP_INTERVAL_MAX { before.row.saturating_add(1) } else { 1 };
        m.newest = before.newest.wrapping_add(1);
        if let Some(stamp) = self.stamps.get_mut(slot(m.newest)) {
            *stamp = edge.at;
        }
        if m.row > 2 {
            self.learn(Interval {
                cell,
                time: larger(seconds(Micros(time)), INTERVAL_MIN),
                rising: edge.rising,
            });
        }
    }

    /// The models at a first edge: somewhere between standing and twice the first speed.
    fn first_models(&self, place: Real, sign: i8) -> [Model; 4] {
        let speed = self.tuning.first_speed;
        let model = Model {
            position: place,
            velocity: speed * HALF * whole(sign.into()),
            position_variance: FIRST_VARIANCE,
            covariance: ZERO,
            velocity_variance: speed * speed,
            weight: QUARTER,
        };
        [model; 4]
    }

    /// The models after an edge at `place`, then relative to a boundary that `moved`.
    fn after_edge(&self, time: Real, factor: Real, place: Real, moved: Real) -> [Model; 4] {
        let noises = self.tuning.accelerations.iter().zip(&self.tuning.deviations);
        let mut updated: Vec<(Model, Real, Real), 4> = Vec::new();
        for (model, (q, deviation)) in self.mixed().iter().zip(noises) {
            // There are four of each.
            let _ = updated.push(model.predict(time, *q, factor).update(place, *deviation));
        }
        let least = updated.iter().map(|(_, far, _)| *far).min().unwrap_or(ZERO);
        for (model, far, variance) in &mut updated {
            model.weight *= ratio(exp_neg(*far - least), root(*variance));
            model.position -= moved;
        }
        let total: Real = updated.iter().fold(ZERO, |sum, (model, ..)| sum + model.weight);
        let mut models = [NO_MODEL; 4];
        for (model, (after, ..)) in models.iter_mut().zip(updated) {
            *model = Model { weight: larger(ratio(after.weight, total), WEIGHT_MIN), ..after };
        }
        let total = models.iter().fold(ZERO, |sum, model| sum + model.weight);
        for model in &mut models {
            model.weight = ratio(model.weight, total);
        }
        models
    }

    /// Each model's state, mixed with those of the models that it may have been before.
    fn mixed(&self) -> [Model; 4] {
        let old = &self.motion.models;
        let leave = (ONE - self.tuning.stay) * THIRD;
        let mut mixed = [NO_MODEL; 4];
        for (i, model) in mixed.iter_mut().enumerate() {
            let share =
                |j: usize, other: &Model| other.weight * if i == j { self.tuning.stay } else { leave };
            model.weight = old.iter().enumerate().fold(ZERO, |sum, (j, other)| sum + share(j, other));
            let weight = model.weight;
            for (j, other) in old.iter().enumerate() {
                model.add_mean(ratio(share(j, other), weight), other);
            }
            for (j, other) in old.iter().enumerate() {
                model.add_variance(ratio(share(j, other), weight), other);
            }
        }
        mixed
    }

    /// Stamp of the edge `back` edges before the newest.
    fn stamp(&self, back: u32) -> Micros {
        self.stamps.get(slot(self.motion.newest.wrapping_sub(back))).copied().unwrap_or_default()
    }

    /// Scores and teaches the patterns; the newest interval follows another.
    fn learn(&mut self, newest: Interval) {
        let (row, sign) = (self.motion.row, i32::from(self.motion.sign));
        let between =
            |shaft: &Self, from: u32, to: u32| seconds(shaft.stamp(to).wrapping_since(shaft.stamp(from)));
        let before = Interval {
            cell: newest.cell.wrapping_sub(sign),
            time: larger(between(self, 2, 1), INTERVAL_MIN),
            rising: !newest.rising,
        };
        let square = difference(newest.time, before.time);
        self.plain_score += (square * square - self.plain_score) / self.tuning.score_memory;
        let mut best = self.plain_score * self.tuning.better;
        self.lap = None;
        for pattern in &mut self.patterns {
            pattern.judge(&before, &newest, self.tuning.score_memory);
            if pattern.score() < best {
                best = pattern.score() * self.tuning.better;
                self.lap = Some(pattern.lap());
            }
        }
        for i in 0..self.patterns.len() {
            let lap = u32::from(self.patterns.get(i).map_or(0, Pattern::lap));
            if row < lap + 2 {
                continue;
            }
            let back = lap / 2;
            let middle = Interval {
                cell: newest.cell.wrapping_sub(sign.saturating_mul(back.cast_signed())),
                time: larger(between(self, back + 1, back), INTERVAL_MIN),
                rising: newest.rising == (back % 2 == 0),
            };
            // Half of the first and of the last interval count.
            let both = between(self, lap, 0) + between(self, lap + 1, 1);
            let mean = both * HALF / whole(lap.cast_signed());
            if let Some(pattern) = self.patterns.get_mut(i) {
                pattern.learn(&middle, larger(mean, INTERVAL_MIN), &self.tuning);
            }
        }
    }

    /// Position and velocity of the rotor at `now`, which is not before the last edge nor before an earlier call. The
    /// position is within the cell of the count. Call it at least once an hour: it records a standstill before the
    /// wrapping clock (71.6 minutes) makes the last edge look recent.
    #[must_use]
    pub fn at(&mut self, now: Micros) -> (Counts, CountsPerSec) {
        let (position, velocity) = self.rotor(now);
        let low = whole(self.low());
        self.reading(self.count, position - low - HALF, HALF, velocity)
    }

    /// A reading `from` counts, at most `far`, from the middle of cell `count`.
    fn reading(&self, count: i32, from: Real, far: Real, velocity: Real) -> (Counts, CountsPerSec) {
        let from = Counts(I22F10::saturating_from_num(within(from, -far, far).0));
        (Counts::from_int(count).wrapping_add(from), CountsPerSec(I16F16::saturating_from_num(velocity.0)))
    }

    /// Lower boundary of the count's cell, from the boundary last crossed.
    fn low(&self) -> i32 {
        if self.motion.sign < 0 { -1 } else { 0 }
    }

    /// Position from the boundary last crossed, and velocity.
    fn rotor(&mut self, now: Micros) -> (Real, Real) {
        let middle = whole(self.low()) + HALF;
        let elapsed = since(self.motion.at, now);
        if self.motion.sign == 0 {
            return (middle, ZERO);
        }
        if elapsed >= STANDSTILL.0 {
            self.motion.at = Micros(now.0.wrapping_sub(STANDSTILL.0));
            (self.motion.standing, self.motion.fall) = (true, None);
        }
        if self.motion.standing { (middle, ZERO) } else { self.running(seconds(Micros(elapsed))) }
    }

    /// [`Self::rotor`], `time` after an edge: the mean of the models and of a rotor that stopped.
    fn running(&self, time: Real) -> (Real, Real) {
        let m = &self.motion;
        let (cell, above) = (self.count, self.count.wrapping_add(1));
        let low = whole(self.low());
        let (low, high) = (low + self.place(cell), low + ONE + self.place(above));
        let factor = self.factor(cell);
        // A rising edge comes late.
        let late = if m.rising { ZERO } else { self.pattern().map_or(ZERO, Pattern::delay) * factor };
        let (mut position, mut velocity, mut weight) = (ZERO, ZERO, ZERO);
        let noises = self.tuning.accelerations.iter().zip(&self.tuning.deviations);
        for (model, (q, deviation)) in m.models.iter().zip(noises) {
            if model.weight < WEIGHT_READ {
                continue;
            }
            let here = model.predict(time, *q, factor);
            let far = root(here.mark_variance(*deviation));
            let overshoot = late * here.velocity;
            let (below, above) = (here.position - low, high - here.position);
            let (below, above) =
                if m.sign > 0 { (below, above + overshoot) } else { (below - overshoot, above) };
            let (probability, mean) = truncated(ratio(below, far), ratio(above, far));
            let share = model.weight * probability;
            weight += share;
            position += share * (here.position + far * mean);
            velocity += share * factor * (here.velocity + ratio(here.covariance, far) * mean);
        }
        let stopped = time / self.tuning.run * (time / self.tuning.run);
        let total = weight + stopped;
        let middle = (low + high) * HALF;
        (ratio(position + stopped * middle, total), ratio(velocity, total))
    }

    /// As [`at`](Self::at), read off a ruler of the falling marks as if these were even: between two of them the speed is taken
    /// for constant, so the reading follows misplaced marks. A recording's labels are made in this way, because open-collector
    /// sensors fall sharply and rise late. Use it to compare with such labels, not to control anything.
    #[must_use]
    pub fn on_even_marks(&mut self, now: Micros) -> (Counts, CountsPerSec) {
        let (position, velocity) = self.rotor(now);
        let plain = position - whole(self.low()) - HALF;
        let m = &self.motion;
        let sign = i32::from(m.sign);
        let back = i32::from(m.rising);
        let Some((fall, at)) = m.fall.filter(|(fall, _)| m.boundary.wrapping_sub(*fall) == back * sign)
        else {
            return self.reading(self.count, plain, HALF, velocity);
        };
        let forward = |x: Real| x * whole(sign);
        let next = fall.wrapping_add(2 * sign);
        let left = whole(2 - back) + forward(self.place(next) - position);
        let speed = forward(velocity);
        if speed < ONE || left < ZERO {
            return self.reading(self.count, plain, HALF, velocity);
        }
        // The cell of the next rising mark cogs otherwise.
        let rest = if m.rising {
            ratio(left, speed)
        } else {
            let rise = fall.wrapping_add(sign);
            let first = within(ONE + forward(self.place(rise) - position), ZERO, left);
            let (here, there) = (self.factor(self.count), self.factor(self.count.wrapping_add(sign)));
            ratio(first, speed) + ratio((left - first) * here, speed * there)
        };
        let passed = seconds(Micros(since(at, now)));
        let whole_time = larger(passed + rest, INTERVAL_MIN);
        let along = ratio(whole(2) * passed, whole_time) * whole(sign);
        let ruler = within(ratio(whole(2), whole_time), ZERO, SPEED_MAX) * whole(sign);
        // From the middle of the cell below the mark.
        self.reading(fall, along - HALF, RULER, ruler)
    }
}

impl Motion {
    /// Mean |v| of the models.
    fn speed(&self) -> Real {
        let mean = self.models.iter().fold(ZERO, |sum, model| sum + model.weight * model.velocity);
        fixed::Saturating(mean.0.saturating_abs())
    }
}

/// Time from one stamp to another, µs; 0 if `later` is up to [`REORDERED`] before `earlier`.
fn since(earlier: Micros, later: Micros) -> u32 {
    let elapsed = later.wrapping_since(earlier).0;
    if elapsed > u32::MAX - REORDERED { 0 } else { elapsed }
}

/// Place of a stamp in the ring.
fn slot(number: u32) -> usize {
    usize::try_from(number).unwrap_or(0) % STAMPS
}
