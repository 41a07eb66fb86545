//! The hand as bodies with shape, mass and inertia, for generators of robot models.
//!
//! Real shapes are not public: palm and fingers are cylinders. A body's inertia is that of a solid cylinder of its mass: an estimate.

use crate::hand::{Drive, Finger, Hand};
use crate::transform::Transform;

/// How a body hangs on its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mount {
    /// Nothing moves it.
    Fixed,
    /// It turns about the z of its frame.
    Turns {
        /// The joint's name.
        joint: &'static str,
        /// 1, or -1 if it turns against z.
        direction: f64,
        /// Its motor's gear, range and speed.
        drive: Drive,
        /// The joint whose angle it repeats: both spreads have one motor.
        mimics: Option<&'static str>,
    },
}

/// A solid cylinder, of fingers with round ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cylinder {
    /// Axis in the body's frame: 0 x, 2 z. It begins at the frame's origin.
    pub axis: usize,
    /// Length between the ends' centers, m.
    pub length_m: f64,
    /// Radius, m.
    pub radius_m: f64,
    /// Whether half spheres close it.
    pub is_round: bool,
}

/// A rigid body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Its name.
    pub name: &'static str,
    /// The parent's name; the palm has none.
    pub parent: Option<&'static str>,
    /// Its frame in that of the parent with its joint at 0; the palm's is the mount.
    pub place: Transform,
    /// How it hangs there.
    pub mount: Mount,
    /// Its shape.
    pub shape: Cylinder,
    /// Its mass, kg.
    pub mass_kg: f64,
}

impl Body {
    /// Moments of inertia about the middle, kg·m²: about the cylinder's axis, m·r²/2, and across it, m·(3·r² + l²)/12.
    #[must_use]
    pub fn inertia_kg_m2(&self) -> [f64; 2] {
        let (m, r2, l2) = (
            self.mass_kg,
            self.shape.radius_m * self.shape.radius_m,
            self.shape.length_m * self.shape.length_m,
        );
        [0.5 * m * r2, m * (3.0 * r2 + l2) / 12.0]
    }
}

/// A point of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Site {
    /// Its name.
    pub name: &'static str,
    /// The body's name.
    pub parent: &'static str,
    /// Its frame in that of the body.
    pub place: Transform,
}

/// Names of a finger's base, link, tip and fingertip.
const PARTS: [[&str; 4]; 3] = [
    ["finger_1_base", "finger_1_link", "finger_1_tip", "finger_1_fingertip"],
    ["finger_2_base", "finger_2_link", "finger_2_tip", "finger_2_fingertip"],
    ["finger_3_base", "finger_3_link", "finger_3_tip", "finger_3_fingertip"],
];

/// Names of a finger's joints: spread, link, tip.
const JOINTS: [[&str; 3]; 3] =
    [["spread_1", "link_1", "tip_1"], ["spread_2", "link_2", "tip_2"], ["", "link_3", "tip_3"]];

const PALM: &str = "palm";

impl Hand {
    /// Palm, then base, link and tip of each finger; parents come first.
    #[must_use]
    pub fn bodies(&self) -> [Body; 10] {
        let [a, b, c] = Finger::ALL.map(|finger| self.finger_bodies(finger));
        let fingers_kg = 3.0 * (self.base_kg + self.link_kg + self.tip_kg);
        let palm = Body {
            name: PALM,
            parent: None,
            place: self.mount,
            mount: Mount::Fixed,
            shape: Cylinder {
                axis: 2,
                // Up to the fingers' bases.
                length_m: self.palm_m - self.finger_radius_m,
                radius_m: self.palm_radius_m,
                is_round: false,
            },
            mass_kg: self.mass_kg - fingers_kg,
        };
        [palm, a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]]
    }

    /// The fingertips.
    #[must_use]
    pub fn sites(&self) -> [Site; 3] {
        Finger::ALL.map(|finger| {
            let [_, _, parent, name] = PARTS[finger.index()];
            Site { name, parent, place: self.dh_table(finger)[3].frame(0.0) }
        })
    }

    /// Shapes of a finger's base, link and tip, each along the x of its frame.
    #[must_use]
    pub fn finger_shapes(&self) -> [Cylinder; 3] {
        [
            (self.base_m, self.finger_radius_m),
            (self.link_m, self.finger_radius_m),
            // Its pad is its surface.
            (self.tip_m, self.pad_m),
        ]
        .map(|(length_m, radius_m)| Cylinder { axis: 0, length_m, radius_m, is_round: true })
    }

    fn finger_bodies(&self, finger: Finger) -> [Body; 3] {
        let (rows, names, joints) = (self.dh_table(finger), PARTS[finger.index()], JOINTS[finger.index()]);
        let turns = |index: usize, drive, mimics| Mount::Turns {
            joint: joints[index],
            direction: rows[index].per_joint,
            drive,
            mimics,
        };
        let spread = match finger {
            Finger::F1 => turns(0, self.spread, None),
            Finger::F2 => turns(0, self.spread, Some(JOINTS[0][0])),
            Finger::F3 => Mount::Fixed,
        };
        let parts = [
            (spread, self.base_kg),
            (turns(1, self.link, None), self.link_kg),
            (turns(2, self.tip, None), self.tip_kg),
        ];
        let shapes = self.finger_shapes();
        core::array::from_fn(|index| {
            let (mount, mass_kg) = parts[index];
            Body {
                name: names[index],
                parent: Some(if index == 0 { PALM } else { names[index - 1] }),
                place: rows[index].frame(0.0),
                mount,
                shape: shapes[index],
                mass_kg,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hand::Angles;

    #[test]
    fn bodies_weigh_what_the_hand_does_and_stand_where_the_table_says() {
        let hand = Hand::default();
        let bodies = hand.bodies();
        let total: f64 = bodies.iter().map(|body| body.mass_kg).sum();
        assert!((total - 6.9).abs() < 1e-12 && bodies.iter().all(|body| body.mass_kg > 0.0));
        // The palm reaches up to the fingers' bases.
        let palm = bodies[0].shape;
        assert!((palm.length_m + hand.finger_radius_m - hand.palm_m).abs() < 1e-12, "{palm:?}");
        let place = |name: &str| {
            let mut at = Transform::IDENTITY;
            let mut next = Some(name);
            while let Some(body) = bodies.iter().find(|body| Some(body.name) == next) {
                (at, next) = (body.place.then(&at), body.parent);
            }
            at
        };
        for (finger, site) in Finger::ALL.into_iter().zip(hand.sites()) {
            let (found, table) =
                (place(site.parent).then(&site.place), hand.fingertip(finger, Angles::default()));
            let by = found.origin.iter().zip(table.origin).map(|(a, b)| (a - b).abs());
            assert!(by.fold(0.0, f64::max) < 1e-12, "{}", site.name);
        }
    }

    #[test]
    fn joints_are_seven_and_a_mimic() {
        let bodies = Hand::default().bodies();
        let (mut own, mut mimics) = (0, 0);
        for body in bodies {
            if let Mount::Turns { mimics: of, direction, .. } = body.mount {
                assert!(direction.abs() == 1.0, "{}", body.name);
                if of.is_some() { mimics += 1 } else { own += 1 }
            }
        }
        assert_eq!((own, mimics), (7, 1));
    }

    #[test]
    fn fingertip_lies_on_the_tips_surface() {
        let hand = Hand::default();
        let [_, _, tip] = hand.finger_shapes();
        for site in hand.sites() {
            let [along, pad, across] = site.place.origin;
            assert!(
                (along - tip.length_m).abs() < 1e-12 && (pad - tip.radius_m).abs() < 1e-12,
                "{}",
                site.name
            );
            assert!(across.abs() < 1e-12, "{}", site.name);
        }
    }

    #[test]
    fn inertia_is_that_of_a_solid_cylinder() {
        let [along, across] = Hand::default().bodies()[2].inertia_kg_m2();
        // 62 g, 8 mm, 70 mm.
        assert!((along - 1.984e-6).abs() < 1e-12 && (across - 2.630_866_666e-5).abs() < 1e-12, "{across}");
    }
}
