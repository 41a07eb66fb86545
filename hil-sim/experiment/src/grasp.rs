//! Files with the objects between a hand's fingers, as TOML:
//!
//! ```
//! let scene = hil_experiment::grasp::parse("ball.toml", r#"
//!     [hand]                     # optional, as is each key: the fields of `kinematics::Hand`
//!     link_mm = 70
//!
//!     [[object]]
//!     at_mm = [0, 0, 146]        # from the middle of the mounting face: y towards finger 3, z out of the palm
//!     to_mm = [50, 0, 146]       # optional: the other end of the axis; default: a sphere
//!     radius_mm = 35
//!     stiffness_n_m = 1e5        # optional
//! "#, &[0.0; 7]).unwrap();        // the pose at the start: no object may overlap a finger
//! assert_eq!(scene.objects.len(), 1);
//! ```

use std::path::Path;

use serde::Deserialize;
use toml::Spanned;

use super::toml_text::Source;
use hil_world::hand::scene::{Capsule, Pose, Scene, SceneObject};
use traces::input::BadInput;

/// Default stiffness, N/m; chosen: the full torque of a link, about 150 N at its tip, dents it by 0.8 mm.
const STIFFNESS_N_M: f64 = 2e5;

const MAX_FILE_BYTES: u64 = 1 << 16;

/// Maximum number of objects.
const OBJECTS: usize = 16;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    hand: Option<Spanned<Hand>>,
    #[serde(default)]
    object: Vec<Spanned<Object>>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct Hand {
    spread_axis_mm: Option<f64>,
    base_mm: Option<f64>,
    link_mm: Option<f64>,
    tip_mm: Option<f64>,
    palm_mm: Option<f64>,
    pad_mm: Option<f64>,
    link_at_zero_deg: Option<f64>,
    tip_at_zero_deg: Option<f64>,
    finger_radius_mm: Option<f64>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct Object {
    at_mm: [f64; 3],
    to_mm: Option<[f64; 3]>,
    radius_mm: f64,
    stiffness_n_m: Option<f64>,
}

/// A field's name, value, minimum and maximum.
type Row = (&'static str, f64, f64, f64);

/// Force with which a finger may press on an object at the start, N: a link's full torque is 150 N at its tip. A hand whose
/// power failed in a grasp starts so.
const PRESS_N: f64 = 200.0;

/// Reads the scene in a file, for a hand that starts at `pose`.
///
/// # Errors
/// The file cannot be read or is invalid, or a finger starts inside an object.
pub fn read(path: &Path, pose: &Pose) -> Result<Scene, BadInput> {
    let bad = |found: String| {
        BadInput::new(path.display().to_string(), "cannot be read")
            .found(found)
            .expected("a TOML file with [[object]] tables")
            .next("check the path; hil-sim/grasps has some")
    };
    let meta = path.metadata().map_err(|error| bad(error.to_string()))?;
    if !meta.is_file() || meta.len() > MAX_FILE_BYTES {
        return Err(bad(format!("no file of up to {MAX_FILE_BYTES} bytes")));
    }
    let text = std::fs::read_to_string(path).map_err(|error| bad(error.to_string()))?;
    parse(&path.display().to_string(), &text, pose)
}

/// Parses a scene for a hand that starts at `pose`; errors name it `file`.
///
/// # Errors
/// An invalid key or value, or an object that a finger starts in, with its line.
pub fn parse(file: &str, text: &str, pose: &Pose) -> Result<Scene, BadInput> {
    let source = Source { file, text };
    let parsed: File = toml::from_str(text).map_err(|error| source.reader_error(&error))?;
    let mut scene = Scene::default();
    if let Some(hand) = &parsed.hand {
        scene.hand = dimensions(source, hand)?;
    }
    if let Some(object) = parsed.object.get(OBJECTS) {
        let next = "take some out";
        return Err(source.error(object.span(), "too many objects", format!("up to {OBJECTS}"), next));
    }
    for object in &parsed.object {
        scene.objects.push(scene_object(source, object)?);
    }
    clear(source, &scene, &parsed.object, pose)?;
    Ok(scene)
}

/// A finger that starts inside an object would be thrown out of it.
fn clear(
    source: Source<'_>,
    scene: &Scene,
    objects: &[Spanned<Object>],
    pose: &Pose,
) -> Result<(), BadInput> {
    let Some((index, finger, part, depth_m)) = scene.overlap(pose) else { return Ok(()) };
    let (object, stiffness) = (&objects[index], scene.objects[index].stiffness_n_m);
    let (press_mm, fresh) = (1000.0 * PRESS_N / stiffness, *pose == Pose::default());
    let depth_mm = 1000.0 * depth_m;
    if !fresh && depth_mm <= press_mm {
        return Ok(());
    }
    let problem = format!("[[object]] overlaps the {part} of finger {finger} where the hand starts");
    let (expected, next) = if fresh {
        ("an object clear of the open fingers".to_owned(), "move it away from the fingers or make it smaller")
    } else {
        let expected = format!("an object clear of the fingers, or pressed in by up to {press_mm:.1} mm");
        (expected, "move it, or open the fingers first: start without this file, type HI, and leave")
    };
    let error = source.error(object.span(), problem, expected, next);
    Err(BadInput { found: format!("{depth_mm:.1} mm inside"), ..error })
}

fn dimensions(source: Source<'_>, hand: &Spanned<Hand>) -> Result<kinematics::Hand, BadInput> {
    let of = *hand.get_ref();
    let default = kinematics::Hand::default();
    let mm = |value: Option<f64>, default: f64| value.unwrap_or(1000.0 * default);
    let deg = |value: Option<f64>, default: f64| value.unwrap_or(default.to_degrees());
    let rows: [Row; 9] = [
        ("spread_axis_mm", mm(of.spread_axis_mm, default.spread_axis_m), 0.0, 1000.0),
        ("base_mm", mm(of.base_mm, default.base_m), 0.0, 1000.0),
        ("link_mm", mm(of.link_mm, default.link_m), 1.0, 1000.0),
        ("tip_mm", mm(of.tip_mm, default.tip_m), 1.0, 1000.0),
        ("palm_mm", mm(of.palm_mm, default.palm_m), 0.0, 1000.0),
        ("pad_mm", mm(of.pad_mm, default.pad_m), 0.1, 100.0),
        ("link_at_zero_deg", deg(of.link_at_zero_deg, default.link_at_zero), -180.0, 180.0),
        ("tip_at_zero_deg", deg(of.tip_at_zero_deg, default.tip_at_zero), -180.0, 180.0),
        ("finger_radius_mm", mm(of.finger_radius_mm, default.finger_radius_m), 0.1, 100.0),
    ];
    check(source, hand.span(), "[hand]", &rows)?;
    let [spread_axis, base, link, tip, palm, pad, link_at_zero, tip_at_zero, finger_radius] =
        rows.map(|row| row.1);
    Ok(kinematics::Hand {
        spread_axis_m: spread_axis / 1000.0,
        base_m: base / 1000.0,
        link_m: link / 1000.0,
        tip_m: tip / 1000.0,
        palm_m: palm / 1000.0,
        pad_m: pad / 1000.0,
        link_at_zero: link_at_zero.to_radians(),
        tip_at_zero: tip_at_zero.to_radians(),
        finger_radius_m: finger_radius / 1000.0,
        ..default
    })
}

fn scene_object(source: Source<'_>, object: &Spanned<Object>) -> Result<SceneObject, BadInput> {
    let of = *object.get_ref();
    let ends = [of.at_mm, of.to_mm.unwrap_or(of.at_mm)];
    let stiffness_n_m = of.stiffness_n_m.unwrap_or(STIFFNESS_N_M);
    let place = |name, value| (name, value, -1000.0, 1000.0);
    let mut rows = vec![("radius_mm", of.radius_mm, 0.1, 1000.0), ("stiffness_n_m", stiffness_n_m, 1.0, 1e6)];
    rows.extend(ends[0].map(|value| place("at_mm", value)));
    rows.extend(ends[1].map(|value| place("to_mm", value)));
    check(source, object.span(), "[[object]]", &rows)?;
    let capsule =
        Capsule { ends: ends.map(|end| end.map(|mm| mm / 1000.0)), radius_m: of.radius_mm / 1000.0 };
    Ok(SceneObject { capsule, stiffness_n_m })
}

fn check(
    source: Source<'_>,
    span: std::ops::Range<usize>,
    table: &str,
    rows: &[Row],
) -> Result<(), BadInput> {
    for &(name, found, min, max) in rows {
        if !(found >= min && found <= max) {
            let problem = format!("{table} {name} is out of range");
            let error =
                source.error(source.field(span, name), problem, format!("{min} to {max}"), "correct it");
            return Err(BadInput { found: format!("{name} = {found}"), ..error });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_scene_is_refused_with_its_line() {
        for (text, line, said) in [
            ("[[object]]\nat_mm = [0, 0, 70]\nradius_mm = 0", "x.toml:3", "radius_mm = 0"),
            ("\n[[object]]\nat_mm = [0, nan, 70]\nradius_mm = 3", "x.toml:3", "at_mm = NaN"),
            ("[[object]]\nat_mm = [0, 0]\nradius_mm = 3", "x.toml:2", "array of length 3"),
            ("[[object]]\nradius_mm = 3", "x.toml:1", "at_mm"),
            ("[hand]\nlink_mm = 0", "x.toml:2", "link_mm = 0"),
            ("[[object]]\nat = 3", "x.toml:2", "at"),
            ("[[object]]\nat_mm=[0,0,0]\nradius_mm=1\nstiffness_n_m=1e9", "x.toml:4", "1 to 1000000"),
            // Of the second object, not of the first.
            (
                "[[object]]\nat_mm=[0,0,0]\nradius_mm=1\n[[object]]\nat_mm=[0,0,0]\nradius_mm=0",
                "x.toml:6",
                "0.1 to",
            ),
            // Without a line of its own: the table's.
            ("object=[{at_mm=[0,0,0], radius_mm=0}]", "x.toml:1", "0.1 to"),
        ] {
            let error = parse("x.toml", text, &Pose::default()).expect_err(text).to_string();
            assert!(error.starts_with(line) && error.contains(said), "{text}\n{error}");
        }
        assert_eq!(parse("x.toml", "", &Pose::default()), Ok(Scene::default()));
    }

    #[test]
    fn object_that_overlaps_a_finger_at_the_start_is_refused_with_its_line() {
        let text = "# two\n[[object]]\nat_mm = [0, 0, 102]\nradius_mm = 10\n\n[[object]]\nat_mm = [0, 80, 79]\nradius_mm = 20";
        let error = parse("x.toml", text, &Pose::default()).expect_err("in finger 3's link").to_string();
        assert!(error.starts_with("x.toml:6") && error.contains("link of finger 3"), "{error}");
        assert!(error.contains("mm inside") && error.contains("move it away"), "{error}");
    }

    #[test]
    fn stored_grasp_may_press_on_its_object_but_not_start_inside_it() {
        let ball = |radius: f64| format!("[[object]]\nat_mm = [0, 0, 102]\nradius_mm = {radius}");
        let scene = parse("x", &ball(34.0), &Pose::default()).expect("clear of open fingers");
        let depth = |pose: &Pose| scene.overlap(pose).map_or(0.0, |found| 1000.0 * found.3);
        let closed =
            |count: i32| Pose::map([1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0], |moves| moves * f64::from(count));
        let pose = (0..338).map(closed).find(|pose| depth(pose) > 0.0).expect("a link meets the ball");
        let radius = 34.0 - depth(&pose);
        assert!(parse("x", &ball(radius + 0.9), &pose).is_ok(), "180 N at 2e5 N/m");
        let error = parse("x", &ball(radius + 1.1), &pose).expect_err("220 N").to_string();
        assert!(error.contains("open the fingers first"), "{error}");
    }
}
