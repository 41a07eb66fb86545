//! TSTOP: a driven motor without a hall count for that long has stalled (manual 5.5 case 1).

/// Largest part of the time between the last count and the set-point being a whole count ahead that belongs to the stall. A
/// rotor that hits an obstacle stopped at its last count, and at 100 counts/s or more the set-point is ahead within 10 ms.
/// A set-point that creeps gets no more than this.
const LEAD_MS: u16 = 10;

/// The stall timer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stall {
    /// Time driven without a count, plus `LEAD_MS`.
    still_ms: u32,
    /// Part of `LEAD_MS` that has not passed yet; 0 before the first count.
    lead_ms: u16,
}

impl Stall {
    /// Restarts the stall time: when a motion starts or is planned again.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// One tick of 1 ms. `counted`: the hall count changed since the last tick. `driven`: the motor is driven away from
    /// rest; otherwise the timer pauses, because a set-point that creeps (ACCEL 1 needs 1.4 s for its first count) is no
    /// obstacle. `tstop` in ms, 0 = never. Returns whether the motor has stalled.
    #[must_use]
    #[inline]
    pub fn step(&mut self, counted: bool, driven: bool, tstop: u16) -> bool {
        if counted {
            *self = Self { still_ms: LEAD_MS.into(), lead_ms: LEAD_MS };
        } else if driven {
            self.still_ms = self.still_ms.saturating_add(1);
            return tstop != 0 && self.still_ms - u32::from(self.lead_ms) >= u32::from(tstop);
        } else if let Some(lead_ms) = self.lead_ms.checked_sub(1) {
            self.lead_ms = lead_ms;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stalls_tstop_after_the_last_count() {
        let mut stall = Stall::default();
        assert!(!stall.step(true, true, 3));
        assert!(!stall.step(false, true, 3));
        assert!(!stall.step(false, true, 3));
        assert!(stall.step(false, true, 3));
    }

    #[test]
    fn time_from_last_count_to_driven_counts_up_to_ten_ms() {
        for (undriven, left) in [(0, 300), (4, 296), (10, 290), (500, 290)] {
            let mut stall = Stall::default();
            assert!(!stall.step(true, true, 300));
            for _ in 0..undriven {
                assert!(!stall.step(false, false, 300));
            }
            assert_eq!((1..).find(|_| stall.step(false, true, 300)), Some(left));
        }
        // Before the first count there is no obstacle.
        let mut stall = Stall::default();
        for _ in 0..500 {
            assert!(!stall.step(false, false, 300));
        }
        assert_eq!((1..).find(|_| stall.step(false, true, 300)), Some(300));
    }

    #[test]
    fn counts_rest_and_restarts_prevent_a_stall() {
        let mut stall = Stall::default();
        for tick in 0..1000 {
            assert!(!stall.step(tick % 3 == 0, true, 3), "a count every 3 ms");
        }
        for _ in 0..1000 {
            assert!(!stall.step(false, false, 3), "not driven");
        }
        for _ in 0..1000 {
            stall.restart();
            assert!(!stall.step(false, true, 3), "restarted");
        }
        for _ in 0..70_000 {
            assert!(!stall.step(false, true, 0), "TSTOP 0 never stalls");
        }
    }
}
