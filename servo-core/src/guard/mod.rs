//! Guards that limit, end or forbid motion. A *limit* reduces torque while the motion continues; a *fault* ends it.
pub mod arrival;
pub mod breakaway;
pub mod direction;
pub mod fault;
pub mod limits;
pub mod stall;
pub mod strain;
pub mod supply;
pub mod thermal;
