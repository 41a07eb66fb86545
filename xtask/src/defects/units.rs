//! Which defects the unit tests of the firmware find.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::board::{Board, progress};
use super::list::{Defect, Edit, Plant};
use super::switch::VARIABLE;
use super::tree::{self, TESTED, Tests, Tree};
use super::trial;
use crate::program::in_parallel;

/// So many times the tests' own time is no end.
const PATIENCE: u32 = 20;

/// Runs the unit tests with each defect of the firmware planted; returns what went wrong.
///
/// # Errors
/// The build's, or a test that fails without a defect.
pub fn test(all: &[Defect], chosen: &[&Defect], folder: &Path, board: &Board) -> Result<Vec<String>, String> {
    let ours: Vec<Defect> = all.iter().filter(|defect| is_of_firmware(defect)).cloned().collect();
    progress("builds the unit tests with all defects");
    let (tests, plan) = tree::switched(&ours, folder, |tree| tree.tests(&TESTED))?;
    let begun = Instant::now();
    for one in &tests {
        if !passes(one, "", Duration::from_secs(3600))? {
            return Err(format!(
                "the tests of {} fail without a defect\n  next: mend that first",
                one.package
            ));
        }
    }
    let deadline = begun.elapsed().max(Duration::from_secs(1)) * PATIENCE;
    let chosen: Vec<&Defect> = chosen.iter().copied().filter(|defect| is_of_firmware(defect)).collect();
    let (alone, together): (Vec<&Defect>, Vec<&Defect>) =
        chosen.into_iter().partition(|defect| plan.alone.contains_key(&defect.name));
    let try_one = |defect: &Defect, tests: &[Tests]| {
        let found = find(defect, tests, deadline)?;
        progress(&format!("{}: {}", defect.name, found.as_deref().unwrap_or("nothing")));
        board.record(defect, |row| row.unit_tested(found.is_some()))
    };
    let mut failures = in_parallel(&together, |defect| try_one(defect, &tests));
    for defect in alone {
        let built = tree::edited(edits(defect))
            .and_then(|texts| Tree::copy(folder, "tree-single", &texts))
            .and_then(|tree| tree.tests(&TESTED));
        failures.extend(built.and_then(|tests| try_one(defect, &tests)).err());
    }
    Ok(failures)
}

fn edits(defect: &Defect) -> &[Edit] {
    match &defect.plant {
        Plant::Texts(edits) => edits,
        Plant::Elsewhere(_) => &[],
    }
}

fn package(edit: &Edit) -> &str {
    edit.file.split('/').next().unwrap_or_default()
}

fn is_of_firmware(defect: &Defect) -> bool {
    !edits(defect).is_empty() && edits(defect).iter().all(|edit| TESTED.contains(&package(edit)))
}

/// The first crate whose tests fail with the defect; its own comes first.
fn find(defect: &Defect, tests: &[Tests], deadline: Duration) -> Result<Option<String>, String> {
    let is_own = |one: &&Tests| edits(defect).iter().any(|edit| package(edit) == one.package);
    let (own, others): (Vec<&Tests>, Vec<&Tests>) = tests.iter().partition(is_own);
    for one in own.into_iter().chain(others) {
        if !passes(one, &defect.name, deadline)? {
            return Ok(Some(one.package.clone()));
        }
    }
    Ok(None)
}

/// Whether tests pass and have an end.
fn passes(tests: &Tests, defect: &str, deadline: Duration) -> Result<bool, String> {
    let mut command = Command::new(&tests.program);
    command.current_dir(&tests.folder);
    // One thread: two defects are tested at a time.
    command.args(["-q", "--test-threads", "1"]).env(VARIABLE, defect).env("RUST_BACKTRACE", "0");
    // The same random inputs for each defect; which failing input is the smallest does not matter.
    command.envs([("PROPTEST_RNG_SEED", "1"), ("PROPTEST_MAX_SHRINK_ITERS", "0")]);
    command.env("PROPTEST_DISABLE_FAILURE_PERSISTENCE", "true");
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let ended = trial::ended(&mut command, deadline);
    ended
        .map(|end| end.is_some_and(|status| status.success()))
        .map_err(|error| format!("{}: {error}", tests.program.display()))
}
