use super::*;
use crate::response::{Margins, Point, Response};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

const PERIOD: usize = 2000;
const HZ: f64 = 1000.0;

/// A discrete loop: lags (1 − p)/(z − p), an integral z/(z − 1) with its rate, a delay and a gain.
#[derive(Clone, Debug)]
struct Plant {
    poles: Vec<f64>,
    integral: f64,
    delay: usize,
    gain: f64,
}

impl Plant {
    fn draw(rng: &mut Pcg64Mcg) -> Self {
        let pole = |rng: &mut Pcg64Mcg| (-TAU * 10f64.powf(rng.random_range(-0.3..2.0)) / HZ).exp();
        let count = rng.random_range(1..=3);
        Self {
            poles: (0..count).map(|_| pole(rng)).collect(),
            integral: 10f64.powf(rng.random_range(-4.0..-2.0)),
            delay: rng.random_range(0..=5),
            gain: 1.0,
        }
    }

    fn at(&self, hz: f64) -> Complex64 {
        let z = Complex64::from_polar(1.0, TAU * hz / HZ);
        let lags: Complex64 = self.poles.iter().map(|pole| (1.0 - pole) / (z - pole)).product();
        lags * (1.0 + self.integral * z / (z - 1.0)) * z.powi(-(self.delay as i32)) * self.gain
    }

    /// With the gain that has this phase margin, where the phase first falls to it; `None` if that is beyond the excited band.
    fn with_margin(mut self, margin_deg: f64) -> Option<Self> {
        let (mut phase, mut last) = (self.at(0.5).arg(), self.at(0.5));
        let target = (margin_deg - 180.0).to_radians();
        for i in 1..20_000 {
            let hz = 0.5 * (f64::from(i) * 3e-4).exp();
            let value = self.at(hz);
            phase += (value / last).arg();
            last = value;
            if phase <= target {
                self.gain = value.norm().recip();
                return (3.0..120.0).contains(&hz).then_some(self);
            }
        }
        None
    }

    fn truth(&self) -> Margins {
        let points = (0..600).map(|i| 0.5 * 900f64.powf(f64::from(i) / 599.0));
        let points = points.map(|hz| Point { hz, value: self.at(hz) }).collect();
        Response::new(points).expect("a response").margins()
    }

    /// Closed around an error r − y with noise on y: the record of one realization.
    fn record(&self, excitation: &Multisine, noise: f64, rng: &mut Pcg64Mcg) -> Record {
        let wanted = excitation.draw(1.0, |_| 1.0, rng);
        let mut lags = vec![0.0; self.poles.len()];
        let mut integral = 0.0;
        let mut line = std::collections::VecDeque::from(vec![0.0; self.delay + 1]);
        let [mut input, mut output] = [const { Vec::new() }; 2];
        for period in 0..6 {
            let [mut errors, mut outputs] = [const { Vec::new() }; 2];
            for r in &wanted {
                // Each lag is a tick late already.
                let y = if self.delay == 0 { lags[self.poles.len() - 1] } else { line[self.delay - 1] };
                let y = y + noise * rng.random_range(-1.7..1.7);
                let e = r - y;
                integral += self.integral * e;
                line.push_front(lags[self.poles.len() - 1]);
                line.truncate(self.delay + 1);
                let mut u = self.gain * (e + integral);
                for (lag, pole) in lags.iter_mut().zip(&self.poles) {
                    let before = *lag;
                    *lag = pole * before + (1.0 - pole) * u;
                    u = before;
                }
                errors.push(e);
                outputs.push(y);
            }
            if period > 0 {
                input.push(excitation.spectrum(&errors));
                output.push(excitation.spectrum(&outputs));
            }
        }
        Record { reference: excitation.spectrum(&wanted), input, output }
    }
}

fn excitation() -> Multisine {
    Multisine::new(PERIOD, HZ, (1.0, 300.0), 48)
}

fn response(estimates: &[Estimate]) -> Response {
    let points = estimates.iter().map(|e| Point { hz: e.hz, value: e.value }).collect();
    Response::new(points).expect("a response")
}

/// 200 loops with 20 to 80 degrees and noise of 5 % of the excitation. 2 degrees: the requirement. The truth is the phase at which the
/// gain was chosen, and the exact response on a dense grid where another crossing is nearer.
#[test]
fn margins_of_200_random_loops_are_within_2_degrees() {
    let excitation = excitation();
    let mut rng = Pcg64Mcg::seed_from_u64(17);
    let (mut count, mut worst, mut worst_ms, mut worst_gain) = (0, 0.0_f64, 0.0_f64, 0.0_f64);
    while count < 200 {
        let margin = rng.random_range(20.0..80.0);
        let Some(plant) = Plant::draw(&mut rng).with_margin(margin) else { continue };
        let truth = plant.truth();
        if truth.stable != Some(true) {
            continue;
        }
        let exact = truth.phase_margin_deg.expect("it crosses");
        assert!(exact <= margin + 0.01, "{plant:?}: {exact}, chosen {margin}");
        let records: Vec<Record> = (0..6).map(|_| plant.record(&excitation, 0.05, &mut rng)).collect();
        let found = response(&excitation.estimate(&records)).margins();
        let error = (found.phase_margin_deg.expect("it crosses") - exact).abs();
        assert!(error < 2.0, "{plant:?}: {found:?}, true {exact}");
        worst = worst.max(error);
        worst_ms = worst_ms.max((found.ms / truth.ms - 1.0).abs());
        // Deep below 0 dB the noise decides.
        if let Some(margin) = truth.gain_margin.filter(|margin| *margin < 4.0) {
            let found = found.gain_margin.unwrap_or(f64::INFINITY);
            worst_gain = worst_gain.max((found / margin - 1.0).abs());
        }
        count += 1;
    }
    // What docs/response.md says; the requirement is above.
    assert!(worst < 0.6 && worst_ms < 0.08, "{worst} deg, Ms {worst_ms}");
    // Lines are 6 to 12 % apart, and the noise is 5 %.
    assert!(worst_gain < 0.1, "{worst_gain}");
}

/// Through y = x + c·x³ with noise on y.
fn static_response(cubic: f64, noise: f64) -> Vec<Estimate> {
    let excitation = excitation();
    let mut rng = Pcg64Mcg::seed_from_u64(4);
    let records: Vec<Record> = (0..12)
        .map(|_| {
            let x = excitation.draw(1.0, |_| 1.0, &mut rng);
            let spectrum = excitation.spectrum(&x);
            let output = (0..5).map(|_| {
                let y: Vec<f64> =
                    x.iter().map(|x| x + cubic * x.powi(3) + noise * rng.random_range(-1.7..1.7)).collect();
                excitation.spectrum(&y)
            });
            let output: Vec<_> = output.collect();
            Record { reference: spectrum.clone(), input: vec![spectrum; 5], output }
        })
        .collect();
    excitation.estimate(&records)
}

fn mean_of(estimates: &[Estimate], of: fn(&Estimate) -> f64) -> f64 {
    estimates.iter().map(of).sum::<f64>() / estimates.len() as f64
}

#[test]
fn noise_and_nonlinearity_are_told_apart() {
    let noisy = static_response(0.0, 0.3);
    let (noise, nonlinear) = (mean_of(&noisy, |e| e.noise), mean_of(&noisy, |e| e.nonlinear));
    // A line of white noise in N samples has 2·σ/√N, one of the L excited lines √(2/L); 60 periods are averaged. A fifth: 48 averages of
    // a variance each, over the lines.
    let sigma = 0.3 * 1.7 / 3f64.sqrt();
    let wanted = 2.0 * sigma / (PERIOD as f64).sqrt() / (2.0 / noisy.len() as f64).sqrt() / 60f64.sqrt();
    assert!((noise / wanted - 1.0).abs() < 0.2, "{noise}, want {wanted}");
    // What the variances of 12 realizations differ by: below the noise of one, √12 of it.
    assert!(nonlinear < 12f64.sqrt() * noise, "{nonlinear} of {noise}");

    let bent = static_response(0.1, 0.0);
    let (noise, nonlinear) = (mean_of(&bent, |e| e.noise), mean_of(&bent, |e| e.nonlinear));
    assert!(noise < 1e-12 && nonlinear > 0.02, "{noise}, {nonlinear}");
    // The best linear approximation of x + c·x³ for a Gaussian x of variance 1 is 1 + 3c.
    let gain = mean_of(&bent, |e| e.value.re);
    assert!((gain - 1.3).abs() < 0.03, "{gain}");
}

#[test]
fn excitation_has_its_amplitude_on_its_lines_only() {
    let excitation = excitation();
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let samples = excitation.draw(3.0, |_| 1.0, &mut rng);
    let rms = (samples.iter().map(|x| x * x).sum::<f64>() / PERIOD as f64).sqrt();
    assert!((rms - 3.0).abs() < 1e-9, "{rms}");
    let lines = excitation.spectrum(&samples);
    let power: f64 = lines.iter().map(|line| line.norm_sqr() / 2.0).sum();
    assert!((power - 9.0).abs() < 1e-9, "{power}");
    let frequencies: Vec<f64> = excitation.frequencies().collect();
    assert!(frequencies.iter().all(|hz| (hz * 2.0).round() as usize % 2 == 1), "{frequencies:?}");
    assert!(frequencies[0] < 2.0 && frequencies[frequencies.len() - 1] > 250.0 && frequencies.len() > 30);
}
