//! The simulated world: what a motor board, its bus and a whole hand are made of.
//!
//! Nothing here opens a socket, a file or a terminal, or reads a clock: the caller advances time, and the same calls give the
//! same result.
#![forbid(unsafe_code)]

pub mod board;
pub mod bus;
pub mod hand;
pub mod node;
pub mod plant;
pub mod rig;
