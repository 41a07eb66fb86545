//! How RealTime ends when something is wrong, what a host says meanwhile, and what it leaves behind.

use hil_sim::board::SimBoard;
use hil_sim::plant::Model;
use hil_sim::rig::{RigParams, StuckLine};
use tater_fw::Board;
use tater_wire::Property;

use super::super::movement::{config, set, status};
use super::{BLOCK_US, Host};
use crate::god::Session;

/// A byte of a serial line at 9600 baud, us.
const BYTE_US: u64 = 1_042;

/// How long GOD hears a host out that does not pause, us; and the boards' frames on top.
const BABBLE_US: u64 = 1_000_000 + 50_000;

/// What is said from now on, within so long.
fn said(session: &mut Session, us: u64) -> String {
    session.wait_us(us);
    String::from_utf8(session.hand.take_tx()).expect("text")
}

impl Host {
    /// Says bytes at 9600 baud.
    fn says_slowly(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.session.hand.push_rx(&[*byte]);
            self.session.wait_us(BYTE_US);
        }
    }

    /// Where the motors are, hall counts, and that they stand.
    fn places(&self) -> Vec<i64> {
        let truth = self.truth();
        assert!(truth.iter().all(|(speed, _)| speed.abs() < 2.0), "{truth:?}");
        truth.iter().map(|(_, counts)| counts.round() as i64).collect()
    }
}

#[test]
fn what_comes_with_a_header_that_is_none_is_no_command() {
    for slowly in [false, true] {
        let mut host = Host::new("1");
        let before = host.places();
        if slowly {
            host.says_slowly(b"BC\rC\r3\r");
        } else {
            host.session.hand.push_rx(b"BC\rC\r3\r");
        }
        assert_eq!(said(&mut host.session, BLOCK_US), "\r\n\rERR 2048\r\n\r=> ", "slowly: {slowly}");
        assert_eq!(said(&mut host.session, 1_000_000), "");
        assert_eq!(host.places(), before);
        assert_eq!(host.session.line("VERS"), "600", "lines again");
    }
}

/// Velocity and gain of two motors, which are as well two commands, or have a ^C: all of a block are data.
#[test]
fn the_data_of_a_block_that_is_answered_by_an_error_are_no_command() {
    for data in [b"C\rO\r", b"\x03C\r\x03"] {
        for pause_us in [0, 15_000] {
            let mut host = Host::new("X12");
            let node = host.session.hand.bus_mut().station_mut(1).expect("motor 2");
            node.rig_mut().set_bus(10.0);
            host.session.wait_us(50_000);
            host.session.hand.push_rx(b"C");
            for byte in data {
                host.session.wait_us(pause_us);
                host.session.hand.push_rx(&[*byte]);
            }
            assert_eq!(said(&mut host.session, BLOCK_US), "\r\n\rERR 8\r\n\r=> ", "{data:?} {pause_us}");
            assert_eq!(said(&mut host.session, 1_000_000), "", "{data:?} {pause_us}");
        }
    }
}

#[test]
fn a_host_that_babbles_is_heard_out_for_a_while_by_motors_at_rest() {
    let mut host = Host::new("X4");
    let begun_us = (0..20).map(|_| {
        host.block(&[b'C', 20, 32], 8);
        host.session.wait_us(10_000);
        host.session.hand.now_us()
    });
    let begun_us = begun_us.last().expect("twenty");
    assert!(host.truth()[3].0 > 80.0, "{:?}", host.truth());
    let mut text = String::new();
    while !text.ends_with("=> ") {
        host.session.hand.push_rx(b"x");
        text += &said(&mut host.session, 5_000);
        let now_us = host.session.hand.now_us();
        assert!(now_us < begun_us + BABBLE_US, "no prompt: {text:?}");
        // Rotor and load take a few tens of ms to stand.
        if (begun_us + 200_000..begun_us + 205_000).contains(&now_us) {
            assert_eq!(text, "");
            host.places();
        }
    }
    assert_eq!(text, "\r\n\rERR 2048\r\n\r=> ");
    assert!(host.session.hand.now_us() > begun_us + 1_000_000);
}

#[test]
fn a_board_that_does_not_take_its_mode_is_told_instead_of_the_first_star() {
    let mut session = Session::new();
    assert_eq!(session.line("HI"), "");
    assert_eq!(session.line("SAVE"), "");
    session.hand.bus_mut().station_mut(0).expect("motor 1").rig_mut().set_bus(10.0);
    assert_eq!(session.line("X1LOOP"), "ERR 8");
    // It cannot make the saved position untrue, and drives nothing.
    session.hand.bus_mut().station_mut(3).expect("motor 4").board_mut().flash().set_worn(true);
    assert_eq!(session.line("SLOOP"), "ERR 512");
    assert_eq!(session.line("VERS"), "600", "lines again");
}

/// When a hall line of motor 4 breaks, us.
const BREAKS_US: u64 = 30_000_000;

/// A hand with such a line.
fn with_a_broken_line() -> Session {
    Session::of_boards(|number, node| {
        let stuck = (number == 4).then_some(StuckLine { line: 0, high: true, from_us: BREAKS_US });
        let rig = RigParams { stuck, ..RigParams::default() };
        SimBoard::with(0.0, node, rig, &[], Model::Averaged, number.into()).expect("in range")
    })
}

#[test]
fn a_position_that_is_lost_is_err_4() {
    let mut host = Host::of(with_a_broken_line(), "X4");
    let now_us = host.session.hand.now_us();
    assert!(now_us < BREAKS_US, "{now_us}");
    host.session.wait_us(BREAKS_US - now_us);
    host.block(&[b'C', 20, 32], 8);
    host.session.wait_us(200_000);
    host.session.hand.push_rx(b"A");
    assert_eq!(host.session.until_prompt(), "\r\n\rERR 4\r\n\r=> ");
}

#[test]
fn ends_are_reported_whatever_lflags_was() {
    let mut session = Session::new();
    assert_eq!(session.line("HI"), "");
    (1..=7).for_each(|motor| set(&mut session, motor, Property::LFLAGS, 0));
    let mut host = Host::into(session, "X12");
    let node = host.session.hand.bus_mut().station_mut(1).expect("motor 2");
    node.rig_mut().set_bus(10.0);
    host.session.wait_us(50_000);
    host.session.hand.push_rx(b"A");
    assert_eq!(host.session.until_prompt(), "\r\n\rERR 8\r\n\r=> ");
}

#[test]
fn gains_are_given_back() {
    for how in ["^C", "error", "hang-up"] {
        let mut host = Host::new("X14");
        for gain in [0, 7] {
            host.block(&[b'C', 0, gain, 0, gain], 15);
        }
        host.session.wait_us(1_000);
        assert_eq!([1, 4].map(|motor| config(&mut host.session, motor).kpv), [7, 7], "{how}");
        match how {
            "^C" => host.session.hand.push_rx(b"\x03"),
            "error" => host.session.hand.push_rx(b"x"),
            _ => host.session.hand.hang_up(),
        }
        host.session.until_prompt();
        assert_eq!([1, 4].map(|motor| config(&mut host.session, motor).kpv), [32, 32], "{how}");
    }
    // A gain of 0 moves nothing.
    let mut host = Host::new("X1");
    host.block(&[b'C', 0, 0], 8);
    host.session.hand.push_rx(b"\x03");
    host.session.until_prompt();
    assert_eq!(host.session.line("X1TC"), "");
    assert!(host.truth()[0].1 > 300.0, "{:?}", host.truth());
}

/// One board is off the bus: the others have their gain all the same, and it has its own as soon as it is needed.
#[test]
fn a_board_that_was_away_is_given_its_gain_back_later() {
    let mut host = Host::new("X12");
    host.block(&[b'C', 0, 7, 0, 7], 15);
    host.session.wait_us(1_000);
    host.session.hand.bus_mut().cut(1, true);
    host.session.hand.push_rx(b"A");
    host.session.wait_us(300_000);
    host.session.hand.take_tx();
    let begun_us = host.session.hand.now_us();
    host.session.hand.push_rx(b"A");
    assert_eq!(host.session.until_prompt(), "\r\n\rERR 1\r\n\r=> ");
    let took_us = host.session.hand.now_us() - begun_us;
    assert!(took_us <= BLOCK_US, "{took_us} us");
    host.session.hand.bus_mut().cut(1, false);
    assert_eq!([1, 2].map(|motor| config(&mut host.session, motor).kpv), [32, 7]);
    assert_eq!(host.session.line("X12M 100"), "");
    assert_eq!([1, 2].map(|motor| config(&mut host.session, motor).kpv), [32, 32]);
    assert_eq!(status(&mut host.session, 1).fault, None);
}
