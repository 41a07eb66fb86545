//! Tuning: many runs instead of one, models from recordings, and what they say about gains.
//!
//! Imports `experiment` and `world`, never `ports`. Has threads, but no clock, network or terminal: whoever starts it passes in
//! the time, where progress goes and whether to stop.

pub mod apply;
pub mod bode;
pub mod compare;
pub mod csv;
pub mod excite;
pub mod identify;
pub mod mcap;
pub mod multisine;
pub mod names;
pub mod parquet;
pub mod response;
pub mod spectrum;
pub mod sweep;
pub mod table;
pub mod tune;
pub mod tuned;
