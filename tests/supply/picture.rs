//! `docs/supply.svg`: bus voltage and current of seven motors that stall, start and reverse at once.

use std::fmt::Write as _;
use std::path::PathBuf;

use super::{Act, Hand, ORDER_US, Supply};

/// With this environment variable set, the test writes the picture instead of comparing it.
const MAKE: &str = "MAKE_SUPPLY_PICTURE";

/// Shown from before the order to after it, µs, in steps.
const BEFORE_US: u64 = 20_000;
const AFTER_US: u64 = 120_000;
const STEP_US: u64 = 500;

const WIDTH: f64 = 900.0;
const LEFT: f64 = 56.0;
const PANEL: f64 = 150.0;
const GAP: f64 = 46.0;

/// A curve's name, color, range, and unit per grid line.
struct Axis {
    name: &'static str,
    color: &'static str,
    low: f64,
    high: f64,
    grid: f64,
}

const VOLTS: Axis = Axis { name: "bus, V", color: "#0b62c4", low: 18.0, high: 32.0, grid: 4.0 };
const AMPS: Axis = Axis { name: "into the motors, A", color: "#d9480f", low: -30.0, high: 60.0, grid: 30.0 };

fn text(svg: &mut String, x: f64, y: f64, color: &str, text: &str) {
    let _ = writeln!(svg, "<text x=\"{x:.0}\" y=\"{y:.0}\" font-size=\"12\" fill=\"{color}\">{text}</text>");
}

fn panel(svg: &mut String, top: f64, axis: &Axis, points: &[(f64, f64)]) {
    let y = |value: f64| top + PANEL * (axis.high - value) / (axis.high - axis.low);
    let x = |ms: f64| {
        let (before, after) = (BEFORE_US as f64 / 1e3, AFTER_US as f64 / 1e3);
        LEFT + (WIDTH - LEFT - 10.0) * (ms + before) / (before + after)
    };
    let mut value = axis.low;
    while value <= axis.high {
        let (at, right) = (y(value), WIDTH - 10.0);
        let _ = writeln!(
            svg,
            "<line x1=\"{LEFT:.0}\" y1=\"{at:.1}\" x2=\"{right:.0}\" y2=\"{at:.1}\" stroke=\"#d0d7de\"/>"
        );
        text(svg, 20.0, at + 4.0, "#57606a", &format!("{value:.0}"));
        value += axis.grid;
    }
    for ms in (-20..=120).step_by(20) {
        text(svg, x(f64::from(ms)) - 8.0, top + PANEL + 14.0, "#57606a", &format!("{ms}"));
    }
    let line: Vec<String> =
        points.iter().map(|&(ms, value)| format!("{:.1},{:.1}", x(ms), y(value))).collect();
    let _ = writeln!(
        svg,
        "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"1.5\" points=\"{}\"/>",
        axis.color,
        line.join(" ")
    );
    text(svg, LEFT + 4.0, top - 6.0, axis.color, axis.name);
}

fn svg() -> String {
    let rows = [
        ("Seven stalls: T 990 against the stop, from rest", Act::Stall, 990),
        ("Seven starts: T 990 from rest", Act::Start, 990),
        ("Seven reversals: T 990 at full speed the other way", Act::Reverse, 990),
        ("Seven reversals with T 300, which return the most", Act::Reverse, 300),
    ];
    let row = 2.0 * (PANEL + GAP) + 30.0;
    let height = row * rows.len() as f64 + 10.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH:.0} {height:.0}\" font-family=\"sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
    );
    for (index, (title, act, torque)) in rows.into_iter().enumerate() {
        let mut hand = Hand::native([act; 7], None, Supply::new(24.0, 7));
        let (mut volts, mut amps) = (Vec::new(), Vec::new());
        hand.act([act; 7], torque, |at_us, supply| {
            let shown = (ORDER_US - BEFORE_US..=ORDER_US + AFTER_US).contains(&at_us);
            if shown && at_us.is_multiple_of(STEP_US) {
                let ms = (at_us as f64 - ORDER_US as f64) / 1e3;
                volts.push((ms, supply.volts()));
                amps.push((ms, supply.motors_a()));
            }
        });
        let top = row * index as f64 + 20.0;
        text(
            &mut svg,
            LEFT,
            top,
            "#1c2128",
            &format!("{title} (ms after the order; 24 V, 30 A, 2.2 mF a board)"),
        );
        panel(&mut svg, top + 26.0, &VOLTS, &volts);
        panel(&mut svg, top + 26.0 + PANEL + GAP, &AMPS, &amps);
    }
    svg + "</svg>\n"
}

#[test]
fn picture_of_the_supply_is_current() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../docs/supply.svg");
    let drawn = svg();
    if std::env::var_os(MAKE).is_some() {
        std::fs::write(&path, &drawn).expect("docs can be written");
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(
        kept == drawn,
        "docs/supply.svg is out of date: {MAKE}=1 cargo test -p system-tests supply::picture"
    );
}
