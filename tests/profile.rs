//! The guarantees of the profile against a continuous-time oracle in f64, without a motor's limits: it lands exactly, within the limits
//! at every tick, at most four ticks later than the shortest time, for plain moves and for new ends and limits during a move.
//!
//! Cases are drawn log-uniformly over the whole range of the properties. Of the million none is longer than
//! `SHORT`; fewer cases run to `LONG`, and the extremes to their end.

use fixed::types::I22F10;
use servo_core::motion::profile::{MoveLimits, Profile, Reach, SetPoint};
use servo_core::units::{Counts, CountsPerSec};

/// Resolution of the emitted values, counts and counts/s; a difference of two has an error of one step.
const POSITION_STEP: f64 = 1.0 / 1024.0;
const VELOCITY_STEP: f64 = 1.0 / 65536.0;
/// Error of the f64 oracle itself, in ticks: a distance of 2^23 counts has an error of 2^-29, which at ACCEL
/// 1 takes 2·√(2^-29·2^20) = 0.09 ticks.
const ORACLE_ERROR: f64 = 0.1;
/// What choosing each tick costs, in ticks: one where cruise begins, one where braking begins, and its last steps are a quarter of the acceleration.
const LATE: f64 = 4.0;
/// What landing takes off: it ends in the tick in which the velocity would become 0.
const EARLY: f64 = 2.0;
/// The longest optimum of the million cases, and of the few hundred that include ACCEL 1, in ms.
const SHORT: f64 = 1500.0;
const LONG: f64 = 300_000.0;

/// SplitMix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn one_in(&mut self, n: u64) -> bool {
        self.next().is_multiple_of(n)
    }

    fn log(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.uniform())
    }

    fn cruise(&mut self) -> CountsPerSec {
        CountsPerSec::from_int(self.log(16.0, 4080.4).round() as i16)
    }

    fn limits(&mut self) -> MoveLimits {
        let accel = self.log(1.0, 65535.4).round() as u16;
        MoveLimits { accel, closing: self.cruise(), opening: self.cruise() }
    }

    fn position(&mut self) -> Counts {
        Counts(I22F10::from_bits((self.next() % (65534 * 1024)) as i32 - 32767 * 1024))
    }

    /// A whole-count position at a log-uniform distance.
    fn end(&mut self, from: Counts) -> Counts {
        let distance = self.log(0.5, 65534.0).copysign(self.uniform() - 0.5);
        Counts::from_int((counts(from) + distance).round().clamp(-32767.0, 32767.0) as i32)
    }
}

fn counts(position: Counts) -> f64 {
    position.0.to_num()
}

/// In counts/ms.
fn per_tick(velocity: CountsPerSec) -> f64 {
    velocity.0.to_num::<f64>() / 1000.0
}

/// Ticks to return from a place half a tick of braking beyond the end: 2·√(a/2 / a), and to stop.
const RETURN: f64 = 4.0;

/// In counts/ms², at most a quarter.
fn acceleration(limits: MoveLimits) -> f64 {
    (f64::from(limits.accel) / 1024.0).powi(2).min(0.25)
}

/// Shortest time, ms, from `velocity` at `distance` before the end to rest on it, by the better approach.
fn optimum(distance: f64, velocity: f64, limits: MoveLimits) -> f64 {
    let a = acceleration(limits);
    let up = approach(distance, velocity, a, per_tick(limits.closing));
    let down = approach(-distance, -velocity, a, per_tick(limits.opening));
    up.min(down)
}

/// The duration of the motion whose last approach is upwards; infinite if the end is too near for one.
fn approach(distance: f64, velocity: f64, a: f64, cruise: f64) -> f64 {
    if distance < velocity * velocity.abs() / (2.0 * a) {
        return f64::INFINITY;
    }
    let peak = cruise.min((a * distance + velocity * velocity / 2.0).max(0.0).sqrt());
    let ramps = (peak - velocity).abs() / a + peak / a;
    // Signed: for slowing from above the cruise velocity and for reversing.
    let ramped = (peak - velocity).abs() / a * (peak + velocity) / 2.0 + peak * peak / (2.0 * a);
    if distance > ramped { ramps + (distance - ramped) / peak } else { ramps }
}

fn remaining(profile: &Profile, end: Counts, limits: MoveLimits) -> f64 {
    let now = profile.current();
    optimum(counts(end.wrapping_sub(now.position)), per_tick(now.velocity), limits)
}

fn tick_fault(before: SetPoint, after: SetPoint, limits: MoveLimits) -> Option<&'static str> {
    let a = acceleration(limits);
    let cruise = |direction: f64| per_tick(if direction > 0.0 { limits.closing } else { limits.opening });
    let (u, v) = (per_tick(before.velocity), per_tick(after.velocity));
    let moved = counts(after.position.wrapping_sub(before.position));
    // Above the cruise velocity only after a new plan, and then slowing with the full acceleration.
    let fastest = cruise(v).max(u.abs() - a * (1.0 - (-10_f64).exp2()));
    let step = VELOCITY_STEP / 1000.0;
    // The deceleration that ends at the end is rounded to 2^-10 of it.
    if (v - u).abs() > a * (1.0 + (-10_f64).exp2()) + step + (-26_f64).exp2() {
        return Some("velocity changes faster than the acceleration limit");
    }
    if v.abs() > fastest + 2.0 * step {
        return Some("velocity above the cruise limit");
    }
    if moved.abs() > u.abs().max(cruise(moved)) + POSITION_STEP {
        return Some("position moves faster than the velocity limit");
    }
    // With |acceleration| ≤ a the mean velocity of a tick differs by at most a/4 from that of its ends.
    // It may have been at rest before the last tick ends.
    let bend = if after.done { a / 2.0 } else { a / 4.0 };
    if (moved - (u + v) / 2.0).abs() > bend + POSITION_STEP {
        return Some("position is not the integral of the velocity");
    }
    None
}

/// A plain move goes one way and never past its end.
fn plain_fault(before: SetPoint, after: SetPoint, (start, end): (Counts, Counts)) -> Option<&'static str> {
    let (from, to) = if end >= start { (before, after) } else { (after, before) };
    if from.position > to.position {
        return Some("moves backwards");
    }
    (!(start.min(end)..=start.max(end)).contains(&after.position)).then_some("crosses the end")
}

struct Stretch {
    limits: MoveLimits,
    end: Counts,
    /// Its start, if it started from rest.
    plain_from: Option<Counts>,
}

impl Stretch {
    fn run(&self, profile: &mut Profile, ticks: u32) -> u32 {
        let was = *profile;
        let mut before = was.current();
        for tick in 0..ticks {
            if before.done {
                return tick;
            }
            let after = profile.step(&self.limits.build(), Reach::FREE);
            let fault = tick_fault(before, after, self.limits)
                .or_else(|| plain_fault(before, after, (self.plain_from?, self.end)));
            if let Some(fault) = fault {
                panic!("{fault} at tick {tick}: {before:?} {after:?} in {was:?}, {:?}", self.limits);
            }
            before = after;
        }
        ticks
    }

    /// Runs to the end and checks it; `None`, and nothing done, if that takes more than `most` ticks.
    fn finish(&self, profile: &mut Profile, most: f64) -> Option<()> {
        let was = *profile;
        let optimum = remaining(profile, self.end, self.limits);
        if optimum > most {
            return None;
        }
        // The cruise velocity is rounded to 2^-26 counts a tick, 2^-20 of the least. The last half of 1/1024 count is not waited for, and
        // the oracle knows the place of a moving set-point within one.
        let places = if self.plain_from.is_some() { 1.0 } else { 4.0 };
        let place = places * (POSITION_STEP / acceleration(self.limits)).sqrt();
        let slack = optimum * (-19_f64).exp2() + place + ORACLE_ERROR;
        let (earliest, latest) = (optimum - slack - EARLY, optimum + slack + LATE);
        // A set-point that would pass its end by less than a tick of braking ends there, or returns. So does one that is stopped by a
        // deceleration half of the velocity's last bit greater, 0.8 % at ACCEL 1.
        let before = profile.current();
        let (v, a) = (f64::from(before.velocity.0) / 1000.0, acceleration(self.limits));
        let left = f64::from(self.end.wrapping_sub(before.position).0) * v.signum();
        let braking = v * v / (2.0 * a);
        let most_beyond = a / 2.0 + braking * (-27_f64).exp2() / a;
        let passes = left >= 0.0 && (0.0..=most_beyond).contains(&(braking - left));
        let (earliest, latest) = if passes { (0.0, latest + RETURN) } else { (earliest, latest) };
        // A way of less than two ticks at full acceleration takes up to five: one to each velocity and one to rest.
        let latest = if optimum < 2.0 { latest.max(5.0) } else { latest };
        let ticks = f64::from(self.run(profile, latest as u32 + 1));
        let case = || format!("{was:?}, {:?}", self.limits);
        for last in [profile.current(), profile.step(&self.limits.build(), Reach::FREE)] {
            assert!(
                last.done && last.position == self.end && last.velocity == CountsPerSec::ZERO,
                "not at rest on the end after {ticks} ticks, optimum {optimum}: {last:?} in {}",
                case()
            );
        }
        assert!(ticks >= earliest && ticks <= latest, "took {ticks} ticks, optimum {optimum}, in {}", case());
        Some(())
    }
}

fn plain(start: Counts, end: Counts, limits: MoveLimits, most: f64) -> Option<()> {
    let mut profile = Profile::at_rest(start);
    profile.set_end(end);
    Stretch { limits, end, plain_from: Some(start) }.finish(&mut profile, most)
}

fn plain_move(random: &mut Random, most: f64) -> Option<()> {
    let (start, limits) = (random.position(), random.limits());
    plain(start, random.end(start), limits, most)
}

fn replanned_move(random: &mut Random, most: f64) -> Option<()> {
    let (start, mut limits) = (random.position(), random.limits());
    let mut end = random.end(start);
    let mut profile = Profile::at_rest(start);
    profile.set_end(end);
    for _ in 0..=random.next() % 3 {
        let share = random.uniform() * remaining(&profile, end, limits).min(most);
        Stretch { limits, end, plain_from: None }.run(&mut profile, share as u32);
        let before = profile.current();
        if !random.one_in(3) {
            end = random.end(before.position);
        }
        if !random.one_in(3) {
            let new = random.limits();
            limits = MoveLimits { accel: if random.one_in(2) { new.accel } else { limits.accel }, ..new };
        }
        profile.set_end(end);
        let after = profile.current();
        assert_eq!(
            (before.position, before.velocity),
            (after.position, after.velocity),
            "a new end steps the set-point"
        );
    }
    Stretch { limits, end, plain_from: None }.finish(&mut profile, most)
}

fn draw(seed: u64, cases: u32, most: f64, case: fn(&mut Random, f64) -> Option<()>) {
    let mut random = Random(seed);
    let mut done = 0;
    while done < cases {
        done += u32::from(case(&mut random, most).is_some());
    }
}

#[test]
fn half_a_million_plain_moves_keep_every_guarantee() {
    draw(0x5eed, 500_000, SHORT, plain_move);
}

#[test]
fn half_a_million_replanned_moves_keep_every_guarantee() {
    draw(0xfeed, 500_000, SHORT, replanned_move);
}

#[test]
fn longer_moves_keep_every_guarantee() {
    draw(0xbeef, 300, LONG, plain_move);
    draw(0xcafe, 300, LONG, replanned_move);
}

#[test]
fn longest_moves_keep_every_guarantee() {
    // The longest (68 minutes), the same with the longest ramps, the longest triangle; and two in between.
    for (accel, cruise) in [(65535, 16), (1, 16), (1, 4080), (8, 4080), (13, 1000)] {
        let cruise = CountsPerSec::from_int(cruise);
        let limits = MoveLimits { accel, closing: cruise, opening: cruise };
        let (low, high) = (Counts::from_int(-32767), Counts::from_int(32767));
        assert!(plain(low, high, limits, f64::INFINITY).is_some());
        assert!(plain(high, low, limits, f64::INFINITY).is_some());
    }
}

/// Decision 0002: 2·√(166/858.3) = 0.880 s, the manual's spread time.
#[test]
fn spread_takes_the_manuals_time() {
    let cruise = CountsPerSec::from_int(1000);
    let limits = MoveLimits { accel: 30, closing: cruise, opening: cruise };
    let mut profile = Profile::at_rest(Counts::ZERO);
    profile.set_end(Counts::from_int(166));
    let ticks = Stretch { limits, end: Counts::from_int(166), plain_from: Some(Counts::ZERO) };
    // 2·√166·1024/30 = 879.56 ms.
    assert_eq!(ticks.run(&mut profile, 1000), 880);
}
