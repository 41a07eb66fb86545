//! Generates the robot models of the hand, URDF and MJCF, from the figures of the crate kinematics, and compares them with independent loaders.

mod mjcf;
mod urdf;

use std::fs;
use std::process::Command;

use kinematics::{Hand, Transform};

use crate::program::{output, program, root, run, target};
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
const PACKAGES: [&str; 2] = ["yourdfpy==0.0.60", "mujoco==4.0.0"];

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
    run(program("cargo build --quiet --package kinematics --example poses"))?;
    let mut poses = Command::new(target().join("debug/examples/poses"));
    poses.args(POSES).current_dir(root());
    let table = target().join("kinematics/poses.csv");
    files::replace(&table, output(poses)?.as_bytes())?;
    let mut compare = Command::new(&python);
    compare.arg("tests/host/kinematics.py").arg(&table).args(FILES.map(|(name, _)| name)).current_dir(root());
    output(compare).map(|said| said.lines().for_each(|line| println!("  {line}")))
}

/// A length or angle to 1e-9: a nanometer.
fn fixed(number: f64) -> String {
    let text = format!("{number:.9}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

fn fixed_all(numbers: &[f64]) -> String {
    numbers.iter().map(|number| fixed(*number)).collect::<Vec<_>>().join(" ")
}

/// A mass or inertia to six digits.
fn short(number: f64) -> String {
    format!("{number:.5e}")
}

/// The middle of a cylinder in its body's frame, and the turn from z onto its axis.
fn middle(shape: &kinematics::bodies::Cylinder) -> (kinematics::Vector, kinematics::Vector) {
    let mut at = [0.0; 3];
    at[shape.axis] = 0.5 * shape.length_m;
    // About y, z comes onto x.
    (at, if shape.axis == 0 { [0.0, std::f64::consts::FRAC_PI_2, 0.0] } else { [0.0; 3] })
}

/// Diagonal of the inertia in the body's frame, kg·m².
fn diagonal(body: &kinematics::bodies::Body) -> kinematics::Vector {
    let [along, across] = body.inertia_kg_m2();
    let mut diagonal = [across; 3];
    diagonal[body.shape.axis] = along;
    diagonal
}

fn xyz_rpy(place: &Transform) -> String {
    format!("xyz=\"{}\" rpy=\"{}\"", fixed_all(&place.origin), fixed_all(&place.roll_pitch_yaw()))
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

    #[test]
    fn numbers_are_plain() {
        assert_eq!(fixed_all(&[0.05, -0.0, 5e-19, 1.0, -0.25]), "0.05 0 0 1 -0.25");
        assert_eq!(short(1.984e-6), "1.98400e-6");
    }
}
