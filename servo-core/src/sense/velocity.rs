//! Position between hall edges, and velocity, from the time stamps of the edges.
//!
//! # Design
//!
//! A fading-memory polynomial filter of second degree (a critically damped g-h-k filter; E. Brookner, *Tracking and
//! Kalman Filtering Made Easy*, Wiley 1998) runs once per edge. An edge says that the rotor was at a known boundary at a
//! known time. With p in counts, v in counts/s and a in counts/s² after the last edge, Δt the time since then in s and
//! τa = min(Δt, 30 ms), the prediction is
//!
//! ```text
//! v̂ = v + a·τa                          if that is negative: v̂ = 0, p̂ = p + v·Δt/2
//! p̂ = p + v·Δt + a·τa·(Δt − τa/2)
//! ```
//!
//! and an edge at the boundary z corrects it by the residual r = z − p̂ in counts. The gains have no unit:
//!
//! ```text
//! p = p̂ + g·r                g = 1 − β³               = 3y − 3y² + y³
//! v = v̂ + h·r/Δt             h = 1.5·(1 − β)²·(1 + β) = 3y² − 1.5y³
//! a = a + k·r/Δt²            k = (1 − β)³             = y³
//! β = e^−x, y = 1 − β ≈ x / (1 + x/2 + x²/12)
//! x = Δt/30 ms · (1 + m²), at most 0.4; 1.2 in a maneuver
//! ```
//!
//! Residuals that keep their sign are a maneuver. The bias b and the usual size n of the residuals, both in counts, give
//! its strength m, which shortens the memory. An acceleration against the bias has ended and is reduced:
//!
//! ```text
//! b = b + 0.3·(r − b)        n = n + (min(|r|, 2n) − n)/32        m = min(|b| / max(n, 0.03), 1.5)
//! a = a·(1 − 0.7·min(0.8·m, 1)²) if a and b differ in sign
//! ```
//!
//! While a motion begins, g and h are those of a growing-memory straight line through its i edges where these are larger:
//! g = 2(2i − 1)/(i(i + 1)), h = 6/(i(i + 1)).
//!
//! What the residuals show beyond motion is learned: a placement offset of each edge of a motor revolution,
//! o = o − r/32 − o/512 in counts, and one delay of all rising edges, d = d ± r·Δt/64, because open-collector sensors
//! fall sharply and rise late. A boundary is z = count ∓ ½ + o, and a rising edge happened d before its time stamp.
//!
//! Between edges the position never passes the next boundary, and the velocity never exceeds the distance to it over Δt,
//! since that edge has not come. The velocity is zero after [`STANDSTILL`].
//!
//! # Formats
//!
//! Positions and residuals in 2^-16 count, velocity in 2^-16 counts/s, acceleration in 2^-8 counts/s², rates (1/Δt) in
//! 2^-12 Hz, times in µs or 2^-32 s, gains in 2^-16.

use crate::num::{mul_low, mul_low_unsigned, mul_shift, mul_upper, saturating_i16, saturating_signed};
use crate::sense::hall::HallEdge;
use crate::units::{Counts, CountsPerSec, Micros};
use fixed::types::{I16F16, I22F10};

#[cfg(test)]
mod tests;

/// Standstill timeout: no edge for this long.
pub const STANDSTILL: Micros = Micros(300_000);

/// 1.0 as a gain, and one count.
const ONE: i32 = 1 << 16;
/// 1/τ of the memory in 2^-32/µs: τ = 30 ms, where placement noise and lag in ramps are equal in recordings of slow
/// spindles (500 counts/s²).
const AGE_PER_US: i32 = 143_166;
/// Largest x of an edge in steady motion, 0.4: about five edges always count, and one late edge cannot swing the velocity.
const AGE_STEADY: u32 = 26_214;
/// Largest x in a maneuver, 1.2, where two edges must do.
const AGE_MANEUVER: u32 = 78_643;
/// Slower edges than this show no maneuver that matters: 0.3 counts in 10 ms is 6000 counts/s², a tenth of what the motor
/// can do, and slow rotors rock over their cogs.
const FAST_EDGE_US: u32 = 10_000;
/// Last position within a cell, from its first boundary.
const CELL_END: i32 = ONE - 64;
/// Least value of n, 0.03 counts: ±2° electrical.
const NOISE_FLOOR: i32 = 1966;
/// A larger residual than this, 0.3 counts, is no placement error (±10° electrical is 0.17 counts) and not learned.
const MAX_LEARNED_RESIDUAL: i32 = 19_661;
/// A larger residual than this, 16 counts, restarts the filter: edges were missed for long.
const RESTART_RESIDUAL: i32 = 16 * ONE;
/// Steps beyond this are clamped; far more than a restart needs.
const MAX_STEPS: i32 = 1 << 13;
/// Shortest interval that the filter divides by, µs; also taken where a learned delay reverses two edges.
const MIN_INTERVAL_US: i32 = 100;
/// Time stamps out of order by up to this are simultaneous, µs: a learned delay reverses edges by up to 400 µs, and a tick
/// may be stamped before an edge that it waited for. Any other interval is a gap, of up to 71.4 minutes.
const REORDERED: i32 = 10_000;
/// Largest learned delay of rising edges, µs.
const MAX_DELAY_US: i32 = 400;
/// Largest |a|: the motor's torque gives 70,000 counts/s² (decision 0003).
const ACCEL_MAX: i32 = 80_000 << 8;
/// Largest v: fifteen times the motor's no-load speed.
const SPEED_MAX: i32 = 1 << 30;
/// Longest τa, µs.
const ACCEL_US: u32 = 30_000;

/// (g, h) of a growing-memory line by the number of its edges.
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

/// Positions count forward, in the rotor's direction, from the nominal place of the boundary last crossed, so velocity is
/// never negative.
#[derive(Clone, Copy, Debug)]
struct FilterState {
    /// Time of the last edge, less the learned delay.
    at: Micros,
    /// Number of the boundary last crossed, which is nominally at number − ½ counts.
    boundary: i32,
    index: usize,
    /// Where that boundary is: its offset.
    place: i32,
    next: i32,
    /// From `place` to `next`; at least 1/8 count.
    gap: u32,
    /// Last position within the cell that is before the next boundary.
    last: i32,
    /// Standing for [`STANDSTILL`] or longer; `at` then stays that far in the past.
    standing: bool,
    position: i32,
    /// 0..=`SPEED_MAX`.
    velocity: i32,
    /// Within ±`ACCEL_MAX`.
    acceleration: i32,
    bias: i32,
    noise: i32,
    /// +1 closing, −1 opening, 0 before the first edge.
    sign: i8,
    /// Edges since the motion began, up to the length of `GROWING`.
    edges: u8,
    rising: bool,
}

/// Estimates position and velocity of one motor and learns the places of its `N` edges. `N` is the number of hall counts
/// a revolution, or a multiple of it.
#[derive(Clone, Debug)]
pub struct Estimator<const N: usize> {
    count: i32,
    state: FilterState,
    /// State before the last edge, restored if that edge was a glitch.
    previous: FilterState,
    offsets: [i16; N],
    /// d in 2^-8 µs, 0..=`MAX_DELAY_US`.
    delay: i32,
}

impl<const N: usize> Estimator<N> {
    /// At rest in the middle of cell `count`, with nothing learned.
    #[must_use]
    pub fn new(count: i32) -> Self {
        let state = FilterState {
            at: Micros(0),
            boundary: count,
            index: Self::index(count),
            place: 0,
            next: ONE,
            gap: ONE.unsigned_abs(),
            last: CELL_END,
            standing: false,
            position: 0,
            velocity: 0,
            acceleration: 0,
            bias: 0,
            noise: NOISE_FLOOR,
            sign: 0,
            edges: 0,
            rising: false,
        };
        Self { count, state, previous: state, offsets: [0; N], delay: 0 }
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

    /// Time since the last step, at most [`STANDSTILL`]; that before the first one.
    #[must_use]
    pub fn quiet(&self, now: Micros) -> Micros {
        let stood = self.state.sign == 0;
        if stood { STANDSTILL } else { Micros(since(self.state.at, now).min(STANDSTILL.0)) }
    }

    /// Processes a step of the count.
    #[inline(never)]
    pub fn edge(&mut self, edge: &HallEdge) {
        self.count = edge.count;
        if edge.bounce {
            self.state = self.previous;
            return;
        }
        self.previous = self.state;
        let sign = edge.direction.sign();
        let closing = sign > 0;
        let boundary = if closing { edge.count } else { edge.count.wrapping_add(1) };
        let late = if edge.rising { self.delay().0 } else { 0 };
        let at = Micros(edge.at.0.wrapping_sub(late));
        let m = &self.state;
        let steps =
            if closing { boundary.wrapping_sub(m.boundary) } else { m.boundary.wrapping_sub(boundary) };
        let (index, place, moved) = if steps == 1 && sign == m.sign {
            (Self::neighbor(m.index, sign), m.next - ONE, m.next)
        } else {
            let index = Self::index(boundary);
            let place = self.offset(index, sign);
            (index, place, steps.clamp(-MAX_STEPS, MAX_STEPS) * ONE + place)
        };
        let elapsed = since(m.at, at);
        let next = self.offset(Self::neighbor(index, sign), sign) + ONE;
        let gap = (next - place).max(ONE / 8).unsigned_abs();
        let rising = edge.rising;
        let (last, standing, position) = (next.min(CELL_END), false, place);
        let here = FilterState {
            at,
            boundary,
            index,
            place,
            next,
            gap,
            last,
            standing,
            position,
            sign,
            rising,
            ..*m
        };
        if sign != m.sign {
            // The rotor reversed, so it stood in between.
            self.state = FilterState { edges: 1, velocity: 0, acceleration: 0, bias: 0, ..here };
            return;
        }
        let dt = elapsed.clamp(MIN_INTERVAL_US.unsigned_abs(), STANDSTILL.0);
        let rate = (RATE / dt).cast_signed();
        let (expected, velocity) = m.predict(dt.cast_signed(), seconds(dt.cast_signed()).min(ACCEL_WINDOW));
        let residual = moved - expected;
        if m.edges < 2 || elapsed > STANDSTILL.0 || residual.abs() > RESTART_RESIDUAL {
            let velocity = mul_shift(moved - m.place, rate, 12).clamp(0, SPEED_MAX);
            self.state = FilterState { edges: 2, velocity, acceleration: 0, bias: 0, ..here };
            return;
        }
        self.state = FilterState { velocity, ..here };
        let corrected = self.state.correct(residual, rate, dt);
        self.state.position = place - residual + corrected;
        if self.state.edges >= 12 && residual.abs() < MAX_LEARNED_RESIDUAL && edge.steps == 1 {
            self.learn(index, residual, edge.rising, dt);
        }
    }

    #[inline]
    fn learn(&mut self, index: usize, residual: i32, rising: bool, dt: u32) {
        let sign = self.state.sign;
        if let Some(offset) = self.offsets.get_mut(index) {
            let old = i32::from(*offset);
            // The leak removes what is common to all edges, which is not placement.
            *offset = saturating_i16(old - (forward(residual, sign) >> 5) - (old >> 9));
        }
        // A late rising edge has a negative residual. |r| < 2^15, Δt < 2^11 µs.
        let short = if rising { -residual } else { residual };
        let lag = (short * dt.min(2000).cast_signed()) >> 14;
        self.delay = (self.delay + lag).clamp(0, MAX_DELAY_US << 8);
    }

    fn index(boundary: i32) -> usize {
        let n = i32::try_from(N).ok().filter(|n| *n > 0);
        n.and_then(|n| usize::try_from(boundary.rem_euclid(n)).ok()).unwrap_or(0)
    }

    const fn neighbor(index: usize, sign: i8) -> usize {
        match (sign > 0, index) {
            (true, last) if last + 1 == N => 0,
            (true, _) => index + 1,
            (false, 0) => N - 1,
            (false, _) => index - 1,
        }
    }

    /// An offset as seen in the direction of `sign`.
    fn offset(&self, index: usize, sign: i8) -> i32 {
        forward(self.offsets.get(index).map_or(0, |o| i32::from(*o)), sign)
    }

    /// Position and velocity of the rotor at `now`, which is not before the last edge nor before an earlier call. The
    /// position is within the cell of the count. Call it at least once an hour: it records a standstill before the
    /// wrapping clock (71.6 minutes) makes the last edge look recent.
    #[must_use]
    #[inline]
    pub fn at(&mut self, now: Micros) -> (Counts, CountsPerSec) {
        let (position, velocity) = self.rotor(now);
        let sign = i32::from(self.state.sign);
        // From the center of the cell, half a count past the boundary.
        let within = (position.min(self.state.last).max(64) - ONE / 2) * sign;
        let within = Counts(I22F10::from_bits(within >> 6));
        let velocity = CountsPerSec(I16F16::from_bits(velocity * sign));
        (Counts::from_int(self.count).wrapping_add(within), velocity)
    }

    /// Position, possibly beyond the next boundary, and velocity, both forward.
    #[inline]
    fn rotor(&mut self, now: Micros) -> (i32, i32) {
        let m = &mut self.state;
        // Signed, because a signed product is one `SMULL`.
        let elapsed = now.wrapping_since(m.at).0.cast_signed();
        if (-REORDERED..ACCEL_US.cast_signed()).contains(&elapsed) {
            self.predict_no_edge(elapsed, seconds(elapsed))
        } else if m.standing {
            m.at = Micros(now.0.wrapping_sub(STANDSTILL.0));
            (m.position, 0)
        } else {
            self.rotor_late(now)
        }
    }

    /// [`Self::rotor`] later than `ACCEL_US` after an edge.
    #[inline(never)]
    fn rotor_late(&mut self, now: Micros) -> (i32, i32) {
        let m = &mut self.state;
        let elapsed = since(m.at, now);
        if elapsed < STANDSTILL.0 {
            return self.predict_no_edge(elapsed.cast_signed(), ACCEL_WINDOW);
        }
        if m.velocity != 0 || m.acceleration != 0 {
            (m.position, _) = m.predict(STANDSTILL.0.cast_signed(), ACCEL_WINDOW);
            (m.velocity, m.acceleration, m.bias) = (0, 0, 0);
        }
        m.position = m.position.min(m.next);
        m.edges = m.edges.min(1);
        m.at = Micros(now.0.wrapping_sub(STANDSTILL.0));
        m.standing = true;
        (m.position, 0)
    }

    /// Position and velocity `elapsed` µs (below `STANDSTILL`) after the last edge, given that the next edge has not come.
    /// `accel_window` as in [`FilterState::predict`].
    #[inline(always)]
    fn predict_no_edge(&self, elapsed: i32, accel_window: i32) -> (i32, i32) {
        let m = &self.state;
        let (position, velocity) = m.predict(elapsed, accel_window);
        let waited = (elapsed - (self.delay >> 8)).max(MIN_INTERVAL_US).cast_unsigned();
        let distance = mul_low_unsigned(velocity.cast_unsigned(), waited * SECOND_PER_US, 32);
        let velocity = if distance < m.gap { velocity } else { m.slower(waited).min(velocity) };
        (position, velocity)
    }

    /// As [`at`](Self::at), for an unknown rotor: the mean of two explanations of a pattern that repeats with the rotor.
    ///
    /// Edges alone cannot tell misplaced sensors, with which `at` is right, from a rotor that cogs, with which the sharp
    /// falling edges are evenly spaced. The mean is wrong by half of the learned ripple at most. Use it for recordings, not
    /// in a control loop, where a ripple that the rotor does not have becomes torque.
    #[must_use]
    pub fn undecided(&mut self, now: Micros) -> (Counts, CountsPerSec) {
        let (position, velocity) = self.rotor(now);
        let m = &self.state;
        let position = position.min(m.next);
        let sign = i32::from(m.sign);
        if sign == 0 {
            return (Counts::from_int(self.count), CountsPerSec::ZERO);
        }
        // Edges fall and rise alternately.
        let back = i32::from(m.rising);
        let fall = m.boundary.wrapping_sub(back * sign);
        let next = fall.wrapping_add(2 * sign);
        let place = self.offset(Self::index(fall), m.sign);
        let half = ONE.saturating_add(self.offset(Self::index(next), m.sign).saturating_sub(place) / 2);
        let marks = saturating_signed(u32::MAX / half.max(ONE / 2).unsigned_abs());
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

const fn forward(distance: i32, sign: i8) -> i32 {
    if sign < 0 { -distance } else { distance }
}

/// 1 MHz in 2^-12 Hz: divided by an interval in µs it is a rate.
const RATE: u32 = 4_096_000_000;

impl FilterState {
    /// p̂ and v̂ after `dt` µs (at most `STANDSTILL`), with `accel_window` = τa in 2^-32 s, at most [`ACCEL_WINDOW`].
    #[inline(always)]
    fn predict(&self, dt: i32, accel_window: i32) -> (i32, i32) {
        let time = seconds(dt);
        // |a| < 2^25 and τa < 2^27, so |gain| < 2^28.
        let gain = mul_low(self.acceleration, accel_window, 24);
        let velocity = self.velocity + gain;
        let straight = mul_upper(self.velocity, time);
        if velocity < 0 {
            // It came to a stop: braking takes at most half the distance at full speed.
            return (self.position + straight / 2, 0);
        }
        let extra = mul_upper(gain, time - (accel_window >> 1));
        (self.position + straight + extra, velocity)
    }

    /// The velocity that takes `waited` µs (at least 1) to the next boundary.
    #[cold]
    fn slower(&self, waited: u32) -> i32 {
        mul_shift(self.gap.cast_signed(), saturating_signed(RATE / waited.max(1)), 12)
    }

    /// One filter step from v̂ with |`residual`| ≤ `RESTART_RESIDUAL` = 2^20; returns g·r.
    fn correct(&mut self, residual: i32, rate: i32, dt: u32) -> i32 {
        self.bias = self.bias + mul_low(residual - self.bias, 19_661, 16);
        let size = residual.abs().min(2 * self.noise);
        self.noise = self.noise + ((size - self.noise) >> 5);
        // m in 2^-8.
        let usual = self.noise.max(NOISE_FLOOR).unsigned_abs();
        let maneuver = ((self.bias.unsigned_abs() << 8) / usual).min(384);
        let large = residual.abs() > MAX_LEARNED_RESIDUAL;
        let quick = dt < FAST_EDGE_US;
        // A motion that has just begun accelerates.
        let age = if quick && self.edges < 6 {
            AGE_MANEUVER
        } else {
            // Below 2^17 · 2.2 · (1 + 1.5²).
            let age = mul_low(dt.min(1 << 17).cast_signed(), AGE_PER_US, 16).unsigned_abs();
            let age = age + mul_low_unsigned(age, maneuver * maneuver, 16);
            age.min(if large && quick { AGE_MANEUVER } else { AGE_STEADY })
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
        // |r| ≤ 2^20 and rate ≤ 2^25.3: |pull| < 2^29.3 in 2^-12 counts/s.
        let pull = mul_low(residual, rate, 16);
        let velocity = (self.velocity >> 4) + mul_low(pull, h, 16);
        self.velocity = velocity.clamp(0, SPEED_MAX >> 4) << 4;
        let bend = mul_shift(mul_low(pull, k, 16), rate, 16).clamp(-2 * ACCEL_MAX, 2 * ACCEL_MAX);
        let acceleration = (self.acceleration + bend).clamp(-ACCEL_MAX, ACCEL_MAX);
        self.acceleration = if (self.bias < 0) == (acceleration < 0) {
            acceleration
        } else {
            let share = ((maneuver * 205) >> 8).min(256);
            let share = ((share * share * 45_875) >> 16).cast_signed();
            acceleration - mul_low(acceleration, share, 16)
        };
        mul_low(residual, g, 16)
    }
}

/// (g, h, k) for x in 2^-16, at most `AGE_MANEUVER`: each 0..=2^16, h up to 1.5 times that.
fn gains(age: u32) -> (i32, i32, i32) {
    // The approximation is 0.1 % high at x = 1.2. Half of x squares below 2^31.
    let half = age / 2;
    let square = (half * half) >> 14;
    let under = (1 << 16) + half + ((square * 5461) >> 16);
    // y < 0.71, so y² fits.
    let y = (age << 14) / (under >> 2);
    let y2 = (y * y) >> 16;
    let y3 = (y2 * y) >> 16;
    let g = 3 * (y - y2) + y3;
    let h = 3 * y2 - y3 - y3 / 2;
    (g.cast_signed(), h.cast_signed(), y3.cast_signed())
}

/// A microsecond in 2^-32 s, 4294.97, rounded up.
const SECOND_PER_US: u32 = 4295;

/// Longest τa in 2^-32 s.
const ACCEL_WINDOW: i32 = seconds(ACCEL_US.cast_signed());

/// Microseconds up to `STANDSTILL` in 2^-32 s.
const fn seconds(us: i32) -> i32 {
    us * SECOND_PER_US.cast_signed()
}
