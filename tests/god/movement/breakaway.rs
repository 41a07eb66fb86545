//! Fingers that meet something (manual 5.1.2, BS, BD and BP).

use servo_core::mode::Mode;
use tater_wire::Property;

use super::{Session, TOLERANCE, assert_near, config, counts, set, telemetry, with_object};

/// Position of the object in the way of link 1, hall counts.
const OBJECT: i32 = 150;

/// Dent before the board detects the breakaway, hall counts: BT 400 is 0.25 N·m, or 1.5 counts (scenario breakaway-link).
const INTO: i32 = 8;

fn finger() -> Session {
    with_object(1, f64::from(OBJECT))
}

fn has_met(count: i32) -> bool {
    (OBJECT..=OBJECT + INTO).contains(&count)
}

#[test]
fn breakaway_tip_closes_on_and_finger_opens_again() {
    let mut session = finger();
    for _ in 0..2 {
        assert_eq!(session.run("C"), "", "C is never ERR 16");
        // The second time the tip stays closed: it no longer follows the link.
        let found = counts(&session);
        assert!(has_met(found[0]), "{found:?}");
        assert!((found[4] - 331).abs() <= TOLERANCE, "the tip moves on to its own CT: {found:?}");
        assert!(
            (found[5] - 88).abs() <= TOLERANCE && (found[1] - 331).abs() <= TOLERANCE,
            "the others: {found:?}"
        );
        let at = telemetry(&mut session, 1).breakaway.expect("BD");
        assert!(has_met(at), "BP: {at}");
        assert_eq!(telemetry(&mut session, 1).mode, Mode::Idle, "locked");
        assert_eq!(config(&mut session, 5).mv, 1000);
    }
    assert_eq!(session.run("1IC 550"), "ERR 16");
    assert!(counts(&session)[4] >= 331, "{:?}", counts(&session));
    assert_eq!(session.run("1M 18000"), "ERR 16");
    assert!(counts(&session)[4] >= 331, "{:?}", counts(&session));
    // Opening aligns link and tip again; only O clears BD.
    assert_eq!(session.run("1M 5500"), "");
    assert_near(&session, [100, 331, 331, 166, 27, 88, 88], "M");
    assert!(telemetry(&mut session, 1).breakaway.is_some());
    assert_eq!(session.run("O"), "");
    assert_near(&session, [0; 7], "O");
    assert_eq!(telemetry(&mut session, 1).breakaway, None);
}

#[test]
fn closing_again_after_breakaway_never_opens_the_tip() {
    let mut session = finger();
    assert_eq!(session.run("1C"), "");
    super::run_until(&mut session, "1C", |session| {
        let tip = counts(session)[4];
        assert!(tip >= 331 - TOLERANCE, "{tip}");
        session.hand.take_tx().ends_with(b"=> ")
    });
}

#[test]
fn tip_alone_after_breakaway_runs_at_full_speed() {
    let mut session = finger();
    super::run_until(&mut session, "1C", |session| counts(session)[0] > 50);
    assert!(config(&mut session, 5).mv < 1000, "with its link it moves slower");
    super::wait_until(&mut session, "its end", |session| counts(session)[4] > 200);
    assert_eq!(config(&mut session, 5).mv, 1000);
}

#[test]
fn tip_ended_by_strain_stays_after_breakaway() {
    let mut session = finger();
    super::run_until(&mut session, "1C", |session| counts(session)[0] > 50);
    // At rest the gauge reads 128.
    set(&mut session, 5, Property::HSG, 1);
    super::wait_until(&mut session, "its end", |session| telemetry(session, 5).mode == Mode::Idle);
    set(&mut session, 5, Property::HSG, 256);
    session.read_to_prompt();
    let found = counts(&session);
    assert!(has_met(found[0]) && found[4] < 40, "{found:?}");
}

#[test]
fn breakaway_with_bs_stops_the_tip() {
    let mut session = finger();
    set(&mut session, 1, Property::BS, 1);
    assert_eq!(session.run("1C"), "");
    let found = counts(&session);
    // The tip followed its link to 150 · 39/147 = 40, and needs a few counts to stop.
    assert!(has_met(found[0]) && (40..50).contains(&found[4]), "{found:?}");
    assert_eq!(telemetry(&mut session, 5).mode, Mode::Idle);
}

#[test]
fn breakaway_in_m_is_err_16_and_tip_reaches_its_goal() {
    let mut session = finger();
    assert_eq!(session.run("1M 11000"), "ERR 16");
    let found = counts(&session);
    assert!(has_met(found[0]) && (found[4] - 53).abs() <= TOLERANCE, "{found:?}");
    assert!(telemetry(&mut session, 1).breakaway.is_some());
    assert_eq!(session.run("1HI"), "");
    assert_eq!(telemetry(&mut session, 1).breakaway, None);
}

#[test]
fn breakaway_in_wm_stops_the_tip() {
    let mut session = finger();
    assert_eq!(session.run("X5MDEG 90"), "");
    assert_eq!(session.run("1WM 16500"), "ERR 16");
    let found = counts(&session);
    // 176 minus the link's travel of 150..158 · 39/49, and what the tip takes to stop.
    assert!(has_met(found[0]) && (30..60).contains(&found[4]), "{found:?}");
}

#[test]
fn exclusive_prefix_disables_breakaway() {
    let mut session = finger();
    assert_eq!(session.run("X15C"), "");
    let found = counts(&session);
    // Full MT, 0.48 N·m, dents the object by 2.7 counts.
    assert!(has_met(found[0]) && (found[4] - 331).abs() <= TOLERANCE, "{found:?}");
    assert_eq!(telemetry(&mut session, 1).breakaway, None);
    assert_eq!(telemetry(&mut session, 1).end, Some(servo_core::EndReason::Stalled));
    assert_eq!(config(&mut session, 1).bt, 400, "BT is restored");
    assert_eq!(session.run("X1M 16500"), "ERR 16");
    assert_eq!(session.run("X1O"), "");
}
