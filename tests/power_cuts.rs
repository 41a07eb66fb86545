//! The power fails in the middle of every flash operation: what is stored and what is downloaded is old or new, never
//! neither.

mod image;
mod monitor;
mod storage;
