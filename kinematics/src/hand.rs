//! The figures of the hand, its fingers and joints, and joint angles from motor counts.

use core::f64::consts::{FRAC_PI_2, TAU};

use tater_wire::MotorKind;

use crate::transform::Transform;

/// Motors in the order of their nodes: links of fingers 1 to 3, the spread, tips of fingers 1 to 3.
pub const MOTORS: usize = 7;

/// Where the spread's motor stands among [`MOTORS`].
const SPREAD: usize = 3;

/// A motor's gear and joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Motor revolutions of a joint revolution (manual 1.3.2, table 2): link 49, spread 18.28, tip 39.
    pub gear_ratio: f64,
    /// Lowest and highest whole hall count (manual 1.3.1, table 1, whose degrees are rounded); the stops stand half a count outside.
    pub range_counts: [f64; 2],
    /// Time from one end of the range to the other, s (manual 1.3.1, speed limits): inner link 0.72, spread 0.88, outer link 1.0.
    pub travel_s: f64,
}

impl Drive {
    const fn of(kind: MotorKind, travel_s: f64) -> Self {
        let [low, high] = kind.range_counts();
        Self {
            gear_ratio: kind.gear_hundredths() as f64 / 100.0,
            range_counts: [low as f64, high as f64],
            travel_s,
        }
    }

    /// Joint angle at a motor position, rad: 0 at count 0, closing positive.
    #[must_use]
    pub fn angle(&self, counts: f64) -> f64 {
        counts * TAU / (MotorKind::COUNTS_PER_TURN as f64 * self.gear_ratio)
    }

    /// Motor position at a joint angle, hall counts.
    #[must_use]
    pub fn counts(&self, angle: f64) -> f64 {
        angle * (MotorKind::COUNTS_PER_TURN as f64 * self.gear_ratio) / TAU
    }

    /// The joint's range, rad.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        self.range_counts.map(|counts| self.angle(counts))
    }

    /// Mean speed of a move through the whole range, rad/s. A move from rest to rest is faster in its middle, by up to two.
    #[must_use]
    pub fn speed(&self) -> f64 {
        let [low, high] = self.range();
        (high - low) / self.travel_s
    }
}

/// Every figure of the hand. No public source gives the lengths of the BH8-600, and the manual's section 8 has headings only: lengths and
/// angles are Barrett's published ones of the **BH8-280**, ratios and ranges the manual's. The manual's width of 640 mm shows that
/// the real fingers are longer: whoever has one measures it and changes the fields.
///
/// Fields are not checked where they are written. The inverse needs lengths of 0 to 1,000 m, link and tip of a micrometer at least; angles
/// within a turn; gear ratios of 0.001 to 1e6; ranges in order, within a million counts; it returns
/// [`Unreachable::BadFigure`](crate::Unreachable::BadFigure) otherwise. All other functions compute with what they find. None panics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hand {
    /// A_w: from the palm's center to the spread axes of fingers 1 and 2, m. BH8-280: 25 mm.
    pub spread_axis_m: f64,
    /// A_1: from there, or for finger 3 from the palm's center, to the link's joint, m. BH8-280: 50 mm.
    pub base_m: f64,
    /// A_2: from the link's joint to the tip's, m. BH8-280: 70 mm.
    pub link_m: f64,
    /// A_3: from the tip's joint to the fingertip, along the tip, m. BH8-280: 50 mm.
    pub tip_m: f64,
    /// D_w: from the hand's mounting face to the plane of the links' joints, m. BH8-280: 76 mm.
    pub palm_m: f64,
    /// D_3: from the tip's middle line to its pad, in closing direction, m. BH8-280: 9.5 mm. A tip's shape has this radius, so that
    /// the fingertip lies on its surface.
    pub pad_m: f64,
    /// Φ_2: the link's angle to the palm at 0, rad. BH8-280: 2.46°, atan(3/70), because the tip's joint stands 3 mm off the link's middle line;
    /// 0 in models without that offset.
    pub link_at_zero: f64,
    /// Φ_3: the tip's angle to the link at 0, rad. BH8-280: 39.56°; with Φ_2 42.02°, where public models without Φ_2
    /// have 42°. 50° is found as well.
    pub tip_at_zero: f64,
    /// The links' motors 1 to 3.
    pub link: Drive,
    /// The spread's motor 4.
    pub spread: Drive,
    /// The tips' motors 5 to 7.
    pub tip: Drive,
    /// The hand's mounting face in the world.
    pub mount: Transform,
    /// A motor's peak torque, N·m (manual 1.3.3): 65 N·cm.
    pub peak_n_m: f64,
    /// A rotor's inertia, kg·m². Chosen: that of hil-sim's plant (`hil-sim/world/src/plant/params.rs`).
    pub rotor_kg_m2: f64,
    /// The whole hand's mass, kg (manual 1.3.1): 6.9. What the bodies below leave of it is the palm's.
    pub mass_kg: f64,
    /// A base's mass, between spread axis and link, kg. BH8-280: 0.141.
    pub base_kg: f64,
    /// A link's mass, kg. BH8-280: 0.062.
    pub link_kg: f64,
    /// A tip's mass, kg. BH8-280: 0.041.
    pub tip_kg: f64,
    /// Half the thickness of a base and a link, m. Chosen: 8 mm.
    pub finger_radius_m: f64,
    /// The palm's radius, m. BH8-280: 45 mm.
    pub palm_radius_m: f64,
}

impl Default for Hand {
    fn default() -> Self {
        Self {
            spread_axis_m: 0.025,
            base_m: 0.05,
            link_m: 0.07,
            tip_m: 0.05,
            palm_m: 0.076,
            pad_m: 0.0095,
            link_at_zero: 2.46_f64.to_radians(),
            tip_at_zero: 39.56_f64.to_radians(),
            link: Drive::of(MotorKind::Link, 0.72),
            spread: Drive::of(MotorKind::Spread, 0.88),
            tip: Drive::of(MotorKind::Tip, 1.0),
            mount: Transform::IDENTITY,
            peak_n_m: 0.65,
            rotor_kg_m2: 2e-5,
            mass_kg: 6.9,
            base_kg: 0.141,
            link_kg: 0.062,
            tip_kg: 0.041,
            finger_radius_m: 0.008,
            palm_radius_m: 0.045,
        }
    }
}

/// A finger, by the manual's number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Finger {
    /// Spreads about the axis at negative x.
    F1,
    /// Spreads about the axis at positive x, by the same angle.
    F2,
    /// Stands at positive y.
    F3,
}

impl Finger {
    /// All, in order.
    pub const ALL: [Self; 3] = [Self::F1, Self::F2, Self::F3];

    /// 0 to 2.
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Whether the spread moves it.
    #[must_use]
    pub const fn spreads(self) -> bool {
        !matches!(self, Self::F3)
    }

    /// r of the published table: the side of its spread axis, and the direction in which it spreads about z; 0 does not.
    pub(crate) const fn side(self) -> f64 {
        match self {
            Self::F1 => -1.0,
            Self::F2 => 1.0,
            Self::F3 => 0.0,
        }
    }

    /// Where it points about z at spread 0, rad: -j·π/2 with j of the published table.
    pub(crate) const fn azimuth(self) -> f64 {
        if self.spreads() { -FRAC_PI_2 } else { FRAC_PI_2 }
    }
}

/// A finger's joint angles, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Angles {
    /// Θ_1, the spread; finger 3 ignores it.
    pub spread: f64,
    /// Θ_2, the link.
    pub link: f64,
    /// Θ_3, the tip.
    pub tip: f64,
}

/// The seven joints' angles, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Joints {
    /// The links of fingers 1 to 3.
    pub links: [f64; 3],
    /// The spread, of fingers 1 and 2 alike: 0 opposite finger 3, π beside it.
    pub spread: f64,
    /// The tips of fingers 1 to 3.
    pub tips: [f64; 3],
}

impl Angles {
    /// The change of the joint that changes most, rad.
    pub(crate) fn most_change(self, to: Self) -> f64 {
        let by = [self.spread - to.spread, self.link - to.link, self.tip - to.tip];
        by.into_iter().fold(0.0, |most: f64, by| most.max(by.abs()))
    }
}

impl Joints {
    /// The joints of one finger. Finger 3 does not spread: 0.
    #[must_use]
    pub fn of(&self, finger: Finger) -> Angles {
        let index = finger.index();
        let spread = if finger.spreads() { self.spread } else { 0.0 };
        Angles { spread, link: self.links[index], tip: self.tips[index] }
    }
}

impl Hand {
    /// The figures that the inverse reads: field, value, and its bounds.
    pub(crate) fn figures(&self) -> [(&'static str, f64, [f64; 2]); 17] {
        const LENGTH_M: [f64; 2] = [0.0, 1e3];
        // Their product divides.
        const BAR_M: [f64; 2] = [1e-6, 1e3];
        const ANGLE: [f64; 2] = [-TAU, TAU];
        const RATIO: [f64; 2] = [1e-3, 1e6];
        const COUNTS: f64 = 1e6;
        let ([link_low, link_high], [spread_low, spread_high], [tip_low, tip_high]) =
            (self.link.range_counts, self.spread.range_counts, self.tip.range_counts);
        [
            ("spread_axis_m", self.spread_axis_m, LENGTH_M),
            ("base_m", self.base_m, LENGTH_M),
            ("link_m", self.link_m, BAR_M),
            ("tip_m", self.tip_m, BAR_M),
            ("palm_m", self.palm_m, LENGTH_M),
            ("pad_m", self.pad_m, LENGTH_M),
            ("link_at_zero", self.link_at_zero, ANGLE),
            ("tip_at_zero", self.tip_at_zero, ANGLE),
            ("link.gear_ratio", self.link.gear_ratio, RATIO),
            ("spread.gear_ratio", self.spread.gear_ratio, RATIO),
            ("tip.gear_ratio", self.tip.gear_ratio, RATIO),
            ("link.range_counts[0]", link_low, [-COUNTS, COUNTS]),
            ("link.range_counts[1]", link_high, [link_low, COUNTS]),
            ("spread.range_counts[0]", spread_low, [-COUNTS, COUNTS]),
            ("spread.range_counts[1]", spread_high, [spread_low, COUNTS]),
            ("tip.range_counts[0]", tip_low, [-COUNTS, COUNTS]),
            ("tip.range_counts[1]", tip_high, [tip_low, COUNTS]),
        ]
    }

    /// A motor's gear and joint; motors are numbered from 0 here.
    const fn drive(&self, motor: usize) -> &Drive {
        match motor {
            0..SPREAD => &self.link,
            SPREAD => &self.spread,
            _ => &self.tip,
        }
    }

    /// Joint angles at motor positions in hall counts. Each motor drives one joint: on the BH8-600 no gear couples link and tip.
    #[must_use]
    pub fn joints(&self, motors: [f64; MOTORS]) -> Joints {
        let angles: [f64; MOTORS] = core::array::from_fn(|motor| self.drive(motor).angle(motors[motor]));
        let [a, b, c, spread, d, e, f] = angles;
        Joints { links: [a, b, c], spread, tips: [d, e, f] }
    }

    /// Motor positions at joint angles, hall counts; not rounded.
    #[must_use]
    pub fn motors(&self, joints: &Joints) -> [f64; MOTORS] {
        let ([a, b, c], [d, e, f]) = (joints.links, joints.tips);
        let angles = [a, b, c, joints.spread, d, e, f];
        core::array::from_fn(|motor| self.drive(motor).counts(angles[motor]))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn motor_counts_of_90_degrees_are_the_manuals() {
        let hand = Hand::default();
        // 1.3.2: 12128 GCL counts, 55 a hall count, rounded.
        assert!((hand.link.counts(FRAC_PI_2) * 55.0 - 12127.5).abs() < 1e-9);
        let joints = Joints { links: [FRAC_PI_2, 0.0, 0.0], spread: FRAC_PI_2, tips: [0.0, 0.0, FRAC_PI_2] };
        let motors = hand.motors(&joints);
        let expected = [220.5, 0.0, 0.0, 82.26, 0.0, 0.0, 175.5];
        assert!(motors.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{motors:?}");
    }

    #[test]
    fn ranges_are_the_manuals_within_its_rounding() {
        let hand = Hand::default();
        // Table 1 in degrees differs from its own counts by up to 5.
        for (drive, table) in
            [(hand.link, [-10.0, 133.0]), (hand.spread, [0.0, 180.0]), (hand.tip, [-78.0, 180.0])]
        {
            for (found, degrees) in drive.range().into_iter().zip(table) {
                assert!((found.to_degrees() - degrees).abs() < 5.1, "{found} {degrees}");
            }
        }
        assert!((hand.spread.speed() * 0.88 - hand.spread.angle(166.0)).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn motors_return_from_their_joints(motors in prop::array::uniform7(-400.0..400.0)) {
            let hand = Hand::default();
            let back = hand.motors(&hand.joints(motors));
            prop_assert!(back.iter().zip(motors).all(|(a, b)| (a - b).abs() < 1e-9), "{:?}", back);
        }
    }
}
