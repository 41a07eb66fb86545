//! Help, errors, version, RESET (manual 5.2.5, 5.2.6).

use super::{Exchange, Session, assert_answers};
use god::command::ROWS;

/// Lines and answers. Long answers are in golden/administration.txt.
pub const COMMANDS: &[Exchange] = &[
    ("?HI", "HI: finds the stops, and so where the motors are; then goes to 0"),
    ("?ic", "IC [counts 0..20000]: closes by so many counts, or by DS"),
    ("?A?", "A?: lists the commands, the advanced ones as well"),
    ("??", "? [command]: lists the commands, or tells what one does"),
    ("?FROB", "ERR 32"),
    ("?HI O", "ERR 1024"),
    ("?wake", "WAKE: wakes the boards, which sleep after power-on"),
    ("?SAVE", "SAVE: stops the motors, and stores positions and parameters for power-off"),
    ("?S", "<boards> S <property> <value>: sets a property of boards, as 4 S E 82"),
    ("?G", "<boards> G <property>: prints a property of boards, as 123 G TEMP"),
    ("A? HI", "ERR 1024"),
    ("1?", "ERR 4096"),
    ("ERR 0", "0 all went well"),
    (
        "ERR 3",
        "1 a motor's board does not answer, or two have its number: ERR 1 names them\n2 no motor is selected",
    ),
    ("ERR 32768", "32768 (not used)"),
    ("ERR 65536", "ERR 128"),
    ("ERR -1", "ERR 128"),
    ("ERR x", "ERR 128"),
    ("ERR 1 2", "ERR 1024"),
    ("VERS", "600"),
    ("VERS 1", "ERR 1024"),
    ("RESET 1", "ERR 1024"),
    ("RESET", "GOD of a BarrettWraptor, as BarrettHand Firmware\n\rVersion 600"),
];

#[test]
fn administration_commands_have_their_answers() {
    assert_answers(&mut Session::new(), COMMANDS);
}

#[test]
fn help_covers_and_lists_every_command() {
    let mut session = Session::new();
    let standard = session.run("?");
    let all = session.run("A?");
    let names = |list: &str| -> Vec<String> {
        let lines = list.lines().flat_map(|line| line.split_once(": ").expect("a title").1.split(' '));
        lines.map(str::to_owned).collect()
    };
    assert_eq!(names(&all), ROWS.iter().map(|row| row.name).collect::<Vec<_>>());
    let advanced = ["A?", "FLISTA", "FLISTAV", "PLISTA", "PLISTAV"];
    assert_eq!(names(&standard), names(&all)[..ROWS.len() - advanced.len()], "manual 5.2.6");
    assert!(names(&all).ends_with(&advanced.map(str::to_owned)));
    for row in ROWS {
        let help = session.run(&format!("?{}", row.name));
        assert!(help.starts_with(row.name) && help.ends_with(row.help), "{help}");
    }
}

#[test]
fn reset_restarts_hand_and_boards() {
    let mut session = Session::new();
    session.run("PSET LFT 1");
    session.run("FSET DS 7");
    session.run("REC 1");
    assert_eq!(
        session.run("1234567 G STAT"),
        (1..=7).map(|n| format!("{n} STAT=2")).collect::<Vec<_>>().join("\n")
    );
    session.run("RESET");
    session.wait_us(100_000);
    assert_eq!(
        session.run("1234567 G STAT"),
        (1..=7).map(|n| format!("{n} STAT=0")).collect::<Vec<_>>().join("\n")
    );
    assert_answers(&mut session, &[("PGET LFT", "0"), ("FGET DS", "1400 1400 1400 800"), ("VERS", "600")]);
    let recorded = session.hand.memory().changed().expect("the first two lines of the sequence").sequences;
    assert_eq!(recorded[1], "1234567 G STAT\rRESET\r", "recording has ended");
}
