//! Random moves of scattered motors: plans and new plans on the way, loads, gains and limits within what a user would set.

use hil_world::node::Sample;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use servo_core::EndReason;
use tater_wire::Property;

use super::rig::{KINDS, Motor, Setup, travel};

/// Moves of one motor.
pub const MOVES: u64 = 10;

/// What the moves of a motor came to.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    pub moves: u64,
    /// Moves that stalled on their load instead.
    pub stalled: u64,
    /// Arrivals after which HOLD has not come to rest within 300 ms, but has within 1 s.
    pub late: u64,
    /// True speed of each arrival, counts/s.
    pub speeds: Vec<f64>,
    /// What must not be: the move and what it did.
    pub wrong: Vec<String>,
}

/// What an arrival is held to.
#[derive(Clone, Copy, Debug)]
struct Order {
    end: i64,
    mpe: i64,
    holds: bool,
}

/// Distance within which a rotor rests that is called arrived, beyond MPE: half a count and a hall's placement error of 10° electrical. It
/// may slip by a count into the next cell.
const CELL_COUNTS: f64 = 0.5 + 1.0 / 6.0;
const SLIP_COUNTS: f64 = 1.0;
/// No arrival may be faster, counts/s: one that breaks loose in the moment.
const MOST_COUNTS_S: f64 = 103.0;
/// Motion at rest with HOLD, from 300 ms after the arrival on, peak to peak.
const HUNTING_COUNTS: f64 = 0.5;

/// Moves of the motor of a seed, over its joint's range. Within: ACCEL 5 to 1000, MV 20 to 4080, MPE 0 to 20, KP 60 to 180, KD 320 to 960, HOLD, a steady load
/// of up to 0.02 N·m, new ends on the way. More than the least friction, 0.021 N·m, turns a joint at less than a count a second until an edge
/// shows it.
pub fn random_moves(seed: u64) -> Tally {
    let mut random = Pcg64Mcg::new(u128::from(seed) << 64 | 0x30_7e5);
    let kind = KINDS[random.random_range(0..KINDS.len())];
    let set = format!("KP = {}, KD = {}", random.random_range(60..=180), random.random_range(320..=960));
    let mut motor = Motor::new(&Setup::new(kind, &set, 0.0), Some(seed));
    let (first, last) = travel(kind);
    let ends = i64::from(first)..=i64::from(last);
    let mut tally = Tally::default();
    for _ in 0..MOVES {
        // Even in logarithm.
        let mut log = |low: f64, high: f64| low * (high / low).powf(random.random_range(0.0..=1.0));
        let (accel, mv, mpe) = (log(5.0, 1000.0) as i64, log(20.0, 4080.0) as i64, log(1.0, 21.0) as i64 - 1);
        let hold = random.random_range(0..=1);
        let load = if random.random_range(0..2) == 0 { 0.0 } else { random.random_range(-0.02..=0.02) };
        for (property, value) in
            [(Property::ACCEL, accel), (Property::MV, mv), (Property::MPE, mpe), (Property::HOLD, hold)]
        {
            motor.set(property, value);
        }
        motor.node.rig_mut().set_disturbance(load);
        let mut end = random.random_range(ends.clone());
        motor.set(Property::M, end);
        motor.ended = None;
        if random.random_range(0..3) == 0 {
            let ms = random.random_range(1..400);
            let (mut left, mut stopped) = (ms, false);
            while left > 0 && !stopped {
                motor.step();
                left -= 1;
                stopped = motor.ended.is_some();
            }
            end = random.random_range(ends.clone());
            motor.set(Property::M, end);
            motor.ended = None;
        }
        let samples = motor.run_to_end(120_000);
        tally.moves += 1;
        let what = format!(
            "seed {seed}, a {kind} to {end}, ACCEL {accel}, MV {mv}, MPE {mpe}, HOLD {hold}, {set}, load {load:.3}"
        );
        match motor.ended {
            Some(EndReason::Arrived) => {}
            Some(EndReason::Stalled) if load != 0.0 => {
                tally.stalled += 1;
                continue;
            }
            ended => {
                tally.wrong.push(format!("{what}: {ended:?}"));
                return tally;
            }
        }
        tally.judge(&mut motor, &samples, &what, Order { end, mpe, holds: hold == 1 });
    }
    tally
}

impl Tally {
    /// Takes note of an arrival, and lets the motor rest for half a second.
    fn judge(&mut self, motor: &mut Motor, samples: &[Sample], what: &str, order: Order) {
        let last = samples.last().expect("a move takes a tick");
        let speed = last.truth.counts_per_s.abs();
        self.speeds.push(speed);
        if speed > MOST_COUNTS_S {
            self.wrong.push(format!("{what}: arrived at {speed:.0} counts/s"));
        }
        let most_torque = samples.iter().map(|sample| sample.status.torque.0.unsigned_abs()).max();
        if most_torque.is_some_and(|torque| torque > 750 + 512) {
            self.wrong.push(format!("{what}: torque {most_torque:?}"));
        }
        let counts: Vec<f64> =
            motor.run(500).iter().map(|sample| sample.truth.counts - sample.zero_counts).collect();
        let rest = (counts[counts.len() - 1] - order.end as f64).abs();
        // Without HOLD the load may turn the joint: a spread brakes, a worm locks.
        if rest > order.mpe as f64 + CELL_COUNTS + SLIP_COUNTS {
            self.wrong.push(format!("{what}: rests {rest:.2} counts from its end"));
        }
        if order.holds && swing(&counts[300..]) > HUNTING_COUNTS {
            // It looks for its load; hunting is what does not end.
            motor.run(500);
            let later: Vec<f64> = motor.run(500).iter().map(|sample| sample.truth.counts).collect();
            if swing(&later) > HUNTING_COUNTS {
                self.wrong.push(format!("{what}: moves by {:.2} counts at rest", swing(&later)));
            } else {
                self.late += 1;
            }
        }
    }
}

/// From peak to peak.
fn swing(counts: &[f64]) -> f64 {
    let (low, high) =
        counts.iter().fold((f64::MAX, f64::MIN), |(low, high), &at| (low.min(at), high.max(at)));
    high - low
}
