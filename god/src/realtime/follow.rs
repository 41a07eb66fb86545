//! A tip that follows its link in RealTime (decision 0030): by position, because a share of the link's velocity alone is less torque than the
//! friction of a tip at low speed, and loses what it rounds.
//!
//! ```text
//! e = lead + 13/49·link − tip       lead: as at the start of LOOP, so that nothing drifts
//! v = 13/49·v_link + KP·e + KI·∫e   within ± the velocity that the host wants of the link
//! ```
//!
//! The bound keeps a tip from pushing harder than its link: in mode 4 torque is gain × velocity error. A link that stalls while it closes has
//! met an object: its tip goes on alone, as after a breakaway, at the share of what the host wants of the link. It keeps its lead once the link
//! moves again. A tip that is blocked (its stop, an object) gives its lag up, but a few counts.

/// The tip's share of its link's travel, hall counts: 13/49 ([`units::tip_travel_along`](crate::units::tip_travel_along)).
const SHARE: i64 = 13;
const OF: i64 = 49;

/// Gain, 1/s: a lag decays in 0.1 s. The boards' velocity loop is ten times faster.
const KP: i64 = 10;

/// Integral gain, 1/s²: friction is compensated within 0.3 s.
const KI: i64 = 30;

const MS_PER_S: i64 = 1000;
const US_PER_S: i64 = 1_000_000;

/// Bound of the tip's velocity while its link is to stand, counts/s: the last counts, at three times the droop of friction (63/1024) under
/// the default gain.
const SETTLE: i64 = 100;

/// Longest step, ms: after a longer pause of the link's answers the integral does not jump.
const MAX_STEP_MS: i64 = 50;

/// Greatest lag that a tip alone, or one that is blocked, keeps, counts: below it a slow tip lags for other reasons.
const MAX_LAG: i64 = 4;

/// Time without a count after which a tip that lags is blocked, ms: the default of TSTOP.
const BLOCKED_MS: i64 = 300;

/// Travel of a link that moves again after it has stalled, counts.
const FREE: i64 = 2;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coupling {
    Coupled,
    /// The link has stalled here.
    Alone {
        link: i64,
        /// What the link would have moved since, counts · µs/s.
        travel: i64,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Follower {
    /// Of the tip before its share of the link's position, 1/49 counts.
    lead: i64,
    /// 1/49 counts · ms.
    integral: i64,
    coupling: Coupling,
    /// Where the tip was, counts, and for how long, ms.
    still: (i64, i64),
}

/// Positions, counts, and velocities, counts/s.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Finger {
    pub link: i64,
    pub link_velocity: i64,
    pub tip: i64,
    /// What the host wants of the link.
    pub wanted: i64,
}

impl Follower {
    pub const fn new(link: i64, tip: i64) -> Self {
        Self { lead: OF * tip - SHARE * link, integral: 0, coupling: Coupling::Coupled, still: (tip, 0) }
    }

    /// The tip's velocity, counts/s, `step_us` after the last call.
    pub fn step(&mut self, finger: Finger, step_us: u64) -> i64 {
        let Finger { link, tip, wanted, .. } = finger;
        let step_ms = i64::try_from(step_us / 1000).unwrap_or(MAX_STEP_MS).min(MAX_STEP_MS);
        if let Coupling::Alone { link: stalled, travel } = self.coupling {
            if (link - stalled).abs() >= FREE || wanted <= 0 {
                *self = Self::new(link, tip);
            } else if self.error(finger) < MAX_LAG * OF {
                let travel = travel + wanted * step_ms * (US_PER_S / MS_PER_S);
                self.coupling = Coupling::Alone { link: stalled, travel };
            }
        }
        let still_ms = if self.still.0 == tip { self.still.1 + step_ms } else { 0 };
        self.still = (tip, still_ms);
        if still_ms >= BLOCKED_MS {
            self.give_up_lag(finger);
        }
        let error = self.error(finger);
        if wanted == 0 && error.abs() < OF {
            self.integral = 0;
            return 0;
        }
        let ahead = match self.coupling {
            Coupling::Coupled => finger.link_velocity,
            Coupling::Alone { .. } => wanted,
        };
        let bound = wanted.abs().max(SETTLE);
        let integral = self.integral + error * step_ms;
        let velocity = (SHARE * ahead + KP * error + KI * integral / MS_PER_S) / OF;
        // The integral stands while the velocity is at its bound.
        if velocity.abs() <= bound {
            self.integral = integral;
        }
        velocity.clamp(-bound, bound)
    }

    /// The link has stalled.
    pub fn link_stalled(&mut self, finger: Finger) {
        if self.coupling == Coupling::Coupled && finger.wanted > 0 {
            *self = Self {
                coupling: Coupling::Alone { link: finger.link, travel: 0 },
                ..Self::new(finger.link, finger.tip)
            };
        }
    }

    fn give_up_lag(&mut self, finger: Finger) {
        let error = self.error(finger);
        let kept = error.clamp(-MAX_LAG * OF, MAX_LAG * OF);
        if kept != error {
            self.lead -= error - kept;
            self.integral = 0;
        }
    }

    /// 1/49 counts.
    const fn error(&self, finger: Finger) -> i64 {
        let alone = match self.coupling {
            Coupling::Coupled => 0,
            Coupling::Alone { travel, .. } => SHARE * travel / US_PER_S,
        };
        self.lead + SHARE * finger.link + alone - OF * finger.tip
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units;
    use std::vec::Vec;

    const STEP_US: u64 = 10_000;

    /// A tip without inertia that misses `droop` of its velocity by friction.
    struct Tip {
        at: f64,
        droop: f64,
        stop: f64,
    }

    impl Tip {
        fn run(&mut self, velocity: i64) {
            let wanted = velocity as f64;
            let moved = (wanted.abs() - self.droop).max(0.0) * wanted.signum();
            self.at = (self.at + moved * STEP_US as f64 / 1e6).min(self.stop);
        }
    }

    /// Runs a link at velocities, each for a second. Returns the errors of the tip, counts.
    fn errors(follower: &mut Follower, tip: &mut Tip, velocities: &[i64]) -> Vec<f64> {
        let (mut link, mut found, from) = (0.0, Vec::new(), tip.at);
        for &velocity in velocities {
            for _ in 0..100 {
                link += velocity as f64 * STEP_US as f64 / 1e6;
                let finger = Finger {
                    link: link as i64,
                    link_velocity: velocity,
                    tip: tip.at as i64,
                    wanted: velocity,
                };
                let v = follower.step(finger, STEP_US);
                tip.run(v);
                found.push(from + link * 13.0 / 49.0 - tip.at);
            }
        }
        found
    }

    #[test]
    fn share_is_that_of_the_other_commands() {
        for link in -400..400 {
            assert!((units::tip_travel_along(link) * OF - SHARE * link).abs() <= OF, "{link}");
        }
    }

    #[test]
    fn tip_stays_within_three_counts_of_its_share_and_does_not_drift() {
        for velocity in [40, 80, 200, 1000] {
            let mut tip = Tip { at: 7.0, droop: 32.0, stop: 1e9 };
            let mut follower = Follower::new(0, 7);
            // Back and forth ten times, with a stop at each end.
            let way: Vec<i64> = (0..10).flat_map(|_| [velocity, 0, -velocity, 0]).collect();
            let found = errors(&mut follower, &mut tip, &way);
            let most = found.iter().fold(0.0_f64, |most, error| most.max(error.abs()));
            assert!(most < 4.0, "{velocity}: {most}");
            // The end of each stop.
            for stop in found.chunks(200).map(|part| part[199]) {
                assert!(stop.abs() < 2.0, "{velocity}: {stop}");
            }
        }
    }

    #[test]
    fn velocity_stays_within_what_the_host_wants_of_the_link() {
        let mut follower = Follower::new(0, 0);
        for step in 0..1000 {
            let finger = Finger { link: step * 10, link_velocity: 1000, tip: 0, wanted: 300 };
            assert!(follower.step(finger, STEP_US).abs() <= 300);
        }
    }

    #[test]
    fn tip_that_is_blocked_by_its_stop_follows_back_from_there() {
        let mut tip = Tip { at: 0.0, droop: 32.0, stop: 20.0 };
        let mut follower = Follower::new(0, 0);
        // The link goes to 600 and back to 400: the tip's share of the way back is 53.
        errors(&mut follower, &mut tip, &[200, 200, 200, -200]);
        let lag = tip.at - (20.0 - 53.0);
        assert!((0.0..=4.0 + 4.0).contains(&lag), "{}", tip.at);
    }

    #[test]
    fn tip_of_a_closing_link_that_stalls_goes_on_alone_until_the_link_moves() {
        let mut tip = Tip { at: 0.0, droop: 32.0, stop: 1e9 };
        let mut follower = Follower::new(100, 0);
        let stalled = |tip: &Tip| Finger { link: 100, link_velocity: 0, tip: tip.at as i64, wanted: 196 };
        follower.link_stalled(stalled(&tip));
        for _ in 0..200 {
            let v = follower.step(stalled(&tip), STEP_US);
            tip.run(v);
        }
        assert!((tip.at - 104.0).abs() < 2.0, "196 · 13/49 · 2 s is 104, but {}", tip.at);
        let back = Finger { link: 97, link_velocity: -100, tip: tip.at as i64, wanted: -100 };
        assert!(follower.step(back, STEP_US) <= 0);
        let mut opening = Follower::new(0, 0);
        opening.link_stalled(Finger { link: 0, link_velocity: 0, tip: 0, wanted: -100 });
        assert_eq!(opening, Follower::new(0, 0), "at its open stop");
    }

    const fn at(link: i64, link_velocity: i64, tip: i64, wanted: i64) -> Finger {
        Finger { link, link_velocity, tip, wanted }
    }

    /// e = 13·link − 49·tip (+ lead), v = (13·v_link + 10·e + 30·∫e/1000)/49.
    #[test]
    fn step_is_the_law_of_the_head_of_this_file() {
        let finger = at(49, 98, 10, 500);
        for (step_us, integral_ms) in [(10_000, 10), (20_000, 20), (50_000, 50), (50_999, 50), (70_000, 50)] {
            let mut follower = Follower::new(0, 0);
            for count in 1..=3 {
                let expected = (13 * 98 + 10 * 147 + 30 * 147 * integral_ms * count / 1000) / 49;
                assert_eq!(follower.step(finger, step_us), expected, "{step_us} {count}");
            }
        }
        // 3 counts of lead at the start stay: e is 3 counts less.
        let mut leading = Follower::new(7, 5);
        assert_eq!(leading.step(at(7, 0, 5, 100), STEP_US), 0);
        assert_eq!(leading.step(at(7 + 49, 0, 5, 300), STEP_US), (10 * 637 + 30 * 6370 / 1000) / 49);
        assert_eq!(leading.step(at(7, 0, 5 + 2, 100), STEP_US), (-10 * 98 + 30 * (6370 - 980) / 1000) / 49);
    }

    #[test]
    fn standing_link_leaves_less_than_a_count() {
        // 13 · 15 − 49 · 3 is 48; a count is 49.
        for (finger, expected) in [
            (at(15, 0, 3, 0), 0),
            (at(-15, 0, -3, 0), 0),
            (at(0, 0, -1, 0), (490 + 14) / 49),
            (at(0, 0, 1, 0), -(490 + 14) / 49),
            (at(15, 0, 3, 1), (480 + 14) / 49),
        ] {
            assert_eq!(Follower::new(0, 0).step(finger, STEP_US), expected, "{finger:?}");
        }
        let mut follower = Follower::new(0, 0);
        follower.step(at(147, 0, 0, 1000), STEP_US);
        follower.step(at(0, 0, 0, 0), STEP_US);
        assert_eq!(follower.step(at(0, 0, 0, 1), STEP_US), 0, "the integral is empty");
    }

    #[test]
    fn velocity_at_its_bound_does_not_wind_up() {
        for (wanted, bound) in [(0, SETTLE), (-30, SETTLE), (99, SETTLE), (101, 101), (-250, 250)] {
            let mut follower = Follower::new(0, 0);
            for _ in 0..20 {
                assert_eq!(follower.step(at(490, 0, 0, wanted), STEP_US), bound, "{wanted}");
            }
            assert_eq!(follower.integral, 0, "{wanted}");
            assert_eq!(Follower::new(0, 0).step(at(-490, 0, 0, wanted), STEP_US), -bound, "{wanted}");
        }
    }

    #[test]
    fn blocked_tip_keeps_four_counts_of_lag_after_300_ms() {
        // 13 counts, and 4.
        for (link, kept) in [(49, 4 * 49), (-49, -4 * 49), (14, 13 * 14)] {
            let mut follower = Follower::new(0, 0);
            let finger = at(link, 0, 0, 1000);
            for _ in 0..29 {
                follower.step(finger, STEP_US);
            }
            assert_eq!(follower.error(finger), 13 * link, "290 ms");
            follower.step(finger, STEP_US);
            assert_eq!(follower.error(finger), kept, "300 ms");
        }
        let mut moving = Follower::new(0, 0);
        for tip in 0..60 {
            moving.step(at(490, 0, tip / 29, 1000), STEP_US);
        }
        assert_eq!(moving.error(at(490, 0, 0, 0)), 6370, "a count comes each 290 ms");
    }

    #[test]
    fn tip_alone_goes_at_its_share_until_it_lags_or_the_link_moves() {
        let stalled = at(100, 0, 20, 196);
        let alone = || {
            let mut follower = Follower::new(100, 20);
            follower.link_stalled(stalled);
            follower
        };
        // 13 · 196 counts/s for 10 ms are 25/49 counts.
        let mut follower = alone();
        assert_eq!(follower.step(stalled, STEP_US), (13 * 196 + 10 * 25 + 30 * 250 / 1000) / 49);
        assert_eq!(follower.error(stalled), 25);
        follower.step(stalled, STEP_US);
        assert_eq!(follower.error(stalled), 50);
        for _ in 0..27 {
            follower.step(stalled, STEP_US);
        }
        assert_eq!(follower.error(stalled), 203, "no further than 196 and a step");
        follower.link_stalled(at(100, 0, 20, 50));
        assert_eq!(follower.error(stalled), 203, "it goes on");
        for (finger, is_alone) in [
            (at(101, 0, 20, 196), true),
            (at(99, 0, 20, 196), true),
            (at(102, 0, 20, 196), false),
            (at(98, 0, 20, 196), false),
            (at(100, 0, 20, 1), true),
            (at(100, 0, 20, 0), false),
            (at(100, 0, 20, -1), false),
        ] {
            let mut follower = alone();
            follower.step(finger, STEP_US);
            assert_eq!(follower.coupling != Coupling::Coupled, is_alone, "{finger:?}");
        }
        let mut standing = Follower::new(100, 20);
        standing.link_stalled(at(100, 0, 20, 0));
        assert_eq!(standing.coupling, Coupling::Coupled, "nothing is wanted of the link");
    }
}
