//! Arrival is true: a motor that is called arrived stands, and comes to rest within MPE of its end, over scattered plants.
//! The full size, 320 plants for each motion: `EFFORT=40 cargo test -p system-tests arrival:: -- --nocapture`.

use crate::effort::effort;
use hil_experiment::run::Options;
use hil_experiment::scenario::Scenario;
use hil_world::node::Node;
use hil_world::plant::Model;
use servo_core::{EndReason, Event};
use tater_wire::Property;

const PLANTS: u64 = 8;

/// 95 % of arrivals are slower than this, counts/s: half a count in the 14 ms that GOD takes to learn of one.
const P95_COUNTS_S: f64 = 35.0;

/// No arrival may be faster, counts/s: one that breaks loose at the moment it is called arrived. Of 32,400 moves the fastest had 77.7.
const MOST_COUNTS_S: f64 = 80.0;

/// A rotor that rests in a cell within MPE is up to half a count and a hall's placement error (10° electrical) beyond it.
const CELL_COUNTS: f64 = 0.5 + 1.0 / 6.0;

/// A rotor that friction holds under torque may slip into the next cell after its arrival: with MPE 0, 4 of 10,800 did.
const SLIP_COUNTS: f64 = 1.0;

struct Ended {
    reason: EndReason,
    ms: u32,
    /// True speed at the end, counts/s.
    speed: f64,
    /// True distance from E once at rest, counts.
    rest: f64,
}

/// A move of a scattered motor with `set`, its stops moved away. Without breakaway, which ends a hard start of a link.
fn moved(motor: &str, set: &str, (from, to): (i32, i32), seed: u64) -> Ended {
    let text = format!(
        "name = \"arrival\"\nabout = \"\"\nmotor = \"{motor}\"\nduration_ms = 1\nscatter = 0.3\nhall_scatter_deg = 10\n\
         set = {{ MCV = 4080, MOV = 4080, BT = 0, {set} }}\nplant = {{ min_count = -400, max_count = 700 }}\n\
         initial = {{ position_counts = {from} }}\n"
    );
    let scenario = Scenario::parse("arrival", &text).expect("valid");
    let options = Options { seed, model: Model::Averaged, trace: false };
    let mut node = hil_experiment::run::board(&scenario, &scenario.cases[0], &options).expect("valid");
    hil_experiment::run::set(&mut node, Property::M, to.into()).expect("idle takes a move");
    let mut end = None;
    let mut ms = 0;
    while end.is_none() {
        node.step();
        ms += 1;
        end = ended(&mut node);
        assert!(ms < 60_000, "{motor} {set} on {seed}: no end");
    }
    let speed = node.sample().expect("awake").truth.counts_per_s.abs();
    for _ in 0..500 {
        node.step();
    }
    let rest = (node.sample().expect("awake").truth.counts - f64::from(to)).abs();
    Ended { reason: end.expect("ended"), ms, speed, rest }
}

fn ended(node: &mut Node) -> Option<EndReason> {
    std::iter::from_fn(|| node.event()).find_map(|event| match event {
        Event::Ended { reason, .. } => Some(reason),
        _ => None,
    })
}

fn plants() -> u64 {
    effort(PLANTS)
}

#[test]
fn arrived_motor_stands_and_rests_within_mpe() {
    let (mut speeds, mut ends) = (Vec::new(), [0; 2]);
    let mut fastest = (0.0, String::new());
    let mut farthest = fastest.clone();
    for (motor, low, high) in [("link", 0, 300), ("spread", 0, 150), ("tip", -100, 300)] {
        for hold in [0, 1] {
            for mpe in [0, 4, 20] {
                for (accel, mv) in [(5, 100), (30, 1000), (60, 1000), (120, 1000), (260, 900), (1000, 4080)] {
                    let set = format!("ACCEL = {accel}, MV = {mv}, HOLD = {hold}, MPE = {mpe}");
                    let mut own = Vec::new();
                    for seed in 0..plants() {
                        let way = [high - low, (high - low) / 3, 12, 2][seed as usize / 2 % 4];
                        let (from, to) = if seed % 2 == 0 { (low, low + way) } else { (high, high - way) };
                        let found = moved(motor, &set, (from, to), seed);
                        let case = format!("{motor} {set}, {from} to {to} on {seed}");
                        if found.reason != EndReason::Arrived {
                            // Within a cell a weak integral gain may not break the rotor loose, and it says so.
                            assert!(
                                found.reason == EndReason::Stalled && mpe == 0,
                                "{case}: {:?}",
                                found.reason
                            );
                            ends[1] += 1;
                            continue;
                        }
                        ends[0] += 1;
                        if found.speed > fastest.0 {
                            fastest = (found.speed, case.clone());
                        }
                        let slip = if mpe == 0 { SLIP_COUNTS } else { 0.0 };
                        let beyond = found.rest - f64::from(mpe) - slip;
                        if beyond > farthest.0 {
                            farthest = (beyond, case);
                        }
                        own.push(found.speed);
                    }
                    own.sort_by(f64::total_cmp);
                    if plants() >= 100 {
                        let p95 = own[(own.len() - 1) * 95 / 100];
                        assert!(p95 <= P95_COUNTS_S, "{motor} {set}: 95 % below {p95:.1} counts/s");
                    }
                    speeds.extend(own);
                }
            }
        }
    }
    speeds.sort_by(f64::total_cmp);
    let at = |percent: usize| speeds[(speeds.len() - 1) * percent / 100];
    println!(
        "figure: {} arrivals, {} stalled: true speed median {:.1}, 95 % {:.1}, maximum {:.1} counts/s ({})",
        ends[0],
        ends[1],
        at(50),
        at(95),
        fastest.0,
        fastest.1
    );
    println!(
        "figure: at rest {:.2} counts beyond MPE, and a slip with MPE 0, at most ({})",
        farthest.0, farthest.1
    );
    assert!(fastest.0 <= MOST_COUNTS_S, "{fastest:?}");
    assert!(farthest.0 <= CELL_COUNTS, "{farthest:?}");
    assert!(at(95) <= P95_COUNTS_S, "{}", at(95));
    assert!(ends[1] * 100 <= ends[0], "{ends:?}");
}

/// The motion: before, 95 % of these links were called arrived at up to 603 counts/s and ended 52 counts away.
#[test]
fn link_that_cannot_brake_as_ordered_arrives_at_rest() {
    let mut speeds = Vec::new();
    for seed in 0..60.max(plants()) {
        let found = moved("link", "ACCEL = 260, MV = 900, HOLD = 0", (0, 300), seed);
        assert_eq!(found.reason, EndReason::Arrived, "seed {seed}");
        assert!(found.rest <= 4.0 + CELL_COUNTS, "seed {seed}: {:.1} counts away", found.rest);
        speeds.push(found.speed);
    }
    speeds.sort_by(f64::total_cmp);
    let p95 = speeds[(speeds.len() - 1) * 95 / 100];
    println!(
        "figure: ACCEL 260, MV 900: 95 % below {p95:.1}, all below {:.1} counts/s",
        speeds[speeds.len() - 1]
    );
    assert!(p95 <= P95_COUNTS_S, "{p95}");
}

/// Manual 2: 0.88 s for the spread's 166 counts; within 2 % on the nominal plant. Of scattered ones with misplaced sensors 95 % are within
/// 6.5 %: they come to rest in the very cell of the end, which one in three reaches from its neighbor. Without friction that falls with speed
/// and without edges that depend on the direction one in six does, and 95 % are within 2.5 %.
#[test]
fn spread_keeps_the_manuals_time() {
    let mut times: Vec<u32> =
        (0..40.max(plants())).map(|seed| moved("spread", "MPE = 4", (0, 166), seed).ms - 31).collect();
    times.sort_unstable();
    let (median, p95) = (times[times.len() / 2], times[(times.len() - 1) * 95 / 100]);
    println!(
        "figure: spread's 166 counts: median {median} ms, 95 % {p95} ms, all {} ms",
        times[times.len() - 1]
    );
    assert!(f64::from(median) >= 0.98 * 880.0 && f64::from(p95) <= 1.065 * 880.0, "{times:?}");
}
