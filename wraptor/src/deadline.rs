//! Deadlines, and the only place that reads the clock.

use std::time::{Duration, Instant};

/// The end of a call, counted from its start.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Deadline {
    start: Instant,
    limit: Duration,
}

impl Deadline {
    pub fn after(limit: Duration) -> Self {
        Self { start: Instant::now(), limit }
    }

    /// Time since the start of the call.
    pub fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// Time left; zero when it is over.
    pub fn remaining(&self) -> Duration {
        self.limit.saturating_sub(self.elapsed())
    }

    pub fn is_over(&self) -> bool {
        self.remaining().is_zero()
    }

    pub const fn limit(&self) -> Duration {
        self.limit
    }

    /// A deadline at most so far away, and not after this one.
    pub fn within(&self, limit: Duration) -> Self {
        Self::after(limit.min(self.remaining()))
    }
}
