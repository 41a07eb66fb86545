//! Hardware in the loop without the hardware: motors, joints, sensors, bridges, the CAN bus, and a whole hand.
//!
//! [`run`] runs a [`scenario::Scenario`] and returns an [`Outcome`]; the binary `hil-sim` is [`cli`]. The library reads no
//! clock: time is simulated, and the same seed gives the same outcome.
//!
//! # Floors
//!
//! Imports point down only; `tests/fences/world.rs` checks it.
//!
//! | floor | modules |
//! |---|---|
//! | ports | [`cli`], [`page`], [`simulated`], [`slcan`], and the private `adapter`, `apply`, `bode`, `compare`, `convert`, `excite`, `export`, `figures`, `gcl`, `identify`, `interrupt`, `lines`, `log`, `margins`, `output`, `serve`, `state_file`, `sweep`, `sweep_folder`, `sweep_report`, `table`, `thread`, `torture`, `tune`, `tune_report`, `undo`, `worker` |
//! | tuning | [`apply`], [`excite`], [`identify`], [`parquet`], [`sweep`], [`table`], [`tune`], [`tuned`], and the private `bode`, `compare`, `csv`, `mcap`, `multisine`, `response`, `spectrum`, `traces` |
//! | experiment | [`charts`], [`events`], [`grasp`], [`input`], [`metrics`], [`over_can`], [`picture`], [`properties`], [`replay`], [`report`], `run`, [`scenario`], [`torture`], [`trace`], [`typist`] |
//! | world | [`board`](mod@board), [`bus`], [`hand`], [`node`], [`plant`], [`rig`](mod@rig) |
#![forbid(unsafe_code)]

mod experiment;
mod ports;
mod tuning;
mod world;

pub use experiment::run::{MotorRun, Options, Outcome, board, node_of, rig, run, set};
pub use experiment::{
    charts, events, grasp, input, metrics, over_can, picture, properties, replay, report, scenario, torture,
    trace, typist,
};
pub use ports::{cli, page, simulated, slcan};
pub use tater_fw::{SetError, motion::defaults};
pub use tater_wire::MotorKind;
pub use tuning::{apply, excite, identify, parquet, sweep, table, tune, tuned};
pub use world::plant::Model;
pub use world::{board, bus, hand, node, plant, rig};
/// For every TCP connection that a server of the simulator accepts.
pub use wraptor::configure_tcp;
