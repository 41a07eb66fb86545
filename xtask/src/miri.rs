//! `cargo xtask miri`: unit tests under Miri, which finds undefined behavior, if it is installed.
//!
//! Only `bsp-stm32f1` has `unsafe` of ours, and Miri has no registers. What is left is what our code makes of `heapless` and of cells:
//! queues, ring buffers, and the future of GOD. Miri is some hundred times slower, so tests that repeat the same operations many
//! thousand times are left out.

use crate::Outcome;
use crate::fuzz::{CI_SEED, PROPERTY_SEED};
use crate::program::{program, run, succeeds, target};

/// Packages, each with parts of the names of its tests that run.
const TESTS: [(&str, &[&str]); 4] = [
    ("tater-wire", &["message::", "frame::", "id::", "value::"]),
    ("boot", &["storage::numbers", "lock::"]),
    ("tater-fw", &["events::"]),
    ("god", &["io::", "events::", "framing::", "grammar::", "line::", "motors::"]),
];

/// # Errors
/// A test fails, or behaves in an undefined way.
pub fn check() -> Outcome {
    // Ask rustup: `cargo +nightly` would install a compiler.
    if !succeeds("rustup run nightly cargo miri --version") {
        println!("skipped: no miri (rustup component add --toolchain nightly miri rust-src)");
        return Ok(());
    }
    for (package, tests) in TESTS {
        let mut miri = program(&format!("cargo miri test --quiet --package {package} --lib --target-dir"));
        miri.arg(target().join("miri")).arg("--").args(tests);
        miri.env("RUSTUP_TOOLCHAIN", "nightly");
        // proptest asks for its folder; its inputs are few.
        miri.envs([("MIRIFLAGS", "-Zmiri-disable-isolation"), ("PROPTEST_CASES", "8")]);
        miri.env("PROPTEST_DISABLE_FAILURE_PERSISTENCE", "true");
        miri.env(PROPERTY_SEED, CI_SEED.to_string());
        run(miri)?;
    }
    Ok(())
}
