//! The HTML page of a run: metrics, verdicts and charts in one self-contained file.

use std::fmt::Write;

use super::chart::{Chart, Mark, Series, escape};
use super::model_name;
use crate::experiment::metrics::{METRICS, Value, end_word};
use crate::experiment::properties::PROPERTIES;
use crate::experiment::run::{MotorRun, Outcome};
use crate::experiment::scenario::{Case, Scenario, motor_name};
use crate::experiment::trace::Trace;

const HEADLINES: [(&str, &str, &str); 8] = [
    ("end_ms", "end of move", "ms"),
    ("overshoot_counts", "overshoot", "counts"),
    ("final_error_counts", "final error", "counts"),
    ("tracking_rms_counts", "tracking RMS", "counts"),
    ("hold_error_counts", "hold error", "counts"),
    ("peak_torque", "peak torque", "/ 1024"),
    ("peak_current_a", "peak current", "A"),
    ("peak_winding_c", "peak winding", "°C"),
];

/// The page.
#[must_use]
pub fn html(scenario: &Scenario, outcome: &Outcome) -> String {
    let passed = outcome.expectations.iter().filter(|verdict| verdict.ok).count();
    let (badge, verdict) = if outcome.passed() { ("good", "passed") } else { ("bad", "failed") };
    let name = escape(&scenario.name);
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{name} · hil-sim</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n\
         <header><h1>{name} <span class=\"badge {badge}\">{verdict}: {passed} of {}</span></h1>\n\
         <p>{}</p>\n<p class=\"how\"><code>hil-sim run {} --seed {} --model {}</code></p></header>\n",
        outcome.expectations.len(),
        escape(&scenario.about),
        escape(&scenario.arguments),
        outcome.options.seed,
        model_name(outcome.options.model),
    );
    expectations(&mut page, outcome);
    for (case, run) in scenario.cases.iter().zip(&outcome.runs) {
        motor(&mut page, scenario, case, run);
    }
    page.push_str("</main>\n</body>\n</html>\n");
    page
}

/// One curve over time.
pub struct Plot {
    /// What it shows.
    pub title: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Least span of the axis.
    pub least_span: f64,
    /// Times, ms.
    pub times: Vec<f64>,
    /// Values.
    pub values: Vec<f64>,
}

/// A page with a table and curves. `head` and the `rows` are plain text; the first column is on the left.
#[must_use]
pub fn plots(name: &str, about: &str, head: &[&str], rows: &[Vec<String>], plots: &[Plot]) -> String {
    let name = escape(name);
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{name} · hil-sim</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n\
         <header><h1>{name}</h1>\n<p>{}</p></header>\n<table><tr>",
        escape(about)
    );
    head.iter().for_each(|cell| page.push_str(&format!("<th>{}</th>", escape(cell))));
    page.push_str("</tr>\n");
    for row in rows {
        let cells: String = row.iter().map(|cell| format!("<td>{}</td>", escape(cell))).collect();
        let _ = writeln!(page, "<tr>{cells}</tr>");
    }
    page.push_str("</table>\n<h2>Residuals</h2>\n");
    for plot in plots {
        let series = vec![Series { name: plot.title, class: "c1", values: plot.values.clone() }];
        let chart = Chart {
            title: plot.title,
            unit: plot.unit,
            height: 220.0,
            least_span: plot.least_span,
            lanes: &[],
            times: &plot.times,
            series,
            marks: &[],
            labeled: false,
        };
        page.push_str(&chart.svg());
    }
    page.push_str("</main>\n</body>\n</html>\n");
    page
}

fn expectations(page: &mut String, outcome: &Outcome) {
    if outcome.expectations.is_empty() {
        return;
    }
    page.push_str("<h2>Expectations</h2>\n<table><tr><th></th><th>metric</th><th class=\"n\">value</th><th>wanted</th></tr>\n");
    for verdict in &outcome.expectations {
        let (class, mark) = if verdict.ok { ("good", "✓") } else { ("bad", "✗") };
        let _ = writeln!(
            page,
            "<tr class=\"{class}\"><td class=\"mark\">{mark}</td><td>{}</td><td class=\"n\">{}</td><td>{}</td></tr>",
            escape(&verdict.name),
            escape(&verdict.value.to_string()),
            escape(&verdict.want)
        );
    }
    page.push_str("</table>\n");
}

fn motor(page: &mut String, scenario: &Scenario, case: &Case, run: &MotorRun) {
    let end = run.metrics.end_reason.map_or(String::new(), |reason| format!(" · {}", end_word(reason)));
    let _ = writeln!(page, "<h2>{} motor{end}</h2>\n<div class=\"tiles\">", capital(motor_name(run.motor)));
    for (name, label, unit) in HEADLINES {
        let value =
            METRICS.iter().find(|metric| metric.name == name).map(|metric| (metric.get)(&run.metrics));
        if let Some(value @ Value::Number(_)) = value {
            let _ = writeln!(
                page,
                "<div class=\"tile\"><b>{}</b> <span>{unit}</span><br><small>{label}</small></div>",
                short(&value)
            );
        }
    }
    page.push_str("</div>\n");
    if let Some(trace) = &run.trace {
        for chart in charts(trace, &trace.column("time_ms"), &marks(scenario, run)) {
            page.push_str(&chart);
        }
    }
    page.push_str("<div class=\"columns\">\n<section><h3>Metrics</h3><table>\n");
    for metric in &METRICS {
        let value = (metric.get)(&run.metrics);
        let _ = writeln!(
            page,
            "<tr><td>{}<br><small>{}</small></td><td class=\"n\">{value}</td></tr>",
            metric.name, metric.about
        );
    }
    page.push_str("</table></section>\n<section><h3>Properties</h3><table>\n");
    properties(page, case);
    page.push_str("</table></section>\n<section><h3>Log</h3><table>\n");
    for (ms, entry) in &run.log {
        let _ = writeln!(page, "<tr><td class=\"n\">{ms} ms</td><td>{}</td></tr>", escape(entry));
    }
    page.push_str("</table></section>\n</div>\n");
}

fn properties(page: &mut String, case: &Case) {
    let defaults = tater_fw::motion::defaults(case.motor);
    for property in &PROPERTIES {
        let (value, default) = (property.get(&case.config), property.get(&defaults));
        let class = if value == default { "" } else { " class=\"changed\"" };
        let _ = writeln!(
            page,
            "<tr{class}><td>{}<br><small>{}</small></td><td class=\"n\">{value}</td></tr>",
            property.name, property.about
        );
    }
}

fn marks(scenario: &Scenario, run: &MotorRun) -> Vec<Mark> {
    let mut marks: Vec<Mark> = scenario
        .timeline
        .iter()
        .map(|timed| Mark { ms: f64::from(timed.ms), class: "command", label: timed.action.to_string() })
        .collect();
    for (ms, entry) in &run.log {
        let class = match entry.as_str() {
            entry if entry.starts_with("refused") || entry.starts_with("fault") => "bad",
            entry if entry.starts_with("glitch") => continue,
            _ => "good",
        };
        marks.push(Mark { ms: f64::from(*ms), class, label: entry.clone() });
    }
    marks.sort_by(|a, b| a.ms.total_cmp(&b.ms));
    marks
}

/// A chart's title, unit, height, minimum span of its y axis, and curves (name, class, column).
type Row = (&'static str, &'static str, f64, f64, &'static [(&'static str, &'static str, &'static str)]);

/// Top to bottom. Positions are in the plant's counts, so that HI causes no jump in the curves.
const CHARTS: [Row; 6] = [
    (
        "Position",
        "hall counts",
        300.0,
        4.0,
        &[
            ("set-point", "goal", "setpoint_counts"),
            ("true rotor", "c1", "position_counts"),
            ("estimated", "c2 thin", "position_estimated_counts"),
        ],
    ),
    ("Lag", "hall counts, set-point − true rotor", 150.0, 2.0, &[("lag", "c1", "lag_counts")]),
    (
        "Velocity",
        "hall counts / s",
        220.0,
        20.0,
        &[
            ("set-point", "goal", "velocity_setpoint_counts_s"),
            ("true rotor", "c1", "velocity_counts_s"),
            ("estimated", "c2 thin", "velocity_estimated_counts_s"),
        ],
    ),
    (
        "Torque and duty",
        "% of peak torque, % of bus voltage",
        190.0,
        20.0,
        &[("torque", "c1", "torque_percent"), ("duty", "c2 thin", "duty_percent")],
    ),
    (
        "Currents",
        "A",
        190.0,
        1.0,
        &[
            ("phase A", "c1 thin", "phase_a_a"),
            ("phase B", "c2 thin", "phase_b_a"),
            ("phase C", "c3 thin", "phase_c_a"),
            ("bus", "goal", "bus_a"),
        ],
    ),
    (
        "Temperature",
        "°C",
        150.0,
        5.0,
        &[
            ("winding", "c1", "winding_c"),
            ("housing", "c2", "housing_c"),
            ("thermistor", "c3 thin", "thermistor_c"),
        ],
    ),
];

fn charts(trace: &Trace, times: &[f64], marks: &[Mark]) -> Vec<String> {
    let mut charts = Vec::new();
    for (title, unit, height, least_span, curves) in &CHARTS {
        let curves = curves.iter().map(|(name, class, column)| (name, class, curve(trace, column)));
        let series: Vec<Series> =
            curves.map(|(name, class, values)| Series { name, class, values }).collect();
        // Some values exist only in some modes, such as the lag in modes 3 and 5.
        if series.iter().any(|series| series.values.iter().any(|value| value.is_finite())) {
            let (height, least_span, labeled) = (*height, *least_span, *title == "Position");
            let chart = Chart { title, unit, height, least_span, lanes: &[], times, series, marks, labeled };
            charts.push(chart.svg());
        }
    }
    charts.insert(charts.len() - 1, halls(trace, times, marks));
    charts
}

fn curve(trace: &Trace, name: &str) -> Vec<f64> {
    match name {
        "setpoint_counts" => {
            // Only modes 3 (PID) and 5 (trapezoidal) have one.
            let goals = in_plant(trace, name).into_iter().zip(trace.column("mode"));
            goals.map(|(goal, mode)| if mode == 3.0 || mode == 5.0 { goal } else { f64::NAN }).collect()
        }
        "position_estimated_counts" => in_plant(trace, name),
        "lag_counts" => {
            let goals = curve(trace, "setpoint_counts").into_iter();
            goals.zip(trace.column("position_counts")).map(|(goal, is)| goal - is).collect()
        }
        "torque_percent" => trace.column("torque_per_1024").iter().map(|torque| torque / 10.24).collect(),
        _ => trace.column(name),
    }
}

fn in_plant(trace: &Trace, name: &str) -> Vec<f64> {
    trace.column(name).iter().zip(trace.column("zero_counts")).map(|(counts, zero)| counts + zero).collect()
}

fn halls(trace: &Trace, times: &[f64], marks: &[Mark]) -> String {
    let codes = trace.column("halls_code");
    let lane = |name, class, bit: u8| {
        let base = f64::from(bit) + 0.1;
        let high = |code: &f64| (*code as u8) >> bit & 1 == 1;
        let values = codes.iter().map(|code| base + if high(code) { 0.75 } else { 0.0 }).collect();
        Series { name, class, values }
    };
    let series = vec![lane("bit 0", "c1 thin", 0), lane("bit 1", "c2 thin", 1), lane("bit 2", "c3 thin", 2)];
    Chart {
        title: "Halls",
        unit: "bits of the code",
        height: 150.0,
        least_span: 1.0,
        lanes: &["bit 0", "bit 1", "bit 2"],
        times,
        series,
        marks,
        labeled: false,
    }
    .svg()
}

fn capital(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

fn short(value: &Value) -> String {
    match value {
        Value::Number(value) if value.abs() < 10.0 && *value != value.trunc() => format!("{value:.2}"),
        Value::Number(value) if value.abs() < 100.0 && *value != value.trunc() => format!("{value:.1}"),
        Value::Number(value) => format!("{value:.0}"),
        other => other.to_string(),
    }
}

/// Blue, vermilion and green are distinct for color-blind readers. The page is dark if the reader's system is.
const STYLE: &str = "
:root { color-scheme: light dark; --bg:#fbfbfa; --ink:#1c2128; --soft:#667080; --line:#e3e5e8; --frame:#9aa3ad;
  --card:#fff; --c1:#0b62c4; --c2:#d9480f; --c3:#1a7f4b; --good:#1a7f4b; --bad:#c92a2a; --goal:#8a929c; }
@media (prefers-color-scheme: dark) { :root { --bg:#14171b; --ink:#e6e9ed; --soft:#98a2ae; --line:#2a3038;
  --frame:#5b6672; --card:#1b1f25; --c1:#5aa9ff; --c2:#ff8a4c; --c3:#4cc38a; --good:#4cc38a; --bad:#ff6b6b;
  --goal:#98a2ae; } }
body { margin:0; background:var(--bg); color:var(--ink); font:15px/1.45 system-ui,'Segoe UI','DejaVu Sans',sans-serif; }
main { max-width:1100px; margin:0 auto; padding:28px 20px 60px; }
h1 { font-size:26px; margin:0 0 6px; } h2 { font-size:19px; margin:30px 0 10px; } h3 { font-size:15px; margin:0 0 6px; }
header p { margin:4px 0; color:var(--soft); } code { font-size:13px; }
.badge { font-size:13px; font-weight:600; padding:3px 10px; border-radius:12px; color:#fff; vertical-align:middle; }
.badge.good { background:var(--good); } .badge.bad { background:var(--bad); }
.tiles { display:flex; flex-wrap:wrap; gap:10px; margin-bottom:14px; }
.tile { background:var(--card); border:1px solid var(--line); border-radius:8px; padding:8px 14px; min-width:92px; }
.tile b { font-size:20px; font-variant-numeric:tabular-nums; } .tile span, small { color:var(--soft); font-size:12px; }
svg { display:block; width:100%; height:auto; background:var(--card); border:1px solid var(--line); border-radius:8px;
  margin:0 0 10px; }
svg text { fill:var(--ink); font-size:12px; } svg .title { font-size:14px; font-weight:600; }
svg .unit, svg .tick { fill:var(--soft); font-weight:400; font-size:12px; } svg .tick { font-size:11px; }
.grid { stroke:var(--line); stroke-width:1; } .grid.zero { stroke:var(--frame); } .frame { stroke:var(--frame); fill:none; }
path.c1, path.c2, path.c3, path.goal, line.c1, line.c2, line.c3, line.goal { fill:none; stroke-width:2; stroke-linejoin:round; }
.c1 { stroke:var(--c1); } .c2 { stroke:var(--c2); } .c3 { stroke:var(--c3); }
.goal { stroke:var(--goal); stroke-dasharray:6 3; } path.thin, line.thin { stroke-width:1.2; }
.mark.command { stroke:var(--goal); stroke-dasharray:2 3; } .mark.good { stroke:var(--good); stroke-dasharray:2 3; }
.mark.bad { stroke:var(--bad); stroke-dasharray:2 3; }
svg .label { font-size:11px; paint-order:stroke; stroke:var(--card); stroke-width:3px; }
svg .label.command { fill:var(--soft); } svg .label.good { fill:var(--good); } svg .label.bad { fill:var(--bad); }
table { border-collapse:collapse; font-size:13.5px; }
th { text-align:left; color:var(--soft); font-weight:500; } td, th { padding:3px 14px 3px 0; border-bottom:1px solid var(--line);
  vertical-align:top; }
.n { text-align:right; font-variant-numeric:tabular-nums; white-space:nowrap; } .mark { font-weight:700; }
tr.good .mark { color:var(--good); } tr.bad td { color:var(--bad); font-weight:600; } tr.changed td { font-weight:700; }
.columns { display:flex; flex-wrap:wrap; gap:34px; margin-top:22px; } section { min-width:250px; }
";
