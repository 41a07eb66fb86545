//! One chart as inline SVG: curves, points and bands over an axis, with a legend and marks. Colors are CSS classes of the page.
//!
//! The picture is what a reader without scripts and a printer see. `report.js` draws it anew from the same description.

use std::fmt::Write;

use serde::Serialize;

/// Maximum points drawn for a curve: more than the plot has pixels would show nothing new.
const MAX_POINTS: usize = 2000;

/// Drawing area in SVG units, and the margins for the axis labels.
const WIDTH: f64 = 1060.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 18.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 24.0;
/// Height of a line of labels above the plot, and the width of a character in one.
const LINE: f64 = 14.0;
const LETTER: f64 = 6.4;

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
#[derive(Clone, Debug, Serialize)]
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

/// Most ticks of an axis, whatever its numbers.
const MOST_TICKS: usize = 100;

struct Axis {
    min: f64,
    max: f64,
    from: f64,
    to: f64,
    log: bool,
}

impl Axis {
    fn at(&self, value: f64) -> f64 {
        let of = |value: f64| if self.log { value.log10() } else { value };
        self.from + (of(value) - of(self.min)) / (of(self.max) - of(self.min)) * (self.to - self.from)
    }

    /// Whether a value has a place.
    fn has(&self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0)
    }

    /// Values with their texts, about `count` of them on a linear axis.
    fn labels(&self, count: f64) -> Vec<(f64, String)> {
        if !self.log {
            let (ticks, decimals) = self.ticks(count);
            return ticks.into_iter().map(|tick| (tick, format!("{tick:.decimals$}"))).collect();
        }
        // From the smallest positive number to the largest there are 632 decades.
        let decades =
            (self.min.max(f64::MIN_POSITIVE).log10().floor() as i32)..=(self.max.log10().ceil() as i32);
        let steps: &[f64] = match (self.max / self.min).log10() {
            decades if decades > 6.0 => &[1.0],
            decades if decades > 2.2 => &[1.0, 3.0],
            _ => &[1.0, 2.0, 5.0],
        };
        let all = decades.flat_map(|decade| steps.iter().map(move |step| step * 10f64.powi(decade)));
        let inside = all.filter(|value| (self.min * 0.999..=self.max * 1.001).contains(value));
        // Without the rounding errors of the powers.
        inside.take(MOST_TICKS).map(|value| (value, format!("{}", (value * 1e6).round() / 1e6))).collect()
    }

    /// Round values at a round distance, about `count` of them, and their number of decimals.
    fn ticks(&self, count: f64) -> (Vec<f64>, usize) {
        let rough = (self.max - self.min) / count;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].iter().map(|n| n * power).find(|step| *step >= rough * 0.999);
        let step = step.unwrap_or(10.0 * power);
        let (first, last) = ((self.min / step).ceil() as i64, (self.max / step).floor() as i64);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        ((first..=last).take(MOST_TICKS).map(|n| n as f64 * step).collect(), decimals)
    }
}

/// The least and the largest of the values that have a place.
fn extremes<'a>(values: impl Iterator<Item = &'a f64>, log: bool) -> Option<(f64, f64)> {
    let inside = values.filter(|value| value.is_finite() && (!log || **value > 0.0));
    inside.fold(None, |found, value| {
        let (min, max) = found.unwrap_or((*value, *value));
        Some((min.min(*value), max.max(*value)))
    })
}

/// A chart with the numbers of its page.
pub(super) struct Drawing<'a> {
    pub(super) chart: &'a Chart,
    pub(super) columns: &'a [Numbers],
}

impl Drawing<'_> {
    fn values(&self, column: Column) -> &[f64] {
        self.columns.get(column.0).map_or(&[], |numbers| &numbers.values)
    }

    pub(super) fn svg(&self) -> String {
        let Chart { title, unit, height, marks, .. } = self.chart;
        let title = escape(title);
        let mut svg = format!(
            "<svg viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{title}\">\
             <text class=\"title\" x=\"{LEFT}\" y=\"18\">{title}<tspan class=\"unit\" dx=\"8\">{}</tspan></text>",
            escape(unit)
        );
        let x = self.across();
        let (min, max) = self.range();
        let below = BOTTOM + if self.is_named() { LINE + 2.0 } else { 0.0 };
        let labels = if self.chart.labeled { place(marks, &x) } else { Vec::new() };
        let lines = labels.iter().map(|label| label.line + 1).max().unwrap_or(0);
        let y = Axis { min, max, from: height - below, to: TOP + LINE * lines as f64, log: self.chart.log };
        self.grid(&mut svg, &x, &y);
        self.draw_marks(&mut svg, &x, &y, &labels);
        for series in &self.chart.series {
            let (kind, path) = self.path(series, &x, &y);
            let _ = write!(svg, "<path class=\"{kind} {}\" d=\"{path}\"/>", series.class);
        }
        self.legend(&mut svg);
        svg.push_str("</svg>\n");
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
                let rows: Vec<_> = rows.filter(|(_, (low, high))| y.has(**low) && y.has(**high)).collect();
                let there = rows.iter().map(|(a, (low, _))| format!("{:.1} {:.1}", x.at(**a), y.at(**low)));
                let back =
                    rows.iter().rev().map(|(a, (_, high))| format!("{:.1} {:.1}", x.at(**a), y.at(**high)));
                let outline: Vec<String> = there.chain(back).collect();
                ("band", if outline.is_empty() { String::new() } else { format!("M{}Z", outline.join("L")) })
            }
        }
    }

    fn across(&self) -> Axis {
        let Across { log, .. } = self.chart.x;
        let values = self.chart.series.iter().flat_map(|series| self.values(series.x));
        let (min, max) = extremes(values, log).unwrap_or(if log { (1.0, 10.0) } else { (0.0, 1.0) });
        let (from, to) = (LEFT, WIDTH - RIGHT);
        let is_scatter = self.chart.series.iter().any(|series| matches!(series.kind, Kind::Points { .. }));
        let (min, max) = match (log, is_scatter) {
            (true, _) => (min, if max > min { max } else { 2.0 * min }),
            (false, true) => {
                let span = if max > min { max - min } else { 1.0 };
                (min - 0.04 * span, max + 0.04 * span)
            }
            (false, false) => (min, if max > min { max } else { min + 1.0 }),
        };
        Axis { min, max, from, to, log }
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
        let found = extremes(values.chain(levels.iter().map(|level| &level.value)), *log);
        let span = least_span.max(f64::MIN_POSITIVE);
        match (found, log) {
            (None, true) => (0.1, 1.0),
            (Some((min, max)), true) => (min / 1.3, max * 1.3),
            (None, false) => (0.0, if *least_span > 0.0 { span } else { 1.0 }),
            (Some((min, max)), false) => {
                let middle = (min + max) / 2.0;
                let span = if max > min { span.max(max - min) } else { least_span.max(1e-9 * middle.abs()) };
                let span = if span > 0.0 { span } else { 1.0 };
                (middle - 0.55 * span, middle + 0.55 * span)
            }
        }
    }

    fn grid(&self, svg: &mut String, x: &Axis, y: &Axis) {
        let (bottom, top, right) = (y.from, y.to, x.to);
        let unit = escape(&self.chart.x.unit);
        for (tick, label) in x.labels(12.0) {
            let at = x.at(tick);
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{at:.1}\" y1=\"{bottom}\" x2=\"{at:.1}\" y2=\"{top}\"/>"
            );
            let below = bottom + 16.0;
            let _ = write!(
                svg,
                "<text class=\"tick\" text-anchor=\"middle\" x=\"{at:.1}\" y=\"{below}\">{label}</text>"
            );
        }
        let (side, below) =
            if self.is_named() { (right, bottom + 31.0) } else { (LEFT - 14.0, bottom + 16.0) };
        let _ =
            write!(svg, "<text class=\"tick\" text-anchor=\"end\" x=\"{side}\" y=\"{below}\">{unit}</text>");
        if self.chart.lanes.is_empty() {
            // About 28 units a step, so that labels do not crowd.
            for (tick, label) in y.labels((bottom - top) / 28.0) {
                y_tick(svg, y.at(tick), right, &label, tick == 0.0);
            }
        }
        for (lane, name) in self.chart.lanes.iter().enumerate() {
            y_tick(svg, y.at(lane as f64 + 0.1), right, name, false);
        }
        for Level { value, class, label } in &self.chart.levels {
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

    fn draw_marks(&self, svg: &mut String, x: &Axis, y: &Axis, labels: &[Label]) {
        for (index, mark) in self.chart.marks.iter().enumerate() {
            let (at, class) = (x.at(mark.x), mark.class);
            let mut top = y.to;
            if let Some(label) = labels.get(index) {
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

/// Assigns each mark's label the first line in which it has room.
fn place(marks: &[Mark], x: &Axis) -> Vec<Label> {
    let mut ends: Vec<f64> = Vec::new();
    let mut labels = Vec::new();
    for mark in marks {
        let at = x.at(mark.x);
        let width = LETTER * mark.label.chars().count() as f64 + 12.0;
        let leftwards = at + width > WIDTH;
        let begin = if leftwards { at - width } else { at };
        let line = ends.iter().position(|end| *end <= begin).unwrap_or(ends.len());
        // A label to the left ends at its mark.
        let end = begin + width;
        match ends.get_mut(line) {
            Some(taken) => *taken = end,
            None => ends.push(end),
        }
        labels.push(Label { line, leftwards });
    }
    labels
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
    fn ticks_are_round_and_inside() {
        let axis = Axis { min: -3.3, max: 171.0, from: 0.0, to: 1.0, log: false };
        assert_eq!(axis.ticks(6.0), (vec![0.0, 50.0, 100.0, 150.0], 0));
        let axis = Axis { min: 0.11, max: 0.52, from: 0.0, to: 1.0, log: false };
        let (ticks, decimals) = axis.ticks(4.0);
        assert_eq!((ticks.len(), decimals), (2, 1));
    }
}
