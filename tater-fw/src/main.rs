//! The application of a motor board. On a host it prints the properties that it has on the bus, or names a board.

#![cfg_attr(target_os = "none", no_std, no_main)]
#![forbid(unsafe_code)]

#[cfg(target_os = "none")]
mod app;
#[cfg(target_os = "none")]
mod log;

#[cfg(not(target_os = "none"))]
mod host;

#[cfg(not(target_os = "none"))]
fn main() -> host::ExitCode {
    host::run()
}
