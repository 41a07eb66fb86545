//! HI.

use servo_core::mode::Mode;
use tater_wire::Property;

use super::{Session, abort, assert_near, counts, run_until, set, telemetry, wait_until};

#[test]
fn hi_homes_links_first_and_ends_at_zero() {
    let mut session = Session::new();
    let (mut lowest, mut highest) = ([0; 7], [0; 7]);
    run_until(&mut session, "HI", |session| {
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
            // The links have touched their stops, half a count below -25, and are back.
            assert!(lowest[..3].iter().all(|&count| count <= -25), "{lowest:?}");
            assert_near(session, [0; 7], "links first");
        }
        begun
    });
    wait_until(&mut session, "its end", |session| {
        for (place, count) in counts(session).into_iter().enumerate() {
            highest[place] = count.max(highest[place]);
        }
        session.hand.take_tx().ends_with(b"=> ")
    });
    assert!(
        highest[4..].iter().all(|&count| count >= 350),
        "the tips have touched their closed stops: {highest:?}"
    );
    assert_near(&session, [0; 7], "HI");
    for motor in 1..=7 {
        assert!(telemetry(&mut session, motor).homed, "{motor}");
    }
}

#[test]
fn hi_with_one_failing_motor_is_err_4_and_homes_the_others() {
    let mut session = Session::new();
    assert_eq!(session.run("HI"), "");
    // Boards refuse HI with IVEL 0 and with IHIT 0; an earlier HI does not count.
    set(&mut session, 2, Property::IVEL, 0);
    set(&mut session, 5, Property::IHIT, 0);
    for motor in [1, 3, 4, 6, 7] {
        set(&mut session, motor, Property::M, 20);
    }
    session.wait_us(1_000_000);
    assert_eq!(session.run("HI"), "ERR 4");
    assert_near(&session, [0; 7], "the others");
    assert_eq!(session.run("13HI"), "ERR 4");
    assert_eq!(session.run("3SHI"), "");
    super::node(&mut session, 3).rig_mut().set_bus(10.0);
    assert_eq!(session.run("3SHI"), "ERR 4");
    super::node(&mut session, 3).rig_mut().set_bus(24.0);
    assert_eq!(session.run("3SHI"), "", "it works again");
}

#[test]
fn hi_aborted_initializes_no_motor() {
    let mut session = Session::new();
    run_until(&mut session, "HI", |session| counts(session)[0] < -5);
    assert!(abort(&mut session).contains("ERR 16384"));
    assert_eq!(telemetry(&mut session, 1).mode, Mode::Idle);
    assert_eq!(session.run("GO"), "ERR 4");
    assert_eq!(session.run("HI"), "");
    assert_eq!(session.run("GO"), "");
}

/// The spread waits for the links without a frame: in mode 2 it would lose its host after HOSTMS, and end with a fault.
#[test]
fn hi_stops_a_spread_that_is_driven_before_the_links_begin() {
    for drive in [&["4 S T 40", "4 S MODE 2"][..], &["4 S V 20", "4 S MODE 4"]] {
        let mut session = Session::new();
        assert_eq!(session.run("HI"), "");
        for line in drive {
            assert_eq!(session.run(line), "", "{line}");
        }
        run_until(&mut session, "HI", |session| counts(session)[0] < -5);
        let mode = telemetry(&mut session, 4).mode;
        assert!(matches!(mode, Mode::Idle | Mode::Pid), "{drive:?}: {mode:?}");
        assert_eq!(session.read_to_prompt(), "HI\r\n\r=> ", "{drive:?}");
        assert_near(&session, [0; 7], "home");
    }
}
