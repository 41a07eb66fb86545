//! Every property of a Tater, once: number, name, width, access, storage, unit, range, defaults, meaning.
//! Range checks, storage, refusals and documents all come from the row.
//!
//! Numbers below 109 are Barrett's, for motor firmware from 175 on; 109 and up are this project's, and so are those that there name the upper half of
//! a 32-bit property (P2, DP2 …): no host writes them.

pub mod barrett;
pub mod host_units;
mod table;
#[cfg(test)]
mod tests;

pub use table::{Access, Default, MotorKind, Property, PropertySpec, ROWS, Range, Rules, Stored};
