//! The moving set-point of mode 5: a trapezoid (or triangle) of velocity from any state to rest at an end
//! position, in the shortest time that the acceleration and cruise velocity limits allow.
//!
//! Decides where the set-point is at each 1 ms tick. Leaves out whether the motor follows: the caller does not
//! call [`Profile::step`] while the motor lags, which freezes the profile, and goes on later without a step.
//!
//! How: the time-optimal motion is computed in *continuous* time and sampled at the ticks, so its limits hold
//! at and between ticks and it ends at the first tick not before the optimum. It has three segments: constant
//! acceleration from the present velocity to a peak (through zero, if the set-point first has to turn round;
//! downwards, if it is faster than the new cruise velocity), cruise at the peak, constant braking to rest. A
//! segment begins between two ticks; [`Profile::plan`] computes the state at the first tick after that (all
//! divisions and the one square root are there), and [`Profile::step`] only adds.
//!
//! Exactness: the tick is the unit of time and state has 32 fractional bits, so a = ACCEL²/2²⁰ and a/2 are
//! whole numbers of units: steps inside a segment are exact, however long. Rounding happens only where a
//! segment begins: velocity by one unit (2⁻³²) or 2⁻²⁹ of the acceleration, position by 2⁻²⁶ counts. Braking
//! is computed back from the end, so the set-point lands on it exactly; there the unit of velocity moves the
//! position by one unit for each tick of braking: 10⁻⁶ counts at ACCEL 30, never more than the 1/1024 that is
//! emitted. The cruise velocity is rounded down to one unit, which makes a move longer by at most 2⁻²⁶ of its
//! duration: 0.06 ticks in the longest, 65,534 counts at 16 counts/s.

use crate::num::{Wide, isqrt_q52, mul_q32, next_tick, ratio_q32, square_q51};
use crate::units::{Counts, CountsPerSec, CountsPerSec2};
use core::num::NonZeroU64;

#[cfg(test)]
mod tests;

/// What bounds a move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Property ACCEL: √acceleration in 1/1024 √counts/ms, that is a = (ACCEL/1024)² counts/ms². 0 never moves;
    /// in mid-move 0 leaves the old ACCEL in force, since with none there would be no stopping.
    pub accel: u16,
    /// Cruise velocity towards higher counts, min(MV, MCV): 16..=4080 counts/s; clamped to that.
    pub closing: CountsPerSec,
    /// Cruise velocity towards lower counts, min(MV, MOV), positive: 16..=4080 counts/s; clamped to that.
    pub opening: CountsPerSec,
}

/// The set-point at one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SetPoint {
    /// Position, rounded to the nearest 1/1024 count. It wraps at ±2²¹ counts as every [`Counts`] does: a
    /// set-point at 4080 counts/s that is told ACCEL 1 needs 8.7 million counts to stop, and takes them.
    pub position: Counts,
    /// Velocity, rounded to the nearest 1/65536 count/s.
    pub velocity: CountsPerSec,
    /// Mean acceleration over the tick that ends here; zero once at rest.
    pub acceleration: CountsPerSec2,
    /// At rest exactly on the end position.
    pub done: bool,
}

impl SetPoint {
    /// At rest at `position`, which is also its end.
    #[must_use]
    pub const fn at_rest(position: Counts) -> Self {
        Self { position, velocity: CountsPerSec::ZERO, acceleration: CountsPerSec2::ZERO, done: true }
    }
}

/// One stretch of constant acceleration, by its state at a tick. Units: counts and ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Segment {
    /// Ticks since the plan.
    tick: u32,
    position: Wide,
    velocity: Wide,
    acceleration: Wide,
}

impl Segment {
    const fn rest(position: Wide) -> Self {
        Self { tick: 0, position, velocity: Wide::ZERO, acceleration: Wide::ZERO }
    }

    fn is_rest(&self) -> bool {
        self.velocity == Wide::ZERO && self.acceleration == Wide::ZERO
    }

    /// The state one tick later. Exact: a is a multiple of 2⁻²⁰, so a/2 is one of 2⁻³².
    fn next(&self) -> Self {
        let mean = self.velocity.wrapping_add(self.acceleration >> 1);
        Self {
            tick: self.tick.wrapping_add(1),
            position: self.position.wrapping_add(mean),
            velocity: self.velocity.wrapping_add(self.acceleration),
            acceleration: self.acceleration,
        }
    }
}

/// The set-point generator of one motor.
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    /// The present sample.
    now: Segment,
    /// Velocity change over the last tick, counts a tick.
    change: Wide,
    /// Cruise, braking, rest at the end: each by its first tick. Of those with the same tick the last holds.
    ahead: [Segment; 3],
    /// ACCEL in force.
    accel: u16,
}

impl Profile {
    /// A set-point at rest at `position`, which is also its end.
    #[must_use]
    pub const fn at_rest(position: Counts) -> Self {
        let rest = Segment::rest(position.to_wide());
        Self { now: rest, change: Wide::ZERO, ahead: [rest; 3], accel: 0 }
    }

    /// The set-point as the last [`step`](Self::step) left it.
    #[must_use]
    pub fn current(&self) -> SetPoint {
        SetPoint {
            position: Counts::from_wide(self.now.position),
            velocity: CountsPerSec::from_wide_per_tick(self.now.velocity),
            acceleration: CountsPerSec2::from_wide_per_tick2(self.change),
            done: self.now.is_rest() && self.now.position == self.ahead[2].position,
        }
    }

    /// Position in counts (not wrapped) and velocity in counts a tick to the full 2⁻³²: what a new plan starts
    /// from.
    #[must_use]
    pub const fn exact(&self) -> (Wide, Wide) {
        (self.now.position, self.now.velocity)
    }

    /// Advances one tick, 1 ms. At the end, or with ACCEL 0, the set-point stays.
    pub fn step(&mut self) -> SetPoint {
        let before = self.now;
        if !before.is_rest() {
            let next = before.next();
            self.now = match self.ahead.iter().rev().find(|segment| segment.tick == next.tick) {
                Some(begun) => *begun,
                None => next,
            };
        }
        self.change = self.now.velocity.wrapping_sub(before.velocity);
        self.current()
    }

    /// Sets out for `end` within `limits`, from the present set-point and its velocity, without a step in
    /// either. If the set-point can no longer stop before `end`, it overshoots and comes back.
    pub fn plan(&mut self, end: Counts, limits: Limits) {
        let end = end.to_wide();
        if limits.accel != 0 || self.now.velocity == Wide::ZERO {
            self.accel = limits.accel;
        }
        let rest = Segment::rest(end);
        let distance = end.wrapping_sub(self.now.position);
        self.now.tick = 0;
        self.now.acceleration = Wide::ZERO;
        self.ahead = [rest; 3];
        let Some(ramp) = Ramp::new(self.accel) else { return };
        if self.now.velocity == Wide::ZERO && distance == Wide::ZERO {
            return;
        }

        let course = Course::new(ramp, distance.to_bits(), self.now.velocity.to_bits(), limits);
        let directed = |magnitude: u64| course.directed(magnitude.cast_signed());
        let acceleration = ramp.acceleration();
        self.now.acceleration = course.directed(if course.slowing {
            acceleration.cast_signed().wrapping_neg()
        } else {
            acceleration.cast_signed()
        });
        let (cruise_tick, cruised) = next_tick(course.cruise_begins);
        let cruise = Segment {
            tick: cruise_tick,
            position: self
                .now
                .position
                .wrapping_add(course.directed(course.to_cruise))
                .wrapping_add(directed(mul_q32(course.peak, cruised))),
            velocity: directed(course.peak),
            acceleration: Wide::ZERO,
        };
        let (brake_tick, braked) = next_tick(course.braking_begins);
        // Zero if the set-point comes to rest before this tick.
        let left = course.peak.saturating_sub(ramp.change(braked));
        let braking = Segment {
            tick: brake_tick,
            position: end.wrapping_sub(directed(ramp.distance(left))),
            velocity: directed(left),
            acceleration: Wide::ZERO.wrapping_sub(directed(acceleration)),
        };
        self.ahead = [cruise, braking, Segment { tick: brake_tick.saturating_add(ramp.ticks(left)), ..rest }];
    }
}

/// The constant acceleration a = ACCEL²/2²⁰ counts a tick². Arguments and results are magnitudes with 32
/// fractional bits in counts and ticks; velocities are below 2³ counts a tick.
#[derive(Clone, Copy)]
struct Ramp {
    accel_squared: NonZeroU64,
}

impl Ramp {
    fn new(accel: u16) -> Option<Self> {
        let accel = u64::from(accel);
        NonZeroU64::new(accel.wrapping_mul(accel)).map(|accel_squared| Self { accel_squared })
    }

    const fn acceleration(self) -> u64 {
        self.accel_squared.get() << 12
    }

    /// Distance between rest and `velocity`: v²/2a = v²·2¹⁹/ACCEL², and 2¹⁹·2³² = 2⁵¹. Rounded down.
    fn distance(self, velocity: u64) -> u64 {
        square_q51(velocity) / self.accel_squared
    }

    /// Time of a velocity change: Δv·2²⁰/ACCEL². Δv < 2⁴, so the shift stays below 2⁵⁶. Rounded down.
    fn time(self, change: u64) -> u64 {
        (change << 20) / self.accel_squared
    }

    /// Velocity change in a time up to one tick; ACCEL² < 2³² keeps the product below 2⁶⁴. Rounded down.
    fn change(self, time: u64) -> u64 {
        self.accel_squared.get().wrapping_mul(time) >> 20
    }

    /// Whole ticks that a velocity change takes, rounded up: ⌈⌈Δv/2¹²⌉/ACCEL²⌉.
    fn ticks(self, change: u64) -> u32 {
        let units = change.saturating_add(0xFFF) >> 12;
        let ticks = units.saturating_add(self.accel_squared.get()).saturating_sub(1) / self.accel_squared;
        u32::try_from(ticks).unwrap_or(u32::MAX)
    }
}

/// A continuous-time motion to rest, mirrored if need be so that its last approach is upwards. 32 fractional
/// bits in counts and ticks.
struct Course {
    /// The approach is in truth downwards.
    mirrored: bool,
    /// The first segment slows from above the cruise velocity.
    slowing: bool,
    /// Highest velocity of the approach.
    peak: u64,
    /// Distance until `peak` is reached; negative if most of that is turning round.
    to_cruise: i64,
    /// When `peak` is reached.
    cruise_begins: u64,
    /// When braking begins.
    braking_begins: u64,
}

impl Course {
    fn new(ramp: Ramp, distance: i64, velocity: i64, limits: Limits) -> Self {
        let speed = velocity.unsigned_abs();
        let stopping = ramp.distance(speed).cast_signed();
        // What would be left to go after stopping at once decides the direction of the approach.
        let left = distance.wrapping_sub(if velocity < 0 { stopping.wrapping_neg() } else { stopping });
        let mirrored = left < 0 || (left == 0 && velocity < 0);
        let (distance, velocity, cruise) = if mirrored {
            (distance.wrapping_neg(), velocity.wrapping_neg(), limits.opening)
        } else {
            (distance, velocity, limits.closing)
        };

        let peak = peak(ramp, distance, velocity, cruise.clamp(SLOWEST, FASTEST).to_wide_per_tick());
        let change = peak.get().cast_signed().wrapping_sub(velocity);
        let slowing = change < 0;
        let braking = ramp.distance(peak.get()).cast_signed();
        // (peak² − v²)/2a, and a is negative when slowing.
        let gain = braking.wrapping_sub(stopping);
        let to_cruise = if slowing { gain.wrapping_neg() } else { gain };
        let cruising = distance.wrapping_sub(to_cruise).wrapping_sub(braking).max(0);
        let cruise_begins = ramp.time(change.unsigned_abs());
        let braking_begins = cruise_begins.saturating_add(ratio_q32(cruising.cast_unsigned(), peak));
        Self { mirrored, slowing, peak: peak.get(), to_cruise, cruise_begins, braking_begins }
    }

    const fn directed(&self, value: i64) -> Wide {
        Wide::from_bits(if self.mirrored { value.wrapping_neg() } else { value })
    }
}

/// Range of the properties MV, MCV and MOV.
const SLOWEST: CountsPerSec = CountsPerSec::from_int(16);
const FASTEST: CountsPerSec = CountsPerSec::from_int(4080);

/// The highest velocity of the approach: `cruise`, or the tip of the triangle, √(a·distance + v²/2), rounded
/// down to 2⁻²⁶ (what rounding leaves over is cruised). A tip δ too low costs δ²/(a·tip) ticks, at most
/// 2⁻²⁶/2⁻²⁰ = 1/64. It is at least 2⁻²⁶, so that cruise time exists; that overruns by 2⁻⁵²/2⁻²⁰ counts at
/// most, one unit.
fn peak(ramp: Ramp, distance: i64, velocity: i64, cruise: NonZeroU64) -> NonZeroU64 {
    // With 52 fractional bits: a·d is ACCEL²·d, v²/2 is v²·2⁵¹, cruise² is 2·cruise²·2⁵¹. Distances too long
    // for that saturate, far above 4.08².
    let squared = ramp.accel_squared.get().cast_signed().saturating_mul(distance);
    let squared =
        squared.saturating_add(square_q51(velocity.unsigned_abs()).cast_signed()).max(1).cast_unsigned();
    if squared >= square_q51(cruise.get()) << 1 { cruise } else { isqrt_q52(squared) }
}
