//! The hand's mechanics: the position of the fingers and objects, and the contact forces at each motor.
//!
//! Links, tips and objects are capsules; objects are fixed to the palm. Two capsules press on each other with a spring along
//! the shortest line between their segments, which acts on a motor through its lever arm and gear as a [`Contact`]. Contacts
//! are linearized once a millisecond: at its highest speed, 4 rad/s, a finger moves half a millimeter meanwhile.
//!
//! Frame: x from the palm's center to finger 3, z out of the palm. With spread 0 fingers 1 and 2 stand opposite finger 3; they
//! rotate about their own axes to its side, finger 1 through negative y and finger 2 through positive y.

use tater_wire::MotorKind;

use crate::world::plant::{Contact, PlantParams, RAD_PER_COUNT};

const FINGERS: usize = 3;

/// Motors in the order of their nodes: three links, the spread, three tips.
const MOTORS: usize = 7;

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

/// A point, m.
pub type Point = [f64; 3];

/// All points within `radius_m` of a segment; a sphere if its ends are equal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capsule {
    /// The segment's ends.
    pub ends: [Point; 2],
    /// Radius, m.
    pub radius_m: f64,
}

/// Dimensions of the hand. The manual gives none; these are the published Denavit-Hartenberg parameters of the BH8-280, a hand
/// by the same manufacturer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// From the palm's center to the spread axes of fingers 1 and 2 (Aw).
    pub spread_axis_m: f64,
    /// From there, or from the palm's center for finger 3, to the link's joint (A1).
    pub base_m: f64,
    /// A link's length (A2).
    pub link_m: f64,
    /// A tip's length (A3).
    pub tip_m: f64,
    /// A link's angle above the palm at 0 (phi 2), rad.
    pub link_at_zero: f64,
    /// A tip's angle to its link at 0 (phi 3), rad.
    pub tip_at_zero: f64,
    /// Half of a finger's thickness; chosen, 16 mm.
    pub finger_radius_m: f64,
}

impl Default for Geometry {
    fn default() -> Self {
        Self {
            spread_axis_m: 0.025,
            base_m: 0.05,
            link_m: 0.07,
            tip_m: 0.05,
            link_at_zero: 2.46_f64.to_radians(),
            tip_at_zero: 39.56_f64.to_radians(),
            finger_radius_m: 0.008,
        }
    }
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
    pub geometry: Geometry,
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

/// Joint radians per hall count for each kind of motor.
#[derive(Clone, Copy, Debug)]
struct Gears([f64; MOTORS]);

impl Gears {
    fn new() -> Self {
        Self(std::array::from_fn(|motor| RAD_PER_COUNT / PlantParams::for_motor(kind(motor)).gear_ratio))
    }
}

impl Scene {
    /// Link and tip capsule of each finger.
    #[must_use]
    pub fn fingers(&self, pose: &Pose) -> [[Capsule; 2]; FINGERS] {
        let gears = Gears::new();
        std::array::from_fn(|finger| self.finger(finger, pose, &gears))
    }

    fn finger(&self, finger: usize, pose: &Pose, gears: &Gears) -> [Capsule; 2] {
        let Geometry { spread_axis_m, base_m, link_m, tip_m, link_at_zero, tip_at_zero, finger_radius_m } =
            self.geometry;
        let angle = |motor: usize| pose[motor] * gears.0[motor];
        let [link, tip] = motors(finger);
        let turned = std::f64::consts::PI - angle(SPREAD);
        let (side, azimuth) = [(-1.0, -turned), (1.0, turned), (0.0, 0.0)][finger];
        let (sin, cos) = azimuth.sin_cos();
        // In the finger's plane: outwards and up.
        let along = |from: Point, len: f64, up: f64| {
            [from[0] + len * up.cos() * cos, from[1] + len * up.cos() * sin, from[2] + len * up.sin()]
        };
        let base = along([0.0, side * spread_axis_m, 0.0], base_m, 0.0);
        let up = link_at_zero + angle(link);
        let joint = along(base, link_m, up);
        let end = along(joint, tip_m, up + tip_at_zero + angle(tip));
        [[base, joint], [joint, end]].map(|ends| Capsule { ends, radius_m: finger_radius_m })
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
        let gears = Gears::new();
        let mut contacts: [Vec<Contact>; MOTORS] = Default::default();
        let fingers: [[Capsule; 2]; FINGERS] =
            std::array::from_fn(|finger| self.finger(finger, pose, &gears));
        for finger in 0..FINGERS {
            for part in 0..2 {
                for object in &self.objects {
                    let gap = gap(&fingers[finger][part], &object.capsule);
                    let touch = Touch { parts: [(finger, part), (finger, part)], object: Some(object), gap };
                    self.touch(&touch, pose, &gears, &mut contacts);
                }
                for other in finger + 1..FINGERS {
                    for other_part in 0..2 {
                        let gap = gap(&fingers[finger][part], &fingers[other][other_part]);
                        let touch = Touch { parts: [(finger, part), (other, other_part)], object: None, gap };
                        self.touch(&touch, pose, &gears, &mut contacts);
                    }
                }
            }
        }
        contacts
    }

    fn touch(&self, touch: &Touch<'_>, pose: &Pose, gears: &Gears, contacts: &mut [Vec<Contact>; MOTORS]) {
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
            let gap = self.gap_of(touch, &nudged, gears);
            let lever = (gap - touch.gap) / (NUDGE * gears.0[motor]);
            if lever.abs() < LEVER_M {
                continue;
            }
            let plant = PlantParams::for_motor(kind(motor));
            // The rotor moves the joint by 1/ratio, and the force returns through the same ratio.
            let lever = lever / plant.gear_ratio;
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

    fn gap_of(&self, touch: &Touch<'_>, pose: &Pose, gears: &Gears) -> f64 {
        let part = |(finger, part): (usize, usize)| self.finger(finger, pose, gears)[part];
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
