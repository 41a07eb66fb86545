//! Where each command takes whom, and when.

use servo_core::mode::Mode;
use tater_wire::Property;

use super::{assert_near, config, counts, initialized, line_until, set, status};

/// Hall counts are GCL counts / 55; a tip goes along with 39/147 of its link's counts, or against with 39/49 of them.
#[test]
fn each_command_takes_each_motor_to_its_place() {
    let mut session = initialized();
    for (line, expected) in [
        ("GM 10000", [182, 182, 182, 0, 48, 48, 48]),
        // DP: 8500, 1575.
        ("M", [155, 155, 155, 29, 41, 41, 41]),
        ("HOME", [0; 7]),
        // 90 degrees of a link are 220.5 counts; of a tip, exactly named, 175.5.
        ("1MDEG 90", [221, 0, 0, 0, 59, 0, 0]),
        ("X5MDEG 90", [221, 0, 0, 0, 176, 0, 0]),
        ("X5MDEG -20", [221, 0, 0, 0, -39, 0, 0]),
        // DP of a tip is 8500 counts, also for MDEG and MPER.
        ("X5MDEG", [221, 0, 0, 0, 155, 0, 0]),
        ("X5HOME", [221, 0, 0, 0, 0, 0, 0]),
        ("X5MPER", [221, 0, 0, 0, 155, 0, 0]),
        ("1HOME", [0; 7]),
        // CT: 18200, 9300.
        ("MPER 50", [165, 165, 165, 85, 44, 44, 44]),
        ("GMPER -5", [-17, -17, -17, 85, -4, -4, -4]),
        ("C", [331, 331, 331, 166, 88, 88, 88]),
        ("O", [0; 7]),
        ("12IC 5500", [100, 100, 0, 0, 27, 27, 0]),
        // DS: 1400, 800.
        ("IC", [125, 125, 25, 15, 34, 34, 7]),
        ("1IO 2750", [75, 125, 25, 15, 21, 34, 7]),
        ("IO", [50, 100, 0, 0, 14, 27, 0]),
        ("X6IC 5500", [50, 100, 0, 0, 14, 127, 0]),
        // A tip that was elsewhere keeps its lead in a relative move, and is put right by an absolute one.
        ("2IC 1100", [50, 120, 0, 0, 14, 132, 0]),
        ("2M 5500", [50, 100, 0, 0, 14, 27, 0]),
        ("GHOME", [0; 7]),
    ] {
        assert_eq!(session.line(line), "", "{line}");
        assert_near(&session, expected, line);
    }
}

#[test]
fn a_wiper_s_tips_keep_their_direction() {
    let mut session = initialized();
    assert_eq!(session.line("X56MDEG 60"), "");
    for (line, expected) in [
        // 5500 counts of a link are 100; a tip goes back by 100 · 39/49 = 80 of its 117.
        ("12WM 5500", [100, 100, 0, 0, 37, 37, 0]),
        ("1WM 2750", [50, 100, 0, 0, 77, 37, 0]),
        // Exactly the named ones: without its tip a link is alone, a tip without its link stands still.
        ("X2WM 2750", [50, 50, 0, 0, 77, 37, 0]),
        ("X16WM 0", [0, 50, 0, 0, 77, 37, 0]),
        ("X15WM 2750", [50, 50, 0, 0, 37, 37, 0]),
        // DP; the spread has no part in it.
        ("WM", [155, 155, 155, 0, -46, -46, -123]),
    ] {
        assert_eq!(session.line(line), "", "{line}");
        assert_near(&session, expected, line);
    }
}

#[test]
fn parallel_tips_go_opposite_ways_while_the_spread_is_open() {
    let mut session = initialized();
    for (line, expected) in [
        ("X567PTM 5500", [0, 0, 0, 0, -100, -100, 100]),
        ("GPTM -5500", [0; 7]),
        ("SM 4500", [0, 0, 0, 82, 0, 0, 0]),
        ("X56PTM 2750", [0, 0, 0, 82, -50, -50, 0]),
        ("X56PTM -2750", [0, 0, 0, 82, 0, 0, 0]),
        // From half of its range on it is closed.
        ("SM 4600", [0, 0, 0, 84, 0, 0, 0]),
        // DS: 1400.
        ("PTM", [0, 0, 0, 84, 25, 25, 25]),
        ("X7PTM -1375", [0, 0, 0, 84, 25, 25, 0]),
    ] {
        assert_eq!(session.line(line), "", "{line}");
        assert_near(&session, expected, line);
    }
}

#[test]
fn torque_controlled_motions_go_to_the_stops() {
    let mut session = initialized();
    for (line, expected) in [
        ("STC", [0, 0, 0, 166, 0, 0, 0]),
        ("1TC", [338, 0, 0, 166, 350, 0, 0]),
        ("X1TO", [-25, 0, 0, 166, 350, 0, 0]),
        ("TO", [-25, -25, -25, 0, -158, -158, -158]),
    ] {
        assert_eq!(session.line(line), "", "{line}");
        assert_near(&session, expected, line);
    }
}

/// A tip goes along by a third of its link's joint angle, 13 hall counts to 49, as far as velocities that friction holds back alike can do
/// it: at a link's count of 150 it is somewhere between 20 and 70. With X it goes by itself, as fast as the link.
#[test]
fn torque_controlled_tips_go_along_with_their_links() {
    for (line, along) in [("GTC", true), ("X123567TC", false)] {
        let mut session = initialized();
        line_until(&mut session, line, |session| counts(session)[0] >= 150);
        let tip = counts(&session)[4];
        assert_eq!((20..=70).contains(&tip), along, "{line}: {tip}");
        session.until_prompt();
        assert_near(
            &session,
            [338, 338, 338, 0, 350, 350, 350],
            "what has stopped the link lets its tip go on",
        );
        for motor in 1..=7 {
            assert_eq!(config(&mut session, motor).mcv, 1000, "{line}: MCV of {motor} is given back");
        }
    }
}

/// When the motors of a command end, ms.
fn ends_of(line: &str) -> [u64; 7] {
    let mut session = initialized();
    let mut ends = [0; 7];
    line_until(&mut session, line, |session| {
        let mut moving = false;
        for motor in 1..=7 {
            if status(session, motor).mode == Mode::Trapezoidal {
                ends[usize::from(motor) - 1] = session.hand.now_us() / 1000;
                moving = true;
            }
        }
        ends != [0; 7] && !moving
    });
    session.until_prompt();
    for motor in 1..=7 {
        assert_eq!(config(&mut session, motor).mv, 1000, "{line}: MV of {motor} is given back");
    }
    ends
}

/// MV is whole counts/s: of a tip that cruises at 100 that is 1 %, or 10 ms of a second's way, and the position comes to rest within TSTOP's
/// granularity of a few counts, 20 ms more.
const TOGETHER_MS: u64 = 30;

#[test]
fn link_and_tip_arrive_together() {
    for line in ["GM 18000", "GM 3000", "2WM 8000", "1IC 7000"] {
        let ends = ends_of(line);
        for finger in (0..3).filter(|&finger| ends[finger] != 0) {
            let apart = ends[finger].abs_diff(ends[finger + 4]);
            assert!(apart <= TOGETHER_MS, "{line}: finger {finger} {apart} ms apart: {ends:?}");
        }
    }
    // Without a finger each takes its own time: 331 and 88 counts do not take the same.
    let ends = ends_of("X15M 15000");
    assert!(ends[0].abs_diff(ends[4]) > TOGETHER_MS, "{ends:?}");
}

#[test]
fn without_a_prefix_those_with_en_move() {
    let mut session = initialized();
    // A finger goes by its link; its tip's EN is nothing to it.
    for (motor, en) in [(2, 0), (4, 0), (5, 0)] {
        set(&mut session, motor, Property::EN, en);
    }
    for (line, expected) in [
        ("M 2750", [50, 0, 50, 0, 13, 0, 13]),
        ("2M 2750", [50, 50, 50, 0, 13, 13, 13]),
        ("HOME", [0, 50, 0, 0, 0, 13, 0]),
    ] {
        assert_eq!(session.line(line), "", "{line}");
        assert_near(&session, expected, line);
    }
    set(&mut session, 1, Property::EN, 0);
    set(&mut session, 3, Property::EN, 0);
    let before = counts(&session);
    assert_eq!(session.line("M 2750"), "ERR 2", "nobody");
    assert_eq!(counts(&session), before);
}
