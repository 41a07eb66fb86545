//! The moving set-point of modes 3 and 5: from any state to rest at an end position, as fast as ACCEL, the cruise velocities and the
//! motor allow.
//!
//! # Design
//!
//! Each tick chooses the velocity v' at its end. With p the way left to the end, v the velocity towards it and a₊, a₋ the
//! accelerations that are possible now ([`Reach`]), all in counts and ticks:
//!
//! ```text
//! v' = min(v + a₊, cruise)     if the rest of the way is enough to stop: v'² ≤ 2·a₋·(p − (v + v')/2)
//!    = v + a₊/2, v + a₊/4, v   else the first of these for which it is
//!    = v − v²/2p               else: the constant deceleration that ends at rest on the end, at most a₋ unless the end has moved
//! p' = p − (v + v')/2
//! ```
//!
//! A set-point that moves away from its end or is faster than its cruise velocity slows down by a₋. One that can no longer stop before
//! its end passes it and returns.
//!
//! # Trade-offs
//!
//! A plan of the whole motion would end exactly at the optimum, but a motor's acceleration falls with its speed and its load, which are
//! learned on the way. Choosing each tick costs two ticks at most (`tests/profile.rs`), no time for a plan, and new limits need none.
//!
//! # Formats
//!
//! Velocities and accelerations in 2^-26 counts and ticks of 1 ms, the way in 2^-27 counts, so that the sum of two velocities is exact.

use crate::num::{Law, ratio_of_square, times};
use crate::units::{Counts, CountsPerSec};
use fixed::FixedI32;
use fixed::types::I22F10;
use fixed::types::extra::{U22, U26, U40};

#[cfg(test)]
mod tests;

/// Largest acceleration, a quarter of a count a tick²: 250,000 counts/s², four times what the motor can do.
const MOST: i32 = 1 << 24;

/// Half of 1/1024 count, 2^-27.
const RESOLUTION: i64 = 1 << 16;

/// Range of the properties MV, MCV and MOV.
const SLOWEST: CountsPerSec = CountsPerSec::from_int(16);
const FASTEST: CountsPerSec = CountsPerSec::from_int(4080);

/// Acceleration and cruise velocities of a move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MoveLimits {
    /// Property ACCEL: a = (ACCEL/1024)² counts/ms². With 0 a set-point at rest stays there; a moving one keeps its last acceleration,
    /// without which it could not stop.
    pub accel: u16,
    /// Cruise velocity towards higher counts, min(MV, MCV): 16..=4080 counts/s; clamped to that.
    pub closing: CountsPerSec,
    /// Cruise velocity towards lower counts, min(MV, MOV), positive: 16..=4080 counts/s; clamped to that.
    pub opening: CountsPerSec,
}

impl MoveLimits {
    /// In counts and ticks.
    #[must_use]
    pub fn build(self) -> Ramps {
        let accel = i32::from(self.accel.min(512));
        let velocity = |speed: CountsPerSec| per_tick(speed.clamp(SLOWEST, FASTEST));
        Ramps {
            accel: (accel * accel * 64).min(MOST),
            closing: velocity(self.closing),
            opening: velocity(self.opening),
        }
    }
}

/// Counts a tick.
type PerTick = FixedI32<U26>;
/// A tick, s.
const TICK: FixedI32<U40> = FixedI32::from_bits(1_099_511_628);
/// Half of the ticks in a second: twice a velocity fits.
const HALF_RATE: FixedI32<U22> = FixedI32::from_bits(500 << 22);

/// A velocity in 2^-26 counts a tick.
const fn per_tick(velocity: CountsPerSec) -> i32 {
    let velocity: PerTick = times(velocity.0, TICK);
    velocity.to_bits()
}

/// [`MoveLimits`] in counts and ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ramps {
    accel: i32,
    closing: i32,
    opening: i32,
}

impl Ramps {
    /// With an acceleration in 2^-26 counts a tick², and no bound of the velocity but that of the properties.
    #[must_use]
    pub fn as_fast_as(accel: i32) -> Self {
        let most = per_tick(FASTEST);
        Self { accel: accel.min(MOST), closing: most, opening: most }
    }
}

/// Accelerations that the motor can do now, magnitudes in 2^-26 counts a tick².
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reach {
    /// Away from rest.
    pub up: i32,
    /// Towards rest.
    pub down: i32,
}

impl Reach {
    /// Of a motor without limits.
    pub const FREE: Self = Self { up: MOST, down: MOST };
}

/// The set-point at one tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SetPoint {
    /// Position, rounded to the nearest 1/1024 count. It wraps at ±2²¹ counts as every [`Counts`] does.
    pub position: Counts,
    /// Velocity, rounded to 1/65536 count/s.
    pub velocity: CountsPerSec,
    /// Change of the velocity in this tick, counts/s.
    pub change: Law,
    /// At rest exactly on the end position.
    pub done: bool,
}

impl SetPoint {
    /// At rest at `position`, which is also its end.
    #[must_use]
    pub const fn at_rest(position: Counts) -> Self {
        Self { position, velocity: CountsPerSec::ZERO, change: Law::ZERO, done: true }
    }
}

/// The set-point generator of one motor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Profile {
    end: Counts,
    /// Way to the end, signed, 2^-27 counts.
    left: i64,
    velocity: i32,
    /// The last acceleration limit other than 0.
    accel: i32,
    /// Ticks since the end was set, in which the set-point moved.
    ticks: u32,
}

impl Profile {
    /// A set-point at rest at `position`, which is also its end.
    #[must_use]
    pub const fn at_rest(position: Counts) -> Self {
        Self { end: position, left: 0, velocity: 0, accel: 0, ticks: 0 }
    }

    /// Takes another end, without a step of the set-point or its velocity.
    pub fn set_end(&mut self, end: Counts) {
        let moved = end.wrapping_sub(self.end);
        self.left += i64::from(moved.0.to_bits()) << 17;
        self.end = end;
        self.ticks = 0;
    }

    /// The set-point as the last [`step`](Self::step) left it.
    #[must_use]
    pub fn current(&self) -> SetPoint {
        self.set_point(self.velocity)
    }

    /// Takes the rotor's position and velocity, as far as the limits allow it, for the set-point's, if that has not arrived.
    pub fn follow(&mut self, ramps: &Ramps, position: Counts, velocity: CountsPerSec) -> SetPoint {
        if self.left != 0 || self.velocity != 0 {
            self.left = i64::from(self.end.wrapping_sub(position).0.to_bits()) << 17;
            self.velocity = per_tick(velocity).max(-ramps.opening).min(ramps.closing);
        }
        self.current()
    }

    fn set_point(&self, before: i32) -> SetPoint {
        // Within ±2^22 counts of 2^-10, as every difference of positions.
        let left = Counts(I22F10::from_bits(crate::num::low_word((self.left + (1 << 16)) >> 17)));
        let law = |velocity: i32| -> Law { times(PerTick::from_bits(2 * velocity), HALF_RATE) };
        SetPoint {
            position: self.end.wrapping_sub(left),
            velocity: CountsPerSec(law(self.velocity)),
            change: law(self.velocity - before),
            done: self.left == 0 && self.velocity == 0,
        }
    }

    /// Whether the end lies towards higher counts.
    #[must_use]
    pub const fn closes(&self) -> bool {
        self.left >= 0
    }

    /// Ticks since the end was set in which the set-point moved.
    #[must_use]
    pub const fn ticks(&self) -> u32 {
        self.ticks
    }

    /// Where the set-point will rest.
    #[must_use]
    pub const fn end(&self) -> Counts {
        self.end
    }

    /// Advances one tick, 1 ms. At the end, or with ACCEL 0, the set-point stays.
    #[inline]
    pub fn step(&mut self, ramps: &Ramps, reach: Reach) -> SetPoint {
        let before = self.velocity;
        if ramps.accel != 0 {
            self.accel = ramps.accel;
        } else if before == 0 {
            return self.current();
        }
        if self.left != 0 || before != 0 {
            self.advance(ramps, reach);
            self.ticks += 1;
        }
        self.set_point(before)
    }

    fn advance(&mut self, ramps: &Ramps, reach: Reach) {
        let opens = self.left < 0 || (self.left == 0 && self.velocity < 0);
        let (way, v, cruise) = if opens {
            (-self.left, -self.velocity, ramps.opening)
        } else {
            (self.left, self.velocity, ramps.closing)
        };
        let (up, down) = (reach.up.min(self.accel), reach.down.min(self.accel).max(1));
        let next = if v < 0 {
            (v + down).min(up.min(cruise))
        } else if v > cruise {
            (v - down).max(cruise)
        } else {
            (v + up).min(cruise)
        };
        let next = if can_stop(way, v, next, down) {
            next
        } else if v < 0 {
            next.min(0)
        } else {
            nearest(way, v, next, down, (down + down / 8).min(self.accel + 1).max(down))
        };
        let rest = way - i64::from(v) - i64::from(next);
        let ends = next <= 0 && v >= 0 && way <= i64::from(v) + i64::from(down);
        if ends || way.abs() <= RESOLUTION && (0..=down).contains(&v) {
            // A velocity of less than a tick's braking ends here, and so does a way that the output does not show.
            (self.left, self.velocity) = (0, 0);
            return;
        }
        (self.left, self.velocity) = if opens { (-rest, -next) } else { (rest, next) };
    }
}

/// Whether a set-point that changes from `v` to `next` can then stop within the way that is left.
fn can_stop(way: i64, v: i32, next: i32, down: i32) -> bool {
    let rest = way - i64::from(v) - i64::from(next);
    if rest < 0 || next <= 0 {
        return rest >= 0;
    }
    // Rounded up.
    let slower = i64::from(next >> 6) + 1;
    // 2^-52 / 2^12; a way of 2^22 counts has 37 bits here, and `down` 24.
    slower * slower <= (rest >> 12) * i64::from(down)
}

/// The highest velocity up to `next` with which the set-point still ends at rest on its end; beyond help it slows down by `most`: an eighth more
/// than `down`, which may have become less on the way, within ACCEL.
#[inline(never)]
fn nearest(way: i64, v: i32, next: i32, down: i32, most: i32) -> i32 {
    let rise = (next - v).max(0);
    // The last of the way in two ticks: one to this velocity, one to rest.
    let last = crate::num::low_word(((way - i64::from(v)) >> 1).clamp(0, i64::from(i32::MAX))) - v;
    // What can stop from `v` decides first: no more can otherwise.
    if v == 0 || can_stop(way, v, v, down) {
        for share in [rise >> 1, rise >> 2, last.clamp(0, rise >> 2)] {
            if v + share > 0 && can_stop(way, v, v + share, down) {
                return v + share;
            }
        }
        return v.max(1);
    }
    // v²/2p: 2^-52 over 2^-27, and half, in 2^-26. An end that came nearer cannot be reached so.
    let needed = ratio_of_square(v.unsigned_abs(), way.unsigned_abs().max(1));
    v - needed.min(most.unsigned_abs()).max(1).cast_signed()
}
