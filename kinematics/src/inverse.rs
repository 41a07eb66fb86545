//! Joint angles for a fingertip's place: closed, all of them.
//!
//! A finger moves in a plane through its spread axis. The spread turns that plane through the target, from one side or from the other;
//! in the plane, link and tip are two bars, and their elbow bends to one side or to the other. So there are up to four solutions, or two
//! at a given spread, of which those within the joints' ranges count.

use core::f64::consts::{FRAC_PI_2, PI, TAU};
use core::fmt;

use crate::hand::{Angles, Finger, Hand};
use crate::transform::Vector;

/// How far a target may be off the finger's plane, or out of its reach, and count as reached, m: a thousandth of a hall count's travel.
const TOLERANCE_M: f64 = 1e-6;

/// How far an angle may be out of its range and count as its end, rad. The bend of stretched bars is exact to 2e-8, √(2·2⁻⁵²).
const TOLERANCE_RAD: f64 = 1e-7;

/// A finger's joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Joint {
    /// Θ_1.
    Spread,
    /// Θ_2.
    Link,
    /// Θ_3.
    Tip,
}

/// Why a fingertip cannot be there: the worst obstacle of the way whose worst obstacle is least. An angle out of its range is less than
/// a place out of reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unreachable {
    /// A figure of the hand is outside what [`Hand`] says of it.
    BadFigure {
        /// Its field.
        field: &'static str,
        /// Its value.
        found: f64,
        /// The least and the largest that it may be.
        expected: [f64; 2],
    },
    /// The target has a coordinate that is no number.
    NotFinite,
    /// The given spread is no number.
    SpreadNotFinite,
    /// The finger's plane, which finger 3 or a given spread fixes, misses the target.
    OffPlane {
        /// The distance, m.
        by_m: f64,
    },
    /// Farther from the link's joint than the stretched finger.
    TooFar {
        /// The distance that remains, m.
        by_m: f64,
    },
    /// Nearer to the link's joint than the folded finger.
    TooNear {
        /// The distance that remains, m.
        by_m: f64,
    },
    /// Only with a joint out of its range.
    OutOfRange {
        /// The joint.
        joint: Joint,
        /// Its angle beyond the end of the range, rad.
        by: f64,
    },
}

impl Unreachable {
    /// First by how far the search came, then by the amount.
    const fn badness(&self) -> (u8, f64) {
        match *self {
            Self::OutOfRange { by, .. } => (0, by),
            Self::TooFar { by_m } | Self::TooNear { by_m } => (1, by_m),
            Self::OffPlane { by_m } => (2, by_m),
            Self::BadFigure { .. } | Self::NotFinite | Self::SpreadNotFinite => (3, 0.0),
        }
    }

    /// Of two obstacles on the same way, the one that counts.
    fn worse(self, other: Self) -> Self {
        if self.badness() > other.badness() { self } else { other }
    }
}

impl fmt::Display for Unreachable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::BadFigure { field, found, expected: [low, high] } => {
                write!(f, "the hand's {field} is {found:e}, expected {low:e} to {high:e}; correct the field")
            }
            Self::NotFinite => f.write_str("the target is not finite; give three numbers in meters"),
            Self::SpreadNotFinite => f.write_str("the spread is not finite; give a number in radians"),
            Self::OffPlane { by_m } => {
                write!(f, "the target is {} off the finger's plane", Amount(by_m, 1e3, "mm"))
            }
            Self::TooFar { by_m } => {
                write!(f, "the target is {} beyond the finger's reach", Amount(by_m, 1e3, "mm"))
            }
            Self::TooNear { by_m } => {
                write!(
                    f,
                    "the target is {} nearer to the link's joint than the finger folds",
                    Amount(by_m, 1e3, "mm")
                )
            }
            Self::OutOfRange { joint, by } => {
                let name = match joint {
                    Joint::Spread => "spread",
                    Joint::Link => "link",
                    Joint::Tip => "tip",
                };
                let amount = Amount(by, 1.0_f64.to_degrees(), "degrees");
                write!(f, "the {name} would be {amount} out of its range")
            }
        }
    }
}

/// A number, how many of the unit make one of it, and the unit. Never printed as `inf`, nor with hundreds of digits.
struct Amount(f64, f64, &'static str);

impl fmt::Display for Amount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(amount, scale, unit) = *self;
        let amount = (amount * scale).min(f64::MAX);
        if amount < 1e6 { write!(f, "{amount:.2} {unit}") } else { write!(f, "{amount:.2e} {unit}") }
    }
}

impl core::error::Error for Unreachable {}

/// The ways to reach a place: at least one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solutions {
    first: Angles,
    others: [Option<Angles>; 3],
}

impl Solutions {
    /// All of them, each within the ranges.
    pub fn iter(&self) -> impl Iterator<Item = Angles> + '_ {
        core::iter::once(self.first).chain(self.others.iter().flatten().copied())
    }

    /// The one with the least change of the joint that changes most.
    #[must_use]
    pub fn nearest(&self, to: Angles) -> Angles {
        let nearer = |best: Angles, angles: Angles| {
            if angles.most_change(to) < best.most_change(to) { angles } else { best }
        };
        self.iter().fold(self.first, nearer)
    }
}

/// Solutions found so far, and the best reason of those that failed.
struct Search {
    found: [Option<Angles>; 4],
    failed: Unreachable,
}

impl Search {
    const fn new() -> Self {
        Self { found: [None; 4], failed: Unreachable::NotFinite }
    }

    fn fail(&mut self, why: Unreachable) {
        let ((rank, amount), (best_rank, best)) = (why.badness(), self.failed.badness());
        if rank < best_rank || (rank == best_rank && amount < best) {
            self.failed = why;
        }
    }

    fn add(&mut self, angles: Angles) {
        // Stretched and folded bars bend to either side alike.
        if self.found.iter().flatten().any(|found| found.most_change(angles) <= TOLERANCE_RAD) {
            return;
        }
        if let Some(free) = self.found.iter_mut().find(|found| found.is_none()) {
            *free = Some(angles);
        }
    }

    fn end(self) -> Result<Solutions, Unreachable> {
        let mut found = self.found.into_iter().flatten();
        let first = found.next().ok_or(self.failed)?;
        Ok(Solutions { first, others: core::array::from_fn(|_| found.next()) })
    }
}

/// An angle clamped to a range within the tolerance.
fn within(angle: f64, [low, high]: [f64; 2], joint: Joint) -> Result<f64, Unreachable> {
    let by = (low - angle).max(angle - high);
    if by > TOLERANCE_RAD { Err(Unreachable::OutOfRange { joint, by }) } else { Ok(angle.max(low).min(high)) }
}

/// The turn of an angle that is nearest to the middle of a range, clamped to it within the tolerance.
fn in_range(angle: f64, range: [f64; 2], joint: Joint) -> Result<f64, Unreachable> {
    let turns = libm::round((angle - 0.5 * (range[0] + range[1])) / TAU);
    within(angle - turns * TAU, range, joint)
}

impl Hand {
    /// The joint angles that bring a fingertip's point to `target`, in the frame of the palm, m. Of finger 3 the spread is 0. Within a
    /// micrometer of a spread axis any spread would do; it is a right angle there, or the end of the range nearest to one.
    ///
    /// # Errors
    /// No angles within the ranges do; `NotFinite`, and `BadFigure` of a hand that cannot be.
    pub fn inverse(&self, finger: Finger, target: Vector) -> Result<Solutions, Unreachable> {
        if !finger.spreads() {
            return self.inverse_at_spread(finger, 0.0, target);
        }
        self.check(target)?;
        let mut search = Search::new();
        let (x, y) = (target[0] - finger.side() * self.spread_axis_m, target[1]);
        let reach = libm::hypot(x, y);
        if reach <= TOLERANCE_M {
            let [low, high] = self.spread.range();
            self.bend(&mut search, FRAC_PI_2.max(low).min(high), 0.0, target[2]);
            return search.end();
        }
        for (turn, along) in [(0.0, reach), (PI, -reach)] {
            let spread = (libm::atan2(y, x) + turn - finger.azimuth()) * finger.side();
            match in_range(spread, self.spread.range(), Joint::Spread) {
                Ok(spread) => self.bend(&mut search, spread, along, target[2]),
                Err(why) => {
                    // The spread alone is to blame only if the finger then reaches.
                    let mut beyond = Search::new();
                    self.bend(&mut beyond, spread, along, target[2]);
                    search.fail(beyond.end().map_or_else(|bend| bend.worse(why), |_| why));
                }
            }
        }
        search.end()
    }

    /// The same with the spread given in rad, as the other finger needs it. Finger 3 ignores it and returns it as 0.
    ///
    /// # Errors
    /// No angles within the ranges do, the given spread first; `OffPlane` if it points elsewhere. `SpreadNotFinite`, and as of
    /// [`Hand::inverse`].
    pub fn inverse_at_spread(
        &self,
        finger: Finger,
        spread: f64,
        target: Vector,
    ) -> Result<Solutions, Unreachable> {
        self.check(target)?;
        let spread = match finger.spreads() {
            true if !spread.is_finite() => return Err(Unreachable::SpreadNotFinite),
            // A joint's angle, of which no turns are taken off.
            true => within(spread, self.spread.range(), Joint::Spread)?,
            false => 0.0,
        };
        let (x, y) = (target[0] - finger.side() * self.spread_axis_m, target[1]);
        let (sin, cos) = libm::sincos(finger.azimuth() + finger.side() * spread);
        let off = (y * cos - x * sin).abs().min(f64::MAX);
        if off > TOLERANCE_M {
            return Err(Unreachable::OffPlane { by_m: off });
        }
        let mut search = Search::new();
        self.bend(&mut search, spread, x * cos + y * sin, target[2]);
        search.end()
    }

    /// The first bad figure, else whether the target is one.
    fn check(&self, target: Vector) -> Result<(), Unreachable> {
        for (field, found, expected) in self.figures() {
            if !(expected[0]..=expected[1]).contains(&found) {
                return Err(Unreachable::BadFigure { field, found, expected });
            }
        }
        if target.iter().all(|x| x.is_finite()) { Ok(()) } else { Err(Unreachable::NotFinite) }
    }

    /// Link and tip as two bars from the link's joint; the second leads to the pad. `along`: from the spread axis, `up`: from the
    /// mounting face, m. With bars l_2 and l_3 and the distance r, the bend is ±acos((r² - l_2² - l_3²) / (2·l_2·l_3)).
    fn bend(&self, search: &mut Search, spread: f64, along: f64, up: f64) {
        let (u, v) = (along - self.base_m, up - self.palm_m);
        let (l2, l3) = (self.link_m, libm::hypot(self.tip_m, self.pad_m));
        // Of a target near the largest number it overflows.
        let r = libm::hypot(u, v).min(f64::MAX);
        let (beyond, within) = (r - (l2 + l3), (l2 - l3).abs() - r);
        if beyond > TOLERANCE_M {
            return search.fail(Unreachable::TooFar { by_m: beyond });
        }
        if within > TOLERANCE_M {
            return search.fail(Unreachable::TooNear { by_m: within });
        }
        let cos = (r * r - l2 * l2 - l3 * l3) / (2.0 * l2 * l3);
        let bend = libm::acos(cos.clamp(-1.0, 1.0));
        for bend in [bend, -bend] {
            let (sin, cos) = libm::sincos(bend);
            let link = libm::atan2(v, u) - libm::atan2(l3 * sin, l2 + l3 * cos) - self.link_at_zero;
            let tip = bend - self.tip_at_zero - libm::atan2(self.pad_m, self.tip_m);
            let link = in_range(link, self.link.range(), Joint::Link);
            match (link, in_range(tip, self.tip.range(), Joint::Tip)) {
                (Ok(link), Ok(tip)) => search.add(Angles { spread, link, tip }),
                // Both count: the worse one is the reason.
                (Err(link), Err(tip)) => search.fail(link.worse(tip)),
                (Err(why), _) | (_, Err(why)) => search.fail(why),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::hand::Drive;
    use crate::transform::minus;

    fn distance(a: Vector, b: Vector) -> f64 {
        minus(a, b).iter().fold(0.0, |sum, x| libm::hypot(sum, *x))
    }

    fn share(range: [f64; 2], part: f64) -> f64 {
        range[0] + part * (range[1] - range[0])
    }

    fn is_within(range: [f64; 2], angle: f64) -> bool {
        (range[0]..=range[1]).contains(&angle)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn inverse_of_any_pose_returns_it_among_ways_to_the_same_place(
            finger in prop::sample::select(&Finger::ALL),
            spread in 0.0..=1.0, link in 0.0..=1.0, tip in 0.0..=1.0,
        ) {
            let hand = Hand::default();
            let spread = if finger.spreads() { share(hand.spread.range(), spread) } else { 0.0 };
            let angles = Angles { spread, link: share(hand.link.range(), link), tip: share(hand.tip.range(), tip) };
            let target = hand.fingertip(finger, angles).origin;
            let side = libm::hypot(target[0] - finger.side() * hand.spread_axis_m, target[1]);
            for found in [hand.inverse(finger, target), hand.inverse_at_spread(finger, spread, target)] {
                let found = found.expect("a pose within the ranges is reachable");
                for way in found.iter() {
                    prop_assert!(is_within(hand.link.range(), way.link) && is_within(hand.tip.range(), way.tip));
                    prop_assert!(is_within(hand.spread.range(), way.spread));
                    // The tolerance of a range's end, at the length of a finger; of a place, on the spread axis.
                    let most = if finger.spreads() && side <= TOLERANCE_M { 2e-6 } else { 3e-8 };
                    prop_assert!(distance(hand.fingertip(finger, way).origin, target) < most, "{:?}", way);
                }
                let back = found.nearest(angles);
                // Where the finger is nearly straight, or near the spread axis, angles are worse conditioned than places.
                let bend = angles.tip + hand.tip_at_zero + libm::atan2(hand.pad_m, hand.tip_m);
                if libm::sin(bend).abs() > 1e-3 && (side > 1e-3 || !finger.spreads()) {
                    let by = [back.spread - spread, back.link - angles.link, back.tip - angles.tip];
                    prop_assert!(by.iter().all(|by| by.abs() < 1e-6), "{:?} {:?}", back, angles);
                }
            }
        }

        #[test]
        fn inverse_of_any_place_reaches_it_or_says_how_far_it_is(
            finger in prop::sample::select(&Finger::ALL),
            x in -0.25..0.25, y in -0.25..0.25, z in -0.15..0.3,
        ) {
            let hand = Hand::default();
            let target = [if finger.spreads() { x } else { 0.0 }, y, z];
            let most = hand.link_m + libm::hypot(hand.tip_m, hand.pad_m);
            match hand.inverse(finger, target) {
                Ok(ways) => for way in ways.iter() {
                    // Farther away than in the other test: TOLERANCE_M.
                    prop_assert!(distance(hand.fingertip(finger, way).origin, target) < 2e-6);
                },
                Err(Unreachable::TooFar { by_m }) => {
                    // The nearer side of the spread axis decides.
                    let [x, y] = [target[0] - finger.side() * hand.spread_axis_m, target[1]];
                    let along = if finger.spreads() { libm::hypot(x, y) } else { y };
                    let nearest = libm::hypot(along - hand.base_m, z - hand.palm_m);
                    prop_assert!(by_m > 0.0 && by_m >= nearest - most - 1e-12);
                }
                Err(Unreachable::TooNear { by_m }) => prop_assert!(by_m > 0.0 && by_m < 0.02),
                Err(Unreachable::OutOfRange { by, .. }) => prop_assert!(by > 0.0 && by <= PI),
                Err(why) => prop_assert!(false, "{}", why),
            }
        }

        #[test]
        fn inverse_of_a_place_beyond_the_stretched_finger_is_too_far_by_the_rest(
            finger in prop::sample::select(&Finger::ALL),
            x in -0.5..0.5, y in -0.5..0.5, z in -0.5..0.5,
        ) {
            let hand = Hand::default();
            let [x, y] = if finger.spreads() { [x, y] } else { [0.0, y] };
            let along = if finger.spreads() { libm::hypot(x - finger.side() * hand.spread_axis_m, y) } else { y };
            let most = hand.link_m + libm::hypot(hand.tip_m, hand.pad_m);
            // The side that faces the place; the other is farther away.
            let rest = libm::hypot(along - hand.base_m, z - hand.palm_m) - most;
            prop_assume!(rest > 1e-5);
            match hand.inverse(finger, [x, y, z]) {
                Err(Unreachable::TooFar { by_m }) => prop_assert!((by_m - rest).abs() < 1e-12, "{by_m} {rest}"),
                other => prop_assert!(false, "{other:?}"),
            }
        }

        #[test]
        fn inverse_succeeds_once_all_ranges_are_wider_by_what_the_error_says_and_no_sooner(
            finger in prop::sample::select(&Finger::ALL),
            x in -0.2..0.2, y in -0.2..0.2, z in -0.05..0.2,
        ) {
            let hand = Hand::default();
            let target = [if finger.spreads() { x } else { 0.0 }, y, z];
            if let Err(Unreachable::OutOfRange { by, .. }) = hand.inverse(finger, target) {
                let wider = |by: f64| {
                    let drive = |drive: Drive| {
                        let [low, high] = drive.range_counts;
                        Drive { range_counts: [low - drive.counts(by), high + drive.counts(by)], ..drive }
                    };
                    Hand { link: drive(hand.link), spread: drive(hand.spread), tip: drive(hand.tip), ..hand }
                };
                prop_assert!(wider(by).inverse(finger, target).is_ok(), "{by}");
                prop_assert!(wider(by - 1e-6).inverse(finger, target).is_err(), "{by}");
            }
        }
    }

    #[test]
    fn inverse_names_what_keeps_the_fingertip_away() {
        let hand = Hand::default();
        let why = |finger, target| hand.inverse(finger, target).expect_err("it is out of reach");
        assert_eq!(why(Finger::F3, [0.0, f64::NAN, 0.1]), Unreachable::NotFinite);
        let Unreachable::OffPlane { by_m } = why(Finger::F3, [0.01, 0.1, 0.1]) else {
            panic!("beside finger 3");
        };
        assert!((by_m - 0.01).abs() < 1e-12, "{by_m}");
        let most = hand.link_m + libm::hypot(hand.tip_m, hand.pad_m);
        let Unreachable::TooFar { by_m } = why(Finger::F3, [0.0, 0.05, 0.076 + most + 0.01]) else {
            panic!("above the stretched finger");
        };
        assert!((by_m - 0.01).abs() < 1e-12, "{by_m}");
        let Unreachable::TooNear { by_m } = why(Finger::F3, [0.0, 0.05, 0.076]) else {
            panic!("the link's joint");
        };
        assert!((by_m - (2.0 * hand.link_m - most)).abs() < 1e-12, "{by_m}");
        // Below the palm, with the link bent back.
        let below = why(Finger::F3, [0.0, 0.06, -0.02]);
        assert!(matches!(below, Unreachable::OutOfRange { joint: Joint::Link, .. }), "{below:?}");
        assert!(format_of(below).starts_with("the link would be "), "{below}");
        // Opposite to where finger 1 can spread, beyond its reach back over the axis.
        let aside = why(Finger::F1, [0.12, 0.0, 0.1]);
        assert!(matches!(aside, Unreachable::OutOfRange { joint: Joint::Spread, .. }), "{aside:?}");
        // Ten meters in front of finger 1, where another spread would not help.
        let Unreachable::TooFar { by_m } = why(Finger::F1, [-10.0, 0.0, 0.1]) else {
            panic!("ten meters away");
        };
        let rest = libm::hypot(10.0 - 0.025 - 0.05, 0.1 - 0.076) - most;
        assert!((by_m - rest).abs() < 1e-12, "{by_m} {rest}");
    }

    fn format_of(why: Unreachable) -> std::string::String {
        std::string::ToString::to_string(&why)
    }

    #[test]
    fn inverse_at_another_spread_is_off_plane() {
        let hand = Hand::default();
        let target = hand.fingertip(Finger::F2, Angles { spread: 1.0, link: 1.0, tip: 0.5 }).origin;
        assert!(hand.inverse_at_spread(Finger::F2, 1.0, target).is_ok());
        let why = hand.inverse_at_spread(Finger::F2, 1.1, target).expect_err("it points elsewhere");
        assert!(matches!(why, Unreachable::OffPlane { .. }), "{why:?}");
    }

    #[test]
    fn inverse_on_the_spread_axis_spreads_by_a_right_angle() {
        let hand = Hand::default();
        for finger in [Finger::F1, Finger::F2] {
            for off in [0.0, 1e-320, -1e-9, 9e-7] {
                let target = [finger.side() * hand.spread_axis_m, off, 0.17];
                let ways = hand.inverse(finger, target).expect("above the palm");
                for way in ways.iter() {
                    assert!((way.spread - FRAC_PI_2).abs() < 1e-12, "{off} {way:?}");
                    assert!(distance(hand.fingertip(finger, way).origin, target) < off.abs() + 1e-12);
                }
            }
            let low = Hand { spread: Drive { range_counts: [0.0, 50.0], ..hand.spread }, ..hand };
            let target = [finger.side() * hand.spread_axis_m, 0.0, 0.17];
            let way = low.inverse(finger, target).expect("above the palm").nearest(Angles::default());
            assert!((way.spread - hand.spread.angle(50.0)).abs() < 1e-12, "{way:?}");
        }
    }

    #[test]
    fn spread_that_is_no_number_matters_to_fingers_1_and_2_only() {
        let hand = Hand::default();
        for spread in [f64::NAN, f64::INFINITY] {
            let angles = Angles { spread: 0.0, link: 1.0, tip: 0.5 };
            for finger in Finger::ALL {
                let target = hand.fingertip(finger, angles).origin;
                let found = hand.inverse_at_spread(finger, spread, target);
                if finger.spreads() {
                    assert_eq!(found, Err(Unreachable::SpreadNotFinite));
                } else {
                    assert!(found.expect("finger 3 has no spread").nearest(angles).spread == 0.0);
                }
            }
        }
        assert_eq!(
            format_of(Unreachable::SpreadNotFinite),
            "the spread is not finite; give a number in radians"
        );
    }

    #[test]
    fn given_spread_is_returned_as_it_is_or_out_of_its_range() {
        let hand = Hand::default();
        let [_, high] = hand.spread.range();
        let place = |spread| hand.fingertip(Finger::F1, Angles { spread, link: 1.0, tip: 0.5 }).origin;
        for spread in [0.0, 1.0, high] {
            let ways = hand.inverse_at_spread(Finger::F1, spread, place(spread)).expect("within the range");
            assert!(ways.iter().all(|way| way.spread == spread), "{spread}");
        }
        for (spread, out) in [(TAU, TAU - high), (-0.5, 0.5)] {
            match hand.inverse_at_spread(Finger::F1, spread, place(spread)) {
                Err(Unreachable::OutOfRange { joint: Joint::Spread, by }) => {
                    assert!((by - out).abs() < 1e-12)
                }
                other => panic!("{other:?}"),
            }
        }
    }

    #[test]
    fn stretched_finger_has_one_solution() {
        let hand = Hand::default();
        let tip = -hand.tip_at_zero - libm::atan2(hand.pad_m, hand.tip_m);
        for finger in Finger::ALL {
            let spread = if finger.spreads() { 1.0 } else { 0.0 };
            let target = hand.fingertip(finger, Angles { spread, link: 0.3, tip }).origin;
            for ways in [hand.inverse(finger, target), hand.inverse_at_spread(finger, spread, target)] {
                assert_eq!(ways.expect("it is a pose").iter().count(), 1, "{finger:?}");
            }
        }
    }

    #[test]
    fn error_of_a_target_near_the_largest_number_is_finite() {
        let hand = Hand::default();
        for finger in Finger::ALL {
            for place in [
                [f64::MAX, 0.0, 0.0],
                [0.0, -f64::MAX, 0.0],
                [0.0, 0.0, f64::MAX],
                [f64::MAX; 3],
                [-1e300; 3],
            ] {
                for why in [hand.inverse(finger, place), hand.inverse_at_spread(finger, 1.0, place)] {
                    let why = why.expect_err("it is far away");
                    match why {
                        Unreachable::TooFar { by_m } | Unreachable::OffPlane { by_m } => {
                            assert!(by_m > 0.01 && by_m.is_finite(), "{why:?}");
                        }
                        other => panic!("{other:?}"),
                    }
                    let text = format_of(why);
                    assert!(!text.contains("inf") && text.len() < 80, "{text}");
                }
            }
        }
        assert_eq!(
            format_of(hand.inverse_at_spread(Finger::F1, f64::MAX, [0.0; 3]).expect_err("too many turns")),
            "the spread would be 1.80e308 degrees out of its range"
        );
    }

    /// The hand with one figure changed, and the figure's name in an error if it is one that the inverse reads.
    fn with_figure(index: usize, value: f64) -> (Hand, &'static str) {
        let mut hand = Hand::default();
        let (figure, name) = match index {
            0 => (&mut hand.spread_axis_m, "spread_axis_m"),
            1 => (&mut hand.base_m, "base_m"),
            2 => (&mut hand.link_m, "link_m"),
            3 => (&mut hand.tip_m, "tip_m"),
            4 => (&mut hand.palm_m, "palm_m"),
            5 => (&mut hand.pad_m, "pad_m"),
            6 => (&mut hand.link_at_zero, "link_at_zero"),
            7 => (&mut hand.tip_at_zero, "tip_at_zero"),
            8 => (&mut hand.link.gear_ratio, "link.gear_ratio"),
            9 => (&mut hand.spread.gear_ratio, "spread.gear_ratio"),
            10 => (&mut hand.tip.gear_ratio, "tip.gear_ratio"),
            11 => (&mut hand.link.range_counts[0], "link.range_counts[0]"),
            12 => (&mut hand.link.range_counts[1], "link.range_counts[1]"),
            13 => (&mut hand.spread.range_counts[0], "spread.range_counts[0]"),
            14 => (&mut hand.spread.range_counts[1], "spread.range_counts[1]"),
            15 => (&mut hand.tip.range_counts[0], "tip.range_counts[0]"),
            16 => (&mut hand.tip.range_counts[1], "tip.range_counts[1]"),
            17 => (&mut hand.spread.travel_s, ""),
            18 => (&mut hand.mount.origin[0], ""),
            19 => (&mut hand.mass_kg, ""),
            _ => (&mut hand.finger_radius_m, ""),
        };
        *figure = value;
        (hand, name)
    }

    #[test]
    fn bad_figure_is_named_and_nothing_panics() {
        let values = [
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::MAX,
            -f64::MAX,
            0.0,
            f64::MIN_POSITIVE,
            -1e3,
            1e7,
        ];
        for (index, value) in (0..21).flat_map(|index| values.map(|value| (index, value))) {
            let (hand, name) = with_figure(index, value);
            // The rest only may not panic.
            let _ = (
                hand.bodies().map(|body| body.inertia_kg_m2()),
                hand.sites(),
                hand.motors(&hand.joints([1.0; 7])),
            );
            let _ = [hand.link, hand.spread, hand.tip].map(|drive| (drive.speed(), drive.range()));
            for finger in Finger::ALL {
                let angles = Angles { spread: 1.0, link: 1.0, tip: 0.5 };
                let _ =
                    (hand.jacobian(finger, angles), hand.fingertip_in_world(finger, angles).roll_pitch_yaw());
                let target = Hand::default().fingertip(finger, angles).origin;
                for found in [hand.inverse(finger, target), hand.inverse_at_spread(finger, 1.0, target)] {
                    match found {
                        Ok(ways) => assert!(
                            ways.iter().all(|way| (way.spread + way.link + way.tip).is_finite()),
                            "{name} {value}"
                        ),
                        Err(Unreachable::BadFigure { field, .. }) => {
                            // A lower end above the upper one is seen at the upper.
                            let bound = name.replace("[0]", "[1]");
                            assert!(field == name || field == bound, "{name} {field}");
                        }
                        Err(why) => assert!(
                            value.is_finite() && !format_of(why).contains("NaN"),
                            "{name} {value} {why}"
                        ),
                    }
                }
                let is_read = !name.is_empty();
                if is_read && !value.is_finite() {
                    assert!(
                        matches!(hand.inverse(finger, target), Err(Unreachable::BadFigure { .. })),
                        "{name}"
                    );
                }
            }
        }
        let (hand, _) = with_figure(2, f64::NAN);
        assert_eq!(
            format_of(hand.inverse(Finger::F3, [0.0; 3]).expect_err("no length")),
            "the hand's link_m is NaN, expected 1e-6 to 1e3; correct the field"
        );
    }
}
