//! Every command and every parameter has a row in the tables of the tests.

use god::command;
use god::parameter::{HAND, MOTOR};
use god::status;
use god::grammar::{self, Statement};

use super::movement::ends;
use super::{Session, administration, lower, sequences, settings};

/// A line, and what it answers.
pub type Row = (&'static str, &'static str);

/// Types lines, one after another, and looks at their answers.
pub fn exercise(session: &mut Session, rows: &[(&str, &str)]) {
    for (line, answer) in rows {
        assert_eq!(session.line(line), *answer, "{line}");
    }
}

/// A line for each movement command that goes well; where its motors go, and what else may become of it, is in movement/.
const MOVEMENT: &[Row] = &[
    ("C", "ERR 4"),
    ("HI", ""),
    ("M 5000", ""),
    ("HOME", ""),
    ("IC 1000", ""),
    ("IO 1000", ""),
    ("MDEG 20", ""),
    ("MPER 10", ""),
    ("PTM 500", ""),
    ("12WM 2000", ""),
    ("SC", ""),
    ("O", ""),
    ("STC", ""),
    ("STO", ""),
    ("T", ""),
    ("1M x", "ERR 128"),
    ("1T 1", "ERR 1024"),
    // No place is near enough, and no hand cold enough.
    ("SFSET MPE -1", ""),
    ("SM 1000", "ERR 16"),
    ("SFDEF", ""),
    ("PSET OTEMP -1", ""),
    ("SM 2000", "ERR 8192"),
];

/// Lines that go on until the host says more; that; and what comes of both.
const GOING_ON: &[(&str, &[u8], &str)] = &[
    ("LOOP", b"\x03", "*"),
    ("13LOOP", b"a\x03", "**"),
    ("X5LOOP", b"x", "*\nERR 2048"),
    ("WAIT 60000", b"\x03", "ERR 16384"),
];

#[test]
fn movement() {
    exercise(&mut Session::new(), MOVEMENT);
}

#[test]
fn going_on() {
    let mut session = Session::new();
    session.line("HI");
    for (line, more, answer) in GOING_ON {
        assert_eq!(session.line_and(line, more), *answer, "{line}");
    }
}

/// Every row that types a line.
fn rows() -> Vec<Row> {
    let going_on: Vec<Row> = GOING_ON.iter().map(|(line, _, answer)| (*line, *answer)).collect();
    let whole = [MOVEMENT, settings::COMMANDS, sequences::COMMANDS, administration::COMMANDS, lower::LINES];
    let broken = [settings::WORN, ends::LOW_BUS];
    [whole.concat(), broken.concat(), going_on].concat()
}

#[test]
fn no_command_is_without_a_row() {
    let rows = rows();
    let used: Vec<_> = rows
        .iter()
        .filter_map(|(line, _)| match grammar::parse(line) {
            Ok(Statement::Command { command, .. }) => Some(command),
            _ => None,
        })
        .collect();
    for row in command::ROWS {
        assert!(used.contains(&row.command), "no test uses {}", row.name);
    }
}

/// Of the lower grammar, in a line that goes well.
#[test]
fn no_word_of_the_lower_grammar_is_without_a_row() {
    let words = grammar::WALK_THROUGH.into_iter().chain(["S", "G", "M", "AP", "REPLY"]);
    let good = |(line, answer): &Row, word: &str| {
        matches!(grammar::parse(line), Ok(Statement::WalkThrough(_)))
            && line.split_ascii_whitespace().any(|found| found == word)
            && !answer.contains("ERR")
    };
    for word in words {
        assert!(lower::LINES.iter().any(|row| good(row, word)), "no test uses {word}");
    }
}

/// Table 4.
#[test]
fn no_status_code_is_without_a_row() {
    let told = |answer: &str| {
        let codes = answer.lines().filter_map(|line| line.strip_prefix("ERR ")?.parse().ok());
        codes.fold(status::Status::OK, |sum, code| sum | status::Status::of(code))
    };
    let all = rows().iter().fold(status::Status::OK, |sum, (_, answer)| sum | told(answer));
    for row in status::ROWS {
        assert!(all.has(row.status), "no test is told {}", row.status.code());
    }
}

#[test]
fn no_parameter_is_without_a_row() {
    let motor = settings::SET.iter().map(|row| row.0).chain(settings::READ_ONLY.iter().map(|row| row.0));
    let motor: Vec<_> = motor.collect();
    assert!(MOTOR.iter().all(|row| motor.contains(&row.name)), "{motor:?}");
    let hand =
        settings::SET_HAND.iter().map(|row| row.0).chain(settings::READ_ONLY_HAND.iter().map(|row| row.0));
    let hand: Vec<_> = hand.collect();
    assert!(HAND.iter().all(|row| hand.contains(&row.name)), "{hand:?}");
}
