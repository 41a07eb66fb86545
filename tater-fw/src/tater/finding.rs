//! The state of FIND, which [`super::find`] executes.

use servo_core::find::Trouble;

/// What FIND is doing, or why it failed last.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finding {
    Nothing,
    Learning,
    Refused(Trouble),
    /// The test move began at this count.
    Testing {
        from: i32,
    },
}
