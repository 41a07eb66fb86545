//! The state of FIND, which [`super::find`] executes.

use crate::find::{Find, Trouble};

/// What FIND is doing, or why it failed last.
#[derive(Clone, Copy, Debug)]
pub enum Finding {
    Nothing,
    Learning(Find),
    Refused(Trouble),
    /// The test move began at this count.
    Testing {
        from: i32,
    },
}
