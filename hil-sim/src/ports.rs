//! The program's interfaces: arguments, sockets, terminals and output files.
//!
//! Imports both floors below. Real time is passed in: only `main.rs` reads the clock.

pub mod cli;
mod gcl;
pub mod grasper;
mod grasper_client;
mod guard;
mod interrupt;
mod lines;
mod output;
mod serve;
pub mod slcan;
mod state_file;
mod thread;
mod torture;
