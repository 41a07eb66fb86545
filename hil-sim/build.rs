//! Names the commit of a release build, for results that last: the columns of a sweep, the answers of a worker.
//!
//! Not of a debug build, because a new commit compiles the package anew.

use std::env;
use std::path::{Path, PathBuf};
use std::process::Command;

/// What decides the result of a run.
const SOURCES: [&str; 17] = [
    "hil-sim/src",
    "hil-sim/world/src",
    "hil-sim/experiment/src",
    "hil-sim/torture/src",
    "hil-sim/tuning/src",
    "hil-sim/scenarios",
    "hil-sim/grasps",
    "programs/src",
    "commission/src",
    "traces/src",
    "god/src",
    "kinematics/src",
    "servo-core/src",
    "boards/tater-f103/src",
    "boot/src",
    "tater-fw/src",
    "tater-wire/src",
];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let is_release = env::var("PROFILE").is_ok_and(|profile| profile == "release");
    let commit = if is_release { commit() } else { None };
    println!("cargo::rustc-env=HIL_SIM_COMMIT={}", commit.as_deref().unwrap_or("unknown"));
}

/// The commit, with `+changes` if sources differ from it; `None` without git or its repository.
fn commit() -> Option<String> {
    let package = PathBuf::from(env::var("CARGO_MANIFEST_DIR").ok()?);
    // Within another project's repository the commit would be that project's.
    if git(&package, &["rev-parse", "--show-prefix"])? != "hil-sim/" {
        return None;
    }
    let root = package.parent()?;
    for file in ["HEAD", "logs/HEAD"] {
        let path = root.join(git(root, &["rev-parse", "--git-path", file])?);
        // A missing file would run this at each build.
        if path.exists() {
            println!("cargo::rerun-if-changed={}", path.display());
        }
    }
    for source in SOURCES {
        println!("cargo::rerun-if-changed={}", root.join(source).display());
    }
    let commit = git(root, &["rev-parse", "HEAD"])?;
    let changes = git(root, &[&["status", "--porcelain", "--"][..], &SOURCES[..]].concat())?;
    Some(if changes.is_empty() { commit } else { format!("{commit}+changes") })
}

fn git(folder: &Path, args: &[&str]) -> Option<String> {
    let output = Command::new("git").args(args).current_dir(folder).output().ok()?;
    let text = output.status.success().then(|| String::from_utf8(output.stdout).ok())??;
    Some(text.trim().to_owned())
}
