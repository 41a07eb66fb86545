//! Help, errors, version (manual 5.2.5, 5.2.6).

use core::fmt::Write;

use tater_wire::Property;

use crate::command::{self, Category, Command, ROWS};
use crate::god::{God, Text, VERSION};
use crate::motors::Motors;
use crate::status::{self, Status};
use crate::words::Arguments;

/// The categories of commands in the manual's order.
const CATEGORIES: [(Category, &str); 6] = [
    (Category::Movement, "Movement"),
    (Category::MotorParameters, "Motor parameters"),
    (Category::GlobalParameters, "Parameters of the hand"),
    (Category::Sequences, "Macros and sequences"),
    (Category::Administration, "Administration"),
    (Category::Advanced, "Advanced"),
];

/// Does it.
pub(crate) async fn execute(god: &God<'_>, command: Command, mut arguments: Arguments<'_>) -> Status {
    if command == Command::Err {
        return match arguments.only_number() {
            Ok(number) => errors(god, number).await,
            Err(status) => status,
        };
    }
    let about = if command == Command::Help { arguments.next() } else { None };
    if let Err(status) = arguments.none() {
        return status;
    }
    match (command, about) {
        (Command::Help, Some(name)) => help(god, name).await,
        (Command::Help, None) => list(god, false).await,
        (Command::HelpAll, _) => list(god, true).await,
        (Command::Vers, _) => {
            god.answer(format_args!("{VERSION}")).await;
            Status::OK
        }
        (Command::Reset, _) => {
            // As after power-on, the boards wait in their monitors.
            god.boards.set(Motors::ALL, Property::STAT, 0).await;
            god.is_over.set(true);
            Status::OK
        }
        _ => Status::UNKNOWN_COMMAND,
    }
}

/// The names of commands, a line a category.
async fn list(god: &God<'_>, advanced: bool) -> Status {
    for (category, title) in CATEGORIES {
        if category == Category::Advanced && !advanced {
            continue;
        }
        let mut names = Text::new();
        for row in ROWS.iter().filter(|row| row.category == category) {
            // The longest list fits: see the test.
            let _ = write!(names, " {}", row.name);
        }
        god.answer(format_args!("{title}:{names}")).await;
    }
    Status::OK
}

/// A command's name, its arguments, and what it does.
async fn help(god: &God<'_>, name: &str) -> Status {
    let Some(row) = command::named(name).and_then(Command::row) else { return Status::UNKNOWN_COMMAND };
    let space = if row.arguments.is_empty() { "" } else { " " };
    god.answer(format_args!("{}{space}{}: {}", row.name, row.arguments, row.help)).await;
    Status::OK
}

/// The codes that a number is the sum of; without a number, all there are.
async fn errors(god: &God<'_>, number: Option<i64>) -> Status {
    let Ok(sum) = u16::try_from(number.unwrap_or(0)) else { return Status::INVALID_VALUE };
    if number == Some(0) {
        god.answer(format_args!("0 all went well")).await;
    }
    for bit in 0..u16::BITS {
        let code = Status::of(1 << bit);
        let row = status::ROWS.iter().find(|row| row.status == code);
        match row {
            Some(row) if number.is_none() || Status::of(sum).has(code) => {
                god.answer(format_args!("{} {}", code.code(), row.meaning)).await;
            }
            None if number.is_some() && Status::of(sum).has(code) => {
                god.answer(format_args!("{} (not used)", code.code())).await;
            }
            _ => {}
        }
    }
    Status::OK
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io;

    #[test]
    fn the_longest_lines_fit() {
        for (category, title) in CATEGORIES {
            let rows = ROWS.iter().filter(|row| row.category == category);
            let len = rows.map(|row| row.name.len() + 1).sum::<usize>() + title.len() + 1;
            assert!((20..=io::TEXT - 3).contains(&len), "{title}: {len}");
        }
        for row in ROWS {
            let len = row.name.len() + row.arguments.len() + row.help.len() + 3;
            assert!(len <= io::TEXT - 3, "{}: {len}", row.name);
        }
    }
}
