//! HI.

use servo_core::mode::Mode;
use tater_wire::Property;

use super::{Session, abort, assert_near, counts, line_until, set, status, until};

#[test]
fn links_go_first_and_all_end_at_their_zeros() {
    let mut session = Session::new();
    let (mut lowest, mut highest) = ([0; 7], [0; 7]);
    line_until(&mut session, "HI", |session| {
        for (place, count) in counts(session).into_iter().enumerate() {
            lowest[place] = count.min(lowest[place]);
            highest[place] = count.max(highest[place]);
        }
        let begun = highest[4] > 0
            || session
                .hand
                .bus()
                .stations()
                .nth(3)
                .is_some_and(|n| n.application().is_some_and(|tater| tater.status().mode != Mode::Idle));
        if begun {
            // Links have found their stops, half a count below -25, and are back.
            assert!(lowest[..3].iter().all(|&count| count <= -25), "{lowest:?}");
            assert_near(session, [0; 7], "links first");
        }
        begun
    });
    until(&mut session, "its end", |session| {
        for (place, count) in counts(session).into_iter().enumerate() {
            highest[place] = count.max(highest[place]);
        }
        session.hand.take_tx().ends_with(b"=> ")
    });
    assert!(
        highest[4..].iter().all(|&count| count >= 350),
        "tips have been at their closed stops: {highest:?}"
    );
    assert_near(&session, [0; 7], "HI");
    for motor in 1..=7 {
        assert!(status(&mut session, motor).homed, "{motor}");
    }
}

#[test]
fn a_motor_that_does_not_home_is_told_and_keeps_nobody() {
    let mut session = Session::new();
    assert_eq!(session.line("HI"), "");
    // Without a velocity the board refuses. It was homed before: that does not count.
    set(&mut session, 2, Property::IVEL, 0);
    set(&mut session, 5, Property::IHIT, 0);
    for motor in [1, 3, 4, 6, 7] {
        set(&mut session, motor, Property::M, 20);
    }
    session.wait_us(1_000_000);
    assert_eq!(session.line("HI"), "ERR 4");
    assert_near(&session, [0; 7], "the others");
    assert_eq!(session.line("13HI"), "ERR 4");
    assert_eq!(session.line("3SHI"), "");
    // A board whose supply has failed latches a fault.
    super::node(&mut session, 3).rig_mut().set_bus(10.0);
    assert_eq!(session.line("3SHI"), "ERR 4");
    super::node(&mut session, 3).rig_mut().set_bus(24.0);
    assert_eq!(session.line("3SHI"), "", "and is fit again");
}

#[test]
fn an_aborted_one_has_initialized_nobody() {
    let mut session = Session::new();
    line_until(&mut session, "HI", |session| counts(session)[0] < -5);
    assert!(abort(&mut session).contains("ERR 16384"));
    assert_eq!(status(&mut session, 1).mode, Mode::Idle);
    assert_eq!(session.line("GO"), "ERR 4");
    assert_eq!(session.line("HI"), "");
    assert_eq!(session.line("GO"), "");
}
