//! MPE: when a move counts as arrived (manual 5.5 case 2), and when it gives up (decisions 0007 and 0049).

use crate::units::{CountsPerSec, Micros, Torque};

/// Largest measured velocity at an arrival, either way. The true one may be higher by what the estimator lags behind a change.
const SLOW: CountsPerSec = CountsPerSec::from_int(25);

/// Time without a hall edge before an arrival. A rotor that turns round within the window stands for an instant only, and at
/// an edge of reversal the estimator knows no velocity. At ACCEL 30 the last edge is 34 ms before the end of the profile.
const QUIET: Micros = Micros(24_000);

/// The same while more torque than a joint's friction is applied, 63 units and 30 %: it may be about to break the rotor loose.
/// 60 ms let 5 % of scattered links arrive above 23 counts/s, 24 ms above 68 (tests/arrival.rs measures it).
const QUIET_PUSHED: Micros = Micros(60_000);
const FRICTION: Torque = Torque(82);

/// How long a rotor counts as pushed after that torque, ms: a high KP changes the sign of its torque all the time.
const PUSHED_MS: u8 = 8;

/// Beyond TSTOP, how long a move waits for a motor that gets no nearer to its end, in ms. Every lasting oscillation of a
/// motor with the manual's gains is over within a tenth of that.
const PATIENCE_MS: u32 = 2000;

/// Times without a hall edge, of which an arrival needs one, and which of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quiet {
    /// Since the last edge, or since the plan if that is later: a short move may end before its rotor has left its cell.
    pub free: Micros,
    /// Since the last edge, or since the end of the profile if that is later: until then it may have been pushed the other way.
    pub pushed: Micros,
    /// More torque than a joint's friction has been applied just now.
    pub is_pushed: bool,
}

/// Whether the rotor is at rest within `mpe` counts of the end, `left` counts away.
#[must_use]
pub fn arrived(left: i32, mpe: u16, velocity: CountsPerSec, quiet: Quiet) -> bool {
    let is_quiet = if quiet.is_pushed { quiet.pushed.0 >= QUIET_PUSHED.0 } else { quiet.free.0 >= QUIET.0 };
    left.unsigned_abs() <= u32::from(mpe) && is_quiet && (SLOW.saturating_neg()..=SLOW).contains(&velocity)
}

/// How long a move has waited for its motor: with a set-point that rests on the end, or that stops for a rotor that lags. A
/// rotor that hunts, or is shaken by its load, never stalls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Arrival {
    /// Least distance from the end so far, in counts.
    nearest: u32,
    /// Time waited without getting nearer.
    late_ms: u32,
    /// Time since the profile's end.
    settling_ms: u32,
    /// Time for which the rotor counts as pushed.
    pushed_ms: u8,
    given_up: bool,
    driven: bool,
}

impl Arrival {
    /// Of a move of a motor that was `driven` when it was planned.
    #[must_use]
    pub const fn of(driven: bool) -> Self {
        Self { nearest: u32::MAX, late_ms: 0, settling_ms: 0, pushed_ms: 0, given_up: false, driven }
    }

    /// One tick of 1 ms of the move, in which `torque` is applied.
    #[inline]
    pub fn push(&mut self, torque: Torque) {
        let is_pushed = torque.saturating_abs() > FRICTION;
        self.pushed_ms = if is_pushed { PUSHED_MS } else { self.pushed_ms.saturating_sub(1) };
    }

    /// One tick of 1 ms after the end of a profile of so many `ticks`, `quiet` after the last edge. Nothing has driven a motor that was off
    /// and is where it is to go: its time without an edge counts from before the plan.
    pub fn settle(&mut self, quiet: Micros, ticks: u32) -> Quiet {
        self.settling_ms = self.settling_ms.saturating_add(1);
        let was_still = ticks == 0 && !self.driven;
        let planned_ms = if was_still { u32::MAX } else { ticks.saturating_add(self.settling_ms) };
        let within = |ms: u32| Micros(quiet.0.min(ms.saturating_mul(1000)));
        Quiet { free: within(planned_ms), pushed: within(self.settling_ms), is_pushed: self.pushed_ms > 0 }
    }

    /// One tick of 1 ms in which the move waits, `left` counts from its end. `tstop` in ms; 0 waits forever.
    pub fn wait(&mut self, left: i32, tstop: u16) {
        if left.unsigned_abs() < self.nearest {
            self.nearest = left.unsigned_abs();
            self.late_ms = 0;
        } else {
            self.late_ms = self.late_ms.saturating_add(1);
            self.given_up = tstop != 0 && self.late_ms >= u32::from(tstop) + PATIENCE_MS;
        }
    }

    /// Whether the move has waited for longer than TSTOP and two seconds.
    #[must_use]
    pub const fn is_given_up(&self) -> bool {
        self.given_up
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STILL: Quiet = Quiet { free: Micros(300_000), pushed: Micros(300_000), is_pushed: false };

    #[test]
    fn arrived_is_at_rest_and_inside_the_window() {
        let free = |us| Quiet { free: Micros(us), pushed: Micros(0), is_pushed: false };
        let pushed = |us| Quiet { free: STILL.free, pushed: Micros(us), is_pushed: true };
        let rows = [
            (4, 4, 0, STILL, true),
            (-4, 4, 25, STILL, true),
            (0, 0, -25, free(QUIET.0), true),
            (5, 4, 0, STILL, false),
            (-5, 4, 0, STILL, false),
            (0, 4, 26, STILL, false),
            (0, 4, -26, STILL, false),
            (0, 4, 0, free(QUIET.0 - 1), false),
            (0, 4, 0, pushed(QUIET_PUSHED.0 - 1), false),
            (0, 4, 0, pushed(QUIET_PUSHED.0), true),
            (i32::MIN, u16::MAX, 0, STILL, false),
        ];
        for (left, mpe, velocity, quiet, expected) in rows {
            let found = arrived(left, mpe, CountsPerSec::from_int(velocity), quiet);
            assert_eq!(found, expected, "{left} of {mpe} counts at {velocity} counts/s, {quiet:?}");
        }
    }

    #[test]
    fn times_count_from_the_plan_and_from_its_end() {
        let us = |free, pushed| Quiet { free: Micros(free), pushed: Micros(pushed), is_pushed: false };
        let still = STILL.free;
        let mut arrival = Arrival::of(false);
        assert_eq!(arrival.settle(still, 4), us(5_000, 1_000));
        assert_eq!(arrival.settle(still, 4), us(6_000, 2_000));
        assert_eq!(arrival.settle(Micros(1_500), 4), us(1_500, 1_500), "an edge later than both");
        assert_eq!(arrival.settle(still, u32::MAX), us(300_000, 4_000), "no wrap");
        assert_eq!(Arrival::of(false).settle(still, 0), us(300_000, 1_000), "no way, and nothing drove it");
        assert_eq!(Arrival::of(true).settle(still, 0), us(1_000, 1_000), "something may have driven it away");
    }

    #[test]
    fn rotor_is_pushed_for_eight_ms_after_more_torque_than_friction() {
        let mut arrival = Arrival::of(false);
        let mut pushed = |torque| {
            arrival.push(Torque(torque));
            arrival.settle(STILL.free, 4).is_pushed
        };
        assert_eq!([82, -82, 83, -82].map(&mut pushed), [false, false, true, true]);
        assert!(pushed(-83));
        for _ in 0..PUSHED_MS - 1 {
            assert!(pushed(0));
        }
        assert!(!pushed(0));
    }

    #[test]
    fn move_that_gets_no_nearer_gives_up_after_tstop_and_two_seconds() {
        for tstop in [1, 300, u16::MAX] {
            let mut arrival = Arrival::of(false);
            arrival.wait(9, tstop);
            let ticks = (1..).find(|tick| {
                arrival.wait(9 + tick % 7, tstop);
                arrival.is_given_up()
            });
            assert_eq!(ticks, Some(i32::from(tstop) + 2000));
        }
    }

    #[test]
    fn move_that_gets_nearer_or_has_no_tstop_never_gives_up() {
        let mut arrival = Arrival::of(false);
        for left in (1..50).rev() {
            for _ in 0..2299 {
                arrival.wait(-left, 300);
            }
            assert!(!arrival.is_given_up());
        }
        let mut arrival = Arrival::of(false);
        for _ in 0..100_000 {
            arrival.wait(9, 0);
        }
        assert!(!arrival.is_given_up());
    }
}
