//! What the servo reaches on motors that nobody has described to its board: the table of `docs/servo.md`.
//!
//! Each figure is taken on the nominal motor, and on plants that differ by ±30 % in inertia, friction, Ke and R, on 20 to 28 V, with halls
//! misplaced by up to ±10°. The full size: `EFFORT=10 cargo test -p system-tests targets:: -- --nocapture`.

mod figures;
mod moves;
pub mod optimum;
mod picture;
mod rig;

use crate::effort::effort;
use tater_wire::Property;

use figures::{
    Spread, arrival_speed, estimator_error, full_travel, load_step, rest, ripple, step, torque, tracking,
    velocity_error, velocity_ripple,
};
use moves::random_moves;
use rig::KINDS;

/// Prints a row of the table and demands its bounds: of the nominal motor, of 95 % of the plants and of all of them.
///
/// The bounds are those of plants without effects.
fn judge(name: &str, spread: &Spread, nominal: f64, p95: f64, most: f64) {
    println!("figure: {name}: {spread}; wanted {nominal}, {p95} ({most})");
    if rig::with_effects() {
        return;
    }
    assert!(spread.nominal <= nominal, "{name}, nominal: {spread}");
    assert!(spread.p95 <= p95, "{name}, 95 %: {spread}");
    assert!(spread.most <= most, "{name}, all: {spread}");
}

const NO_BOUND: f64 = f64::INFINITY;

#[test]
fn ripple_of_slow_moves() {
    // The maxima miss 12, 6 and 6: a plant whose halls are misplaced most sticks and slips (docs/servo.md).
    // Of the first 100 plants 95 % are below 5.1, of 1,000 below 4.5.
    for (mv, p95, most) in [(16, 5.2, 30.0), (50, 3.0, 8.0), (100, 3.0, 10.0)] {
        judge(&format!("ripple at MV {mv}, counts/s"), &ripple(mv, 0.0), 1.0, p95, most);
    }
    for (mv, nominal) in [(16, 5.0), (50, 2.5), (100, 1.5)] {
        judge(
            &format!("ripple at MV {mv} with 5 mN m of cogging, counts/s"),
            &ripple(mv, 0.005),
            nominal,
            NO_BOUND,
            NO_BOUND,
        );
    }
}

#[test]
fn link_follows_its_set_point() {
    let (rms, overshoot) = tracking();
    judge("link-fast: tracking, counts rms", &rms, 0.1, 0.4, 1.0);
    judge("link-fast: overshoot, counts", &overshoot, 0.1, 0.8, 1.0);
}

#[test]
fn full_travel_takes_little_more_than_the_motor_needs() {
    // A spread's move is so short that the 10 ms in which an arrival is proved are 5 % of it: 1.25 is missed. A weak motor that overshoots
    // takes up to 1.7.
    for (kind, ms, ratio) in [("link", 435.0, 1.17), ("spread", 222.0, 1.29), ("tip", 595.0, 1.15)] {
        let (times, ratios) = full_travel(kind);
        judge(&format!("full travel of a {kind}, ms"), &times, ms, NO_BOUND, NO_BOUND);
        judge(&format!("full travel of a {kind}, by the plant's optimum"), &ratios, ratio, ratio, 1.7);
    }
}

#[test]
fn ten_counts_take_a_twentieth_of_a_second() {
    let (settling, overshoot) = step();
    // One plant in 1000 holds at 1.0 to 1.4 counts, within MPE.
    judge("10-count step: to ±1 count, ms", &settling, 45.0, 60.0, NO_BOUND);
    judge("10-count step: overshoot, counts", &overshoot, 0.3, 1.0, 2.0);
}

#[test]
fn load_is_held() {
    let (deviation, recovery) = load_step(0.2);
    judge("0.2 N m: deviation, counts", &deviation, 2.2, 4.0, 6.0);
    judge("0.2 N m: to ±1 count, ms", &recovery, 90.0, 160.0, 400.0);
}

#[test]
fn mode_four_keeps_its_velocity() {
    // The load that mode 4 adds is bounded by 40 units: at V 20 a joint with twice the friction creeps, and one in a hundred stands.
    judge("mode 4, V 20 to 500: error, %", &velocity_error(), 1.0, 5.0, 100.0);
    for (gain, p95) in [(8, 10.0), (32, 10.0), (64, 10.0), (128, 20.0)] {
        let name = format!("mode 4, gain {gain}, inertia 0.5 to 2: ripple, counts/s");
        judge(&name, &velocity_ripple(gain), 1.0, p95, 2.0 * p95);
    }
}

#[test]
fn estimator_knows_the_velocity() {
    // 15 is missed by 1.2: a third of the plants is heavier and weaker than their model until it has learned.
    judge("velocity as estimated at ACCEL 100: error, counts/s rms", &estimator_error(), 2.0, 17.0, 40.0);
}

#[test]
fn arrived_motor_is_slow() {
    for kind in KINDS {
        judge(
            &format!("speed of an arrived {kind} at ACCEL 100, counts/s"),
            &arrival_speed(kind, 100),
            10.0,
            20.0,
            80.0,
        );
        judge(
            &format!("speed of an arrived {kind} at ACCEL 1000, counts/s"),
            &arrival_speed(kind, 1000),
            10.0,
            35.0,
            80.0,
        );
    }
}

#[test]
fn torque_is_what_was_ordered() {
    let (stalled, turning) = torque(25.0);
    // Misplaced halls cost up to 1 − cos 40° at a stop. Turning behind a load of 0.48 N·m misses 3 % by 2, and 8 % of the plants by 9: the
    // model takes some of such a load for EMF. A measured current will tell them apart.
    judge("torque when stalled at 25 C: error, %", &stalled, 3.0, 10.0, 14.0);
    judge("torque when turning at 25 C: error, %", &turning, 6.0, 17.0, 40.0);
    let (stalled, turning) = torque(110.0);
    // T is a voltage, and the resistance of copper is a third higher. The model of the winding is too warm on purpose (decision 0051), so it
    // cannot compensate that: 5 % are missed.
    judge("torque when stalled at 110 C: error, %", &stalled, 26.5, 32.0, 34.0);
    judge("torque when turning at 110 C: error, %", &turning, 40.0, 52.0, 55.0);
}

#[test]
fn arrived_motor_stays_where_it_is() {
    let moved = rest();
    judge("motion from 300 ms after settling on, counts", &moved, 0.5, 0.5, 1.5);
}

/// Plants of ±50 % with halls misplaced by up to ±15°. The full size: `EFFORT=67 cargo test -p system-tests targets::free -- --nocapture`.
#[test]
fn free_motors_neither_stall_nor_break_away() {
    let plants = effort(150);
    let ends = figures::each(0..plants, figures::free_move);
    let wrong: Vec<&String> = ends.iter().flatten().collect();
    println!("figure: {} of {} free moves did not arrive", wrong.len(), 3 * plants);
    assert!(wrong.len() as u64 * 10_000 <= 3 * plants, "{wrong:#?}");
}

/// Motors that did what they must not before a correction: stalled on a load that was friction (6232, 13839), arrived while a growing torque
/// broke them loose (13437, 19617), and returned current unknown to their model (23002).
const CORRECTED: [u64; 5] = [6_232, 13_437, 13_839, 19_617, 23_002];

/// The full size, a million moves of 100,000 motors: `EFFORT=1700 cargo test -p system-tests targets::random -- --nocapture`.
#[test]
fn random_moves_arrive_and_rest() {
    let motors = effort(60);
    let tallies = figures::each((0..motors).chain(CORRECTED), random_moves);
    let moves: u64 = tallies.iter().map(|tally| tally.moves).sum();
    let stalled: u64 = tallies.iter().map(|tally| tally.stalled).sum();
    let mut speeds: Vec<f64> = tallies.iter().flat_map(|tally| tally.speeds.iter().copied()).collect();
    speeds.sort_by(f64::total_cmp);
    let p95 = speeds[(speeds.len() - 1) * 95 / 100];
    println!(
        "figure: {moves} random moves: {stalled} stalled on their load; arrived at {p95:.1} counts/s (95 %), all below {:.1}",
        speeds[speeds.len() - 1]
    );
    let wrong: Vec<&String> = tallies.iter().flat_map(|tally| &tally.wrong).collect();
    let late: u64 = tallies.iter().map(|tally| tally.late).sum();
    println!(
        "figure: {} of {moves} random moves did what they must not; {late} came to rest after 0.3 to 1 s",
        wrong.len()
    );
    // Measured: one in 50,000.
    assert!(late <= 1 + moves / 5_000, "{late} of {moves}");
    assert!(wrong.is_empty() && p95 <= 35.0 && speeds.len() > 10, "{p95}: {wrong:#?}");
}

/// A rotor that runs on longer than its model takes that for a load: the EMF of the model's velocity may not make it true.
#[test]
fn zero_torque_never_drives_a_heavy_motor_with_little_friction() {
    for (inertia, friction) in [(3e-5, 0.015), (4e-5, 0.015), (4e-5, 0.021)] {
        for bus_v in [20, 28] {
            let plant = format!(
                "j_kg_m2 = {inertia:?}, coulomb_n_m = {friction:?}, static_n_m = {friction:?}, bus_v = {bus_v}"
            );
            let mut motor = rig::Motor::new(&rig::Setup::new("link", "", 0.0).plant(&plant), None);
            motor.set(Property::MODE, 2);
            motor.set(Property::T, 300);
            while motor.step().truth.counts_per_s < 300.0 {}
            motor.set(Property::T, 0);
            motor.run(2);
            let (mut slowest, mut rise) = (f64::MAX, 0.0_f64);
            for sample in motor.run(800) {
                slowest = slowest.min(sample.truth.counts_per_s);
                rise = rise.max(sample.truth.counts_per_s - slowest);
            }
            assert!(rise < 5.0, "{plant}: faster by {rise:.0} counts/s at T = 0");
        }
    }
}
