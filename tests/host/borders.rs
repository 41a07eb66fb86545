//! Frames of hosts that were written for another hand: what they mean here, on native and emulated boards.

use hil_world::bus::Station;

use super::can::{GROUP, Host, emulated, native};
use crate::emulated::bench::production;

const ROLE: u8 = 1;
const STAT: u8 = 5;
const MODE: u8 = 8;
const CMD: u8 = 29;
const GRPA: u8 = 26;
const P: u8 = 48;
const M: u8 = 58;
const HSG: u8 = 71;
const LSG: u8 = 72;
const END: u8 = 115;

const E: u8 = 52;
const CT: u8 = 56;

const HI: i32 = 13;
const C: i32 = 18;

const FINGER: u16 = 11;
const OTHER: u16 = 12;

fn wake<S: Station>(host: &mut Host<S>) {
    host.set(GROUP, STAT, 2);
    host.sleep_ms(1000);
    host.clear();
}

fn home<S: Station>(host: &mut Host<S>, nodes: &[u16]) {
    wake(host);
    nodes.iter().for_each(|&node| host.set(node, CMD, HI));
    host.sleep_ms(4000);
    host.clear();
}

/// BHand API, pyHand and btutil write 0 for "no limit" into both strain limits.
fn strain_limits_of_zero_end_nothing<S: Station>(host: &mut Host<S>) {
    home(host, &[FINGER]);
    host.set(FINGER, HSG, 0);
    host.set(FINGER, LSG, 0);
    host.set(FINGER, CMD, C);
    host.sleep_ms(2000);
    host.clear();
    assert_eq!((host.get(FINGER, END), host.get(FINGER, HSG)), (1, 0));
    assert!(host.get(FINGER, P) > 300, "{}", host.get(FINGER, P));
}

/// A host for the BH8-282 sends a second byte and waits for the answer without a limit; others pad to eight.
fn get_of_any_length_is_answered<S: Station>(host: &mut Host<S>) {
    for awake in [false, true] {
        if awake {
            wake(host);
        }
        for len in 1..=8 {
            host.clear();
            host.send(FINGER, &[ROLE, 0, 0, 0, 0, 0, 0, 0][..len]);
            let answer = host.read(50).unwrap_or_else(|| panic!("GET of {len} bytes: no answer"));
            assert_eq!(answer.frame.raw_id(), 0x406 | FINGER << 5, "{len} bytes");
            assert_eq!(answer.frame.data(), [0x80 | ROLE, 0, 3, 8], "{len} bytes");
        }
    }
    assert_eq!(host.get(FINGER, MODE), 0);
}

/// A goal in another hand's units: the board that refuses it stays, the others of the group move. What is stored moves to the bound.
fn goal_beyond_the_joint_moves_nothing<S: Station>(host: &mut Host<S>) {
    home(host, &[FINGER, OTHER]);
    for (bad, wide) in [(3995, false), (81_487, true)] {
        host.set(FINGER, E, 100);
        host.set(OTHER, E, if wide { 50 } else { 100 });
        assert_eq!(bad > 32_767, wide, "beyond the property's range too");
        host.set(FINGER, E, bad);
        host.set(GROUP, MODE, 5);
        host.sleep_ms(1000);
        host.clear();
        assert_eq!((host.get(FINGER, MODE), host.get(FINGER, END)), (0, 3), "E {bad}");
        assert!(host.get(FINGER, P).abs() <= 4, "E {bad}: {}", host.get(FINGER, P));
        let goal = host.get(OTHER, E);
        assert!((host.get(OTHER, P) - goal).abs() <= 4 && host.get(OTHER, END) == 1, "E {bad}");
    }
    host.set(FINGER, E, 100);
    host.set(FINGER, MODE, 5);
    host.sleep_ms(1500);
    host.clear();
    assert!((host.get(FINGER, P) - 100).abs() <= 4, "a good goal: {}", host.get(FINGER, P));
    host.set(FINGER, CT, 750);
    assert_eq!(host.get(FINGER, CT), 346);
}

/// M and P beyond the joint are refused like E, and so is the next MODE 5.
fn order_beyond_the_joint_moves_nothing<S: Station>(host: &mut Host<S>) {
    home(host, &[FINGER]);
    for (property, mode) in [(M, 0), (P, 3)] {
        host.set(FINGER, MODE, mode);
        host.sleep_ms(100);
        host.set(FINGER, property, 3995);
        host.sleep_ms(1000);
        host.set(FINGER, MODE, 5);
        host.sleep_ms(1000);
        host.clear();
        assert!(host.get(FINGER, P).abs() <= 4, "{property}: {}", host.get(FINGER, P));
        host.set(FINGER, MODE, 0);
    }
}

/// Barrett's hands listen to group 7, and hosts with a hand alone on the bus store 8.
fn groups_of_barretts_hands_reach_their_members<S: Station>(host: &mut Host<S>) {
    wake(host);
    for (group, members) in [(7, true), (8, false)] {
        host.set(0x400 | group, HSG, 200 + i32::from(group));
        host.sleep_ms(5);
        host.clear();
        assert_eq!(host.get(FINGER, HSG) == 200 + i32::from(group), members, "group {group}");
    }
    host.set(FINGER, GRPA, 8);
    host.set(0x408, HSG, 208);
    host.sleep_ms(5);
    host.clear();
    assert_eq!((host.get(FINGER, HSG), host.get(OTHER, HSG)), (208, 207));
}

#[test]
fn order_beyond_the_joint_moves_no_native_board() {
    order_beyond_the_joint_moves_nothing(&mut native(&[FINGER]));
}

#[test]
fn groups_of_barretts_hands_reach_native_boards() {
    groups_of_barretts_hands_reach_their_members(&mut native(&[FINGER, OTHER]));
}

#[test]
fn strain_limits_of_zero_end_no_move_of_a_native_board() {
    strain_limits_of_zero_end_nothing(&mut native(&[FINGER]));
}

#[test]
fn get_of_any_length_is_answered_by_a_native_board() {
    get_of_any_length_is_answered(&mut native(&[FINGER]));
}

#[test]
fn goal_beyond_the_joint_moves_no_native_board() {
    goal_beyond_the_joint_moves_nothing(&mut native(&[FINGER, OTHER]));
}

#[test]
fn emulated_boards_do_the_same() {
    let Some(programs) = production() else { return };
    goal_beyond_the_joint_moves_nothing(&mut emulated(&programs, &[FINGER, OTHER]));
    get_of_any_length_is_answered(&mut emulated(&programs, &[FINGER]));
    strain_limits_of_zero_end_nothing(&mut emulated(&programs, &[FINGER]));
    order_beyond_the_joint_moves_nothing(&mut emulated(&programs, &[FINGER]));
    groups_of_barretts_hands_reach_their_members(&mut emulated(&programs, &[FINGER, OTHER]));
}
