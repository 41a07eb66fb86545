//! One chart as inline SVG: curves, points and bands over an axis, with a legend and marks. Colors are CSS classes of the page.
//!
//! The picture is what a reader without scripts sees: the one that `report.js` draws at this width, below a title and a legend.

use std::fmt::Write;

use serde::Serialize;

use super::axis::{Axis, range};

/// Maximum points drawn for a curve: more than the plot has pixels would show nothing new.
const MAX_POINTS: usize = 2000;

/// Drawing area in SVG units, and the margins for the axis labels.
const WIDTH: f64 = 1060.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 18.0;
const TOP: f64 = 10.0;
const BOTTOM: f64 = 26.0;
/// Height of the line of title and legend above all.
const HEAD: f64 = 24.0;
/// Height of a line of labels above the plot, the width of a character in one, and the most lines.
const LINE: f64 = 14.0;
const LETTER: f64 = 6.4;
const MOST_LINES: usize = 8;

/// A column of numbers of a page, by its place there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Column(pub(super) usize);

/// Its numbers.
pub(super) struct Numbers {
    /// Digits after the point; none: as many as a number needs.
    pub(super) digits: Option<usize>,
    pub(super) values: Vec<f64>,
}

impl Numbers {
    /// As JSON; what is not finite is null.
    pub(super) fn push(&self, json: &mut String) {
        let digits = self.digits.map_or_else(|| "null".to_owned(), |digits| digits.to_string());
        let _ = write!(json, "{{\"digits\":{digits},\"values\":[");
        for (index, value) in self.values.iter().enumerate() {
            if index > 0 {
                json.push(',');
            }
            match (value.is_finite(), self.digits) {
                (false, _) => json.push_str("null"),
                (true, Some(digits)) => {
                    let text = format!("{value:.digits$}");
                    let short =
                        if digits > 0 { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
                    json.push_str(if short == "-0" { "0" } else { short });
                }
                (true, None) => json.push_str(&serde_json::Value::from(*value).to_string()),
            }
        }
        json.push_str("]}");
    }
}

/// How a series is drawn.
#[derive(Clone, Debug, Serialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Kind {
    /// A curve; x rises.
    Line,
    /// A point a row, each with a text that is shown for it; no texts: the series' name.
    Points {
        /// One for each row.
        labels: Vec<String>,
    },
    /// What is between two curves over the same x.
    Band {
        /// The upper one.
        upper: Column,
    },
}

/// Numbers over others.
#[derive(Clone, Debug, Serialize)]
pub struct Series {
    /// In the legend.
    pub name: String,
    /// CSS classes: a color `c1` to `c8` or `goal` for a set-point, and `thin`, `dashed`, `small`, `large` or `faint`.
    pub class: String,
    /// How it is drawn.
    #[serde(flatten)]
    pub kind: Kind,
    /// Across.
    pub x: Column,
    /// Upwards.
    pub y: Column,
    /// Series with the same key are hidden together.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub key: Option<String>,
}

impl Series {
    /// A curve.
    #[must_use]
    pub fn line(name: &str, class: &str, x: Column, y: Column) -> Self {
        Self { name: name.to_owned(), class: class.to_owned(), kind: Kind::Line, x, y, key: None }
    }

    /// Points, each with a text.
    #[must_use]
    pub fn points(name: &str, class: &str, x: Column, y: Column, labels: Vec<String>) -> Self {
        Self { kind: Kind::Points { labels }, ..Self::line(name, class, x, y) }
    }

    /// What is between two curves.
    #[must_use]
    pub fn band(name: &str, class: &str, x: Column, lower: Column, upper: Column) -> Self {
        Self { kind: Kind::Band { upper }, ..Self::line(name, class, x, lower) }
    }
}

/// A vertical line with a text.
#[derive(Clone, Debug, Serialize)]
pub struct Mark {
    /// Where.
    pub x: f64,
    /// CSS class: `command`, `good` or `bad`.
    pub class: &'static str,
    /// Its text.
    pub label: String,
}

/// A horizontal line with a text.
#[derive(Clone, Debug, Serialize)]
pub struct Level {
    /// Where.
    pub value: f64,
    /// CSS class: `goal`, `good` or `bad`.
    pub class: &'static str,
    /// Its text; may be empty.
    pub label: String,
}

/// What goes across a chart.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Across {
    /// Its unit or name.
    pub unit: String,
    /// Whether equal distances are equal ratios.
    pub log: bool,
    /// Charts with the same group, unit and scale share range and cursor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
}

/// A column of a table whose columns can be drawn against each other.
#[derive(Clone, Debug, Serialize)]
pub struct Field {
    /// Its name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// The numbers.
    pub column: Column,
    /// Whether it is a parameter: others are drawn over it with their quantiles.
    pub axis: bool,
}

/// A row with a name.
#[derive(Clone, Debug, Serialize)]
pub struct Marked {
    /// The row.
    pub row: usize,
    /// In the legend.
    pub name: String,
    /// As that of a [`Series`].
    pub class: &'static str,
}

/// A chart of which the reader chooses both axes. Between two fields that are no parameters it shows the rows that no other one beats
/// in both.
#[derive(Clone, Debug, Serialize)]
pub struct Explore {
    /// The columns.
    pub fields: Vec<Field>,
    /// The number of each row's run, if they are named by it.
    pub run: Option<Column>,
    /// Rows drawn apart.
    pub marked: Vec<Marked>,
    /// The field that is across at first.
    pub x: usize,
    /// The field that is upwards at first.
    pub y: usize,
}

/// A chart.
#[derive(Clone, Debug, Serialize)]
pub struct Chart {
    /// Its title.
    pub title: String,
    /// The unit of the y axis.
    pub unit: String,
    /// Height of the whole chart in SVG units.
    pub height: f64,
    /// Minimum span of the y axis, so that noise is not enlarged.
    #[serde(rename = "span")]
    pub least_span: f64,
    /// Whether the y axis is logarithmic: values that are not positive are left out.
    pub log: bool,
    /// Names on the y axis in place of numbers: lanes of height 1 from the bottom, for logic levels.
    pub lanes: Vec<String>,
    /// The x axis.
    pub x: Across,
    /// What is drawn, the last on top.
    pub series: Vec<Series>,
    /// Vertical lines.
    pub marks: Vec<Mark>,
    /// Horizontal lines.
    pub levels: Vec<Level>,
    /// Whether the texts of the marks are drawn.
    pub labeled: bool,
    /// A table to choose from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub explore: Option<Explore>,
}

impl Chart {
    /// An empty chart over `unit`, linear.
    #[must_use]
    pub fn new(title: &str, unit: &str, across: &str) -> Self {
        Self {
            title: title.to_owned(),
            unit: unit.to_owned(),
            height: 240.0,
            least_span: 0.0,
            log: false,
            lanes: Vec::new(),
            x: Across { unit: across.to_owned(), log: false, group: None },
            series: Vec::new(),
            marks: Vec::new(),
            levels: Vec::new(),
            labeled: false,
            explore: None,
        }
    }
}

/// The range of the x axis that these charts share.
pub(super) fn range_across<'a>(charts: impl Iterator<Item = &'a Chart>, columns: &[Numbers]) -> (f64, f64) {
    let (mut values, mut log, mut margin) = (Vec::new(), false, 0.0);
    for chart in charts {
        log = chart.x.log;
        for series in &chart.series {
            values.push(numbers(columns, series.x));
            if matches!(series.kind, Kind::Points { .. }) {
                margin = 0.04;
            }
        }
    }
    range(values.into_iter().flatten().copied(), log, 0.0, margin)
}

fn numbers(columns: &[Numbers], column: Column) -> &[f64] {
    columns.get(column.0).map_or(&[], |numbers| &numbers.values)
}

/// A chart with the numbers of its page.
pub(super) struct Drawing<'a> {
    pub(super) chart: &'a Chart,
    pub(super) columns: &'a [Numbers],
    /// The range of the x axis.
    pub(super) across: (f64, f64),
}

impl Drawing<'_> {
    fn values(&self, column: Column) -> &[f64] {
        numbers(self.columns, column)
    }

    pub(super) fn svg(&self) -> String {
        let Chart { title, unit, height, marks, .. } = self.chart;
        let title = escape(title);
        let mut svg = format!(
            "<svg viewBox=\"0 0 {WIDTH} {}\" role=\"img\" aria-label=\"{title}\">\
             <text class=\"title\" x=\"{LEFT}\" y=\"18\">{title}<tspan class=\"unit\" dx=\"8\">{}</tspan></text>",
            HEAD + height,
            escape(unit)
        );
        self.legend(&mut svg);
        let (min, max) = self.across;
        let x = Axis { min, max, from: LEFT, to: WIDTH - RIGHT, log: self.chart.x.log };
        let labels = if self.chart.labeled { place(marks, &x) } else { Vec::new() };
        let lines = labels.iter().flatten().map(|label| label.line + 1).max().unwrap_or(0);
        let below = BOTTOM + if self.is_named() { LINE + 2.0 } else { 0.0 };
        let (min, max) = self.range();
        let y = Axis { min, max, from: height - below, to: TOP + LINE * lines as f64, log: self.chart.log };
        let _ = write!(svg, "<g transform=\"translate(0 {HEAD})\">");
        self.grid(&mut svg, &x, &y);
        self.draw_marks(&mut svg, &x, &y, &labels);
        for series in &self.chart.series {
            let (kind, path) = self.path(series, &x, &y);
            let _ = write!(svg, "<path class=\"{kind} {}\" d=\"{path}\"/>", series.class);
        }
        svg.push_str("</g></svg>\n");
        svg
    }

    /// Whether the x axis has a name, which is longer than a unit and has a line of its own.
    fn is_named(&self) -> bool {
        self.chart.x.unit.chars().count() > 4
    }

    fn path(&self, series: &Series, x: &Axis, y: &Axis) -> (&'static str, String) {
        let (across, up) = (self.values(series.x), self.values(series.y));
        match &series.kind {
            Kind::Line => ("line", path(across, up, x, y)),
            Kind::Points { .. } => {
                let inside = across.iter().zip(up).filter(|(a, b)| x.has(**a) && y.has(**b));
                let dots = inside.map(|(a, b)| format!("M{:.1} {:.1}h0", x.at(*a), y.at(*b)));
                ("points", dots.collect())
            }
            Kind::Band { upper } => {
                let rows = across.iter().zip(up.iter().zip(self.values(*upper)));
                let rows: Vec<_> =
                    rows.filter(|(a, (low, high))| x.has(**a) && y.has(**low) && y.has(**high)).collect();
                let there = rows.iter().map(|(a, (low, _))| format!("{:.1} {:.1}", x.at(**a), y.at(**low)));
                let back =
                    rows.iter().rev().map(|(a, (_, high))| format!("{:.1} {:.1}", x.at(**a), y.at(**high)));
                let outline: Vec<String> = there.chain(back).collect();
                ("band", if outline.is_empty() { String::new() } else { format!("M{}Z", outline.join("L")) })
            }
        }
    }

    fn range(&self) -> (f64, f64) {
        let Chart { lanes, series, levels, least_span, log, .. } = self.chart;
        if !lanes.is_empty() {
            return (0.0, lanes.len() as f64);
        }
        let values = series.iter().flat_map(|series| {
            let upper = match series.kind {
                Kind::Band { upper } => self.values(upper),
                _ => &[],
            };
            self.values(series.y).iter().chain(upper)
        });
        let values = values.chain(levels.iter().map(|level| &level.value));
        range(values.copied(), *log, *least_span, 0.05)
    }

    fn grid(&self, svg: &mut String, x: &Axis, y: &Axis) {
        let (bottom, top, right) = (y.from, y.to, x.to);
        let unit = &self.chart.x.unit;
        let end = right - LETTER * unit.chars().count() as f64 - 14.0;
        for (tick, label) in x.ticks((right - LEFT) / 84.0) {
            let at = x.at(tick);
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{at:.1}\" y1=\"{bottom}\" x2=\"{at:.1}\" y2=\"{top}\"/>"
            );
            let below = bottom + 17.0;
            if self.is_named() || at < end {
                let _ = write!(
                    svg,
                    "<text class=\"tick\" text-anchor=\"middle\" x=\"{at:.1}\" y=\"{below}\">{label}</text>"
                );
            }
        }
        let below = bottom + if self.is_named() { 33.0 } else { 17.0 };
        let unit = escape(unit);
        let _ =
            write!(svg, "<text class=\"tick\" text-anchor=\"end\" x=\"{right}\" y=\"{below}\">{unit}</text>");
        if self.chart.lanes.is_empty() {
            // About 28 units a step, so that labels do not crowd.
            for (tick, label) in y.ticks((bottom - top) / 28.0) {
                y_tick(svg, y.at(tick), right, &label, tick == 0.0);
            }
        }
        for (lane, name) in self.chart.lanes.iter().enumerate() {
            y_tick(svg, y.at(lane as f64 + 0.1), right, name, false);
        }
        for Level { value, class, label } in self.chart.levels.iter().filter(|level| y.has(level.value)) {
            let at = y.at(*value);
            let _ = write!(
                svg,
                "<line class=\"mark {class}\" x1=\"{LEFT}\" y1=\"{at:.1}\" x2=\"{right}\" y2=\"{at:.1}\"/>\
                 <text class=\"label {class}\" text-anchor=\"end\" x=\"{}\" y=\"{:.1}\">{}</text>",
                right - 6.0,
                at - 5.0,
                escape(label)
            );
        }
        let _ = write!(svg, "<path class=\"frame\" d=\"M{LEFT} {top}V{bottom}H{right}\"/>");
    }

    fn draw_marks(&self, svg: &mut String, x: &Axis, y: &Axis, labels: &[Option<Label>]) {
        for (index, mark) in self.chart.marks.iter().enumerate() {
            let (at, class) = (x.at(mark.x), mark.class);
            if !is_inside(at, x) {
                continue;
            }
            let mut top = y.to;
            if let Some(Some(label)) = labels.get(index) {
                top = TOP + LINE * label.line as f64;
                let (anchor, dx) = if label.leftwards { ("end", -4.0) } else { ("start", 4.0) };
                let _ = write!(
                    svg,
                    "<text class=\"label {class}\" text-anchor=\"{anchor}\" x=\"{:.1}\" y=\"{:.1}\">{}</text>",
                    at + dx,
                    top + 10.0,
                    escape(&mark.label)
                );
            }
            let bottom = y.from;
            let _ = write!(
                svg,
                "<line class=\"mark {class}\" x1=\"{at:.1}\" y1=\"{top}\" x2=\"{at:.1}\" y2=\"{bottom}\"/>"
            );
        }
    }

    fn legend(&self, svg: &mut String) {
        if !self.chart.lanes.is_empty() {
            return;
        }
        let mut right = WIDTH - RIGHT;
        for series in self.chart.series.iter().rev() {
            let width = 6.6 * series.name.chars().count() as f64;
            let text = right - width;
            let kind = match series.kind {
                Kind::Line => "line",
                Kind::Points { .. } => "points",
                Kind::Band { .. } => "band",
            };
            let (from, to) = (text - 28.0, text - 6.0);
            let key = match series.kind {
                Kind::Line => format!("M{from:.1} 14H{to:.1}"),
                Kind::Points { .. } => format!("M{to:.1} 14h0"),
                Kind::Band { .. } => format!("M{from:.1} 9H{to:.1}V19H{from:.1}Z"),
            };
            let _ = write!(
                svg,
                "<text class=\"legend\" x=\"{text:.1}\" y=\"18\">{}</text><path class=\"{kind} {}\" d=\"{key}\"/>",
                escape(&series.name),
                series.class,
            );
            right = text - 46.0;
        }
    }
}

fn y_tick(svg: &mut String, at: f64, right: f64, label: &str, zero: bool) {
    let class = if zero { "grid zero" } else { "grid" };
    let _ =
        write!(svg, "<line class=\"{class}\" x1=\"{LEFT}\" y1=\"{at:.1}\" x2=\"{right}\" y2=\"{at:.1}\"/>");
    let (x, y) = (LEFT - 7.0, at + 4.0);
    let label = escape(label);
    let _ = write!(svg, "<text class=\"tick\" text-anchor=\"end\" x=\"{x}\" y=\"{y:.1}\">{label}</text>");
}

struct Label {
    line: usize,
    leftwards: bool,
}

/// Half a unit beyond its ends is the rounding of a mark at one of them.
fn is_inside(at: f64, x: &Axis) -> bool {
    (x.from - 0.5..=x.to + 0.5).contains(&at)
}

/// Assigns each mark's label the first line in which it has room.
fn place(marks: &[Mark], x: &Axis) -> Vec<Option<Label>> {
    let mut ends: Vec<f64> = Vec::new();
    let label = |mark: &Mark| {
        let at = x.at(mark.x);
        let width = LETTER * mark.label.chars().count() as f64 + 12.0;
        let leftwards = at + width > WIDTH;
        let begin = if leftwards { at - width } else { at };
        let line = ends.iter().position(|end| *end <= begin).unwrap_or(ends.len());
        if !is_inside(at, x) || line >= MOST_LINES || begin < 0.0 {
            return None;
        }
        ends.resize(ends.len().max(line + 1), 0.0);
        // A label to the left ends at its mark.
        ends[line] = begin + width;
        Some(Label { line, leftwards })
    };
    marks.iter().map(label).collect()
}

/// Interrupted where a value is not finite. Of several values in one pixel it keeps the smallest and the largest, in order.
fn path(times: &[f64], values: &[f64], x: &Axis, y: &Axis) -> String {
    let points: Vec<(f64, f64)> = times.iter().copied().zip(values.iter().copied()).collect();
    // Two points per bucket; a short curve has one value per bucket.
    let bucket = if points.len() <= MAX_POINTS { 1 } else { points.len().div_ceil(MAX_POINTS / 2) };
    let mut pen = Pen::default();
    let mut draw = |(time, value): (f64, f64)| {
        if y.has(value) && x.has(time) {
            pen.to(format!("{:.1}", x.at(time)), format!("{:.1}", y.at(value)));
        } else {
            pen.lift();
        }
    };
    for chunk in points.chunks(bucket) {
        let low = chunk.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        let high = chunk.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        if let (Some(&low), Some(&high)) = (low, high) {
            let (first, second) = if low.0 <= high.0 { (low, high) } else { (high, low) };
            draw(first);
            if first.0 != second.0 {
                draw(second);
            }
        }
    }
    pen.lift();
    pen.path
}

/// Writes a path; of points at the same height only the first and the last.
#[derive(Default)]
struct Pen {
    path: String,
    /// The height, if the pen is down.
    height: Option<String>,
    /// A point at that height that is not written yet.
    held: Option<String>,
}

impl Pen {
    fn to(&mut self, x: String, y: String) {
        if self.height.as_ref() == Some(&y) {
            self.held = Some(x);
            return;
        }
        self.flush();
        let letter = if self.height.is_some() { 'L' } else { 'M' };
        let _ = write!(self.path, "{letter}{x} {y}");
        self.height = Some(y);
    }

    fn flush(&mut self) {
        if let Some((x, y)) = self.held.take().zip(self.height.as_ref()) {
            let _ = write!(self.path, "L{x} {y}");
        }
    }

    fn lift(&mut self) {
        self.flush();
        self.height = None;
    }
}

/// As HTML has it.
#[must_use]
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_curve_is_thinned_and_keeps_its_extremes() {
        let times: Vec<f64> = (0..50_000).map(f64::from).collect();
        let mut values = vec![0.0; times.len()];
        values[31_415] = 7.0;
        values[31_416] = -3.0;
        let x = Axis { min: 0.0, max: 50_000.0, from: 0.0, to: 1000.0, log: false };
        let y = Axis { min: -10.0, max: 10.0, from: 200.0, to: 0.0, log: false };
        let drawn = path(&times, &values, &x, &y);
        let ys: Vec<&str> = drawn.split(['M', 'L']).filter_map(|p| p.split(' ').nth(1)).collect();
        assert!(ys.len() <= MAX_POINTS, "{}", ys.len());
        assert!(ys.contains(&"30.0") && ys.contains(&"130.0"), "7 and −3 are drawn");
    }

    #[test]
    fn curve_stops_at_missing_values() {
        let x = Axis { min: 0.0, max: 4.0, from: 0.0, to: 4.0, log: false };
        let y = Axis { min: 0.0, max: 4.0, from: 0.0, to: 4.0, log: false };
        let drawn = path(&[0.0, 1.0, 2.0, 3.0, 4.0], &[1.0, 2.0, f64::NAN, 3.0, 4.0], &x, &y);
        assert_eq!(drawn, "M0.0 1.0L1.0 2.0M3.0 3.0L4.0 4.0");
    }

    #[test]
    fn label_of_a_mark_has_a_place_inside_the_chart_or_none() {
        let x = Axis { min: 0.0, max: 10.0, from: LEFT, to: WIDTH - RIGHT, log: false };
        let mark = |x| Mark { x, class: "good", label: "arrived".to_owned() };
        let lines = |marks: &[f64]| {
            let marks: Vec<Mark> = marks.iter().copied().map(mark).collect();
            place(&marks, &x).iter().map(|label| label.as_ref().map(|label| label.line)).collect::<Vec<_>>()
        };
        assert_eq!(
            lines(&[-1.0, 0.0, 0.1, 5.0, 11.0, f64::NAN]),
            [None, Some(0), Some(1), Some(0), None, None]
        );
        assert_eq!(lines(&[5.0; 9]).iter().flatten().max(), Some(&(MOST_LINES - 1)));
    }
}
