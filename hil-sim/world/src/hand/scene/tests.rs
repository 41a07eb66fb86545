use super::*;

use kinematics::Angles;
use proptest::prelude::*;

fn upright() -> (Scene, Pose) {
    let scene =
        Scene { hand: Hand { tip_at_zero: 0.0, link_at_zero: 0.0, ..Hand::default() }, objects: Vec::new() };
    // 90° of a link are 220.5 counts (the manual's 12128 / 55).
    (scene, [220.5, 220.5, 220.5, 0.0, 0.0, 0.0, 0.0])
}

fn far(found: Point, expected: Point) -> f64 {
    let by = minus(found, expected);
    dot(by, by).sqrt()
}

fn close(found: Point, expected: Point) {
    assert!(far(found, expected) < 1e-9, "{found:?}, expected {expected:?}");
}

#[test]
fn finger_positions_follow_from_the_dimensions() {
    let (scene, pose) = upright();
    let fingers = scene.fingers(&pose);
    for (finger, x, y) in [(0, -0.025, -0.05), (1, 0.025, -0.05), (2, 0.0, 0.05)] {
        let [link, tip] = fingers[finger];
        close(link.ends[0], [x, y, 0.076]);
        close(link.ends[1], [x, y, 0.146]);
        close(tip.ends[1], [x, y, 0.196]);
    }
    // 180° of the spread: 18.28 turns of 18 counts for 360°.
    let spread = [220.5, 220.5, 220.5, 0.5 * 18.28 * 18.0, 0.0, 0.0, 0.0];
    let fingers = scene.fingers(&spread);
    close(fingers[0][0].ends[0], [-0.025, 0.05, 0.076]);
    close(fingers[1][0].ends[0], [0.025, 0.05, 0.076]);
    let half = [220.5, 220.5, 220.5, 0.25 * 18.28 * 18.0, 0.0, 0.0, 0.0];
    let fingers = scene.fingers(&half);
    close(fingers[0][0].ends[0], [-0.075, 0.0, 0.076]);
    close(fingers[1][0].ends[0], [0.075, 0.0, 0.076]);
}

/// Numbers of an attribute in the first element of `text`.
fn numbers(text: &str, attribute: &str) -> Vec<f64> {
    let (_, value) = text.split_once(&format!(" {attribute}=\"")).expect(attribute);
    let (value, _) = value.split_once('"').expect("a closing quote");
    value.split(' ').map(|number| number.parse().expect(attribute)).collect()
}

/// Link and tip of a finger in the MJCF at joint angles, by its own bodies and joints.
fn modeled(finger: usize, angles: Angles) -> [Capsule; 2] {
    let model = include_str!("../../../../../kinematics/model/barrettwraptor.xml");
    let (mut at, mut capsules) = (Transform::IDENTITY, Vec::new());
    for (part, angle) in [("base", angles.spread), ("link", angles.link), ("tip", angles.tip)] {
        let (_, body) =
            model.split_once(&format!("<body name=\"finger_{}_{part}\"", finger + 1)).expect(part);
        let (own, _) = body.split_once("<body ").unwrap_or((body, ""));
        let [x1, x2, x3, y1, y2, y3] = numbers(body, "xyaxes")[..] else { panic!("six numbers") };
        let z = [x2 * y3 - x3 * y2, x3 * y1 - x1 * y3, x1 * y2 - x2 * y1];
        let place = Transform {
            rotation: [[x1, y1, z[0]], [x2, y2, z[1]], [x3, y3, z[2]]],
            origin: numbers(body, "pos").try_into().expect("three numbers"),
        };
        let joint = own.split_once("<joint ").map_or(0.0, |(_, joint)| angle * numbers(joint, "axis")[2]);
        at = at.then(&place).then(&Transform::dh(0.0, 0.0, 0.0, joint));
        let (_, geom) = own.split_once("<geom type=\"capsule\"").expect("a capsule");
        let [a, b, c, d, e, f] = numbers(geom, "fromto")[..] else { panic!("six numbers") };
        capsules.push(Capsule {
            ends: [[a, b, c], [d, e, f]].map(|end| at.apply(end)),
            radius_m: numbers(geom, "size")[0],
        });
    }
    [capsules[1], capsules[2]]
}

#[test]
fn shapes_are_those_of_the_urdf() {
    let model = include_str!("../../../../../kinematics/model/barrettwraptor.urdf");
    let fingers = Scene::default().fingers(&Pose::default());
    for (finger, parts) in (1..).zip(fingers) {
        for (name, capsule) in ["link", "tip"].into_iter().zip(parts) {
            let start = format!("<link name=\"finger_{finger}_{name}\"");
            let (_, link) = model.split_once(&start).expect("a link");
            let (_, cylinder) = link.split_once("<cylinder").expect("a shape");
            assert_eq!(numbers(cylinder, "radius"), [capsule.radius_m], "{start}");
            assert!(
                (numbers(cylinder, "length")[0] - far(capsule.ends[0], capsule.ends[1])).abs() < 1e-9,
                "{start}"
            );
        }
    }
}

proptest! {
    #[test]
    fn capsule_ends_are_those_of_the_forward_kinematics(motors in prop::array::uniform7(-400.0..400.0)) {
        let scene = Scene::default();
        let (hand, joints) = (scene.hand, scene.hand.joints(motors));
        let knuckle = Hand { tip_m: 0.0, pad_m: 0.0, ..hand };
        for (finger, [link, tip]) in Finger::ALL.into_iter().zip(scene.fingers(&motors)) {
            let angles = joints.of(finger);
            let fingertip = hand.fingertip(finger, angles);
            // The pad looks along z, the tip's radius away.
            prop_assert!(far(tip.ends[1], fingertip.apply([0.0, 0.0, -hand.pad_m])) < 1e-9, "{:?}", tip);
            prop_assert_eq!(tip.radius_m, hand.pad_m);
            let joint = knuckle.fingertip(finger, angles).origin;
            prop_assert!(far(link.ends[1], joint) < 1e-9 && far(tip.ends[0], joint) < 1e-9, "{:?}", link);
            prop_assert!((far(link.ends[0], joint) - hand.link_m).abs() < 1e-9, "{:?}", link);
        }
    }

    #[test]
    fn capsules_are_those_of_the_mujoco_model(motors in prop::array::uniform7(-400.0..400.0)) {
        let scene = Scene::default();
        let joints = scene.hand.joints(motors);
        for (finger, parts) in Finger::ALL.into_iter().zip(scene.fingers(&motors)) {
            for (found, modeled) in parts.iter().zip(modeled(finger.index(), joints.of(finger))) {
                prop_assert_eq!(found.radius_m, modeled.radius_m);
                // The model is rounded to nine places.
                let by = found.ends.iter().zip(modeled.ends).map(|(a, b)| far(*a, b));
                prop_assert!(by.fold(0.0, f64::max) < 1e-9, "{:?}, {:?}", found, modeled);
            }
        }
    }
}

#[test]
fn segment_distance_covers_interior_and_ends() {
    let along_x = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];
    for (other, expected) in [
        ([[0.5, -1.0, 2.0], [0.5, 1.0, 2.0]], 2.0),
        ([[3.0, 0.0, 0.0], [4.0, 0.0, 0.0]], 2.0),
        ([[0.2, 3.0, 0.0], [0.8, 3.0, 0.0]], 3.0),
        ([[0.5, 0.0, 0.0], [0.5, 5.0, 0.0]], 0.0),
        ([[4.0, 4.0, 0.0], [4.0, 4.0, 0.0]], 5.0),
        ([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0]], 1.0),
    ] {
        let found = distance(&along_x, &other);
        assert!((found - expected).abs() < 1e-12, "{other:?}: {found}");
        assert!((distance(&other, &along_x) - found).abs() < 1e-12, "either way round");
    }
}

#[test]
fn contact_force_acts_through_lever_and_gear() {
    let (mut scene, pose) = upright();
    // The tip's radius is 9.5 mm.
    let ball = Capsule { ends: [[-0.025, -0.05 + 0.0305, 0.196]; 2], radius_m: 0.02 };
    scene.objects.push(SceneObject { capsule: ball, stiffness_n_m: 1e5 });
    let contacts = scene.contacts(&pose);
    // The gap is 1 mm at the very end of the tip, 120 mm above the link's joint and 50 above its own.
    for (motor, lever_m, ratio) in [(0, 0.12, 49.0), (4, 0.05, 39.0)] {
        let [contact] = contacts[motor][..] else { panic!("one contact of motor {motor}: {contacts:?}") };
        assert_eq!(contact.side, 1.0, "in the way of closing");
        let stiffness = 1e5 * (lever_m / ratio) * (lever_m / ratio);
        assert!((contact.stiffness / stiffness - 1.0).abs() < 0.01, "{contact:?}, {stiffness}");
        let to_go = (contact.from - pose[motor] * RAD_PER_COUNT) / ratio * lever_m;
        assert!((to_go - 0.001).abs() < 2e-5, "{to_go}");
    }
    for motor in [1, 2, 5, 6] {
        assert!(contacts[motor].is_empty(), "far from it: {motor}");
    }
}

#[test]
fn finger_contact_acts_on_the_spread() {
    let (scene, mut pose) = upright();
    assert!(scene.contacts(&pose).iter().all(Vec::is_empty), "50 mm and more between them");
    // Closed over the palm, fingers 1 and 3 cross where the spread brings finger 1 into finger 3's plane.
    pose[3] = 0.5 * 18.28 * 18.0;
    assert!(!scene.contacts(&pose)[3].is_empty(), "9 mm beside finger 3");
    let closing = scene.contacts(&pose)[3][0];
    assert_eq!(closing.side, 1.0, "in the way of closing the spread");
}
