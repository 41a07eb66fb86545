//! Periodic excitation, and a frequency response from it with noise and nonlinearity told apart: the robust method of Pintelon and
//! Schoukens (System identification: a frequency domain approach, 2nd ed. 2012, section 4.3).
//!
//! A realization is a sum of sines of odd harmonics with random phases, repeated for some periods. Noise differs from period to period; what
//! a nonlinearity adds repeats with the period and differs from realization to realization. With R the spectrum of what was injected, U
//! and Y those of the response's input and output, each of realization m and period p,
//!
//! ```text
//! G = Syr/Sur          Syr = mean(Y·R*) over all m and p; unbiased in closed loop too, since R knows no noise
//! e = (Y − G·U)·R*
//! noise²(G) = Σₘₚ |e − ēₘ|² / (M²P(P − 1)) / |Sur|²
//! total²(G) = Σₘ |ēₘ − ē|² / (M(M − 1)) / |Sur|²
//! ```
//!
//! are G and the variances of G. What the total exceeds the noise by is the nonlinearity's; times M it is that of one realization. G itself
//! is the best linear approximation: it holds for signals of this size and spectrum.

use num_complex::Complex64;
use rand::{Rng, RngExt};
use std::f64::consts::TAU;

#[cfg(test)]
mod tests;

/// What is injected.
#[derive(Clone, Debug)]
pub struct Multisine {
    /// Samples of a period.
    period: usize,
    /// Samples a second.
    sample_hz: f64,
    /// Excited harmonics, odd and rising.
    lines: Vec<usize>,
}

/// The spectra of one realization at the excited lines.
#[derive(Clone, Debug)]
pub struct Record {
    /// What was injected, without noise.
    pub reference: Vec<Complex64>,
    /// The response's input, of each period.
    pub input: Vec<Vec<Complex64>>,
    /// Its output, of each period.
    pub output: Vec<Vec<Complex64>>,
}

/// The response at a line.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    /// Frequency, Hz.
    pub hz: f64,
    /// G.
    pub value: Complex64,
    /// Standard deviation of G by noise, absolute.
    pub noise: f64,
    /// Standard deviation of G by noise and nonlinearity, absolute.
    pub total: f64,
    /// Standard deviation of one realization's response by the nonlinearity, absolute.
    pub nonlinear: f64,
}

impl Multisine {
    /// About `count` odd harmonics from `from_hz` to `to_hz`, evenly over the logarithm of the frequency.
    #[must_use]
    pub fn new(period: usize, sample_hz: f64, (from_hz, to_hz): (f64, f64), count: usize) -> Self {
        let bin = |hz: f64| hz * period as f64 / sample_hz;
        let ratio = (to_hz / from_hz).ln() / count.saturating_sub(1).max(1) as f64;
        let mut lines: Vec<usize> = (0..count)
            .map(|i| bin(from_hz * (ratio * i as f64).exp()))
            .map(|bin| 2 * (bin / 2.0).floor() as usize + 1)
            .filter(|line| 2 * line < period)
            .collect();
        lines.dedup();
        Self { period, sample_hz, lines }
    }

    /// Frequencies of the lines, Hz.
    pub fn frequencies(&self) -> impl Iterator<Item = f64> {
        self.lines.iter().map(|line| *line as f64 * self.sample_hz / self.period as f64)
    }

    /// A period with random phases. `rms`: of each line, relative to the others, by its frequency in Hz; the whole has `amplitude` RMS.
    pub fn draw(&self, amplitude: f64, rms: impl Fn(f64) -> f64, rng: &mut impl Rng) -> Vec<f64> {
        let table = Twiddles::new(self.period);
        let mut samples = vec![0.0; self.period];
        let mut power = 0.0;
        for (line, hz) in self.lines.iter().zip(self.frequencies()) {
            let weight = rms(hz);
            power += weight * weight;
            let phase = Complex64::from_polar(weight * std::f64::consts::SQRT_2, rng.random_range(0.0..TAU));
            for (sample, turn) in samples.iter_mut().zip(table.of(*line)) {
                *sample += (phase * turn.conj()).re;
            }
        }
        let scale = amplitude / power.sqrt();
        samples.iter_mut().for_each(|sample| *sample *= scale);
        samples
    }

    /// The amplitudes at the lines of one period.
    #[must_use]
    pub fn spectrum(&self, samples: &[f64]) -> Vec<Complex64> {
        let table = Twiddles::new(self.period);
        let scale = 2.0 / self.period as f64;
        let sum = |line: &usize| -> Complex64 {
            samples.iter().zip(table.of(*line)).map(|(x, turn)| turn * *x).sum()
        };
        self.lines.iter().map(|line| sum(line) * scale).collect()
    }

    /// The response from at least two realizations of at least two periods each; lines whose input is 0 are left out.
    #[must_use]
    pub fn estimate(&self, records: &[Record]) -> Vec<Estimate> {
        let estimates = self.frequencies().enumerate().map(|(line, hz)| estimate(records, line, hz));
        estimates.filter(|e| e.value.is_finite() && e.total.is_finite()).collect()
    }
}

fn estimate(records: &[Record], line: usize, hz: f64) -> Estimate {
    let realizations = records.len() as f64;
    let over = |of: fn(&Record) -> &Vec<Vec<Complex64>>| -> Complex64 {
        let cross =
            |record: &Record| mean(of(record).iter().map(|x| x[line])) * record.reference[line].conj();
        records.iter().map(cross).sum::<Complex64>() / realizations
    };
    let (input, output) = (over(|record| &record.input), over(|record| &record.output));
    let value = output / input;
    let mut within = 0.0;
    let mut means = Vec::with_capacity(records.len());
    for record in records {
        let pairs = record.input.iter().zip(&record.output);
        let errors: Vec<Complex64> =
            pairs.map(|(u, y)| (y[line] - value * u[line]) * record.reference[line].conj()).collect();
        let middle = mean(errors.iter().copied());
        let periods = errors.len() as f64;
        within += errors.iter().map(|e| (e - middle).norm_sqr()).sum::<f64>() / (periods * (periods - 1.0));
        means.push(middle);
    }
    let middle = mean(means.iter().copied());
    let between: f64 = means.iter().map(|e| (e - middle).norm_sqr()).sum();
    let noise = within / (realizations * realizations) / input.norm_sqr();
    let total = between / (realizations * (realizations - 1.0)) / input.norm_sqr();
    let nonlinear = ((total - noise).max(0.0) * realizations).sqrt();
    // With few realizations the total may come out below the noise.
    Estimate { hz, value, noise: noise.sqrt(), total: total.max(noise).sqrt(), nonlinear }
}

fn mean(values: impl ExactSizeIterator<Item = Complex64>) -> Complex64 {
    let count = values.len() as f64;
    values.sum::<Complex64>() / count
}

/// e^(−j2πi/N).
struct Twiddles(Vec<Complex64>);

impl Twiddles {
    fn new(period: usize) -> Self {
        Self((0..period).map(|i| Complex64::from_polar(1.0, -TAU * i as f64 / period as f64)).collect())
    }

    /// e^(−j2πki/N) of line k, for i = 0 to N − 1.
    fn of(&self, line: usize) -> impl Iterator<Item = Complex64> {
        let period = self.0.len();
        let mut at = 0;
        (0..period).map(move |_| {
            let turn = self.0[at];
            at += line;
            if at >= period {
                at -= period;
            }
            turn
        })
    }
}
