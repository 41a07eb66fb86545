//! The HTML page of a run: metrics, verdicts and charts in one self-contained file.

use std::fmt::Write;

use crate::metrics::{METRICS, Value, end_word};
use crate::properties::PROPERTIES;
use crate::report::model_name;
use crate::run::{MotorRun, Outcome};
use crate::scenario::{Case, Scenario};
use crate::trace::{COLUMNS, Trace};
use charts::{Chart, Column, Mark, Series, Sheet, escape};

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
        "<header><h1>{name} <span class=\"badge {badge}\">{verdict}: {passed} of {}</span></h1>\n\
         <p>{}</p>\n<p class=\"how\"><code>hil-sim run {} --seed {} --model {}</code></p></header>\n",
        outcome.expectations.len(),
        escape(&scenario.about),
        escape(&scenario.arguments),
        outcome.options.seed,
        model_name(outcome.options.model),
    );
    expectations(&mut page, outcome);
    let mut sheet = Sheet::new(&scenario.name);
    sheet.push(&page);
    sheet.help();
    for (case, run) in scenario.cases.iter().zip(&outcome.runs) {
        motor(&mut sheet, scenario, case, run);
    }
    sheet.finish()
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

fn motor(sheet: &mut Sheet, scenario: &Scenario, case: &Case, run: &MotorRun) {
    let end = run.metrics.end_reason.map_or(String::new(), |reason| format!(" · {}", end_word(reason)));
    let mut page = String::new();
    let _ = writeln!(page, "<h2>{} motor{end}</h2>\n<div class=\"tiles\">", capital(run.motor.name()));
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
    sheet.push(&page);
    if let Some(trace) = &run.trace {
        charts(sheet, trace, &marks(scenario, run));
    }
    let mut page = String::new();
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
    properties(&mut page, case);
    page.push_str("</table></section>\n<section><h3>Log</h3><table>\n");
    for (ms, entry) in &run.log {
        let _ = writeln!(page, "<tr><td class=\"n\">{ms} ms</td><td>{}</td></tr>", escape(entry));
    }
    page.push_str("</table></section>\n</div>\n");
    sheet.push(&page);
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
        .map(|timed| Mark { x: f64::from(timed.ms), class: "command", label: timed.action.to_string() })
        .collect();
    for (ms, entry) in &run.log {
        let class = match entry.as_str() {
            entry if entry.starts_with("refused") || entry.starts_with("fault") => "bad",
            entry if entry.starts_with("glitch") => continue,
            _ => "good",
        };
        marks.push(Mark { x: f64::from(*ms), class, label: entry.clone() });
    }
    marks.sort_by(|a, b| a.x.total_cmp(&b.x));
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

fn charts(sheet: &mut Sheet, trace: &Trace, marks: &[Mark]) {
    let times = sheet.column(trace.column("time_ms"), Some(0));
    for (index, (title, unit, height, least_span, curves)) in CHARTS.iter().enumerate() {
        if index + 1 == CHARTS.len() {
            halls(sheet, trace, times, marks);
        }
        let mut chart = over_time(title, unit, *height, marks);
        (chart.least_span, chart.labeled) = (*least_span, *title == "Position");
        for (name, class, column) in *curves {
            let values = curve(trace, column);
            // Some values exist only in some modes, such as the lag in modes 3 and 5.
            if values.iter().any(|value| value.is_finite()) {
                let values = sheet.column(values, Some(digits(column)));
                chart.series.push(Series::line(name, class, times, values));
            }
        }
        if !chart.series.is_empty() {
            sheet.chart(&chart);
        }
    }
}

fn over_time(title: &str, unit: &str, height: f64, marks: &[Mark]) -> Chart {
    let mut chart = Chart::new(title, unit, "ms");
    (chart.height, chart.marks) = (height, marks.to_vec());
    chart.x.group = Some("time".to_owned());
    chart
}

/// Digits after the point, as in the trace.
fn digits(column: &str) -> usize {
    match column {
        "torque_percent" => 2,
        "lag_counts" => 3,
        _ => COLUMNS.iter().find(|own| own.name == column).map_or(3, |own| own.decimals),
    }
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

fn halls(sheet: &mut Sheet, trace: &Trace, times: Column, marks: &[Mark]) {
    let codes = trace.column("halls_code");
    let mut chart = over_time("Halls", "bits of the code", 150.0, marks);
    for (bit, class) in [(0, "c1 thin"), (1, "c2 thin"), (2, "c3 thin")] {
        let base = f64::from(bit) + 0.1;
        let high = |code: &f64| (*code as u8) >> bit & 1 == 1;
        let values = codes.iter().map(|code| base + if high(code) { 0.75 } else { 0.0 }).collect();
        let values = sheet.column(values, Some(2));
        let name = format!("bit {bit}");
        chart.series.push(Series::line(&name, class, times, values));
        chart.lanes.push(name);
    }
    sheet.chart(&chart);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{Options, run};
    use hil_world::plant::Model;

    #[test]
    fn page_shows_the_run_and_stands_alone() {
        let scenario = Scenario::find("spread-full-travel").expect("shipped");
        let options = Options { seed: 1, model: Model::Averaged, trace: true };
        let html = html(&scenario, &run(&scenario, &options).expect("it runs"));
        assert_eq!(html.matches("<svg viewBox=\"0 0 1060 ").count(), 7, "static charts");
        for outside in ["http:", "https:", "src=", "<link", "@import", "NaN", "inf\""] {
            assert!(!html.contains(outside), "{outside} in a page that must stand alone");
        }
    }
}
