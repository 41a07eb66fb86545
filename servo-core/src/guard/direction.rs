//! Whether the motor runs the way it is driven: little torque until that has been seen, and a fault if it does not.
//!
//! # Design
//!
//! A rotor at rest has no energy, so what its motor does to it is positive: torque times counts, summed up from rest, cannot
//! become negative unless the wiring is wrong or something else turns the rotor. Counts against the torque while the sum is
//! at zero are wrong ones; braking after an acceleration is none of them.
//!
//! After more than `WRONG` wrong counts the bridge opens until the rotor rests. One that its own motor turned the wrong way is
//! slowed by friction and stops within a count: the wiring is wrong. One that is pushed goes on, by `PUSHED` counts or more: then
//! the motion resumes from there (decision 0047).
//!
//! The direction is right once the rotor is `RIGHT` counts from where it began to follow its torque: an electrical revolution. A wiring that
//! is right in some sectors and wrong in others holds the rotor within three. Rests on the way do not count, because a motor with much friction
//! stops at every count; a count against the torque begins anew.

use crate::motor::Motor;
use crate::num::saturating_i16;
use crate::units::Torque;

/// Torque limits until the direction is known, torque units. They follow from the friction at rest; in brackets those of the hand's motor, whose
/// friction is 63.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Starts {
    /// The limit of a motion, enough to start (80).
    pub start: Torque,
    /// The limit of a motor that stands, and of FIND (160). Friction of 63 units, 30 % more of it, and 30 % less torque an ampere with
    /// 30 % more resistance need 152. The bridge's dead time took 11 of 172 before it was compensated.
    pub most: Torque,
    /// The limit of a motor that has come loose (125): friction in motion is a quarter less than at rest, so the worst motor needs 115.
    pub loose: i16,
    /// The limit of a motor that does not start (238): before it slept an impact may have wedged its joint in a stop. Of 3240 wrong wirings
    /// and plants none runs more than 5.8 counts the wrong way then; with 320 it would be 7.8 (tests/wiring.rs).
    pub wedged: i16,
    /// Rise of the limit up to `most`, units a ms (1), and a quarter of that above: within TSTOP to what a wedged joint needs.
    rise: i16,
}

impl Starts {
    /// Of a motor. One without friction gets 2 to 6 % of its torque: cogging and what its description does not know hold it.
    #[must_use]
    pub fn new(motor: &Motor) -> Self {
        let friction = motor.stiction();
        let of = |hands: u16, least: u16| {
            let share = (u32::from(hands) * u32::from(friction) / HAND_FRICTION).max(least.into());
            saturating_i16(share.min(990).cast_signed())
        };
        Self {
            start: Torque(of(80, 20)),
            most: Torque(of(160, 40)),
            loose: of(125, 32),
            wedged: of(238, 60),
            rise: 1 + of(62, 0) / 63,
        }
    }
}

/// Friction at rest of the hand's motor, torque units.
const HAND_FRICTION: u32 = 63;

/// Rise above [`Starts::most`] over that below.
const WEDGED_RATE: i16 = 4;

/// Time without a count from which the limit rises, ms.
const PATIENCE_MS: i16 = 50;

/// Counts against the torque that are not a fault yet.
const WRONG: u32 = 4;

/// Further counts without a drive that only a push makes.
const PUSHED: u32 = 2;

/// Time without a count that ends the watch, ms: a push of 5 counts/s or more is recognized. The bridge stays open until then,
/// because a rotor that was pushed still has the energy of the push.
const WATCH_MS: u16 = 200;

/// Counts with the torque that prove the direction.
const RIGHT: u32 = 6;

/// Time without a count that is rest, ms.
const REST_MS: i16 = 100;

/// Time without a count after which nothing changes before the next: the limit has risen to [`Starts::wedged`].
const SETTLED_MS: i16 = 200;
const _: () = assert!(SETTLED_MS > REST_MS);

/// What follows from a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Go on with this torque limit.
    Limit(Torque),
    /// The bridge stays open.
    Open,
    /// The direction is right.
    Right,
    /// The motor runs against its own torque.
    Wrong,
}

/// Counts and torque since the rotor was last at rest, until the direction is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// It has been seen to be right since the start.
    Right,
    /// Not seen yet.
    Unseen {
        /// Count since which it has followed the torque.
        from: i32,
        /// Count at the last tick.
        count: i32,
        /// Torque times counts since then, not below 0.
        work: i32,
        /// Counts against the torque.
        wrong: u32,
        /// Time since the last count.
        still_ms: i16,
        /// The torque limit.
        limit: i16,
    },
    /// The bridge is open since the rotor was at `count`.
    Watching {
        /// Where it opened.
        count: i32,
        /// The count at the last tick.
        last: i32,
        /// Time since the last count.
        ms: u16,
    },
}

impl Direction {
    /// A rotor at rest.
    #[must_use]
    pub const fn at_rest(starts: &Starts, count: i32) -> Self {
        Self::Unseen { from: count, count, work: 0, wrong: 0, still_ms: 0, limit: starts.start.0 }
    }

    /// FIND's: nothing is watched, and the limit is [`Starts::most`].
    #[must_use]
    pub const fn standing(starts: &Starts, count: i32) -> Self {
        Self::Unseen { from: count, count, work: 0, wrong: 0, still_ms: SETTLED_MS, limit: starts.most.0 }
    }

    /// The torque limit until the next step.
    #[must_use]
    pub const fn limit(&self, starts: &Starts) -> Torque {
        match self {
            Self::Right => Torque(i16::MAX),
            Self::Unseen { limit, .. } => Torque(*limit),
            Self::Watching { .. } => starts.start,
        }
    }

    /// Whether a tick without a count changes nothing: the rotor is at rest, and the limit as high as it gets.
    #[inline]
    #[must_use]
    pub const fn is_settled(&self) -> bool {
        matches!(self, Self::Unseen { still_ms: SETTLED_MS.., .. })
    }

    /// Whether it has been seen to be right.
    #[inline]
    #[must_use]
    pub const fn is_right(&self) -> bool {
        matches!(self, Self::Right)
    }

    /// One tick of 1 ms: the hall count and the torque that was applied since the last one.
    #[inline(never)]
    pub fn step(&mut self, starts: &Starts, now: i32, torque: Torque) -> Verdict {
        match self {
            Self::Right => Verdict::Right,
            Self::Watching { count, last, ms } => {
                *ms = if now == *last { *ms + 1 } else { 0 };
                *last = now;
                if *ms < WATCH_MS {
                    return Verdict::Open;
                }
                let pushed = now.wrapping_sub(*count).unsigned_abs() >= PUSHED;
                *self = Self::at_rest(starts, now);
                if pushed { Verdict::Limit(starts.start) } else { Verdict::Wrong }
            }
            Self::Unseen { from, count, work, wrong, still_ms, limit } => {
                let moved = now.wrapping_sub(*count);
                *count = now;
                if moved == 0 {
                    *still_ms = still_ms.saturating_add(1);
                    if *still_ms == REST_MS {
                        // A rotor that came here without its torque was turned.
                        *from = if *work > 0 { *from } else { now };
                        *work = 0;
                    }
                    if *still_ms > PATIENCE_MS {
                        let rise =
                            if *limit < starts.most.0 { starts.rise } else { WEDGED_RATE * starts.rise };
                        *limit = limit.saturating_add(rise).min(starts.wedged);
                    }
                    return Verdict::Limit(Torque(*limit));
                }
                *still_ms = 0;
                *limit = (*limit).min(starts.loose);
                let sum = work.saturating_add(moved.saturating_mul(torque.0.into()));
                *work = sum.max(0);
                if sum < 0 {
                    *wrong += moved.unsigned_abs();
                    *from = now;
                }
                if *wrong > WRONG {
                    *self = Self::Watching { count: now, last: now, ms: 0 };
                    return Verdict::Open;
                }
                if *work > 0 && now.wrapping_sub(*from).unsigned_abs() >= RIGHT {
                    *self = Self::Right;
                    return Verdict::Right;
                }
                Verdict::Limit(Torque(*limit))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hand() -> Starts {
        Starts::new(&Motor::HAND)
    }

    fn run(steps: &[(i32, i16)]) -> (Direction, Verdict) {
        let (mut direction, mut count, mut last) = (Direction::at_rest(&hand(), 0), 0, Verdict::Open);
        for &(moved, torque) in steps {
            count += moved;
            last = direction.step(&hand(), count, Torque(torque));
        }
        (direction, last)
    }

    #[test]
    fn six_counts_with_the_torque_are_right() {
        assert_eq!(run(&[(1, 80); 5]).1, Verdict::Limit(hand().start));
        assert_eq!(run(&[(1, 80); 6]).1, Verdict::Right);
        assert_eq!(run(&[(-1, -80); 6]).1, Verdict::Right);
    }

    #[test]
    fn fifth_count_against_the_torque_opens_the_bridge_and_friction_makes_it_a_fault() {
        assert_eq!(run(&[(-1, 80); 4]).1, Verdict::Limit(hand().start));
        let (mut direction, verdict) = run(&[(-1, 80); 5]);
        assert_eq!(verdict, Verdict::Open);
        for _ in 0..WATCH_MS {
            assert_eq!(direction.step(&hand(), -6, Torque::ZERO), Verdict::Open);
        }
        assert_eq!(direction.step(&hand(), -6, Torque::ZERO), Verdict::Wrong);
    }

    #[test]
    fn pushed_rotor_is_no_fault() {
        let (mut direction, _) = run(&[(-1, 80); 5]);
        for _ in 0..WATCH_MS {
            assert_eq!(direction.step(&hand(), -7, Torque::ZERO), Verdict::Open);
        }
        assert_eq!(direction.step(&hand(), -7, Torque::ZERO), Verdict::Limit(hand().start));
    }

    #[test]
    fn braking_after_an_acceleration_is_right_and_rocking_proves_nothing() {
        let mut braking = [(1, 80); 13];
        braking[5..].fill((1, -10));
        assert!(run(&braking).0.is_right());
        assert_eq!(run([[(1, 80), (-1, -80)]; 20].as_flattened()).1, Verdict::Limit(hand().start));
    }

    #[test]
    fn motor_that_rests_at_every_count_proves_it_as_well() {
        let rests = |moved: i32, torque: i16| {
            let mut steps = [(0, torque); 1 + REST_MS as usize];
            steps[0].0 = moved;
            steps
        };
        assert!(run([rests(1, 125); 6].as_flattened()).0.is_right());
        let back =
            [rests(1, 125), rests(1, 125), rests(1, 125), rests(-1, 125), rests(1, 125), rests(1, 125)];
        assert!(
            !run([back, back].as_flattened().as_flattened()).0.is_right(),
            "a count against the torque begins anew"
        );
        assert!(!run([rests(1, 0); 6].as_flattened()).0.is_right(), "it is turned by hand");
    }

    #[test]
    fn rotor_that_is_turned_without_torque_proves_nothing() {
        assert_eq!(run(&[(1, 0); 20]).1, Verdict::Limit(hand().start));
    }

    #[test]
    fn limit_rises_while_the_rotor_stands() {
        let (mut direction, mut most) = (Direction::at_rest(&hand(), 0), hand().start);
        for ms in 1..=SETTLED_MS {
            let Verdict::Limit(limit) = direction.step(&hand(), 0, Torque(86)) else {
                panic!("{direction:?}")
            };
            let slow = (hand().start.0 + (ms - PATIENCE_MS).max(0)).min(hand().most.0);
            let fast = WEDGED_RATE * (ms - PATIENCE_MS - (hand().most.0 - hand().start.0)).max(0);
            assert_eq!(limit, Torque((slow + fast).min(hand().wedged)), "after {ms} ms");
            most = limit;
        }
        assert_eq!(most, Torque(hand().wedged));
        assert!(direction.is_settled());
        assert_eq!(
            direction.step(&hand(), 1, Torque(700)),
            Verdict::Limit(Torque(hand().loose)),
            "it has come loose"
        );
    }
}
