//! The page of properties, commands and faults, made of the tables that the boards obey.

use std::fs;

use tater_wire::property::{Access, Default, PropertySpec, Stored};
use tater_wire::{command, fault, property};

use crate::program::root;
use crate::{Outcome, files};

const PAGE: &str = "docs/properties.md";

/// Writes the page, or compares it.
///
/// # Errors
/// The page cannot be written, or is not what the tables say.
pub fn table(check: bool) -> Outcome {
    let (path, text) = (root().join(PAGE), page());
    if !check {
        return files::replace(&path, text.as_bytes());
    }
    let found = fs::read_to_string(&path).map_err(|error| stale(&format!("cannot be read: {error}")))?;
    match difference(&found, &text) {
        None => Ok(()),
        Some(what) => Err(stale(&what)),
    }
}

fn stale(what: &str) -> String {
    format!("{PAGE}: {what}\n  run `cargo xtask table`, and commit the page")
}

/// The first line that differs.
fn difference(found: &str, expected: &str) -> Option<String> {
    if found == expected {
        return None;
    }
    let (mut lines, mut wanted) = (found.lines(), expected.lines());
    for number in 1.. {
        match (lines.next(), wanted.next()) {
            (None, None) => break,
            (line, want) if line != want => {
                let shown = |line: Option<&str>| line.map_or("the end".into(), |line| format!("`{line}`"));
                return Some(format!("line {number}: found {}, expected {}", shown(line), shown(want)));
            }
            _ => {}
        }
    }
    Some("the line ends differ".into())
}

fn page() -> String {
    let mut page = String::from(
        "<!-- Made by `cargo xtask table` of the tables in tater-wire: change those, not this page. -->\n\n\
         # Properties, commands and faults of a Tater\n\n\
         ## Properties\n\n\
         Access: R GET, W SET, L SET once after LOCK's sequence. Stored: S by SAVE, A by itself. Bits: width of a \
         reply. Three\ndefaults are those of links (nodes 1 to 3), spread (4) and tips (5 to 7). 1/1024 peak is a \
         torque of 65 N·cm / 1024; a\ncount is a hall count, 18 a motor revolution.\n\n",
    );
    page += &rows(
        &["Id", "Name", "Bits", "Access", "Stored", "Unit", "Range", "Default", "Meaning"],
        property::ROWS.iter().map(property_row),
    );
    page += "\n## Commands\n\nValues of CMD.\n\n";
    page += &rows(
        &["CMD", "Name", "Meaning"],
        command::ROWS.iter().map(|row| [row.number.to_string(), row.name.into(), row.meaning.into()]),
    );
    page += "\n## Faults\n\nValues of ERROR.\n\n";
    page += &rows(
        &["ERROR", "Name", "Property", "Cause", "Next step"],
        fault::ROWS.iter().map(|row| {
            let property = row.property.map_or("", |property| property.row().name);
            let texts = [row.name, property, row.cause, row.next].map(String::from);
            let [name, property, cause, next] = texts;
            [row.code.code().to_string(), name, property, cause, next]
        }),
    );
    page
}

fn property_row(row: &PropertySpec) -> [String; 9] {
    let access = match row.access {
        Access::ReadOnly => "R",
        Access::ReadWrite => "RW",
        Access::WriteOnly => "W",
        Access::Locked => "RL",
    };
    let stored = match row.stored {
        Stored::No => "",
        Stored::Yes => "S",
        Stored::Always => "A",
    };
    let default = match row.default {
        Default::None => String::new(),
        Default::Same(value) => value.to_string(),
        Default::Kinds(link, spread, tip) => format!("{link}, {spread}, {tip}"),
        Default::Node => "the node".into(),
        Default::Slot => "the node's slot".into(),
    };
    [
        row.property.id().to_string(),
        row.name.into(),
        row.bits.to_string(),
        access.into(),
        stored.into(),
        row.unit.into(),
        format!("{} to {}", row.min, row.max),
        default,
        row.meaning.into(),
    ]
}

/// A Markdown table.
fn rows<const N: usize>(head: &[&str; N], rows: impl Iterator<Item = [String; N]>) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut text = line(&head.map(String::from)) + &line(&head.map(|_| "---".into()));
    for row in rows {
        // A bar in a cell would end it.
        text += &line(&row.map(|cell| cell.replace('|', "\\|")));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_on_the_page_and_every_table_is_a_table() {
        let page = page();
        for row in property::ROWS {
            assert!(page.contains(&format!("\n| {} | {} | ", row.property.id(), row.name)), "{}", row.name);
        }
        for row in command::ROWS {
            assert!(page.contains(&format!("\n| {} | {} | {} |\n", row.number, row.name, row.meaning)));
        }
        for row in fault::ROWS {
            assert!(page.contains(&format!("\n| {} | {} | ", row.code.code(), row.name)), "{}", row.name);
        }
        // Bars that are not escaped: cells + 1 in each line of a table.
        let bars = |line: &str| line.replace("\\|", "").matches('|').count();
        let mut tables = 0;
        for pair in page.lines().collect::<Vec<_>>().windows(2) {
            match (pair[0].starts_with('|'), pair[1].starts_with('|')) {
                (true, true) => assert_eq!(bars(pair[0]), bars(pair[1]), "{}", pair[1]),
                (false, true) => tables += 1,
                _ => {}
            }
        }
        assert_eq!(tables, 3);
    }

    #[test]
    fn a_page_that_differs_is_noticed_in_its_line() {
        assert_eq!(difference("a\nb\n", "a\nb\n"), None);
        let said = |found, expected| difference(found, expected).unwrap_or_default();
        assert_eq!(said("a\nb\n", "a\nc\n"), "line 2: found `b`, expected `c`");
        assert_eq!(said("a\n", "a\nc\n"), "line 2: found the end, expected `c`");
        assert_eq!(said("a\nc\nd\n", "a\nc\n"), "line 3: found `d`, expected the end");
        assert_eq!(said("a\r\n", "a\n"), "the line ends differ");
    }
}
