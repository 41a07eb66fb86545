//! A picture of the hand and its objects from the side and from above, as SVG.

use std::fmt::Write;

use hil_world::hand::scene::{Capsule, Point, Pose, Scene, gap};

/// SVG units per meter: 2.4 per millimeter.
const SCALE: f64 = 2400.0;

/// Size of a panel, m: the fingers reach 0.17 from the center, and as far up.
const WIDTH: f64 = 0.38;
const TALL: f64 = 0.34;

/// Space for captions, SVG units.
const HEAD: f64 = 56.0;
const LINE: f64 = 17.0;

/// Colors of fingers 1, 2 and 3, distinct for the color-blind.
const COLORS: [&str; 3] = ["#0b62c4", "#d9480f", "#1a7f4b"];

/// A view by its axes, of the palm: to the right and upwards.
struct View {
    name: &'static str,
    axes: [usize; 2],
    left: f64,
    /// Distance of the origin from the top, m.
    down: f64,
}

/// Both views, of a palm of that height.
const fn views(palm_m: f64) -> [View; 2] {
    [
        View { name: "From the side", axes: [1, 2], left: 0.0, down: 0.27 + palm_m },
        View { name: "From above", axes: [0, 1], left: WIDTH * SCALE, down: 0.17 },
    ]
}

impl View {
    fn at(&self, point: Point) -> [f64; 2] {
        let [right, up] = self.axes.map(|axis| point[axis] * SCALE);
        [self.left + 0.5 * WIDTH * SCALE + right, HEAD + self.down * SCALE - up]
    }

    fn capsule(&self, svg: &mut String, capsule: &Capsule, color: &str, opacity: f64) {
        let [[x1, y1], [x2, y2]] = capsule.ends.map(|end| self.at(end));
        let width = 2.0 * capsule.radius_m * SCALE;
        let _ = writeln!(
            svg,
            "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"{color}\" stroke-width=\"{width:.1}\" \
             stroke-linecap=\"round\" opacity=\"{opacity}\"/>"
        );
    }
}

fn text(svg: &mut String, [x, y]: [f64; 2], size: u32, text: &str) {
    let text = text.replace('&', "&amp;").replace('<', "&lt;");
    let _ =
        writeln!(svg, "<text x=\"{x:.0}\" y=\"{y:.0}\" font-size=\"{size}\" fill=\"#1c2128\">{text}</text>");
}

/// Draws the hand in a scene at `pose`, and faintly at `before`, under `title`.
#[must_use]
pub fn svg(scene: &Scene, before: &Pose, pose: &Pose, title: &str) -> String {
    let captions = captions(scene, pose);
    let width = 2.0 * WIDTH * SCALE;
    let bottom = HEAD + TALL * SCALE;
    let height = bottom + LINE * (captions.len() as f64 + 1.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    text(&mut svg, [16.0, 24.0], 18, title);
    let palm_m = scene.hand.palm_m;
    for view in &views(palm_m) {
        text(&mut svg, [view.left + 16.0, 46.0], 13, view.name);
        let palm = Capsule { ends: [-0.05, 0.05].map(|y| [0.0, y, palm_m - 0.012]), radius_m: 0.01 };
        view.capsule(&mut svg, &palm, "#d0d4d9", 1.0);
        for object in &scene.objects {
            view.capsule(&mut svg, &object.capsule, "#c9a227", 0.8);
        }
        for (pose, opacity) in [(before, [0.12, 0.08]), (pose, [0.85, 0.6])] {
            for (finger, color) in scene.fingers(pose).iter().zip(COLORS) {
                for (part, opacity) in finger.iter().zip(opacity) {
                    view.capsule(&mut svg, part, color, opacity);
                }
            }
        }
    }
    for (line, caption) in (1..).zip(&captions) {
        text(&mut svg, [16.0, bottom + LINE * f64::from(line) - 4.0], 13, caption);
    }
    svg.push_str("</svg>\n");
    svg
}

fn captions(scene: &Scene, pose: &Pose) -> Vec<String> {
    let caption = |(finger, parts): (usize, &[Capsule; 2])| {
        let mut text =
            format!("finger {}: link {:.1}, tip {:.1} counts", finger + 1, pose[finger], pose[finger + 4]);
        for (number, object) in (1..).zip(&scene.objects) {
            let [link, tip] = [0, 1].map(|part| 1000.0 * gap(&parts[part], &object.capsule));
            let _ = write!(text, "; to object {number}: link {link:.1} mm, tip {tip:.1} mm");
        }
        text
    };
    let mut captions: Vec<String> = scene.fingers(pose).iter().enumerate().map(caption).collect();
    captions.push(format!("spread: {:.1} counts", pose[3]));
    captions
}
