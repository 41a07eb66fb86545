//! `cargo xtask defects`: plants one defect at a time in a copy of the project and plays the torture chamber, which must find it by
//! the invariant that the list names. So each invariant is seen to fail (docs/defects.md).
//!
//! The same seed is played without the defect as well: what fails there too shows nothing.

mod list;
mod tree;
mod trial;

use std::io::IsTerminal;
use std::path::Path;
use std::time::Duration;

use crate::program::{root, target};
use crate::{Failure, files, outcome::say};
use list::{Defect, Plant};
use tree::Tree;
use trial::{Found, Trial};

/// On a quiet core a defect that nothing finds takes a minute.
const SEEDS: u32 = 300;

/// Time for one seed on a busy core, on average: 0.2 s on a quiet one, and four times as long where boards do not answer.
const SEED: Duration = Duration::from_secs(2);

/// Arguments of `defects`.
#[derive(clap::Args)]
pub struct DefectsArgs {
    /// Defects or invariants; all defects without one
    #[arg(value_name = "NAME")]
    names: Vec<String>,
    /// Seeds for each defect, from 0 on
    #[arg(long, value_name = "N", default_value_t = SEEDS)]
    seeds: u32,
}

/// Plants the defects and prints a row of a table for each.
///
/// # Errors
/// A defect is not caught by its invariant, one that is listed as missed is, or the build fails.
pub fn defects(args: &DefectsArgs) -> Result<(), Failure> {
    let all = list::read(&root().join(list::LIST)).map_err(Failure::Unusable)?;
    let chosen = list::choose(&all, &args.names).map_err(Failure::Unusable)?;
    let folder = target().join("defects");
    let tree = Tree::copy(&folder)?;
    let unchanged = folder.join("unchanged");
    tree.build()?;
    std::fs::copy(tree.simulator(), &unchanged).map_err(|error| files::unreadable(&unchanged, &error))?;
    files::print(
        "| defect | expected | caught by | seeds | simulated s | s | before it |\n|---|---|---|---|---|---|---|\n",
    )?;
    let mut failures = Vec::new();
    for (at, defect) in chosen.iter().enumerate() {
        progress(&format!("[{}/{}] {}", at + 1, chosen.len(), defect.name));
        let expected = defect.invariants.join(", ");
        let edits = match &defect.plant {
            Plant::Texts(edits) => edits,
            Plant::Elsewhere(tests) => {
                files::print(&format!("| {} | {expected} | elsewhere: {tests} | | | | |\n", defect.name))?;
                continue;
            }
        };
        let found = tree.with(edits, || try_one(defect, args.seeds, &tree, &folder, &unchanged));
        let judged = found.and_then(|found| {
            files::print(&format!("| {} | {expected} | {} |\n", defect.name, found.cells()))?;
            judge(defect, &found, args.seeds)
        });
        failures.extend(judged.err().map(|error| format!("{}: {error}", defect.name)));
    }
    if failures.is_empty() { Ok(()) } else { Err(Failure::Judged(failures.join("\n"))) }
}

fn try_one(
    defect: &Defect,
    seeds: u32,
    tree: &Tree,
    folder: &Path,
    unchanged: &Path,
) -> Result<Found, String> {
    tree.build()?;
    let trial = Trial { simulator: &tree.simulator(), results: &folder.join(&defect.name), seeds };
    let found = trial.run(&defect.invariants, SEED * seeds.max(30))?;
    match found.seed() {
        Some(seed) if !trial::holds(unchanged, seed)? => Err(format!(
            "seed {seed} fails without the defect as well\n  next: mend that first: {} torture --seed {seed}",
            unchanged.display()
        )),
        _ => Ok(found),
    }
}

fn judge(defect: &Defect, found: &Found, seeds: u32) -> Result<(), String> {
    match (found.seed(), &defect.missed) {
        (Some(_), None) | (None, Some(_)) => Ok(()),
        (Some(seed), Some(_)) => Err(format!(
            "caught at seed {seed}, but listed as missed\n  next: delete \"missed\" in {}",
            list::LIST
        )),
        (None, None) => Err(format!(
            "not caught by {} with {seeds} seeds{}\n  next: more --seeds, a stronger check, or programs and faults that the defect \
             needs; a defect that no user could notice is a bad one. State a hole as \"missed\" in {}",
            defect.invariants.join(" or "),
            found.why(),
            list::LIST
        )),
    }
}

/// A line for a person who watches.
fn progress(text: &str) {
    if std::io::stderr().is_terminal() {
        say(text);
    }
}
