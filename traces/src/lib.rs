//! Tables of numbers over time, their formats, and errors in what a user gave. Without the features `mcap` and `parquet` the only format is
//! CSV, and most crates of the others are not compiled.
#![forbid(unsafe_code)]

pub mod csv;
pub mod format;
pub mod input;
#[cfg(feature = "mcap")]
pub mod mcap;
pub mod names;
pub mod numbers;
#[cfg(feature = "parquet")]
pub mod parquet;
pub mod table;
