//! Conditions that do not end RealTime: blocks without data, pauses of the host, stalls.

use servo_core::EndReason;
use servo_core::mode::Mode;

use super::super::movement::telemetry;
use super::{ALL, BLOCK_US, FEEDBACK, Host};
use crate::god::Session;

fn without_velocity() -> Host {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    assert_eq!(session.run("FSET LCV 0"), "");
    Host::enter(session, "1")
}

#[test]
fn loop_boards_without_data_are_kept_alive() {
    // Feedback reads only the link of a finger.
    let mut host = Host::new("1");
    for _ in 0..100 {
        assert_eq!(host.block(b"A", 8)[0], b'*');
        host.session.wait_us(50_000);
    }
    let mut host = Host::new("12");
    for _ in 0..100 {
        assert_eq!(host.block(b"a", 1), b"*");
        host.session.wait_us(50_000);
    }
    // Only a changed gain is sent, and the block has no velocity.
    let mut host = without_velocity();
    for _ in 0..100 {
        assert_eq!(host.block(&[b'c', 40], 1), b"*");
        host.session.wait_us(50_000);
    }
    assert_eq!([1, 5].map(|motor| telemetry(&mut host.session, motor).mode), [Mode::Velocity; 2]);
}

#[test]
fn loop_stalled_motor_restarts_with_the_next_control_block() {
    let mut host = Host::new("X1");
    let mut stalls = 0;
    for _ in 0..300 {
        // 800 counts/s to the stop at 338, then full torque against it.
        assert_eq!(host.block(&[b'C', 100, 32], 8)[0], b'*');
        host.session.wait_us(10_000);
        stalls += u32::from(telemetry(&mut host.session, 1).end == Some(EndReason::Stalled));
    }
    // Half a second to the stop, then a stall each TSTOP of 300 ms for 2.5 s.
    assert!((4..=9).contains(&stalls), "{stalls}");
    assert!(host.truth()[0].1 > 330.0, "{:?}", host.truth());
    // Feedback alone does not restart it.
    for _ in 0..100 {
        assert_eq!(host.block(b"A", 8)[0], b'*');
        host.session.wait_us(10_000);
    }
    assert_eq!(telemetry(&mut host.session, 1).mode, Mode::Idle);
    for _ in 0..20 {
        assert_eq!(host.block(&[b'C', 0xEC, 32], 8)[0], b'*');
        host.session.wait_us(10_000);
    }
    assert!(host.truth()[0].0 < -80.0, "{:?}", host.truth());
    host.session.hand.push_rx(b"\x03");
    assert_eq!(host.session.read_to_prompt(), "\r\n\r=> ");
}

#[test]
fn incomplete_block_is_dropped() {
    let mut host = Host::new(ALL);
    assert_eq!(host.block(b"C\x00\x20\x00\x20\x00", FEEDBACK)[0], b'*');
    host.session.wait_us(240_000);
    host.session.hand.push_rx(b"\x20\x00\x20\x00\x20\x00\x20\x00\x20");
    assert_eq!(host.block(b"a", 1), b"*");
    host.session.hand.push_rx(b"c\x14\x20\x14");
    host.session.wait_us(400_000);
    assert_eq!(host.session.hand.take_tx(), b"", "no star for an incomplete block");
    assert_eq!(host.block(b"A", FEEDBACK)[0], b'*');
    host.session.hand.push_rx(b"C");
    host.session.wait_us(400_000);
    assert_eq!(host.session.hand.take_tx().len(), FEEDBACK);
    host.session.hand.push_rx(b"\x03");
    host.session.wait_us(BLOCK_US);
    assert_eq!(host.session.hand.take_tx(), b"\r\n\r=> ");
    // At 160 counts/s for a quarter of a second they would have moved 40 counts.
    assert!(host.truth().iter().all(|(_, counts)| counts.abs() < 3.0), "{:?}", host.truth());
}
