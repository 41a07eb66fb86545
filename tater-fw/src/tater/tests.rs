//! The application on a fake board: cases that frames alone cannot show, or only slowly. Every property
//! against the table: `tests/protocol/properties.rs`.

mod board;
mod commands;
mod faults;
mod host_units;
mod keeping;
mod modes;
mod reports;
mod standstill;
mod upset;
