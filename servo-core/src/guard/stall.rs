//! TSTOP: a driven motor without a hall count for that long has stalled (manual 5.5 case 1).

/// The stall timer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stall {
    driven_ms: u32,
}

impl Stall {
    /// Starts from nought: at the start of a move, a brake release, a re-plan.
    pub fn restart(&mut self) {
        self.driven_ms = 0;
    }

    /// One tick of 1 ms. `counted`: the hall count moved since the last tick. `driven`: the motor is driven
    /// away from rest; the timer stands still while it is not, because a set-point that creeps (ACCEL 1 needs
    /// 1.4 s for its first count) is no obstacle. `tstop` in ms, 0 = never.
    ///
    /// Returns whether the motor has stalled.
    #[must_use]
    pub fn step(&mut self, counted: bool, driven: bool, tstop: u16) -> bool {
        if counted {
            self.driven_ms = 0;
        } else if driven {
            self.driven_ms = self.driven_ms.saturating_add(1);
        }
        tstop != 0 && self.driven_ms >= u32::from(tstop)
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
    fn counts_rest_and_restarts_hold_it_off() {
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
