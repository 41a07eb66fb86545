//! The hand's mechanics: the position of the fingers and objects, and the contact forces at each motor.
//!
//! Links, tips and objects are capsules; objects are fixed to the palm. Two capsules press on each other with a spring along
//! the shortest line between their segments, which acts on a motor through its lever arm and gear as a [`Contact`]. Contacts
//! are linearized once a millisecond: at its highest speed, 4 rad/s, a finger moves half a millimeter meanwhile.
//!
//! Where they are is the crate `kinematics`' matter. Its frame of the palm: origin on the mounting face, y to finger 3, z out of the palm.

use kinematics::bodies::Cylinder;
use kinematics::{Finger, Hand, MOTORS, Transform, Vector};
use tater_wire::MotorKind;

use crate::plant::{Contact, PlantParams, RAD_PER_COUNT};

const FINGERS: usize = 3;

/// The spread's index.
pub const SPREAD: usize = 3;

/// Capsules farther apart than this cannot touch within the next millisecond, m.
const NEAR_M: f64 = 0.01;

/// Lever arms below this are ignored, m/rad at the joint.
const LEVER_M: f64 = 1e-3;

/// Motor displacement for the numerical derivative of a gap, hall counts.
const NUDGE: f64 = 0.05;

/// Positions of the seven rotors, hall counts.
pub type Pose = [f64; MOTORS];

/// A point in the frame of the palm, m.
pub type Point = Vector;

/// All points within `radius_m` of a segment; a sphere if its ends are equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capsule {
    /// The segment's ends.
    pub ends: [Point; 2],
    /// Radius, m.
    pub radius_m: f64,
}

/// An object between the fingers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneObject {
    /// Shape and place.
    pub capsule: Capsule,
    /// Contact stiffness, N/m.
    pub stiffness_n_m: f64,
}

/// Stiffness of finger against finger, N/m; chosen: the full torque of two links compresses it by a millimeter.
const FINGER_N_M: f64 = 2e5;

/// A hand and the objects between its fingers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scene {
    /// The hand's dimensions.
    pub hand: Hand,
    /// The objects.
    pub objects: Vec<SceneObject>,
}

const fn kind(motor: usize) -> MotorKind {
    match motor {
        0..SPREAD => MotorKind::Link,
        SPREAD => MotorKind::Spread,
        _ => MotorKind::Tip,
    }
}

const fn motors(finger: usize) -> [usize; 2] {
    [finger, finger + SPREAD + 1]
}

impl Scene {
    /// Link and tip capsule of each finger.
    #[must_use]
    pub fn fingers(&self, pose: &Pose) -> [[Capsule; 2]; FINGERS] {
        Finger::ALL.map(|finger| self.finger(finger, pose))
    }

    fn finger(&self, finger: Finger, pose: &Pose) -> [Capsule; 2] {
        let [_, link, tip, _] = self.hand.frames(finger, self.hand.joints(*pose).of(finger));
        let [_, link_shape, tip_shape] = self.hand.finger_shapes();
        [capsule(&link, &link_shape), capsule(&tip, &tip_shape)]
    }

    /// The deepest overlap of an object with a finger at a pose: the object's index, the finger (1 to 3), `link` or `tip`, and
    /// the depth, m. `None` if all are clear.
    #[must_use]
    pub fn overlap(&self, pose: &Pose) -> Option<(usize, usize, &'static str, f64)> {
        let fingers = self.fingers(pose);
        let parts = |(finger, parts): (usize, &[Capsule; 2])| {
            let parts = [(finger + 1, "link", parts[0]), (finger + 1, "tip", parts[1])];
            parts.into_iter()
        };
        let parts: Vec<_> = fingers.iter().enumerate().flat_map(parts).collect();
        let depths = self.objects.iter().enumerate().flat_map(|(index, object)| {
            let depth = |&(finger, name, part): &(usize, &'static str, Capsule)| {
                (index, finger, name, -gap(&part, &object.capsule))
            };
            parts.iter().map(depth).collect::<Vec<_>>()
        });
        depths.filter(|found| found.3 > 0.0).max_by(|a, b| a.3.total_cmp(&b.3))
    }

    /// The contacts of each motor at the rotors' positions.
    #[must_use]
    pub fn contacts(&self, pose: &Pose) -> [Vec<Contact>; MOTORS] {
        let mut contacts: [Vec<Contact>; MOTORS] = Default::default();
        let fingers = self.fingers(pose);
        for finger in 0..FINGERS {
            for part in 0..2 {
                for object in &self.objects {
                    let gap = gap(&fingers[finger][part], &object.capsule);
                    let touch = Touch { parts: [(finger, part), (finger, part)], object: Some(object), gap };
                    self.touch(&touch, pose, &mut contacts);
                }
                for other in finger + 1..FINGERS {
                    for other_part in 0..2 {
                        let gap = gap(&fingers[finger][part], &fingers[other][other_part]);
                        let touch = Touch { parts: [(finger, part), (other, other_part)], object: None, gap };
                        self.touch(&touch, pose, &mut contacts);
                    }
                }
            }
        }
        contacts
    }

    fn touch(&self, touch: &Touch<'_>, pose: &Pose, contacts: &mut [Vec<Contact>; MOTORS]) {
        if touch.gap > NEAR_M {
            return;
        }
        let movers = touch.parts.iter().flat_map(|&(finger, part)| motors(finger).into_iter().take(part + 1));
        let mut movers: Vec<usize> = movers.chain([SPREAD]).collect();
        movers.sort_unstable();
        movers.dedup();
        for motor in movers {
            let mut nudged = *pose;
            nudged[motor] += NUDGE;
            // The rotor moves the joint by 1/ratio, and the force returns through the same ratio.
            let lever = (self.gap_of(touch, &nudged) - touch.gap) / (NUDGE * RAD_PER_COUNT);
            let plant = PlantParams::for_motor(kind(motor));
            if lever.abs() * plant.gear_ratio < LEVER_M {
                continue;
            }
            let stiffness = lever * lever * touch.object.map_or(FINGER_N_M, |object| object.stiffness_n_m);
            contacts[motor].push(Contact {
                from: pose[motor] * RAD_PER_COUNT - touch.gap / lever,
                side: -lever.signum(),
                stiffness,
                // Half of critical, as the stops'.
                damping: (stiffness * plant.j_kg_m2).sqrt(),
            });
        }
    }

    fn gap_of(&self, touch: &Touch<'_>, pose: &Pose) -> f64 {
        let part = |(finger, part): (usize, usize)| self.finger(Finger::ALL[finger], pose)[part];
        let other = touch.object.map_or_else(|| part(touch.parts[1]), |object| object.capsule);
        gap(&part(touch.parts[0]), &other)
    }
}

struct Touch<'a> {
    /// Finger and part (0 link, 1 tip); both entries are the same if the other side is an object.
    parts: [(usize, usize); 2],
    object: Option<&'a SceneObject>,
    /// Distance between their surfaces, m; negative where they press.
    gap: f64,
}

fn capsule(frame: &Transform, shape: &Cylinder) -> Capsule {
    Capsule { ends: [frame.origin, frame.apply([shape.length_m, 0.0, 0.0])], radius_m: shape.radius_m }
}

/// The gap between two capsules' surfaces, m.
#[must_use]
pub fn gap(a: &Capsule, b: &Capsule) -> f64 {
    distance(&a.ends, &b.ends) - a.radius_m - b.radius_m
}

fn minus(a: Point, b: Point) -> Point {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: Point, b: Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn at(segment: &[Point; 2], share: f64) -> Point {
    std::array::from_fn(|i| segment[0][i] + share * (segment[1][i] - segment[0][i]))
}

fn nearest(segment: &[Point; 2], point: Point) -> f64 {
    let along = minus(segment[1], segment[0]);
    let square = dot(along, along);
    if square > 0.0 { (dot(minus(point, segment[0]), along) / square).clamp(0.0, 1.0) } else { 0.0 }
}

/// The minimum is between interior points or at an end of one segment.
fn distance(a: &[Point; 2], b: &[Point; 2]) -> f64 {
    let (u, v, w) = (minus(a[1], a[0]), minus(b[1], b[0]), minus(a[0], b[0]));
    let (uu, uv, vv, uw, vw) = (dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w));
    let between = |p: Point, q: Point| dot(minus(p, q), minus(p, q));
    let mut least = f64::INFINITY;
    let det = uu * vv - uv * uv;
    if det > 1e-12 {
        let (s, t) = ((uv * vw - vv * uw) / det, (uu * vw - uv * uw) / det);
        if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
            least = between(at(a, s), at(b, t));
        }
    }
    for end in *a {
        least = least.min(between(end, at(b, nearest(b, end))));
    }
    for end in *b {
        least = least.min(between(end, at(a, nearest(a, end))));
    }
    least.sqrt()
}

#[cfg(test)]
mod tests;
