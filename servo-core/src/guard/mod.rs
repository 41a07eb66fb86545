//! What may bound, end or forbid motion. A *limit* bounds and the motion goes on; a *fault* ends it.
pub mod arrival;
pub mod breakaway;
pub mod fault;
pub mod limits;
pub mod stall;
pub mod strain;
pub mod thermal;
