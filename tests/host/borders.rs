//! Frames of hosts that were written for another hand: what they mean here, on native and emulated boards.

use hil_sim::bus::Station;

use super::can::{GROUP, Host, emulated, native};
use crate::emulated::bench::production;

const ROLE: u8 = 1;
const STAT: u8 = 5;
const MODE: u8 = 8;
const CMD: u8 = 29;
const P: u8 = 48;
const HSG: u8 = 71;
const LSG: u8 = 72;
const END: u8 = 115;

const HI: i32 = 13;
const C: i32 = 18;

const FINGER: u16 = 11;

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

#[test]
fn strain_limits_of_zero_end_no_move_of_a_native_board() {
    strain_limits_of_zero_end_nothing(&mut native(&[FINGER]));
}

#[test]
fn get_of_any_length_is_answered_by_a_native_board() {
    get_of_any_length_is_answered(&mut native(&[FINGER]));
}

#[test]
fn emulated_boards_do_the_same() {
    let Some(programs) = production() else { return };
    get_of_any_length_is_answered(&mut emulated(&programs, &[FINGER]));
    strain_limits_of_zero_end_nothing(&mut emulated(&programs, &[FINGER]));
}
