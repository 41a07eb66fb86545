//! `watch`: properties of boards, read again and again.

use std::fmt::Write;
use std::io::{self, IsTerminal};
use std::time::Duration;

use wraptor::{Deadline, Hand, Property};

use crate::output::print;
use crate::trouble::Trouble;
use programs::interrupt;

/// Time between two readings.
const INTERVAL: Duration = Duration::from_millis(200);

/// Longest time of a reading.
const LIMIT: Duration = Duration::from_secs(5);

/// Shows properties until ^C or for a time; without one, once unless a person watches. On a terminal each table replaces the last.
///
/// # Errors
/// A board does not answer, the connection is lost.
pub fn watch(
    hand: &mut Hand,
    nodes: &str,
    properties: &[Property],
    time: Option<Duration>,
    is_typed: bool,
) -> Result<(), Trouble> {
    let end = Deadline::after(time.unwrap_or_default());
    let replaces = io::stdout().is_terminal();
    let mut first = true;
    loop {
        let table = table(hand, nodes, properties)?;
        let up = if replaces && !first { format!("\x1b[{}A", table.lines().count()) } else { String::new() };
        first = false;
        print(&format!("{up}{table}"))?;
        // Without a time a person watches until ^C, and a script sees one table.
        let is_over = end.is_over() && (time.is_some() || !is_typed);
        if is_over || interrupt::interrupted() {
            return Ok(());
        }
        // Reports that arrive meanwhile are kept.
        hand.receive(INTERVAL)?;
    }
}

fn table(hand: &mut Hand, nodes: &str, properties: &[Property]) -> Result<String, Trouble> {
    let mut table = format!("{:<9}", "node");
    nodes.chars().for_each(|node| _ = write!(table, "{node:>8}"));
    table.push('\n');
    for &property in properties {
        let row = property.row();
        let _ = write!(table, "{:<9}", row.name);
        for (_, value) in hand.get(nodes, property, LIMIT)? {
            let _ = write!(table, "{value:>8}");
        }
        let _ = writeln!(table, "  {}", row.unit);
    }
    Ok(table)
}
