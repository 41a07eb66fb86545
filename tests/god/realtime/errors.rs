//! RealTime that ends by an error: the status, the host's remaining bytes, and the state afterwards.

use boot::Chip;
use hil_world::board::SimBoard;
use hil_world::plant::Model;
use hil_world::rig::{RigParams, StuckLine};
use tater_wire::Property;

use super::super::movement::{config, set, telemetry};
use super::{BLOCK_US, Host};
use crate::god::Session;

/// A byte at 9600 baud.
const BYTE_US: u64 = 1_042;

/// Longest drain of a host that never pauses, us: a second, and the boards' frames.
const DRAIN_US: u64 = 1_000_000 + 50_000;

fn read_for(session: &mut Session, us: u64) -> String {
    session.wait_us(us);
    String::from_utf8(session.hand.take_tx()).expect("text")
}

impl Host {
    fn send_slowly(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.session.hand.push_rx(&[*byte]);
            self.session.wait_us(BYTE_US);
        }
    }

    /// Positions of the motors, hall counts. All must be at rest.
    fn positions(&self) -> Vec<i64> {
        let truth = self.truth();
        assert!(truth.iter().all(|(speed, _)| speed.abs() < 2.0), "{truth:?}");
        truth.iter().map(|(_, counts)| counts.round() as i64).collect()
    }
}

#[test]
fn bytes_after_a_bad_header_are_no_command() {
    for slowly in [false, true] {
        let mut host = Host::new("1");
        let before = host.positions();
        if slowly {
            host.send_slowly(b"BC\rC\r3\r");
        } else {
            host.session.hand.push_rx(b"BC\rC\r3\r");
        }
        assert_eq!(read_for(&mut host.session, BLOCK_US), "\r\n\rERR 2048\r\n\r=> ", "slowly: {slowly}");
        assert_eq!(read_for(&mut host.session, 1_000_000), "");
        assert_eq!(host.positions(), before);
        assert_eq!(host.session.run("VERS"), "600", "lines again");
    }
}

/// Velocities and gains that look like commands or like ^C are still data.
#[test]
fn data_of_a_block_answered_by_an_error_are_no_command() {
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
            assert_eq!(read_for(&mut host.session, BLOCK_US), "\r\n\rERR 8\r\n\r=> ", "{data:?} {pause_us}");
            assert_eq!(read_for(&mut host.session, 1_000_000), "", "{data:?} {pause_us}");
        }
    }
}

#[test]
fn endless_bytes_after_an_error_are_drained_for_1_s_with_motors_at_rest() {
    let mut host = Host::new("X4");
    let start_us = (0..20).map(|_| {
        host.block(&[b'C', 20, 32], 8);
        host.session.wait_us(10_000);
        host.session.hand.now_us()
    });
    let start_us = start_us.last().expect("twenty");
    assert!(host.truth()[3].0 > 80.0, "{:?}", host.truth());
    let mut text = String::new();
    while !text.ends_with("=> ") {
        host.session.hand.push_rx(b"x");
        text += &read_for(&mut host.session, 5_000);
        let now_us = host.session.hand.now_us();
        assert!(now_us < start_us + DRAIN_US, "no prompt: {text:?}");
        // Rotor and load need a few tens of ms to stop.
        if (start_us + 200_000..start_us + 205_000).contains(&now_us) {
            assert_eq!(text, "");
            host.positions();
        }
    }
    assert_eq!(text, "\r\n\rERR 2048\r\n\r=> ");
    assert!(host.session.hand.now_us() > start_us + 1_000_000);
}

#[test]
fn board_that_refuses_loop_is_an_error_instead_of_the_first_star() {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    assert_eq!(session.run("SAVE"), "");
    session.hand.bus_mut().station_mut(0).expect("motor 1").rig_mut().set_bus(10.0);
    assert_eq!(session.run("X1LOOP"), "ERR 8");
    // It cannot invalidate the saved position, so it does not drive.
    session.hand.bus_mut().station_mut(3).expect("motor 4").board_mut().flash().set_worn(true);
    assert_eq!(session.run("SLOOP"), "ERR 512");
    assert_eq!(session.run("VERS"), "600", "lines again");
}

const BREAKS_US: u64 = 30_000_000;

fn with_breaking_line() -> Session {
    Session::with_boards(|number, node| {
        let stuck = (number == 4).then_some(StuckLine { line: 0, high: true, from_us: BREAKS_US });
        let rig = RigParams { stuck, ..RigParams::default() };
        SimBoard::with(0.0, node, rig, &[], Model::Averaged, number.into()).expect("in range")
    })
}

#[test]
fn loop_position_lost_is_err_4() {
    let mut host = Host::from_session(with_breaking_line(), "X4");
    let now_us = host.session.hand.now_us();
    assert!(now_us < BREAKS_US, "{now_us}");
    host.session.wait_us(BREAKS_US - now_us);
    host.block(&[b'C', 20, 32], 8);
    host.session.wait_us(200_000);
    host.session.hand.push_rx(b"A");
    assert_eq!(host.session.read_to_prompt(), "\r\n\rERR 4\r\n\r=> ");
}

#[test]
fn loop_enables_end_reports() {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    (1..=7).for_each(|motor| set(&mut session, motor, Property::LFLAGS, 0));
    let mut host = Host::enter(session, "X12");
    let node = host.session.hand.bus_mut().station_mut(1).expect("motor 2");
    node.rig_mut().set_bus(10.0);
    host.session.wait_us(50_000);
    host.session.hand.push_rx(b"A");
    assert_eq!(host.session.read_to_prompt(), "\r\n\rERR 8\r\n\r=> ");
}

#[test]
fn loop_restores_gains() {
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
        host.session.read_to_prompt();
        assert_eq!([1, 4].map(|motor| config(&mut host.session, motor).kpv), [32, 32], "{how}");
    }
    // Gain 0 would leave the motor without torque.
    let mut host = Host::new("X1");
    host.block(&[b'C', 0, 0], 8);
    host.session.hand.push_rx(b"\x03");
    host.session.read_to_prompt();
    assert_eq!(host.session.run("X1TC"), "");
    assert!(host.truth()[0].1 > 300.0, "{:?}", host.truth());
}

/// With one board off the bus the others get their gain back at once, and that board at its next motion.
#[test]
fn loop_restores_gain_of_lost_board_at_the_next_motion() {
    let mut host = Host::new("X12");
    host.block(&[b'C', 0, 7, 0, 7], 15);
    host.session.wait_us(1_000);
    host.session.hand.bus_mut().cut(1, true);
    host.session.hand.push_rx(b"A");
    host.session.wait_us(300_000);
    host.session.hand.take_tx();
    let start_us = host.session.hand.now_us();
    host.session.hand.push_rx(b"A");
    assert_eq!(host.session.read_to_prompt(), "\r\n\rERR 1\r\n\r=> ");
    let took_us = host.session.hand.now_us() - start_us;
    assert!(took_us <= BLOCK_US, "{took_us} us");
    host.session.hand.bus_mut().cut(1, false);
    assert_eq!([1, 2].map(|motor| config(&mut host.session, motor).kpv), [32, 7]);
    assert_eq!(host.session.run("X12M 100"), "");
    assert_eq!([1, 2].map(|motor| config(&mut host.session, motor).kpv), [32, 32]);
    assert_eq!(telemetry(&mut host.session, 1).fault, None);
}
