//! The page of a sweep: parameters against metrics, Pareto fronts, and the worst runs with the lines that make them again.
//!
//! Takes the table row by row and keeps a part of it. The bytes depend on the table alone.

use super::Sweep;
use super::table::ResultColumn;
use charts::{Chart, Explore, Field, Series, Sheet, escape};
use traces::table::Kind;

/// Most rows that are drawn: more points hide each other.
pub const MOST_SHOWN: u64 = 5000;

/// Runs that are listed as the worst of a metric, and as failed.
const WORST: usize = 3;
const FAILED: usize = 5;

/// Scenarios with charts of their own.
const MOST_SCENARIOS: usize = 12;

/// Metrics that are drawn first, if they vary.
const FIRST: [&str; 8] = [
    "tracking_rms_counts",
    "settling_ms",
    "overshoot_counts",
    "hold_error_counts",
    "ripple_counts_s",
    "arrival_ms",
    "end_ms",
    "iae",
];
const SECOND: [&str; 5] = ["chatter", "heat_j", "peak_torque", "peak_current_a", "overshoot_counts"];

/// A number column over all rows of a scenario.
#[derive(Clone, Debug, Default)]
struct Range {
    number: u64,
    sum: f64,
    least: f64,
    /// The largest values with their runs, the largest first.
    worst: Vec<(f64, u64)>,
}

impl Range {
    fn add(&mut self, value: f64, run: u64) {
        self.least = if self.number == 0 { value } else { self.least.min(value) };
        self.number += 1;
        self.sum += value;
        let at = self.worst.iter().position(|(other, _)| value > *other).unwrap_or(self.worst.len());
        if at < WORST {
            self.worst.insert(at, (value, run));
            self.worst.truncate(WORST);
        }
    }

    fn largest(&self) -> f64 {
        self.worst.first().map_or(self.least, |(value, _)| *value)
    }

    fn varies(&self) -> bool {
        self.number > 1 && self.largest() > self.least
    }
}

#[derive(Clone, Debug)]
struct Part {
    scenario: String,
    runs: u64,
    ranges: Vec<Range>,
    /// Cells of the number columns of some rows, absent ones as NaN.
    shown: Vec<Vec<f64>>,
    failed: Vec<u64>,
    failures: u64,
    errors: Vec<(u64, String)>,
}

/// A report under construction.
pub struct Report {
    /// Number columns: place in a line, name, unit, and whether it is a parameter.
    numbers: Vec<(usize, String, String, bool)>,
    stride: u64,
    parts: Vec<Part>,
}

impl Report {
    /// A report without rows, of a table of `runs` rows.
    #[must_use]
    pub fn new(columns: &[ResultColumn], runs: u64) -> Self {
        let numbers = columns.iter().enumerate().filter(|(at, column)| {
            // The first columns are about the run; of those the number is an axis of its own.
            *at == 0 || column.kind == Kind::Float
        });
        let numbers = numbers.map(|(at, column)| {
            let is_axis = at == 0 || column.name.contains('.');
            // A plain number has the unit 1.
            let unit = if column.unit == "1" { String::new() } else { column.unit.clone() };
            (at, column.name.clone(), unit, is_axis)
        });
        Self { numbers: numbers.collect(), stride: runs.div_ceil(MOST_SHOWN).max(1), parts: Vec::new() }
    }

    /// Adds the cells of a line, in the order of the columns.
    pub fn row(&mut self, cells: &[String]) {
        let text = |at: usize| cells.get(at).map_or("", String::as_str);
        let run: u64 = text(0).parse().unwrap_or(0);
        let (passed, error, scenario) = (text(1), text(2), text(5));
        let at = self.parts.iter().position(|part| part.scenario == scenario).unwrap_or_else(|| {
            self.parts.push(Part {
                scenario: scenario.to_owned(),
                runs: 0,
                ranges: vec![Range::default(); self.numbers.len()],
                shown: Vec::new(),
                failed: Vec::new(),
                failures: 0,
                errors: Vec::new(),
            });
            self.parts.len() - 1
        });
        let values: Vec<f64> =
            self.numbers.iter().map(|(at, ..)| text(*at).parse().unwrap_or(f64::NAN)).collect();
        let Some(part) = self.parts.get_mut(at) else { return };
        part.runs += 1;
        if !error.is_empty() {
            if part.errors.len() < FAILED {
                part.errors.push((run, error.to_owned()));
            }
            return;
        }
        if passed != "1" {
            part.failures += 1;
            if part.failed.len() < FAILED {
                part.failed.push(run);
            }
        }
        for (range, value) in part.ranges.iter_mut().zip(&values) {
            if value.is_finite() {
                range.add(*value, run);
            }
        }
        if run.is_multiple_of(self.stride) {
            part.shown.push(values);
        }
    }

    /// The page. `commit` is that of the runs.
    #[must_use]
    pub fn html(&self, sweep: &Sweep, commit: &str) -> String {
        let line = |run: u64| sweep.line(&sweep.run(run), &str::to_owned, &str::to_owned);
        let runs: u64 = self.parts.iter().map(|part| part.runs).sum();
        let errors: usize = self.parts.iter().map(|part| part.errors.len()).sum();
        let failures: u64 = self.parts.iter().map(|part| part.failures).sum();
        let mut sheet = Sheet::new("Sweep");
        sheet.push(&format!(
            "<header><h1>Sweep of {runs} runs</h1>\n<p>{failures} missed an expectation of their scenario{}.</p>\n\
             <p>Reproduce at commit <code>{}</code>: save the text at the end as <code>sweep.toml</code>, then \
             <code>hil-sim sweep sweep.toml --out results</code>; one run: <code>hil-sim sweep sweep.toml --row N</code></p></header>\n",
            if errors > 0 { "; some could not be made" } else { "" },
            escape(commit)
        ));
        if self.stride > 1 {
            let shown: usize = self.parts.iter().map(|part| part.shown.len()).sum();
            sheet.push(&format!(
                "<p class=\"note\">The charts show {shown} of {runs} runs, every {}th, and quantiles of those; the tables count all runs.</p>\n",
                self.stride
            ));
        }
        sheet.help();
        for part in self.parts.iter().take(MOST_SCENARIOS) {
            self.part(&mut sheet, part, &line);
        }
        if self.parts.len() > MOST_SCENARIOS {
            let more = self.parts.len() - MOST_SCENARIOS;
            sheet.push(&format!("<p class=\"note\">{more} more scenarios are in results.csv alone.</p>\n"));
        }
        sheet.push(&format!("<h2>sweep.toml</h2>\n<pre>{}</pre>\n", escape(sweep.text())));
        sheet.finish()
    }

    fn part(&self, sheet: &mut Sheet, part: &Part, line: &dyn Fn(u64) -> String) {
        let code = |run: u64| format!("<code>{}</code>", escape(&line(run)));
        sheet.push(&format!("<h2>{}</h2>\n", escape(&part.scenario)));
        self.charts(sheet, part);
        let rows: Vec<Vec<String>> = self
            .numbers
            .iter()
            .zip(&part.ranges)
            .filter(|((.., is_axis), range)| !is_axis && range.number > 0)
            .map(|((_, name, unit, _), range)| {
                let mean = range.sum / range.number as f64;
                let mut row = vec![name.clone(), unit.clone()];
                row.extend([range.least, mean, range.largest()].map(digits));
                row.push(range.worst.first().map_or_else(String::new, |(_, run)| run.to_string()));
                row.push(range.number.to_string());
                row
            })
            .collect();
        sheet.push("<h3>Metrics of all runs</h3>\n");
        sheet.table(&["metric", "unit", "least", "mean", "largest", "in run", "runs that have it"], &rows, 2);
        sheet.push("<h3>Worst runs</h3>\n");
        for ((_, name, unit, is_axis), range) in self.numbers.iter().zip(&part.ranges) {
            if *is_axis || !range.varies() {
                continue;
            }
            sheet.push(&format!(
                "<details><summary>{name}: up to {} {unit}</summary>\n",
                digits(range.largest())
            ));
            for (value, run) in &range.worst {
                sheet.push(&format!("<p>run {run}: {} {unit}<br>{}</p>\n", digits(*value), code(*run)));
            }
            sheet.push("</details>\n");
        }
        if part.failures > 0 {
            sheet
                .push(&format!("<details><summary>{} runs missed an expectation</summary>\n", part.failures));
            part.failed.iter().for_each(|run| sheet.push(&format!("<p>run {run}<br>{}</p>\n", code(*run))));
            sheet.push("</details>\n");
        }
        for (run, error) in &part.errors {
            sheet.push(&format!("<p class=\"note\">run {run} could not be made: {}</p>\n", escape(error)));
        }
    }

    /// A parameter against a metric, and two metrics against each other; the reader chooses others.
    fn charts(&self, sheet: &mut Sheet, part: &Part) {
        let mut fields = Vec::new();
        for (at, ((_, name, unit, axis), range)) in self.numbers.iter().zip(&part.ranges).enumerate() {
            if range.varies() {
                let values =
                    part.shown.iter().map(|row| row.get(at).map_or(f64::NAN, |value| rounded(*value)));
                let column = sheet.column(values.collect(), None);
                fields.push(Field { name: name.clone(), unit: unit.clone(), column, axis: *axis });
            }
        }
        // The parameters before the number of the run.
        if fields.first().is_some_and(|field| field.name == "index") {
            let axes = fields.iter().filter(|field| field.axis).count();
            fields[..axes].rotate_left(1);
        }
        let metrics: Vec<usize> = (0..fields.len()).filter(|at| !fields[*at].axis).collect();
        let named = |names: &[&str], other_than: Option<usize>| {
            let free = |at: &usize| Some(*at) != other_than;
            let found = names
                .iter()
                .find_map(|name| metrics.iter().copied().filter(free).find(|at| fields[*at].name == *name));
            found.or_else(|| metrics.iter().copied().find(free))
        };
        let Some(up) = named(&FIRST, None) else {
            sheet.push("<p class=\"note\">No metric varies.</p>\n");
            return;
        };
        let pairs = [Some(0).filter(|_| fields[0].axis), named(&SECOND, Some(up))];
        for x in pairs.into_iter().flatten() {
            let (across, upwards) = (&fields[x], &fields[up]);
            let title = format!("{} against {}", upwards.name, across.name);
            let mut chart = Chart::new(&title, &upwards.unit, &across.name);
            chart.height = 340.0;
            chart.series.push(Series::points("runs", "c4 small", across.column, upwards.column, Vec::new()));
            let run = fields.iter().find(|field| field.name == "index").map(|field| field.column);
            chart.explore = Some(Explore { fields: fields.clone(), run, marked: Vec::new(), x, y: up });
            sheet.chart(&chart);
        }
    }
}

/// To seven digits: a page has no room for 17 that no chart shows.
fn rounded(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

fn digits(value: f64) -> String {
    match value.abs() {
        _ if value == value.trunc() => format!("{value:.0}"),
        size if size < 0.1 => format!("{value:.5}"),
        size if size < 1000.0 => format!("{value:.3}"),
        _ => format!("{value:.1}"),
    }
}
