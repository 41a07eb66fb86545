//! Hall lines to sector and count, to the phases to drive, and to position and velocity between edges.
pub mod commutation;
pub mod hall;
pub mod observer;
pub mod wiring;
