//! One chart as inline SVG: curves over time, with axes, a legend and marks. Colors are CSS classes of the
//! page.

use std::fmt::Write;

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

pub(super) struct Series {
    pub(super) name: &'static str,
    /// CSS class: `c1` to `c4`, `goal` for a set-point.
    pub(super) class: &'static str,
    pub(super) values: Vec<f64>,
}

#[derive(Clone)]
pub(super) struct Mark {
    pub(super) ms: f64,
    /// CSS class: `command`, `good` or `bad`.
    pub(super) class: &'static str,
    pub(super) label: String,
}

pub(super) struct Chart<'a> {
    pub(super) title: &'static str,
    pub(super) unit: &'static str,
    /// Height of the whole chart in SVG units.
    pub(super) height: f64,
    /// Minimum span of the y axis, so that noise is not enlarged.
    pub(super) least_span: f64,
    /// Names on the y axis in place of numbers: lanes of height 1 from the bottom, for logic levels.
    pub(super) lanes: &'static [&'static str],
    pub(super) times: &'a [f64],
    pub(super) series: Vec<Series>,
    pub(super) marks: &'a [Mark],
    pub(super) labeled: bool,
}

struct Axis {
    min: f64,
    max: f64,
    from: f64,
    to: f64,
}

impl Axis {
    fn at(&self, value: f64) -> f64 {
        self.from + (value - self.min) / (self.max - self.min) * (self.to - self.from)
    }

    /// Round values at a round distance, about `count` of them, and their number of decimals.
    fn ticks(&self, count: f64) -> (Vec<f64>, usize) {
        let rough = (self.max - self.min) / count;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].iter().map(|n| n * power).find(|step| *step >= rough * 0.999);
        let step = step.unwrap_or(10.0 * power);
        let (first, last) = ((self.min / step).ceil() as i64, (self.max / step).floor() as i64);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        ((first..=last).map(|n| n as f64 * step).collect(), decimals)
    }
}

impl Chart<'_> {
    pub(super) fn svg(&self) -> String {
        let height = self.height;
        let mut svg = format!(
            "<svg viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" aria-label=\"{}\">\
             <text class=\"title\" x=\"{LEFT}\" y=\"18\">{}<tspan class=\"unit\" dx=\"8\">{}</tspan></text>",
            self.title, self.title, self.unit
        );
        let (first, last) = (self.times.first().copied(), self.times.last().copied());
        let x = Axis {
            min: first.unwrap_or(0.0),
            max: last.unwrap_or(1.0).max(first.unwrap_or(0.0) + 1.0),
            from: LEFT,
            to: WIDTH - RIGHT,
        };
        let (min, max) = self.range();
        let labels = if self.labeled { place(self.marks, &x) } else { Vec::new() };
        let lines = labels.iter().map(|label| label.line + 1).max().unwrap_or(0);
        let y = Axis { min, max, from: height - BOTTOM, to: TOP + LINE * lines as f64 };
        self.grid(&mut svg, &x, &y);
        self.draw_marks(&mut svg, &x, &y, &labels);
        for series in &self.series {
            let path = path(self.times, &series.values, &x, &y);
            let _ = write!(svg, "<path class=\"{}\" d=\"{path}\"/>", series.class);
        }
        self.legend(&mut svg);
        svg.push_str("</svg>\n");
        svg
    }

    fn range(&self) -> (f64, f64) {
        if !self.lanes.is_empty() {
            return (0.0, self.lanes.len() as f64);
        }
        let values = self.series.iter().flat_map(|series| &series.values);
        let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(|value| value.is_finite()) {
            min = min.min(*value);
            max = max.max(*value);
        }
        if min > max {
            return (0.0, self.least_span);
        }
        let span = (max - min).max(self.least_span);
        let middle = (min + max) / 2.0;
        (middle - 0.55 * span, middle + 0.55 * span)
    }

    fn grid(&self, svg: &mut String, x: &Axis, y: &Axis) {
        let (bottom, top, right) = (y.from, y.to, x.to);
        let (ticks, decimals) = x.ticks(12.0);
        for tick in ticks {
            let at = x.at(tick);
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{at:.1}\" y1=\"{bottom}\" x2=\"{at:.1}\" y2=\"{top}\"/>"
            );
            let label = bottom + 16.0;
            let _ = write!(
                svg,
                "<text class=\"tick\" text-anchor=\"middle\" x=\"{at:.1}\" y=\"{label}\">{tick:.decimals$}</text>"
            );
        }
        let (side, below) = (LEFT - 14.0, bottom + 16.0);
        let _ = write!(svg, "<text class=\"tick\" text-anchor=\"end\" x=\"{side}\" y=\"{below}\">ms</text>");
        if self.lanes.is_empty() {
            // About 28 units a step, so that labels do not crowd.
            let (ticks, decimals) = y.ticks((bottom - top) / 28.0);
            for tick in ticks {
                self.y_tick(svg, y.at(tick), right, &format!("{tick:.decimals$}"), tick == 0.0);
            }
        }
        for (lane, name) in self.lanes.iter().enumerate() {
            self.y_tick(svg, y.at(lane as f64 + 0.1), right, name, false);
        }
        let _ = write!(svg, "<path class=\"frame\" d=\"M{LEFT} {top}V{bottom}H{right}\"/>");
    }

    fn y_tick(&self, svg: &mut String, at: f64, right: f64, label: &str, zero: bool) {
        let class = if zero { "grid zero" } else { "grid" };
        let _ = write!(
            svg,
            "<line class=\"{class}\" x1=\"{LEFT}\" y1=\"{at:.1}\" x2=\"{right}\" y2=\"{at:.1}\"/>"
        );
        let (x, y) = (LEFT - 7.0, at + 4.0);
        let _ = write!(svg, "<text class=\"tick\" text-anchor=\"end\" x=\"{x}\" y=\"{y:.1}\">{label}</text>");
    }

    fn draw_marks(&self, svg: &mut String, x: &Axis, y: &Axis, labels: &[Label]) {
        for (index, mark) in self.marks.iter().enumerate() {
            let (at, class) = (x.at(mark.ms), mark.class);
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
        if !self.lanes.is_empty() {
            return;
        }
        let mut right = WIDTH - RIGHT;
        for series in self.series.iter().rev() {
            let width = 6.6 * series.name.chars().count() as f64;
            let text = right - width;
            let _ = write!(
                svg,
                "<text class=\"legend\" x=\"{text:.1}\" y=\"18\">{}</text>\
                 <line class=\"{}\" x1=\"{:.1}\" y1=\"14\" x2=\"{:.1}\" y2=\"14\"/>",
                series.name,
                series.class,
                text - 28.0,
                text - 6.0
            );
            right = text - 46.0;
        }
    }
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
        let at = x.at(mark.ms);
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
    let mut path = String::new();
    let mut pen_down = false;
    let mut draw = |(time, value): (f64, f64)| {
        if value.is_finite() {
            let letter = if pen_down { 'L' } else { 'M' };
            let _ = write!(path, "{letter}{:.1} {:.1}", x.at(time), y.at(value));
        }
        pen_down = value.is_finite();
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
    path
}

pub(super) fn escape(text: &str) -> String {
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
        let x = Axis { min: 0.0, max: 50_000.0, from: 0.0, to: 1000.0 };
        let y = Axis { min: -10.0, max: 10.0, from: 200.0, to: 0.0 };
        let drawn = path(&times, &values, &x, &y);
        let ys: Vec<&str> = drawn.split(['M', 'L']).filter_map(|p| p.split(' ').nth(1)).collect();
        assert!(ys.len() <= MAX_POINTS, "{}", ys.len());
        assert!(ys.contains(&"30.0") && ys.contains(&"130.0"), "7 and −3 are drawn");
    }

    #[test]
    fn curve_stops_at_missing_values() {
        let x = Axis { min: 0.0, max: 4.0, from: 0.0, to: 4.0 };
        let y = Axis { min: 0.0, max: 4.0, from: 0.0, to: 4.0 };
        let drawn = path(&[0.0, 1.0, 2.0, 3.0, 4.0], &[1.0, 2.0, f64::NAN, 3.0, 4.0], &x, &y);
        assert_eq!(drawn, "M0.0 1.0L1.0 2.0M3.0 3.0L4.0 4.0");
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let axis = Axis { min: -3.3, max: 171.0, from: 0.0, to: 1.0 };
        assert_eq!(axis.ticks(6.0), (vec![0.0, 50.0, 100.0, 150.0], 0));
        let axis = Axis { min: 0.11, max: 0.52, from: 0.0, to: 1.0 };
        let (ticks, decimals) = axis.ticks(4.0);
        assert_eq!((ticks.len(), decimals), (2, 1));
    }
}
