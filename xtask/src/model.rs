//! Generates the robot models of the hand, URDF and MJCF, from the figures of the crate kinematics, and compares them with independent loaders.

mod mjcf;
mod text;
mod urdf;

use std::fs;
use std::process::Command;

use kinematics::Hand;

use crate::program::{built, output, root, target};
use crate::table::difference;
use crate::{Outcome, files, python};

type Page = fn(&Hand) -> String;

const FILES: [(&str, Page); 2] = [
    ("kinematics/model/barrettwraptor.urdf", urdf::page),
    ("kinematics/model/barrettwraptor.xml", mjcf::page),
];

/// # Errors
/// A file cannot be written, or is not what the figures say.
pub fn model(check: bool) -> Outcome {
    let hand = Hand::default();
    for (name, page) in FILES {
        let (path, text) = (root().join(name), page(&hand));
        if !check {
            files::replace(&path, text.as_bytes())?;
            continue;
        }
        let found =
            fs::read_to_string(&path).map_err(|error| stale(name, &format!("cannot be read: {error}")))?;
        if let Some(what) = difference(&found, &text) {
            return Err(stale(name, &what));
        }
    }
    Ok(())
}

fn stale(name: &str, what: &str) -> String {
    format!("{name}: {what}\n  run `cargo xtask model`, and commit the file")
}

/// From PyPI. Pinned, so that a failure is this project's.
const PACKAGES: [&str; 2] = ["yourdfpy==0.0.60", MUJOCO];

/// The physics engine.
pub const MUJOCO: &str = "mujoco==4.0.0";

/// Poses that are compared, and the seed of their joints.
const POSES: [&str; 2] = ["10000", "1"];

/// Checks that the models are current, then that two loaders that know nothing of this project find the same fingertips.
/// The packages are large (130 MB of wheels), so a machine without a network skips the loaders.
///
/// # Errors
/// The failed check with a command to repeat it.
pub fn check() -> Outcome {
    model(true)?;
    let python = match python::environment("kinematics", &PACKAGES) {
        Ok(python) => python,
        Err(error) => {
            println!("skipped: no URDF loaders: {}", error.lines().next().unwrap_or_default());
            return Ok(());
        }
    };
    let mut poses = Command::new(built("examples/poses")?);
    poses.args(POSES).current_dir(root());
    let table = target().join("kinematics/poses.csv");
    files::replace(&table, output(poses)?.as_bytes())?;
    let mut compare = Command::new(&python);
    compare.arg("tests/host/kinematics.py").arg(&table).args(FILES.map(|(name, _)| name)).current_dir(root());
    output(compare).map(|said| said.lines().for_each(|line| println!("  {line}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_in_the_repository_are_current() {
        assert_eq!(model(true), Ok(()));
    }

    #[test]
    fn changed_figure_changes_both_models() {
        let (hand, other) = (Hand::default(), Hand { tip_m: 0.058, ..Hand::default() });
        for (name, page) in FILES {
            assert!(difference(&page(&hand), &page(&other)).is_some(), "{name}");
        }
    }
}
