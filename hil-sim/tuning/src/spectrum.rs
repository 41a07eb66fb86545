//! The response between two recorded signals, by Welch's method: segments of an eighth of the record that overlap by half, each less its mean
//! and with Hann's window,
//!
//! ```text
//! G = Syr/Sur          coherence γ² = |Suy|²/(Suu·Syy)          relative standard deviation √((1 − γ²)/(2·γ²·n))
//! ```
//!
//! with n = 8 independent segments (Bendat and Piersol, Random data, 4th ed. 2010, section 9.1). Without a reference r of its own the input
//! is r: biased by noise that a loop feeds back to the input.

use num_complex::Complex64;
use std::f64::consts::TAU;

/// Independent segments of a record.
const SEGMENTS: usize = 8;

/// Fewest samples of a record: segments of 32.
pub const FEWEST: usize = 32 * SEGMENTS;

/// Lines a decade at most: where bins are dense.
const PER_DECADE: f64 = 24.0;

/// First bin: lower ones hold what is left of the mean and the drift.
const FIRST: usize = 2;

/// The response at one frequency.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// Frequency, Hz.
    pub hz: f64,
    /// G.
    pub value: Complex64,
    /// γ², 0 to 1.
    pub coherence: f64,
    /// Standard deviation of G, absolute.
    pub deviation: f64,
}

/// The median step between times.
#[must_use]
pub fn step(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or_default()
}

/// Steps without a row from which there is nothing to read in between. A board over USB answers in 5 ms, and waits 50 ms for a busy host.
const MOST_STEPS: f64 = 20.0;

/// The first time that is not above the one before, or comes more than twenty steps after it.
#[must_use]
pub fn unreadable(times: &[f64]) -> Option<usize> {
    let most = MOST_STEPS * step(times);
    (1..times.len()).find(|at| {
        let own = times[*at] - times[at - 1];
        own <= 0.0 || own > most
    })
}

/// Share of a step by which times may be off their place.
const MOST_JITTER: f64 = 0.02;

/// Whether times are evenly spaced, from the first to the last.
#[must_use]
pub fn is_even(times: &[f64]) -> bool {
    let (Some(first), Some(last)) = (times.first(), times.last()) else { return true };
    let step = (last - first) / (times.len() - 1).max(1) as f64;
    let place = |at: usize| first + at as f64 * step;
    times.iter().enumerate().all(|(at, time)| (time - place(at)).abs() <= MOST_JITTER * step)
}

/// A signal at as many even times, read on the lines between its values: what that takes of high frequencies it takes of each signal.
#[must_use]
pub fn even(times: &[f64], values: &[f64]) -> Vec<f64> {
    if is_even(times) {
        return values.to_vec();
    }
    let (first, last) = (times[0], times[times.len() - 1]);
    let step = (last - first) / (times.len() - 1) as f64;
    let mut at = 0;
    let read = |index: usize| {
        let time = first + index as f64 * step;
        while at + 2 < times.len() && times[at + 1] < time {
            at += 1;
        }
        let share = ((time - times[at]) / (times[at + 1] - times[at])).clamp(0.0, 1.0);
        values[at] + share * (values[at + 1] - values[at])
    };
    (0..times.len()).map(read).collect()
}

/// The response from `input` to `output`, sampled every `step_s`; lines without input are left out. All signals are as long as `input`,
/// [`FEWEST`] at least.
#[must_use]
pub fn response(step_s: f64, input: &[f64], output: &[f64], reference: &[f64]) -> Vec<Line> {
    let length = input.len() / SEGMENTS;
    let window: Vec<f64> = (0..length).map(|i| 0.5 - 0.5 * (TAU * i as f64 / length as f64).cos()).collect();
    let table: Vec<Complex64> =
        (0..length).map(|i| Complex64::from_polar(1.0, -TAU * i as f64 / length as f64)).collect();
    let bins = bins(length);
    let mut sums = vec![Sums::default(); bins.len()];
    let starts = (0..=input.len() - length).step_by((length / 2).max(1));
    for start in starts {
        let segment = |signal: &[f64]| -> Vec<f64> {
            let part = &signal[start..start + length];
            let mean = part.iter().sum::<f64>() / length as f64;
            part.iter().zip(&window).map(|(x, w)| (x - mean) * w).collect()
        };
        let signals = [input, output, reference].map(segment);
        for (bin, sum) in bins.iter().zip(&mut sums) {
            let [u, y, r] = signals.each_ref().map(|signal| -> Complex64 {
                signal.iter().enumerate().map(|(i, x)| table[bin * i % length] * *x).sum()
            });
            sum.ur += u * r.conj();
            sum.yr += y * r.conj();
            sum.uy += u * y.conj();
            sum.uu += u.norm_sqr();
            sum.yy += y.norm_sqr();
        }
    }
    let lines = bins.iter().zip(sums).map(|(bin, sum)| sum.line(*bin as f64 / (length as f64 * step_s)));
    lines.filter(|line| line.value.is_finite() && line.coherence.is_finite()).collect()
}

/// Bins evenly over the logarithm of the frequency, each once, up to four fifths of half the sampling rate.
fn bins(length: usize) -> Vec<usize> {
    let (first, last) = (FIRST as f64, 0.4 * length as f64);
    let count = ((last / first).log10() * PER_DECADE).ceil();
    let mut bins: Vec<usize> = (0..=count as usize)
        .map(|i| (first * (last / first).powf(i as f64 / count)).round() as usize)
        .collect();
    bins.dedup();
    bins
}

#[derive(Clone, Copy, Default)]
struct Sums {
    ur: Complex64,
    yr: Complex64,
    uy: Complex64,
    uu: f64,
    yy: f64,
}

impl Sums {
    fn line(self, hz: f64) -> Line {
        let value = self.yr / self.ur;
        let coherence = self.uy.norm_sqr() / (self.uu * self.yy);
        let relative = ((1.0 - coherence).max(0.0) / (2.0 * coherence * SEGMENTS as f64)).sqrt();
        Line { hz, value, coherence, deviation: value.norm() * relative }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    /// A lag of 10 rad/s sampled every 5 ms or so: up to 20 Hz the response is as sampled evenly, within 3 %.
    #[test]
    fn uneven_sampling_is_read_in_between() {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let mut time = 0.0;
        let times: Vec<f64> = (0..4096)
            .map(|_| {
                time += 0.005 * rng.random_range(0.7..1.4);
                time
            })
            .collect();
        let tones: Vec<f64> = (1..40).map(|i| 0.5 * f64::from(i)).collect();
        let wave = |time: f64, gain: fn(f64) -> Complex64| -> f64 {
            let tone = |hz: &f64| (gain(*hz) * Complex64::from_polar(1.0, TAU * hz * (time + hz * hz))).im;
            tones.iter().map(tone).sum()
        };
        let input: Vec<f64> = times.iter().map(|time| wave(*time, |_| Complex64::new(1.0, 0.0))).collect();
        let lag = |hz: f64| Complex64::new(1.0, TAU * hz / 10.0).inv();
        let output: Vec<f64> = times.iter().map(|time| wave(*time, lag)).collect();
        assert!(!is_even(&times) && unreadable(&times).is_none());
        let (input, output) = (even(&times, &input), even(&times, &output));
        let step_s = (times[4095] - times[0]) / 4095.0;
        let lines = response(step_s, &input, &output, &input);
        let sure: Vec<&Line> = lines.iter().filter(|line| line.hz < 20.0 && line.coherence > 0.99).collect();
        assert!(sure.len() > 20, "{} lines", sure.len());
        for line in sure {
            assert!((line.value - lag(line.hz)).norm() < 0.03, "{line:?}");
        }
        assert_eq!(unreadable(&[0.0, 1.0, 2.0, 23.0, 24.0]), Some(3));
        assert_eq!(unreadable(&[0.0, 1.0, 1.0, 2.0]), Some(2));
    }

    /// y = 0.9·y₋₁ + 0.2·u₋₁: at all lines of good coherence within four deviations, and 5 % for the leakage of short segments.
    #[test]
    fn response_of_a_lag_is_its_transfer_function() {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let input: Vec<f64> = (0..8192).map(|_| rng.random_range(-1.0..1.0)).collect();
        let mut state = 0.0;
        let output: Vec<f64> = input
            .iter()
            .map(|u| {
                let now = state;
                state = 0.9 * state + 0.2 * u;
                now + rng.random_range(-0.05..0.05)
            })
            .collect();
        let lines = response(0.001, &input, &output, &input);
        assert!(lines.len() > 30 && lines.last().is_some_and(|line| line.hz > 350.0), "{}", lines.len());
        for line in lines {
            let z = Complex64::from_polar(1.0, TAU * line.hz * 0.001);
            let truth = 0.2 / (z - 0.9);
            let error = (line.value - truth).norm();
            assert!(error < 4.0 * line.deviation + 0.05 * truth.norm(), "{line:?}, {truth}");
        }
    }

    /// A loop around noise: only the reference knows what is the motor's.
    #[test]
    fn reference_removes_the_bias_of_feedback() {
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let (mut state, mut noise) = (0.0, 0.0);
        let [mut input, mut output, mut reference] = [const { Vec::new() }; 3];
        for _ in 0..65_536 {
            let r: f64 = rng.random_range(-1.0..1.0);
            noise = 0.95 * noise + rng.random_range(-0.05..0.05);
            let y = state + noise;
            let u = r - 2.0 * y;
            state = 0.9 * state + 0.05 * u;
            input.push(u);
            output.push(y);
            reference.push(r);
        }
        let bias = |reference: &[f64]| {
            let lines = response(0.001, &input, &output, reference);
            let ratio =
                |line: &Line| line.value / (0.05 / (Complex64::from_polar(1.0, TAU * line.hz * 0.001) - 0.9));
            let slow: Vec<Complex64> = lines.iter().filter(|line| line.hz < 20.0).map(ratio).collect();
            (slow.iter().sum::<Complex64>() / slow.len() as f64 - 1.0).norm()
        };
        let (with, without) = (bias(&reference), bias(&input));
        // Noise of four times the signal makes of the motor the inverse of its law, −1/2 instead of +1/2.
        assert!(without > 0.8 && with < 0.3, "{with} with, {without} without");
    }
}
