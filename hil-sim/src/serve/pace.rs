//! Couples simulated time to real time.

/// Lag beyond which simulated time no longer catches up, µs: longer than a scheduler's ordinary pauses.
const SLACK_US: u64 = 100_000;

#[derive(Clone, Copy, Debug, Default)]
pub struct Pace {
    /// Lag given up so far, µs.
    behind_us: u64,
    warned: bool,
}

impl Pace {
    /// The target of simulated time, now at `now_us`, and a warning when it falls behind for the first time.
    pub fn target(&mut self, real_us: u64, now_us: u64) -> (u64, Option<String>) {
        let late_us = real_us.saturating_sub(self.behind_us).saturating_sub(now_us);
        if late_us <= SLACK_US {
            return (now_us + late_us, None);
        }
        self.behind_us += late_us - SLACK_US;
        let text = "warning: the machine is too slow, or was stopped: simulated time falls behind real time";
        let first = !std::mem::replace(&mut self.warned, true);
        (now_us + SLACK_US, first.then(|| text.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn target_follows_real_time_and_never_decreases() {
        let mut pace = Pace::default();
        assert_eq!(pace.target(1_000, 0), (1_000, None));
        assert_eq!(pace.target(1_000, 1_000), (1_000, None));
        assert_eq!(pace.target(100_999, 1_000), (100_999, None));
        assert_eq!(pace.target(90_000, 100_999), (100_999, None));
    }

    #[test]
    fn slow_machine_falls_behind_and_warns_once() {
        let mut pace = Pace::default();
        let (target, text) = pace.target(10_000_000, 0);
        assert_eq!(target, 100_000);
        assert!(text.is_some());
        // 1 s later time is on target again, 9.9 s behind real time.
        assert_eq!(pace.target(11_000_000, 1_100_000), (1_100_000, None));
        assert_eq!(pace.target(30_000_000, 1_100_000), (1_200_000, None), "no second warning");
    }
}
