//! The Python wheel (wraptor/python), built by maturin from PyPI, and its check: a fresh environment, the documented installation, the tests, the types,
//! the tutorial (docs/python.md) and the speed against Rust.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::outcome::Failure;
use crate::program::{built, output, output_of_both, program, root, run, target, typed};
use crate::served::Served;
use crate::{Outcome, model, python};

/// From PyPI. Pinned, so that a failure is this project's.
const MATURIN: [&str; 1] = ["maturin==1.16.0"];

/// What the check needs besides the wheel and its own dependencies.
const TOOLS: &str = "-m pip install --quiet --disable-pip-version-check pytest==9.2.0 pytest-xdist==3.8.0 matplotlib==3.11.2 mypy==2.4.1";

/// How the wheel is installed, as docs/python.md says.
const INSTALL: &str = "-m pip install";

/// Least speed of runs from Python, as a share of Rust's.
const LEAST_SHARE: &str = "0.8";

#[derive(clap::Args)]
pub struct WheelArgs {
    /// Build with the profile of the checks, install into a fresh environment below target/, run tests, types, tutorial and benchmark
    #[arg(long)]
    check: bool,
}

/// Builds the wheel, and prints the command that installs it; or checks it.
///
/// # Errors
/// The failed program with a command to repeat it.
pub fn wheel(args: &WheelArgs) -> Result<(), Failure> {
    if args.check {
        return Ok(check()?);
    }
    let wheel = build("release", &target().join("wheels"))?;
    let path = wheel.strip_prefix(root()).unwrap_or(&wheel);
    println!("python3 {INSTALL} {}", path.display());
    Ok(())
}

/// # Errors
/// The failed program with a command to repeat it.
pub fn check() -> Outcome {
    let place = target().join("wheel-check");
    // The simulator with the checks' profile is mostly compiled already.
    let wheel = build("dev", &place.join("wheels"))?;
    let python = fresh(&place.join("environment"), &wheel)?;
    let simulator = built("hil-sim")?;
    let emulated = Served::emulated()?;
    let address = emulated.place("gcl")?;
    let script = |line: &str, paths: &[&Path]| {
        let mut script = Command::new(&python);
        script
            .args(line.split(' '))
            .args(paths)
            .current_dir(root().join("wraptor/python"))
            .env("HIL_SIM", &simulator)
            .env("EMULATED", address);
        // What the tools cache beside their sources.
        script.env("PYTHONDONTWRITEBYTECODE", "1");
        output(script).map(|said| said.lines().for_each(|line| println!("  {line}")))
    };
    // Most of its time is waiting for hands in real time.
    script("-m pytest --quiet --numprocesses 4 -p no:cacheprovider tests", &[])?;
    script("-m mypy --strict --cache-dir=/dev/null tests examples benches", &[])?;
    script("-m mypy.stubtest wraptor", &[])?;
    script("tests/tutorial.py ../../docs/python.md", &[&place.join("tutorial")])?;
    grasp(&python, script)?;
    script("benches/runs.py", &[&built("examples/run_speed")?, Path::new(LEAST_SHARE)])
}

/// The grasp of docs/mujoco.md, skipped where MuJoCo has no wheel. After the types, which must not depend on it.
fn grasp(python: &Path, script: impl Fn(&str, &[&Path]) -> Outcome) -> Outcome {
    let mut install = Command::new(python);
    install.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary=mujoco"]);
    install.arg(model::MUJOCO);
    if let Err(error) = output_of_both(install) {
        println!("  skipped: no MuJoCo; {}", error.lines().last().unwrap_or_default().trim());
        return Ok(());
    }
    script("examples/mujoco_grasp.py", &[])
}

/// Builds the wheel into a folder, and returns its file.
fn build(profile: &str, folder: &Path) -> Result<PathBuf, String> {
    let python = python::environment("maturin", &MATURIN)?;
    let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
    // A wheel of an earlier version would be found as well.
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(failed)?;
    }
    let mut maturin = Command::new(&python);
    maturin.args([
        "-m",
        "maturin",
        "build",
        "--quiet",
        "--manifest-path",
        "wraptor/python/Cargo.toml",
        "--profile",
    ]);
    maturin.arg(profile).arg("--out").arg(folder).current_dir(root());
    let line = typed(&maturin);
    output_of_both(maturin)?;
    let mut files = fs::read_dir(folder).map_err(failed)?.filter_map(|entry| Some(entry.ok()?.path()));
    let wheel = files.find(|path| path.extension().is_some_and(|extension| extension == "whl"));
    wheel.ok_or_else(|| format!("found no wheel in {}\n  repeat with: {line}", folder.display()))
}

/// A new environment with the wheel and the check's tools; returns its Python.
fn fresh(folder: &Path, wheel: &Path) -> Result<PathBuf, String> {
    let mut make = program("python3 -m venv --clear");
    make.arg(folder);
    run(make)?;
    let python = folder.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    let pip = |line: &str, wheel: Option<&Path>| {
        let mut pip = Command::new(&python);
        pip.args(line.split(' ')).args(wheel).current_dir(root());
        output(pip).map(drop).map_err(|error| {
            format!("packages cannot be installed; without a network, point pip to a mirror (PIP_INDEX_URL): {error}")
        })
    };
    pip(INSTALL, Some(wheel))?;
    pip(TOOLS, None)?;
    Ok(python)
}
