//! The moving set-point of mode 5: a trapezoid or triangle of velocity from any state to rest at an end position, in the
//! shortest time that the acceleration and the cruise velocities allow.
//!
//! The module computes the set-point at each 1 ms tick. Whether the motor follows is the caller's concern: it does not call
//! [`Profile::step`] while the motor lags, which freezes the profile, and continues later without a step.
//!
//! # Design
//!
//! The time-optimal motion is computed in continuous time and sampled at the ticks, so its limits hold at and between
//! ticks, and it ends at the first tick not before the optimum. It has three segments: constant acceleration from the
//! present velocity to a peak (through zero if the set-point must turn round; downwards if it is faster than the new
//! cruise velocity), cruise at the peak, constant braking to rest. A segment begins between two ticks; its state is
//! computed at the first tick after that, and between those ticks [`Profile::step`] only adds:
//!
//! ```text
//! p = p + v + a/2        v = v + a        a = ±(ACCEL/1024)², in counts and ticks
//! ```
//!
//! A plan is made within a tick. [`MoveLimits::build`] computes what depends on the limits alone; a plan needs one square
//! root and three divisions at most.
//!
//! # Exactness
//!
//! The state has 32 fractional bits, so a = ACCEL²/2²⁰ and a/2 are whole numbers of units and steps inside a segment are
//! exact, however long. Rounding happens only where a segment begins: velocity by one unit (2⁻³²) or 2⁻²⁹ of the
//! acceleration, position by 2⁻²⁶ counts. Braking is computed back from the end, so the set-point lands on it exactly. The
//! unit of velocity moves the position by half a unit for each tick of braking: 10⁻⁶ counts at ACCEL 30, never more than
//! the 1/1024 of the output. The cruise velocity is rounded down by one unit, which lengthens a move by at most 2⁻²⁶ of its
//! duration: 0.06 ticks for 65,534 counts at 16 counts/s.

use crate::num::{Wide, divide, isqrt_q52, mul_q32, next_tick, ratio_q32, square_q51};
use crate::units::{Counts, CountsPerSec};
use core::num::NonZeroU32;

#[cfg(test)]
mod tests;

/// Acceleration and cruise velocities of a move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MoveLimits {
    /// Property ACCEL: a = (ACCEL/1024)² counts/ms². With 0 a set-point at rest stays there; a moving one keeps its old ACCEL,
    /// without which it could not stop.
    pub accel: u16,
    /// Cruise velocity towards higher counts, min(MV, MCV): 16..=4080 counts/s; clamped to that.
    pub closing: CountsPerSec,
    /// Cruise velocity towards lower counts, min(MV, MOV), positive: 16..=4080 counts/s; clamped to that.
    pub opening: CountsPerSec,
}

impl MoveLimits {
    /// Precomputes what every plan needs.
    #[must_use]
    pub fn build(self) -> CruiseRamps {
        let velocity = |speed: CountsPerSec| speed.clamp(SLOWEST, FASTEST).to_wide_per_tick().get();
        CruiseRamps::new(self.accel, velocity(self.closing), velocity(self.opening))
    }
}

/// Range of the properties MV, MCV and MOV.
const SLOWEST: CountsPerSec = CountsPerSec::from_int(16);
const FASTEST: CountsPerSec = CountsPerSec::from_int(4080);

/// [`MoveLimits`] in counts and ticks, with the ramp from rest to each cruise velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CruiseRamps {
    accel: u16,
    closing: Ramp,
    opening: Ramp,
}

impl CruiseRamps {
    fn new(accel: u16, closing: u64, opening: u64) -> Self {
        let ramp = |velocity| match Slope::new(accel) {
            Some(slope) => slope.ramp(velocity),
            None => Ramp { velocity, time: 0, distance: 0 },
        };
        Self { accel, closing: ramp(closing), opening: ramp(opening) }
    }
}

/// The set-point at one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SetPoint {
    /// Position, rounded to the nearest 1/1024 count. It wraps at ±2²¹ counts as every [`Counts`] does.
    pub position: Counts,
    /// Velocity, rounded to the nearest 1/65536 count/s.
    pub velocity: CountsPerSec,
    /// At rest exactly on the end position.
    pub done: bool,
}

impl SetPoint {
    /// At rest at `position`, which is also its end.
    #[must_use]
    pub const fn at_rest(position: Counts) -> Self {
        Self { position, velocity: CountsPerSec::ZERO, done: true }
    }
}

/// The set-point generator of one motor.
#[derive(Clone, Copy, Debug)]
pub struct Profile {
    /// The present sample, in counts and ticks.
    position: Wide,
    velocity: Wide,
    acceleration: Wide,
    end: Wide,
    accel: u16,
    /// Ticks since the plan, and when the next segment begins.
    tick: u32,
    due: u32,
    /// First ticks of braking and of rest; the latter is computed when braking begins. Of segments that begin at the same tick
    /// the last holds.
    brake_tick: u32,
    rest_tick: u32,
    /// `None` at rest.
    course: Option<Course>,
}

impl Profile {
    /// A set-point at rest at `position`, which is also its end.
    #[must_use]
    pub const fn at_rest(position: Counts) -> Self {
        let position = position.to_wide();
        Self {
            position,
            velocity: Wide::ZERO,
            acceleration: Wide::ZERO,
            end: position,
            accel: 0,
            tick: 0,
            due: 0,
            brake_tick: 0,
            rest_tick: 0,
            course: None,
        }
    }

    /// Puts the set-point to rest at `position`, which becomes its end.
    pub fn rest_at(&mut self, position: Counts) {
        self.end = position.to_wide();
        self.rest();
    }

    fn rest(&mut self) {
        self.position = self.end;
        self.velocity = Wide::ZERO;
        self.acceleration = Wide::ZERO;
        self.course = None;
    }

    /// The set-point as the last [`step`](Self::step) left it.
    #[must_use]
    pub fn current(&self) -> SetPoint {
        SetPoint {
            position: Counts::from_wide(self.position),
            velocity: CountsPerSec::from_wide_per_tick(self.velocity),
            done: self.course.is_none() && self.position == self.end,
        }
    }

    /// Ticks since the plan in which the set-point moved.
    #[must_use]
    pub const fn ticks(&self) -> u32 {
        self.tick
    }

    /// Where the set-point will rest.
    #[must_use]
    pub const fn end(&self) -> Counts {
        Counts::from_wide(self.end)
    }

    /// Position in counts (not wrapped) and velocity in counts a tick to the full 2⁻³²: what a new plan starts
    /// from.
    #[must_use]
    pub const fn exact(&self) -> (Wide, Wide) {
        (self.position, self.velocity)
    }

    /// Advances one tick, 1 ms. At the end, or with ACCEL 0, the set-point stays.
    #[inline]
    pub fn step(&mut self) -> SetPoint {
        if self.course.is_some() {
            self.tick += 1;
            if self.tick == self.due {
                self.begin();
            } else {
                // Exact: a is a multiple of 2⁻²⁰, so a/2 is one of 2⁻³².
                let mean = self.velocity + (self.acceleration >> 1);
                let position = self.position + mean;
                let velocity = self.velocity + self.acceleration;
                (self.position, self.velocity) = (position, velocity);
                return SetPoint {
                    position: Counts::from_wide(position),
                    velocity: CountsPerSec::from_wide_per_tick(velocity),
                    done: false,
                };
            }
        }
        self.current()
    }

    #[inline(never)]
    fn begin(&mut self) {
        let Some(course) = &self.course else { return };
        if self.tick == self.brake_tick {
            self.begin_braking();
        } else if self.tick == self.rest_tick {
            self.rest();
        } else {
            let peak = course.peak.velocity;
            let (_, cruised) = next_tick(course.cruise_begins);
            let distance = course.to_cruise + mul_q32(peak, cruised).cast_signed();
            self.position = course.from + course.directed(distance);
            self.velocity = course.directed(peak.cast_signed());
            self.acceleration = Wide::ZERO;
            self.due = self.brake_tick;
        }
    }

    fn begin_braking(&mut self) {
        let (Some(course), Some(slope)) = (&self.course, Slope::new(self.accel)) else {
            return self.rest();
        };
        let (_, braked) = next_tick(course.braking_begins);
        // Both are zero if the set-point stops before this tick.
        let left = course.peak.velocity.saturating_sub(slope.change(braked));
        let time = course.peak.time.saturating_sub(braked);
        if time == 0 {
            return self.rest();
        }
        let directed = |magnitude: u64| course.directed(magnitude.cast_signed());
        self.position = self.end - directed(mul_q32(left, time) >> 1);
        self.velocity = directed(left);
        self.acceleration = -directed(slope.acceleration());
        self.rest_tick = self.tick.saturating_add(next_tick(time - 1).0);
        self.due = self.rest_tick;
    }

    /// Plans from the present set-point and its velocity to `end`, without a step in either. A set-point that can no longer stop
    /// before `end` overshoots and returns.
    #[inline(never)]
    pub fn plan(&mut self, end: Counts, ramps: &CruiseRamps) {
        if ramps.accel == 0 && self.velocity != Wide::ZERO {
            let old = CruiseRamps::new(self.accel, ramps.closing.velocity, ramps.opening.velocity);
            self.plan_with(end, &old);
        } else {
            self.plan_with(end, ramps);
        }
    }

    #[inline]
    fn plan_with(&mut self, end: Counts, ramps: &CruiseRamps) {
        self.accel = ramps.accel;
        self.end = end.to_wide();
        self.tick = 0;
        self.acceleration = Wide::ZERO;
        self.course = None;
        let distance = self.end - self.position;
        let Some(slope) = Slope::new(ramps.accel) else { return };
        if self.velocity == Wide::ZERO && distance == Wide::ZERO {
            return;
        }

        let course = Course::new(slope, self.position, distance.to_bits(), self.velocity.to_bits(), ramps);
        let acceleration = slope.acceleration().cast_signed();
        self.acceleration = course.directed(if course.slowing { -acceleration } else { acceleration });
        self.due = next_tick(course.cruise_begins).0;
        self.brake_tick = next_tick(course.braking_begins).0;
        self.course = Some(course);
        self.rest_tick = 0;
    }
}

/// A velocity, and the time and the distance between rest and it: magnitudes with 32 fractional bits in counts and ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Ramp {
    velocity: u64,
    time: u64,
    distance: u64,
}

/// The constant acceleration a = ACCEL²/2²⁰ counts a tick². Arguments and results are magnitudes with 32
/// fractional bits in counts and ticks; velocities are below 2³ counts a tick.
#[derive(Clone, Copy)]
struct Slope {
    accel_squared: NonZeroU32,
}

impl Slope {
    fn new(accel: u16) -> Option<Self> {
        let accel = u32::from(accel);
        NonZeroU32::new(accel * accel).map(|accel_squared| Self { accel_squared })
    }

    fn acceleration(self) -> u64 {
        u64::from(self.accel_squared.get()) << 12
    }

    /// Time is v·2²⁰/ACCEL² (v < 2³, so the shift stays below 2⁵⁵), rounded down; distance is half of its product with the
    /// velocity, below 2⁵⁷.
    #[inline(never)]
    fn ramp(self, velocity: u64) -> Ramp {
        let time = divide(velocity << 20, self.accel_squared);
        Ramp { velocity, time, distance: mul_q32(velocity, time) >> 1 }
    }

    /// Velocity change in a time up to one tick; ACCEL² < 2³² keeps the product below 2⁶⁴. Rounded down.
    fn change(self, time: u64) -> u64 {
        (u64::from(self.accel_squared.get()) * time) >> 20
    }
}

/// A continuous-time motion to rest, mirrored if need be so that its last approach is upwards. 32 fractional
/// bits in counts and ticks.
#[derive(Clone, Copy, Debug)]
struct Course {
    from: Wide,
    mirrored: bool,
    /// The first segment decelerates from above the cruise velocity.
    slowing: bool,
    peak: Ramp,
    /// Distance to the start of cruise; negative if most of it is turning round.
    to_cruise: i64,
    cruise_begins: u64,
    braking_begins: u64,
}

impl Course {
    #[inline]
    fn new(slope: Slope, from: Wide, distance: i64, velocity: i64, ramps: &CruiseRamps) -> Self {
        let (stop_time, stopping) = if velocity == 0 {
            (0, 0)
        } else {
            let stop = slope.ramp(velocity.unsigned_abs());
            (stop.time, stop.distance.cast_signed())
        };
        // The distance left after stopping at once decides the direction of the approach.
        let left = distance - if velocity < 0 { -stopping } else { stopping };
        let mirrored = left < 0 || (left == 0 && velocity < 0);
        let (distance, velocity, cruise) = if mirrored {
            (-distance, -velocity, &ramps.opening)
        } else {
            (distance, velocity, &ramps.closing)
        };

        let to_peak = distance + stopping;
        let peak = if to_peak >= 2 * cruise.distance.cast_signed() {
            *cruise
        } else {
            slope.ramp(triangle_peak_velocity(slope, distance, velocity))
        };
        let slowing = peak.velocity.cast_signed() < velocity;
        let braking = peak.distance.cast_signed();
        // (peak² − v²)/2a, and a is negative when slowing.
        let gain = braking - stopping;
        let to_cruise = if slowing { -gain } else { gain };
        let cruising = (distance - to_cruise - braking).max(0);
        let cruise_begins = if velocity < 0 { peak.time + stop_time } else { peak.time.abs_diff(stop_time) };
        let braking_begins = cruise_begins.saturating_add(ratio_q32(cruising.cast_unsigned(), peak.velocity));
        Self { from, mirrored, slowing, peak, to_cruise, cruise_begins, braking_begins }
    }

    const fn directed(&self, value: i64) -> Wide {
        Wide::from_bits(if self.mirrored { -value } else { value })
    }
}

/// Peak velocity of a triangle below the cruise velocity, √(a·distance + v²/2), rounded down to 2⁻²⁶; the rounding error is
/// cruised. A peak δ too low costs δ²/(a·peak) ticks, at most 2⁻²⁶/2⁻²⁰ = 1/64. It is at least 2⁻²⁶, so that the cruise
/// time exists, which overruns the end by at most one unit.
fn triangle_peak_velocity(slope: Slope, distance: i64, velocity: i64) -> u64 {
    // With 52 fractional bits: a·d is ACCEL²·d, v²/2 is v²·2⁵¹. Their sum is below 4.08², and so each is within ±4.08².
    let squared = i64::from(slope.accel_squared.get()) * distance;
    let squared = squared + square_q51(velocity.unsigned_abs()).cast_signed();
    isqrt_q52(squared.max(1).cast_unsigned())
}
