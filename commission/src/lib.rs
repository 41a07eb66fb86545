//! Real boards over their bus: what a motor is, and what its board holds. Knows no simulator: a [`excite::Link`] carries frames, and has
//! the time.
#![forbid(unsafe_code)]

pub mod adapter;
pub mod apply;
pub mod excite;
pub mod recording;
pub mod undo;
