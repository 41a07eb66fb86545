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

use crate::num::{mul_low, mul_low_unsigned, mul_shift, mul_upper, saturating_i16, saturating_signed};
use crate::sense::hall::HallEdge;
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
const AGE_STEADY: u32 = 26_214;
/// The most in a manoeuvre, where two edges must do.
const AGE_MANOEUVRE: u32 = 78_643;
/// Slower edges than this cannot show a manoeuvre that matters: 0.3 counts in 10 ms is 6000 counts/s², a tenth
/// of what the motor can do, and slow rotors rock over their cogs.
const QUICK_US: u32 = 10_000;
/// The last place within a cell, from its boundary: 1/1024 before the other.
const CELL_END: i32 = ONE - 64;
/// Residuals are taken to be at least this large, 0.03 counts: ±2° electrical.
const NOISE_FLOOR: i32 = 1966;
/// A residual beyond this, 0.3 counts, is no placement error (±10° electrical is 0.17 counts) and not learned.
const LEARNABLE: i32 = 19_661;
/// A residual beyond this, 16 counts, means that edges were not seen for long: begin anew.
const LOST: i32 = 16 * ONE;
/// Most steps that are reckoned with.
const MOST_STEPS: i32 = 1 << 13;
/// Shortest time between edges that is reckoned with; also where a learned delay turns their order.
const SHORTEST_US: i32 = 100;
/// Time stamps out of order by up to this are simultaneous, µs: the learned delay reverses edges by up to 400 µs, and a
/// tick may be stamped before an edge that its computation waited for. Any other gap is a gap: of up to 71.5 minutes.
const REORDERED: i32 = 10_000;
/// Highest learned delay of rising edges, in µs.
const DELAY_MAX: i32 = 400;
/// Highest acceleration believed, counts/s²: the motor's torque gives 70,000.
const ACCEL_MAX: i32 = 80_000 << 8;
/// Highest velocity believed: fifteen times the motor's no-load speed.
const SPEED_MAX: i32 = 1 << 30;
/// The acceleration is believed for this long after an edge.
const ACCEL_US: u32 = 30_000;

/// Least-squares gains of the n-th edge of a straight line, (position, velocity): all edges weigh the same
/// until the memory is full: then it is as long as the fading one.
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

/// What the edges have told of the motion. Distances are counted forward, in the direction of the rotor, from the boundary
/// last crossed: velocity is never negative.
#[derive(Clone, Copy, Debug)]
struct Motion {
    /// When the last edge truly was.
    at: Micros,
    /// The number of the boundary last crossed, at number − ½ counts.
    boundary: i32,
    /// Its offset's.
    index: usize,
    /// Where that boundary really is.
    place: i32,
    /// Where the next one really is.
    next: i32,
    /// The way between the two, or what is reckoned with: at least an eighth of a count.
    ahead: u32,
    /// The last place before the next one that is within the cell.
    last: i32,
    /// At a standstill since `STILL` or longer; `at` is as long ago as that.
    still: bool,
    /// Filtered position.
    position: i32,
    /// 0..=`SPEED_MAX`.
    velocity: i32,
    /// Within ±`ACCEL_MAX`.
    acceleration: i32,
    /// Mean residual: what is left of a manoeuvre.
    bias: i32,
    /// Mean size of a residual.
    noise: i32,
    /// +1, −1; 0 before the first edge.
    sign: i8,
    /// Edges since the motion began, as far as `GROWING` goes.
    edges: u8,
    /// Whether the line rose at the boundary.
    rising: bool,
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
    /// Delay of rising edges in 2^-8 µs, 0..=`DELAY_MAX`.
    delay: i32,
}

impl<const N: usize> Estimator<N> {
    /// At rest in the middle of cell `count`, nothing learned.
    #[must_use]
    pub fn new(count: i32) -> Self {
        let motion = Motion {
            at: Micros(0),
            boundary: count,
            index: Self::index(count),
            place: 0,
            next: ONE,
            ahead: ONE.unsigned_abs(),
            last: CELL_END,
            still: false,
            position: 0,
            velocity: 0,
            acceleration: 0,
            bias: 0,
            noise: NOISE_FLOOR,
            sign: 0,
            edges: 0,
            rising: false,
        };
        Self { count, motion, before: motion, offsets: [0; N], delay: 0 }
    }

    /// The learned delay of rising edges.
    #[must_use]
    pub const fn delay(&self) -> Micros {
        Micros((self.delay >> 8).unsigned_abs())
    }

    /// The count after the last step.
    #[must_use]
    pub const fn count(&self) -> i32 {
        self.count
    }

    /// Takes a step of the count.
    #[inline(never)]
    pub fn edge(&mut self, edge: &HallEdge) {
        self.count = edge.count;
        if edge.bounce {
            self.motion = self.before;
            return;
        }
        self.before = self.motion;
        let sign = edge.direction.sign();
        let closing = sign > 0;
        let boundary = if closing { edge.count } else { edge.count.wrapping_add(1) };
        let late = if edge.rising { self.delay().0 } else { 0 };
        let at = Micros(edge.at.0.wrapping_sub(late));
        let m = &self.motion;
        let steps =
            if closing { boundary.wrapping_sub(m.boundary) } else { m.boundary.wrapping_sub(boundary) };
        let (index, place, moved) = if steps == 1 && sign == m.sign {
            // As a rule it is the next boundary, and known.
            (Self::beside(m.index, sign), m.next - ONE, m.next)
        } else {
            let index = Self::index(boundary);
            let place = self.offset(index, sign);
            // Below 2^30, and far more than `LOST`.
            (index, place, steps.clamp(-MOST_STEPS, MOST_STEPS) * ONE + place)
        };
        let elapsed = since(m.at, at);
        let next = self.offset(Self::beside(index, sign), sign) + ONE;
        let ahead = (next - place).max(ONE / 8).unsigned_abs();
        let rising = edge.rising;
        let (last, still, position) = (next.min(CELL_END), false, place);
        let here =
            Motion { at, boundary, index, place, next, ahead, last, still, position, sign, rising, ..*m };
        if sign != m.sign {
            // Crossed back: somewhere in between the rotor stood.
            self.motion = Motion { edges: 1, velocity: 0, acceleration: 0, bias: 0, ..here };
            return;
        }
        let dt = elapsed.clamp(SHORTEST_US.unsigned_abs(), STILL.0);
        let rate = (RATE / dt).cast_signed();
        // Below 2^29.
        let (expected, velocity) = m.predict(dt.cast_signed(), seconds(dt.cast_signed()).min(ACCEL_WINDOW));
        let residual = moved - expected;
        if m.edges < 2 || elapsed > STILL.0 || residual.abs() > LOST {
            let velocity = mul_shift(moved - m.place, rate, 12).clamp(0, SPEED_MAX);
            self.motion = Motion { edges: 2, velocity, acceleration: 0, bias: 0, ..here };
            return;
        }
        self.motion = Motion { velocity, ..here };
        let corrected = self.motion.correct(residual, rate, dt);
        self.motion.position = place - residual + corrected;
        if self.motion.edges >= 12 && residual.abs() < LEARNABLE && edge.steps == 1 {
            self.learn(index, residual, edge.rising, dt);
        }
    }

    /// Offset of an edge, and the rising edges' delay, from a residual.
    #[inline]
    fn learn(&mut self, index: usize, residual: i32, rising: bool, dt: u32) {
        let sign = self.motion.sign;
        if let Some(offset) = self.offsets.get_mut(index) {
            let old = i32::from(*offset);
            // A share of the residual, and a leak: a constant over all edges is not placement.
            *offset = saturating_i16(old - (along(residual, sign) >> 5) - (old >> 9));
        }
        // A late edge finds the rotor short of where it is expected; residual · interval is the time: < 2^15 · 2^11.
        let short = if rising { -residual } else { residual };
        let lag = (short * dt.min(2000).cast_signed()) >> 14;
        self.delay = (self.delay + lag).clamp(0, DELAY_MAX << 8);
    }

    /// Which offset is a boundary's.
    fn index(boundary: i32) -> usize {
        let n = i32::try_from(N).ok().filter(|n| *n > 0);
        n.and_then(|n| usize::try_from(boundary.rem_euclid(n)).ok()).unwrap_or(0)
    }

    /// The next one, in the direction of `sign`.
    const fn beside(index: usize, sign: i8) -> usize {
        match (sign > 0, index) {
            (true, last) if last + 1 == N => 0,
            (true, _) => index + 1,
            (false, 0) => N - 1,
            (false, _) => index - 1,
        }
    }

    /// An offset, forward where that is `sign`.
    fn offset(&self, index: usize, sign: i8) -> i32 {
        along(self.offsets.get(index).map_or(0, |o| i32::from(*o)), sign)
    }

    /// Position and velocity of the rotor at `now`, which is not before the last edge nor before an earlier call. The
    /// position is within the cell of the count. Call it at least once an hour: it records a standstill before the
    /// wrapping clock (71.6 minutes) makes the last edge look recent.
    #[must_use]
    #[inline]
    pub fn at(&mut self, now: Micros) -> (Counts, CountsPerSec) {
        let (position, velocity) = self.rotor(now);
        let sign = i32::from(self.motion.sign);
        // From the centre of the cell, which is half a count past the boundary.
        let within = (position.min(self.motion.last).max(64) - ONE / 2) * sign;
        let within = Counts(I22F10::from_bits(within >> 6));
        let velocity = CountsPerSec(I16F16::from_bits(velocity * sign));
        (Counts::from_int(self.count).wrapping_add(within), velocity)
    }

    /// Position, maybe beyond the next edge's place, and velocity; forward.
    #[inline]
    fn rotor(&mut self, now: Micros) -> (i32, i32) {
        let m = &mut self.motion;
        // Signed, because a signed product is one `SMULL`.
        let elapsed = now.wrapping_since(m.at).0.cast_signed();
        if (-REORDERED..ACCEL_US.cast_signed()).contains(&elapsed) {
            self.predict_no_edge(elapsed, seconds(elapsed))
        } else if m.still {
            m.at = Micros(now.0.wrapping_sub(STILL.0));
            (m.position, 0)
        } else {
            self.rotor_late(now)
        }
    }

    /// The rest of [`Self::rotor`]: it slows down, and then stands.
    #[inline(never)]
    fn rotor_late(&mut self, now: Micros) -> (i32, i32) {
        let m = &mut self.motion;
        let elapsed = since(m.at, now);
        if elapsed < STILL.0 {
            return self.predict_no_edge(elapsed.cast_signed(), ACCEL_WINDOW);
        }
        // It has gone as far as it will, and stays just as long ago as this from now on.
        if m.velocity != 0 || m.acceleration != 0 {
            (m.position, _) = m.predict(STILL.0.cast_signed(), ACCEL_WINDOW);
            (m.velocity, m.acceleration, m.bias) = (0, 0, 0);
        }
        m.position = m.position.min(m.next);
        m.edges = m.edges.min(1);
        m.at = Micros(now.0.wrapping_sub(STILL.0));
        m.still = true;
        (m.position, 0)
    }

    /// Position and velocity `elapsed` µs (≤ `STILL`) after the last edge, given that the next has not come. For `accel_window` see
    /// [`Motion::predict`].
    #[inline(always)]
    fn predict_no_edge(&self, elapsed: i32, accel_window: i32) -> (i32, i32) {
        let m = &self.motion;
        let (position, velocity) = m.predict(elapsed, accel_window);
        // All of the way takes longer than the wait, or it is slower. Below 2^19 and 2^17, so the difference has a sign.
        let waited = (elapsed - (self.delay >> 8)).max(SHORTEST_US).cast_unsigned();
        // Nothing is negative here, so it is one `UMULL`.
        let way = mul_low_unsigned(velocity.cast_unsigned(), waited * SECOND, 32);
        let velocity = if way < m.ahead { velocity } else { m.slower(waited).min(velocity) };
        (position, velocity)
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
        let position = position.min(m.next);
        let sign = i32::from(m.sign);
        if sign == 0 {
            return (Counts::from_int(self.count), CountsPerSec::ZERO);
        }
        // Edges fall and rise by turns.
        let back = i32::from(m.rising);
        let fall = m.boundary.wrapping_sub(back * sign);
        let next = fall.wrapping_add(2 * sign);
        let place = self.offset(Self::index(fall), m.sign);
        // Half of the way between the two: offsets are within ±½.
        let way = ONE.saturating_add(self.offset(Self::index(next), m.sign).saturating_sub(place) / 2);
        let marks = saturating_signed(u32::MAX / way.max(ONE / 2).unsigned_abs());
        let from_mark = position.saturating_add(back.saturating_mul(ONE));
        let along = mul_shift(from_mark.saturating_sub(place), marks, 16);
        let mean = (from_mark / 2).saturating_add(along / 2).clamp(0, 2 * ONE).saturating_mul(sign);
        let mark = Counts::from_int(fall).wrapping_sub(Counts(I22F10::ONE / 2));
        let velocity = mul_shift(velocity, marks.saturating_add(ONE), 17).saturating_mul(sign);
        (mark.wrapping_add(Counts(I22F10::from_bits(mean >> 6))), CountsPerSec(I16F16::from_bits(velocity)))
    }
}

/// Time from one stamp to another; 0 if `later` is up to [`REORDERED`] before `earlier`.
const fn since(earlier: Micros, later: Micros) -> u32 {
    let elapsed = later.wrapping_since(earlier).0;
    if elapsed > u32::MAX - REORDERED.unsigned_abs() { 0 } else { elapsed }
}

/// A distance as seen in the direction of `sign`, +1 or −1.
const fn along(distance: i32, sign: i8) -> i32 {
    if sign < 0 { -distance } else { distance }
}

/// 1 MHz in 2^-12 Hz: divided by µs it is a rate.
const RATE: u32 = 4_096_000_000;

impl Motion {
    /// Position and velocity `dt` µs (≤ `STILL`) after the last edge, with the acceleration in the first `accel_window` of it, in
    /// 2^-32 s, at most [`ACCEL_WINDOW`].
    #[inline(always)]
    fn predict(&self, dt: i32, accel_window: i32) -> (i32, i32) {
        let time = seconds(dt);
        // a < 2^25 in 2^-8, time < 2^27 in 2^-32 s: 24 bits down is below 2^28 in 2^-16 counts/s.
        let gain = mul_low(self.acceleration, accel_window, 24);
        // Below 2^30 + 2^28.
        let velocity = self.velocity + gain;
        // Below 2^30 · 0.3 s, and below 2^28 of that.
        let straight = mul_upper(self.velocity, time);
        if velocity < 0 {
            // Slowed down to a stop: half the distance at full speed is its braking distance, or more.
            return (self.position + straight / 2, 0);
        }
        let extra = mul_upper(gain, time - (accel_window >> 1));
        (self.position + straight + extra, velocity)
    }

    /// The velocity that takes `waited` µs (at least 1) for the way to the next boundary.
    #[cold]
    fn slower(&self, waited: u32) -> i32 {
        mul_shift(self.ahead.cast_signed(), saturating_signed(RATE / waited.max(1)), 12)
    }

    /// One filter step from the velocity predicted, with |residual| ≤ `LOST` = 2^20; gives the filtered deviation from the
    /// expected place.
    fn correct(&mut self, residual: i32, rate: i32, dt: u32) -> i32 {
        // Both stay within what they follow: 2^20.
        self.bias = self.bias + mul_low(residual - self.bias, 19_661, 16);
        let size = residual.abs().min(2 * self.noise);
        self.noise = self.noise + ((size - self.noise) >> 5);
        // How much of a manoeuvre the residuals are: 2^-8, at most 1.5.
        let usual = self.noise.max(NOISE_FLOOR).unsigned_abs();
        let manoeuvre = ((self.bias.unsigned_abs() << 8) / usual).min(384);
        let large = residual.abs() > LEARNABLE;
        let quick = dt < QUICK_US;
        // A motion that has just begun is accelerating.
        let age = if quick && self.edges < 6 {
            AGE_MANOEUVRE
        } else {
            // < 2^17 · 2.2, and 1 + 1.5² times as much: below 2^20 · 2^18 before the shift.
            let age = mul_low(dt.min(1 << 17).cast_signed(), AGE_PER_US, 16).unsigned_abs();
            let age = age + mul_low_unsigned(age, manoeuvre * manoeuvre, 16);
            age.min(if large && quick { AGE_MANOEUVRE } else { AGE_STEADY })
        };
        let (mut g, mut h, mut k) = gains(age);
        if let Some(&(g_growing, h_growing)) = GROWING.get(usize::from(self.edges)) {
            g = g.max(g_growing);
            h = h.max(h_growing);
            self.edges += 1;
            if self.edges < 4 {
                k = 0;
            }
        }
        // Residual ≤ 2^20 and rate ≤ 2^25.3: in 2^-12 counts/s below 2^29.3, and the velocity below 2^26.3.
        let pull = mul_low(residual, rate, 16);
        let velocity = (self.velocity >> 4) + mul_low(pull, h, 16);
        self.velocity = velocity.clamp(0, SPEED_MAX >> 4) << 4;
        // 2^-12 · 2^-12 → 2^-8: 16 bits down; saturated, and the acceleration is below 2^25.
        let bend = mul_shift(mul_low(pull, k, 16), rate, 16).clamp(-2 * ACCEL_MAX, 2 * ACCEL_MAX);
        let acceleration = (self.acceleration + bend).clamp(-ACCEL_MAX, ACCEL_MAX);
        self.acceleration = if (self.bias < 0) == (acceleration < 0) {
            acceleration
        } else {
            // The acceleration has ended: drop up to 0.7 of it.
            let share = ((manoeuvre * 205) >> 8).min(256);
            let share = ((share * share * 45_875) >> 16).cast_signed();
            acceleration - mul_low(acceleration, share, 16)
        };
        mul_low(residual, g, 16)
    }
}

/// Gains of the fading memory for the age that an interval adds (2^-16, at most `AGE_MANOEUVRE`): 0..=2^16 each, 1.5 for
/// the second.
fn gains(age: u32) -> (i32, i32, i32) {
    // y = 1 − e^−x ≈ x / (1 + x/2 + x²/12), 0.1 % high at x = 1.2. Half of the age squares below 2^31.
    let half = age / 2;
    let square = (half * half) >> 14;
    let under = (1 << 16) + half + ((square * 5461) >> 16);
    // y < 0.71, so no square passes 2^32.
    let y = (age << 14) / (under >> 2);
    let y2 = (y * y) >> 16;
    let y3 = (y2 * y) >> 16;
    let g = 3 * (y - y2) + y3;
    let h = 3 * y2 - y3 - y3 / 2;
    (g.cast_signed(), h.cast_signed(), y3.cast_signed())
}

/// A microsecond in 2^-32 s: 4294.97, of which this is 8 millionths more.
const SECOND: u32 = 4295;

/// `ACCEL_US` in 2^-32 s.
const ACCEL_WINDOW: i32 = seconds(ACCEL_US.cast_signed());

/// Microseconds up to `STILL` in 2^-32 s.
const fn seconds(us: i32) -> i32 {
    us * SECOND.cast_signed()
}
