//! Tables of numbers over time, their formats, and errors in what a user gave.
#![forbid(unsafe_code)]

pub mod csv;
pub mod format;
pub mod input;
pub mod mcap;
pub mod names;
pub mod numbers;
pub mod parquet;
pub mod table;
