//! The reports of hil-sim in a headless Chromium: opened from disk, clicked, zoomed, read, printed, on a telephone's width.
//! Where Chromium is not installed, Debian's package is; a machine that cannot have it skips this.

use std::process::Command;

use crate::Outcome;
use crate::program::{built, output, root, succeeds};

/// The program of Debian's package, and the line that installs it.
pub const CHROMIUM: &str = "chromium";
pub const INSTALL: &str = "apt-get install chromium";

/// # Errors
/// The failed check with a command to repeat it.
pub fn check() -> Outcome {
    if !installed() {
        println!("skipped: no Chromium to open reports in: {INSTALL} did not install it");
        return Ok(());
    }
    if !succeeds("python3 --version") {
        println!("skipped: no python3 to drive Chromium");
        return Ok(());
    }
    let mut check = Command::new("python3");
    check.arg("tests/host/reports.py").arg(built("hil-sim")?).arg(CHROMIUM).current_dir(root());
    output(check).map(|said| said.lines().for_each(|line| println!("  {line}")))
}

/// Whether Chromium is here, or could be installed without asking anybody.
fn installed() -> bool {
    let is_here = || succeeds("chromium --version");
    if is_here() {
        return true;
    }
    println!("  {CHROMIUM} is missing: {INSTALL}");
    let install = || succeeds("apt-get install --yes --no-install-recommends --quiet chromium") && is_here();
    // The lists of packages may be absent or old.
    install() || (succeeds("apt-get update --quiet") && install())
}
