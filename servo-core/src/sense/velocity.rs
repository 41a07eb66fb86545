//! Position between edges and velocity from edge time-stamps.
//!
//! A fading-memory g-h-k filter (position, velocity, acceleration; one gain from the age of its data) runs at
//! the edges only. Each edge says that the rotor was at a known boundary at a known time; what the boundaries'
//! places and the times lack is learned from the filter's own residuals: an offset for each edge of a motor
//! revolution, and one delay of all rising edges, because open-collector sensors fall sharply and rise late.
//!
//! A residual that keeps its sign is a manoeuvre, not placement: its mean over some edges, against the usual
//! size of residuals, shortens the memory and drops an acceleration that has ended.
//!
//! Between edges the filter predicts, never beyond the next boundary, and never faster than the next edge's
//! being absent allows: velocity then falls as 1/t and is zero after [`STILL`].
//!
//! Formats: positions and residuals in 2^-16 count, velocity in 2^-16 counts/s, acceleration in 2^-8
//! counts/s², rates in 2^-12 Hz, gains in 2^-16.

use crate::num::{mul_shift, saturating_i16, saturating_signed};
use crate::sense::hall::{Direction, HallEdge};
use crate::units::{Counts, CountsPerSec, Micros};
use fixed::types::{I16F16, I22F10};

#[cfg(test)]
mod tests;

/// No edge for this long is standstill.
pub const STILL: Micros = Micros(300_000);

/// 1.0 as a gain, and one count.
const ONE: i32 = 1 << 16;
/// Memory of the filter at speed, 1/τ in 2^-16/µs · 2^16: τ = 30 ms, where noise of the placement and lag at
/// ramps are equal in recordings of slow spindles (500 counts/s²).
const AGE_PER_US: i32 = 143_166;
/// The most that one edge ages the memory when nothing is going on: 0.4, so that about five edges always count
/// and a single late one cannot swing the velocity.
const AGE_STEADY: i32 = 26_214;
/// The most in a manoeuvre, where two edges must do.
const AGE_MANOEUVRE: i32 = 78_643;
/// Slower edges than this cannot show a manoeuvre that matters: 0.3 counts in 10 ms is 6000 counts/s², a tenth
/// of what the motor can do, and slow rotors rock over their cogs.
const QUICK_US: u32 = 10_000;
/// Residuals are taken to be at least this large, 0.03 counts: ±2° electrical.
const NOISE_FLOOR: i32 = 1966;
/// A residual beyond this, 0.3 counts, is no placement error (±10° electrical is 0.17 counts) and not learned.
const LEARNABLE: i32 = 19_661;
/// A residual beyond this, 16 counts, means that edges were not seen for long: begin anew.
const LOST: i32 = 16 * ONE;
/// Shortest time between edges that is reckoned with; also where a learned delay turns their order.
const SHORTEST_US: u32 = 100;
/// Highest learned delay of rising edges, in µs.
const DELAY_MAX: i32 = 400;
/// Highest acceleration believed, counts/s²: the motor's torque gives 70,000.
const ACCEL_MAX: i32 = 80_000 << 8;
/// The acceleration is believed for this long after an edge.
const ACCEL_US: u32 = 30_000;
/// Edges after which the growing memory is as long as the fading one.
const GROWN: u8 = 20;

/// Least-squares gains of the n-th edge of a straight line, (position, velocity): all edges weigh the same
/// until the memory is full.
const GROWING: [(i32, i32); 20] = [
    (ONE, ONE),
    (ONE, ONE),
    (ONE, ONE),
    (54_613, 32_768),
    (45_875, 19_661),
    (39_322, 13_107),
    (34_328, 9362),
    (30_427, 7022),
    (27_307, 5461),
    (24_758, 4369),
    (22_641, 3575),
    (20_853, 2979),
    (19_323, 2521),
    (18_004, 2161),
    (16_852, 1872),
    (15_838, 1638),
    (14_939, 1446),
    (14_136, 1285),
    (13_414, 1150),
    (12_762, 1035),
];

/// What the edges have told of the motion.
#[derive(Clone, Copy, Debug)]
struct Motion {
    /// When the last edge truly was.
    at: Micros,
    /// Cell count ± ½: the number of the boundary last crossed, at number − ½ counts.
    boundary: i32,
    /// Whether the line rose there.
    rising: bool,
    /// +1, −1; 0 before the first edge.
    sign: i32,
    /// Edges since the motion began, to `GROWN`.
    edges: u8,
    /// Where that boundary really is, from number − ½.
    place: i32,
    /// Filtered position, from number − ½.
    position: i32,
    velocity: i32,
    acceleration: i32,
    /// Mean residual: what is left of a manoeuvre.
    bias: i32,
    /// Mean size of a residual.
    noise: i32,
}

/// Estimates position and velocity of one motor, learning the places of `N` edges: the hall counts a revolution,
/// or a multiple.
#[derive(Clone, Debug)]
pub struct Estimator<const N: usize> {
    count: i32,
    motion: Motion,
    /// The motion before the last edge, in case that was a glitch.
    before: Motion,
    offsets: [i16; N],
    /// Delay of rising edges in 2^-8 µs.
    delay: i32,
}

impl<const N: usize> Estimator<N> {
    /// At rest in the middle of cell `count`, nothing learned.
    #[must_use]
    pub const fn new(count: i32) -> Self {
        let motion = Motion {
            at: Micros(0),
            boundary: count,
            rising: false,
            sign: 0,
            edges: 0,
            place: 0,
            position: 0,
            velocity: 0,
            acceleration: 0,
            bias: 0,
            noise: NOISE_FLOOR,
        };
        Self { count, motion, before: motion, offsets: [0; N], delay: 0 }
    }

    /// The learned delay of rising edges.
    #[must_use]
    pub const fn delay(&self) -> Micros {
        Micros((self.delay >> 8).unsigned_abs())
    }

    /// Takes a step of the count.
    pub fn edge(&mut self, edge: &HallEdge) {
        self.count = edge.count;
        if edge.bounce {
            self.motion = self.before;
            return;
        }
        self.before = self.motion;
        let sign = i32::from(edge.direction.sign());
        let boundary = match edge.direction {
            Direction::Closing => edge.count,
            Direction::Opening => edge.count.wrapping_add(1),
        };
        let late = if edge.rising { self.delay().0 } else { 0 };
        let at = Micros(edge.at.0.wrapping_sub(late));
        let place = self.offset(boundary);
        let m = &mut self.motion;
        let elapsed = since(m.at, at);
        let moved = boundary.wrapping_sub(m.boundary).saturating_mul(ONE).saturating_add(place);
        if sign != m.sign {
            // Crossed back: somewhere in between the rotor stood.
            *m = Motion {
                at,
                boundary,
                rising: edge.rising,
                sign,
                edges: 1,
                place,
                position: place,
                velocity: 0,
                acceleration: 0,
                bias: 0,
                ..*m
            };
            return;
        }
        let dt = elapsed.clamp(SHORTEST_US, STILL.0);
        let rate = saturating_signed(RATE / dt);
        let (expected, velocity) = m.predict(dt);
        let residual = moved.saturating_sub(expected);
        if m.edges < 2 || elapsed > STILL.0 || residual.saturating_abs() > LOST {
            let velocity = mul_shift(moved.saturating_sub(m.place), rate, 12);
            *m = Motion {
                at,
                boundary,
                rising: edge.rising,
                edges: 2,
                place,
                position: place,
                velocity,
                acceleration: 0,
                bias: 0,
                ..*m
            };
            return;
        }
        m.correct(residual, velocity, rate, dt);
        m.at = at;
        m.boundary = boundary;
        m.rising = edge.rising;
        m.position = place.saturating_sub(residual).saturating_add(m.position);
        m.place = place;
        if m.edges >= 12 && residual.saturating_abs() < LEARNABLE && edge.steps == 1 {
            self.learn(boundary, residual, edge.rising, dt);
        }
    }

    /// Offset of an edge, and the rising edges' delay, from a residual.
    fn learn(&mut self, boundary: i32, residual: i32, rising: bool, dt: u32) {
        if let Some(offset) = self.index(boundary).and_then(|k| self.offsets.get_mut(k)) {
            let old = i32::from(*offset);
            // A share of the residual, and a leak: a constant over all edges is not placement.
            *offset = saturating_i16(old.saturating_sub(residual >> 5).saturating_sub(old >> 9));
        }
        // A late edge finds the rotor short of where it is expected; residual · interval is the time.
        let short = along(if rising { residual.wrapping_neg() } else { residual }, self.motion.sign);
        let lag = mul_shift(short, saturating_signed(dt.min(2000)), 14);
        self.delay = self.delay.saturating_add(lag).clamp(0, DELAY_MAX << 8);
    }

    fn index(&self, boundary: i32) -> Option<usize> {
        let n = i32::try_from(N).ok().filter(|n| *n > 0)?;
        usize::try_from(boundary.rem_euclid(n)).ok()
    }

    fn offset(&self, boundary: i32) -> i32 {
        self.index(boundary).and_then(|k| self.offsets.get(k)).map_or(0, |o| i32::from(*o))
    }

    /// Position and velocity of the rotor at a time not before the last edge nor before an earlier call. The
    /// position is within the cell of the count. To be called at least each half hour: a standstill is noted
    /// here, before the clock's wrap makes the last edge look young.
    #[must_use]
    pub fn at(&mut self, now: Micros) -> (Counts, CountsPerSec) {
        let (position, velocity) = self.rotor(now);
        // From the centre of the cell, which is half a count past the boundary.
        let half = self.motion.sign.saturating_mul(ONE / 2);
        let within = position.saturating_sub(half).clamp(-ONE / 2, ONE / 2 - 64);
        let within = Counts(I22F10::from_bits(within >> 6));
        (Counts::from_int(self.count).wrapping_add(within), CountsPerSec(I16F16::from_bits(velocity)))
    }

    /// Position from the last boundary's number − ½, not beyond the next edge's place, and velocity.
    fn rotor(&mut self, now: Micros) -> (i32, i32) {
        let m = &self.motion;
        if m.sign == 0 {
            return (0, 0);
        }
        let elapsed = since(m.at, now);
        let dt = elapsed.min(STILL.0);
        let (position, velocity) = m.predict(dt);
        // The next edge's place: no edge yet, so the rotor is not there yet.
        let next = self.offset(m.boundary.wrapping_add(m.sign)).saturating_add(along(ONE, m.sign));
        let ahead = along(next.saturating_sub(m.place), m.sign).max(ONE / 8);
        let position = if m.sign > 0 { position.min(next) } else { position.max(next) };
        if elapsed >= STILL.0 {
            // Stays just as old as this from now on.
            let at = Micros(now.0.wrapping_sub(STILL.0));
            self.motion = Motion { at, edges: 1, position, velocity: 0, acceleration: 0, bias: 0, ..*m };
            return (position, 0);
        }
        let waited = dt.saturating_sub(self.delay().0).max(SHORTEST_US);
        let limit = mul_shift(ahead, saturating_signed(RATE / waited), 12);
        (position, if m.edges < 2 { 0 } else { velocity.max(limit.saturating_neg()).min(limit) })
    }

    /// As [`at`](Self::at), but undecided what a pattern is that repeats with the rotor: marks out of place, or a
    /// rotor that cogs over marks that are in place.
    ///
    /// The edges alone cannot tell. In the first case the rotor's speed is as even as `at` says; in the second it
    /// has a ripple, foretold by what is learned of the falling edges, which are sharp: they are the marks of a
    /// ruler, two counts apart by definition. This is the mean of the two readings, so it is wrong by half of
    /// that ripple at most, and is what to report of a rotor of which nothing else is known, as in a recording.
    /// It is not for a control loop, where half of a ripple that the rotor may not have would become torque.
    #[must_use]
    pub fn undecided(&mut self, now: Micros) -> (Counts, CountsPerSec) {
        let (position, velocity) = self.rotor(now);
        let m = &self.motion;
        if m.sign == 0 {
            return (Counts::from_int(self.count), CountsPerSec::ZERO);
        }
        // Edges fall and rise by turns.
        let back = if m.rising { m.sign } else { 0 };
        let fall = m.boundary.wrapping_sub(back);
        let next = fall.wrapping_add(m.sign.saturating_mul(2));
        let place = self.offset(fall);
        // Half of the way between the two: offsets are within ±½.
        let way = ONE.saturating_add((self.offset(next).saturating_sub(place) / 2).saturating_mul(m.sign));
        let marks = saturating_signed(u32::MAX / way.max(ONE / 2).unsigned_abs());
        let from_mark = position.saturating_add(back.saturating_mul(ONE)).saturating_mul(m.sign);
        let along = mul_shift(from_mark.saturating_sub(place.saturating_mul(m.sign)), marks, 16);
        let mean = (from_mark / 2).saturating_add(along / 2).clamp(0, 2 * ONE).saturating_mul(m.sign);
        let mark = Counts::from_int(fall).wrapping_sub(Counts(I22F10::ONE / 2));
        let velocity = mul_shift(velocity, marks.saturating_add(ONE), 17);
        (mark.wrapping_add(Counts(I22F10::from_bits(mean >> 6))), CountsPerSec(I16F16::from_bits(velocity)))
    }
}

/// Time from one stamp to another. A learned delay may turn two edges round: then it is none, not the clock's
/// whole range.
const fn since(earlier: Micros, later: Micros) -> u32 {
    let elapsed = later.wrapping_since(earlier).0;
    if elapsed > u32::MAX / 2 { 0 } else { elapsed }
}

/// A distance as seen in the direction of `sign`, +1 or −1.
const fn along(distance: i32, sign: i32) -> i32 {
    if sign < 0 { distance.wrapping_neg() } else { distance }
}

/// 1 MHz in 2^-12 Hz: divided by µs it is a rate.
const RATE: u32 = 4_096_000_000;

impl Motion {
    /// Position from the last boundary and velocity `dt` µs (≤ `STILL`) after the last edge.
    fn predict(&self, dt: u32) -> (i32, i32) {
        let seconds = seconds(dt);
        let bent = seconds.min(seconds_const(ACCEL_US));
        // a in 2^-8, time in 2^-31 s: 23 bits down is 2^-16 counts/s.
        let gain = mul_shift(self.acceleration, bent, 23);
        let velocity = self.velocity.saturating_add(gain);
        let straight = mul_shift(self.velocity, seconds, 31);
        if velocity != 0 && (velocity < 0) != (self.sign < 0) {
            // Slowed down to a stop: half the distance at full speed is its braking distance, or more.
            return (self.position.saturating_add(straight / 2), 0);
        }
        let extra = mul_shift(gain, seconds.saturating_sub(bent / 2), 31);
        (self.position.saturating_add(straight).saturating_add(extra), velocity)
    }

    /// One filter step; leaves in `position` the filtered deviation from the expected place.
    fn correct(&mut self, residual: i32, velocity: i32, rate: i32, dt: u32) {
        self.bias = self.bias.saturating_add(mul_shift(residual.saturating_sub(self.bias), 19_661, 16));
        let size = residual.saturating_abs().min(self.noise.saturating_mul(2));
        self.noise = self.noise.saturating_add(size.saturating_sub(self.noise) >> 5);
        // How much of a manoeuvre the residuals are: 2^-8, at most 1.5.
        let usual = self.noise.max(NOISE_FLOOR).unsigned_abs();
        let manoeuvre = saturating_signed((self.bias.unsigned_abs().min(1 << 20) << 8) / usual).min(384);
        let square = manoeuvre.saturating_mul(manoeuvre);
        let age = mul_shift(saturating_signed(dt.min(1 << 17)), AGE_PER_US, 16);
        let age = age.saturating_add(mul_shift(age, square, 16));
        let large = residual.saturating_abs() > LEARNABLE && dt < QUICK_US;
        let age = age.min(if large { AGE_MANOEUVRE } else { AGE_STEADY });
        // A motion that has just begun is accelerating.
        let age = if self.edges < 6 && dt < QUICK_US { AGE_MANOEUVRE } else { age };
        let (mut g, mut h, mut k) = gains(age);
        if let Some(&(g_growing, h_growing)) = GROWING.get(usize::from(self.edges)) {
            g = g.max(g_growing);
            h = h.max(h_growing);
            self.edges = self.edges.saturating_add(1).min(GROWN);
            if self.edges < 4 {
                k = 0;
            }
        }
        self.position = mul_shift(residual, g, 16);
        let pull = mul_shift(residual, rate, 12);
        let velocity = velocity.saturating_add(mul_shift(pull, h, 16));
        self.velocity = if (velocity < 0) == (self.sign < 0) { velocity } else { 0 };
        // 2^-16 · 2^-12 → 2^-8: 20 bits down.
        let bend = mul_shift(mul_shift(pull, k, 16), rate, 20);
        let mut acceleration = self.acceleration.saturating_add(bend).clamp(-ACCEL_MAX, ACCEL_MAX);
        if (self.bias < 0) != (acceleration < 0) {
            // The acceleration has ended: drop up to 0.7 of it.
            let share = mul_shift(manoeuvre, 205, 8).min(256);
            let share = mul_shift(share.saturating_mul(share), 45_875, 16);
            acceleration = acceleration.saturating_sub(mul_shift(acceleration, share, 16));
        }
        self.acceleration = acceleration;
    }
}

/// Gains of the fading memory for the age that an interval adds (2^-16, below 2).
fn gains(age: i32) -> (i32, i32, i32) {
    // y = 1 − e^−x ≈ x / (1 + x/2 + x²/12), 0.1 % high at x = 1.2.
    let square = mul_shift(age, age, 16);
    let under = ONE.saturating_add(age / 2).saturating_add(mul_shift(square, 5461, 16)).unsigned_abs();
    let y = saturating_signed((age.unsigned_abs() << 14) / (under >> 2));
    let y2 = mul_shift(y, y, 16);
    let y3 = mul_shift(y2, y, 16);
    let g = y.saturating_sub(y2).saturating_mul(3).saturating_add(y3);
    let h = y2.saturating_mul(3).saturating_sub(y3.saturating_add(y3 / 2));
    (g, h, y3)
}

/// Microseconds up to 0.99 s in 2^-31 s.
fn seconds(us: u32) -> i32 {
    seconds_const(us.min(STILL.0))
}

const fn seconds_const(us: u32) -> i32 {
    // 2^31 / 10^6 = 2147.48
    mul_shift(saturating_signed(us), 2_199_023, 10)
}
