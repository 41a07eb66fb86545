//! Counts of instructions: all, and those of each exception's handler alone.
//!
//! An exception's entry takes 12 cycles (PM0056 2.3.7) and its return as many, if memory has no wait states; at the model's 1.5
//! cycles an instruction either is 8 instructions, and both count for its handler. What preempts a handler does not count for it.

use crate::time::Time;

/// Instructions that an exception's entry, or its return, is worth.
pub const ENTRY: u64 = 8;

/// What one exception's handler has taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Handler {
    /// How often it ran to its end.
    pub runs: u64,
    /// Instructions of all runs, entries and returns included.
    pub total: u64,
    /// Of the longest run.
    pub max: u64,
}

/// A handler's run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Exception number: 16 and the interrupt's position, 15 for SysTick.
    pub exception: u32,
    /// Instructions so far, its entry included.
    pub instructions: u64,
    /// When it began.
    pub since: Time,
}

/// What a core has executed.
#[derive(Clone, Debug, Default)]
pub struct Counts {
    /// All instructions since the core was made; entries and returns count [`ENTRY`] each.
    pub instructions: u64,
    /// By exception number; 0 is what runs outside handlers.
    pub handlers: Vec<Handler>,
    /// The handlers that have begun and not ended, the innermost last.
    pub running: Vec<Run>,
}
