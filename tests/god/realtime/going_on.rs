//! What RealTime goes on through: blocks without data, a host that pauses, and things in the way.

use servo_core::EndReason;
use servo_core::mode::Mode;

use super::super::movement::status;
use super::{ALL, BLOCK_US, FEEDBACK, Host};
use crate::god::Session;

/// A hand that feeds back nothing of its links, and whose blocks have no velocity, in RealTime with finger 1.
fn without_velocity() -> Host {
    let mut session = Session::new();
    assert_eq!(session.line("HI"), "");
    assert_eq!(session.line("FSET LCV 0"), "");
    Host::into(session, "1")
}

#[test]
fn boards_that_no_block_speaks_to_know_that_their_host_is_there() {
    // Feedback asks a finger's link only.
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
    // A gain is told when it is another, and a velocity is not in the block.
    let mut host = without_velocity();
    for _ in 0..100 {
        assert_eq!(host.block(&[b'c', 40], 1), b"*");
        host.session.wait_us(50_000);
    }
    assert_eq!([1, 5].map(|motor| status(&mut host.session, motor).mode), [Mode::Velocity; 2]);
}

#[test]
fn what_presses_goes_on_with_the_next_control_block() {
    let mut host = Host::new("X1");
    let mut stalls = 0;
    for _ in 0..300 {
        // 800 counts/s, to its stop at 338 and against it with all its torque.
        assert_eq!(host.block(&[b'C', 100, 32], 8)[0], b'*');
        host.session.wait_us(10_000);
        stalls += u32::from(status(&mut host.session, 1).end == Some(EndReason::Stalled));
    }
    // Half a second to the stop; then, in 2.5 s, a stall each TSTOP of 300 ms.
    assert!((4..=9).contains(&stalls), "{stalls}");
    assert!(host.truth()[0].1 > 330.0, "{:?}", host.truth());
    // Feedback alone does not drive it again.
    for _ in 0..100 {
        assert_eq!(host.block(b"A", 8)[0], b'*');
        host.session.wait_us(10_000);
    }
    assert_eq!(status(&mut host.session, 1).mode, Mode::Idle);
    for _ in 0..20 {
        assert_eq!(host.block(&[b'C', 0xEC, 32], 8)[0], b'*');
        host.session.wait_us(10_000);
    }
    assert!(host.truth()[0].0 < -80.0, "{:?}", host.truth());
    host.session.hand.push_rx(b"\x03");
    assert_eq!(host.session.until_prompt(), "\r\n\r=> ");
}

#[test]
fn a_block_that_breaks_off_is_dropped() {
    let mut host = Host::new(ALL);
    // A host may pause in a block.
    assert_eq!(host.block(b"C\x00\x20\x00\x20\x00", FEEDBACK)[0], b'*');
    host.session.wait_us(240_000);
    host.session.hand.push_rx(b"\x20\x00\x20\x00\x20\x00\x20\x00\x20");
    assert_eq!(host.block(b"a", 1), b"*");
    // But not for so long.
    host.session.hand.push_rx(b"c\x14\x20\x14");
    host.session.wait_us(400_000);
    assert_eq!(host.session.hand.take_tx(), b"", "no star for what is no block");
    // What comes next is a header.
    assert_eq!(host.block(b"A", FEEDBACK)[0], b'*');
    host.session.hand.push_rx(b"C");
    host.session.wait_us(400_000);
    assert_eq!(host.session.hand.take_tx().len(), FEEDBACK);
    host.session.hand.push_rx(b"\x03");
    host.session.wait_us(BLOCK_US);
    assert_eq!(host.session.hand.take_tx(), b"\r\n\r=> ");
    // At 160 counts/s for a quarter of a second they would be elsewhere.
    assert!(host.truth().iter().all(|(_, counts)| counts.abs() < 3.0), "{:?}", host.truth());
}
