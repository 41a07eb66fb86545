//! What the three hall lines say: sector and count, which phases to drive, position and velocity in between.
pub mod commutation;
pub mod hall;
pub mod velocity;
