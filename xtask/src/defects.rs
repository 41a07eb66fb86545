//! `cargo xtask defects`: plants defects in a copy of the project and plays the torture chamber, which must find each by an invariant that the list
//! names. So each invariant is seen to fail (docs/defects.md).
//!
//! One build has all defects, of which a variable of the environment chooses one. Those that this cannot express, as another constant, get a build
//! of their own. A seed that finds a defect is played without it as well: what fails there too shows nothing.

mod board;
mod draw;
mod functions;
mod list;
mod page;
mod switch;
mod tree;
mod trial;
mod units;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::program::{in_parallel, root, target};
use crate::{Failure, files};
use board::{Board, progress};
use list::{Defect, Plant};
use programs::output::warn;
use tree::Tree;
use trial::{Found, PER_LONG, Simulator, Trial};

const SEEDS: u64 = 1000;

/// Seeds that the build with switches and the unchanged one must play alike.
const ALIKE: [u64; 8] = [0, 1, 2, 3, 4, 5, 6, 7];

/// Arguments of `defects`.
#[derive(clap::Args)]
pub struct DefectsArgs {
    /// Defects or invariants; all defects without one
    #[arg(value_name = "NAME")]
    names: Vec<String>,
    /// Most seeds for each defect, from 0 on, of the long ones a fiftieth; with 0 only the tables are made again, after a change of the list
    #[arg(long, value_name = "N", default_value_t = SEEDS)]
    seeds: u64,
    /// Run the unit tests of the firmware instead of torture
    #[arg(long, conflicts_with = "seeds")]
    unit_tests: bool,
    /// Write the results into docs/defects.md, each as soon as it is known
    #[arg(long)]
    write: bool,
    /// Print one JSON object instead of the page's tables
    #[arg(long)]
    json: bool,
    /// Play nothing: print the entries of the list that this seed draws
    #[arg(long, value_name = "SEED", conflicts_with_all = ["names", "seeds", "unit_tests", "write", "json"])]
    draw: Option<u64>,
}

/// Plants the defects and prints the tables of the page.
///
/// # Errors
/// A defect is not caught by its invariant, one that is listed as missed is, or the build fails.
pub fn defects(args: &DefectsArgs) -> Result<(), Failure> {
    let all = list::read(&root().join(list::LIST)).map_err(Failure::Unusable)?;
    let folder = target().join("defects");
    if let Some(seed) = args.draw {
        return Ok(files::print(&(draw::draw(seed, &all, &folder)? + "\n"))?);
    }
    let chosen = list::choose(&all, &args.names).map_err(Failure::Unusable)?;
    let planted: Vec<&Defect> = chosen.iter().copied().filter(|defect| defect.is_planted()).collect();
    let page = std::fs::read_to_string(root().join(page::PAGE)).map_err(|error| error.to_string())?;
    let board = Board::new(&all, page, args.write);
    let mut failures = if args.unit_tests {
        units::test(&all, &planted, &folder, &board)?
    } else if args.seeds == 0 {
        Vec::new()
    } else {
        torture(&all, &planted, &folder, args.seeds, &board)?
    };
    let rows = board.finish()?;
    if args.json {
        files::print(&format!("{}\n", page::json(&chosen, &rows)))?;
    } else {
        files::print(&page::made(&chosen, &rows))?;
    }
    failures.sort();
    if failures.is_empty() { Ok(()) } else { Err(Failure::Judged(failures.join("\n"))) }
}

fn torture(
    all: &[Defect],
    chosen: &[&Defect],
    folder: &Path,
    seeds: u64,
    board: &Board,
) -> Result<Vec<String>, String> {
    let [unchanged, switching, single] =
        ["unchanged", "switched", "single"].map(|name| folder.join(format!("hil-sim-{name}")));
    progress("builds the unchanged simulator");
    Tree::copy(folder, "tree", &BTreeMap::new())?.simulator(&unchanged)?;
    progress("builds the simulator with all defects");
    let ((), plan) = tree::switched(all, folder, |tree| tree.simulator(&switching))?;
    are_alike(&unchanged, &switching, folder)?;
    let every = Simulator { path: &unchanged, planted: None }.invariants()?;
    let (alone, together): (Vec<&Defect>, Vec<&Defect>) =
        chosen.iter().copied().partition(|defect| plan.alone.contains_key(&defect.name));
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let search = |defect: &Defect, path: &PathBuf, planted: Option<&str>, jobs: usize| {
        let or_endless = defect.missed.is_some() || defect.invariants == [list::ANY];
        let until = if or_endless { &every } else { &defect.invariants };
        let results = folder.join(&defect.name);
        let simulator = Simulator { path, planted };
        let is_long = defect.is_long;
        let seeds = if is_long { seeds.div_ceil(PER_LONG) } else { seeds };
        let trial = Trial {
            simulator,
            unchanged: &unchanged,
            results: &results,
            seeds,
            is_long,
            jobs,
            until,
            or_endless,
        };
        let found = trial.run().map_err(|error| format!("{}: {error}", defect.name))?;
        let by = found.caught.as_ref().map(|(_, name)| name.as_str());
        let notes = Some(found.notes())
            .filter(|notes| !notes.is_empty())
            .map(|notes| format!("; before it: {notes}"));
        let notes = notes.unwrap_or_default();
        progress(&format!("{}: {} after {} seeds{notes}", defect.name, by.unwrap_or("nothing"), found.seeds));
        board.record(defect, |row| row.tortured(by, found.seeds, is_long, found.simulated_s))?;
        judge(defect, &found, seeds).map_err(|error| format!("{}: {error}", defect.name))
    };
    // One core each: so the seeds before a find are the same on every machine.
    let jobs = (cores / together.len().max(1)).max(1);
    let mut failures = in_parallel(&together, |defect| search(defect, &switching, Some(&defect.name), jobs));
    for defect in alone {
        let why = plan.alone.get(&defect.name).copied().unwrap_or_default();
        warn(&format!("{}: {why}, so it gets a build of its own", defect.name));
        let Plant::Texts(edits) = &defect.plant else { continue };
        let built = tree::edited(edits)
            .and_then(|texts| Tree::copy(folder, "tree-single", &texts))
            .and_then(|tree| tree.simulator(&single))
            .map_err(|error| format!("{}: {error}", defect.name));
        failures.extend(built.and_then(|()| search(defect, &single, None, cores)).err());
    }
    Ok(failures)
}

/// Checks that a build with switches does without a defect what the unchanged one does, to the last event.
fn are_alike(unchanged: &Path, switched: &Path, folder: &Path) -> Result<(), String> {
    let report = |path: &Path, seed: u64| {
        let file = folder.join(format!("alike-{seed}.txt"));
        Simulator { path, planted: None }.report(seed, &file)
    };
    let differ = in_parallel(&ALIKE, |&seed| {
        let (one, other) = (report(unchanged, seed)?, report(switched, seed)?);
        match crate::table::difference(&other, &one) {
            None => Ok(()),
            Some(what) => {
                Err(format!("seed {seed} differs in the build with switches, without a defect: {what}"))
            }
        }
    });
    if differ.is_empty() { Ok(()) } else { Err(differ.join("\n")) }
}

fn judge(defect: &Defect, found: &Found, seeds: u64) -> Result<(), String> {
    match (&found.caught, &defect.missed) {
        (Some(_), None) | (None, Some(_)) => Ok(()),
        (Some((seed, name)), Some(_)) => Err(format!(
            "caught by {name} at seed {seed}, but listed as missed\n  next: delete \"missed\" in {}",
            list::LIST
        )),
        (None, None) => Err(format!(
            "not caught by {} with {seeds} seeds ({})\n  next: more --seeds, a stronger check, or programs and faults that the defect \
             needs; a defect that no user could notice is a bad one. State a hole as \"missed\" in {}",
            defect.invariants.join(" or "),
            found.notes(),
            list::LIST
        )),
    }
}
