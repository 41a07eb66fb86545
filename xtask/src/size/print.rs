//! The figures as a report for a terminal.

use std::fmt::Write;

use tater_f103::map::STACK;

use super::figures::MOST_OF_A_POLL;
use super::stack::Worst;
use super::{Figures, LIMITS};
use crate::image::Profile;

pub fn page(profile: Profile, all: &[Figures]) -> String {
    let mut page = format!("profile {}; limits are those of production\n", profile.name());
    for figures in all {
        // Writing to a string cannot fail.
        let _ = program(&mut page, figures);
    }
    page
}

fn program(page: &mut String, figures: &Figures) -> std::fmt::Result {
    let limits = LIMITS.iter().find(|limits| limits.program == figures.name);
    let (flash, ram) = limits.map_or((0, 0), |limits| (limits.flash, limits.ram));
    writeln!(page, "{}", figures.name)?;
    writeln!(page, "  flash      {:>6} of {flash} bytes", figures.flash)?;
    writeln!(page, "  static RAM {:>6} of {ram} bytes", figures.ram)?;
    writeln!(page, "  by section")?;
    for (name, bytes, in_flash, in_ram) in &figures.sections {
        let place = match (in_flash, in_ram) {
            (true, true) => "flash, RAM",
            (true, false) => "flash",
            _ => "RAM",
        };
        writeln!(page, "    {bytes:>6}  {name} ({place})")?;
    }
    for (place, crates) in [("flash", &figures.flash_by_crate), ("RAM", &figures.ram_by_crate)] {
        writeln!(page, "  {place} by crate (inlined code where it was inlined)")?;
        let mut crates: Vec<_> = crates.iter().collect();
        crates.sort_by_key(|&(_, bytes)| std::cmp::Reverse(bytes));
        for (name, bytes) in crates {
            writeln!(page, "    {bytes:>6}  {name}")?;
        }
    }
    writeln!(page, "  largest")?;
    for (name, bytes) in &figures.largest {
        writeln!(page, "    {bytes:>6}  {name}")?;
    }
    writeln!(page, "  must not be there: {}", figures.forbidden.len())?;
    for found in &figures.forbidden {
        writeln!(page, "    {} ({}), by {}", found.name, found.family, found.chain.join(" > "))?;
    }
    match &figures.stack {
        Ok(worst) => {
            if let Some(poll) = figures.poll() {
                writeln!(
                    page,
                    "  a poll takes {poll} of {MOST_OF_A_POLL} bytes of stack at worst, beside GOD's state"
                )?;
            }
            stack(page, worst)
        }
        Err(error) => writeln!(page, "  stack unknown: {error}"),
    }
}

fn stack(page: &mut String, worst: &Worst) -> std::fmt::Result {
    writeln!(
        page,
        "  stack      {:>6} of {} bytes at worst, {} free ({:.1} %)",
        worst.bytes(),
        STACK.len,
        worst.margin(),
        worst.margin_percent()
    )?;
    for level in &worst.levels {
        writeln!(
            page,
            "    {:>6}  {}, of which {} pushed by the processor",
            level.bytes(),
            level.name,
            level.pushed
        )?;
        path(page, &level.deepest)?;
    }
    writeln!(page, "    {:>6}  start, where no interrupt comes in", worst.start.bytes)?;
    path(page, &worst.start)?;
    writeln!(page, "    called by register: {}", listed(&worst.by_register))?;
    writeln!(page, "    reached by nothing: {}", listed(&worst.unreached))
}

fn path(page: &mut String, deepest: &super::stack::Deepest) -> std::fmt::Result {
    for frame in &deepest.path {
        writeln!(page, "            {:>6}  {}", frame.bytes, frame.function)?;
    }
    Ok(())
}

fn listed(names: &[String]) -> String {
    if names.is_empty() { "none".into() } else { names.join(", ") }
}
