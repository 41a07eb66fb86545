//! Simulated time at the pace of real time.

/// How far simulated time may be behind before it stops catching up, µs: longer than any pause of an ordinary scheduler.
const SLACK_US: u64 = 100_000;

/// The difference between real and simulated time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pace {
    /// Given up so far.
    behind_us: u64,
    told: bool,
}

impl Pace {
    /// Where simulated time, now at `now_us`, should be; and what to tell the user, once, where it will never get there.
    pub fn target(&mut self, real_us: u64, now_us: u64) -> (u64, Option<String>) {
        let late_us = real_us.saturating_sub(self.behind_us).saturating_sub(now_us);
        if late_us <= SLACK_US {
            return (now_us + late_us, None);
        }
        self.behind_us += late_us - SLACK_US;
        let text = "warning: the machine is too slow, or was stopped: simulated time falls behind real time";
        let first = !std::mem::replace(&mut self.told, true);
        (now_us + SLACK_US, first.then(|| text.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_is_followed_and_never_goes_back() {
        let mut pace = Pace::default();
        assert_eq!(pace.target(1_000, 0), (1_000, None));
        assert_eq!(pace.target(1_000, 1_000), (1_000, None));
        assert_eq!(pace.target(100_999, 1_000), (100_999, None));
        assert_eq!(pace.target(90_000, 100_999), (100_999, None));
    }

    #[test]
    fn a_slow_machine_falls_behind_and_is_told_of_once() {
        let mut pace = Pace::default();
        let (target, text) = pace.target(10_000_000, 0);
        assert_eq!(target, 100_000);
        assert!(text.is_some());
        // 1 s later it is where it was to be, and on time from now on: 9.9 s behind.
        assert_eq!(pace.target(11_000_000, 1_100_000), (1_100_000, None));
        assert_eq!(pace.target(30_000_000, 1_100_000), (1_200_000, None), "not told again");
    }
}
