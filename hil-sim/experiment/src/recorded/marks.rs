//! What repeats with the rotor: widths of the cells between marks, cogging, and the delay of rising edges.
//!
//! # Design
//!
//! A cell of the width 1 + m counts between two marks is crossed in
//!
//! ```text
//! T = (1 + m) / (v̄·f) + s·d        f = √(1 + c/v̄²)        s = +1 if the cell ends with a rising edge, else −1
//! ```
//!
//! at the mean speed v̄ of a lap. Misplaced marks (m) scale with the interval, cogging (c, the surplus of v² in this cell) shows
//! at slow speeds only, and the delay d of rising edges at fast ones. That tells the three apart.
//!
//! The mean is that of the lap of n edges centered on the cell, with half of the first and of the last interval. What
//! repeats with the lap cancels in it exactly, and a constant acceleration nearly. So nothing is learned from residuals of
//! the motion's filter, whose lag would be taken for marks. With T·v̄ measured half a lap later, the residual is
//!
//! ```text
//! e = (T − s·d)·v̄ − (1 + m)/f       in counts
//! ∂e: H_m = 1/f    H_c = −(T − s·d)·v̄/(2·f²·v̄²)    H_d = s·v̄
//! S = k·r + P_m·H_m² + P_c·H_c² + P_d·H_d²          r = r + (min(e², 0.06) − r)/R
//! K = P·H/S        θ = θ + K·e        P = P·(1 − K·H) + q        for each θ of m, c, d
//! ```
//!
//! a Kalman filter without its cross covariances; the factor k makes up for these. The widths of a lap sum to n.
//!
//! The lap is unknown: a motor has 6 counts for each pair of poles. Each [`Pattern`] assumes another one and predicts the ratio
//! of an interval to the one before; the mean square of its error is its score. The pattern with the best score is used,
//! if it is better than none by a factor, and better than a shorter one by the same.
//!
//! # Formats
//!
//! [`Real`] throughout: widths in counts, c in (counts/s)², d in ms, so that the variance of d has digits.

use super::real::{HALF, ONE, Real, ZERO, larger, ratio, root, whole, within};
use super::tuning::Tuning;

/// Largest learned width error of a cell, in counts.
const WIDTH_MAX: Real = real!("0.7");
/// Largest delay of rising edges, in ms.
const DELAY_MAX: Real = real!("0.4");
/// Largest |c|: that of a rotor that cogs from 300 counts/s to a halt.
const COGGING_MAX: Real = real!("100000");
/// Least and largest f².
const FACTOR: (Real, Real) = (real!("0.2"), real!("4"));
/// Largest e² that counts in r: that of a placement error of a quarter count.
const RESIDUAL_MAX: Real = real!("0.06");
/// Largest variance of c.
const COGGING_VARIANCE_MAX: Real = real!("10000000");
/// r before anything is learned.
const RESIDUAL_FIRST: Real = real!("0.01");
/// ms in a second.
const MS: Real = real!("1000");
/// Least r: a stamp's resolution, 1/1000 count.
const RESIDUAL_MIN: Real = real!("0.000001");
/// Variance of the delay before anything is learned, (1 µs)²: a delay must show.
const DELAY_VARIANCE: Real = real!("0.000001");
/// Growth of the delay's variance with each visit, (2.2 µs)².
const DELAY_GROWTH: Real = real!("0.000005");

/// An interval between two edges.
#[derive(Clone, Copy, Debug)]
pub struct Interval {
    /// Number of the boundary at the lower end of the cell.
    pub cell: i32,
    /// Seconds between the stamps of its edges.
    pub time: Real,
    /// The last of its edges rises.
    pub rising: bool,
}

impl Interval {
    fn sign(&self) -> Real {
        if self.rising { ONE } else { -ONE }
    }
}

#[derive(Clone, Copy, Debug)]
struct Cell {
    /// m.
    width: Real,
    width_variance: Real,
    /// c.
    cogging: Real,
    cogging_variance: Real,
    /// Place of the mark at the lower end, relative to an even one; the mean of a lap is 0.
    place: Real,
}

/// What is learned if a lap has a certain number of counts.
#[derive(Clone, Debug)]
pub struct Pattern<const N: usize> {
    lap: u8,
    cells: [Cell; N],
    /// d.
    delay: Real,
    delay_variance: Real,
    /// r.
    residual: Real,
    score: Real,
}

impl<const N: usize> Pattern<N> {
    /// Nothing learned of a lap of `lap` counts.
    pub fn new(lap: u8, tuning: &Tuning) -> Self {
        let cell = Cell {
            width: ZERO,
            width_variance: tuning.width_variance,
            cogging: ZERO,
            cogging_variance: tuning.cogging_variance,
            place: ZERO,
        };
        Self {
            lap,
            cells: [cell; N],
            delay: ZERO,
            delay_variance: DELAY_VARIANCE,
            residual: RESIDUAL_FIRST,
            score: ZERO,
        }
    }

    /// Counts of the lap.
    pub const fn lap(&self) -> u8 {
        self.lap
    }

    /// Mean square error of predicted ratios.
    pub const fn score(&self) -> Real {
        self.score
    }

    fn index(&self, boundary: i32) -> usize {
        usize::try_from(boundary.rem_euclid(i32::from(self.lap.max(1)))).unwrap_or(0)
    }

    fn cell(&self, boundary: i32) -> Option<&Cell> {
        self.cells.get(self.index(boundary))
    }

    /// Place of a mark, relative to boundary − ½ counts.
    pub fn place(&self, boundary: i32) -> Real {
        self.cell(boundary).map_or(ZERO, |cell| cell.place)
    }

    /// c of the cell above a boundary.
    pub fn cogging(&self, cell: i32) -> Real {
        self.cell(cell).map_or(ZERO, |cell| cell.cogging)
    }

    /// d in seconds.
    pub fn delay(&self) -> Real {
        self.delay / MS
    }

    /// T·v of an interval at speed v.
    fn expected(&self, interval: &Interval, speed: Real) -> Real {
        let Some(cell) = self.cell(interval.cell) else { return ONE };
        let (width, factor) = ((ONE + cell.width), factor(cell.cogging, speed));
        ratio(width, factor) + interval.sign() * self.delay() * speed
    }

    /// Scores the prediction of an interval from the one before.
    pub fn judge(&mut self, before: &Interval, interval: &Interval, memory: Real) {
        let speed = ratio(whole(2), before.time + interval.time);
        let ahead = interval.time * self.expected(before, speed);
        let error = difference(ahead, before.time * self.expected(interval, speed));
        self.score += (error * error - self.score) / memory;
    }

    /// Learns from the interval in the middle of a lap whose mean interval is `mean` seconds.
    pub fn learn(&mut self, interval: &Interval, mean: Real, tuning: &Tuning) {
        let speed = ratio(ONE, mean);
        let (sign, delay, index) = (interval.sign(), self.delay(), self.index(interval.cell));
        let Some(cell) = self.cells.get_mut(index) else { return };
        let factor = factor(cell.cogging, speed);
        let time = (interval.time - sign * delay) * speed;
        let error = time - ratio(ONE + cell.width, factor);
        let square = within(error * error, ZERO, RESIDUAL_MAX);
        self.residual += (square - self.residual) / tuning.residual_memory;
        if error.0.abs() > WIDTH_MAX.0 {
            return;
        }
        let by_width = ratio(ONE, factor);
        let by_cogging = -ratio(ratio(time * HALF, factor * factor), speed * speed);
        let by_delay = sign * speed / MS;
        let noise = larger(self.residual, RESIDUAL_MIN) * tuning.residual_factor;
        let width = cell.width_variance * by_width;
        let cogging = cell.cogging_variance * by_cogging;
        let delay = self.delay_variance * by_delay;
        let variance = noise + width * by_width + cogging * by_cogging + delay * by_delay;
        let gain = |covariance| ratio(covariance, variance);
        let wider = gain(width) * error;
        cell.width = within(cell.width + wider, -WIDTH_MAX, WIDTH_MAX);
        cell.width_variance *= ONE - gain(width) * by_width;
        cell.cogging = within(cell.cogging + gain(cogging) * error, -COGGING_MAX, COGGING_MAX);
        let left = cell.cogging_variance * (ONE - gain(cogging) * by_cogging);
        cell.cogging_variance = within(left + tuning.cogging_growth, ZERO, COGGING_VARIANCE_MAX);
        self.delay = within(self.delay + gain(delay) * error, ZERO, DELAY_MAX);
        self.delay_variance = self.delay_variance * (ONE - gain(delay) * by_delay) + DELAY_GROWTH;
        self.place_marks(wider);
    }

    /// Places of all marks after one cell became `wider`, which the others make up for.
    fn place_marks(&mut self, wider: Real) {
        let lap = whole(i32::from(self.lap.max(1)));
        let share = wider / lap;
        let (mut place, mut sum) = (ZERO, ZERO);
        for cell in self.cells.iter_mut().take(usize::from(self.lap)) {
            cell.width -= share;
            cell.place = place;
            sum += place;
            place += cell.width;
        }
        let mean = sum / lap;
        for cell in self.cells.iter_mut().take(usize::from(self.lap)) {
            cell.place -= mean;
        }
    }
}

/// f.
pub fn factor(cogging: Real, speed: Real) -> Real {
    root(within(ONE + ratio(cogging, speed * speed), FACTOR.0, FACTOR.1))
}

/// (a − b) / (a + b), half the relative difference.
pub fn difference(a: Real, b: Real) -> Real {
    ratio(a - b, a + b)
}
