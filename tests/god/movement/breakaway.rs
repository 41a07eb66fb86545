//! Fingers that meet something (manual 5.1.2, BS, BD and BP).

use servo_core::mode::Mode;
use tater_wire::Property;

use super::{NEAR, Session, assert_near, config, counts, set, status, with_object};

/// Where link 1 meets something, hall counts.
const OBJECT: i32 = 150;

/// How far into it the link is when its board is sure: BT 400 is 0.25 N·m, or 1.5 counts (scenario breakaway-link).
const INTO: i32 = 8;

fn finger() -> Session {
    with_object(1, f64::from(OBJECT))
}

fn has_met(count: i32) -> bool {
    (OBJECT..=OBJECT + INTO).contains(&count)
}

#[test]
fn a_closing_finger_envelops_what_its_link_meets_and_opens_again() {
    let mut session = finger();
    for _ in 0..2 {
        assert_eq!(session.line("C"), "", "C is never ERR 16");
        // The second time the tip stays closed: it does not go along any more.
        let found = counts(&session);
        assert!(has_met(found[0]), "{found:?}");
        assert!((found[4] - 331).abs() <= NEAR, "its tip goes on to its own CT: {found:?}");
        assert!((found[5] - 88).abs() <= NEAR && (found[1] - 331).abs() <= NEAR, "the others: {found:?}");
        let at = status(&mut session, 1).breakaway.expect("BD");
        assert!(has_met(at), "BP: {at}");
        assert_eq!(status(&mut session, 1).mode, Mode::Idle, "locked");
        assert_eq!(config(&mut session, 5).mv, 1000);
    }
    // On with it by steps: what it holds is not let go.
    assert_eq!(session.line("1IC 550"), "ERR 16");
    assert!(counts(&session)[4] >= 331, "{:?}", counts(&session));
    assert_eq!(session.line("1M 18000"), "ERR 16");
    assert!(counts(&session)[4] >= 331, "{:?}", counts(&session));
    // Opening puts the finger right; BD is O's to clear.
    assert_eq!(session.line("1M 5500"), "");
    assert_near(&session, [100, 331, 331, 166, 27, 88, 88], "M");
    assert!(status(&mut session, 1).breakaway.is_some());
    assert_eq!(session.line("O"), "");
    assert_near(&session, [0; 7], "O");
    assert_eq!(status(&mut session, 1).breakaway, None);
}

#[test]
fn the_tip_never_opens_while_its_finger_closes_again() {
    let mut session = finger();
    assert_eq!(session.line("1C"), "");
    super::line_until(&mut session, "1C", |session| {
        let tip = counts(session)[4];
        assert!(tip >= 331 - NEAR, "{tip}");
        session.hand.take_tx().ends_with(b"=> ")
    });
}

#[test]
fn a_tip_that_goes_on_alone_goes_as_fast_as_it_may() {
    let mut session = finger();
    super::line_until(&mut session, "1C", |session| counts(session)[0] > 50);
    assert!(config(&mut session, 5).mv < 1000, "with its link it goes slower");
    super::until(&mut session, "its end", |session| counts(session)[4] > 200);
    assert_eq!(config(&mut session, 5).mv, 1000);
}

#[test]
fn a_tip_that_strain_has_ended_does_not_go_on() {
    let mut session = finger();
    super::line_until(&mut session, "1C", |session| counts(session)[0] > 50);
    // At rest the gauge says 128.
    set(&mut session, 5, Property::HSG, 1);
    super::until(&mut session, "its end", |session| status(session, 5).mode == Mode::Idle);
    set(&mut session, 5, Property::HSG, 256);
    session.until_prompt();
    let found = counts(&session);
    assert!(has_met(found[0]) && found[4] < 40, "{found:?}");
}

#[test]
fn bs_stops_the_tip_too() {
    let mut session = finger();
    set(&mut session, 1, Property::BS, 1);
    assert_eq!(session.line("1C"), "");
    let found = counts(&session);
    // Where it was then: along with its link, 150 · 39/147 = 40, and a few counts to stop.
    assert!(has_met(found[0]) && (40..50).contains(&found[4]), "{found:?}");
    assert_eq!(status(&mut session, 5).mode, Mode::Idle);
}

#[test]
fn a_position_that_the_link_does_not_reach_is_err_16_and_the_tip_reaches_its_own() {
    let mut session = finger();
    assert_eq!(session.line("1M 11000"), "ERR 16");
    let found = counts(&session);
    assert!(has_met(found[0]) && (found[4] - 53).abs() <= NEAR, "{found:?}");
    assert!(status(&mut session, 1).breakaway.is_some());
    // HI forgets it as well.
    assert_eq!(session.line("1HI"), "");
    assert_eq!(status(&mut session, 1).breakaway, None);
}

#[test]
fn a_wiper_stops_with_its_link() {
    let mut session = finger();
    assert_eq!(session.line("X5MDEG 90"), "");
    assert_eq!(session.line("1WM 16500"), "ERR 16");
    let found = counts(&session);
    // 176 less what the link went, 150..158 · 39/49, and a few counts to stop.
    assert!(has_met(found[0]) && (40..60).contains(&found[4]), "{found:?}");
}

#[test]
fn with_x_there_is_no_breakaway() {
    let mut session = finger();
    assert_eq!(session.line("X15C"), "");
    let found = counts(&session);
    // With all of MT, 0.48 N·m, it is 2.7 counts into the object.
    assert!(has_met(found[0]) && (found[4] - 331).abs() <= NEAR, "{found:?}");
    assert_eq!(status(&mut session, 1).breakaway, None);
    assert_eq!(status(&mut session, 1).end, Some(servo_core::EndReason::Stalled));
    assert_eq!(config(&mut session, 1).bt, 400, "BT is given back");
    assert_eq!(session.line("X1M 16500"), "ERR 16");
    assert_eq!(session.line("X1O"), "");
}
