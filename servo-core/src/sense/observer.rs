//! Position, velocity and load of the rotor between hall edges, from a model of the motor that knows the applied voltage.
//!
//! # Design
//!
//! Eighteen edges a revolution say little about the velocity of a slow rotor, but the voltage is known at each tick and the motor's
//! own EMF damps every error of the velocity within τ = 1/(B·K), 11 ms. So the model runs once a tick, and an edge corrects it. All
//! voltages and torques are in torque units (1024 is 24 V across the driven pair). With x in counts, v in counts/s, u the voltage
//! that drives the current, F the Coulomb friction and T = 1 ms:
//!
//! ```text
//! u = U + λ·(S − U)                             S = U + ε·(S − U), the current that the tick began with, as a voltage
//! a = B·(1+β)·(u + d − F·sgn v − (K+κ)·v)       B: acceleration a torque unit, K: EMF a count/s
//! v = v + a·T/(1 + B·(1+β)·K·T/2)               x = x + (v₋₁ + v)·T/2
//! ```
//!
//! With the electrical time constant τₑ = L/R, ε = e^(−T/τₑ) and λ = (1 − ε)·τₑ/T; of a τₑ up to a third of a tick ε is below 5 % and taken
//! for 0. At v = 0 the rotor sticks while |u + d| is within the static friction. Learned are the load d, which adds to the voltage, the
//! deviation κ of the EMF and the deviation β of the gain.
//!
//! # Correction
//!
//! An edge at the boundary z at a time within the tick gives r = z − x there. A wrong place after an interval t means that velocity
//! and load were wrong in it; with y = t/τ, e = 1 − e^−y, w = y − e and the memory θ = max(e^(−t/tₘ), 0.3), tₘ = 60 ms · min(1, t/20 ms)
//! and at least 8 ms:
//!
//! ```text
//! x = x + (1 − θ³)·r
//! v = v + (1 − θ)²·(1 + θ/(2(1+y)))·(e/w)/τ·r
//! δ = (1 − θ)²·(h + (1 − h)·y/(1+y))·(K/w)/τ·r         h = (1 − θ)/2; |δ| ≤ 250
//! ```
//!
//! θ is 0 at the first edge after a rest, with t = 10 ms. Residuals beyond half a count that keep their sign square θ. What δ says
//! is shared between the three explanations, with n the net torque:
//!
//! ```text
//! q = δ/(40² + (w/4)² + (0.6·n)²)       d = d + 40²·q       κ = κ − w·r·q/16       β = β + 0.36·n·q
//! ```
//!
//! with r = K/0.97, the EMF relative to the hand's motor, and w = r·v, so that a share of the EMF is as likely to be wrong of every motor. κ and
//! β are bounded; what they cannot take at a bound is taken by d.
//!
//! No edge yet is information as well: beyond the next boundary by 0.15 counts x is set back there, with t at most 25 ms and half of
//! the other corrections. Boundaries are learned in steady motion: the six of an electrical revolution, each by 0.15·r; their mean
//! stays 0.
//!
//! # Derivation
//!
//! Between two edges an error obeys x' = v, v' = B·δ − v/τ. A wrong load alone has made, after t, the errors v = B·δ·τ·e and
//! x = B·δ·τ²·w. With B·K = 1/τ, a residual that is all of a load's therefore says v = (e/w)/τ·r and δ = (K/w)/τ·r. The shares before them
//! are how much of r is believed: those of a fading memory of the second degree (Morrison, Introduction to Sequential Smoothing and
//! Prediction, 1969: 1 − θ³, 3/2·(1 − θ)²·(1 + θ) and (1 − θ)³ for x, v and acceleration, all three poles at θ), to which ours are close
//! for small y: 1 − θ³, (1 − θ)²·(2 + θ) and (1 − θ)³. They grow with y, because a motor that damps its velocity shows less of a wrong load. An edge leaves less than
//! 0.95 of every error, and with θ of 0.7 or more at least 0.69, whatever y is; Morrison's would leave 0.99 of it from y = 1 on (`tests/estimator.rs`).
//!
//! d, κ and β are the likeliest that together explain δ = d − κ·v + β·n, if they are independent with standard deviations of 40 units, r/4
//! units a count/s and 0.6: each takes its variance's share.
//!
//! # Trade-offs
//!
//! Gains are looked up for half octaves of t: a Kalman filter's covariances did no better in trials, and diverged with misplaced
//! sensors. A load and a wrong friction are one thing to the model. A torque that repeats with each count (cogging) is invisible.
//!
//! # Formats
//!
//! x is a `Place`, from the center of the cell; v, voltages, torques, shares and deviations are [`Law`]; times are in µs. A product says the
//! format of its result, so that no shift stands alone.

use crate::motor::Motor;
use crate::num::{Law, half_octaves, mul_low_unsigned, saturating_i16, times, times_saturated};
use crate::sense::hall::HallEdge;
use crate::units::{Counts, CountsPerSec, Micros};
use crate::way::Way;
use fixed::FixedI32;
use fixed::types::I22F10;
use fixed::types::extra::{U0, U4, U6, U8, U10, U12, U15, U20, U22, U26, U28, U30, U36};

#[cfg(test)]
mod tests;

/// A way or a place, counts.
type Place = FixedI32<U20>;
/// Change of a velocity in a tick for a torque unit, counts/s.
type Step = FixedI32<U28>;
/// A share of a tick.
type Share = FixedI32<U22>;
/// A whole number: counts/s, torque units.
type Whole = FixedI32<U0>;

/// One count.
const COUNT: Place = Place::from_bits(1 << 20);
/// 1.0 as a share or a deviation, and one torque unit.
const ONE: Law = Law::ONE;
/// The smallest step of a [`Law`].
const DELTA: Law = Law::DELTA;
/// Boundaries of an electrical revolution.
const BOUNDARIES: usize = 6;
/// Tick, µs.
const TICK_US: i32 = 1000;
/// Longest time that is told apart, µs.
const LONGEST_US: i32 = 300_000;
/// Shortest interval of a correction, µs.
const SHORTEST_US: i32 = 2000;
/// How far beyond a boundary the rotor may be before its missing edge counts, 0.15 counts: ±10° electrical of misplacement.
const BEYOND: Place = Place::from_bits(COUNT.to_bits() * 3 / 20);
/// Intervals of a rotor at 9 to 120 counts/s.
const SLOW_US: (i32, i32) = (11_000, 150_000);
/// Time without an edge from which nothing is sure of a velocity, µs.
const STANDING_US: i32 = 50_000;
/// Longest interval of a correction without an edge, µs.
const OVERDUE_US: i32 = 25_000;
/// Friction at rest of the hand's motor, torque units, and a quarter of it: what a missing or unexpected edge adds to the load each tick while
/// the rotor should rest.
const HAND_STICTION: i32 = 63;
const REST_PULL: i32 = 16;
/// The load of a rotor that should rest is searched: each time that the search turns round it takes half of its steps, down to a sixteenth,
/// and twice that again after as many ms one way. Otherwise a joint that friction nearly holds is pushed to and fro for good.
const NARROWEST: u32 = 4;
const WIDENS_MS: u32 = 40;
/// θ never falls below these: 0.3, and 0.2 in a maneuver.
const KEEP_LEAST: Law = Law::from_bits(19_661);
const KEEP_LEAST_MANEUVER: Law = Law::from_bits(13_107);
/// A rotor that has been beyond a boundary for so long, by the model alone, has been held by its friction, ms.
const PINNED_MS: i32 = 6;
/// A residual beyond half a count, again in the same direction within 40 ms, is a maneuver.
const LARGE: Place = HALF;
const MANEUVER_US: i32 = 40_000;
/// Interval of the first edge after a rest, µs.
const FIRST_US: i32 = 10_000;
/// Largest residual of the first edge that corrects the velocity: a longer way took longer than [`FIRST_US`].
const FIRST_RESIDUAL: Place = HALF;
/// Largest residual that corrects the velocity, 2 counts: more is a lost edge.
const MOST_RESIDUAL: Place = Place::from_bits(2 * COUNT.to_bits());
/// Largest residual from which a boundary is learned, 0.4 counts, and the largest offset.
const LEARNED_RESIDUAL: Place = Place::from_bits(COUNT.to_bits() * 2 / 5);
const MOST_OFFSET: i32 = ONE.to_bits() * 2 / 5;
/// A sixth of 0.15, the share of a residual by which a boundary is learned.
const SIXTH: Law = Law::lit("0.025");
/// Torque beyond the static friction that breaks a rotor loose for sure.
const MARGIN: Law = Law::lit("2");
/// Largest δ and largest load, torque units.
const MOST_DELTA: Law = Law::from_bits(250 * ONE.to_bits());
const MOST_LOAD: Law = Law::from_bits(900 * ONE.to_bits());
/// Bounds of κ, 46 % of K: 0.45 of the hand's motor; and of β.
const MOST_EMF_CHANGE: Law = Law::from_bits(29_491);
const GAIN_CHANGE: (Law, Law) = (Law::from_bits(-32_768), Law::from_bits(58_982));
/// Velocity from which a motor that should rest learns its EMF, counts/s: MT limits the torque by it.
const RUNAWAY: i32 = 300;
/// Largest velocity, 16,384 counts/s: fifteen times the no-load speed of the hand's motor.
const SPEED_MAX: Law = Law::from_bits((1 << 30) - 1);
/// Velocity whose EMF, with the most that is learned, is 24,000 torque units of the hand's motor, counts/s: the sum of all voltages fits 32 bits.
const EMF_SPEED: u32 = 16_906;
/// MKE of the hand's motor: see r.
const HAND_EMF: u32 = 3971;
/// Longest electrical time constant of a motor whose current does not outlast a tick, µs.
const SHORT_LAG_US: u32 = 333;
/// Half a tick, s: the way of a mean velocity is that of the sum of two.
const HALF_TICK: FixedI32<U36> = FixedI32::from_bits(34_359_738);
/// A tick, s.
const TICK: FixedI32<U30> = FixedI32::from_bits(1_073_742);
/// Half a count.
const HALF: Place = Place::from_bits(1 << 19);
/// 1/τ of the motor for which the tables below are as long as t: 88.1/s in 2^-4.
const TABLE_RATE: u32 = 1409;

/// e^(−t/tₘ) in 2^-16 for t = 1 ms · 2^(i/2).
const KEEP: [u16; 17] = [
    57_835, 54_917, 51_039, 46_959, 46_959, 46_959, 46_959, 46_959, 46_959, 44_947, 38_446, 30_826, 22_554,
    14_499, 7762, 3208, 919,
];

/// e/w and 1/w in 2^-12 and y/(1+y) in 2^-16, as bits, for y = 0.0885 · 2^(i/2).
const SLOPES: [(i32, i32, i32); 17] = [
    (91_224, 1_077_119, 5328),
    (64_119, 545_063, 7290),
    (44_959, 277_162, 9855),
    (31_419, 141_888, 13_120),
    (21_856, 73_313, 17_134),
    (15_109, 38_363, 21_863),
    (10_359, 20_418, 27_165),
    (7028, 11_111, 32_788),
    (4710, 6219, 38_409),
    (3115, 3601, 43_708),
    (2039, 2166, 48_433),
    (1330, 1355, 52_442),
    (875, 878, 55_701),
    (584, 584, 58_262),
    (397, 397, 60_220),
    (273, 273, 61_685),
    (189, 189, 62_765),
];

/// What the model needs of the motor's description.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Model {
    /// B·T.
    step: Step,
    /// K, F and the static friction in torque units (a count/s).
    emf: Law,
    friction: Law,
    stiction: Law,
    /// λ and ε, and half a tick and τₑ in ticks.
    lag: Law,
    decay: Law,
    ahead: FixedI32<U6>,
    /// 1/τ = B·K in Hz, and relative to the tables' in 2^-16.
    rate: FixedI32<U4>,
    relative_rate: u32,
    /// r.
    relative_emf: Law,
    /// Largest velocity, counts/s, and the time that it takes for 1.3 counts at 2.5 times the no-load speed, µs.
    speed_max: Law,
    least_us: i32,
    rest_pull: Law,
}

impl Model {
    /// Of a motor that fits.
    #[must_use]
    pub fn new(motor: &Motor) -> Self {
        let (gain, emf) = (i32::from(motor.mka), i32::from(motor.mke));
        // 2^28 / 16 / 1000 = 16,777.2; below 2^31 for every gain up to 65,535.
        let step = gain * 16_777 + gain / 5;
        // B in 2^-4 counts/s², K in 2^-12.
        let rate = times::<U4, U12, U4>(FixedI32::from_bits(gain), FixedI32::from_bits(emf));
        let relative_emf = (u32::from(motor.mke) << 16) / HAND_EMF;
        let te = u32::from(motor.mte);
        let decay = decay(te);
        let stiction = i32::from(motor.stiction());
        Self {
            step: Step::from_bits(step),
            emf: Law::from_bits(emf << 4),
            friction: Law::from_bits(i32::from(motor.mfc) << 16),
            stiction: Law::from_bits(stiction << 16),
            lag: bits(mul_low_unsigned((te << 16) / TICK_US.unsigned_abs(), (1 << 16) - decay, 16)),
            decay: bits(decay),
            ahead: bits(32 + te.min(2000) * 64 / 1000),
            rate,
            relative_rate: ((rate.to_bits().unsigned_abs() << 8) / TABLE_RATE) << 8,
            relative_emf: bits(relative_emf),
            speed_max: Law::from_bits(
                (((EMF_SPEED << 16) / relative_emf.max(1)).min(16_384).cast_signed() << 16).saturating_sub(1),
            )
            .min(SPEED_MAX),
            least_us: (528_000 / motor.no_load().max(53)).cast_signed(),
            rest_pull: Law::from_bits(REST_PULL * stiction * ONE.to_bits() / HAND_STICTION),
        }
    }
}

/// A number of a format from its bits.
const fn bits<F>(bits: u32) -> FixedI32<F> {
    FixedI32::from_bits(bits.cast_signed())
}

/// ε in 2^-16 of a τₑ in µs: e^(−x) is ((1 − x/8)/(1 + x/8))^4 within 0.008 for x up to 3.
fn decay(te: u32) -> u32 {
    if te <= SHORT_LAG_US {
        return 0;
    }
    let fourth = ((8 * te - 1000) << 15) / (8 * te + 1000);
    let square = |x: u32| (x * x) >> 15;
    2 * square(square(fourth))
}

/// What the motor has shown beyond its properties, and the rotor's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct State {
    count: i32,
    /// Number of the boundary above the cell within the electrical revolution.
    index: usize,
    /// At the last tick, and at the next one.
    from: Place,
    to: Place,
    velocity: Law,
    load: Law,
    emf_change: Law,
    gain_change: Law,
    /// Sticks at rest.
    stuck: bool,
    /// Time from the last edge, and from when it last stuck, to the last tick: below [`LONGEST_US`].
    quiet_us: i32,
    moving_us: i32,
    /// The last interval between edges.
    interval_us: i32,
    /// Sign of the last residual if that was large, or 0.
    large: i32,
    /// The last edge was the first after a rest.
    fresh: bool,
    search: Search,
    /// Ticks for which the rotor should have been beyond a boundary while it was to rest, with the sign of that direction.
    pinned: i32,
}

/// The search for the load of a rotor that should rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Search {
    /// Which way the load was last changed, or 0.
    sign: i32,
    /// Each step is this power of two smaller.
    narrow: u32,
    /// Ticks one way.
    ms: u32,
}

impl Search {
    const NONE: Self = Self { sign: 0, narrow: 0, ms: 0 };

    /// A step of `most` at first, in the direction of `sign`.
    fn step(&mut self, sign: i32, most: Law) -> Law {
        if self.sign == -sign {
            (self.narrow, self.ms) = ((self.narrow + 1).min(NARROWEST), 0);
        } else if self.ms >= WIDENS_MS {
            (self.narrow, self.ms) = (self.narrow.saturating_sub(1), 0);
        }
        self.ms += 1;
        self.sign = sign;
        (most >> self.narrow) * sign
    }
}

/// What the servo does to the rotor in a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Push {
    /// Bridge off, or a field that does not follow the rotor.
    Off,
    /// This voltage, in torque units.
    Volts {
        /// The voltage.
        volts: i32,
        /// The rotor is to rest where it is, or its torque is commanded: an edge shows a load.
        resting: bool,
    },
}

/// Observes one motor.
#[derive(Clone, Debug)]
pub struct Observer {
    model: Model,
    state: State,
    /// Before the last edge, restored if that was a glitch.
    previous: State,
    /// Time of the last tick.
    at: Micros,
    /// K + κ.
    emf: Law,
    /// Gain of a tick, B(1+β)T/(1 + ½B(1+β)KT), and 1/(B(1+β)T).
    step: Step,
    inertia: Law,
    /// B(1+min(β, 0))T², counts a torque unit.
    sure_gain: FixedI32<U26>,
    /// Voltage of the last tick, and the one that drove the current in it.
    volts: Law,
    mean_volts: Law,
    driven: bool,
    resting: bool,
    /// Change of the velocity in the last tick.
    change: Law,
    /// Offsets of the boundaries, 2^-16 counts.
    offsets: [i16; BOUNDARIES],
    /// Boundaries of the cell, from its center.
    low: Place,
    high: Place,
}

impl Observer {
    /// At rest in the middle of cell `count`, with nothing learned.
    #[must_use]
    pub fn new(model: Model, count: i32) -> Self {
        let state = State {
            count,
            index: index(count),
            from: Place::ZERO,
            to: Place::ZERO,
            velocity: Law::ZERO,
            load: Law::ZERO,
            emf_change: Law::ZERO,
            gain_change: Law::ZERO,
            stuck: true,
            quiet_us: LONGEST_US,
            moving_us: LONGEST_US,
            interval_us: LONGEST_US,
            large: 0,
            fresh: false,
            search: Search::NONE,
            pinned: 0,
        };
        let mut observer = Self {
            model,
            state,
            previous: state,
            at: Micros(0),
            emf: Law::ZERO,
            step: Step::ZERO,
            inertia: Law::ZERO,
            sure_gain: FixedI32::ZERO,
            volts: Law::ZERO,
            mean_volts: Law::ZERO,
            driven: false,
            resting: false,
            change: Law::ZERO,
            offsets: [0; BOUNDARIES],
            low: -HALF,
            high: HALF,
        };
        observer.rescale();
        observer
    }

    /// Takes another description of the motor, and forgets what was learned beyond the old.
    pub fn set_model(&mut self, model: Model) {
        self.model = model;
        for state in [&mut self.state, &mut self.previous] {
            (state.emf_change, state.gain_change) = (Law::ZERO, Law::ZERO);
        }
        self.rescale();
    }

    /// The count after the last edge.
    #[must_use]
    pub const fn count(&self) -> i32 {
        self.state.count
    }

    /// Position at the last tick, within the cell of the count.
    #[must_use]
    pub fn position(&self) -> Counts {
        self.counts(self.state.to.clamp(Place::from_bits(64) - HALF, HALF - Place::from_bits(1024)))
    }

    /// Position at the last tick; a misplaced sensor may say another cell.
    #[must_use]
    pub const fn exact_position(&self) -> Counts {
        self.counts(self.state.to)
    }

    const fn counts(&self, from_center: Place) -> Counts {
        Counts::from_int(self.state.count)
            .wrapping_add(Counts(I22F10::from_bits(from_center.to_bits() >> 10)))
    }

    /// See [`Self::sure_coming_velocity`].
    fn coming_velocity(&self) -> CountsPerSec {
        CountsPerSec(self.state.velocity.saturating_add(times(self.change, self.model.ahead)))
    }

    /// Velocity at the last tick.
    #[must_use]
    pub const fn velocity(&self) -> CountsPerSec {
        CountsPerSec(self.state.velocity)
    }

    /// Velocity that is sure: the rotor has moved by 1.3 counts at most since the last edge; after 50 ms it is taken to stand.
    #[must_use]
    pub fn sure_velocity(&self) -> CountsPerSec {
        self.sure(self.velocity())
    }

    /// Velocity in the middle of the coming tick, if the torque stays, and as much later as the current lags; within the same bound. It is
    /// what the EMF of a tick is.
    #[must_use]
    pub fn sure_coming_velocity(&self) -> CountsPerSec {
        self.sure(self.coming_velocity())
    }

    /// The same as the last interval between edges has shown it: 1.3 counts in it at most. A heavy rotor with little friction runs on longer
    /// than its model, which takes that for a load that drives it, and whose velocity would drive it indeed.
    #[must_use]
    pub fn shown_coming_velocity(&self) -> CountsPerSec {
        self.within(self.coming_velocity(), self.state.quiet_us.max(self.state.interval_us))
    }

    fn sure(&self, velocity: CountsPerSec) -> CountsPerSec {
        self.within(velocity, self.state.quiet_us)
    }

    /// A velocity of 1.3 counts in a time at most, and none of a rotor that stands.
    fn within(&self, velocity: CountsPerSec, us: i32) -> CountsPerSec {
        if self.state.quiet_us > STANDING_US {
            return CountsPerSec::ZERO;
        }
        let most = fastest(us.max(self.model.least_us));
        CountsPerSec(velocity.0.max(-most).min(most))
    }

    /// A motion in this direction has ended: of a load along it, forgets what may have been friction that the motor does not have, F at most.
    /// A resting rotor is held by as much.
    pub fn end_motion(&mut self, way: Way) {
        let friction = self.model.friction;
        let (low, high) = match way {
            Way::Closing => (Law::ZERO, friction),
            Way::Opening => (-friction, Law::ZERO),
        };
        self.state.load -= self.state.load.max(low).min(high);
    }

    /// A rotor leaves a rest: of its load, forgets what may have been friction, F at most. Friction holds the rest of a real one until the rotor
    /// moves and shows it.
    pub fn leave_rest(&mut self) {
        let friction = self.model.friction;
        self.state.load -= self.state.load.max(-friction).min(friction);
    }

    /// Forgets the load.
    pub const fn forget_load(&mut self) {
        self.state.load = Law::ZERO;
    }

    /// d: torque that something else applies to the rotor, torque units, ±900.
    #[must_use]
    pub const fn load(&self) -> Law {
        self.state.load
    }

    /// K + κ: EMF in torque units per count/s.
    #[must_use]
    pub const fn emf(&self) -> Law {
        self.emf
    }

    /// K without what was learned.
    #[must_use]
    pub const fn nominal_emf(&self) -> Law {
        self.model.emf
    }

    /// 1/(B(1+β)): torque units that change the velocity by a count/s in a tick.
    #[must_use]
    pub const fn inertia(&self) -> Law {
        self.inertia
    }

    /// F: Coulomb friction in torque units.
    #[must_use]
    pub const fn friction(&self) -> Law {
        self.model.friction
    }

    /// Torque beyond F that breaks a rotor loose; 0 while it moves.
    #[must_use]
    pub fn kick(&self) -> Law {
        let more = self.model.stiction - self.model.friction + MARGIN;
        if self.state.stuck { more } else { Law::ZERO }
    }

    /// Acceleration that a torque unit gives for sure, in 2^-26 counts a tick².
    #[must_use]
    pub const fn sure_gain(&self) -> i32 {
        self.sure_gain.to_bits()
    }

    /// Time since the last edge, up to 0.3 s.
    #[must_use]
    pub fn quiet(&self) -> Micros {
        Micros(self.state.quiet_us.max(0).unsigned_abs())
    }

    /// Begins a tick at `now`: what was predicted for it has come, unless an edge is missing.
    #[inline]
    pub fn tick(&mut self, now: Micros) {
        self.at = now;
        let m = &mut self.state;
        m.quiet_us = (m.quiet_us + TICK_US).min(LONGEST_US);
        m.moving_us = (m.moving_us + TICK_US).min(LONGEST_US);
        let (low, high) = (self.low - BEYOND, self.high + BEYOND);
        let to = m.to;
        if to > high {
            self.overdue(high - to);
        } else if to < low {
            self.overdue(low - to);
        } else {
            m.pinned = 0;
        }
    }

    #[inline(never)]
    fn overdue(&mut self, over: Place) {
        let before = self.state.velocity;
        let waited = self.state.quiet_us.min(self.state.moving_us).max(0);
        let interval = waited.max(SHORTEST_US);
        let keep = keep(interval).max(KEEP_LEAST);
        self.state.to += over;
        self.correct(over, interval.min(OVERDUE_US), keep, true);
        let m = &mut self.state;
        if turns(before, m.velocity) {
            m.velocity = Law::ZERO;
        }
        let towards = over.to_bits().signum();
        if self.resting {
            let sign = -towards;
            m.pinned = if m.pinned.signum() == sign { (m.pinned + sign).clamp(-99, 99) } else { sign };
            m.load = (m.load + m.search.step(towards, self.model.rest_pull)).clamp(-MOST_LOAD, MOST_LOAD);
        }
        // An obstacle stops a rotor whatever its voltage: it has moved 1.3 counts at most since the last edge. One that began at rest is twice
        // as fast as its mean, and a slow one with misplaced sensors is left to the gains. µs and 2^-16 counts/s in 32 bits.
        let most = fastest(waited.max(self.model.least_us));
        let is_slow = (SLOW_US.0..SLOW_US.1).contains(&waited);
        let most = if is_slow || m.moving_us < m.quiet_us { most << 1_u32 } else { most };
        m.velocity = m.velocity.max(-most).min(most);
    }

    /// Ends a tick: predicts the next one.
    #[inline]
    pub fn predict(&mut self, push: Push) {
        let m = &mut self.state;
        let back: Law = times(self.emf, m.velocity);
        let driven = matches!(push, Push::Volts { .. });
        if driven != self.driven {
            self.driven = driven;
            m.load = Law::ZERO;
        }
        (self.volts, self.mean_volts, self.resting) = match push {
            Push::Off => (back, back, false),
            Push::Volts { volts, resting } => {
                let volts = Law::from_bits(volts << 16);
                let past = self.volts - volts;
                let (kept, mean): (Law, Law) = (times(past, self.model.decay), times(past, self.model.lag));
                (volts + kept, volts + mean, resting)
            }
        };
        if !self.resting {
            m.search = Search::NONE;
        }
        let drive = self.mean_volts + m.load;
        m.from = m.to;
        let sign = if m.velocity == Law::ZERO {
            let holds = if m.stuck { self.model.stiction } else { self.model.friction };
            if drive.abs() <= holds {
                m.stuck = true;
                m.moving_us = 0;
                self.change = Law::ZERO;
                return;
            }
            drive
        } else {
            m.velocity
        };
        m.stuck = false;
        let friction = if sign < Law::ZERO { -self.model.friction } else { self.model.friction };
        // A motor that fits changes its velocity by 4000 counts/s in a tick at most, so the sum fits.
        let change: Law = times(self.step, drive - friction - back);
        self.change = change;
        let most = self.model.speed_max;
        let velocity = (m.velocity + change).max(-most - DELTA).min(most);
        let stops = m.velocity != Law::ZERO && (velocity == Law::ZERO || turns(velocity, m.velocity));
        let velocity = if stops { Law::ZERO } else { velocity };
        let mut moved: Place = times(m.velocity + velocity, HALF_TICK);
        if stops {
            moved = times(moved, stopping_share(m.velocity, change));
            m.stuck = drive.abs() <= self.model.stiction;
        }
        m.to += moved;
        m.velocity = velocity;
    }

    /// Processes a step of the count.
    #[inline(never)]
    pub fn edge(&mut self, edge: &HallEdge) {
        if edge.bounce {
            return self.restore(edge.count);
        }
        self.previous = self.state;
        let sign = edge.way.along(1);
        let shift = COUNT * (sign * i32::from(edge.steps.min(8)));
        self.enter(edge.count);
        let m = &mut self.state;
        m.from -= shift;
        m.to -= shift;
        let place = if sign > 0 { self.low } else { self.high };
        let boundary = if sign > 0 { below(m.index) } else { m.index };
        let into = edge.at.wrapping_since(self.at).0.cast_signed().clamp(-TICK_US, 2 * TICK_US);
        let moved: Place = times(m.to - m.from, of_a_tick(into.clamp(0, TICK_US)));
        let there = m.from + moved;
        let since = (m.quiet_us.min(m.moving_us) + into).max(0);
        // A rotor that torque has broken loose at last came from somewhere in its cell, not from the boundary.
        let loose = m.pinned * sign >= PINNED_MS;
        let residual = if loose { FIRST_RESIDUAL * sign } else { place - there };
        if loose {
            m.velocity = Law::ZERO;
            m.from += place - there - residual;
            m.to += place - there - residual;
        }
        let first = m.velocity == Law::ZERO;
        if m.velocity.to_bits().signum() == -sign {
            m.velocity = Law::ZERO;
        }
        let large = if residual.abs() > LARGE { residual.to_bits().signum() } else { 0 };
        let maneuver = large != 0 && large == m.large && since < MANEUVER_US;
        m.large = large;
        let (interval, keep) = if first {
            (FIRST_US, Law::ZERO)
        } else {
            let interval = since.max(SHORTEST_US);
            let keep = keep(interval);
            let square: Law = times(keep, keep);
            let short = if m.fresh { KEEP_LEAST } else { square.max(KEEP_LEAST_MANEUVER) };
            (interval, if maneuver || m.fresh { short } else { keep.max(KEEP_LEAST) })
        };
        m.fresh = first;
        m.pinned = 0;
        let square: Law = times(keep, keep);
        let cube: Law = times(square, keep);
        let moved: Place = times(residual, ONE - cube);
        let moved = if residual.abs() > COUNT { residual } else { moved };
        m.from += moved;
        m.to += moved;
        let steady = 5 * (since - m.interval_us).abs() < 2 * m.interval_us;
        m.interval_us = since;
        m.quiet_us = -into;
        let most = if first { FIRST_RESIDUAL } else { MOST_RESIDUAL };
        // Beyond an edge a tick the corrections share what one would do.
        let residual_share =
            if since < TICK_US && !first { times(residual, of_a_tick(since)) } else { residual };
        self.correct(residual_share.clamp(-most, most), interval, keep, false);
        let m = &mut self.state;
        if first && self.resting {
            m.load = (m.load + m.search.step(sign, self.model.stiction)).clamp(-MOST_LOAD, MOST_LOAD);
        }
        if m.velocity.to_bits().signum() != sign {
            m.velocity = ONE * sign;
        }
        m.stuck = false;
        if steady && edge.steps == 1 && residual.abs() < LEARNED_RESIDUAL {
            self.learn(boundary, residual);
        }
    }

    /// The last edge was a glitch: back to the state before it.
    fn restore(&mut self, count: i32) {
        let shift = count.wrapping_sub(self.state.count);
        let from = self.state.from - COUNT * shift.clamp(-8, 8);
        self.state = State { from, ..self.previous };
        self.rescale();
        self.enter(count);
    }

    fn enter(&mut self, count: i32) {
        self.state.count = count;
        self.state.index = index(count);
        self.bound();
    }

    fn bound(&mut self) {
        let offset = |at: usize| {
            self.offsets.get(at).map_or(Place::ZERO, |offset| Place::from_bits(i32::from(*offset) << 4))
        };
        self.low = offset(below(self.state.index)) - HALF;
        self.high = offset(self.state.index) + HALF;
    }

    fn learn(&mut self, boundary: usize, residual: Place) {
        // A sixth of 0.15 · r, and six times that, so that the mean stays 0.
        let share: Law = times(residual, SIXTH);
        let share = share.to_bits();
        let change = 6 * share;
        for (at, offset) in self.offsets.iter_mut().enumerate() {
            let old = i32::from(*offset) + share - if at == boundary { change } else { 0 };
            *offset = saturating_i16(old.clamp(-MOST_OFFSET, MOST_OFFSET));
        }
        self.bound();
    }

    /// Corrects velocity, load, EMF and gain by a residual after an interval; `overdue`: by half.
    fn correct(&mut self, residual: Place, interval: i32, keep: Law, overdue: bool) {
        let scaled = mul_low_unsigned(interval.unsigned_abs(), self.model.relative_rate, 16);
        let (rate, pull, slowness) = entry(&SLOPES, half_octaves(scaled));
        let (pull, slowness) = (FixedI32::<U12>::from_bits(pull), Law::from_bits(slowness));
        let gone = ONE - keep;
        let weight: Law = times(gone, gone);
        let weight = weight >> u32::from(overdue);
        let more = ONE + (share(keep, ONE - slowness) >> 1_u32);
        let half = gone >> 1_u32;
        let lean = half + share(ONE - half, slowness);
        let m = &mut self.state;
        let faster: Law = times(residual, share(weight, more));
        // Rates in 2^-12 and 2^-4, below 2^17 and 2^13.
        let per_second = FixedI32::<U8>::from_bits((rate * self.model.rate.to_bits()) >> 8);
        let change: Law = times_saturated(faster, per_second);
        let friction = match m.velocity.to_bits() {
            0 => Law::ZERO,
            ..0 => -self.model.friction,
            _ => self.model.friction,
        };
        let back: Law = times(self.emf, m.velocity);
        let net = self.mean_volts + m.load - back - friction;
        let stronger: Law = times(residual, share(weight, lean));
        let pull: FixedI32<U4> = times(pull, self.model.rate);
        let slope: FixedI32<U4> = times(pull, self.model.emf);
        let delta: Law = times_saturated(stronger, slope);
        let delta = delta.clamp(-MOST_DELTA, MOST_DELTA);
        let speed = (m.velocity.to_bits() >> 16).clamp(-4096, 4095);
        // r is below 17.
        let relative: Whole = times(Whole::from_bits(speed), self.model.relative_emf);
        let relative = relative.to_bits().clamp(-(1 << 14), (1 << 14) - 1);
        let net = (net.to_bits() >> 16).clamp(-900, 900);
        let most = self.model.speed_max;
        m.velocity = m.velocity.saturating_add(change).max(-most - DELTA).min(most);
        // A motor at rest shows no more than a load, unless that is running away with it.
        let (by_speed, by_torque) = if self.resting && speed.abs() < RUNAWAY {
            (0, 0)
        } else {
            ((relative * relative) >> 4, (net * net * 23) >> 6)
        };
        let sum = by_speed + by_torque + 1600;
        // |δ| < 2^24 in 2^-16, so q has 22 bits of fraction.
        let q = FixedI32::<U22>::from_bits((delta.to_bits() << 6) / sum);
        let mut load: Law = times_saturated(q, Whole::from_bits(1600));
        if by_speed * 50 > sum || by_torque * 50 > sum {
            let relative: Whole = times(Whole::from_bits(relative), self.model.relative_emf);
            // A sixteenth of one product, 1/64 of the other, which has 23 for 0.36.
            let emf: FixedI32<U12> = times_saturated(q, relative);
            let gain: FixedI32<U10> = times_saturated(q, Whole::from_bits(net * 23));
            let emf = m.emf_change - Law::from_bits(emf.to_bits());
            let gain = m.gain_change + Law::from_bits(gain.to_bits());
            let most: Law = times(MOST_EMF_CHANGE, self.model.relative_emf);
            m.emf_change = emf.max(-most).min(most);
            m.gain_change = gain.clamp(GAIN_CHANGE.0, GAIN_CHANGE.1);
            // Each at most δ.
            load += (m.emf_change - emf) * speed + (gain - m.gain_change) * net;
            self.rescale();
        }
        let m = &mut self.state;
        m.load = (m.load + load).clamp(-MOST_LOAD, MOST_LOAD);
    }

    /// Gains that follow from κ and β.
    fn rescale(&mut self) {
        self.emf = self.model.emf + self.state.emf_change;
        // The step is below 2^27, 1 + β between 0.5 and 1.9.
        let gain: Step = times(self.model.step, ONE + self.state.gain_change);
        // x = B(1+β)KT/2; 1/(1 + x) = 1 − x + x² within 0.1 % for x up to 0.1: a motor with τ above 5 ms.
        let twice: FixedI32<U15> = times(gain, self.model.emf);
        let x = Law::from_bits(twice.to_bits());
        let share = if x <= Law::from_bits(ONE.to_bits() / 10) {
            let square: Law = times(x, x);
            ONE - x + square
        } else {
            Law::from_bits(2 * ((1 << 31) / (ONE + x).to_bits().unsigned_abs()).cast_signed())
        };
        self.step = times(gain, share);
        let sure: Step = times(self.model.step, ONE + self.state.gain_change.min(Law::ZERO));
        self.sure_gain = times(sure, TICK);
        // 2^44 / 2^28.
        let inertia = (1_u32 << 31) / (gain.to_bits().cast_unsigned() >> 13).max(1);
        self.inertia = bits(inertia.min(u32::from(u16::MAX) << 10));
    }
}

/// A share of a share; neither is negative.
const fn share(a: Law, b: Law) -> Law {
    bits(mul_low_unsigned(a.to_bits().cast_unsigned(), b.to_bits().cast_unsigned(), 16))
}

/// A time of up to a tick, µs, as a share of it: 4194 in 2^22 are a µs.
const fn of_a_tick(us: i32) -> Share {
    Share::from_bits(us * 4194)
}

/// Whether two velocities have different signs.
const fn turns(a: Law, b: Law) -> bool {
    (a.to_bits() ^ b.to_bits()) < 0
}

/// Number of a count's upper boundary within the electrical revolution.
fn index(count: i32) -> usize {
    usize::try_from(count.rem_euclid(6)).unwrap_or(0)
}

/// The share v/change of a tick after which a rotor stops in it.
#[inline(never)]
fn stopping_share(velocity: Law, change: Law) -> FixedI32<U8> {
    let (velocity, change) = (velocity.to_bits().unsigned_abs(), change.to_bits().unsigned_abs());
    bits((((velocity >> 8) << 8) / (change >> 8).max(1)).min(256))
}

/// Mean velocity of a rotor that has moved by 1.3 counts since an edge `us` ago, at least [`Model::least_us`].
fn fastest(us: i32) -> Law {
    Law::from_bits((1_300_000_u32 / us.max(100).unsigned_abs()).cast_signed() << 16)
}

const fn below(index: usize) -> usize {
    if index == 0 { BOUNDARIES - 1 } else { index - 1 }
}

fn keep(interval: i32) -> Law {
    let keep = KEEP.get(half_octaves(interval.unsigned_abs())).or(KEEP.last());
    keep.map_or(Law::ZERO, |keep| bits(u32::from(*keep)))
}

fn entry<T: Copy + Default, const N: usize>(table: &[T; N], at: usize) -> T {
    table.get(at).or(table.last()).copied().unwrap_or_default()
}
