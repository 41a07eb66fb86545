//! A Bode plot as one self-contained HTML page.

use std::fmt::Write;

use num_complex::Complex64;

use crate::tuning::response::Response;

/// Drawing area in SVG units, and margins for the labels.
const WIDTH: f64 = 960.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 60.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 26.0;
const BOTTOM: f64 = 30.0;

/// Points of a curve: the interpolation shows between the measured ones.
const POINTS: usize = 600;

/// Magnitudes below are not drawn, dB.
const FLOOR_DB: f64 = -60.0;

struct Curve {
    name: &'static str,
    color: &'static str,
    of: fn(Complex64) -> f64,
}

fn db(value: Complex64) -> f64 {
    (20.0 * value.norm().log10()).max(FLOOR_DB)
}

fn phase(value: Complex64) -> f64 {
    // −360 to 0: a loop falls through −180.
    let degrees = value.arg().to_degrees();
    if degrees > 0.0 { degrees - 360.0 } else { degrees }
}

const ONE: Complex64 = Complex64::new(1.0, 0.0);

/// Magnitudes of L, T and S, and the phase of L, over the frequency; `facts` as preformatted text below.
#[must_use]
pub fn html(title: &str, response: &Response, facts: &str) -> String {
    let magnitude = plot(
        "Magnitude, dB",
        response,
        &[
            Curve { name: "L", color: "#1f5fbf", of: db },
            Curve { name: "T", color: "#2e8b57", of: |l| db(l / (ONE + l)) },
            Curve { name: "S", color: "#c0392b", of: |l| db(ONE / (ONE + l)) },
        ],
        0.0,
    );
    let phase =
        plot("Phase of L, degrees", response, &[Curve { name: "L", color: "#1f5fbf", of: phase }], -180.0);
    let title = escape(title);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\n\
         <style>body{{font:14px sans-serif;max-width:980px;margin:2em auto}}svg{{width:100%}}\
         text{{font-size:12px;fill:#444}}.grid{{stroke:#ddd}}.level{{stroke:#666}}path{{fill:none;stroke-width:1.6}}\
         </style></head>\n<body><h1>Bode plot</h1><p><code>{title}</code></p>\n{magnitude}{phase}<pre>{}</pre></body></html>\n",
        escape(facts)
    )
}

/// `level`: drawn as a line, and inside the plot.
fn plot(title: &str, response: &Response, curves: &[Curve], level: f64) -> String {
    let (Some(first), Some(last)) = (response.points().first(), response.points().last()) else {
        return String::new();
    };
    let (from, to) = (first.hz.ln(), last.hz.ln());
    let hz = |i: usize| (from + (to - from) * i as f64 / POINTS as f64).exp();
    let values: Vec<Vec<f64>> =
        curves.iter().map(|curve| (0..=POINTS).map(|i| (curve.of)(response.at(hz(i)))).collect()).collect();
    let (mut low, mut high) = (level, level);
    for value in values.iter().flatten().filter(|value| value.is_finite()) {
        (low, high) = (low.min(*value), high.max(*value));
    }
    let room = 0.05 * (high - low).max(1.0);
    let (low, high) = (low - room, high + room);
    let x = |hz: f64| LEFT + (hz.ln() - from) / (to - from) * (WIDTH - LEFT - RIGHT);
    let y = |value: f64| HEIGHT - BOTTOM - (value - low) / (high - low) * (HEIGHT - TOP - BOTTOM);
    let (right, bottom) = (WIDTH - RIGHT, HEIGHT - BOTTOM);
    let mut svg = format!("<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\"><text x=\"{LEFT}\" y=\"16\">{title}</text>");
    for (hz, label) in ticks_hz(first.hz, last.hz) {
        let at = x(hz);
        let _ =
            write!(svg, "<line class=\"grid\" x1=\"{at:.1}\" x2=\"{at:.1}\" y1=\"{TOP}\" y2=\"{bottom}\"/>");
        if label {
            let below = bottom + 18.0;
            let _ = write!(svg, "<text x=\"{at:.1}\" y=\"{below}\" text-anchor=\"middle\">{hz} Hz</text>");
        }
    }
    let step = if high - low > 120.0 { 45.0 } else { 10.0 };
    let mut tick = (low / step).ceil() * step;
    while tick <= high {
        let (at, class) = (y(tick), if tick == level { "level" } else { "grid" });
        let _ = write!(
            svg,
            "<line class=\"{class}\" x1=\"{LEFT}\" x2=\"{right}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/>\
             <text x=\"52\" y=\"{:.1}\" text-anchor=\"end\">{tick}</text>",
            at + 4.0
        );
        tick += step;
    }
    for (number, (curve, values)) in curves.iter().zip(&values).enumerate() {
        let points: Vec<String> =
            values.iter().enumerate().map(|(i, value)| format!("{:.1} {:.1}", x(hz(i)), y(*value))).collect();
        let Curve { name, color, .. } = curve;
        let at = right - 30.0 * (curves.len() - number) as f64;
        let _ = write!(
            svg,
            "<path stroke=\"{color}\" d=\"M{}\"/><text x=\"{at}\" y=\"16\" style=\"fill:{color}\">{name}</text>",
            points.join("L")
        );
    }
    svg + "</svg>\n"
}

/// 1, 2 … 9 of each decade; 1, 2 and 5 have labels.
fn ticks_hz(from: f64, to: f64) -> Vec<(f64, bool)> {
    let decades = (from.log10().floor() as i32)..=(to.log10().ceil() as i32);
    let all = decades.flat_map(|decade| (1..10).map(move |n| (n, f64::from(n) * 10f64.powi(decade))));
    all.filter(|(_, hz)| (from..=to).contains(hz)).map(|(n, hz)| (hz, [1, 2, 5].contains(&n))).collect()
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
