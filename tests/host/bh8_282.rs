//! A driver for the BH8-282: its GETs have two bytes, and it reads the answer half a millisecond later, without a time limit. Sleeps in place
//! of polls. Compared with the plant.

use hil_world::bus::Station;
use hil_world::hand::Motorized;

use super::can::{HAND, Host, SPREAD, emulated_280, native_280};
use crate::emulated::bench::production;

const ROLE: u8 = 1;
const STAT: u8 = 5;
const ERROR: u8 = 4;
const MODE: u8 = 8;
const CMD: u8 = 29;
const MT: u8 = 43;
const MV: u8 = 45;
const P: u8 = 48;
const OT: u8 = 54;
const CT: u8 = 56;
const HSG: u8 = 71;
const LSG: u8 = 72;
const TSTOP: u8 = 78;
const KP: u8 = 79;
const KD: u8 = 80;
const KI: u8 = 81;
const ACCEL: u8 = 82;

const HI: i32 = 13;
const CLOSE: i32 = 18;
const OPEN: i32 = 20;

/// The property, then a zero. The answer must be there when it reads.
fn get<S: Station>(host: &mut Host<S>, node: u16, property: u8) -> i32 {
    host.clear();
    host.send(node, &[property, 0]);
    let until = host.bus.now_us() + 500;
    host.bus.run_until(until);
    let frame =
        host.bus.receive().unwrap_or_else(|| panic!("GET {property} of {node}: it waits forever")).frame;
    match *frame.data() {
        [high, middle, low] if property == P => i32::from_be_bytes([0, high & 0x7F, middle, low]),
        [_, 0, a, b] => i16::from_le_bytes([a, b]).into(),
        [_, 0, a, b, c, d] => i32::from_le_bytes([a, b, c, d]),
        _ => panic!("{frame:?}"),
    }
}

fn init<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    for &node in nodes {
        assert!(get(host, node, ROLE) >= 0, "a puck has not been found");
    }
    for &node in nodes {
        host.set(node, STAT, 2);
        host.sleep_ms(750);
        host.set(node, CMD, HI);
        host.sleep_ms(3000);
    }
    host.sleep_ms(1000);
    host.set(SPREAD, MODE, 0);
}

fn set_values<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    for &node in nodes.iter().filter(|&&node| node != SPREAD) {
        for (property, value) in [
            (TSTOP, 50),
            // More than the motor has: it stays as it was.
            (MT, 22_200),
            (CT, 195_000),
            (OT, 0),
            (MV, 400),
            (ACCEL, 200),
            // Beyond its gauge: never.
            (HSG, 20_000),
            (LSG, 0),
            (KD, 2500),
            (KI, 0),
            (KP, 200),
        ] {
            host.set(node, property, value);
        }
    }
    host.set(SPREAD, TSTOP, 150);
    host.sleep_ms(1000);
}

fn drives<S: Motorized>(host: &mut Host<S>, nodes: &[u16]) {
    init(host, nodes);
    host.mark_zeros(nodes);
    set_values(host, nodes);
    for (cmd, finger) in [(CLOSE, 195_000), (OPEN, 0)] {
        for &node in nodes.iter().rev() {
            host.set(node, CMD, cmd);
            host.sleep_ms(3000);
        }
        for &node in nodes {
            assert_eq!(
                (get(host, node, ERROR), get(host, node, MODE) == 3),
                (0, node == SPREAD),
                "node {node}"
            );
            let ratio = if node == SPREAD { 17.5 } else { 125.0 };
            // The spread's CT is the default: 169 counts, beyond its stop at 166.5.
            let counts = if node == SPREAD && cmd == CLOSE { 36_150 } else { finger };
            let wanted = f64::from(counts) * std::f64::consts::TAU / (4096.0 * ratio);
            let at = host.joint_rad(node);
            println!(
                "figure: CMD {cmd} of the BH8-282's host, node {node}: {wanted:.4} rad asked, {at:.4} rad of the joint"
            );
            assert!(
                (at - wanted).abs() <= host.arrival_rad(node),
                "CMD {cmd}, node {node}: {at} of {wanted} rad"
            );
            let read = get(host, node, P);
            assert!(
                (f64::from(read) - at * 4096.0 * ratio / std::f64::consts::TAU).abs() <= 600.0,
                "node {node}: {read}"
            );
        }
    }
}

#[test]
fn gets_of_two_bytes_are_answered_by_native_boards() {
    drives(&mut native_280(&HAND), &HAND);
}

#[test]
fn gets_of_two_bytes_are_answered_by_emulated_boards() {
    let Some(programs) = production() else { return };
    let nodes = [11, SPREAD];
    drives(&mut emulated_280(&programs, &nodes), &nodes);
}
