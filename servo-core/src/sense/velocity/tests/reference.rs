//! The equations of the head of `velocity.rs` in exact arithmetic, step by step beside the filter: from the filter's state before an edge,
//! its state after it; from its state at a time, its output.

use super::super::{Estimator, FilterState, MAX_DELAY_US, ONE, SPEED_MAX, STANDSTILL};
use crate::sense::hall::{Direction, HallEdge};
use crate::units::Micros;

/// Fractions of 2^-40.
const FRACTION: u32 = 40;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Exact(i128);

impl Exact {
    const ZERO: Self = Self(0);

    const fn of(bits: i32, fraction: u32) -> Self {
        Self((bits as i128) << (FRACTION - fraction))
    }

    const fn ratio(numerator: i64, denominator: i64) -> Self {
        Self(((numerator as i128) << FRACTION) / denominator as i128)
    }

    const fn int(value: i64) -> Self {
        Self((value as i128) << FRACTION)
    }

    fn abs(self) -> Self {
        Self(self.0.abs())
    }

    /// Whether a number with this fraction is nearer than `tolerance`.
    fn is_near(self, bits: i32, fraction: u32, tolerance: Self) -> bool {
        (self - Self::of(bits, fraction)).abs() <= tolerance
    }
}

impl core::ops::Add for Exact {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0 + other.0)
    }
}

impl core::ops::Sub for Exact {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0 - other.0)
    }
}

impl core::ops::Mul for Exact {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self((self.0 * other.0) >> FRACTION)
    }
}

impl core::ops::Div for Exact {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        Self((self.0 << FRACTION) / other.0)
    }
}

fn seconds(us: u32) -> Exact {
    Exact::ratio(us.into(), 1_000_000)
}

/// p̂ and v̂ after so many µs.
fn predicted(of: &FilterState, us: u32) -> (Exact, Exact) {
    let (p, v) = (Exact::of(of.position, 16), Exact::of(of.velocity, 16));
    let a = Exact::of(of.acceleration, 8);
    let (dt, window) = (seconds(us), seconds(us.min(30_000)));
    let half = Exact::ratio(1, 2);
    let velocity = v + a * window;
    if velocity < Exact::ZERO {
        return (p + v * dt * half, Exact::ZERO);
    }
    (p + v * dt + a * window * (dt - window * half), velocity)
}

/// g, h and k, for m in 2^-8 as the filter rounds it, with `edges` of the motion before this one.
fn gains(us: u32, m: i64, edges: u8, residual: Exact) -> [Exact; 3] {
    let (is_quick, is_large) = (us < 10_000, residual.abs() > Exact::of(19_661, 16));
    let x = Exact::ratio(us.into(), 30_000) * (Exact::int(1) + Exact::ratio(m * m, 65_536));
    let x = match (is_quick, is_large) {
        (true, _) if edges < 6 => Exact::ratio(12, 10),
        (true, true) => x.min(Exact::ratio(12, 10)),
        _ => x.min(Exact::ratio(4, 10)),
    };
    let y = x / (Exact::int(1) + x * Exact::ratio(1, 2) + x * x * Exact::ratio(1, 12));
    let (y2, y3) = (y * y, y * y * y);
    let steady = [
        Exact::int(3) * y - Exact::int(3) * y2 + y3,
        Exact::int(3) * y2 - Exact::ratio(3, 2) * y3,
        if edges < 3 { Exact::ZERO } else { y3 },
    ];
    let i = i64::from(edges);
    if i >= 20 {
        return steady;
    }
    let line = [Exact::ratio(2 * (2 * i - 1), i * (i + 1)), Exact::ratio(6, i * (i + 1)), Exact::ZERO];
    [0, 1, 2].map(|at| steady[at].max(line[at]))
}

/// The offset of a boundary as seen in a direction.
fn offset(e: &Estimator<18>, boundary: i32, sign: i32) -> Exact {
    Exact::of(sign * i32::from(e.offsets[boundary.rem_euclid(18) as usize]), 16)
}

struct Run {
    e: Estimator<18>,
    count: i32,
    now: u32,
    /// Edges that the filter corrected by, that restarted it, that reversed, that it learned from.
    seen: [u32; 4],
}

impl Run {
    fn new(start: i32) -> Self {
        let mut e = Estimator::new(start);
        for (at, offset) in e.offsets.iter_mut().enumerate() {
            *offset = [900, -2100, 40, -5, 3300, -700, 1500, -60, -2900][at % 9] + at as i16;
        }
        e.delay = 120 << 8;
        Self { e, count: start, now: 4_294_000_000, seen: [0; 4] }
    }

    fn edge(&mut self, us: u32, steps: i32) {
        let sign = steps.signum();
        let direction = if sign > 0 { Direction::Closing } else { Direction::Opening };
        self.now = self.now.wrapping_add(us);
        self.count += steps;
        let boundary = if sign > 0 { self.count } else { self.count + 1 };
        let rising = (boundary & 1 == 1) == (sign > 0);
        let before = self.e.clone();
        self.e.edge(&HallEdge {
            count: self.count,
            steps: steps.unsigned_abs() as u8,
            direction,
            at: Micros(self.now),
            rising,
            bounce: false,
            uncertain: false,
        });
        self.compare(&before, boundary, sign, rising, steps.abs());
    }

    fn compare(&mut self, before: &Estimator<18>, boundary: i32, sign: i32, rising: bool, steps: i32) {
        let (old, new) = (&before.state, &self.e.state);
        let late = if rising { (before.delay >> 8) as u32 } else { 0 };
        let at = self.now.wrapping_sub(late);
        assert_eq!((new.at.0, new.boundary, new.rising, new.standing), (at, boundary, rising, false));
        let place = offset(before, boundary, sign);
        let next = offset(before, boundary + sign, sign) + Exact::int(1);
        assert_eq!((Exact::of(new.place, 16), Exact::of(new.next, 16)), (place, next));
        assert_eq!(new.last, new.next.min(ONE - 64));
        assert_eq!(new.gap as i32, (new.next - new.place).max(ONE / 8));
        if i32::from(old.sign) != sign {
            self.seen[2] += 1;
            assert_eq!((new.velocity, new.acceleration, new.bias, new.edges), (0, 0, 0, 1));
            assert_eq!(new.position, new.place);
            return;
        }
        let elapsed = match at.wrapping_sub(old.at.0) {
            reversed if reversed > u32::MAX - 10_000 => 0,
            elapsed => elapsed,
        };
        let us = elapsed.clamp(100, STANDSTILL.0);
        let moved = Exact::int((sign * (boundary - old.boundary)).into()) + place;
        let (position, velocity) = predicted(old, us);
        let residual = moved - position;
        if old.edges < 2 || elapsed > STANDSTILL.0 || residual.abs() > Exact::int(16) {
            self.seen[1] += 1;
            let way = moved - Exact::of(old.place, 16);
            let velocity = (way / seconds(us)).max(Exact::ZERO).min(Exact::of(SPEED_MAX, 16));
            assert!(velocity.is_near(
                new.velocity,
                16,
                velocity * Exact::ratio(1, 10_000) + Exact::of(16, 16)
            ));
            assert_eq!((new.acceleration, new.bias, new.edges, new.position), (0, 0, 2, new.place));
            return;
        }
        self.seen[0] += 1;
        let least = Exact::of(4, 16) + position.abs() * Exact::ratio(1, 50_000);
        // b = b + 0.3·(r − b), n = n + (min(|r|, 2n) − n)/32.
        let (b, n) = (Exact::of(old.bias, 16), Exact::of(old.noise, 16));
        assert!((b + (residual - b) * Exact::ratio(3, 10)).is_near(new.bias, 16, least), "{old:?} {new:?}");
        let size = residual.abs().min(Exact::int(2) * n);
        assert!((n + (size - n) * Exact::ratio(1, 32)).is_near(new.noise, 16, least), "{old:?} {new:?}");
        let m = ((i64::from(new.bias).abs() << 8) / i64::from(new.noise.max(1966))).min(384);
        let [g, h, k] = gains(us, m, old.edges, residual);
        assert_eq!(new.edges, (old.edges + 1).min(20));
        // g is a sum of rounded products.
        let share = Exact::ratio(1, 4000) * residual.abs() + least;
        let corrected = place - residual + g * residual;
        assert!(corrected.is_near(new.position, 16, share), "{us} us: {corrected:?}, {old:?} {new:?}");
        let pull = residual / seconds(us);
        let wanted = (velocity + h * pull).max(Exact::ZERO).min(Exact::of(SPEED_MAX, 16));
        let tolerance =
            (pull.abs() + velocity) * Exact::ratio(1, 8000) + h * least / seconds(us) + Exact::of(40, 16);
        assert!(wanted.is_near(new.velocity, 16, tolerance), "{us} us: {wanted:?}, {old:?} {new:?}");
        let [bend, whole, blur] = [k * residual, residual, k * least].map(|r| r / seconds(us) / seconds(us));
        self.compare_acceleration(old, [bend, whole, blur], m);
        self.compare_learned(before, boundary, sign, rising, steps == 1, us, residual);
    }

    /// `bend` is k·r/Δt², of which the filter takes twice the largest acceleration at most; `whole` is r/Δt²; `blur` is what rounding of r
    /// makes of it.
    fn compare_acceleration(&self, old: &FilterState, [bend, whole, blur]: [Exact; 3], m: i64) {
        let new = &self.e.state;
        let most = Exact::int(80_000);
        let clamp = |value: Exact, most: Exact| value.min(most).max(Exact::ZERO - most);
        let bend = clamp(bend, Exact::int(160_000));
        let acceleration = clamp(Exact::of(old.acceleration, 8) + bend, most);
        // k is rounded to 2^-16 three times.
        let error = (whole.abs() * Exact::of(4, 16)).min(Exact::int(160_000))
            + bend.abs() * Exact::ratio(1, 2000)
            + blur;
        let agrees = (new.bias < 0) == (acceleration < Exact::ZERO);
        let share = (Exact::ratio(m, 256) * Exact::ratio(8, 10)).min(Exact::int(1));
        let kept = acceleration - acceleration * share * share * Exact::ratio(7, 10);
        let wanted = if agrees { acceleration } else { kept };
        let tolerance = error + acceleration.abs() * Exact::ratio(8, 1000) + Exact::of(16, 8);
        // Near zero its sign is within the rounding.
        if acceleration.abs() > error {
            assert!(wanted.is_near(new.acceleration, 8, tolerance), "{wanted:?}, {old:?} {new:?}");
        }
    }

    #[allow(clippy::too_many_arguments, reason = "what one edge says")]
    fn compare_learned(
        &mut self,
        before: &Estimator<18>,
        boundary: i32,
        sign: i32,
        rising: bool,
        is_single: bool,
        us: u32,
        residual: Exact,
    ) {
        let index = boundary.rem_euclid(18) as usize;
        let learns = before.state.edges >= 11 && residual.abs() < Exact::of(19_661, 16) && is_single;
        let (old, new) = (i32::from(before.offsets[index]), i32::from(self.e.offsets[index]));
        if !learns {
            assert_eq!((new, self.e.delay), (old, before.delay));
            return;
        }
        self.seen[3] += 1;
        let forward = if sign > 0 { residual } else { Exact::ZERO - residual };
        let o = Exact::of(old, 16);
        let wanted = o - forward * Exact::ratio(1, 32) - o * Exact::ratio(1, 512);
        assert!(wanted.is_near(new, 16, Exact::of(3, 16)), "{wanted:?} {old} {new}");
        // d in 2^-8 us.
        let short = if rising { Exact::ZERO - residual } else { residual };
        let lag = short * Exact::int(us.min(2000).into()) * Exact::ratio(1, 64);
        let wanted = Exact::of(before.delay, 8) + lag;
        let wanted = wanted.max(Exact::ZERO).min(Exact::int(MAX_DELAY_US.into()));
        assert!(wanted.is_near(self.e.delay, 8, Exact::of(2, 8)), "{wanted:?} {}", self.e.delay);
    }

    /// The output so many µs after the last edge.
    fn compare_output(&self, us: u32) {
        let m = self.e.state;
        let (position, velocity) = self.e.clone().at(Micros(m.at.0.wrapping_add(us)));
        let sign = i32::from(m.sign);
        if us >= STANDSTILL.0 {
            assert_eq!(velocity.0.to_bits(), 0);
            return self.compare_rest(position.0.to_bits());
        }
        let (p, v) = predicted(&m, us);
        let waited = seconds((i64::from(us) - i64::from(self.e.delay >> 8)).max(100) as u32);
        let next = Exact::of(m.gap as i32, 16) / waited;
        let wanted = v.min(next);
        // A microsecond is 8e-6 too long.
        let gained = Exact::of(m.acceleration, 8).abs() * seconds(us.min(30_000));
        let tolerance =
            wanted * Exact::ratio(1, 10_000) + gained * Exact::ratio(1, 100_000) + Exact::of(64, 16);
        assert!(
            wanted.is_near(sign * velocity.0.to_bits(), 16, tolerance),
            "{us} us: {wanted:?} {velocity:?} {m:?}"
        );
        let within = p.min(Exact::of(m.last, 16)).max(Exact::of(64, 16)) - Exact::ratio(1, 2);
        let found = sign * (position.0.to_bits() - self.e.count * 1024);
        let tolerance = p.abs() * Exact::ratio(1, 50_000) + Exact::of(2, 10);
        assert!(within.is_near(found, 10, tolerance), "{us} us: {within:?} {found} {m:?}");
    }

    /// At standstill the rotor is where it would have come, but in its cell. It stays there, and its next edge begins a motion.
    fn compare_rest(&self, position: i32) {
        let (old, sign) = (self.e.state, i32::from(self.e.state.sign));
        let (p, _) = predicted(&old, STANDSTILL.0);
        let within = p.min(Exact::of(old.last, 16)).max(Exact::of(64, 16)) - Exact::ratio(1, 2);
        let tolerance = p.abs() * Exact::ratio(1, 50_000) + Exact::of(2, 10);
        assert!(within.is_near(sign * (position - self.e.count * 1024), 10, tolerance), "{within:?} {old:?}");
        let mut e = self.e.clone();
        for us in [STANDSTILL.0, 7_000_000, 4_200_000_000] {
            let now = old.at.0.wrapping_add(us);
            assert_eq!((e.at(Micros(now)).0).0.to_bits(), position);
            let m = e.state;
            assert_eq!((m.velocity, m.acceleration, m.bias, m.standing), (0, 0, 0, true));
            assert_eq!((m.edges, m.at.0), (1, now.wrapping_sub(STANDSTILL.0)));
            assert!(m.position <= m.next);
        }
    }

    /// The mean of two explanations: `p` counts since the mark and its share of the way between the two marks.
    fn compare_undecided(&self, us: u32) {
        let m = self.e.state;
        let now = Micros(m.at.0.wrapping_add(us));
        let (position, velocity) = self.e.clone().undecided(now);
        let sign = i32::from(m.sign);
        let (p, v) = self.e.clone().rotor(now);
        let back = i32::from(m.rising);
        let fall = m.boundary - back * sign;
        let place = offset(&self.e, fall, sign);
        let half = Exact::int(1) + (offset(&self.e, fall + 2 * sign, sign) - place) * Exact::ratio(1, 2);
        let from_mark = Exact::of(p.min(m.next), 16) + Exact::int(back.into());
        let mean = (from_mark + (from_mark - place) / half) * Exact::ratio(1, 2);
        let mean = mean.max(Exact::ZERO).min(Exact::int(2));
        let found = sign * (position.0.to_bits() - (fall * 1024 - 512));
        assert!(mean.is_near(found, 10, Exact::of(3, 10)), "{us} us: {mean:?} {found} {m:?}");
        let wanted = Exact::of(v, 16) * (Exact::int(1) / half + Exact::int(1)) * Exact::ratio(1, 2);
        let tolerance = wanted.abs() * Exact::ratio(1, 10_000) + Exact::of(8, 16);
        assert!(
            wanted.is_near(sign * velocity.0.to_bits(), 16, tolerance),
            "{us} us: {wanted:?} {velocity:?}"
        );
    }
}

/// A sequence that looks random, 0..range.
struct Noise(u64);

impl Noise {
    fn below(&mut self, range: u32) -> u32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) % u64::from(range)) as u32
    }
}

/// Runs of both directions with all speeds, and jitter, ramps, missed edges, pauses.
#[test]
fn filter_follows_its_equations() {
    let mut run = Run::new(-20);
    let mut noise = Noise(1);
    let intervals: [u32; 10] = [90, 300, 1000, 2000, 2400, 5000, 9000, 11_000, 25_000, 70_000];
    for round in 0..400_u32 {
        let sign = if round % 3 == 0 { -1 } else { 1 };
        let from = intervals[noise.below(10) as usize];
        let to = if noise.below(2) == 0 { from } else { from / 2 + 50 };
        let jitter = [1, 3, 10, 60][noise.below(4) as usize];
        for k in 0..30 {
            let even = from + (to * k).saturating_sub(from * k) / 30;
            let us = even + even * noise.below(jitter) / 100;
            let (steps, us) = match noise.below(60) {
                0 => (2, us),
                1 => (1, us + 290_000),
                2 => (1, 310_000),
                3 => (30, us),
                _ => (1, us),
            };
            run.edge(us, sign * steps);
            if noise.below(4) == 0 {
                let times = [0, 60, 500, 1500, 7000, 29_999, 30_000, 120_000, 299_999, 300_000];
                times.iter().for_each(|&us| run.compare_output(us));
                times[..6].iter().for_each(|&us| run.compare_undecided(us));
            }
        }
    }
    // Each kind has happened often.
    assert!(run.seen.iter().all(|&count| count > 100), "{:?}", run.seen);
}
