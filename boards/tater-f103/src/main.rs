//! The application of a motor board.

#![cfg_attr(target_os = "none", no_std, no_main)]
#![forbid(unsafe_code)]

#[cfg(target_os = "none")]
mod app;
#[cfg(target_os = "none")]
mod log;

#[cfg(not(target_os = "none"))]
fn main() -> Result<(), &'static str> {
    Err(
        "this program runs on a motor board: see `cargo xtask image` and `cargo xtask flash`; hil-sim simulates a board",
    )
}
