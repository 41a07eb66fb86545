//! Charts of `docs/`, drawn by the tests that measure what they show.

use std::fmt::Write as _;
use std::path::PathBuf;

const WIDTH: f64 = 900.0;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 24.0;
const PANEL: f64 = 190.0;
const GAP: f64 = 62.0;

const ENVELOPE: &str = "#9ec5f0";

/// Blue, of the nominal motor, and orange.
pub const BLUE: &str = "#0b62c4";
pub const ORANGE: &str = "#d9480f";

pub type Points = Vec<(f64, f64)>;

/// One diagram: its ranges from low to high, with the distance of grid lines.
pub struct Panel {
    pub title: String,
    pub x: (f64, f64, f64),
    pub y: (f64, f64, f64),
    /// The lower and the upper edge of an area.
    pub band: Option<(Points, Points)>,
    /// Curves by their colors.
    pub lines: Vec<(&'static str, Points)>,
}

impl Panel {
    fn draw(&self, svg: &mut String, top: f64) {
        let (left, right, x_grid) = self.x;
        let (low, high, y_grid) = self.y;
        let at = |&(x, y): &(f64, f64)| {
            let y = y.clamp(low, high);
            let across = LEFT + (WIDTH - LEFT - RIGHT) * (x - left) / (right - left);
            format!("{across:.1},{:.1}", top + PANEL * (high - y) / (high - low))
        };
        let path = |points: &Points| points.iter().map(at).collect::<Vec<_>>().join(" ");
        text(svg, LEFT, top - 10.0, "#1c2128", &self.title);
        let mut value = low;
        while value <= high + 1e-9 {
            let y = top + PANEL * (high - value) / (high - low);
            let end = WIDTH - RIGHT;
            let _ = writeln!(
                svg,
                "<line x1=\"{LEFT:.0}\" y1=\"{y:.1}\" x2=\"{end:.0}\" y2=\"{y:.1}\" stroke=\"#d0d7de\"/>"
            );
            text(svg, 14.0, y + 4.0, "#57606a", &format!("{value:.0}"));
            value += y_grid;
        }
        let mut value = left;
        while value <= right + 1e-9 {
            let x = LEFT + (WIDTH - LEFT - RIGHT) * (value - left) / (right - left);
            text(svg, x - 8.0, top + PANEL + 15.0, "#57606a", &format!("{value:.0}"));
            value += x_grid;
        }
        if let Some((lower, upper)) = &self.band {
            let back: Points = lower.iter().rev().copied().collect();
            let _ =
                writeln!(svg, "<polygon fill=\"{ENVELOPE}\" points=\"{} {}\"/>", path(upper), path(&back));
        }
        for (color, points) in &self.lines {
            let points = path(points);
            let _ = writeln!(
                svg,
                "<polyline fill=\"none\" stroke=\"{color}\" stroke-width=\"1.5\" points=\"{points}\"/>"
            );
        }
    }
}

fn text(svg: &mut String, x: f64, y: f64, color: &str, text: &str) {
    let _ = writeln!(svg, "<text x=\"{x:.0}\" y=\"{y:.0}\" font-size=\"12\" fill=\"{color}\">{text}</text>");
}

fn svg(panels: &[Panel]) -> String {
    let height = (PANEL + GAP) * panels.len() as f64 + 10.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH:.0} {height:.0}\" font-family=\"sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
    );
    for (index, panel) in panels.iter().enumerate() {
        panel.draw(&mut svg, 30.0 + (PANEL + GAP) * index as f64);
    }
    svg + "</svg>\n"
}

/// Compares the chart of these panels with the one in `docs/`, or writes it if the environment variable `make` is set.
///
/// # Panics
/// If they differ: then `test` has changed what it measures.
pub fn keep(file: &str, make: &str, test: &str, panels: &[Panel]) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs").join(file);
    let drawn = svg(panels);
    if std::env::var_os(make).is_some() {
        std::fs::write(&path, &drawn).expect("docs can be written");
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(kept == drawn, "docs/{file} is out of date: {make}=1 cargo test -p system-tests {test}");
}
