//! The figures, each on the nominal motor and on scattered plants.

use std::fmt;

use hil_world::node::Sample;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use servo_core::EndReason;
use tater_wire::Property;

use super::optimum::{PEAK_A, optimum_ms};
use super::rig::{KINDS, Motor, Setup, plants, travel};

/// A figure of the nominal motor, and its distribution over the plants.
#[derive(Clone, Debug)]
pub struct Spread {
    pub nominal: f64,
    pub median: f64,
    pub p95: f64,
    pub most: f64,
    /// The plant that has it.
    pub seed: u64,
    pub plants: usize,
}

impl fmt::Display for Spread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { nominal, median, p95, most, seed, plants } = self;
        write!(
            f,
            "nominal {nominal:.2}; median {median:.2}, 95 % {p95:.2}, all {most:.2} (seed {seed}) of {plants} plants"
        )
    }
}

/// Something of each seed, in order, on all processors.
pub fn each<T: Send>(seeds: impl Iterator<Item = u64>, of: impl Fn(u64) -> T + Sync) -> Vec<T> {
    seeds.collect::<Vec<_>>().into_par_iter().map(&of).collect()
}

/// Several figures of one run on all plants.
fn spread<const N: usize>(figure: impl Fn(Option<u64>) -> [f64; N] + Sync) -> [Spread; N] {
    let seeds = plants();
    let measured = each(seeds.clone(), |seed| figure(Some(seed)));
    let nominal = figure(None);
    std::array::from_fn(|i| {
        let mut values: Vec<(f64, u64)> =
            measured.iter().map(|figures| figures[i]).zip(seeds.clone()).collect();
        values.sort_by(|a, b| a.0.total_cmp(&b.0));
        let at = |percent: usize| values[(values.len() - 1) * percent / 100];
        let (most, seed) = at(100);
        Spread { nominal: nominal[i], median: at(50).0, p95: at(95).0, most, seed, plants: values.len() }
    })
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), x| (sum + x * x, n + 1.0));
    (sum / f64::max(n, 1.0)).sqrt()
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), x| (sum + x, n + 1.0));
    sum / f64::max(n, 1.0)
}

/// RMS of the true velocity about its mean.
fn velocity_rms(samples: &[Sample]) -> f64 {
    let mean = mean(samples.iter().map(|sample| sample.truth.counts_per_s));
    rms(samples.iter().map(|sample| sample.truth.counts_per_s - mean))
}

/// RMS of the true velocity about its mean at MV, counts/s, from half a second after the start until 100 ms before the profile ends.
pub fn ripple(mv: u16, cogging_n_m: f64) -> Spread {
    let (from, _) = travel("link");
    let setup = Setup::new("link", &format!("MV = {mv}"), from.into());
    let cogging = format!("cogging_n_m = {cogging_n_m:?}");
    let setup = if cogging_n_m > 0.0 { setup.plant(&cogging) } else { setup };
    // At MV 100 nearly all that the joint has.
    let end = i64::from(from) + i64::from(mv) * 7 / 2;
    let [spread] = spread(|seed| {
        let mut motor = Motor::new(&setup, seed);
        motor.set(Property::M, end);
        [velocity_rms(&motor.run(3_300)[500..])]
    });
    spread
}

/// `link-fast`: ACCEL 60, MV 1000: RMS of the true position about the set-point while it moves, and overshoot; counts.
pub fn tracking() -> (Spread, Spread) {
    let setup = Setup::new("link", "ACCEL = 60, MV = 1000", -25.0);
    let [rms, overshoot] = spread(|seed| {
        let mut motor = Motor::new(&setup, seed);
        motor.set(Property::M, 338);
        let samples = motor.run_to_end(3_000);
        assert_eq!(motor.ended, Some(EndReason::Arrived), "{seed:?}");
        let moving = samples.iter().filter(|sample| sample.driven);
        let error = moving.map(|sample| sample.truth.counts - sample.zero_counts - sample.setpoint_counts());
        let after = motor.run(300);
        let most = samples.iter().chain(&after).map(|sample| sample.truth.counts).fold(0.0, f64::max);
        [rms(error), (most - 338.0).max(0.0)]
    });
    (rms, overshoot)
}

/// Time of a move over the whole range with the greatest ACCEL and MV, ms, and by the shortest that this plant's motor allows.
pub fn full_travel(kind: &'static str) -> (Spread, Spread) {
    let (from, to) = travel(kind);
    let setup = Setup::new(kind, "ACCEL = 1000, MV = 4080", from.into());
    let [times, ratios] = spread(|seed| {
        let mut motor = Motor::new(&setup, seed);
        let optimum = optimum_ms(motor.node.board().rig().plant(), PEAK_A, f64::from(to - from));
        motor.set(Property::M, to.into());
        // The spread's brake takes 20 ms to release, in which nothing moves.
        let samples = motor.run_to_end(3_000);
        assert_eq!(motor.ended, Some(EndReason::Arrived), "{kind} {seed:?}");
        let waits =
            samples.iter().take_while(|sample| sample.truth.counts_per_s == 0.0).count().saturating_sub(1);
        let ms = (samples.len() - waits) as f64;
        [ms, ms / optimum]
    });
    (times, ratios)
}

/// A link's move by 10 counts with the greatest ACCEL: from the order until it stays within a count, ms; and overshoot, counts.
pub fn step() -> (Spread, Spread) {
    let setup = Setup::new("link", "ACCEL = 1000, MV = 4080, HOLD = 1", 40.0);
    let [settling, overshoot] = spread(|seed| {
        let mut motor = Motor::new(&setup, seed);
        motor.set(Property::M, 50);
        let counts: Vec<f64> = motor.run(700).iter().map(|sample| sample.truth.counts).collect();
        let settled = counts.iter().rposition(|counts| (counts - 50.0).abs() > 1.0).map_or(0, |ms| ms + 1);
        let most = counts.iter().copied().fold(0.0, f64::max);
        [settled as f64, (most - 50.0).max(0.0)]
    });
    (settling, overshoot)
}

/// A load on a spread that holds its position: the largest deviation, counts, and the time until it stays within a count, ms.
pub fn load_step(n_m: f64) -> (Spread, Spread) {
    let setup = Setup::new("spread", "", 40.0);
    let [deviation, recovery] = spread(|seed| {
        let mut motor = Motor::new(&setup, seed);
        motor.set(Property::MODE, 3);
        let held = motor.run(300).last().expect("300 samples").truth.counts;
        motor.node.rig_mut().set_disturbance(n_m);
        let away: Vec<f64> = motor.run(800).iter().map(|sample| (sample.truth.counts - held).abs()).collect();
        let settled = away.iter().rposition(|&away| away > 1.0).map_or(0, |ms| ms + 1);
        [away.iter().copied().fold(0.0, f64::max), settled as f64]
    });
    (deviation, recovery)
}

/// Order of a velocity to a spread and the samples from 700 ms on.
fn at_velocity(setup: &Setup, seed: Option<u64>, v: i64) -> Vec<Sample> {
    let mut motor = Motor::new(setup, seed);
    motor.set(Property::MODE, 4);
    motor.set(Property::V, v);
    motor.run(2_000).split_off(700)
}

/// The largest error of the mean velocity of mode 4 at V 20 to 500 with the default gain, %.
pub fn velocity_error() -> Spread {
    let setup = Setup::new("spread", "", 0.0);
    let [spread] = spread(|seed| {
        let error = |v: i64| {
            let samples = at_velocity(&setup, seed, v);
            100.0 * (mean(samples.iter().map(|sample| sample.truth.counts_per_s)) / v as f64 - 1.0).abs()
        };
        [[20, 50, 100, 200, 500].map(error).into_iter().fold(0.0, f64::max)]
    });
    spread
}

/// The largest ripple in mode 4 with KPV `gain` at V 20 to 500 and inertia 0.5 to 2, counts/s RMS.
pub fn velocity_ripple(gain: u16) -> Spread {
    let [spread] = spread(|seed| {
        let mut most = 0.0;
        for inertia in [1e-5, 2e-5, 4e-5] {
            let setup =
                Setup::new("spread", &format!("KPV = {gain}"), 0.0).plant(&format!("j_kg_m2 = {inertia:?}"));
            for v in [20, 100, 500] {
                most = f64::max(most, velocity_rms(&at_velocity(&setup, seed, v)));
            }
        }
        [most]
    });
    spread
}

/// RMS error of the estimated velocity during a link's move with ACCEL 100, counts/s.
pub fn estimator_error() -> Spread {
    let setup = Setup::new("link", "ACCEL = 100, MV = 1000", -25.0);
    let [spread] = spread(|seed| {
        let mut motor = Motor::new(&setup, seed);
        motor.set(Property::M, 338);
        let samples = motor.run_to_end(3_000);
        let error = |sample: &Sample| sample.status.velocity.0.to_num::<f64>() - sample.truth.counts_per_s;
        [rms(samples.iter().filter(|sample| sample.driven).map(error))]
    });
    spread
}

/// True speed at the end of a move with HOLD, counts/s.
pub fn arrival_speed(kind: &'static str, accel: u16) -> Spread {
    let (from, to) = travel(kind);
    let setup = Setup::new(kind, &format!("ACCEL = {accel}, MV = 4080, HOLD = 1"), from.into());
    let [spread] = spread(|seed| {
        let mut motor = Motor::new(&setup, seed);
        motor.set(Property::M, to.into());
        let samples = motor.run_to_end(3_000);
        assert_eq!(motor.ended, Some(EndReason::Arrived), "{kind} {seed:?}");
        [samples.last().expect("it moved").truth.counts_per_s.abs()]
    });
    spread
}

/// Torque of a unit of T on this plant, N·m: 24 V across its winding at 25 °C give 1024. Its board knows neither R nor Ke (decision 0005).
fn unit_n_m(motor: &Motor) -> f64 {
    let plant = motor.node.board().rig().plant();
    24.0 / plant.r_ohm * plant.ke_v_s / 1024.0
}

/// Error of the mean torque on the rotor in mode 2, %: against a stop, or once the servo has learned the EMF in a fast move and the rotor turns
/// behind a load that grows with the velocity and balances T at 100 counts/s.
pub fn torque_error(seed: Option<u64>, t: i64, turning: bool, winding_c: f64) -> f64 {
    let stop = if turning { "" } else { "min_count = 0, max_count = 4000" };
    let mut setup = Setup::new("spread", "ACCEL = 1000, MV = 4080, OTEMP = 1250", 1.0).plant(stop);
    setup.winding_c = winding_c;
    let mut motor = Motor::new(&setup, seed);
    if turning {
        motor.set(Property::M, 160);
        motor.run_to_end(3_000);
        motor.run(100);
    }
    motor.set(Property::MODE, 2);
    motor.set(Property::T, if turning { t } else { -t });
    let ordered = t as f64 * unit_n_m(&motor);
    let mean_torque = |samples: &[Sample]| mean(samples.iter().map(|sample| sample.truth.torque_n_m));
    let torque = if turning {
        let load = (ordered - motor.node.board().rig().plant().coulomb_n_m) / 100.0;
        let brake = |motor: &mut Motor| {
            let sample = motor.step();
            motor.node.rig_mut().set_disturbance(-load * sample.truth.counts_per_s);
            sample
        };
        let samples: Vec<Sample> = (0..1_500).map(|_| brake(&mut motor)).collect();
        mean_torque(&samples[500..])
    } else {
        -mean_torque(&motor.run(300)[200..])
    };
    100.0 * (torque / ordered - 1.0)
}

/// The largest error of the torque: with T 20 to 750 against a stop, and with T 200 to 750 turning; %.
pub fn torque(winding_c: f64) -> (Spread, Spread) {
    let [stalled, turning] = spread(|seed| {
        let worst = |ts: &[i64], turning| {
            ts.iter().map(|&t| torque_error(seed, t, turning, winding_c).abs()).fold(0.0, f64::max)
        };
        [worst(&[20, 50, 100, 200, 400, 750], false), worst(&[200, 400, 750], true)]
    });
    (stalled, turning)
}

/// Peak-to-peak motion of a link that holds its position, from 300 ms after its arrival on, counts.
pub fn rest() -> Spread {
    let setup = Setup::new("link", "ACCEL = 100, MV = 1000, HOLD = 1", 0.0);
    let [spread] = spread(|seed| {
        let mut motor = Motor::new(&setup, seed);
        motor.set(Property::M, 100);
        motor.run_to_end(3_000);
        let counts = motor.run(1_300).split_off(300);
        let counts = counts.iter().map(|sample| sample.truth.counts);
        [counts.clone().fold(f64::MIN, f64::max) - counts.fold(f64::MAX, f64::min)]
    });
    spread
}

/// What ended the free moves of a link, a spread and a tip over their range with the manual's settings, where that was no arrival.
pub fn free_move(seed: u64) -> Vec<String> {
    let wrong = |kind: &&'static str| {
        let (from, to) = travel(kind);
        let setup = Setup { set: String::new(), scatter: (0.5, 15.0), ..Setup::new(kind, "", from.into()) };
        let mut motor = Motor::new(&setup, Some(seed));
        motor.set(Property::M, to.into());
        motor.run_to_end(30_000);
        (motor.ended != Some(EndReason::Arrived)).then(|| format!("seed {seed}, {kind}: {:?}", motor.ended))
    };
    KINDS.iter().filter_map(wrong).collect()
}
