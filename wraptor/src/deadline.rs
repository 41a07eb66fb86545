//! Deadlines, and the only place that reads the clock.

use std::time::{Duration, Instant};

/// The end of a call, counted from its start.
#[derive(Clone, Copy, Debug)]
pub struct Deadline {
    start: Instant,
    limit: Duration,
}

impl Deadline {
    /// So long from now on.
    #[must_use]
    pub fn after(limit: Duration) -> Self {
        Self { start: Instant::now(), limit }
    }

    /// Time since the start of the call.
    #[must_use]
    pub fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// Time left; zero when it is over.
    #[must_use]
    pub fn remaining(&self) -> Duration {
        self.limit.saturating_sub(self.elapsed())
    }

    /// Whether no time is left.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.remaining().is_zero()
    }

    /// The time that it had at its start.
    #[must_use]
    pub const fn limit(&self) -> Duration {
        self.limit
    }

    /// A deadline at most so far away, and not after this one.
    #[must_use]
    pub fn within(&self, limit: Duration) -> Self {
        Self::after(limit.min(self.remaining()))
    }
}
