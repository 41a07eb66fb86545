//! Installs what the checks need besides cargo.

use crate::Outcome;
use crate::program::{output, program, run, succeeds};
use programs::output::warn;

pub const THUMB: &str = "thumbv7m-none-eabi";

/// Installs rustfmt, clippy and the microcontroller's core library if missing.
///
/// # Errors
/// The missing component, and the command that installs it.
pub fn install() -> Outcome {
    if !succeeds("cargo fmt --version") {
        fetch("rustfmt", "rustup component add rustfmt")?;
    }
    if !succeeds("cargo clippy --version") {
        fetch("clippy", "rustup component add clippy")?;
    }
    target()
}

/// Installs the microcontroller's core library if missing.
///
/// # Errors
/// As [`install`].
pub fn target() -> Outcome {
    add(THUMB)
}

/// Installs the core library of a target if missing.
///
/// # Errors
/// As [`install`].
pub fn add(target: &str) -> Outcome {
    if has(target)? { Ok(()) } else { fetch(target, &format!("rustup target add {target}")) }
}

/// Whether the compiler in use has the microcontroller's core library.
///
/// # Errors
/// No compiler.
pub fn has_target() -> Result<bool, String> {
    has(THUMB)
}

fn has(target: &str) -> Result<bool, String> {
    let libraries = output(program(&format!("rustc --print target-libdir --target {target}")))?;
    Ok(std::path::Path::new(libraries.trim()).is_dir())
}

fn fetch(what: &str, line: &str) -> Outcome {
    if !succeeds("rustup --version") {
        return Err(format!(
            "{what} is missing, and so is rustup, which would install it.\n  Install rustup from \
             https://rustup.rs and then run `{line}`, or add {what} to this Rust by the means it came by."
        ));
    }
    warn(&format!("{what} is missing: {line}"));
    run(program(line)).map_err(|error| format!("{what} cannot be installed: {error}"))
}
