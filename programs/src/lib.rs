//! What command-line programs share: files replaced atomically, ^C, and standard output whose reader may leave.
//!
//! An error is the system's; each program adds what its user should do next.
#![forbid(unsafe_code)]

pub mod files;
pub mod interrupt;
pub mod output;
