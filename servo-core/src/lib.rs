//! The servo of one motor of the hand: motion only.
//!
//! Hall codes and analog readings go in, a bridge duty and a brake command come out. The crate knows no
//! register, no bus, no property number and no clock: time is passed in. It is `no_std`, without heap and
//! without floating point, because it runs on a Cortex-M3; all arithmetic is fixed point, in [`units`] and
//! [`num`].
//!
//! Where to look: what the halls say is in [`sense`], how a set-point moves and becomes torque is in
//! [`motion`], what may stop or bound it is in [`guard`], which loop runs when is in [`mode`], what goes
//! in and out is in [`command`], and the one order in which all of it runs is in [`servo`].
#![no_std]
#![forbid(unsafe_code)]
// The control path does not panic and does not index out of bounds; a test may.
#![cfg_attr(
    not(test),
    deny(
        clippy::indexing_slicing,
        clippy::string_slice,
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable
    )
)]

pub mod command;
pub mod config;
pub mod guard;
pub mod mode;
pub mod motion;
pub mod num;
pub mod sense;
pub mod servo;
pub mod units;

pub use command::{Command, Drive, EndReason, Event, Refusal, Sense, Telemetry};
pub use config::Config;
pub use servo::Servo;
