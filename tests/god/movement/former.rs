//! Orders to motors that move already: what their boards say of the former motion ends nothing of the new one.

use servo_core::mode::Mode;

use super::{Session, abort, assert_near, counts, initialized, line_until, status};

/// An initialised hand in which these lines have set something in motion.
fn moving(lines: &[&str]) -> Session {
    let mut session = initialized();
    for line in lines {
        assert_eq!(session.line(line), "", "{line}");
    }
    session
}

/// The spread on its way to 150, as slow as 60 counts/s.
const SLOW_SPREAD: &[&str] = &["4FSET MCV 60", "4 S E 150", "4 S M 5", "WAIT 300"];

#[test]
fn torque_control_in_place_of_a_move_goes_on_to_its_own_end() {
    let mut session = moving(SLOW_SPREAD);
    assert_eq!(session.line("4TC"), "");
    assert_near(&session, [0, 0, 0, 166, 0, 0, 0], "its stop");
    assert_eq!(status(&mut session, 4).mode, Mode::Velocity, "it holds, and so presses");
}

#[test]
fn control_c_ends_torque_control_in_place_of_a_move() {
    let mut session = moving(SLOW_SPREAD);
    line_until(&mut session, "4TC", |session| counts(session)[3] > 50);
    assert_eq!(session.hand.take_tx(), b"4TC", "it goes on");
    assert!(abort(&mut session).contains("ERR 16384"));
    assert_eq!(status(&mut session, 4).mode, Mode::Pid);
}

#[test]
fn a_move_in_place_of_torque_control_reaches_its_goal() {
    let mut session = moving(&["1 S CMD 16", "WAIT 200"]);
    assert_eq!(session.line("X1M 15000"), "");
    assert_near(&session, [273, 0, 0, 0, 0, 0, 0], "X1M");
    assert_eq!(status(&mut session, 1).mode, Mode::Idle);
}

#[test]
fn hi_in_place_of_a_move_finds_its_zero() {
    let mut session = moving(&["1 S E 300", "1 S M 5", "WAIT 200"]);
    assert_eq!(session.line("1HI"), "");
    assert_near(&session, [0; 7], "1HI");
    assert!(status(&mut session, 1).homed);
}
