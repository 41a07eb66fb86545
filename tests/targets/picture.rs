//! `docs/servo.svg`: what the servo does, on the nominal motor and on 40 scattered plants.

use std::fmt::Write as _;
use std::path::PathBuf;

use hil_sim::node::Sample;
use tater_wire::Property;

use super::figures::{each, torque_error};
use super::optimum::optimum_path;
use super::rig::{Motor, Setup};

/// With this environment variable set, the test writes the picture instead of comparing it.
const MAKE: &str = "MAKE_SERVO_PICTURE";

/// Plants of an envelope, which shows 5 to 95 % of them.
const PLANTS: u64 = 40;

const WIDTH: f64 = 900.0;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 24.0;
const PANEL: f64 = 190.0;
const GAP: f64 = 62.0;

const NOMINAL: &str = "#0b62c4";
const OPTIMUM: &str = "#d9480f";
const ENVELOPE: &str = "#9ec5f0";

type Points = Vec<(f64, f64)>;

/// One diagram: its ranges from low to high, with the distance of grid lines.
struct Panel {
    title: &'static str,
    x: (f64, f64, f64),
    y: (f64, f64, f64),
    band: Option<(Points, Points)>,
    lines: Vec<(&'static str, Points)>,
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
        text(svg, LEFT, top - 10.0, "#1c2128", self.title);
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

/// A figure of each ms of a run: of the nominal motor, and the 5 and 95 % of the scattered plants.
fn envelope(run: impl Fn(Option<u64>) -> Vec<f64> + Sync) -> (Points, (Points, Points)) {
    let runs = each(0..PLANTS, |seed| run(Some(seed)));
    let of_ms =
        |values: Vec<f64>| values.into_iter().enumerate().map(|(ms, value)| (ms as f64, value)).collect();
    let nominal = run(None);
    let share = |percent: usize| {
        let at = |ms: usize| {
            let mut values: Vec<f64> = runs.iter().map(|run| run[ms]).collect();
            values.sort_by(f64::total_cmp);
            values[(values.len() - 1) * percent / 100]
        };
        of_ms((0..nominal.len()).map(at).collect())
    };
    let band = (share(5), share(95));
    (of_ms(nominal.clone()), band)
}

fn counts(samples: &[Sample]) -> Vec<f64> {
    samples.iter().map(|sample| sample.truth.counts).collect()
}

/// A step, a slow move and the fastest one.
fn moves() -> Vec<Panel> {
    let step = Setup::new("link", "ACCEL = 1000, MV = 4080, HOLD = 1", 0.0);
    let (stepped, step_band) = envelope(|seed| {
        let mut motor = Motor::new(&step, seed);
        motor.set(Property::M, 10);
        counts(&motor.run(120))
    });
    let slow = Setup::new("link", "MV = 16", 0.0);
    let (slowly, slow_band) = envelope(|seed| {
        let mut motor = Motor::new(&slow, seed);
        motor.set(Property::M, 100);
        motor.run(1_500).iter().map(|sample| sample.truth.counts_per_s).collect()
    });
    let travel = Setup::new("link", "ACCEL = 1000, MV = 4080", -25.0);
    let (travelled, travel_band) = envelope(|seed| {
        let mut motor = Motor::new(&travel, seed);
        motor.set(Property::M, 338);
        counts(&motor.run(700))
    });
    let nominal = Motor::new(&travel, None);
    let optimum: Points = optimum_path(nominal.node.board().rig().plant(), 363.0)
        .into_iter()
        .map(|(ms, counts)| (ms, counts - 25.0))
        .collect();
    vec![
        Panel {
            title: "A link's step of 10 counts: counts over ms. Line: the nominal motor; area: 5 to 95 % of 40 plants of ±30 %",
            x: (0.0, 120.0, 20.0),
            y: (0.0, 12.0, 2.0),
            band: Some(step_band),
            lines: vec![(NOMINAL, stepped)],
        },
        Panel {
            title: "A link's move at MV 16: true velocity in counts/s over ms",
            x: (0.0, 1_500.0, 250.0),
            y: (0.0, 32.0, 8.0),
            band: Some(slow_band),
            lines: vec![(NOMINAL, slowly)],
        },
        Panel {
            title: "A link's full travel, ACCEL 1000, MV 4080: counts over ms. Orange: the shortest time that the nominal motor allows",
            x: (0.0, 700.0, 100.0),
            y: (-50.0, 350.0, 50.0),
            band: Some(travel_band),
            lines: vec![(OPTIMUM, optimum), (NOMINAL, travelled)],
        },
    ]
}

/// A load on a joint that is held, and the torque.
fn forces() -> Vec<Panel> {
    let load = Setup::new("spread", "", 0.0);
    let (loaded, load_band) = envelope(|seed| {
        let mut motor = Motor::new(&load, seed);
        motor.set(Property::MODE, 3);
        motor.run(250);
        motor.node.rig_mut().set_disturbance(0.2);
        counts(&motor.run(200))
    });
    let torques: Vec<i64> = (1..=15).map(|step| 50 * step).collect();
    let errors = |turning: bool| -> Points {
        torques
            .iter()
            .filter(|&&t| !turning || t >= 100)
            .map(|&t| (t as f64, torque_error(None, t, turning, 25.0)))
            .collect()
    };
    vec![
        Panel {
            title: "0.2 N m on a spread that holds its position, from 0 ms on: counts over ms",
            x: (0.0, 200.0, 25.0),
            y: (-1.0, 4.0, 1.0),
            band: Some(load_band),
            lines: vec![(NOMINAL, loaded)],
        },
        Panel {
            title: "Error of the torque in mode 2, % over T. Blue: against a stop; orange: turning at 100 counts/s",
            x: (0.0, 750.0, 50.0),
            y: (-10.0, 10.0, 5.0),
            band: None,
            lines: vec![(NOMINAL, errors(false)), (OPTIMUM, errors(true))],
        },
    ]
}

fn svg() -> String {
    let panels: Vec<Panel> = moves().into_iter().chain(forces()).collect();
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

#[test]
fn picture_of_the_servo_is_current() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/servo.svg");
    let drawn = svg();
    if std::env::var_os(MAKE).is_some() {
        std::fs::write(&path, &drawn).expect("docs can be written");
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        kept == drawn,
        "docs/servo.svg is out of date: {MAKE}=1 cargo test -p system-tests targets::picture"
    );
}
