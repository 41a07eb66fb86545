//! EN: which motors a command without a prefix moves, sets and prints, for every command and every combination of link and tip.

use hil_world::hand::Hand;
use hil_world::plant::Model;

use super::Session;
use super::faults::saved;
use super::movement::counts;

/// Finger 1 has the combination under test; finger 2 is whole, finger 3 has its tip only, and the spread is disabled.
fn session(link: bool, tip: bool) -> (Session, Vec<usize>) {
    let mut session =
        Session::from_hand(Hand::restore(Model::Averaged, 1, saved()).expect("within its stops"));
    let enabled = [link, true, false, false, tip, true, true];
    for (place, enabled) in enabled.iter().enumerate().filter(|(_, enabled)| !**enabled) {
        assert_eq!(session.run(&format!("X{}FSET EN {}", place + 1, u8::from(*enabled))), "");
    }
    let motors = (1..=7).filter(|motor| enabled[motor - 1]).collect();
    (session, motors)
}

const COMBINATIONS: [(bool, bool); 4] = [(true, true), (true, false), (false, true), (false, false)];

/// A command, and whether it moves a motor that is enabled; `whole` where the motor's finger is.
type Row = (&'static str, fn(motor: usize, is_enabled: &dyn Fn(usize) -> bool) -> bool);

const MOVE: &[Row] = &[
    ("HI", |_, _| true),
    ("C", |_, _| true),
    ("O", |_, _| true),
    ("M 9000", |_, _| true),
    ("MDEG 60", |_, _| true),
    ("MPER 60", |_, _| true),
    ("IC 3000", |_, _| true),
    ("IO 2000", |_, _| true),
    ("HOME", |_, _| true),
    ("TC", |_, _| true),
    ("TO", |_, _| true),
    ("MAC 3", |_, _| true),
    ("T", |_, _| false),
    // A tip keeps its direction while its link moves.
    ("WM 6000", |motor, is_enabled| motor < 4 || is_enabled(motor - 4)),
    ("PTM 2000", |motor, _| motor > 4),
];

/// Travel of a motor that has moved, hall counts: backlash and rest are less.
const MOVED: i32 = 3;

#[test]
fn command_without_a_prefix_moves_exactly_the_enabled_motors() {
    for (link, tip) in COMBINATIONS {
        for (line, moves) in MOVE {
            let (mut session, enabled) = session(link, tip);
            let before = counts(&session);
            session.type_line(line);
            // HI and O may end where they began: any travel on the way counts.
            let mut moved = [false; 7];
            loop {
                session.wait_us(20_000);
                for (moved, (now, before)) in moved.iter_mut().zip(counts(&session).iter().zip(&before)) {
                    *moved |= (now - before).abs() >= MOVED;
                }
                let text: String = session.hand.take_tx().into_iter().map(char::from).collect();
                if text.ends_with("=> ") {
                    break;
                }
            }
            let is_enabled = |motor: usize| enabled.contains(&motor);
            let expected: Vec<usize> =
                enabled.iter().copied().filter(|&motor| moves(motor, &is_enabled)).collect();
            let found: Vec<usize> = (1..=7).filter(|motor| moved[motor - 1]).collect();
            assert_eq!(found, expected, "{line} with EN {} {}", u8::from(link), u8::from(tip));
        }
    }
}

/// 9000 GCL counts are 164 hall counts; a tip that follows goes to 13/49 of them, one alone to all.
#[test]
fn tip_follows_its_link_only_if_both_are_enabled() {
    for (link, tip) in COMBINATIONS {
        let (mut session, enabled) = session(link, tip);
        let before = counts(&session);
        assert_eq!(session.run("M 9000"), "");
        let after = counts(&session);
        let expected = |motor: usize| match motor {
            _ if !enabled.contains(&motor) => before[motor - 1],
            5 | 6 if enabled.contains(&(motor - 4)) => 44,
            _ => 164,
        };
        for motor in 1..=7 {
            let distance = (after[motor - 1] - expected(motor)).abs();
            assert!(distance <= 4, "motor {motor} with EN {link} {tip}: {after:?}");
        }
    }
}

/// A finger has one value; a motor without its finger has its own.
#[test]
fn parameters_without_a_prefix_are_those_of_the_enabled_motors() {
    for (link, tip) in COMBINATIONS {
        let (mut session, enabled) = session(link, tip);
        let all = "X1234567FGET TSTOP";
        let tstop = |on: bool, value: u32| if on { value } else { 77 };
        assert_eq!(session.run("X1234567FSET TSTOP 77"), "");
        assert_eq!(session.run("FSET TSTOP 99"), "");
        let found: Vec<u32> =
            session.run(all).split(' ').map(|value| value.parse().expect("a number")).collect();
        let expected: Vec<u32> = (1..=7).map(|motor| tstop(enabled.contains(&motor), 99)).collect();
        assert_eq!(found, expected, "EN {link} {tip}");
        // Motor 6 follows motor 2, and so does 5 if its link is enabled.
        let axes = enabled.iter().filter(|&&motor| motor != 6 && !(motor == 5 && link)).count();
        for line in ["FGET P", "FGET S", "FGET LCV", "FGET TSTOP"] {
            assert_eq!(session.run(line).split(' ').count(), axes, "{line} with EN {link} {tip}");
        }
        for line in ["FDEF", "FSAVE", "FLOAD"] {
            assert_eq!(session.run(line), "", "{line}");
        }
        let found = session.run(all);
        let defaults = [300, 300, 300, 400, 300, 300, 300];
        let expected: Vec<String> = (1..=7)
            .map(|motor| if enabled.contains(&motor) { defaults[motor - 1] } else { 77 }.to_string())
            .collect();
        assert_eq!(found, expected.join(" "), "FDEF with EN {link} {tip}");
    }
}

/// A prefix selects its motors whatever EN is, and a finger that it names moves as one.
#[test]
fn prefix_overrides_en() {
    let (mut session, _) = session(false, false);
    for (line, expected) in [("1M 9000", [164, 44]), ("X1M 8000", [145, 44]), ("X5M 8000", [145, 145])] {
        assert_eq!(session.run(line), "", "{line}");
        let found = counts(&session);
        for (found, expected) in [found[0], found[4]].iter().zip(expected) {
            assert!((found - expected).abs() <= 4, "{line}: {found} of {expected}");
        }
    }
    for (line, count) in [("1FGET P", 1), ("X15FGET P", 2), ("GFGET P", 3), ("SGFGET P", 4), ("XGFGET P", 6)]
    {
        assert_eq!(session.run(line).split(' ').count(), count, "{line}");
    }
    assert_eq!(session.run("X1234567FSET EN 0"), "");
    for line in ["C", "HI", "FGET P", "FSET DS 1", "LOOP", "T", "MAC 3", "XC"] {
        assert_eq!(session.run(line), "ERR 2", "{line}");
    }
}

/// By EN alone no line without a prefix would reach a disabled motor again, nor would FDEF leave a hand that moves.
#[test]
fn fset_en_and_fdef_enable_disabled_motors() {
    const EN: &str = "X1234567FGET EN";
    for disabled in ["X4", "X15", "X26", "X7", "X1234567"] {
        for line in ["FSET EN 1", "FDEF"] {
            let mut session = Session::new();
            assert_eq!(session.run(&format!("{disabled}FSET EN 0")), "");
            assert_eq!(session.run(line), "", "{line} with {disabled} disabled");
            assert_eq!(session.run(EN), "1 1 1 1 1 1 1", "{line} with {disabled} disabled");
        }
    }
    // With a prefix the named motors alone; everything else of a line is for those that had EN.
    let mut session = Session::new();
    for (line, answer) in [
        ("4FSET EN 0", ""),
        ("1FSET EN 1", ""),
        ("1FDEF", ""),
        (EN, "1 1 1 0 1 1 1"),
        ("FSET EN 1 TSTOP 77", ""),
        ("X1234567FGET TSTOP", "77 77 77 400 77 77 77"),
        (EN, "1 1 1 1 1 1 1"),
        ("FSET EN 0", ""),
        ("FSET EN 1 TSTOP 78", "ERR 2"),
        ("FSET EN 2", "ERR 128"),
        (EN, "0 0 0 0 0 0 0"),
        ("FDEF", ""),
        ("X4FGET EN", "1"),
    ] {
        assert_eq!(session.run(line), answer, "{line}");
    }
    assert!(session.run("?FDEF").contains("EN of all"));
}
