//! Installs what the checks need besides cargo.

use crate::Outcome;
use crate::outcome::say;
use crate::program::{output, program, run, succeeds};

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
    if has_target()? { Ok(()) } else { fetch(THUMB, &format!("rustup target add {THUMB}")) }
}

/// Whether the compiler in use has the microcontroller's core library.
///
/// # Errors
/// No compiler.
pub fn has_target() -> Result<bool, String> {
    let libraries = output(program(&format!("rustc --print target-libdir --target {THUMB}")))?;
    Ok(std::path::Path::new(libraries.trim()).is_dir())
}

fn fetch(what: &str, line: &str) -> Outcome {
    if !succeeds("rustup --version") {
        return Err(format!(
            "{what} is missing, and so is rustup, which would install it.\n  Install rustup from \
             https://rustup.rs and then run `{line}`, or add {what} to this Rust by the means it came by."
        ));
    }
    say(&format!("{what} is missing: {line}"));
    run(program(line)).map_err(|error| format!("{what} cannot be installed: {error}"))
}
