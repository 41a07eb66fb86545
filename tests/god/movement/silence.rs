//! Boards that stop answering while their motors move.

use servo_core::mode::Mode;

use super::{Session, abort, assert_near, counts, initialized, run_until, telemetry, wait_until};

/// Time after which GOD takes a board for lost, us: it polls every 50 ms, and asks three times for 60 ms.
const LOST_US: u64 = 300_000;

/// Position of motor 2 when its board falls silent, and the farthest position after GOD's stop order: 100 counts/s for half a second, and
/// the coasting, hall counts.
const FROM: i32 = 50;
const TO: i32 = 120;

/// A hand that runs a line with links at 100 counts/s, after the board of motor 2 was off the bus for a while.
fn deaf_for(us: u64, line: &str) -> Session {
    let mut session = initialized();
    assert_eq!(session.run("GFSET MCV 100"), "");
    run_until(&mut session, line, |session| counts(session)[1] > FROM);
    session.hand.bus_mut().cut(1, true);
    session.wait_us(us);
    session.hand.bus_mut().cut(1, false);
    session
}

fn assert_stopped(session: &mut Session) {
    assert_eq!(telemetry(session, 2).mode, Mode::Idle);
    let at = counts(session)[1];
    assert!((FROM..TO).contains(&at), "{at}");
}

#[test]
fn board_deaf_for_a_while_stops_and_others_finish() {
    let mut session = deaf_for(LOST_US, "GM 16500");
    assert!(session.read_to_prompt().contains("ERR 1\r"));
    assert_stopped(&mut session);
    let at = counts(&session)[1];
    assert_near(&session, [300, at, 300, 0, 80, 80, 80], "GM");
    assert_eq!(session.run("GM 0"), "");
    assert_near(&session, [0; 7], "GM 0");
}

#[test]
fn control_c_stops_board_that_was_deaf() {
    let mut session = deaf_for(LOST_US, "GM 16500");
    assert!(abort(&mut session).contains("ERR 16384"));
    session.wait_us(100_000);
    assert_stopped(&mut session);
}

#[test]
fn only_motor_deaf_for_a_while_stops_before_the_prompt() {
    let mut session = deaf_for(LOST_US, "X2M 16500");
    assert!(session.read_to_prompt().contains("ERR 1\r"));
    session.wait_us(100_000);
    assert_stopped(&mut session);
}

#[test]
fn board_silent_after_all_ended_is_err_1_alone() {
    let mut session = initialized();
    assert_eq!(session.run("X3FSET MCV 50"), "");
    run_until(&mut session, "X123M 5500", |session| counts(session)[1] > FROM);
    wait_until(&mut session, "two ends", |session| {
        [1, 2].iter().all(|&n| telemetry(session, n).mode == Mode::Idle)
    });
    session.wait_us(10_000);
    session.hand.bus_mut().cut(1, true);
    assert!(session.read_to_prompt().contains("ERR 1\r"));
    assert_eq!(session.run("X13FGET S"), "0 0");
    assert_near(&session, [100, 100, 100, 0, 0, 0, 0], "all of them");
}
