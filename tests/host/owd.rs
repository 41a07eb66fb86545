//! OWD's hand: encoder counts of 199,111.1 for 140° of a finger and 35,840 for 180° of the spread, polls of MODE, TEMP and THERM to group
//! 5. Compared with the plant.

use hil_world::bus::Station;
use hil_world::hand::Motorized;

use super::can::{FINGERS, GROUP, HAND, Host, SPREAD, emulated, emulated_280, native, native_280};
use crate::emulated::bench::production;

const STAT: u8 = 5;
const ERROR: u8 = 4;
const MODE: u8 = 8;
const TEMP: u8 = 9;
const THERM: u8 = 20;
const GRPA: u8 = 26;
const CMD: u8 = 29;
const T: u8 = 42;
const MT: u8 = 43;
const V: u8 = 44;
const MV: u8 = 45;
const P: u8 = 48;
const E: u8 = 52;
const CT: u8 = 56;
const HSG: u8 = 71;
const HOLD: u8 = 77;
const TSTOP: u8 = 78;
const KP: u8 = 79;
const KD: u8 = 80;
const END: u8 = 115;

const HI: i32 = 13;

/// It calls a finger arrived within this many encoder counts.
const NEAR: i32 = 600;

fn encoder(node: u16, rad: f64) -> i32 {
    let degrees = rad.to_degrees();
    if node == SPREAD { (degrees / 180.0 * 35_840.0) as i32 } else { (degrees / 140.0 * 199_111.1) as i32 }
}

/// Wakes each board, and puts it into its groups.
fn activate<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    for &node in nodes {
        assert_eq!(host.get(node, STAT), 0);
        host.set(node, STAT, 2);
        host.sleep_ms(1200);
        for (property, group) in [(GRPA, 0), (GRPA + 1, 5), (GRPA + 2, 5)] {
            if host.get_within(node, property, 20) != Some(group) {
                host.set(node, property, group);
            }
        }
    }
}

/// HI of one finger after the other, three times, then the spread; each to mode 0 or 3.
fn find_stops<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    let fingers = nodes.iter().filter(|&&node| node != SPREAD);
    for &node in fingers.clone().chain(fingers.clone()).chain(fingers).chain([&SPREAD]) {
        host.set(node, CMD, HI);
        let done = (0..200).any(|_| {
            host.sleep_ms(50);
            matches!(host.get(node, MODE), 0 | 3)
        });
        assert!(done, "HI of {node}");
        host.clear();
    }
}

/// What it sets after HI, and its first move away from the stop.
fn set_up<S: Station>(host: &mut Host<S>, fingers: &[u16]) {
    for &node in fingers {
        for (property, value) in [(TSTOP, 50), (HOLD, 0), (CT, encoder(node, 2.4))] {
            host.set(node, property, value);
        }
    }
    for (property, value) in [(TSTOP, 200), (HOLD, 1)] {
        host.set(SPREAD, property, value);
    }
    for &node in fingers {
        for (property, value) in [(KP, 125), (KD, 1250), (E, encoder(node, 0.05)), (MODE, 5)] {
            host.set(node, property, value);
        }
    }
    // A parameter of its: no limit of the strain.
    host.set(GROUP, HSG, 0);
}

/// Its control loop: the state of all, until each is idle or holds.
fn wait<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    let done = (0..100).any(|_| {
        for property in [TEMP, THERM] {
            let degrees = host.get_group(property, nodes);
            assert!(degrees.iter().all(|degrees| (15..60).contains(degrees)), "{degrees:?} °C");
        }
        let modes = host.get_group(MODE, nodes);
        host.sleep_ms(50);
        modes.iter().all(|mode| matches!(mode, 0 | 3))
    });
    assert!(done, "{:?}", host.get_group(MODE, nodes));
}

fn move_to<S: Motorized>(host: &mut Host<S>, nodes: &[u16], goals: &[f64]) {
    for &node in nodes.iter().filter(|&&node| node != SPREAD) {
        host.set(node, TSTOP, 150);
        host.set(node, MT, 2200);
    }
    for (&node, &goal) in nodes.iter().zip(goals) {
        host.set(node, E, encoder(node, goal));
    }
    host.set(GROUP, MODE, 5);
    wait(host, nodes);
    for (&node, &goal) in nodes.iter().zip(goals) {
        let read = host.get(node, P);
        assert!((read - encoder(node, goal)).abs() < NEAR, "node {node}: {read}");
        let at = host.joint_rad(node);
        println!("figure: OWD's {goal} rad of node {node} is {at:.4} rad of the joint");
        assert!((at - goal).abs() <= host.arrival_rad(node), "node {node}: {at} of {goal} rad");
    }
}

fn velocity<S: Motorized>(host: &mut Host<S>, nodes: &[u16], rad_per_s: f64) {
    for &node in nodes {
        host.set(node, V, encoder(node, rad_per_s) / 1000);
    }
    host.set(GROUP, MODE, 4);
    host.sleep_ms(300);
    let from: Vec<f64> = nodes.iter().map(|&node| host.joint_rad(node)).collect();
    host.sleep_ms(1000);
    for (&node, from) in nodes.iter().zip(from) {
        let speed = host.joint_rad(node) - from;
        // Whole counts/ms: of the spread only every 0.09 rad/s. The board has whole hall counts/s.
        let sent = f64::from(encoder(node, rad_per_s) / 1000) * 1000.0 / f64::from(encoder(node, 1.0));
        let most = 0.03 * sent.abs() + 0.5 * host.rad_per_count(node);
        assert!((speed - sent).abs() <= most, "node {node}: {speed} of {sent} rad/s");
    }
    host.clear();
    host.set(GROUP, MODE, 0);
}

/// T is in the units of the board, of which IPNM / ratio are a N·m at the joint.
fn torque<S: Motorized>(host: &mut Host<S>, nodes: &[u16]) {
    for &node in nodes {
        let n_m = 0.6;
        let torque = n_m * 20_000.0 / if node == SPREAD { 17.5 } else { 125.0 };
        host.set(node, MODE, 2);
        host.set(node, T, torque as i32);
        host.sleep_ms(50);
        let delivered = host.joint_torque_n_m(node);
        assert!((delivered / n_m - 1.0).abs() <= 0.05, "node {node}: {delivered} of {n_m} N m");
    }
    host.set(GROUP, MODE, 0);
}

fn drives<S: Motorized>(host: &mut Host<S>, nodes: &[u16]) {
    activate(host, nodes);
    find_stops(host, nodes);
    host.mark_zeros(nodes);
    let fingers = &nodes[..nodes.len() - 1];
    set_up(host, fingers);
    wait(host, nodes);
    for &node in fingers {
        let at = host.joint_rad(node);
        assert!((at - 0.05).abs() <= host.arrival_rad(node), "node {node}: {at} rad after its start");
    }
    let goals: Vec<f64> =
        nodes.iter().map(|&node| if node == SPREAD { 1.5 } else { f64::from(node) * 0.1 }).collect();
    move_to(host, nodes, &goals);
    velocity(host, nodes, 0.4);
    velocity(host, nodes, -0.4);
    // The speed of moves, in rad/s.
    for &node in nodes {
        host.set(node, MV, encoder(node, 1.0) / 1000);
    }
    let goals: Vec<f64> = nodes.iter().map(|_| 0.5).collect();
    move_to(host, nodes, &goals);
    torque(host, nodes);
    assert_eq!(host.get_group(ERROR, nodes), vec![0; nodes.len()]);
}

#[test]
fn owd_moves_native_boards_to_its_radians() {
    drives(&mut native_280(&HAND), &HAND);
}

#[test]
fn owd_moves_emulated_boards_to_its_radians() {
    let Some(programs) = production() else { return };
    let nodes = [11, SPREAD];
    drives(&mut emulated_280(&programs, &nodes), &nodes);
}

/// Without HOSTUNITS its goals are beyond the joint: they closed every finger to the stop, and a group's MODE 5 after a refusal went to
/// the goal before it.
fn goals_in_foreign_units_are_refused<S: Motorized>(host: &mut Host<S>, nodes: &[u16]) {
    activate(host, nodes);
    find_stops(host, nodes);
    let finger = FINGERS[0];
    host.set(finger, E, 60);
    host.set(finger, MODE, 5);
    wait_plain(host, nodes);
    for (goal, to) in [(3995, finger), (encoder(finger, 0.05), finger), (81_487, GROUP)] {
        let before = host.joint_rad(finger);
        host.set(finger, E, goal);
        host.set(to, MODE, 5);
        host.sleep_ms(1000);
        host.clear();
        // It holds where its first move of MODE 5 has ended.
        assert_eq!((host.get(finger, MODE), host.get(finger, END)), (3, 3), "E {goal}");
        let moved = host.joint_rad(finger) - before;
        assert!(moved.abs() < host.rad_per_count(finger), "E {goal}: moved by {moved} rad");
    }
    // A good one moves it again.
    host.set(finger, E, 100);
    host.set(finger, MODE, 5);
    wait_plain(host, nodes);
    assert!((host.get(finger, P) - 100).abs() <= 4);
}

fn wait_plain<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    let done = (0..100).any(|_| {
        host.sleep_ms(50);
        host.get_group(MODE, nodes).iter().all(|mode| matches!(mode, 0 | 3))
    });
    assert!(done, "{:?}", host.get_group(MODE, nodes));
    host.clear();
}

#[test]
fn owd_start_without_host_units_is_refused_by_native_boards() {
    goals_in_foreign_units_are_refused(&mut native(&[11, SPREAD]), &[11, SPREAD]);
}

#[test]
fn owd_start_without_host_units_is_refused_by_emulated_boards() {
    let Some(programs) = production() else { return };
    let nodes = [11, SPREAD];
    goals_in_foreign_units_are_refused(&mut emulated(&programs, &nodes), &nodes);
}
