//! cisst's BH8_280: checks what it sets, sends HI to all motors at once, reads positions of the group. Its joints open to the positive, with
//! a ratio of its own: 129.1 instead of 125. Compared with the plant.

use hil_world::hand::Motorized;

use super::can::{GROUP, HAND, Host, SPREAD, emulated_280, native_280};
use crate::emulated::bench::production;

const STAT: u8 = 5;
const MODE: u8 = 8;
const GRPA: u8 = 26;
const CMD: u8 = 29;
const P: u8 = 48;
const CTS: u8 = 68;
const PIDX: u8 = 70;
const IPNM: u8 = 86;

const HI: i32 = 13;

/// Radians of the joint for one of the motor, as it writes them.
fn motor_to_joint(node: u16) -> f64 {
    if node == SPREAD { -0.057_268 } else { -0.007_743_7 }
}

/// It writes six bytes for any property.
fn set<S: Motorized>(host: &mut Host<S>, to: u16, property: u8, value: i32) {
    let [a, b, c, d] = value.to_le_bytes();
    host.send(to, &[0x80 | property, 0, a, b, c, d]);
}

/// Sets and verifies: 10 ms later, or a second after a STAT.
fn set_and_check<S: Motorized>(host: &mut Host<S>, node: u16, property: u8, value: i32) {
    set(host, node, property, value);
    host.sleep_ms(if property == STAT { 1000 } else { 10 });
    assert_eq!(host.get(node, property), value, "unexpected value of {property} of {node}");
}

/// Wakes and idles the motor; returns its counts a revolution.
fn initialize_motor<S: Motorized>(host: &mut Host<S>, node: u16) -> i32 {
    if host.get(node, STAT) == 0 {
        set_and_check(host, node, STAT, 2);
        host.sleep_ms(1000);
    }
    assert_eq!(host.get(node, STAT), 2);
    set_and_check(host, node, MODE, 0);
    let counts = host.get(node, CTS);
    assert_eq!(host.get(node, IPNM), 20_000);
    assert_eq!(host.get(node, PIDX), i32::from(node) - 10);
    for group in [GRPA, GRPA + 1, GRPA + 2] {
        host.get(node, group);
    }
    counts
}

/// One GET to the group; each member answers to group 3.
fn positions<S: Motorized>(host: &mut Host<S>, nodes: &[u16], cts: i32) -> Vec<f64> {
    host.clear();
    host.send(GROUP, &[P]);
    let mut joints = vec![f64::NAN; nodes.len()];
    for _ in nodes {
        let frame = host.read(10).expect("an answer of each member").frame;
        assert_eq!(frame.raw_id() & 0x41F, 0x403, "{frame:?}");
        let &[high, middle, low] = frame.data() else { panic!("{frame:?}") };
        let counts = (i32::from_be_bytes([0, high, middle, low]) << 10) >> 10;
        let node = frame.raw_id() >> 5 & 31;
        let place = nodes.iter().position(|&own| own == node).expect("a member");
        joints[place] = f64::from(counts) * std::f64::consts::TAU / f64::from(cts) * motor_to_joint(node);
    }
    joints
}

fn drives<S: Motorized>(host: &mut Host<S>, nodes: &[u16]) {
    let counts: Vec<i32> = nodes.iter().map(|&node| initialize_motor(host, node)).collect();
    assert!(counts.iter().all(|&counts| counts == 4096), "{counts:?}");
    for &node in nodes {
        set(host, node, CMD, HI);
    }
    host.sleep_ms(1000);
    // Its program asks for positions from here on, and HI takes longer.
    let done = (0..100).any(|_| {
        positions(host, nodes, 4096);
        host.sleep_ms(100);
        nodes.iter().all(|&node| matches!(host.get(node, MODE), 0 | 3))
    });
    assert!(done, "HI");
    host.mark_zeros(nodes);
    set(host, GROUP, MODE, 3);
    host.sleep_ms(10);
    // 0.5 rad towards closing, in steps: its positions are goals of mode 3.
    for step in 1..=25 {
        for &node in nodes {
            let motor_rad = -0.02 * f64::from(step) / motor_to_joint(node);
            set(host, node, P, (motor_rad * 4096.0 / std::f64::consts::TAU).floor() as i32);
        }
        host.sleep_ms(40);
    }
    host.sleep_ms(500);
    let read = positions(host, nodes, 4096);
    for (&node, read) in nodes.iter().zip(read) {
        let count = host.rad_per_count(node);
        // The same motor angle by this hand's ratio.
        let ratio = if node == SPREAD { 17.5 } else { 125.0 };
        let own = -motor_to_joint(node) * ratio;
        let wanted = 0.5 / own;
        let at = host.joint_rad(node);
        println!(
            "figure: cisst's -0.5 rad of node {node} is {at:.4} rad of the joint; its own ratio asks for {wanted:.4}"
        );
        // The position loop leaves what friction holds, up to 4 counts.
        assert!((at - wanted).abs() <= 4.0 * count, "node {node}: {at} of {wanted} rad");
        assert!((read + at * own).abs() <= count, "node {node}: reads {read} at {at} rad");
    }
    set(host, GROUP, MODE, 0);
}

#[test]
fn cisst_moves_native_boards() {
    drives(&mut native_280(&HAND), &HAND);
}

#[test]
fn cisst_moves_emulated_boards() {
    let Some(programs) = production() else { return };
    let nodes = [11, SPREAD];
    drives(&mut emulated_280(&programs, &nodes), &nodes);
}
