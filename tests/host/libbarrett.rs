//! libbarrett's hand: group 5, polls of MODE at 10 Hz, positions in mode 3, packed torques to group 5.

use hil_sim::bus::Station;
use tater_wire::property::barrett;
use tater_wire::{Body, Destination, Group, Message, Node as Id, Torques};

use super::can::{GROUP, HAND, Host, SPREAD, emulated, native};
use crate::emulated::bench::production;

const VERS: u8 = 0;
const ROLE: u8 = 1;
const ERROR: u8 = 4;
const STAT: u8 = 5;
const MODE: u8 = 8;
const CMD: u8 = 29;
const T: u8 = 42;
const V: u8 = 44;
const P: u8 = 48;
const E: u8 = 52;
const HOLD: u8 = 77;

const HI: i32 = 13;

/// Looks at a board, and wakes it, with the board's time to leave and to join the bus.
fn wake<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    for &node in nodes {
        assert_eq!(host.get(node, ROLE) & 0x1F, 3, "a motor's board");
        assert!(host.get(node, VERS) >= 145, "the newest of its property tables");
        assert_eq!(host.get(node, STAT), 0);
        host.set(node, STAT, 2);
        host.sleep_ms(50);
    }
    host.sleep_ms(1000);
    for &node in nodes {
        assert_eq!(host.get_within(node, STAT, 50), Some(2), "node {node} is awake");
    }
}

/// HI of the group; each motor must be seen in mode 4, and then in another.
fn initialize<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    host.set(GROUP, CMD, HI);
    let (mut seen, mut done) = (vec![false; nodes.len()], vec![false; nodes.len()]);
    for _ in 0..100 {
        for (place, mode) in host.get_group(MODE, nodes).into_iter().enumerate() {
            done[place] |= seen[place] && mode != 4;
            seen[place] |= mode == 4;
        }
        if done.iter().all(|&done| done) {
            break;
        }
        host.sleep_ms(100);
    }
    assert!(done.iter().all(|&done| done), "seen in mode 4: {seen:?}, after it: {done:?}");
}

fn wait_until_done<S: Station>(host: &mut Host<S>, nodes: &[u16], holds: &[i32]) {
    for _ in 0..50 {
        let modes = host.get_group(MODE, nodes);
        if modes.iter().zip(holds).all(|(&mode, &hold)| mode == if hold == 0 { 0 } else { 3 }) {
            return;
        }
        host.sleep_ms(100);
    }
    panic!("{:?} for HOLD {holds:?}", host.get_group(MODE, nodes));
}

fn moves_in_every_mode<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    wake(host, nodes);
    let holds = host.get_group(HOLD, nodes);
    initialize(host, nodes);
    wait_until_done(host, nodes, &holds);
    // A trapezoidal move: E of each, mode 5 of the group.
    for &node in nodes {
        host.set(node, E, 60);
    }
    host.set(GROUP, MODE, 5);
    wait_until_done(host, nodes, &vec![1; nodes.len()]);
    for &node in nodes {
        assert!((host.get(node, P) - 60).abs() <= 4, "node {node}");
    }
    // O, by CMD, whose end HOLD says.
    host.set(GROUP, CMD, O);
    wait_until_done(host, nodes, &holds);
    for &node in nodes {
        assert!(host.get(node, P).abs() <= 4, "node {node}");
    }
    // Positions, in mode 3.
    host.set(GROUP, MODE, 3);
    for step in 0..20 {
        for &node in nodes {
            host.set(node, P, 60 + step);
        }
        host.sleep_ms(50);
    }
    for &node in nodes {
        assert!((host.get(node, P) - 79).abs() <= 4, "node {node}: {}", host.get(node, P));
    }
    // Velocities, in mode 4, with one order a second.
    for _ in 0..2 {
        for &node in nodes {
            host.set(node, V, 20);
        }
        host.set(GROUP, MODE, 4);
        host.sleep_ms(1000);
    }
    host.clear();
    assert_eq!(host.get_group(MODE, nodes), vec![4; nodes.len()]);
    assert_eq!(host.get_group(ERROR, nodes), vec![0; nodes.len()]);
    // Torques, packed for the slots of the hand's four motors, at 500 Hz. Too little to turn them.
    host.set(GROUP, MODE, 2);
    let torques = Torques::new(&[11, -12, 13, -14]).expect("four");
    let to = Destination::Group(Group::new(5).expect("a group"));
    // For less than TSTOP: a torque that moves nothing is a stall.
    for _ in 0..50 {
        let packed = Message { from: Id::HOST, to, body: Body::Torques(torques) }.frame();
        host.send(packed.raw_id(), packed.data());
        host.sleep_ms(2);
    }
    for &node in nodes {
        let sign = if node % 2 == 1 { 1 } else { -1 };
        assert_eq!(host.get(node, T), sign * i32::from(node), "the slot of node {node}");
    }
    host.set(GROUP, MODE, 0);
}

#[test]
fn every_mode_of_the_hand_on_native_boards() {
    moves_in_every_mode(&mut native(&HAND), &HAND);
}

#[test]
fn every_mode_of_the_hand_on_emulated_boards() {
    let Some(programs) = production() else { return };
    let nodes = [11, SPREAD];
    moves_in_every_mode(&mut emulated(&programs, &nodes), &nodes);
}

/// It does not read ERROR: after a fault its mode 3 is refused, and each position that it then sent was taken for a new name of
/// the present one.
#[test]
fn position_mode_after_a_fault_renames_nothing() {
    let mut host = native(&HAND);
    wake(&mut host, &HAND);
    initialize(&mut host, &HAND);
    host.set(GROUP, MODE, 3);
    host.sleep_ms(500);
    host.clear();
    let positions = host.get_all(HAND, P);
    for place in 0..HAND.len() {
        host.bus.station_mut(place).expect("a board").rig_mut().set_bus(12.0);
    }
    host.sleep_ms(100);
    host.set(GROUP, MODE, 3);
    for _ in 0..100 {
        for node in HAND {
            host.set(node, P, 535);
        }
        host.sleep_ms(10);
    }
    host.clear();
    assert_eq!(host.get_group(ERROR, &HAND), [5; 4], "under-voltage");
    for (node, before) in HAND.into_iter().zip(positions) {
        let after = host.get(node, P);
        assert!((after - before).abs() <= 4, "node {node}: {before}, then {after}");
    }
}

/// It takes the number of a name from a table, and waits for each answer.
#[test]
fn every_name_of_its_table_is_answered() {
    let mut host = native(&HAND);
    wake(&mut host, &HAND);
    for node in HAND {
        for row in barrett::ABSENT {
            assert_eq!(host.get(node, row.id), 0, "{} of {node}", row.name);
        }
    }
}
