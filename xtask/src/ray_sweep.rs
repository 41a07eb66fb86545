//! A sweep under Ray: the bytes of one machine for one, two and three workers, and after a worker is killed.
//! The package is large (70 MB), so a machine without it or without a network skips this.

use std::process::Command;

use crate::program::{built, output, root};
use crate::{Outcome, python};

/// From PyPI. Pinned, so that a failure is this project's.
const PACKAGES: [&str; 1] = ["ray==2.60.0"];

/// # Errors
/// The failed check with a command to repeat it.
pub fn check() -> Outcome {
    let python = match python::environment("ray-sweep", &PACKAGES) {
        Ok(python) => python,
        Err(error) => {
            println!("skipped: no Ray: {}", error.lines().next().unwrap_or_default());
            return Ok(());
        }
    };
    let mut check = Command::new(&python);
    check.arg("tests/host/ray_sweep.py").arg(built("hil-sim")?).current_dir(root());
    output(check).map(|said| said.lines().for_each(|line| println!("  {line}")))
}
