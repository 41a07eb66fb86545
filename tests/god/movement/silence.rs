//! Boards that fall silent while they move.

use servo_core::mode::Mode;

use super::{Session, abort, assert_near, counts, initialized, line_until, status, until};

/// How long a board must be deaf until it is taken for lost, us: it is asked every 50 ms, three times for 60 ms.
const LOST_US: u64 = 300_000;

/// Where motor 2 is when its board falls silent, and the farthest that it may be when it has been told to stop: 100 counts/s for half a
/// second, and as far as it coasts.
const FROM: i32 = 50;
const TO: i32 = 120;

/// A hand that does what a line says, links at 100 counts/s, with the board of motor 2 silent for a while on its way.
fn deaf_for(us: u64, line: &str) -> Session {
    let mut session = initialized();
    assert_eq!(session.line("GFSET MCV 100"), "");
    line_until(&mut session, line, |session| counts(session)[1] > FROM);
    session.hand.bus_mut().cut(1, true);
    session.wait_us(us);
    session.hand.bus_mut().cut(1, false);
    session
}

fn assert_stopped(session: &mut Session) {
    assert_eq!(status(session, 2).mode, Mode::Idle);
    let at = counts(session)[1];
    assert!((FROM..TO).contains(&at), "{at}");
}

#[test]
fn who_has_only_lost_some_frames_stops_and_the_others_go_on() {
    let mut session = deaf_for(LOST_US, "GM 16500");
    assert!(session.until_prompt().contains("ERR 1\r"));
    assert_stopped(&mut session);
    let at = counts(&session)[1];
    assert_near(&session, [300, at, 300, 0, 80, 80, 80], "GM");
    assert_eq!(session.line("GM 0"), "");
    assert_near(&session, [0; 7], "GM 0");
}

#[test]
fn control_c_reaches_who_was_silent() {
    let mut session = deaf_for(LOST_US, "GM 16500");
    assert!(abort(&mut session).contains("ERR 16384"));
    session.wait_us(100_000);
    assert_stopped(&mut session);
}

#[test]
fn the_only_one_is_told_to_stop_before_the_prompt() {
    let mut session = deaf_for(LOST_US, "X2M 16500");
    assert!(session.until_prompt().contains("ERR 1\r"));
    session.wait_us(100_000);
    assert_stopped(&mut session);
}

#[test]
fn who_is_silent_when_all_have_ended_is_told_alone() {
    let mut session = initialized();
    assert_eq!(session.line("X3FSET MCV 50"), "");
    line_until(&mut session, "X123M 5500", |session| counts(session)[1] > FROM);
    until(&mut session, "two ends", |session| [1, 2].iter().all(|&n| status(session, n).mode == Mode::Idle));
    session.wait_us(10_000);
    session.hand.bus_mut().cut(1, true);
    assert!(session.until_prompt().contains("ERR 1\r"));
    assert_eq!(session.line("X13FGET S"), "0 0");
    assert_near(&session, [100, 100, 100, 0, 0, 0, 0], "all of them");
}
