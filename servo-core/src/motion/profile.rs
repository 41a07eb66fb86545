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
//! segment begins between two ticks; at the first tick after that its state is computed, and between [`Profile::step`] only
//! adds. A plan is made inside a tick: all that depends on the limits alone is in
//! [`MoveLimits::build`], and what is left is at most a square root and three divisions, none of them a library's.
//!
//! Exactness: the tick is the unit of time and state has 32 fractional bits, so a = ACCEL²/2²⁰ and a/2 are
//! whole numbers of units: steps inside a segment are exact, however long. Rounding happens only where a
//! segment begins: velocity by one unit (2⁻³²) or 2⁻²⁹ of the acceleration, position by 2⁻²⁶ counts. Braking
//! is computed back from the end, so the set-point lands on it exactly; there the unit of velocity moves the
//! position by half a unit for each tick of braking: 10⁻⁶ counts at ACCEL 30, never more than the 1/1024 that is
//! emitted. The cruise velocity is rounded down to one unit, which makes a move longer by at most 2⁻²⁶ of its
//! duration: 0.06 ticks in the longest, 65,534 counts at 16 counts/s.

use crate::num::{Wide, divide, isqrt_q52, mul_q32, next_tick, ratio_q32, square_q51};
use crate::units::{Counts, CountsPerSec};
use core::num::NonZeroU32;

#[cfg(test)]
mod tests;

/// What bounds a move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MoveLimits {
    /// Property ACCEL: √acceleration in 1/1024 √counts/ms, that is a = (ACCEL/1024)² counts/ms². 0 never moves;
    /// in mid-move 0 leaves the old ACCEL in force, since with none there would be no stopping.
    pub accel: u16,
    /// Cruise velocity towards higher counts, min(MV, MCV): 16..=4080 counts/s; clamped to that.
    pub closing: CountsPerSec,
    /// Cruise velocity towards lower counts, min(MV, MOV), positive: 16..=4080 counts/s; clamped to that.
    pub opening: CountsPerSec,
}

impl MoveLimits {
    /// What a plan needs of them.
    #[must_use]
    pub fn build(self) -> CruiseRamps {
        let velocity = |speed: CountsPerSec| speed.clamp(SLOWEST, FASTEST).to_wide_per_tick().get();
        CruiseRamps::new(self.accel, velocity(self.closing), velocity(self.opening))
    }
}

/// Range of the properties MV, MCV and MOV.
const SLOWEST: CountsPerSec = CountsPerSec::from_int(16);
const FASTEST: CountsPerSec = CountsPerSec::from_int(4080);

/// [`MoveLimits`] in counts and ticks, with what takes long to compute.
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
    /// Position, rounded to the nearest 1/1024 count. It wraps at ±2²¹ counts as every [`Counts`] does: a
    /// set-point at 4080 counts/s that is told ACCEL 1 needs 8.7 million counts to stop, and takes them.
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
    /// The present sample. Units: counts and ticks.
    position: Wide,
    velocity: Wide,
    acceleration: Wide,
    /// Where the plan ends.
    end: Wide,
    /// A segment is under way; else the set-point is at rest.
    moving: bool,
    /// ACCEL in force.
    accel: u16,
    /// Ticks since the plan, and when the next segment begins.
    tick: u32,
    due: u32,
    /// First ticks of braking and of rest; that of rest is known when braking begins. Of segments that begin at the same tick
    /// the last holds.
    brake_tick: u32,
    rest_tick: u32,
    /// What the segments ahead are computed from.
    course: Course,
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
            moving: false,
            accel: 0,
            tick: 0,
            due: 0,
            brake_tick: 0,
            rest_tick: 0,
            course: Course::NONE,
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
        self.moving = false;
    }

    /// The set-point as the last [`step`](Self::step) left it.
    #[must_use]
    pub fn current(&self) -> SetPoint {
        SetPoint {
            position: Counts::from_wide(self.position),
            velocity: CountsPerSec::from_wide_per_tick(self.velocity),
            done: !self.moving && self.position == self.end,
        }
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
        if self.moving {
            self.tick += 1;
            if self.tick == self.due {
                self.begin();
            } else {
                // Exact: a is a multiple of 2⁻²⁰, so a/2 is one of 2⁻³².
                let mean = self.velocity + (self.acceleration >> 1);
                let position = self.position + mean;
                let velocity = self.velocity + self.acceleration;
                (self.position, self.velocity) = (position, velocity);
                // What moves is not done: only a segment that begins may be rest.
                return SetPoint {
                    position: Counts::from_wide(position),
                    velocity: CountsPerSec::from_wide_per_tick(velocity),
                    done: false,
                };
            }
        }
        self.current()
    }

    /// The segment that begins at this tick.
    #[inline(never)]
    fn begin(&mut self) {
        if self.tick == self.brake_tick {
            self.begin_braking();
        } else if self.tick == self.rest_tick {
            self.rest();
        } else {
            let course = &self.course;
            let peak = course.peak.velocity;
            let (_, cruised) = next_tick(course.cruise_begins);
            let way = course.to_cruise + mul_q32(peak, cruised).cast_signed();
            self.position = course.from + course.directed(way);
            self.velocity = course.directed(peak.cast_signed());
            self.acceleration = Wide::ZERO;
            self.due = self.brake_tick;
        }
    }

    fn begin_braking(&mut self) {
        let Course { peak, .. } = self.course;
        let (Some(slope), (_, braked)) = (Slope::new(self.accel), next_tick(self.course.braking_begins))
        else {
            return self.rest();
        };
        // Both zero if the set-point comes to rest before this tick.
        let left = peak.velocity.saturating_sub(slope.change(braked));
        let time = peak.time.saturating_sub(braked);
        if time == 0 {
            return self.rest();
        }
        let directed = |magnitude: u64| self.course.directed(magnitude.cast_signed());
        self.position = self.end - directed(mul_q32(left, time) >> 1);
        self.velocity = directed(left);
        self.acceleration = -directed(slope.acceleration());
        // The tick at the time, or the first after it.
        self.rest_tick = self.tick.saturating_add(next_tick(time - 1).0);
        self.due = self.rest_tick;
    }

    /// Sets out for `end` within `bounds`, from the present set-point and its velocity, without a step in
    /// either. If the set-point can no longer stop before `end`, it overshoots and comes back.
    #[inline(never)]
    pub fn plan(&mut self, end: Counts, bounds: &CruiseRamps) {
        if bounds.accel == 0 && self.velocity != Wide::ZERO {
            let old = CruiseRamps::new(self.accel, bounds.closing.velocity, bounds.opening.velocity);
            self.set_out(end, &old);
        } else {
            self.set_out(end, bounds);
        }
    }

    #[inline]
    fn set_out(&mut self, end: Counts, bounds: &CruiseRamps) {
        self.accel = bounds.accel;
        self.end = end.to_wide();
        self.tick = 0;
        self.acceleration = Wide::ZERO;
        self.moving = false;
        let distance = self.end - self.position;
        let Some(slope) = Slope::new(bounds.accel) else { return };
        if self.velocity == Wide::ZERO && distance == Wide::ZERO {
            return;
        }

        self.course = Course::new(slope, self.position, distance.to_bits(), self.velocity.to_bits(), bounds);
        let acceleration = slope.acceleration().cast_signed();
        let slowing = self.course.slowing;
        self.acceleration = self.course.directed(if slowing { -acceleration } else { acceleration });
        self.moving = true;
        self.due = next_tick(self.course.cruise_begins).0;
        self.brake_tick = next_tick(self.course.braking_begins).0;
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
    /// Where it begins.
    from: Wide,
    /// The approach is in truth downwards.
    mirrored: bool,
    /// The first segment slows from above the cruise velocity.
    slowing: bool,
    /// Highest velocity of the approach.
    peak: Ramp,
    /// Distance until `peak` is reached; negative if most of that is turning round.
    to_cruise: i64,
    /// When `peak` is reached.
    cruise_begins: u64,
    /// When braking begins.
    braking_begins: u64,
}

impl Course {
    const NONE: Self = Self {
        from: Wide::ZERO,
        mirrored: false,
        slowing: false,
        peak: Ramp { velocity: 0, time: 0, distance: 0 },
        to_cruise: 0,
        cruise_begins: 0,
        braking_begins: 0,
    };

    #[inline]
    fn new(slope: Slope, from: Wide, distance: i64, velocity: i64, bounds: &CruiseRamps) -> Self {
        let (stop_time, stopping) = if velocity == 0 {
            (0, 0)
        } else {
            let stop = slope.ramp(velocity.unsigned_abs());
            (stop.time, stop.distance.cast_signed())
        };
        // What would be left to go after stopping at once decides the direction of the approach.
        let left = distance - if velocity < 0 { -stopping } else { stopping };
        let mirrored = left < 0 || (left == 0 && velocity < 0);
        let (distance, velocity, cruise) = if mirrored {
            (-distance, -velocity, &bounds.opening)
        } else {
            (distance, velocity, &bounds.closing)
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

/// The tip of the triangle, √(a·distance + v²/2), below a cruise velocity; rounded
/// down to 2⁻²⁶ (what rounding leaves over is cruised). A tip δ too low costs δ²/(a·tip) ticks, at most
/// 2⁻²⁶/2⁻²⁰ = 1/64. It is at least 2⁻²⁶, so that cruise time exists; that overruns by 2⁻⁵²/2⁻²⁰ counts at
/// most, one unit.
fn triangle_peak_velocity(slope: Slope, distance: i64, velocity: i64) -> u64 {
    // With 52 fractional bits: a·d is ACCEL²·d, v²/2 is v²·2⁵¹. Their sum is below 4.08², and so each is within ±4.08².
    let squared = i64::from(slope.accel_squared.get()) * distance;
    let squared = squared + square_q51(velocity.unsigned_abs()).cast_signed();
    isqrt_q52(squared.max(1).cast_unsigned())
}
