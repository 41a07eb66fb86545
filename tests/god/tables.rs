//! The tests cover every command, parameter and status code.

use god::command;
use god::grammar::{self, Statement};
use god::parameter::{HAND, MOTOR};
use god::status;

use super::movement::ends;
use super::{Exchange, Session, administration, assert_answers, sequences, settings, walk_through_grammar};

/// Each movement command once. The tests in movement/ check where the motors go, and the errors.
const MOVEMENT: &[Exchange] = &[
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
    // A negative MPE, which no position meets; then an OTEMP below the hand's temperature.
    ("SFSET MPE -1", ""),
    ("SM 1000", "ERR 16"),
    ("SFDEF", ""),
    ("PSET OTEMP -1", ""),
    ("SM 2000", "ERR 8192"),
];

/// Lines that run until further input; that input; and the answer.
const OPEN_ENDED: &[(&str, &[u8], &str)] = &[
    ("LOOP", b"\x03", "*"),
    ("13LOOP", b"a\x03", "**"),
    ("X5LOOP", b"x", "*\nERR 2048"),
    ("WAIT 60000", b"\x03", "ERR 16384"),
];

#[test]
fn movement_commands_have_their_answers() {
    assert_answers(&mut Session::new(), MOVEMENT);
}

#[test]
fn open_ended_commands_have_their_answers() {
    let mut session = Session::new();
    session.run("HI");
    for (line, input, answer) in OPEN_ENDED {
        assert_eq!(session.run_with_input(line, input), *answer, "{line}");
    }
}

fn exchanges() -> Vec<Exchange> {
    let going_on: Vec<Exchange> = OPEN_ENDED.iter().map(|(line, _, answer)| (*line, *answer)).collect();
    let whole = [
        MOVEMENT,
        settings::COMMANDS,
        sequences::COMMANDS,
        administration::COMMANDS,
        walk_through_grammar::LINES,
    ];
    let broken = [settings::WORN, ends::LOW_BUS];
    [whole.concat(), broken.concat(), going_on].concat()
}

#[test]
fn every_command_is_tested() {
    let exchanges = exchanges();
    let used: Vec<_> = exchanges
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

#[test]
fn every_word_of_the_walk_through_is_tested() {
    let words = ["WAKE", "SAVE", "S", "G", "M", "AP", "STATUS", "REPLY"];
    let uses = |(line, answer): &Exchange, word: &str| {
        matches!(grammar::parse(line), Ok(Statement::Lower(_)))
            && line.split_ascii_whitespace().any(|found| found == word)
            && !answer.contains("ERR")
    };
    for word in words {
        assert!(
            walk_through_grammar::LINES.iter().any(|exchange| uses(exchange, word)),
            "no test uses {word}"
        );
    }
}

/// Manual, table 4.
#[test]
fn every_status_code_is_tested() {
    let status_in = |answer: &str| {
        let codes = answer.lines().filter_map(|line| line.strip_prefix("ERR ")?.parse().ok());
        codes.fold(status::Status::OK, |sum, code| sum | status::Status::of(code))
    };
    let all = exchanges().iter().fold(status::Status::OK, |sum, (_, answer)| sum | status_in(answer));
    for row in status::ROWS {
        assert!(all.has(row.status), "no test expects ERR {}", row.status.code());
    }
}

#[test]
fn every_parameter_is_tested() {
    let motor = settings::SET.iter().map(|row| row.0).chain(settings::READ_ONLY.iter().map(|row| row.0));
    let motor: Vec<_> = motor.collect();
    assert!(MOTOR.iter().all(|row| motor.contains(&row.name)), "{motor:?}");
    let hand =
        settings::SET_HAND.iter().map(|row| row.0).chain(settings::READ_ONLY_HAND.iter().map(|row| row.0));
    // SN can be set once: settings.rs has its own test.
    let hand: Vec<_> = hand.chain(["SN"]).collect();
    assert!(HAND.iter().all(|row| hand.contains(&row.name)), "{hand:?}");
}
