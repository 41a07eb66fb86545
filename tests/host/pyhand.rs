//! pyHand: orders to nodes 11 to 14 and group 5, and sleeps in place of polls. It takes the next frame for the answer to a GET.

use hil_world::bus::Station;
use tater_wire::property::barrett;

use super::can::{ALL, FINGERS, GROUP, HAND, Host, SPREAD, emulated, native};
use crate::emulated::bench::production;

const ROLE: u8 = 1;
const ERROR: u8 = 4;
const STAT: u8 = 5;
const MODE: u8 = 8;
const CMD: u8 = 29;
const V: u8 = 44;
const P: u8 = 48;
const CT: u8 = 56;
const M: u8 = 58;
const TSTOP: u8 = 78;
const HALLH: u8 = 88;

/// Waits for an answer this long before it reads its queue.
const READ_MS: u64 = 15;

const HI: i32 = 13;

fn initialize<S: Station>(host: &mut Host<S>) {
    host.set(ALL, STAT, 2);
    host.sleep_ms(1000);
    host.clear();
}

/// Three fingers, 3 s of sleep, the spread, 2 s of sleep; no poll.
fn init_hand<S: Station>(host: &mut Host<S>) {
    for finger in FINGERS {
        host.set(finger, CMD, HI);
    }
    host.sleep_ms(3000);
    host.set(SPREAD, CMD, HI);
    host.sleep_ms(2000);
    host.clear();
    assert_eq!(host.get_within(FINGERS[0], ROLE, READ_MS), Some(0x0803));
}

fn homed<S: Station>(host: &mut Host<S>, node: u16) -> bool {
    host.get(node, HALLH) >> 30 & 1 == 1
}

fn initializes<S: Station>(host: &mut Host<S>) {
    initialize(host);
    assert_eq!(host.get(SPREAD, CT), 169, "the spread's default, not a link's");
    init_hand(host);
    for node in HAND {
        assert_eq!(host.get(node, ERROR), 0, "node {node}");
        assert!(homed(host, node), "node {node} has not found its stop");
    }
}

#[test]
fn initialization_without_polls_homes_native_boards() {
    initializes(&mut native(&HAND));
}

/// The velocity example: mode 4 for 1.5 s without a frame, TSTOP 0.
fn opens_and_closes_by_velocity<S: Station>(host: &mut Host<S>) {
    host.set(SPREAD, V, 0);
    for (speed, closing) in [(200, true), (-200, false)] {
        let before = host.get_all(FINGERS, P);
        for finger in FINGERS {
            host.set(finger, V, speed);
        }
        host.set(GROUP, TSTOP, 0);
        host.set(GROUP, MODE, 4);
        host.sleep_ms(1500);
        host.clear();
        for (finger, before) in FINGERS.into_iter().zip(before) {
            assert_eq!((host.get(finger, MODE), host.get(finger, ERROR)), (4, 0), "finger {finger}");
            let moved = host.get(finger, P) - before;
            assert!(if closing { moved > 200 } else { moved < -200 }, "finger {finger}: {moved} counts");
        }
        host.set(GROUP, MODE, 0);
    }
    host.set(GROUP, TSTOP, 300);
    assert_eq!(host.get_all(HAND, ERROR), [0; 4]);
}

#[test]
fn velocity_example_on_native_boards() {
    let mut host = native(&HAND);
    initialize(&mut host);
    init_hand(&mut host);
    opens_and_closes_by_velocity(&mut host);
}

/// A host that dies in mode 4: the motor idles after HOSTMS, and the next program begins with orders, not with a reset.
fn dead_host<S: Station>(host: &mut Host<S>, node: u16) {
    host.set(node, TSTOP, 0);
    host.set(node, V, 30);
    host.set(node, MODE, 4);
    host.sleep_ms(2100);
    host.clear();
    assert_eq!((host.get(node, MODE), host.get(node, ERROR)), (0, 7));
    host.set(node, TSTOP, 400);
    host.set(node, M, 40);
    host.sleep_ms(1500);
    host.clear();
    assert_eq!(host.get(node, ERROR), 0, "does not latch");
    assert!((host.get(node, P) - 40).abs() <= 4, "{}", host.get(node, P));
}

#[test]
fn orders_after_a_lost_host_are_obeyed_by_native_boards() {
    for node in HAND {
        let mut host = native(&[node]);
        initialize(&mut host);
        dead_host(&mut host, node);
    }
}

/// Every number of its constants, the upper halves of 32-bit properties too.
fn lists_every_property<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    for &node in nodes {
        for property in 0..barrett::BARRETTS {
            let value = host.get_within(node, property, READ_MS);
            assert!(value.is_some(), "{property} of {node}: it would take the next answer for this one's");
        }
    }
}

#[test]
fn listing_of_every_property_is_answered_by_native_boards() {
    let mut host = native(&HAND);
    initialize(&mut host);
    lists_every_property(&mut host, &HAND);
}

/// It enumerates 32 nodes by their ROLE, in the monitor.
#[test]
fn enumeration_finds_the_hand_beside_an_arm() {
    let mut host = native(&HAND);
    let found: Vec<u16> = (0..32).filter(|&node| host.get_within(node, ROLE, READ_MS).is_some()).collect();
    assert_eq!(found, HAND);
}

#[test]
fn emulated_boards_do_the_same() {
    let Some(programs) = production() else { return };
    let mut host = emulated(&programs, &[11, SPREAD]);
    initialize(&mut host);
    assert_eq!(host.get(SPREAD, CT), 169, "the spread's default");
    lists_every_property(&mut host, &[SPREAD]);
    for (node, ms) in [(11, 3000), (SPREAD, 2000)] {
        host.set(node, CMD, HI);
        host.sleep_ms(ms);
        host.clear();
        assert_eq!(host.get(node, ERROR), 0, "node {node}");
        assert!(homed(&mut host, node), "node {node}");
    }
    dead_host(&mut host, SPREAD);
}
