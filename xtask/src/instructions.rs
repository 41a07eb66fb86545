//! Compares the emulated core with an independent one: board-emu generates and executes random instructions,
//! Unicorn's Cortex-M3 repeats them.

use std::process::Command;

use crate::program::{built, output, root, run, target};
use crate::{Outcome, python};

/// From PyPI.
const PACKAGES: [&str; 1] = ["unicorn==2.1.4"];

const LEAST: &str = "200000";

/// Fixed, so that a failure can be repeated.
const SEED: &str = "20261122";

/// # Errors
/// The first instructions that differ, with both states; or the missing tool.
pub fn check() -> Outcome {
    let python = python::environment("unicorn", &PACKAGES)?;
    let folder = target().join("instructions");
    std::fs::create_dir_all(&folder).map_err(|error| format!("{}: {error}", folder.display()))?;
    let cases = folder.join("cases.bin");
    let mut make = Command::new(built("examples/instructions")?);
    make.current_dir(root()).arg(&cases).args([SEED, LEAST]);
    run(make)?;
    let mut compare = Command::new(python);
    compare.arg("tests/host/instructions.py").arg(&cases).arg(LEAST).current_dir(root());
    println!("  {}", output(compare)?.trim_end());
    Ok(())
}
