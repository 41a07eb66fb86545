//! Macros and sequences (manual 5.2.4).

use super::{Exchange, Session, assert_answers};

pub const COMMANDS: &[Exchange] = &[
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
    ("REC 5", ""),
    ("sfset ds 100", ""),
    ("  SFGET DS", "100"),
    ("REC", ""),
    ("SFSET DS 200", ""),
    ("PLAY 5", "100"),
    ("SFGET DS", "100"),
];

#[test]
fn sequence_commands_have_their_answers() {
    assert_answers(&mut Session::new(), COMMANDS);
}

fn recorded(session: &Session, number: usize) -> String {
    session.hand.memory().changed().expect("it was recorded").sequences[number].to_string()
}

/// Lines are recorded and run. PLAY, REC and lines that are no command are not recorded.
#[test]
fn rec_records_commands_only() {
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
        // A command that fails is still recorded.
        ("PGET FROB", "ERR 64"),
        ("0 G REPLY", "0 REPLY=0"),
        ("REC 6", "ERR 128"),
        ("VERS", "600"),
        ("REC", ""),
        ("VERS", "600"),
    ];
    assert_answers(&mut session, &rows);
    assert_eq!(recorded(&session, 0), "PGET LFT\rPGET FROB\r0 G REPLY\rVERS\r");
    // Recording erases the sequence at once.
    assert_answers(&mut session, &[("REC 0", "")]);
    assert_eq!(recorded(&session, 0), "");
}

/// A host that waits for PLAY's prompt cannot send blocks (decision 0028).
#[test]
fn loop_while_recording_runs_unrecorded() {
    let mut session = Session::new();
    assert_answers(&mut session, &[("HI", ""), ("REC 1", ""), ("SFGET DS", "800")]);
    assert_eq!(session.run_with_input("SLOOP", b"a\x03"), "**");
    assert_answers(&mut session, &[("VERS", "600"), ("REC", "")]);
    assert_eq!(recorded(&session, 1), "SFGET DS\rVERS\r");
    assert_answers(&mut session, &[("PLAY 1", "800\n600")]);
}

/// 150 characters including the line ends. A line that does not fit ends the recording, and runs.
#[test]
fn sequence_holds_150_characters() {
    let mut session = Session::new();
    session.run("REC 2");
    let lines = [30, 30, 30, 30, 26];
    for len in lines {
        // The CR is the last character.
        assert_eq!(session.run(&format!("VERS{}", " ".repeat(len - 1 - 9) + "1 2 3")), "ERR 1024");
    }
    let end = "sequence 2 is full: recording has ended\n600";
    assert_answers(&mut session, &[("VERS", end), ("VERS", "600"), ("REC 2", ""), ("VERS", "600")]);
    assert_eq!(recorded(&session, 2), "VERS\r");
    let mut session = Session::new();
    session.run("REC 3");
    let first = format!("VERS{}", " ".repeat(140)) + "x";
    assert_answers(&mut session, &[(&*first.leak(), "ERR 1024"), ("?", "")][..1]);
    assert_eq!(recorded(&session, 3).len(), 146);
    assert_answers(
        &mut session,
        &[("?HI", "HI: finds the stops, and so where the motors are; then goes to 0")],
    );
    assert_eq!(recorded(&session, 3).len(), 150, "to the last character");
}

#[test]
fn wait_is_exact_and_abort_or_error_ends_a_sequence() {
    let mut session = Session::new();
    let took = |session: &mut Session, line: &str, answer: &str| {
        let from = session.hand.now_us();
        assert_eq!(session.run(line), answer, "{line}");
        // The session has a resolution of a millisecond.
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
    assert_answers(&mut session, &rows);
    assert_eq!(took(&mut session, "PLAY 4", "600\nERR 64"), 2000);
    session.hand.push_rx(b"PLAY 4\r");
    session.wait_us(1_000_000);
    session.hand.push_rx(b"\x03");
    assert_eq!(session.read_to_prompt(), "PLAY 4\r\n\rERR 16384\r\n\r=> ");
    assert_answers(&mut session, &[("VERS", "600")]);
}

/// REC and PLAY without a number mean sequence 0; REC ends a recording.
#[test]
fn rec_and_play_without_a_number_use_sequence_0() {
    let mut session = Session::new();
    let rows = [
        ("PLAY", "ERR 128"),
        ("REC", ""),
        ("VERS", "600"),
        ("REC", ""),
        ("PGET LFT", "0"),
        ("PLAY", "600"),
        ("PLAY 0", "600"),
        ("REC 3", ""),
        ("PGET LFT", "0"),
        // Ends the recording of sequence 3, and begins none.
        ("REC", ""),
        ("PGET TEMP", "350"),
        ("PLAY", "600"),
        ("PLAY 3", "0"),
        // Records again, from the beginning.
        ("REC", ""),
        ("PLAY 0", "ERR 128"),
        ("REC", ""),
    ];
    assert_answers(&mut session, &rows);
}

#[test]
fn recording_ends_with_its_host() {
    let mut session = Session::new();
    assert_answers(&mut session, &[("REC 2", ""), ("VERS", "600"), ("0 S REPLY 1", "")]);
    session.hand.hang_up();
    session.read_to_prompt();
    assert_answers(&mut session, &[("PGET LFT", "0"), ("0 G REPLY", "0 REPLY=0"), ("PLAY 2", "600")]);
    // ^C ends no recording.
    assert_answers(&mut session, &[("REC 2", "")]);
    session.hand.push_rx(b"\x03");
    session.read_to_prompt();
    assert_answers(&mut session, &[("PGET LFT", "0"), ("REC", ""), ("PLAY 2", "0")]);
}

/// Both are stored at once.
#[test]
fn macros_and_sequences_survive_reset() {
    let mut session = Session::new();
    assert_answers(
        &mut session,
        &[("REC 3", ""), ("VERS", "600"), ("REC", ""), ("HI", ""), ("MACSET 7", "")],
    );
    session.run("RESET");
    assert_answers(&mut session, &[("PLAY 3", "600")]);
    let stored = session.hand.memory().changed().expect("both");
    assert_eq!(stored.macros.iter().position(Option::is_some), Some(7));
    session.hand.bus_mut().cut(6, true);
    assert_answers(&mut session, &[("MACSET 7", "ERR 1")]);
}

#[test]
fn macro_stores_the_position_of_every_motor() {
    let mut session = Session::new();
    let places = "X1234567FGET P";
    session.run("HI");
    session.run("X1M 5500");
    session.run("X5M 11000");
    session.run("SM 4400");
    let there = session.run(places);
    assert_answers(&mut session, &[("MACSET 3", ""), ("HOME", "")]);
    let home = session.run(places);
    let number =
        |places: &str| places.split(' ').map(|place| place.parse().expect("it")).collect::<Vec<i32>>();
    let near = |found: &str, expected: &[i32]| {
        // MPE of each, 200, and hall counts of 55.
        assert!(
            number(found).iter().zip(expected).all(|(a, b)| (a - b).abs() <= 255),
            "{found} {expected:?}"
        );
    };
    near(&home, &[0; 7]);
    near(&there, &[5500, 0, 0, 4400, 11_000, 0, 0]);
    assert_answers(&mut session, &[("X5MAC 3", "")]);
    near(&session.run(places), &[0, 0, 0, 0, 11_000, 0, 0]);
    assert_answers(&mut session, &[("GMAC 3", "")]);
    near(&session.run(places), &[5500, 0, 0, 0, 11_000, 0, 0]);
    assert_answers(&mut session, &[("MAC 3", "")]);
    near(&session.run(places), &[5500, 0, 0, 4400, 11_000, 0, 0]);
    session.run("RESET");
    assert_answers(&mut session, &[("MAC 3", "ERR 4")]);
}
