//! Help, status codes, version (manual 5.2.5, 5.2.6).

use crate::command::{self, Category, GclCommand, ROWS};
use crate::god::{God, Text, VERSION};
use crate::grammar::{Arguments, lower};
use crate::motors::Motors;
use crate::status::{self, Status};
use crate::words::{append, words};
use tater_wire::Property;

const CATEGORIES: [(Category, &str); 6] = [
    (Category::Movement, "Movement"),
    (Category::MotorParameters, "Motor parameters"),
    (Category::GlobalParameters, "Parameters of the hand"),
    (Category::Sequences, "Macros and sequences"),
    (Category::Administration, "Administration"),
    (Category::Advanced, "Advanced"),
];

/// Runs a command of this category but RESET.
pub(crate) async fn execute(god: &God<'_>, command: GclCommand, mut arguments: Arguments<'_>) -> Status {
    if command == GclCommand::Err {
        return match arguments.only_number() {
            Ok(number) => errors(god, number).await,
            Err(status) => status,
        };
    }
    let about = if command == GclCommand::Help { arguments.next() } else { None };
    if let Err(status) = arguments.none() {
        return status;
    }
    match (command, about) {
        (GclCommand::Help, Some(name)) => help(god, name).await,
        (GclCommand::Help, None) => list(god, false).await,
        (GclCommand::HelpAll, _) => list(god, true).await,
        (GclCommand::Vers, _) => {
            god.print_line(words![VERSION]).await;
            Status::OK
        }
        _ => Status::UNKNOWN_COMMAND,
    }
}

async fn list(god: &God<'_>, advanced: bool) -> Status {
    for (category, title) in CATEGORIES {
        if category == Category::Advanced && !advanced {
            continue;
        }
        let mut names = Text::new();
        for row in ROWS.iter().filter(|row| row.category == category) {
            // The longest list fits: see the test.
            append(&mut names, words![" ", row.name]);
        }
        god.print_line(words![title, ":", names.as_str()]).await;
    }
    Status::OK
}

async fn help(god: &God<'_>, name: &str) -> Status {
    if let Some(row) = lower::ROWS.iter().find(|row| row.name == name) {
        god.print_line(words![row.line, ": ", row.help]).await;
        return Status::OK;
    }
    let Some(row) = command::find(name).and_then(GclCommand::row) else { return Status::UNKNOWN_COMMAND };
    let space = if row.arguments.is_empty() { "" } else { " " };
    god.print_line(words![row.name, space, row.arguments, ": ", row.help]).await;
    Status::OK
}

/// Prints the codes that a number is the sum of; without a number, all of them.
async fn errors(god: &God<'_>, number: Option<i64>) -> Status {
    let Ok(sum) = u16::try_from(number.unwrap_or(0)) else { return Status::INVALID_VALUE };
    if number == Some(0) {
        god.print_line(words!["0 all went well"]).await;
    }
    for bit in 0..u16::BITS {
        let code = Status::of(1 << bit);
        let row = status::ROWS.iter().find(|row| row.status == code);
        match row {
            Some(row) if number.is_none() || Status::of(sum).has(code) => {
                god.print_line(words![code.code(), " ", row.meaning]).await;
                if number.is_some() && code == Status::NO_BOARD {
                    name_boards(god).await;
                }
            }
            None if number.is_some() && Status::of(sum).has(code) => {
                god.print_line(words![code.code(), " (not used)"]).await;
            }
            _ => {}
        }
    }
    Status::OK
}

/// Prints the motors that are ERR 1 now: whose board does not answer, and whose number two boards have.
async fn name_boards(god: &God<'_>) {
    let answering = god.boards.get(Motors::ALL, Property::STAT).await.motors();
    for motor in Motors::ALL.difference(answering).iter() {
        god.print_line(words!["motor ", motor.number(), ": no answer. Check its power and its CAN cable"])
            .await;
    }
    let (first, second) = god.boards.find_doubled(answering).await;
    for motor in second.motors().iter() {
        let [one, other] = [first, second].map(|numbers| numbers.get(motor).unwrap_or(0));
        let (low, high) = (one.min(other), one.max(other));
        god.print_line(words!["motor ", motor.number(), ": two boards, SN ", low, " and SN ", high]).await;
        god.print_line(words![WAY_OUT]).await;
    }
}

/// The next step of two boards with one number (docs/hand.md).
const WAY_OUT: &str =
    "  Unplug one, or give both the number of their straps: docs/hand.md, Two boards with one number";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io;

    #[test]
    fn longest_lines_fit_an_output_text() {
        for (category, title) in CATEGORIES {
            let rows = ROWS.iter().filter(|row| row.category == category);
            let len = rows.map(|row| row.name.len() + 1).sum::<usize>() + title.len() + 1;
            assert!((20..=io::TEXT - 3).contains(&len), "{title}: {len}");
        }
        for row in ROWS {
            let len = row.name.len() + row.arguments.len() + row.help.len() + 3;
            assert!(len <= io::TEXT - 3, "{}: {len}", row.name);
        }
        assert!(WAY_OUT.len() <= io::TEXT - 3);
        for row in lower::ROWS {
            assert!(row.line.len() + row.help.len() + 2 <= io::TEXT - 3, "{}", row.name);
        }
    }
}
