//! Hall decoder and the estimator of recorded shafts against recordings, and against generated motions of known velocity.

use hil_experiment::recorded::real::Real;
use hil_experiment::recorded::{RecordedShaft, Tuning};
use hil_experiment::replay;
use proptest::prelude::*;
use servo_core::sense::hall::{HallDecoder, HallEvent, Wiring};
use servo_core::units::Micros;
use std::fs::File;
use std::io::Read;
use std::path::PathBuf;

use flate2::read::GzDecoder;

use crate::fences::root;
use crate::figures::Figure::Near;
use crate::figures::claim;

struct Score {
    velocity_mse: f64,
    position_mse: f64,
    bias_pct: f64,
}

/// Truth from falling edges alone, at constant speed between two of them: rising edges are late.
fn truth(codes: &[u8], rate: f64) -> (Vec<f64>, Vec<f64>) {
    const PLACE: [i32; 8] = [0, 0, 2, 1, 4, 5, 3, 0];
    let place = |code: u8| PLACE[usize::from(code)];
    let mut count = 0;
    let mut falls: Vec<(usize, i32)> = Vec::new();
    let mut position = vec![0.5; codes.len()];
    let mut velocity = vec![0.0; codes.len()];
    for (i, pair) in codes.windows(2).enumerate() {
        let step = match (place(pair[1]) - place(pair[0])).rem_euclid(6) {
            far @ 3.. => far - 6,
            near => near,
        };
        count += step;
        position[i + 1] = f64::from(count) + 0.5;
        let line = pair[0] ^ pair[1];
        if line.count_ones() == 1 && pair[0] & line != 0 {
            falls.push((i + 1, if step > 0 { count } else { count + 1 }));
        }
    }
    for pair in falls.windows(2) {
        let ((from, a), (to, b)) = (pair[0], pair[1]);
        let speed = f64::from(b - a) / (to - from) as f64;
        for i in from..to {
            velocity[i] = speed * rate;
            position[i] = f64::from(a) + speed * (i - from) as f64;
        }
    }
    (position, velocity)
}

fn mean(x: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = x.len() as f64;
    x.sum::<f64>() / n
}

fn score(codes: &[u8], estimate: &[(f64, f64)], rate: f64) -> Score {
    let (position, velocity) = truth(codes, rate);
    let same = velocity.iter().zip(estimate).map(|(v, e)| v * e.1).sum::<f64>() >= 0.0;
    let sign = if same { 1.0 } else { -1.0 };
    let off: Vec<f64> = position.iter().zip(estimate).map(|(p, e)| p - sign * e.0).collect();
    let mut sorted = off.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    let error: Vec<f64> = velocity.iter().zip(estimate).map(|(v, e)| v - sign * e.1).collect();
    let window = (rate / 10.0) as usize;
    let mut bias_pct = 0.0_f64;
    for (v, e) in velocity.chunks_exact(window).zip(error.chunks_exact(window)) {
        let even = mean(v.iter().copied());
        let spread = |pick: fn(f64, f64) -> f64| v.iter().map(|v| v.abs()).reduce(pick).unwrap_or(0.0);
        if even.abs() >= 50.0 && spread(f64::max) - spread(f64::min) <= 0.05 * even.abs() {
            bias_pct = bias_pct.max((mean(e.iter().copied()) / even).abs() * 100.0);
        }
    }
    Score {
        velocity_mse: mean(error.iter().map(|e| e * e)),
        position_mse: mean(off.iter().map(|e| (e - median).powi(2))),
        bias_pct,
    }
}

/// What is asserted of a recording.
struct Bound {
    name: &'static str,
    /// Read on even marks, as the labels are: velocity and position.
    labels: (f64, f64),
    /// The rotor's reading.
    rotor: (f64, f64),
}

/// Measured, and 5 %; the aim where that is less (64, 207, 268 and 139 for velocity on even marks).
const BOUNDS: [Bound; 4] = [
    Bound { name: "20250616-back-and-forth", labels: (64.0, 0.040), rotor: (67.7, 0.042) },
    Bound { name: "20250616-speed-cycle", labels: (148.0, 0.052), rotor: (339.0, 0.052) },
    Bound { name: "20260618-spindle-hw", labels: (197.0, 0.0020), rotor: (576.0, 0.0023) },
    Bound { name: "20250615-new-slow", labels: (139.0, 0.092), rotor: (161.0, 0.101) },
];

/// Where the recording of this name is.
fn file_of(name: &str) -> PathBuf {
    root().join("tests/captures").join(format!("{name}.dat.gz"))
}

/// Recordings of motors, replayed with 90 counts a revolution. A result below half of a bound is suspicious: edges are known to 1/30 ms only, which
/// is 2 % of the interval of two falling edges at 1500 counts/s.
#[test]
fn recordings_score_within_their_bounds() {
    let mut stated = Vec::new();
    for (bound, (name, codes, _)) in BOUNDS.iter().zip(recordings()) {
        let mut lines = Vec::new();
        let replayed =
            replay::replay(&file_of(name), 90, 30_000, &mut lines).unwrap_or_else(|e| panic!("{e}"));
        let text = String::from_utf8(lines).expect("text");
        let estimate: Vec<(f64, f64)> = text
            .lines()
            .map(|line| line.split_once(',').expect("two columns"))
            .map(|(p, v)| (p.parse().expect("position"), v.parse().expect("velocity")))
            .collect();
        assert_eq!((estimate.len(), replayed.bad), (replayed.samples, 0));
        let labels = score(&codes, &estimate, 30_000.0);
        let rotor = replay::readings(&codes, 30_000, RecordedShaft::<180>::new(0), RecordedShaft::at);
        let rotor = score(&codes, &rotor, 30_000.0);
        for (reading, s) in [("on even marks", &labels), ("the rotor", &rotor)] {
            println!(
                "{name}, {reading}: velocity {:.1}, position {:.4}, bias {:.3} %",
                s.velocity_mse, s.position_mse, s.bias_pct
            );
        }
        for (s, (velocity, position)) in [(&labels, bound.labels), (&rotor, bound.rotor)] {
            assert!(
                s.velocity_mse < velocity && s.velocity_mse > velocity / 2.0,
                "{name}: {}",
                s.velocity_mse
            );
            assert!(s.position_mse < position && s.position_mse > 0.001, "{name}: {}", s.position_mse);
            // The rotor's reading leaves out the ripple of uneven marks, 0.04 % more in the worst tenth of a second.
            assert!(s.bias_pct <= 0.35, "{name}: {} %", s.bias_pct);
        }
        assert!(labels.bias_pct <= 0.3, "{name}: {} %", labels.bias_pct);
        stated.push(Near(labels.velocity_mse));
    }
    claim("docs/figures.md", "| {}, {}, {}, {} (counts/s)²; best public estimator", &stated);
}

/// Name, codes and true velocity of each recording.
fn recordings() -> [(&'static str, Vec<u8>, Vec<f64>); 4] {
    BOUNDS.map(|Bound { name, .. }| {
        let file = File::open(file_of(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        let mut raw = Vec::new();
        GzDecoder::new(file).read_to_end(&mut raw).unwrap_or_else(|error| panic!("{name}: {error}"));
        let codes = replay::samples(&raw).unwrap_or_else(|error| panic!("{name}: {error:?}")).codes;
        let (_, velocity) = truth(&codes, 30_000.0);
        (name, codes, velocity)
    })
}

/// Mean square velocity error on even marks, at each tenth sample.
fn tenth_score(codes: &[u8], truth: &[f64], tuning: Tuning) -> f64 {
    let mut halls = HallDecoder::new(Wiring::from_number(2).expect("wiring 2"), codes[0], 0);
    let mut shaft = RecordedShaft::<180>::with_tuning(0, tuning);
    let (mut last, mut errors) = (codes[0], [Vec::new(), Vec::new()]);
    for ((i, &code), truth) in (0_u32..).zip(codes).zip(truth) {
        let now = Micros((u64::from(i) * 100 / 3) as u32);
        if code != last || i % 30 == 0 {
            if let Some(HallEvent::Step(edge)) = halls.sample(code, now) {
                shaft.edge(&edge);
            }
            last = code;
        }
        if i % 10 == 0 {
            let v = shaft.on_even_marks(now).1.0.to_num::<f64>();
            // The wiring's direction is unknown.
            errors[0].push((v - truth).powi(2));
            errors[1].push((v + truth).powi(2));
        }
    }
    let [same, other] = errors.map(|e| mean(e.into_iter()));
    same.min(other)
}

fn real(text: &str) -> Real {
    text.parse().expect("a number")
}

/// Multiplies constants of the estimator.
type Knob = fn(&mut Tuning, Real);

const KNOBS: [Knob; 13] = [
    |t, by| (t.accelerations[0], t.accelerations[2]) = (t.accelerations[0] * by, t.accelerations[2] * by),
    |t, by| t.accelerations[1] *= by,
    |t, by| t.accelerations[3] *= by,
    |t, by| (t.deviations[0], t.deviations[1]) = (t.deviations[0] * by, t.deviations[1] * by),
    |t, by| (t.deviations[2], t.deviations[3]) = (t.deviations[2] * by, t.deviations[3] * by),
    |t, by| t.stay = real("1") - (real("1") - t.stay) * by,
    |t, by| t.run *= by,
    |t, by| t.first_speed *= by,
    |t, by| t.width_variance *= by,
    |t, by| (t.cogging_variance, t.cogging_growth) = (t.cogging_variance * by, t.cogging_growth * by),
    |t, by| t.residual_factor *= by,
    |t, by| t.residual_memory *= by,
    |t, by| t.score_memory *= by,
];

/// Guards against tuning to recordings: leaves each out in turn, chooses the constants from the others by coordinate
/// descent from powers of ten, and scores the one left out. Takes minutes, so only on request.
#[test]
fn leave_one_out() {
    if std::env::var_os("LEAVE_ONE_OUT").is_none() {
        println!(
            "skipped: set LEAVE_ONE_OUT=1 to choose constants from three recordings and score the fourth"
        );
        return;
    }
    let start = Tuning {
        accelerations: ["1000", "100000", "1000", "1000000"].map(real),
        deviations: ["0.01", "0.01", "0.1", "0.1"].map(real),
        stay: real("0.99"),
        run: real("1"),
        first_speed: real("100"),
        width_variance: real("0.01"),
        cogging_variance: real("100000"),
        cogging_growth: real("1000"),
        residual_factor: real("10"),
        residual_memory: real("100"),
        score_memory: real("100"),
        better: real("0.9"),
    };
    let recordings = recordings();
    for left in &recordings {
        let others = || recordings.iter().filter(|other| other.0 != left.0);
        let cost = |t: Tuning| others().map(|(_, c, v)| tenth_score(c, v, t).ln()).sum::<f64>();
        let (mut best, mut least) = (start, cost(start));
        for step in ["4", "2", "1.5"].map(real) {
            for (knob, by) in KNOBS.iter().flat_map(|knob| [(knob, step), (knob, real("1") / step)]) {
                let mut tuning = best;
                knob(&mut tuning, by);
                let cost = cost(tuning);
                if cost < least {
                    (best, least) = (tuning, cost);
                }
            }
        }
        let scored = |t| {
            let rows = replay::readings(
                &left.1,
                30_000,
                RecordedShaft::<180>::with_tuning(0, t),
                RecordedShaft::on_even_marks,
            );
            let s = score(&left.1, &rows, 30_000.0);
            format!(
                "velocity {:.1}, position {:.4}, bias {:.2} %",
                s.velocity_mse, s.position_mse, s.bias_pct
            )
        };
        println!("{}: start {}; chosen from the others {}", left.0, scored(start), scored(best));
        println!("  {best:?}");
    }
}

/// xorshift64*: a seed gives the same motion with any version of `rand`.
struct Dice(u64);

impl Dice {
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn range(&mut self, from: f64, to: f64) -> f64 {
        from + (to - from) * self.unit()
    }
}

/// One motor: placement of its edges in a revolution, and delay of its rising lines.
struct Motor {
    offsets: Vec<f64>,
    rise_us: u32,
    high_since: [Option<u32>; 3],
}

impl Motor {
    /// `counts` a revolution, edges displaced by up to ± `degrees` electrical, rising lines late by up to 300 µs.
    fn new(dice: &mut Dice, counts: usize, degrees: f64) -> Self {
        // Six edges in 360°.
        let offsets = (0..counts).map(|_| dice.range(-degrees / 60.0, degrees / 60.0)).collect();
        Self { offsets, rise_us: dice.range(0.0, 300.0) as u32, high_since: [Some(0); 3] }
    }

    fn cell(&self, position: f64) -> i32 {
        let near = (position + 0.5).floor() as i32;
        let boundary =
            |k: i32| f64::from(k) - 0.5 + self.offsets[k.rem_euclid(self.offsets.len() as i32) as usize];
        (near - 1..=near + 1).rev().find(|&k| position >= boundary(k)).unwrap_or(near - 1)
    }

    /// The lines: falling at once, rising with a delay.
    fn lines(&mut self, position: f64, now: u32) -> u8 {
        let field = Wiring::STANDARD.code(self.cell(position).rem_euclid(6) as u8);
        let mut code = 0;
        for (bit, since) in self.high_since.iter_mut().enumerate() {
            *since = if field >> bit & 1 == 1 { since.or(Some(now)) } else { None };
            if since.is_some_and(|t| t == 0 || now - t >= self.rise_us) {
                code |= 1 << bit;
            }
        }
        code
    }
}

/// Quality of a generated run: summed square velocity errors of the estimator and of the plain interval
/// velocity, the largest error of the estimator, and the number of ticks.
#[derive(Default)]
struct Run {
    ours: f64,
    plain: f64,
    worst: f64,
    ticks: f64,
}

/// 12 s of moves back and forth with accelerations from `accelerations`, cruising at 50..1000 counts/s, with
/// dwells; `glitches` is the fraction of edges that follow a wrong code of 4 µs.
fn run(seed: u64, accelerations: (f64, f64), glitches: f64) -> Run {
    let mut dice = Dice(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let mut motor = Motor::new(&mut dice, 18, 10.0);
    let (mut position, mut velocity, mut target, mut acceleration) = (0.0_f64, 0.0_f64, 0.0_f64, 1000.0);
    let first = motor.lines(position, 0);
    let start = motor.cell(position);
    let mut halls = HallDecoder::new(Wiring::STANDARD, first, start);
    let mut estimator = RecordedShaft::<18>::new(start);
    let mut seen = first;
    // Plain: one count over the last interval, less when the next edge is overdue, zero after a reversal.
    let (mut edge_at, mut edge_sign, mut plain) = (0_u32, 0, 0.0_f64);
    let (mut r, mut until) = (Run::default(), 200_000_u32);
    for now in (10..12_000_000_u32).step_by(10) {
        if now >= until {
            until = now + dice.range(100_000.0, 500_000.0) as u32;
            acceleration = dice.range(accelerations.0, accelerations.1);
            target = match dice.unit() {
                x if x < 0.2 => 0.0,
                x => dice.range(50.0, 1000.0) * if x < 0.6 { 1.0 } else { -1.0 },
            };
        }
        velocity += (target - velocity).clamp(-acceleration * 1e-5, acceleration * 1e-5);
        position += velocity * 1e-5;
        let code = motor.lines(position, now);
        let glitch = code != seen && dice.unit() < glitches;
        let wrong = (dice.unit() * 8.0) as u8;
        // The wrong code comes 8 µs before the change: lines ring when they switch.
        let samples = [glitch.then_some((wrong, 0)), glitch.then_some((seen, 4)), Some((code, 8))];
        let tick = now % 1000 == 0;
        if code != seen || tick {
            for (code, after) in samples.into_iter().flatten() {
                let at = Micros(now + after);
                let Some(HallEvent::Step(edge)) = halls.sample(code, at) else { continue };
                estimator.edge(&edge);
                // The plain estimator ignores impossible codes too.
                if edge.bounce || at.0 - edge_at < 100 {
                    continue;
                }
                let sign = edge.way.along(1);
                let dt = f64::from(at.0 - edge_at).max(1.0) * 1e-6;
                plain = if sign == edge_sign { f64::from(sign) * f64::from(edge.steps) / dt } else { 0.0 };
                (edge_at, edge_sign) = (at.0, sign);
            }
            seen = code;
        }
        if tick && now > 10_000 {
            let (p, v) = estimator.at(Micros(now + 8));
            assert!(
                (p.0.to_num::<f64>() - f64::from(halls.count())).abs() <= 0.5,
                "position outside its cell"
            );
            let error = v.0.to_num::<f64>() - velocity;
            let bound = 1.0 / (f64::from(now + 8 - edge_at).max(1.0) * 1e-6);
            let plain_error = plain.clamp(-bound, bound) - velocity;
            r.ours += error * error;
            r.plain += plain_error * plain_error;
            r.worst = r.worst.max(error.abs());
            r.ticks += 1.0;
        }
    }
    assert_eq!(halls.count(), motor_count(&motor, halls.count(), position), "seed {seed}");
    r
}

/// The cell that the lines show at the end, which may lag the rotor by an edge that has not risen yet.
fn motor_count(motor: &Motor, count: i32, position: f64) -> i32 {
    let cell = motor.cell(position);
    if (cell - count).abs() <= 1 { count } else { cell }
}

fn total(accelerations: (f64, f64), glitches: f64) -> (f64, f64, f64) {
    let runs: Vec<Run> = (1..=20).map(|seed| run(seed, accelerations, glitches)).collect();
    let ticks: f64 = runs.iter().map(|r| r.ticks).sum();
    let rms = |f: fn(&Run) -> f64| (runs.iter().map(f).sum::<f64>() / ticks).sqrt();
    (rms(|r| r.ours), rms(|r| r.plain), runs.iter().map(|r| r.worst).fold(0.0, f64::max))
}

#[test]
fn generated_motions_beat_the_interval_velocity() {
    for (name, accelerations) in
        [("gentle", (300.0, 1500.0)), ("brisk", (3000.0, 8000.0)), ("hard", (20_000.0, 70_000.0))]
    {
        for glitches in [0.0, 0.01] {
            let (ours, plain, worst) = total(accelerations, glitches);
            println!(
                "{name}, glitches {glitches}: ours {ours:.1}, plain {plain:.1}, worst {worst:.0} counts/s"
            );
            // ±10° placement alone gives an interval an error of 14 % rms (√2 · (1/6)/√3). With learned
            // placement, half the error is the least to expect, also where lag rather than placement
            // dominates. A twentieth would require knowing a start or a reversal before its first edge.
            assert!(ours < plain / 2.0 && ours > plain / 20.0, "{name}, {glitches}: {ours} against {plain}");
            // The hardest acceleration for 10 ms, the duration of a start from rest and its first edges.
            assert!(worst < 700.0, "{name}, {glitches}: {worst} counts/s");
        }
    }
}

/// Velocity at 30 kHz of 30 s of generated moves: from the lines, and of the rotor.
fn recording(seed: u64, accelerations: (f64, f64)) -> (Vec<u8>, Vec<f64>) {
    let mut dice = Dice(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let mut motor = Motor::new(&mut dice, 18, 10.0);
    let (mut position, mut velocity, mut target, mut acceleration, mut until) =
        (0.0, 0.0_f64, 0.0, 1000.0, 0);
    let sample = |i: u32| {
        if i >= until {
            until = i + dice.range(3000.0, 30_000.0) as u32;
            acceleration = dice.range(accelerations.0, accelerations.1);
            target = dice.range(50.0, 1000.0) * if dice.unit() < 0.5 { 1.0 } else { -1.0 };
        }
        velocity += (target - velocity).clamp(-acceleration / 3e4, acceleration / 3e4);
        position += velocity / 3e4;
        (motor.lines(position, i * 100 / 3), velocity)
    };
    (0..900_000).map(sample).unzip()
}

/// Either the marks are misplaced (as here), or the rotor ripples over even marks (as the truth from falling
/// edges reads the same lines). The reading on even marks is right in the second case and wrong by the whole ripple in
/// the first; the rotor's reading is the other way around. So neither is better, and only one may enter a control loop.
#[test]
fn each_reading_is_right_for_its_own_truth() {
    for (seed, accelerations) in [(1, (300.0, 1500.0)), (2, (300.0, 1500.0)), (3, (3000.0, 8000.0))] {
        let (codes, rotor) = recording(seed, accelerations);
        let (_, marks) = truth(&codes, 30_000.0);
        let read = |reading| -> Vec<f64> {
            let rows = replay::readings(&codes, 30_000, RecordedShaft::<18>::new(0), reading);
            rows.into_iter().map(|(_, v)| v).collect()
        };
        let (smooth, even) = (read(RecordedShaft::at), read(RecordedShaft::on_even_marks));
        let mse = |a: &[f64], b: &[f64]| mean(a.iter().zip(b).map(|(a, b)| (a - b).powi(2)));
        let ripple = mse(&rotor, &marks);
        let (right, wrong) = (mse(&smooth, &rotor), mse(&even, &rotor));
        println!("ripple {ripple:.0}; rotor smooth: the rotor {right:.0}, on even marks {wrong:.0}");
        assert!(right < ripple / 5.0 && wrong > ripple / 2.0, "{right}, {wrong}, ripple {ripple}");
        let (wrong, right) = (mse(&smooth, &marks), mse(&even, &marks));
        println!("  marks even: the rotor {wrong:.0}, on even marks {right:.0}");
        assert!(right < ripple / 5.0 && wrong > ripple / 2.0, "{right}, {wrong}, ripple {ripple}");
    }
}

/// A motion that is hard to follow.
struct Hard {
    name: &'static str,
    /// Fastest target, counts/s.
    speed: f64,
    /// Counts/s².
    accelerations: (f64, f64),
    /// Probabilities that the next target is 0, and that it is in the other direction.
    stop: f64,
    reverse: f64,
    /// Seconds until the next target.
    dwell: (f64, f64),
    /// Surplus of v² at the peak of a cog, (counts/s)².
    cogging: f64,
    /// Bounds for 18 and 90 counts a revolution: rms errors of velocity, counts/s, and position, counts. Measured, and 5 %.
    bounds: [(f64, f64); 2],
}

const HARD: [Hard; 6] = [
    Hard {
        name: "hand",
        speed: 30.0,
        accelerations: (20.0, 300.0),
        stop: 0.25,
        reverse: 0.5,
        dwell: (0.1, 1.0),
        cogging: 0.0,
        bounds: [(5.1, 0.262), (5.28, 0.266)],
    },
    Hard {
        name: "hand over cogs",
        speed: 30.0,
        accelerations: (20.0, 300.0),
        stop: 0.25,
        reverse: 0.5,
        dwell: (0.1, 1.0),
        cogging: 130.0,
        bounds: [(6.1, 0.286), (5.95, 0.287)],
    },
    Hard {
        name: "brisk hand",
        speed: 200.0,
        accelerations: (200.0, 3000.0),
        stop: 0.2,
        reverse: 0.5,
        dwell: (0.1, 1.0),
        cogging: 0.0,
        bounds: [(9.38, 0.184), (12.7, 0.27)],
    },
    Hard {
        name: "slow over cogs",
        speed: 100.0,
        accelerations: (50.0, 300.0),
        stop: 0.0,
        reverse: 0.0,
        dwell: (1.0, 4.0),
        cogging: 640.0,
        bounds: [(5.94, 0.13), (6.68, 0.219)],
    },
    Hard {
        name: "spindle",
        speed: 1000.0,
        accelerations: (300.0, 1500.0),
        stop: 0.1,
        reverse: 0.1,
        dwell: (0.5, 2.0),
        cogging: 640.0,
        bounds: [(7.11, 0.087), (9.11, 0.191)],
    },
    Hard {
        name: "full torque",
        speed: 1000.0,
        accelerations: (20_000.0, 70_000.0),
        stop: 0.2,
        reverse: 0.5,
        dwell: (0.1, 0.5),
        cogging: 0.0,
        bounds: [(37.8, 0.185), (38.7, 0.214)],
    },
];

/// A rotor on its way to targets, with cogs.
struct Rotor {
    dice: Dice,
    position: f64,
    velocity: f64,
    target: f64,
    acceleration: f64,
    until: f64,
}

impl Rotor {
    /// Moves on by 25 µs, with so many counts in a cog.
    fn step(&mut self, hard: &Hard, now: f64, cog: f64) {
        const DT: f64 = 25e-6;
        if now >= self.until {
            self.until = now + self.dice.range(hard.dwell.0, hard.dwell.1);
            self.acceleration = self.dice.range(hard.accelerations.0, hard.accelerations.1);
            let sign = if (self.target < 0.0) == (self.dice.unit() < hard.reverse) { 1.0 } else { -1.0 };
            let stops = self.dice.unit() < hard.stop;
            self.target = if stops { 0.0 } else { sign * self.dice.range(hard.speed / 10.0, hard.speed) };
        }
        let most = self.acceleration * DT;
        self.velocity += (self.target - self.velocity).clamp(-most, most);
        if hard.cogging > 0.0 && (self.target != 0.0 || self.velocity.abs() > 2.0) {
            // The potential c/2·sin(2πx/cog) accelerates by its slope; the drive pulls back to the target within 0.1 s.
            let turn = std::f64::consts::TAU / cog;
            self.velocity += hard.cogging * turn * (turn * self.position).cos() * DT;
            self.velocity += (self.target - self.velocity) * DT / 0.1;
        }
        self.position += self.velocity * DT;
    }
}

type HardRun = fn(&Hard, usize, u64) -> [f64; 3];

/// Mean square errors of 12 s of a hard motion: velocity of the estimator and of the interval, position.
fn hard_run<const N: usize>(hard: &Hard, counts: usize, seed: u64) -> [f64; 3] {
    let mut dice = Dice(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1);
    let mut motor = Motor::new(&mut dice, counts, 15.0);
    let cog = if counts == 18 { 3.0 } else { 3.75 };
    let mut rotor = Rotor { dice, position: 0.0, velocity: 0.0, target: 0.0, acceleration: 0.0, until: 0.2 };
    let mut seen = motor.lines(0.0, 0);
    let start = motor.cell(0.0);
    let mut halls = HallDecoder::new(Wiring::STANDARD, seen, start);
    let mut shaft = RecordedShaft::<N>::new(start);
    let (mut edge_at, mut edge_sign, mut plain) = (0_u32, 0, 0.0_f64);
    let (mut sums, mut ticks) = ([0.0; 3], 0.0);
    for now in (25..12_000_000_u32).step_by(25) {
        rotor.step(hard, f64::from(now) * 1e-6, cog);
        let code = motor.lines(rotor.position, now);
        let tick = now % 1000 == 0;
        if (code != seen || tick)
            && let Some(HallEvent::Step(edge)) = halls.sample(code, Micros(now))
        {
            shaft.edge(&edge);
            if !edge.bounce {
                let sign = edge.way.along(1);
                let dt = f64::from((now - edge_at).max(25)) * 1e-6;
                plain = if sign == edge_sign { f64::from(sign) / dt } else { 0.0 };
                (edge_at, edge_sign) = (now, sign);
            }
        }
        seen = code;
        if tick {
            let (p, v) = shaft.at(Micros(now));
            let bound = 1.0 / (f64::from((now - edge_at).max(1)) * 1e-6);
            let errors = [
                v.0.to_num::<f64>() - rotor.velocity,
                plain.clamp(-bound, bound) - rotor.velocity,
                p.0.to_num::<f64>() - rotor.position,
            ];
            for (sum, error) in sums.iter_mut().zip(errors) {
                *sum += error * error;
            }
            ticks += 1.0;
        }
    }
    sums.map(|sum| sum / ticks)
}

/// Placement ±15° electrical and rise delay 0–300 µs in each run; both lap lengths; nothing learned beforehand.
#[test]
fn hard_motions_stay_within_their_bounds() {
    for hard in &HARD {
        let runs: [HardRun; 2] = [hard_run::<18>, hard_run::<180>];
        for ((run, counts), (velocity, position)) in runs.into_iter().zip([18, 90]).zip(hard.bounds) {
            let errors: Vec<[f64; 3]> = (1..=4).map(|seed| run(hard, counts, seed)).collect();
            let rms = |i: usize| mean(errors.iter().map(|e| e[i])).sqrt();
            let (ours, plain, place) = (rms(0), rms(1), rms(2));
            println!(
                "{}, {counts}: {ours:.2} counts/s, interval {plain:.2} ({:.3}), position {place:.3}",
                hard.name,
                ours / plain
            );
            assert!(ours < velocity && ours > velocity / 2.0, "{}: {ours} counts/s", hard.name);
            assert!(place < position && place > position / 2.0, "{}: {place} counts", hard.name);
        }
    }
}

proptest! {
    #[test]
    fn any_lines_keep_position_and_velocity_plausible(samples in prop::collection::vec((0..8_u8, 1..20_000_u32), 0..400), begin: u32) {
        let mut halls = HallDecoder::new(Wiring::STANDARD, 2, 0);
        let mut estimator = RecordedShaft::<18>::new(0);
        let mut now = begin;
        for (code, dt) in samples {
            now = now.wrapping_add(dt);
            if let Some(HallEvent::Step(edge)) = halls.sample(code, Micros(now)) {
                estimator.edge(&edge);
            }
            for later in [0, 300, 5000, 400_000, 1_000_000] {
                let (p, v) = estimator.clone().at(Micros(now.wrapping_add(later)));
                prop_assert!((p.0.to_num::<f64>() - f64::from(halls.count())).abs() <= 0.5);
                // The mean of a truncated normal velocity exceeds the bound of a constant one, 1⅓ counts in the elapsed
                // time, by its deviation at most; 200 µs apart is as near as the decoder lets edges follow.
                let passed = f64::from(later.max(200)) * 1e-6;
                prop_assert!(v.0.to_num::<f64>().abs() <= 4.0 / passed, "{v:?} after {later}");
                if later >= 1_000_000 {
                    prop_assert_eq!(v.0.to_num::<f64>(), 0.0);
                }
            }
        }
    }
}
