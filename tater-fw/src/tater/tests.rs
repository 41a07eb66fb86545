//! The application on a fake board, for what frames alone cannot show or would take long to. Property by property
//! against the table: `tests/protocol/properties.rs`.

mod board;
mod commands;
mod faults;
mod keeping;
mod modes;
mod reports;
mod standstill;
mod upset;
