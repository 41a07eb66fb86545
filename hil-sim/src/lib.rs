//! The program `hil-sim`: its command line, and servers of simulated boards and hands.
//!
//! The binary is [`cli`]. Real time is passed in: only `main.rs` reads the clock.
#![forbid(unsafe_code)]

mod apply;
mod bode;
pub mod cli;
mod compare;
mod convert;
mod excite;
mod export;
mod figures;
mod gcl;
mod identify;
mod lines;
mod log;
mod margins;
mod open;
mod output;
mod serve;
pub mod simulated;
pub mod slcan;
mod state_file;
mod sweep;
mod sweep_folder;
mod sweep_report;
mod thread;
mod torture;
mod tune;
mod tune_report;
mod worker;
