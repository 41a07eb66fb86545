//! Instruction counts: all, and those of each exception's handler alone.
//!
//! An exception's entry takes 12 cycles (PM0056 2.3.7), and so does its return, without wait states. At the
//! model's 1.5 cycles an instruction each counts as 8 instructions of its handler. Handlers that preempt
//! another do not count for it. Tail-chaining, which saves most of a return and an entry on the chip, counts
//! as both.

use super::nvic::EXCEPTIONS;
use crate::time::Time;

/// Instructions for an exception's entry, or its return.
pub const ENTRY: u64 = 8;

/// Counts of one exception's handler.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Handler {
    /// Completed runs.
    pub runs: u64,
    /// Instructions of all runs, with entries and returns.
    pub total: u64,
    /// Instructions of the longest run.
    pub max: u64,
    /// Start of the last completed run.
    pub since: Time,
}

/// A run of a handler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Run {
    /// Exception number: 15 for SysTick, 16 plus the position of an interrupt.
    pub exception: u32,
    /// Instructions so far, with its entry.
    pub instructions: u64,
    /// Start of the run.
    pub since: Time,
}

/// Counts of a core.
#[derive(Clone, Debug)]
pub struct Counts {
    /// All instructions since the core was made; entries and returns count [`ENTRY`] each.
    pub instructions: u64,
    /// By exception number; of 0, thread mode, only `total` is counted.
    pub handlers: Vec<Handler>,
    /// Handlers in progress, the innermost last.
    pub running: Vec<Run>,
}

impl Default for Counts {
    fn default() -> Self {
        Self { instructions: 0, handlers: vec![Handler::default(); EXCEPTIONS], running: Vec::new() }
    }
}

impl Counts {
    pub(super) fn instruction(&mut self) {
        self.add(1);
    }

    fn add(&mut self, instructions: u64) {
        self.instructions += instructions;
        if let Some(run) = self.running.last_mut() {
            run.instructions += instructions;
        } else if let Some(thread) = self.handlers.first_mut() {
            thread.total += instructions;
        }
    }

    pub(super) fn enter(&mut self, exception: u32, now: Time) {
        self.running.push(Run { exception, instructions: 0, since: now });
        self.add(ENTRY);
    }

    /// Ends a handler, and drops runs inside it that never ended.
    pub(crate) fn leave(&mut self, exception: u32) {
        let Some(at) = self.running.iter().rposition(|run| run.exception == exception) else { return };
        self.running.truncate(at + 1);
        self.add(ENTRY);
        if let (Some(run), Some(handler)) = (self.running.pop(), self.handlers.get_mut(exception as usize)) {
            handler.runs += 1;
            handler.total += run.instructions;
            handler.max = handler.max.max(run.instructions);
            handler.since = run.since;
        }
    }

    pub(super) fn reset(&mut self) {
        self.running.clear();
    }

    /// Clears the counts of all handlers.
    pub fn clear(&mut self) {
        self.handlers.fill(Handler::default());
    }
}
