//! Counts of instructions: all, and those of each exception's handler alone.
//!
//! An exception's entry takes 12 cycles (PM0056 2.3.7) and its return as many, if memory has no wait states; at the model's 1.5
//! cycles an instruction either is 8 instructions, and both count for its handler. What preempts a handler does not count for it.
//! Tail-chaining, which on the chip saves most of a return and an entry, counts as both.

use super::nvic::EXCEPTIONS;
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
    /// When the last run began that has ended.
    pub since: Time,
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
#[derive(Clone, Debug)]
pub struct Counts {
    /// All instructions since the core was made; entries and returns count [`ENTRY`] each.
    pub instructions: u64,
    /// By exception number; 0 is what runs outside handlers, of which `total` alone is counted.
    pub handlers: Vec<Handler>,
    /// The handlers that have begun and not ended, the innermost last.
    pub running: Vec<Run>,
}

impl Default for Counts {
    fn default() -> Self {
        Self { instructions: 0, handlers: vec![Handler::default(); EXCEPTIONS], running: Vec::new() }
    }
}

impl Counts {
    /// An instruction, of the innermost handler or of none.
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

    /// A handler begins.
    pub(super) fn enter(&mut self, exception: u32, now: Time) {
        self.running.push(Run { exception, instructions: 0, since: now });
        self.add(ENTRY);
    }

    /// A handler ends. One that was entered within it and never ended is forgotten.
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

    /// A reset: no handler runs.
    pub(super) fn reset(&mut self) {
        self.running.clear();
    }

    /// Forgets the longest runs, and what was counted of all handlers.
    pub fn clear(&mut self) {
        self.handlers.fill(Handler::default());
    }
}
