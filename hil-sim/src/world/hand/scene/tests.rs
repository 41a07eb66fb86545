use super::*;

fn upright() -> (Scene, Pose) {
    let scene = Scene {
        geometry: Geometry { tip_at_zero: 0.0, link_at_zero: 0.0, ..Geometry::default() },
        objects: Vec::new(),
    };
    // 90° of a link are 220.5 counts (the manual's 12128 / 55).
    (scene, [220.5, 220.5, 220.5, 0.0, 0.0, 0.0, 0.0])
}

fn close(found: Point, expected: Point) {
    let far = minus(found, expected);
    assert!(dot(far, far).sqrt() < 1e-9, "{found:?}, expected {expected:?}");
}

#[test]
fn finger_positions_follow_from_the_dimensions() {
    let (scene, pose) = upright();
    let fingers = scene.fingers(&pose);
    for (finger, x, y) in [(0, -0.05, -0.025), (1, -0.05, 0.025), (2, 0.05, 0.0)] {
        let [link, tip] = fingers[finger];
        close(link.ends[0], [x, y, 0.0]);
        close(link.ends[1], [x, y, 0.07]);
        close(tip.ends[1], [x, y, 0.12]);
    }
    // 180° of the spread: 18.28 turns of 18 counts for 360°.
    let spread = [220.5, 220.5, 220.5, 0.5 * 18.28 * 18.0, 0.0, 0.0, 0.0];
    let fingers = scene.fingers(&spread);
    close(fingers[0][0].ends[0], [0.05, -0.025, 0.0]);
    close(fingers[1][0].ends[0], [0.05, 0.025, 0.0]);
    let half = [220.5, 220.5, 220.5, 0.25 * 18.28 * 18.0, 0.0, 0.0, 0.0];
    let fingers = scene.fingers(&half);
    close(fingers[0][0].ends[0], [0.0, -0.075, 0.0]);
    close(fingers[1][0].ends[0], [0.0, 0.075, 0.0]);
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
    let ball = Capsule { ends: [[-0.05 + 0.03, -0.025, 0.12]; 2], radius_m: 0.021 };
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
