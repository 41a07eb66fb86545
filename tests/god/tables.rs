//! Every command and every parameter has a row in the tables of the tests.

use god::command::{self, Command};
use god::parameter::{GLOBAL, MOTOR};
use god::words::{self, Words};

use super::{Session, administration, sequences, settings};

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
];

#[test]
fn movement() {
    exercise(&mut Session::new(), MOVEMENT);
}

#[test]
fn no_command_is_without_a_row() {
    let rows = [MOVEMENT, settings::COMMANDS, sequences::COMMANDS, administration::COMMANDS].concat();
    let used: Vec<_> = rows
        .iter()
        .filter_map(|(line, _)| match words::parse(line) {
            Ok(Words::Command { command, .. }) => Some(command),
            _ => None,
        })
        .collect();
    // What LOOP answers are no lines: realtime.rs.
    for row in command::ROWS.iter().filter(|row| row.command != Command::Loop) {
        assert!(used.contains(&row.command), "no test uses {}", row.name);
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
    assert!(GLOBAL.iter().all(|row| hand.contains(&row.name)), "{hand:?}");
}
