//! Experiments in the world: scenarios and scripts, their metrics, verdicts and reports.
//!
//! Reads no clock; the files it reads are its inputs (scenarios, scenes, captures).
#![forbid(unsafe_code)]

pub mod events;
pub mod folder;
pub mod grasp;
pub mod metrics;
pub mod motor_file;
pub mod over_can;
pub mod packets;
pub mod page;
pub mod picture;
pub mod properties;
pub mod recorded;
pub mod replay;
pub mod report;
pub mod run;
pub mod scenario;
pub mod toml_text;
pub mod trace;
pub mod typist;
