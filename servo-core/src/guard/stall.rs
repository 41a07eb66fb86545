//! TSTOP: a driven motor without a hall count for that long has stalled (manual 5.5 case 1).
//!
//! The time belongs to the motor, not to a motion: neither a write nor a new motion restarts it (decision 0049). Each direction
//! has its own, so that a motion may leave a stop that the last one ran into. A count clears both, and so does a rest of
//! TSTOP. A rotor that goes to and fro between the same two cells does not move: it rests on the boundary of an obstacle.

use crate::way::Way;

/// Largest part of the time between the last count and the set-point being a whole count ahead that belongs to the stall. A
/// rotor that hits an obstacle stopped at its last count, and at 100 counts/s or more the set-point is ahead within 10 ms.
/// A set-point that creeps gets no more than this.
const LEAD_MS: u16 = 10;

/// A rest that has cleared the times: longer changes nothing.
const RESTED: u32 = u32::MAX;

/// The stall timer. A tick of 1 ms is one call of [`Stall::drive`] or [`Stall::rest`], or one of
/// [`Stall::count`] that returns `true`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stall {
    /// Time driven without a count, plus `LEAD_MS`.
    opening_ms: u32,
    closing_ms: u32,
    /// Time not driven since the last count or drive.
    rest_ms: u32,
    /// Part of `LEAD_MS` that has not passed yet; 0 before the first count.
    lead_ms: u16,
    /// The last count, and the one before it.
    at: i32,
    before: i32,
    /// The last count was that of two before.
    returned: bool,
}

impl Stall {
    /// A tick in which the hall count changed to `at`. Returns whether the rotor has moved; otherwise the tick is one without a count.
    #[inline]
    pub fn count(&mut self, at: i32) -> bool {
        let returned = at == self.before;
        // A reversal returns once.
        let moved = !(returned && self.returned);
        (self.before, self.at, self.returned) = (self.at, at, returned);
        if moved {
            self.opening_ms = LEAD_MS.into();
            self.closing_ms = LEAD_MS.into();
            (self.rest_ms, self.lead_ms) = (0, LEAD_MS);
        }
        moved
    }

    /// A tick in which the motor is driven away from rest, without a count. `tstop` in ms, 0 = never. Returns whether the
    /// motor has stalled.
    #[must_use]
    #[inline]
    pub fn drive(&mut self, way: Way, tstop: u16) -> bool {
        self.rest_ms = 0;
        let still_ms = self.still_ms(way);
        *still_ms = still_ms.saturating_add(1);
        self.is_over(way, tstop)
    }

    /// A tick in which the motor is not driven away from rest: idle, waiting for its brake, or following a set-point that
    /// creeps (ACCEL 1 needs 1.4 s for its first count), which is no obstacle. The timer pauses.
    #[inline]
    pub fn rest(&mut self, tstop: u16) {
        if self.rest_ms == RESTED {
            return;
        }
        if self.lead_ms > 0 {
            self.lead_ms -= 1;
        }
        self.rest_ms += 1;
        if self.rest_ms >= u32::from(tstop) && self.lead_ms == 0 {
            self.rest_ms = RESTED;
            self.forget(Way::Opening);
            self.forget(Way::Closing);
        }
    }

    const fn still_ms(&mut self, way: Way) -> &mut u32 {
        match way {
            Way::Opening => &mut self.opening_ms,
            Way::Closing => &mut self.closing_ms,
        }
    }

    /// Forgets the time of one way: HI leaves the stop that it has pressed on purpose.
    pub fn forget(&mut self, way: Way) {
        let still_ms = self.still_ms(way);
        *still_ms = (*still_ms).min(LEAD_MS.into());
    }

    /// Whether the motor has been driven that way for `tstop` without a count.
    #[must_use]
    pub fn is_over(&self, way: Way, tstop: u16) -> bool {
        let still_ms = match way {
            Way::Opening => self.opening_ms,
            Way::Closing => self.closing_ms,
        };
        tstop != 0 && still_ms >= u32::from(tstop) + u32::from(self.lead_ms)
    }

    /// Whether [`Self::is_over`] may hold either way: a quick check for each tick.
    #[must_use]
    #[inline]
    pub fn may_be_over(&self, tstop: u16) -> bool {
        self.closing_ms.max(self.opening_ms) >= u32::from(tstop)
    }

    /// Whether half of `tstop` is used up, either way.
    #[must_use]
    pub fn is_over_half(&self, tstop: u16) -> bool {
        self.is_over(Way::Closing, tstop / 2) || self.is_over(Way::Opening, tstop / 2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ticks of drive until the stall.
    fn left(stall: &mut Stall, way: Way, tstop: u16) -> Option<u32> {
        (1..100_000).find(|_| stall.drive(way, tstop))
    }

    /// The next count of a rotor that closes.
    fn count(stall: &mut Stall) {
        assert!(stall.count(stall.at + 1));
    }

    fn rest(stall: &mut Stall, ms: u32, tstop: u16) {
        for _ in 0..ms {
            stall.rest(tstop);
        }
    }

    #[test]
    fn stalls_tstop_after_the_last_count() {
        let mut stall = Stall::default();
        count(&mut stall);
        assert_eq!(left(&mut stall, Way::Closing, 3), Some(3));
    }

    #[test]
    fn time_from_last_count_to_driven_counts_up_to_ten_ms() {
        for (undriven, expected) in [(0, 300), (4, 296), (10, 290), (500, 290)] {
            let mut stall = Stall::default();
            count(&mut stall);
            rest(&mut stall, undriven, 300);
            assert_eq!(left(&mut stall, Way::Opening, 300), Some(expected), "{undriven}");
        }
        // Before the first count there is no obstacle.
        let mut stall = Stall::default();
        rest(&mut stall, 500, 300);
        assert_eq!(left(&mut stall, Way::Closing, 300), Some(300));
    }

    #[test]
    fn counts_and_tstop_0_prevent_a_stall() {
        let mut stall = Stall::default();
        for tick in 0..1000 {
            if tick % 3 == 0 {
                count(&mut stall);
            } else {
                assert!(!stall.drive(Way::Closing, 3), "a count every 3 ms");
            }
        }
        assert_eq!(left(&mut Stall::default(), Way::Closing, 0), None, "TSTOP 0 never stalls");
    }

    #[test]
    fn only_a_rest_of_tstop_or_a_count_clears_the_time() {
        for (ms, expected) in [(0, 1), (1, 1), (299, 1), (300, 290), (9999, 290)] {
            let mut stall = Stall::default();
            count(&mut stall);
            assert_eq!(left(&mut stall, Way::Closing, 300), Some(300));
            rest(&mut stall, ms, 300);
            assert_eq!(left(&mut stall, Way::Closing, 300), Some(expected), "after {ms} ms");
        }
        let mut stall = Stall::default();
        assert_eq!(left(&mut stall, Way::Closing, 300), Some(300));
        count(&mut stall);
        assert_eq!(left(&mut stall, Way::Closing, 300), Some(300));
    }

    #[test]
    fn each_direction_stalls_once() {
        let mut stall = Stall::default();
        count(&mut stall);
        let mut driven = 0;
        while !(stall.is_over(Way::Closing, 300) && stall.is_over(Way::Opening, 300)) {
            let _ = stall.drive(Way::closing_if(driven / 100 % 2 == 0), 300);
            driven += 1;
        }
        assert!(driven <= 700, "{driven}");
    }

    #[test]
    fn rotor_between_two_cells_does_not_move() {
        let mut stall = Stall::default();
        // There, and back once: a reversal.
        assert_eq!(
            [7, 8, 7, 8, 7, 8, 7].map(|at| stall.count(at)),
            [true, true, true, false, false, false, false]
        );
        assert_eq!([6, 7, 6, 5].map(|at| stall.count(at)), [true, true, false, true]);
        // The time goes on.
        let mut stall = Stall::default();
        let ended = (1..).find(|ms| {
            let moved = ms % 20 == 0 && stall.count(ms / 20 % 2);
            !moved && stall.drive(Way::Closing, 300)
        });
        assert!(ended.is_some_and(|ms| (290..=360).contains(&ms)), "{ended:?}");
    }
}
