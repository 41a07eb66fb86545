//! The program's interfaces: arguments, sockets, terminals and output files.
//!
//! Imports both floors below. Real time is passed in: only `main.rs` reads the clock.

mod bode;
pub mod cli;
mod convert;
mod gcl;
pub mod grasper;
mod grasper_client;
mod guard;
mod interrupt;
mod lines;
mod margins;
mod log;
mod output;
mod serve;
pub mod slcan;
mod state_file;
mod table;
mod thread;
mod torture;
mod tune;
mod sweep;
mod sweep_folder;
mod thread;
mod torture;
mod worker;
