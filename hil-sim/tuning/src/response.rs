//! A measured frequency response, and the stability margins of the loop that it describes.
//!
//! With L the open loop, S = 1/(1 + L) its sensitivity and T = L/(1 + L) the closed loop:
//!
//! ```text
//! phase margin   angle from −1 to L where |L| = 1                  gain margin   1/|L| where L < 0 is real
//! Ms             max |S|                                            bandwidth     first f with |T| < 1/√2
//! disk margin    α = 2/max |(1 − L)/(1 + L)|: the loop bears gains of (2 − α)/(2 + α) to (2 + α)/(2 − α) and, alone, phases of
//!                ±2·atan(α/2) (Seiler, Packard, Gahinet, An introduction to disk margins, 2020, with skew 0)
//! ```
//!
//! Between two points ln |L| and the phase are cubic in ln f: an integrator is a line, and a delay or a resonance is smooth. The slope at
//! a point is that of the parabola through it and its neighbors, bounded so that what rises from point to point rises in between.
//!
//! # Stability
//!
//! By Nyquist's criterion the closed loop has Z = P + 2(N₋ − N₊) unstable poles: P of the open loop, and N₋ and N₊ the crossings of the
//! real axis beyond −1 with falling and rising phase. P is not known. With N₋ > N₊ the closed loop is unstable whatever P is;
//! otherwise it is stable if P is the number that the crossings call for, which is 0 for nearly every loop. Below the first frequency the
//! response continues as its slope there says: −n as n integrators. A response that ends above 0 dB says nothing, nor does one that begins
//! above it with a phase that does not fit its slope.

use num_complex::Complex64;

#[cfg(test)]
mod tests;

/// Fewest points of a response: a cubic has four coefficients.
pub const FEWEST: usize = 4;

/// Steps in each interval when a peak is searched: a peak between two of them is refined by thirds.
const STEPS: usize = 16;

/// How far the first phase may be from that of the slope, or from its opposite, 60°: in the middle between the two are 90°.
const MOST_REST: f64 = std::f64::consts::FRAC_PI_3;

/// A peak of |S| above which the loop is −1 but for rounding.
const MOST_PEAK: f64 = 1e9;

/// Halvings of an interval or a section until f64 has no more digits.
const HALVINGS: usize = 60;

/// Phase step of two points above which their interpolation is a guess, degrees: nearer to 180° the direction is unknown.
const COARSE_DEG: f64 = 120.0;

/// A point of a response.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Frequency in Hz.
    pub hz: f64,
    /// The response.
    pub value: Complex64,
}

/// Why points are no response; `at` counts from 0.
#[derive(Clone, Debug, PartialEq)]
pub enum ResponseError {
    /// Fewer than [`FEWEST`] points.
    TooFew {
        /// How many.
        found: usize,
    },
    /// A frequency that is not finite or not above 0.
    Frequency {
        /// Which point.
        at: usize,
    },
    /// A frequency that is not above the last one.
    Order {
        /// Which point.
        at: usize,
    },
    /// A value that is not finite, or 0: it has no phase.
    Value {
        /// Which point.
        at: usize,
    },
}

/// A frequency response: points in order of their frequency, and what lies between them.
#[derive(Clone, Debug)]
pub struct Response {
    points: Vec<Point>,
    /// ln f, ln |L| and unwrapped phase in radians of each point, and the slopes of both over ln f.
    nodes: Vec<Node>,
}

#[derive(Clone, Copy, Debug)]
struct Node {
    x: f64,
    gain: f64,
    phase: f64,
    gain_slope: f64,
    phase_slope: f64,
}

/// A crossing of 0 dB.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct GainCrossing {
    /// Frequency, Hz.
    pub freq_hz: f64,
    /// Angle from −1 to the response, −180 to 180 degrees; positive on the side of a loop that falls from phase 0.
    pub phase_margin_deg: f64,
}

/// A crossing of −180° (and −540° ...).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct PhaseCrossing {
    /// Frequency, Hz.
    pub freq_hz: f64,
    /// Factor that takes the response to −1.
    pub factor: f64,
    /// Whether the phase rises there.
    pub rises: bool,
}

/// Margins of an open loop; `None` where they do not exist.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Margins {
    /// Smallest phase margin of all gain crossings, degrees; negative if the closed loop is unstable.
    pub phase_margin_deg: Option<f64>,
    /// Smallest factor above 1 that takes the loop to −1; of an unstable loop without one, the largest below 1.
    pub gain_margin: Option<f64>,
    /// Largest factor below 1 that takes the loop to −1.
    pub gain_margin_low: Option<f64>,
    /// Ms: the peak of |S| in the band; infinite if the loop is −1 there.
    pub ms: f64,
    /// Where that is, Hz.
    pub ms_hz: f64,
    /// α: the disk margin, 0 to 2.
    pub disk_margin: Option<f64>,
    /// First frequency at which |T| falls to 1/√2, Hz.
    pub bandwidth_hz: Option<f64>,
    /// The gain crossing of the phase margin, Hz.
    pub crossover_hz: Option<f64>,
    /// The phase crossing of the gain margin, Hz.
    pub phase_crossover_hz: Option<f64>,
    /// Delay that takes the loop to −1, ms; none of an unstable loop.
    pub delay_margin_ms: Option<f64>,
    /// Whether the closed loop is stable, as far as the band shows (see above).
    pub stable: Option<bool>,
    /// Every crossing of 0 dB.
    pub gain_crossings: Vec<GainCrossing>,
    /// Every crossing of −180°.
    pub phase_crossings: Vec<PhaseCrossing>,
    /// What is missing, and why: the name as in JSON, and the reason.
    pub reasons: Vec<(&'static str, String)>,
    /// What makes the margins doubtful.
    pub doubts: Vec<String>,
}

impl Response {
    /// Of points in order of their frequencies.
    ///
    /// # Errors
    /// Too few, out of order, or no numbers.
    pub fn new(points: Vec<Point>) -> Result<Self, ResponseError> {
        if points.len() < FEWEST {
            return Err(ResponseError::TooFew { found: points.len() });
        }
        for (at, point) in points.iter().enumerate() {
            if !(point.hz.is_finite() && point.hz > 0.0) {
                return Err(ResponseError::Frequency { at });
            }
            if at > 0 && point.hz <= points[at - 1].hz {
                return Err(ResponseError::Order { at });
            }
            // Squares of the parts must not overflow or vanish either.
            if !(point.value.norm() > 1e-150 && point.value.norm() < 1e150) {
                return Err(ResponseError::Value { at });
            }
        }
        let nodes = nodes(&points);
        Ok(Self { points, nodes })
    }

    /// The points.
    #[must_use]
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// The response at a frequency, held at the first and the last point outside of the band.
    #[must_use]
    pub fn at(&self, hz: f64) -> Complex64 {
        let last = self.nodes.len() - 1;
        let x = hz.ln().clamp(self.nodes[0].x, self.nodes[last].x);
        let after = self.nodes.partition_point(|node| node.x <= x).clamp(1, last);
        let (gain, phase) = between(&self.nodes[after - 1], &self.nodes[after], x);
        Complex64::from_polar(gain.exp(), phase)
    }

    /// The margins, with the response as the open loop.
    #[must_use]
    pub fn margins(&self) -> Margins {
        let mut margins = Margins {
            gain_crossings: self.gain_crossings(),
            phase_crossings: self.phase_crossings(),
            ..Margins::default()
        };
        margins.stable = self.is_stable(&margins.phase_crossings);
        let one = Complex64::new(1.0, 0.0);
        (margins.ms_hz, margins.ms) = self.peak(|l| (one + l).norm().recip());
        if margins.ms > MOST_PEAK {
            margins.ms = f64::INFINITY;
        }
        if margins.stable != Some(false) {
            let (_, most) = self.peak(|l| ((one - l) / (one + l)).norm());
            margins.disk_margin = Some(2.0 / most);
        }
        margins.bandwidth_hz = self.falls(|l| (l / (one + l)).norm_sqr().ln() + std::f64::consts::LN_2);
        margins.take_phase();
        margins.take_gain();
        self.explain(&mut margins);
        margins
    }

    fn intervals(&self) -> impl Iterator<Item = (&Node, &Node)> {
        self.nodes.iter().zip(&self.nodes[1..])
    }

    fn gain_crossings(&self) -> Vec<GainCrossing> {
        let mut all = Vec::new();
        for (a, b) in self.intervals() {
            for x in roots(a, b, |gain, _| gain) {
                let (_, phase) = between(a, b, x);
                all.push(GainCrossing { freq_hz: x.exp(), phase_margin_deg: margin_deg(phase) });
            }
        }
        all
    }

    fn phase_crossings(&self) -> Vec<PhaseCrossing> {
        use std::f64::consts::{PI, TAU};
        let mut all = Vec::new();
        for (a, b) in self.intervals() {
            // A cubic may leave the range of its ends by less than their distance.
            let room = (a.phase - b.phase).abs();
            let (low, high) = (a.phase.min(b.phase) - room, a.phase.max(b.phase) + room);
            let first = ((low - PI) / TAU).ceil() as i64;
            for turn in (first..).take_while(|turn| *turn as f64 * TAU + PI <= high) {
                let level = turn as f64 * TAU + PI;
                for x in roots(a, b, |_, phase| phase - level) {
                    let (gain, _) = between(a, b, x);
                    let rises = slope(a, b, x).1 > 0.0;
                    all.push(PhaseCrossing { freq_hz: x.exp(), factor: (-gain).exp(), rises });
                }
            }
        }
        all.sort_by(|a, b| a.freq_hz.total_cmp(&b.freq_hz));
        all
    }

    /// See the module's head.
    fn is_stable(&self, crossings: &[PhaseCrossing]) -> Option<bool> {
        use std::f64::consts::{FRAC_PI_2, PI};
        let last = self.nodes.last()?;
        if last.gain >= 0.0 {
            return None;
        }
        let beyond = crossings.iter().filter(|crossing| crossing.factor < 1.0);
        // In halves: a response that begins on the negative real axis crosses it by half.
        let mut falling: i64 = beyond.map(|crossing| if crossing.rises { -2 } else { 2 }).sum();
        let first = self.nodes[0];
        if first.gain > 0.0 {
            // Bode's relation: without a delay yet, a slope of −n has −n quarter turns. More than a quarter turn off is a negative gain.
            // Over an octave, since the slope at the end is the noisiest.
            let octave =
                self.nodes.iter().find(|node| node.x >= first.x + std::f64::consts::LN_2).unwrap_or(last);
            let slope = (octave.gain - first.gain) / (octave.x - first.x);
            let turn = -slope * FRAC_PI_2;
            let rest = wrapped(first.phase + turn);
            let start = if rest.abs() <= FRAC_PI_2 { 0.0 } else { -PI };
            let rest = wrapped(rest - start);
            if rest.abs() > MOST_REST {
                return None;
            }
            let end = start - turn + rest;
            // Odd multiples of π in between, half of one at the start.
            let passed = |level: f64| start > level && end <= level;
            falling += (0..8).filter(|k| passed(-PI * f64::from(2 * k + 1))).count() as i64 * 2;
            if start < 0.0 {
                falling += if end < start { 1 } else { -1 };
            }
        }
        Some(falling <= 0)
    }

    /// The largest value of a function of the response, and its frequency.
    fn peak(&self, of: impl Fn(Complex64) -> f64) -> (f64, f64) {
        let value = |a: &Node, b: &Node, x: f64| {
            let (gain, phase) = between(a, b, x);
            of(Complex64::from_polar(gain.exp(), phase))
        };
        let mut tops = Vec::with_capacity(self.nodes.len());
        for (a, b) in self.intervals() {
            let step = (b.x - a.x) / STEPS as f64;
            let tried = (0..=STEPS).map(|i| a.x + step * i as f64).map(|x| (x, value(a, b, x)));
            tops.extend(tried.max_by(|one, other| one.1.total_cmp(&other.1)));
        }
        let top = tops.iter().copied().max_by(|one, other| one.1.total_cmp(&other.1));
        let (mut at, mut most) = top.unwrap_or((self.nodes[0].x, 0.0));
        let highest = most;
        for ((a, b), (x, found)) in self.intervals().zip(tops) {
            // Between two steps a peak is little above them.
            if found < 0.9 * highest {
                continue;
            }
            let step = (b.x - a.x) / STEPS as f64;
            let (mut low, mut high) = ((x - step).max(a.x), (x + step).min(b.x));
            for _ in 0..HALVINGS {
                let (left, right) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
                if value(a, b, left) < value(a, b, right) { low = left } else { high = right }
            }
            let middle = (low + high) / 2.0;
            if value(a, b, middle) > most {
                (at, most) = (middle, value(a, b, middle));
            }
        }
        (at.exp(), most)
    }

    /// The first frequency at which a function of the response falls through 0; `None` if it starts below or stays above.
    fn falls(&self, of: impl Fn(Complex64) -> f64) -> Option<f64> {
        let value = |x: f64| of(self.at(x.exp()));
        let (first, last) = (self.nodes[0].x, self.nodes[self.nodes.len() - 1].x);
        if of(self.points[0].value) <= 0.0 {
            return None;
        }
        let count = STEPS * self.nodes.len();
        let at = |i: usize| first + (last - first) * i as f64 / count as f64;
        let after = (1..=count).find(|i| value(at(*i)) <= 0.0)?;
        Some(bisect(at(after - 1), at(after), value).exp())
    }

    fn explain(&self, margins: &mut Margins) {
        let (from, to) = (self.points[0].hz, self.points[self.points.len() - 1].hz);
        let band = format!("from {from:.4} to {to:.4} Hz");
        let mut why = |name: &'static str, reason: String| margins.reasons.push((name, reason));
        if margins.phase_margin_deg.is_none() {
            let side = if self.nodes[0].gain > 0.0 { "above" } else { "below" };
            let reason = format!("the gain stays {side} 0 dB {band}");
            for name in ["phase_margin_deg", "crossover_hz", "delay_margin_ms"] {
                why(name, reason.clone());
            }
        } else if margins.delay_margin_ms.is_none() {
            why("delay_margin_ms", "the closed loop is unstable".to_owned());
        }
        if margins.gain_margin.is_none() {
            let reason = if margins.phase_crossings.is_empty() {
                format!("the phase does not cross -180 degrees {band}")
            } else {
                format!("the phase crosses -180 degrees only where the gain is above 0 dB, {band}")
            };
            why("gain_margin", reason.clone());
            why("phase_crossover_hz", reason);
        }
        if margins.gain_margin_low.is_none() {
            why("gain_margin_low", format!("no -180 degrees at a gain above 0 dB {band}"));
        }
        if margins.disk_margin.is_none() {
            why("disk_margin", "the closed loop is unstable".to_owned());
        }
        if !margins.ms.is_finite() {
            why("ms", format!("the loop is -1 at {:.4} Hz", margins.ms_hz));
        }
        if margins.bandwidth_hz.is_none() {
            why("bandwidth_hz", format!("the closed loop does not fall from above to below -3 dB {band}"));
        }
        if margins.stable.is_none() {
            let ends = self.nodes[self.nodes.len() - 1].gain >= 0.0;
            let reason = if ends {
                format!("the gain is above 0 dB at the end of the band, {to:.4} Hz")
            } else {
                format!(
                    "phase and slope do not fit at the begin of the band, {from:.4} Hz, where the gain is above 0 dB"
                )
            };
            why("closed_loop_stable", reason);
        }
        if margins.stable == Some(false) {
            margins.doubts.push("the closed loop is unstable".to_owned());
        }
        if margins.ms_hz <= from * (1.0 + 1e-9) || margins.ms_hz >= to * (1.0 - 1e-9) {
            let at = margins.ms_hz;
            margins.doubts.push(format!("Ms is at the end of the band, {at:.4} Hz: it may be higher beyond"));
        }
        // Far below 0 dB no direction of the phase changes a margin.
        let coarse = self.intervals().find(|(a, b)| {
            (a.phase - b.phase).abs().to_degrees() > COARSE_DEG && a.gain.max(b.gain) > 0.1_f64.ln()
        });
        if let Some((a, b)) = coarse {
            margins.doubts.push(format!(
                "the phase turns by {:.0} degrees from {:.4} to {:.4} Hz: more points are needed there",
                (b.phase - a.phase).abs().to_degrees(),
                a.x.exp(),
                b.x.exp()
            ));
        }
    }
}

impl Margins {
    fn take_phase(&mut self) {
        // Of a stable loop either direction counts; of an unstable one the worst says by how much.
        let size = |margin: f64| if self.stable == Some(true) { margin.abs() } else { margin };
        let nearest = self
            .gain_crossings
            .iter()
            .min_by(|a, b| size(a.phase_margin_deg).total_cmp(&size(b.phase_margin_deg)));
        let Some(nearest) = nearest else { return };
        let size = size(nearest.phase_margin_deg);
        // A phase of −400° is 140° beyond −540°.
        self.phase_margin_deg = Some(if self.stable == Some(false) { -size.abs() } else { size });
        self.crossover_hz = Some(nearest.freq_hz);
        if self.stable != Some(false) {
            // A delay turns the phase down only.
            let delay = |crossing: &GainCrossing| {
                crossing.phase_margin_deg.rem_euclid(360.0) / 360.0 / crossing.freq_hz * 1000.0
            };
            self.delay_margin_ms = self.gain_crossings.iter().map(delay).min_by(f64::total_cmp);
        }
    }

    fn take_gain(&mut self) {
        let above = self.phase_crossings.iter().filter(|crossing| crossing.factor > 1.0);
        let below = self.phase_crossings.iter().filter(|crossing| crossing.factor <= 1.0);
        let up = above.min_by(|a, b| a.factor.total_cmp(&b.factor));
        let down = below.max_by(|a, b| a.factor.total_cmp(&b.factor));
        self.gain_margin_low = down.map(|crossing| crossing.factor);
        let margin = up.or_else(|| down.filter(|_| self.stable == Some(false)));
        self.gain_margin = margin.map(|crossing| crossing.factor);
        self.phase_crossover_hz = margin.map(|crossing| crossing.freq_hz);
    }
}

/// Angle from −1 to a phase, −180 to 180 degrees.
fn margin_deg(phase: f64) -> f64 {
    let margin = wrapped(phase - std::f64::consts::PI).to_degrees();
    if margin == -180.0 { 180.0 } else { margin }
}

/// Into −π to π.
fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::TAU;
    angle - TAU * (angle / TAU).round()
}

fn nodes(points: &[Point]) -> Vec<Node> {
    let mut nodes: Vec<Node> = Vec::with_capacity(points.len());
    for Point { hz, value } in points {
        let phase = nodes
            .last()
            .map_or_else(|| value.arg(), |before| before.phase + wrapped(value.arg() - before.phase));
        nodes.push(Node { x: hz.ln(), gain: value.norm().ln(), phase, gain_slope: 0.0, phase_slope: 0.0 });
    }
    for i in 0..nodes.len() {
        let slope_of = |of: fn(&Node) -> f64| slope_at(&nodes, i, of);
        let (gain_slope, phase_slope) = (slope_of(|node| node.gain), slope_of(|node| node.phase));
        (nodes[i].gain_slope, nodes[i].phase_slope) = (gain_slope, phase_slope);
    }
    nodes
}

/// Slope of the parabola through a point and its neighbors, bounded by three times the slopes beside it where both have one sign: then the
/// cubics are monotone (Fritsch and Carlson, 1980).
fn slope_at(nodes: &[Node], i: usize, of: fn(&Node) -> f64) -> f64 {
    let secant = |i: usize| (of(&nodes[i + 1]) - of(&nodes[i])) / (nodes[i + 1].x - nodes[i].x);
    let width = |i: usize| nodes[i + 1].x - nodes[i].x;
    let last = nodes.len() - 1;
    let bounded = |slope: f64, a: f64, b: f64| {
        let most = 3.0 * a.abs().min(b.abs());
        if a * b > 0.0 { slope.clamp(-most, most) } else { slope }
    };
    match i {
        0 => {
            let bend = (secant(1) - secant(0)) / (width(0) + width(1));
            bounded(secant(0) - bend * width(0), secant(0), secant(0))
        }
        i if i == last => {
            let bend = (secant(i - 1) - secant(i - 2)) / (width(i - 1) + width(i - 2));
            bounded(secant(i - 1) + bend * width(i - 1), secant(i - 1), secant(i - 1))
        }
        i => {
            let (a, b) = (secant(i - 1), secant(i));
            bounded((a * width(i) + b * width(i - 1)) / (width(i - 1) + width(i)), a, b)
        }
    }
}

/// Hermite's cubic through two nodes: ln |L| and phase at `x`.
fn between(a: &Node, b: &Node, x: f64) -> (f64, f64) {
    let width = b.x - a.x;
    let t = (x - a.x) / width;
    let (t2, t3) = (t * t, t * t * t);
    let (h00, h10, h01, h11) = (2.0 * t3 - 3.0 * t2 + 1.0, t3 - 2.0 * t2 + t, 3.0 * t2 - 2.0 * t3, t3 - t2);
    let cubic =
        |y0: f64, m0: f64, y1: f64, m1: f64| h00 * y0 + h10 * width * m0 + h01 * y1 + h11 * width * m1;
    (cubic(a.gain, a.gain_slope, b.gain, b.gain_slope), cubic(a.phase, a.phase_slope, b.phase, b.phase_slope))
}

/// Its slopes.
fn slope(a: &Node, b: &Node, x: f64) -> (f64, f64) {
    let step = (b.x - a.x) * 1e-6;
    let (before, after) = (between(a, b, x - step), between(a, b, x + step));
    ((after.0 - before.0) / (2.0 * step), (after.1 - before.1) / (2.0 * step))
}

/// Roots of a function of the cubics in `a.x..b.x`, the end left to the next interval.
fn roots(a: &Node, b: &Node, of: impl Fn(f64, f64) -> f64) -> Vec<f64> {
    let value = |x: f64| {
        let (gain, phase) = between(a, b, x);
        of(gain, phase)
    };
    let at = |i: usize| if i == STEPS { b.x } else { a.x + (b.x - a.x) * i as f64 / STEPS as f64 };
    let mut found = Vec::new();
    for i in 0..STEPS {
        let (low, high) = (value(at(i)), value(at(i + 1)));
        if low == 0.0 && high == 0.0 {
            // It runs along the axis: a crossing nowhere.
        } else if low == 0.0 {
            found.push(at(i));
        } else if low * high < 0.0 {
            found.push(bisect(at(i), at(i + 1), value));
        }
    }
    found
}

fn bisect(mut low: f64, mut high: f64, value: impl Fn(f64) -> f64) -> f64 {
    let rises = value(high) > value(low);
    for _ in 0..HALVINGS {
        let middle = (low + high) / 2.0;
        if (value(middle) > 0.0) == rises { high = middle } else { low = middle }
    }
    (low + high) / 2.0
}
