//! HI on simulated joints: a motor that cannot turn is never homed, and one that is homed knows where it stands.

use hil_experiment::run::Options;
use hil_experiment::scenario::Scenario;
use hil_world::node::Node;
use hil_world::plant::Model;
use hil_world::plant::{Contact, PlantParams, RAD_PER_COUNT};
use servo_core::guard::fault::Fault;
use servo_core::mode::Mode;
use tater_wire::{MotorKind, Property};

const OPTIONS: Options = Options { seed: 1, model: Model::Averaged, trace: false };

/// Longest HI with IVEL 100 or more, ms: 2048 counts to the stop and twice 128 from it and back at 100 counts/s, and the way to
/// zero (decision 0048).
const HI_MS: u32 = 26_000;

/// Zero of a homed motor against the true one, counts: the stop lies on the boundary of two (1), the rotor rests
/// within MPE of zero, and what it reads there is a cell of one count (1).
const ZERO_COUNTS: f64 = 2.0;

/// Torque of the default IHIT, 250 of 1024 parts of 0.65 N·m.
const IHIT_N_M: f64 = 0.65 * 250.0 / 1024.0;

/// A motor at `count` whose shaft has `friction` N·m.
fn joint(motor: &str, count: i32, friction: f64, set: &str, seed: u64) -> Node {
    let text = format!(
        "name = \"joint\"\nabout = \"\"\nmotor = \"{motor}\"\nduration_ms = 1\nset = {{ {set} }}\n\
         plant = {{ coulomb_n_m = {friction}, static_n_m = {friction} }}\n\
         initial = {{ position_counts = {count} }}\n"
    );
    let scenario = Scenario::parse("joint", &text).expect("valid");
    hil_experiment::run::board(&scenario, &scenario.cases[0], &Options { seed, ..OPTIONS }).expect("valid")
}

/// Orders HI and steps until the motor is idle or holds; `each` sees every step. Returns the fault and whether it is homed.
fn home(node: &mut Node, mut each: impl FnMut(&mut Node)) -> (Option<Fault>, bool) {
    hil_experiment::run::set(node, Property::CMD, 13).expect("HI");
    for ms in 0..HI_MS {
        if ms % 100 == 0 {
            // Mode 4 ends without a host.
            hil_experiment::run::set(node, Property::DS, 0).expect("in range");
        }
        node.step();
        each(node);
        if node.sample().expect("awake").status.end.is_some() {
            let status = node.sample().expect("awake").status;
            assert!(matches!(status.mode, Mode::Idle | Mode::Pid), "{:?}", status.mode);
            return (status.fault, status.homed);
        }
    }
    panic!("HI has no end after {HI_MS} ms");
}

/// P as read less the true position.
fn error_counts(node: &Node) -> f64 {
    let sample = node.sample().expect("awake");
    f64::from(sample.status.position.round()) - sample.truth.counts
}

#[test]
fn spread_whose_brake_is_stuck_is_jammed_and_not_homed() {
    let mut spread = joint("spread", 83, 1.0, "", 1);
    assert_eq!(home(&mut spread, |_| ()), (Some(Fault::Jammed), false));
    // The brake itself, which never releases.
    let mut spread = joint("spread", 83, 0.03, "", 1);
    spread.rig_mut().stick_brake(Some(true));
    assert_eq!(home(&mut spread, |_| ()), (Some(Fault::Jammed), false));
    spread.rig_mut().stick_brake(None);
    hil_experiment::run::set(&mut spread, Property::STAT, 2).expect("clears the fault");
    assert_eq!(home(&mut spread, |_| ()), (None, true));
}

#[test]
fn homed_motors_know_where_they_are_at_any_friction_and_torque() {
    let mut ends = [0; 3];
    for (motor, low, high) in [("link", -25, 338), ("spread", 0, 166), ("tip", -158, 350)] {
        for friction in [0.0, 0.03, 0.05, 0.08, 0.12, 0.15, 0.17, 0.2, 0.3, 0.5, 1.0] {
            // KPV 24 presses with 300 at IVEL; 100 with all of IHIT 990.
            for (ihit, kpv) in [(63, 24), (120, 24), (250, 24), (500, 100), (990, 24), (990, 100)] {
                for count in [low, (low + high) / 2, high] {
                    let set = format!("IHIT = {ihit}, KPV = {kpv}");
                    let mut node = joint(motor, count, friction, &set, 1);
                    let (fault, homed) = home(&mut node, |_| ());
                    let case = format!("{motor} at {count}, {friction} N·m, {set}: {fault:?}");
                    assert!(matches!(fault, None | Some(Fault::Jammed)), "{case}");
                    if homed {
                        let error = error_counts(&node);
                        assert!(fault.is_none() && error.abs() <= ZERO_COUNTS, "{case}: {error}");
                    }
                    // IHIT 250 is 0.159 N·m.
                    let sure = (ihit == 250 && friction <= 0.08) || (ihit == 500 && friction <= 0.15);
                    let torque = 0.65 * f64::from(ihit) / 1024.0;
                    assert!(if sure { homed } else { friction < torque || !homed }, "{case}: homed {homed}");
                    ends[if homed { 0 } else { 1 + usize::from(fault.is_none()) }] += 1;
                }
            }
        }
    }
    let [homed, jammed, stalled] = ends;
    println!("figure: HI on 594 joints: {homed} homed, {jammed} jammed, {stalled} stalled below IHIT");
}

/// Figures of a joint that decide what a rotor does at its stop and when it leaves it: each at zero, or next to it, by default, and three times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Times {
    Zero,
    Default,
    Three,
}

/// Worm lead, play, twist of the gear, stiffness and damping of the stops.
type Variation = [Times; 5];

/// A variation of the plant of a kind of motor.
fn varied(kind: MotorKind, variation: Variation) -> PlantParams {
    let plant = PlantParams::for_motor(kind);
    let [lead, play, twist, stiffness, damping] = variation;
    let of = |times: Times, value: f64, least: f64| match times {
        Times::Zero => least,
        Times::Default => value,
        Times::Three => 3.0 * value,
    };
    // A spread has no worm: one of 5 degrees is its third case.
    let worm_lead_deg = match (kind, lead) {
        (MotorKind::Spread, Times::Three) => 5.0,
        _ => of(lead, plant.worm_lead_deg, 0.0),
    };
    PlantParams {
        worm_lead_deg,
        // Friction that just locks it, as that of the default.
        worm_friction: plant.worm_friction.max(1.03 * worm_lead_deg.to_radians().tan()),
        backlash_counts: of(play, plant.backlash_counts, 0.0),
        gear_rad_n_m: of(twist, plant.gear_rad_n_m, 0.0),
        // Without stiffness there is no stop; with 0.2 N·m/rad IHIT dents it by two counts.
        stop_stiffness_n_m_rad: of(stiffness, plant.stop_stiffness_n_m_rad, 0.2),
        stop_damping_n_m_s: of(damping, plant.stop_damping_n_m_s, 0.0),
        ..plant
    }
}

/// All variations of one figure and of two.
fn variations() -> Vec<Variation> {
    let default = [Times::Default; 5];
    let mut all = vec![default];
    for first in 0..5 {
        for times in [Times::Zero, Times::Three] {
            let mut one = default;
            one[first] = times;
            all.push(one);
            for second in first + 1..5 {
                for times in [Times::Zero, Times::Three] {
                    let mut two = one;
                    two[second] = times;
                    all.push(two);
                }
            }
        }
    }
    all
}

/// A motor with such a plant, and halls misplaced by up to 5 degrees, at rest 60 counts from its open stop.
fn varied_joint(kind: MotorKind, plant: &PlantParams, seed: u64) -> Node {
    let motor = kind.name();
    let count = plant.min_count as i32 + 60;
    let PlantParams { worm_lead_deg, worm_friction, backlash_counts, gear_rad_n_m, .. } = plant;
    let PlantParams { stop_stiffness_n_m_rad, stop_damping_n_m_s, .. } = plant;
    let text = format!(
        "name = \"joint\"\nabout = \"\"\nmotor = \"{motor}\"\nduration_ms = 1\nhall_scatter_deg = 5\n\
         initial = {{ position_counts = {count} }}\n[plant]\nworm_lead_deg = {worm_lead_deg}\n\
         worm_friction = {worm_friction}\nbacklash_counts = {backlash_counts}\ngear_rad_n_m = {gear_rad_n_m}\n\
         stop_stiffness_n_m_rad = {stop_stiffness_n_m_rad}\nstop_damping_n_m_s = {stop_damping_n_m_s}\n"
    );
    let scenario = Scenario::parse("joint", &text).expect("valid");
    hil_experiment::run::board(&scenario, &scenario.cases[0], &Options { seed, ..OPTIONS }).expect("valid")
}

/// A joint's play, its twist and its stop decide whether a rotor springs back when it is let go; one that does not was taken for stalled on its
/// way to zero.
#[test]
fn hi_homes_on_any_worm_play_twist_and_stop() {
    let mut runs = 0;
    let mut failed = Vec::new();
    for kind in [MotorKind::Link, MotorKind::Spread, MotorKind::Tip] {
        for variation in variations() {
            let plant = varied(kind, variation);
            for seed in 1..=2 {
                let mut node = varied_joint(kind, &plant, seed);
                let (fault, homed) = home(&mut node, |_| ());
                let error = error_counts(&node);
                runs += 1;
                // IHIT dents stop and gear, and the joint is anywhere in its play.
                let dent = IHIT_N_M * plant.stop_rad_n_m() / RAD_PER_COUNT;
                let most = ZERO_COUNTS + dent + 0.5 * plant.backlash_counts;
                if !homed || fault.is_some() || error.abs() > most {
                    let end = node.sample().expect("awake").status.end;
                    failed.push(format!(
                        "{kind:?} {variation:?}, seed {seed}: {end:?} {fault:?} {homed} {error:.1}"
                    ));
                }
            }
        }
    }
    println!("figure: HI on {runs} joints of other worms, plays, twists and stops: {} failed", failed.len());
    assert!(failed.is_empty(), "{} of {runs}:\n{}", failed.len(), failed.join("\n"));
}

/// An object as hard as a stop, met in the direction of IVEL.
fn object(count: f64, side: f64) -> Contact {
    Contact { from: count * RAD_PER_COUNT, side, stiffness: 20.0, damping: 0.02 }
}

#[test]
fn object_that_moves_between_two_contacts_is_no_stop() {
    for (motor, side) in [("link", -1.0), ("spread", -1.0), ("tip", 1.0)] {
        for shift in [-80.0, -6.0, -3.0, 0.0, 3.0, 6.0] {
            let mut node = joint(motor, 100, 0.03, "", 1);
            let at = 100.5 + side * 20.0;
            node.rig_mut().set_objects(&[object(at, side)]);
            let mut left = false;
            let (fault, homed) = home(&mut node, |node| {
                let truth = node.sample().expect("awake").truth;
                // On its way from the object.
                if !left && side * (truth.counts - at) < -8.0 && truth.counts_per_s * side < -100.0 {
                    let reached = node.sample().expect("awake").status.position.round().abs() < 20;
                    if reached {
                        node.rig_mut().set_objects(&[object(at - side * shift, side)]);
                        left = true;
                    }
                }
            });
            let expected = if shift == 0.0 { (None, true) } else { (Some(Fault::Jammed), false) };
            assert!(left, "{motor}: leaves the object");
            if shift != 0.0 || motor == "spread" {
                assert_eq!((fault, homed), expected, "{motor}, by {shift} counts");
            }
        }
    }
}
