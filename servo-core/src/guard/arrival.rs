//! MPE: when a move counts as arrived (manual 5.5 case 2), and when it gives up (decisions 0007 and 0049).

use crate::motor::Motor;
use crate::num::{root_within, saturating_i16};
use crate::units::{CountsPerSec, Micros, Torque};

/// How slow a rotor must be, and which torque may move it; of the hand's motor in brackets.
///
/// Friction F stops a rotor that coasts with v within v²/(2·B·F) counts: the hand's from 25 counts/s within 0.073 counts. That is the same way
/// of every motor, so the speeds are in proportion to √(B·F). A motor with much friction is not allowed more than the hand's, which is what an
/// arrival promises; one without is stopped by its loop, and 40 % is what that leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rest {
    /// Largest measured velocity at an arrival, either way (25). The true one may be higher by what the estimator lags behind a change.
    slow: CountsPerSec,
    /// Observed velocity at an arrival in the very cell of the end (6); up to `slower` (20) if no edge has come for [`QUIET_CELL`]. It must
    /// last for four ticks; for five if the last edge is that long ago at their beginning, since then it is the model's word alone: a rotor that
    /// is faster is stopped by its friction meanwhile (4270 counts/s²).
    still: CountsPerSec,
    slower: CountsPerSec,
    /// Observed velocity below which a rotor within two cells does not move (130): a joint pressed on an object by a high KP shakes within two
    /// cells at 200 counts/s (torture seed 1330008105), one that rests on its stop at a boundary is observed at up to 106, since each edge says
    /// that it moves (1350001410).
    hunting: CountsPerSec,
    /// Torque that may be about to break the rotor loose: friction at rest and 30 % (82).
    pushes: u16,
}

/// MKA · MFC of the hand's motor over 16.
const HAND_STOPPING: u32 = 1454 * 47 / 16;

impl Rest {
    /// Of a motor.
    #[must_use]
    pub fn new(motor: &Motor) -> Self {
        let stopping = u32::from(motor.mka) * u32::from(motor.mfc) / 16;
        // Percent, 40 to 100.
        let share = root_within(stopping.min(HAND_STOPPING) * 10_000 / HAND_STOPPING, 40, 100);
        let speed =
            |hands: u32| CountsPerSec::from_int(saturating_i16(((hands * share + 50) / 100).cast_signed()));
        let friction = motor.stiction();
        Self {
            slow: speed(25),
            still: speed(6),
            slower: speed(20),
            hunting: speed(130),
            pushes: (friction + (friction * 3 + 1) / 10).max(10),
        }
    }
}

/// Time without a hall edge before an arrival. A rotor that turns round within the window stands for an instant only, and at
/// an edge of reversal the estimator knows no velocity. At ACCEL 30 the last edge is 34 ms before the end of the profile.
const QUIET: Micros = Micros(24_000);

/// The same while more than [`Rest::pushes`] is applied: it may be about to break the rotor loose.
/// 60 ms let 5 % of scattered links arrive above 23 counts/s, 24 ms above 68 (tests/arrival.rs measures it).
const QUIET_PUSHED: Micros = Micros(60_000);

/// How long a rotor counts as pushed after that torque, ms: a high KP changes the sign of its torque all the time.
const PUSHED_MS: u8 = 8;

/// Time without an edge from which a rotor in the cell of the end may be observed at [`Rest::slower`].
const QUIET_CELL: Micros = Micros(12_000);
/// Least time since the last edge: a rotor that has just come into the cell is as fast as it is, whatever the model says. With the four ticks
/// it is 10 ms, in which one of 100 counts/s passes the cell. More torque than friction takes [`QUIET`]: what is taken for the load that it
/// carries may have been friction, and the rotor runs on (torture seed 1300000029).
const QUIET_LEAST: Micros = Micros(6_000);
const STILL_MS: u8 = 4;
const STILL_SLOW_MS: u8 = 5;

/// Time within two cells that is no motion any more, ms: see [`Rest::hunting`].
const HUNTING_MS: u16 = 250;

/// Time since the end of the profile within which the servo brings the rotor into the end's own cell: an arrival elsewhere waits for it.
const SETTLING_MS: u32 = 60;

/// Beyond TSTOP, how long a move waits for a motor that gets no nearer to its end, in ms. Every lasting oscillation of a
/// motor with the manual's gains is over within a tenth of that.
const PATIENCE_MS: u32 = 2000;

/// Times without a hall edge, of which an arrival needs one, and which of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quiet {
    /// Since the last edge, or since the plan if that is later: a short move may end before its rotor has left its cell.
    pub free: Micros,
    /// Since the last edge, the end of the profile or the first torque of about this size, whichever is latest: one that grows has yet to move it.
    pub pushed: Micros,
    /// More torque than a joint's friction has been applied just now.
    pub is_pushed: bool,
}

/// Whether the rotor is at rest within `mpe` counts of the end, `left` counts away.
#[must_use]
pub fn arrived(rest: &Rest, left: i32, mpe: u16, velocity: CountsPerSec, quiet: Quiet) -> bool {
    let is_quiet = if quiet.is_pushed { quiet.pushed.0 >= QUIET_PUSHED.0 } else { quiet.free.0 >= QUIET.0 };
    left.unsigned_abs() <= u32::from(mpe) && is_quiet && within(velocity, rest.slow)
}

/// Whether a velocity is `most` or less, either way.
fn within(velocity: CountsPerSec, most: CountsPerSec) -> bool {
    (most.saturating_neg()..=most).contains(&velocity)
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
    /// Time for which the rotor still counts as pushed, and since when it has by about `pushed_by` torque units.
    pushed_ms: u8,
    pushing_ms: u32,
    pushed_by: u16,
    /// Ticks at rest in the cell of the end.
    still_ms: u8,
    needed_ms: u8,
    /// Least and largest distance from the end, counts, within which the rotor has stayed for `hunting_ms`.
    cells: (i32, i32),
    hunting_ms: u16,
    given_up: bool,
    driven: bool,
}

impl Arrival {
    /// Of a move of a motor that was `driven` when it was planned.
    #[must_use]
    pub const fn of(driven: bool) -> Self {
        Self {
            nearest: u32::MAX,
            late_ms: 0,
            settling_ms: 0,
            pushed_ms: 0,
            pushing_ms: 0,
            pushed_by: 0,
            still_ms: 0,
            needed_ms: 0,
            cells: (0, 0),
            hunting_ms: 0,
            given_up: false,
            driven,
        }
    }

    /// One tick of 1 ms of the move, in which `torque` is applied. One that has grown by a joint's friction is a new push: the servo that pulls
    /// a rotor into the end's cell ever harder has just broken it loose, 10 ms before its edge.
    #[inline]
    pub fn push(&mut self, rest: &Rest, torque: Torque) {
        let (by, friction) = (torque.0.unsigned_abs(), rest.pushes);
        if by > friction {
            self.pushed_ms = PUSHED_MS;
        } else if self.pushed_ms == 0 {
            return;
        } else {
            self.pushed_ms -= 1;
        }
        if self.pushed_ms == 0 {
            (self.pushing_ms, self.pushed_by) = (0, 0);
        } else if by > self.pushed_by + friction {
            (self.pushing_ms, self.pushed_by) = (1, by);
        } else {
            self.pushing_ms = self.pushing_ms.saturating_add(1);
        }
    }

    /// One tick of 1 ms after the end of a profile of so many `ticks`, `quiet` after the last edge. Nothing has driven a motor that was off
    /// and is where it is to go: its time without an edge counts from before the plan.
    pub fn settle(&mut self, quiet: Micros, ticks: u32) -> Quiet {
        self.settling_ms = self.settling_ms.saturating_add(1);
        let was_still = ticks == 0 && !self.driven;
        let planned_ms = if was_still { u32::MAX } else { ticks.saturating_add(self.settling_ms) };
        let within = |ms: u32| Micros(quiet.0.min(ms.saturating_mul(1000)));
        let pushed = within(self.settling_ms.min(self.pushing_ms));
        Quiet { free: within(planned_ms), pushed, is_pushed: self.pushed_ms > 0 }
    }

    /// One tick of 1 ms after the end of a profile, `left` counts from it and `quiet` after the last edge.
    /// Whether the rotor rests in the cell of the end.
    pub fn rests(&mut self, rest: &Rest, left: i32, velocity: CountsPerSec, quiet: Micros) -> bool {
        let still = left == 0
            && (within(velocity, rest.still) && quiet.0 >= QUIET_LEAST.0
                || within(velocity, rest.slower) && quiet.0 >= QUIET_CELL.0);
        if !still {
            self.still_ms = 0;
            return false;
        }
        if self.still_ms == 0 {
            self.needed_ms = if quiet.0 < QUIET_CELL.0 { STILL_MS } else { STILL_SLOW_MS };
        }
        self.still_ms = self.still_ms.saturating_add(1);
        self.still_ms >= self.needed_ms && (self.pushed_ms == 0 || quiet.0 >= QUIET.0)
    }

    /// One tick of 1 ms after the end of a profile, `left` counts from it. Whether the rotor has stayed within two neighboring cells for so
    /// long, and so slow, that it is at their boundary: one that rests on its stop there is never quiet.
    pub fn hunts(&mut self, rest: &Rest, left: i32, velocity: CountsPerSec) -> bool {
        let (low, high) = (self.cells.0.min(left), self.cells.1.max(left));
        if high.saturating_sub(low) > 1 || !within(velocity, rest.hunting) {
            (self.cells, self.hunting_ms) = ((left, left), 0);
        } else {
            (self.cells, self.hunting_ms) = ((low, high), self.hunting_ms.saturating_add(1));
        }
        self.hunting_ms >= HUNTING_MS && within(velocity, rest.slow)
    }

    /// Whether the servo has had its time to bring the rotor into the cell of the end.
    #[must_use]
    pub const fn has_settled(&self) -> bool {
        self.settling_ms >= SETTLING_MS
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

    fn hand() -> Rest {
        Rest::new(&Motor::HAND)
    }

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
            let found = arrived(&hand(), left, mpe, CountsPerSec::from_int(velocity), quiet);
            assert_eq!(found, expected, "{left} of {mpe} counts at {velocity} counts/s, {quiet:?}");
        }
    }

    #[test]
    fn times_count_from_the_plan_and_from_its_end() {
        let free = |arrival: &mut Arrival, quiet, ticks| arrival.settle(quiet, ticks).free.0;
        let still = STILL.free;
        let mut arrival = Arrival::of(false);
        assert_eq!(free(&mut arrival, still, 4), 5_000);
        assert_eq!(free(&mut arrival, still, 4), 6_000);
        assert_eq!(free(&mut arrival, Micros(1_500), 4), 1_500, "an edge later than both");
        assert_eq!(free(&mut arrival, still, u32::MAX), 300_000, "no wrap");
        assert_eq!(free(&mut Arrival::of(false), still, 0), 300_000, "no way, and nothing drove it");
        assert_eq!(free(&mut Arrival::of(true), still, 0), 1_000, "something may have driven it away");
    }

    #[test]
    fn time_of_a_pushed_rotor_counts_from_the_latest_of_edge_end_and_push() {
        let mut arrival = Arrival::of(false);
        let mut pushed = |torque, edge_us| {
            arrival.push(&hand(), Torque(torque));
            arrival.settle(Micros(edge_us), 4).pushed.0
        };
        assert_eq!(
            [83, 83].map(|torque| pushed(torque, 300_000)),
            [1_000, 2_000],
            "from the end of the profile"
        );
        assert_eq!(pushed(83, 500), 500, "from an edge");
        for tick in 4..4 + u32::from(PUSHED_MS) - 1 {
            assert_eq!(pushed(0, 300_000), 1_000 * tick);
        }
        assert_eq!(pushed(0, 300_000), 0);
        assert_eq!([83, -83].map(|torque| pushed(torque, 300_000)), [1_000, 2_000], "from a later push");
        assert_eq!(
            [165, 166].map(|torque| pushed(torque, 300_000)),
            [3_000, 1_000],
            "from one that has grown"
        );
    }

    /// First tick in which it rests.
    fn rests_after(left: i32, velocity: i16, torque: i16, quiet: Micros) -> Option<u8> {
        let mut arrival = Arrival::of(false);
        (1..50).find(|_| {
            arrival.push(&hand(), Torque(torque));
            arrival.rests(&hand(), left, CountsPerSec::from_int(velocity), quiet)
        })
    }

    #[test]
    fn rotor_is_pushed_for_eight_ms_after_more_torque_than_friction() {
        let mut arrival = Arrival::of(false);
        let mut pushed = |torque| {
            arrival.push(&hand(), Torque(torque));
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
    fn rotor_that_is_pushed_rests_after_24_quiet_ms() {
        for (torque, quiet, ticks) in [
            (83, Micros(QUIET.0 - 1), None),
            (-83, Micros(QUIET.0 - 1), None),
            (83, QUIET, Some(5)),
            (82, QUIET_CELL, Some(5)),
        ] {
            assert_eq!(rests_after(0, 0, torque, quiet), ticks, "{torque} {quiet:?}");
        }
    }

    #[test]
    fn rotor_rests_in_the_cell_of_the_end_after_four_slow_ticks_or_five_quiet_ones() {
        let (least, cell) = (QUIET_LEAST, QUIET_CELL);
        let early = |quiet: Micros| Micros(quiet.0 - 1);
        for (left, velocity, quiet, ticks) in [
            (0, 6, least, Some(4)),
            (0, -6, early(cell), Some(4)),
            (0, 0, early(least), None),
            (0, 7, early(cell), None),
            (0, 20, cell, Some(5)),
            (0, -20, cell, Some(5)),
            (0, 0, cell, Some(5)),
            (0, 21, cell, None),
            (0, -21, cell, None),
            (1, 0, cell, None),
            (-1, 0, cell, None),
        ] {
            assert_eq!(rests_after(left, velocity, 0, quiet), ticks, "{left} {velocity} {quiet:?}");
        }
    }

    #[test]
    fn rest_begins_anew_when_the_rotor_moves() {
        let mut arrival = Arrival::of(false);
        for velocity in [0, 0, 0, 7, 0, 0, 0] {
            assert!(!arrival.rests(&hand(), 0, CountsPerSec::from_int(velocity), QUIET_LEAST));
        }
        assert!(arrival.rests(&hand(), 0, CountsPerSec::ZERO, QUIET_LEAST));
    }

    #[test]
    fn rotor_hunts_that_stays_slow_within_two_cells_for_250_ms() {
        let slow = hand().hunting.0.to_num::<i16>();
        for (span, speed, hunts) in [
            (0, 0, true),
            (1, slow, true),
            (1, -slow, true),
            (2, 0, false),
            (1, slow + 1, false),
            (1, -slow - 1, false),
        ] {
            let mut arrival = Arrival::of(false);
            // Every other tick at this speed.
            let speed = |tick| CountsPerSec::from_int(if tick % 2 == 0 { speed } else { 0 });
            let ticks = (1..1000)
                .find(|&tick| arrival.hunts(&hand(), -3 + span * (i32::from(tick) / 20 % 2), speed(tick)));
            // The first tick only shows where it is.
            assert_eq!(
                ticks.is_some_and(|ticks: i16| (250..=251).contains(&ticks)),
                hunts,
                "{span}: {ticks:?}"
            );
            assert_eq!(ticks.is_some(), hunts, "{span}: {ticks:?}");
        }
    }

    #[test]
    fn servo_has_60_ms_to_settle() {
        let mut arrival = Arrival::of(false);
        for _ in 0..59 {
            arrival.settle(Micros(0), 5);
        }
        assert!(!arrival.has_settled());
        arrival.settle(Micros(0), 5);
        assert!(arrival.has_settled());
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
