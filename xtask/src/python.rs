//! Python environments below `target/` for checks by independent tools, with packages from PyPI.

use std::path::PathBuf;
use std::process::Command;

use crate::program::{program, root, run, succeeds, target};

/// The Python interpreter of an environment, created if it is missing or has other packages. Versions are
/// pinned, so that a failure is this project's.
///
/// # Errors
/// The missing tool, and how to install it.
pub fn environment(name: &str, packages: &[&str]) -> Result<PathBuf, String> {
    let folder = target().join(name);
    let python = folder.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    // Written last: an incomplete environment is created anew.
    let mark = folder.join("installed");
    // Scripts in it name its folder: it cannot move.
    let wanted = format!("{}\n{}", folder.display(), packages.join("\n"));
    if std::fs::read_to_string(&mark).is_ok_and(|found| found == wanted) && python.exists() {
        return Ok(python);
    }
    if !succeeds("python3 -m venv --help") {
        return Err(
            "python3 with its module venv is missing\n  install it (on Debian: apt install python3-venv)"
                .into(),
        );
    }
    println!("  installing {} into {}", packages.join(" and "), folder.display());
    let mut make = program("python3 -m venv --clear");
    make.arg(&folder);
    run(make)?;
    let mut install = Command::new(&python);
    install.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]).args(packages);
    install.current_dir(root());
    run(install).map_err(|error| {
        format!(
            "{} cannot be installed; without a network, point pip to a mirror (PIP_INDEX_URL): {error}",
            packages.join(" and ")
        )
    })?;
    std::fs::write(&mark, wanted).map_err(|error| format!("{}: {error}", mark.display()))?;
    Ok(python)
}
