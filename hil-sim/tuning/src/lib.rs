//! Tuning: many runs instead of one, models from recordings, and what they say about gains.
//!
//! Has threads, but no clock, network or terminal: whoever starts it passes in the time, where progress goes and whether to stop.
#![forbid(unsafe_code)]

pub mod bode;
pub mod compare;
pub mod frf;
pub mod identify;
pub(crate) mod multisine;
pub mod response;
pub mod spectrum;
pub mod sweep;
pub mod tune;
pub mod tuned;
