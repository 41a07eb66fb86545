//! Tuning: many runs instead of one, models from recordings, and what they say about gains.
//!
//! Imports `experiment` and `world`, never `ports`. Has threads, but no clock, network or terminal: whoever starts it passes in
//! the time, where progress goes and whether to stop.

pub mod excite;
pub mod identify;
