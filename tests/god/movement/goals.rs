//! Goals and timing of each command.

use servo_core::mode::Mode;
use tater_wire::Property;

use super::{assert_near, config, counts, initialized, run_until, set, telemetry};

/// A hall count is 55 GCL counts. A tip follows its link by 39/147 of the counts, or turns against it by 39/49.
#[test]
fn each_command_reaches_its_goals() {
    let mut session = initialized();
    for (line, expected) in [
        ("GM 10000", [182, 182, 182, 0, 48, 48, 48]),
        // DP: 8500, 1575.
        ("M", [155, 155, 155, 29, 41, 41, 41]),
        ("HOME", [0; 7]),
        // 90 degrees of a link are 220.5 counts; of a tip named with X 175.5.
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
        // Where C goes, which a finger's tip follows too (decision 0001).
        ("MPER 100", [331, 331, 331, 166, 88, 88, 88]),
        ("C", [331, 331, 331, 166, 88, 88, 88]),
        ("O", [0; 7]),
        ("12IC 5500", [100, 100, 0, 0, 27, 27, 0]),
        // DS: 1400, 800.
        ("IC", [125, 125, 25, 15, 34, 34, 7]),
        ("1IO 2750", [75, 125, 25, 15, 21, 34, 7]),
        ("IO", [50, 100, 0, 0, 14, 27, 0]),
        ("X6IC 5500", [50, 100, 0, 0, 14, 127, 0]),
        // A relative move keeps the offset between tip and link; an absolute one removes it.
        ("2IC 1100", [50, 120, 0, 0, 14, 132, 0]),
        ("2M 5500", [50, 100, 0, 0, 14, 27, 0]),
        ("GHOME", [0; 7]),
    ] {
        assert_eq!(session.run(line), "", "{line}");
        assert_near(&session, expected, line);
    }
}

#[test]
fn wm_tips_keep_their_direction() {
    let mut session = initialized();
    assert_eq!(session.run("X56MDEG 60"), "");
    for (line, expected) in [
        // 5500 counts of a link are 100; the tip turns back by 100 · 39/49 = 80 of its 117.
        ("12WM 5500", [100, 100, 0, 0, 37, 37, 0]),
        ("1WM 2750", [50, 100, 0, 0, 77, 37, 0]),
        // Only the named motors: a link moves alone, a tip without its link not at all.
        ("X2WM 2750", [50, 50, 0, 0, 77, 37, 0]),
        ("X16WM 0", [0, 50, 0, 0, 77, 37, 0]),
        ("X15WM 2750", [50, 50, 0, 0, 37, 37, 0]),
        // DP; the spread does not move.
        ("WM", [155, 155, 155, 0, -46, -46, -123]),
    ] {
        assert_eq!(session.run(line), "", "{line}");
        assert_near(&session, expected, line);
    }
}

/// The manual's example turns tips that are open beyond their stops, at -8690 counts (decision 0001).
#[test]
fn wm_of_the_manual_reaches_its_goal_with_tips_that_have_room() {
    let mut session = initialized();
    assert_eq!(session.run("12WM 12000"), "ERR 16");
    assert_eq!(session.run("HOME"), "");
    assert_eq!(session.run("X56M 1000"), "");
    assert_eq!(session.run("12WM 12000"), "");
}

#[test]
fn ptm_with_open_spread_moves_tips_in_opposite_directions() {
    let mut session = initialized();
    for (line, expected) in [
        ("X567PTM 5500", [0, 0, 0, 0, -100, -100, 100]),
        ("GPTM -5500", [0; 7]),
        ("SM 4500", [0, 0, 0, 82, 0, 0, 0]),
        ("X56PTM 2750", [0, 0, 0, 82, -50, -50, 0]),
        ("X56PTM -2750", [0, 0, 0, 82, 0, 0, 0]),
        // From half of its range on the spread counts as closed.
        ("SM 4600", [0, 0, 0, 84, 0, 0, 0]),
        // DS: 1400.
        ("PTM", [0, 0, 0, 84, 25, 25, 25]),
        ("X7PTM -1375", [0, 0, 0, 84, 25, 25, 0]),
    ] {
        assert_eq!(session.run(line), "", "{line}");
        assert_near(&session, expected, line);
    }
}

#[test]
fn tc_and_to_reach_the_stops() {
    let mut session = initialized();
    for (line, expected) in [
        ("STC", [0, 0, 0, 166, 0, 0, 0]),
        ("1TC", [338, 0, 0, 166, 350, 0, 0]),
        ("X1TO", [-25, 0, 0, 166, 350, 0, 0]),
        ("TO", [-25, -25, -25, 0, -158, -158, -158]),
    ] {
        assert_eq!(session.run(line), "", "{line}");
        assert_near(&session, expected, line);
    }
}

/// A tip follows by velocity alone, 13 hall counts to its link's 49: at link position 150 it is between 20 and 70.
#[test]
fn tc_tips_move_along_with_their_links() {
    for (line, along) in [("GTC", true), ("X123567TC", false)] {
        let mut session = initialized();
        run_until(&mut session, line, |session| counts(session)[0] >= 150);
        let tip = counts(&session)[4];
        assert_eq!((20..=70).contains(&tip), along, "{line}: {tip}");
        session.read_to_prompt();
        assert_near(
            &session,
            [338, 338, 338, 0, 350, 350, 350],
            "the tip continues when its link has stopped",
        );
        for motor in 1..=7 {
            assert_eq!(config(&mut session, motor).mcv, 1000, "{line}: MCV of {motor} is restored");
        }
    }
}

fn ends_of(line: &str) -> [u64; 7] {
    let mut session = initialized();
    let mut ends = [0; 7];
    run_until(&mut session, line, |session| {
        let mut moving = false;
        for motor in 1..=7 {
            if telemetry(session, motor).mode == Mode::Trapezoidal {
                ends[usize::from(motor) - 1] = session.hand.now_us() / 1000;
                moving = true;
            }
        }
        ends != [0; 7] && !moving
    });
    session.read_to_prompt();
    for motor in 1..=7 {
        assert_eq!(config(&mut session, motor).mv, 1000, "{line}: MV of {motor} is restored");
    }
    ends
}

/// Longest time between the ends of link and tip, ms: MV in whole counts/s gives 10 ms, the last counts before rest 20 ms.
const TOGETHER_MS: u64 = 30;

#[test]
fn move_link_and_tip_arrive_together() {
    for line in ["GM 18000", "GM 3000", "2WM 8000", "1IC 7000"] {
        let ends = ends_of(line);
        for finger in (0..3).filter(|&finger| ends[finger] != 0) {
            let apart = ends[finger].abs_diff(ends[finger + 4]);
            assert!(apart <= TOGETHER_MS, "{line}: finger {finger} {apart} ms apart: {ends:?}");
        }
    }
    let ends = ends_of("X15M 15000");
    assert!(ends[0].abs_diff(ends[4]) > TOGETHER_MS, "{ends:?}");
}

#[test]
fn no_prefix_selects_motors_with_en() {
    let mut session = initialized();
    // Motors 1 and 6 are without their finger: each goes to the position itself.
    for (motor, en) in [(2, 0), (4, 0), (5, 0)] {
        set(&mut session, motor, Property::EN, en);
    }
    for (line, expected) in [
        ("M 2750", [50, 0, 50, 0, 0, 50, 13]),
        ("2M 2750", [50, 50, 50, 0, 0, 13, 13]),
        ("HOME", [0, 50, 0, 0, 0, 0, 0]),
    ] {
        assert_eq!(session.run(line), "", "{line}");
        assert_near(&session, expected, line);
    }
    for motor in [1, 3, 6, 7] {
        set(&mut session, motor, Property::EN, 0);
    }
    let before = counts(&session);
    assert_eq!(session.run("M 2750"), "ERR 2", "no motor is enabled");
    assert_eq!(counts(&session), before);
}
