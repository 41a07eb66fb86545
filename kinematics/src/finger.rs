//! A finger's Denavit-Hartenberg table, and what follows from it: frames, fingertip, Jacobian.

use core::f64::consts::FRAC_PI_2;

use crate::hand::{Angles, Finger, Hand};
use crate::transform::{Transform, Vector, cross, minus};

/// A row of the table, in Craig's convention: a and α lead from axis i-1 to axis i, d and θ lie on axis i.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DhRow {
    /// a_{i-1}, m.
    pub a_m: f64,
    /// α_{i-1}, rad.
    pub alpha: f64,
    /// d_i, m.
    pub d_m: f64,
    /// θ_i with the joint at 0, rad.
    pub theta_at_zero: f64,
    /// θ_i per joint angle: 1, -1, or 0 for a frame that no joint moves.
    pub per_joint: f64,
}

impl DhRow {
    /// The frame in the one before it, at a joint angle.
    #[must_use]
    pub fn frame(&self, joint: f64) -> Transform {
        Transform::dh(self.a_m, self.alpha, self.d_m, self.theta_at_zero + self.per_joint * joint)
    }
}

/// Velocity of the fingertip for each joint's, in the frame of the palm. Columns: spread, link, tip; finger 3's first is 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jacobian {
    /// Of the fingertip's point, m/rad.
    pub linear: [Vector; 3],
    /// Of its orientation, rad/rad.
    pub angular: [Vector; 3],
}

impl Hand {
    /// The table of a finger: spread, link, tip, fingertip.
    #[must_use]
    pub fn dh_table(&self, finger: Finger) -> [DhRow; 4] {
        let row =
            |a_m, alpha, d_m, theta_at_zero, per_joint| DhRow { a_m, alpha, d_m, theta_at_zero, per_joint };
        [
            row(finger.side() * self.spread_axis_m, 0.0, self.palm_m, finger.azimuth(), finger.side()),
            row(self.base_m, FRAC_PI_2, 0.0, self.link_at_zero, 1.0),
            row(self.link_m, 0.0, 0.0, self.tip_at_zero, 1.0),
            row(self.tip_m, -FRAC_PI_2, self.pad_m, 0.0, 0.0),
        ]
    }

    /// The finger's frames in that of the palm: base, link, tip, fingertip. The z of the first three are the joints' axes; that of the
    /// fingertip points out of its pad.
    #[must_use]
    pub fn frames(&self, finger: Finger, angles: Angles) -> [Transform; 4] {
        let [spread, link, tip, end] = self.dh_table(finger);
        let base = spread.frame(angles.spread);
        let link = base.then(&link.frame(angles.link));
        let tip = link.then(&tip.frame(angles.tip));
        [base, link, tip, tip.then(&end.frame(0.0))]
    }

    /// The fingertip in the frame of the palm: x along the tip, z out of its pad.
    #[must_use]
    pub fn fingertip(&self, finger: Finger, angles: Angles) -> Transform {
        self.frames(finger, angles)[3]
    }

    /// The fingertip in the world.
    #[must_use]
    pub fn fingertip_in_world(&self, finger: Finger, angles: Angles) -> Transform {
        self.mount.then(&self.fingertip(finger, angles))
    }

    /// The fingertip's Jacobian: column i is z_i × (tip - o_i) over z_i, for the joint of axis z_i through o_i.
    #[must_use]
    pub fn jacobian(&self, finger: Finger, angles: Angles) -> Jacobian {
        let frames = self.frames(finger, angles);
        let rows = self.dh_table(finger);
        let axes: [Vector; 3] =
            core::array::from_fn(|joint| frames[joint].axis(2).map(|part| part * rows[joint].per_joint));
        let arms: [Vector; 3] =
            core::array::from_fn(|joint| cross(axes[joint], minus(frames[3].origin, frames[joint].origin)));
        let columns = |of: &[Vector; 3]| core::array::from_fn(|i| core::array::from_fn(|joint| of[joint][i]));
        Jacobian { linear: columns(&arms), angular: columns(&axes) }
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use proptest::prelude::*;

    use super::*;

    /// Rounding of a few products below 1 m.
    const EXACT_M: f64 = 1e-12;

    fn near(a: Vector, b: Vector, by: f64) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < by)
    }

    #[test]
    fn fingertip_of_straight_fingers_is_the_sum_of_their_lengths() {
        let hand = Hand { link_at_zero: 0.0, tip_at_zero: 0.0, ..Hand::default() };
        let up = 0.076 + 0.0095;
        for (finger, spread, expected) in [
            (Finger::F1, 0.0, [-0.025, -0.17, up]),
            (Finger::F1, FRAC_PI_2, [-0.195, 0.0, up]),
            (Finger::F1, PI, [-0.025, 0.17, up]),
            (Finger::F2, 0.0, [0.025, -0.17, up]),
            (Finger::F2, FRAC_PI_2, [0.195, 0.0, up]),
            (Finger::F2, PI, [0.025, 0.17, up]),
            (Finger::F3, 0.0, [0.0, 0.17, up]),
            (Finger::F3, 1.0, [0.0, 0.17, up]),
        ] {
            let found = hand.fingertip(finger, Angles { spread, ..Angles::default() });
            assert!(near(found.origin, expected, EXACT_M), "{finger:?} {spread}: {:?}", found.origin);
            assert!(near(found.axis(2), [0.0, 0.0, 1.0], EXACT_M), "the pad looks out of the palm");
        }
    }

    #[test]
    fn link_at_90_degrees_stands_up_and_its_pad_looks_inwards() {
        let hand = Hand { link_at_zero: 0.0, tip_at_zero: 0.0, ..Hand::default() };
        let up = Angles { link: FRAC_PI_2, ..Angles::default() };
        let tip = hand.fingertip(Finger::F3, up);
        assert!(near(tip.origin, [0.0, 0.05 - 0.0095, 0.076 + 0.12], EXACT_M), "{tip:?}");
        assert!(near(tip.axis(2), [0.0, -1.0, 0.0], EXACT_M), "{tip:?}");
    }

    #[test]
    fn fingertip_in_world_is_seen_through_the_mount() {
        let mount = Transform::dh(0.3, 1.0, -0.2, 2.0);
        let hand = Hand { mount, ..Hand::default() };
        let angles = Angles { spread: 0.4, link: 1.1, tip: 0.7 };
        let back = mount.inverse().then(&hand.fingertip_in_world(Finger::F1, angles));
        assert!(near(back.origin, hand.fingertip(Finger::F1, angles).origin, EXACT_M));
    }

    proptest! {
        #[test]
        fn jacobian_is_the_derivative_of_the_fingertip(
            finger in prop::sample::select(&Finger::ALL),
            spread in 0.0..3.1, link in -0.2..2.4, tip in -1.4..3.1,
        ) {
            // Central differences over 2e-5 rad: the third derivative, below 0.2 m, leaves 1e-11; rounding leaves 1e-11 as well.
            const STEP: f64 = 1e-5;
            let hand = Hand::default();
            let jacobian = hand.jacobian(finger, Angles { spread, link, tip });
            for joint in 0..3 {
                let at = |by: f64| {
                    let by: [f64; 3] = core::array::from_fn(|i| if i == joint { by } else { 0.0 });
                    hand.fingertip(finger, Angles { spread: spread + by[0], link: link + by[1], tip: tip + by[2] })
                };
                let (after, before) = (at(STEP), at(-STEP));
                let rate = minus(after.origin, before.origin).map(|by| by / (2.0 * STEP));
                let column = jacobian.linear.map(|row| row[joint]);
                prop_assert!(near(rate, column, 1e-9), "{:?} {:?}", rate, column);
                // Each axis of the fingertip turns by ω × axis.
                let omega = jacobian.angular.map(|row| row[joint]);
                for axis in 0..3 {
                    let rate = minus(after.axis(axis), before.axis(axis)).map(|by| by / (2.0 * STEP));
                    let now = hand.fingertip(finger, Angles { spread, link, tip }).axis(axis);
                    prop_assert!(near(rate, cross(omega, now), 1e-9));
                }
            }
        }
    }
}
