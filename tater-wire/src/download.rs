//! The transport of a `.tek` file's characters to a monitor. Barrett's hosts send one per frame. Our
//! extension sends eight and numbers the frames: ASCII leaves bit 7 of every byte free, and eight such bits
//! are a number of 0..=255. The number reveals a late, duplicate or missing frame.
//!
//! A numbered frame always has eight bytes, so it is no GET, SET or request; zeros pad the last one.

mod host;
mod numbered;

pub use host::{Characters, DownloadError, Downloader, Next};
pub use numbered::{CHARACTERS, START, START_NUMBERED, before, pack, unpack};
