//! The program's interfaces: arguments, sockets, terminals and output files.
//!
//! Imports both floors below. Real time is passed in: only `main.rs` reads the clock.

mod adapter;
pub mod cli;
mod excite;
mod gcl;
pub mod grasper;
mod grasper_client;
mod guard;
mod identify;
mod interrupt;
mod lines;
mod output;
mod serve;
pub mod slcan;
mod state_file;
mod thread;
mod torture;
