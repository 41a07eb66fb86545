//! Orders to motors that already move: reports of the former motion do not end the new one.

use servo_core::mode::Mode;

use super::{Session, abort, assert_near, counts, initialized, run_until, telemetry};

fn moving(lines: &[&str]) -> Session {
    let mut session = initialized();
    for line in lines {
        assert_eq!(session.run(line), "", "{line}");
    }
    session
}

const SLOW_SPREAD: &[&str] = &["4FSET MCV 60", "4 S E 150", "4 S M 5", "WAIT 300"];

#[test]
fn tc_replacing_a_move_runs_to_its_own_end() {
    let mut session = moving(SLOW_SPREAD);
    assert_eq!(session.run("4TC"), "");
    assert_near(&session, [0, 0, 0, 166, 0, 0, 0], "its stop");
    assert_eq!(telemetry(&mut session, 4).mode, Mode::Velocity, "it holds by pressing");
}

#[test]
fn control_c_ends_tc_that_replaced_a_move() {
    let mut session = moving(SLOW_SPREAD);
    run_until(&mut session, "4TC", |session| counts(session)[3] > 50);
    assert_eq!(session.hand.take_tx(), b"4TC", "still running");
    assert!(abort(&mut session).contains("ERR 16384"));
    assert_eq!(telemetry(&mut session, 4).mode, Mode::Pid);
}

#[test]
fn move_replacing_torque_control_reaches_its_goal() {
    let mut session = moving(&["1 S CMD 16", "WAIT 200"]);
    assert_eq!(session.run("X1M 15000"), "");
    assert_near(&session, [273, 0, 0, 0, 0, 0, 0], "X1M");
    assert_eq!(telemetry(&mut session, 1).mode, Mode::Idle);
}

#[test]
fn hi_replacing_a_move_finds_zero() {
    let mut session = moving(&["1 S E 300", "1 S M 5", "WAIT 200"]);
    assert_eq!(session.run("1HI"), "");
    assert_near(&session, [0; 7], "1HI");
    assert!(telemetry(&mut session, 1).homed);
}
