//! Macros and sequences (manual 5.2.4).

use super::Session;
use super::tables::{Row, exercise};

/// Lines and answers, one after another in one session.
pub const COMMANDS: &[Row] = &[
    ("MACSET 0", "ERR 4"),
    ("HI", ""),
    ("MACSET 0", ""),
    ("MACSET 19", ""),
    ("MACSET 20", "ERR 128"),
    ("MACSET -1", "ERR 128"),
    ("MACSET", "ERR 128"),
    ("MACSET 1 2", "ERR 1024"),
    ("1MACSET 1", "ERR 4096"),
    ("MAC 20", "ERR 128"),
    ("MAC", "ERR 128"),
    ("GMAC 3", "ERR 128"),
    ("GMAC 0", ""),
    ("REC 6", "ERR 128"),
    ("REC x", "ERR 128"),
    ("1REC 1", "ERR 4096"),
    ("PLAY", "ERR 128"),
    ("PLAY 6", "ERR 128"),
    ("PLAY 5", "ERR 128"),
    ("1PLAY 5", "ERR 4096"),
    ("PLAY 1 2", "ERR 1024"),
    ("WAIT", "ERR 128"),
    ("WAIT -1", "ERR 128"),
    ("WAIT 4294967296", "ERR 128"),
    ("WAIT 0", ""),
    ("REC", ""),
    ("REC 5", ""),
    ("sfset ds 100", ""),
    ("  SFGET DS", "100"),
    ("REC", ""),
    ("SFSET DS 200", ""),
    ("PLAY 5", "100"),
    ("SFGET DS", "100"),
];

#[test]
fn commands() {
    exercise(&mut Session::new(), COMMANDS);
}

fn recorded(session: &Session, number: usize) -> String {
    session.hand.memory().changed().expect("it was recorded").sequences[number].to_string()
}

/// What is typed is recorded and done; PLAY, REC and what is no command are not recorded.
#[test]
fn what_is_recorded() {
    let mut session = Session::new();
    let rows = [
        ("REC 1", ""),
        ("VERS", "600"),
        ("REC", ""),
        ("REC 0", ""),
        ("PLAY 1", "600"),
        ("PGET LFT", "0"),
        ("FROB", "ERR 32"),
        ("5C", "ERR 2"),
        ("", ""),
        // A command that goes wrong is one all the same.
        ("PGET FROB", "ERR 64"),
        ("0 G REPLY", "0 REPLY=0"),
        ("REC 6", "ERR 128"),
        ("VERS", "600"),
        ("REC", ""),
        ("VERS", "600"),
    ];
    exercise(&mut session, &rows);
    assert_eq!(recorded(&session, 0), "PGET LFT\rPGET FROB\r0 G REPLY\rVERS\r");
    // It is erased as soon as recording begins.
    exercise(&mut session, &[("REC 0", "")]);
    assert_eq!(recorded(&session, 0), "");
}

/// RealTime control is for the host that asks for it, and not for one that waits for PLAY's prompt.
#[test]
fn loop_is_done_and_not_recorded() {
    let mut session = Session::new();
    exercise(&mut session, &[("HI", ""), ("REC 1", ""), ("SFGET DS", "800")]);
    assert_eq!(session.line_and("SLOOP", b"a\x03"), "**");
    exercise(&mut session, &[("VERS", "600"), ("REC", "")]);
    assert_eq!(recorded(&session, 1), "SFGET DS\rVERS\r");
    exercise(&mut session, &[("PLAY 1", "800\n600")]);
}

/// 150 characters with the ends of lines; a line that does not fit ends the recording, and is done.
#[test]
fn a_sequence_is_150_characters() {
    let mut session = Session::new();
    session.line("REC 2");
    let lines = [30, 30, 30, 30, 26];
    for len in lines {
        // And the CR.
        assert_eq!(session.line(&format!("VERS{}", " ".repeat(len - 1 - 9) + "1 2 3")), "ERR 1024");
    }
    let end = "sequence 2 is full: recording has ended\n600";
    exercise(&mut session, &[("VERS", end), ("VERS", "600"), ("REC 2", ""), ("VERS", "600")]);
    assert_eq!(recorded(&session, 2), "VERS\r");
    let mut session = Session::new();
    session.line("REC 3");
    let first = format!("VERS{}", " ".repeat(140)) + "x";
    exercise(&mut session, &[(&*first.leak(), "ERR 1024"), ("?", "")][..1]);
    assert_eq!(recorded(&session, 3).len(), 146);
    exercise(&mut session, &[("?HI", "HI: finds the stops, and so where the motors are; then goes to 0")]);
    assert_eq!(recorded(&session, 3).len(), 150, "to the last one");
}

/// It waits so long, in a sequence too; ^C ends the sequence; so does what goes wrong.
#[test]
fn wait_abort_and_errors() {
    let mut session = Session::new();
    let took = |session: &mut Session, line: &str, answer: &str| {
        let from = session.hand.now_us();
        assert_eq!(session.line(line), answer, "{line}");
        // The session looks once a millisecond.
        (session.hand.now_us() - from) / 1000
    };
    assert_eq!(took(&mut session, "WAIT 5000", ""), 5000);
    let rows = [
        ("REC 4", ""),
        ("WAIT 2000", ""),
        ("VERS", "600"),
        ("PGET FROB", "ERR 64"),
        ("VERS", "600"),
        ("REC", ""),
    ];
    exercise(&mut session, &rows);
    assert_eq!(took(&mut session, "PLAY 4", "600\nERR 64"), 2000);
    session.hand.push_rx(b"PLAY 4\r");
    session.wait_us(1_000_000);
    session.hand.push_rx(b"\x03");
    assert_eq!(session.until_prompt(), "PLAY 4\r\n\rERR 16384\r\n\r=> ");
    exercise(&mut session, &[("VERS", "600")]);
}

/// Both are in memory at once, and so outlive RESET.
#[test]
fn they_outlive_the_power() {
    let mut session = Session::new();
    exercise(&mut session, &[("REC 3", ""), ("VERS", "600"), ("REC", ""), ("HI", ""), ("MACSET 7", "")]);
    session.line("RESET");
    exercise(&mut session, &[("PLAY 3", "600")]);
    let stored = session.hand.memory().changed().expect("both");
    assert_eq!(stored.macros.iter().position(Option::is_some), Some(7));
    session.hand.bus_mut().cut(6, true);
    exercise(&mut session, &[("MACSET 7", "ERR 1")]);
}

/// Each motor goes to where it was at MACSET: a tip too; with X only those that are named.
#[test]
fn a_macro_is_the_place_of_every_motor() {
    let mut session = Session::new();
    let places = "X1234567FGET P";
    session.line("HI");
    session.line("X1M 5500");
    session.line("X5M 11000");
    session.line("SM 4400");
    let there = session.line(places);
    exercise(&mut session, &[("MACSET 3", ""), ("HOME", "")]);
    let home = session.line(places);
    let number =
        |places: &str| places.split(' ').map(|place| place.parse().expect("it")).collect::<Vec<i32>>();
    // The other way round: nobody stays where he was.
    let near = |found: &str, expected: &[i32]| {
        // MPE of each, 200, and hall counts of 55.
        assert!(
            number(found).iter().zip(expected).all(|(a, b)| (a - b).abs() <= 255),
            "{found} {expected:?}"
        );
    };
    near(&home, &[0; 7]);
    near(&there, &[5500, 0, 0, 4400, 11_000, 0, 0]);
    exercise(&mut session, &[("X5MAC 3", "")]);
    near(&session.line(places), &[0, 0, 0, 0, 11_000, 0, 0]);
    exercise(&mut session, &[("GMAC 3", "")]);
    near(&session.line(places), &[5500, 0, 0, 0, 11_000, 0, 0]);
    exercise(&mut session, &[("MAC 3", "")]);
    near(&session.line(places), &[5500, 0, 0, 4400, 11_000, 0, 0]);
    session.line("RESET");
    exercise(&mut session, &[("MAC 3", "ERR 4")]);
}
