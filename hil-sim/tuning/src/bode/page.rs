//! A Bode plot with its margins, as charts of a page or as a page of its own.

use num_complex::Complex64;

use crate::response::Response;
use charts::{Chart, Level, Mark, Series, Sheet, escape};

/// Points of a curve: the interpolation shows between the measured ones.
const POINTS: usize = 600;

/// Magnitudes below are not drawn, dB.
const FLOOR_DB: f64 = -60.0;

fn db(value: Complex64) -> f64 {
    (20.0 * value.norm().log10()).max(FLOOR_DB)
}

fn phase(value: Complex64) -> f64 {
    // −360 to 0: a loop falls through −180.
    let degrees = value.arg().to_degrees();
    if degrees > 0.0 { degrees - 360.0 } else { degrees }
}

/// Name, class, and what it makes of L.
type Curve = (&'static str, &'static str, fn(Complex64) -> f64);

const ONE: Complex64 = Complex64::new(1.0, 0.0);

/// Magnitudes of L, T and S, and the phase of L, over the frequency; `facts` as preformatted text below.
#[must_use]
pub fn html(title: &str, response: &Response, facts: &str) -> String {
    let mut sheet = Sheet::new(title);
    sheet.push(&format!("<header><h1>Bode plot</h1>\n<p><code>{}</code></p></header>\n", escape(title)));
    sheet.help();
    charts(&mut sheet, "bode", response);
    sheet.push(&format!("<pre>{}</pre>\n", escape(facts)));
    sheet.finish()
}

/// Two charts, magnitude and phase, with the margins marked; `group` is a name that no other response of the page has.
pub fn charts(sheet: &mut Sheet, group: &str, response: &Response) {
    let (Some(first), Some(last)) = (response.points().first(), response.points().last()) else { return };
    let (from, to) = (first.hz.ln(), last.hz.ln());
    let all: Vec<f64> = (0..=POINTS).map(|i| (from + (to - from) * i as f64 / POINTS as f64).exp()).collect();
    let values = |of: fn(Complex64) -> f64| all.iter().map(|hz| of(response.at(*hz))).collect();
    let hz = sheet.column(all.clone(), None);
    let marks = marks(response);
    let chart = |title: &str, unit: &str, level: f64| {
        let mut chart = Chart::new(title, unit, "Hz");
        (chart.x.log, chart.x.group) = (true, Some(group.to_owned()));
        chart.levels.push(Level { value: level, class: "goal", label: String::new() });
        (chart.height, chart.marks) = (320.0, marks.clone());
        chart
    };
    let mut magnitude = chart("Magnitude", "dB; L open loop, T closed loop, S sensitivity", 0.0);
    magnitude.labeled = true;
    let curves: [Curve; 3] =
        [("L", "c1", db), ("T", "c3", |l| db(l / (ONE + l))), ("S", "c2", |l| db(ONE / (ONE + l)))];
    for (name, class, of) in curves {
        let column = sheet.column(values(of), Some(2));
        magnitude.series.push(Series::line(name, class, hz, column));
    }
    sheet.chart(&magnitude);
    let mut angle = chart("Phase of L", "degrees", -180.0);
    let column = sheet.column(values(phase), Some(1));
    angle.series.push(Series::line("L", "c1", hz, column));
    sheet.chart(&angle);
}

/// Where the margins are read.
fn marks(response: &Response) -> Vec<Mark> {
    let margins = response.margins();
    let phase = margins.crossover_hz.zip(margins.phase_margin_deg);
    let gain = margins.phase_crossover_hz.zip(margins.gain_margin);
    let marks = [
        phase.map(|(hz, deg)| (hz, deg > 0.0, format!("phase margin {deg:.1}° at {hz:.3} Hz"))),
        gain.map(|(hz, factor)| (hz, factor > 1.0, format!("gain margin {factor:.2} at {hz:.3} Hz"))),
        Some((margins.ms_hz, true, format!("Ms {:.2} at {:.3} Hz", margins.ms, margins.ms_hz))),
    ];
    let mark = |(x, is_good, label)| Mark { x, class: if is_good { "good" } else { "bad" }, label };
    let mut marks: Vec<Mark> = marks.into_iter().flatten().map(mark).filter(|mark| mark.x > 0.0).collect();
    marks.sort_by(|a, b| a.x.total_cmp(&b.x));
    marks
}
