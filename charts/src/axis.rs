//! The rule of an axis: which values have a place on it, its range, its ticks and their labels.
//!
//! `axis.js` is the same rule for a reader who zooms; `axes.json` has inputs and answers that both are tested against. Powers of ten
//! are read from decimal text and written as such: the logarithms of two math libraries differ in their last bit.

/// Magnitudes that have a place: neither a span nor a margin of such values overflows.
const LARGEST: f64 = 1e300;
const SMALLEST: f64 = 1e-300;
/// A span of less than this share of its values is rounding. It would need labels with more digits than anyone reads.
const FLAT: f64 = 1e-9;

pub(super) struct Axis {
    pub(super) min: f64,
    pub(super) max: f64,
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) log: bool,
}

impl Axis {
    pub(super) fn at(&self, value: f64) -> f64 {
        let of = |value: f64| if self.log { value.log10() } else { value };
        self.from + (of(value) - of(self.min)) / (of(self.max) - of(self.min)) * (self.to - self.from)
    }

    pub(super) fn has(&self, value: f64) -> bool {
        has(value, self.log)
    }

    /// Round values and their labels, about `count` of them.
    pub(super) fn ticks(&self, count: f64) -> Vec<(f64, String)> {
        let count = count.max(1.0);
        // Below a ratio of 5 equal distances read better than 1, 2 and 5.
        if self.log && self.max > 5.0 * self.min { self.decades(count) } else { self.equidistant(count) }
    }

    fn decades(&self, count: f64) -> Vec<(f64, String)> {
        let decades = exponent(self.min)..=exponent(self.max);
        let steps: &[f64] = match self.max / self.min {
            ratio if ratio > 1e6 => &[1.0],
            ratio if ratio > 160.0 => &[1.0, 3.0],
            _ => &[1.0, 2.0, 5.0],
        };
        let every = match steps {
            [_] => (f64::from(decades.end() - decades.start()) / count + 0.5).floor().max(1.0) as i32,
            _ => 1,
        };
        let decades = decades.filter(|decade| decade % every == 0);
        let all = decades.flat_map(|decade| steps.iter().map(move |step| (decimal(*step, decade), decade)));
        let inside = all.filter(|(value, _)| (self.min..=self.max).contains(value));
        inside.map(|(value, decade)| (value, label(value, decade, value))).collect()
    }

    fn equidistant(&self, count: f64) -> Vec<(f64, String)> {
        let size = self.min.abs().max(self.max.abs());
        if is_flat(self.max - self.min, size) {
            return Vec::new();
        }
        let rough = (self.max - self.min) / count;
        let decade = exponent(rough);
        let steps = [1.0, 2.0, 5.0].map(|step| decimal(step, decade));
        let step = steps.into_iter().find(|step| *step >= rough * 0.999).unwrap_or(decimal(10.0, decade));
        // A range that is not flat has fewer steps from zero than an i64 holds.
        let (first, last) = ((self.min / step).ceil() as i64, (self.max / step).floor() as i64);
        let values = (first..=last).map(|n| n as f64 * step);
        values.map(|value| (value, label(value, exponent(step), size))).collect()
    }
}

/// Whether a value has a place.
fn has(value: f64, log: bool) -> bool {
    value.abs() <= LARGEST && (!log || value >= SMALLEST)
}

fn is_flat(span: f64, size: f64) -> bool {
    span <= SMALLEST.max(FLAT * size)
}

/// The range that shows all values that have a place. A linear one spans at least `least_span` and has `margin` of its span free on
/// both sides; a logarithmic one with a margin has a factor of 1.3.
pub(super) fn range(
    values: impl Iterator<Item = f64>,
    log: bool,
    least_span: f64,
    margin: f64,
) -> (f64, f64) {
    let found = values.filter(|value| has(*value, log)).fold(None, |found, value| {
        let (min, max) = found.unwrap_or((value, value));
        Some((value.min(min), value.max(max)))
    });
    match found {
        None if log => (1.0, 10.0),
        None => (0.0, if least_span > 0.0 { least_span } else { 1.0 }),
        Some((min, max)) if log => {
            let free = if margin > 0.0 { 1.3 } else { 1.0 };
            let factor = if is_flat(max - min, max) { 2.0 } else { free };
            (min / factor, max * factor)
        }
        Some((min, max)) => {
            let size = min.abs().max(max.abs());
            let own = if size > SMALLEST { size } else { 1.0 };
            let wanted = least_span.max(max - min);
            let span = if is_flat(wanted, size) { own } else { wanted };
            let free = (span - (max - min)) / 2.0 + margin * span;
            (min - free, max + free)
        }
    }
}

/// The power of ten of a positive number's first digit.
fn exponent(value: f64) -> i32 {
    format!("{value:e}").rsplit('e').next().and_then(|power| power.parse().ok()).unwrap_or(0)
}

fn decimal(digits: f64, power: i32) -> f64 {
    format!("{digits}e{power}").parse().unwrap_or(f64::NAN)
}

/// With the digits down to `decade`. `size` is the largest number beside it, so that an axis has labels of one form.
fn label(value: f64, decade: i32, size: f64) -> String {
    if size < 1e6 && decade > -6 {
        let digits = usize::try_from(-decade).unwrap_or(0);
        return format!("{value:.digits$}");
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = usize::try_from(exponent(value.abs()) - decade).unwrap_or(0);
    format!("{value:.digits$e}")
}

#[cfg(test)]
mod tests {
    use std::fmt::Write;
    use std::path::PathBuf;

    use serde_json::json;

    use super::*;

    const ABSENT: f64 = f64::NAN;

    /// Values, as a chart may have them.
    const VALUES: [&[f64]; 37] = [
        &[],
        &[ABSENT],
        &[0.0],
        &[5.0, 5.0],
        &[-5.0],
        &[166.0],
        &[1e20],
        &[-1e20],
        &[1e-20],
        &[1e300],
        &[1e-310],
        &[-1e300, 1e300],
        &[1e-300, 1e300],
        &[f64::MIN, f64::MAX],
        &[f64::from_bits(1), 0.0],
        &[f64::from_bits(1), f64::MAX, 3.0],
        &[1.0, 1.0 + f64::EPSILON],
        &[1e6, 1e6 + 0.001],
        &[1e15, 1e15 + 1e7],
        &[-3.3, ABSENT, 171.0],
        &[0.11, 0.52],
        &[0.0, 1000.0],
        &[-7.0, -2.0],
        &[999_999.0, 1_000_050.0],
        &[0.0, 3e6],
        &[0.0, 7e-7],
        &[-2e-9, 5e-9],
        &[1.6, 1.63],
        &[3.0, 11.0],
        &[0.9, 90.0],
        &[1.0, 150.0],
        &[0.02, 500.0],
        &[1e-5, 1e5],
        &[1e-9, 1e9],
        &[1e-30, 1e3],
        &[-1.0, 0.0, 10.0, 1000.0],
        &[-3.0, -1.0],
    ];

    /// Minimum span, margin and number of ticks: of an axis x, of one with points, and of a y axis.
    const KINDS: [(f64, f64, f64); 4] =
        [(0.0, 0.0, 11.7), (0.0, 0.04, 3.0), (0.0, 0.05, 7.3), (20.0, 0.05, 0.5)];

    fn axes() -> impl Iterator<Item = (&'static [f64], bool, (f64, f64, f64), Axis)> {
        let scales = VALUES.into_iter().flat_map(|values| [(values, false), (values, true)]);
        let all = scales.flat_map(|(values, log)| KINDS.map(|kind| (values, log, kind)));
        all.map(|(values, log, kind)| {
            let (min, max) = range(values.iter().copied(), log, kind.0, kind.1);
            (values, log, kind, Axis { min, max, from: 0.0, to: 1000.0, log })
        })
    }

    #[test]
    fn axis_has_a_place_for_every_value_and_tick() {
        for (values, log, kind, axis) in axes() {
            let ticks = axis.ticks(kind.2);
            assert!(ticks.len() <= 16, "{values:?} {log} {kind:?}: {} ticks", ticks.len());
            let places =
                ticks.iter().map(|(tick, _)| tick).chain(values.iter().filter(|value| axis.has(**value)));
            for value in places {
                let at = axis.at(*value);
                assert!((-0.1..=1000.1).contains(&at), "{values:?} {log} {kind:?}: {value} is at {at}");
            }
            let mut labels: Vec<&String> = ticks.iter().map(|(_, label)| label).collect();
            labels.dedup();
            assert_eq!(labels.len(), ticks.len(), "{values:?} {log} {kind:?}: {labels:?}");
        }
    }

    #[test]
    fn axis_equals_the_answers_kept_for_the_script() {
        let mut kept = String::from("[\n");
        for (values, log, (span, margin, count), axis) in axes() {
            let ticks = axis.ticks(count);
            let values: Vec<_> = values.iter().map(|value| value.is_finite().then_some(*value)).collect();
            let line = json!({
                "values": values, "log": log, "span": span, "margin": margin, "count": count,
                "range": [axis.min, axis.max],
                "ticks": ticks,
            });
            let _ = writeln!(kept, "{}{line}", if kept.len() > 2 { "," } else { "" });
        }
        kept.push_str("]\n");
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("axes.json");
        if std::env::var_os("BLESS_CHARTS").is_some() {
            std::fs::write(&path, &kept).expect("the crate's folder can be written");
        }
        let found = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            found == kept,
            "charts/axes.json is out of date: BLESS_CHARTS=1 cargo test -p charts, then cargo xtask reports"
        );
    }

    #[test]
    fn ticks_are_round_and_inside() {
        let labels = |min, max, log, count| {
            let axis = Axis { min, max, from: 0.0, to: 1.0, log };
            axis.ticks(count).into_iter().map(|(_, label)| label).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(labels(-3.3, 171.0, false, 6.0), "0 50 100 150");
        assert_eq!(labels(0.11, 0.52, false, 4.0), "0.2 0.4");
        assert_eq!(labels(0.0, 3e6, false, 3.0), "0 1e6 2e6 3e6");
        assert_eq!(labels(999_900.0, 1_000_100.0, false, 2.0), "9.999e5 1.0000e6 1.0001e6");
        assert_eq!(labels(2.0, 5.0, true, 3.0), "2 3 4 5");
        assert_eq!(labels(0.05, 3.0, true, 3.0), "0.05 0.1 0.2 0.5 1 2");
        assert_eq!(labels(0.1, 100.0, true, 3.0), "0.1 0.3 1 3 10 30 100");
        assert_eq!(labels(1e-9, 1e9, true, 6.0), "1e-9 1e-6 0.001 1 1000 1e6 1e9");
    }

    #[test]
    fn equal_values_span_their_own_size() {
        let of = |values: &[f64], log, span| range(values.iter().copied(), log, span, 0.0);
        assert_eq!(of(&[4.0, 4.0], false, 0.0), (2.0, 6.0));
        assert_eq!(of(&[4.0, 4.0], false, 20.0), (-6.0, 14.0));
        assert_eq!(of(&[0.0], false, 0.0), (-0.5, 0.5));
        assert_eq!(of(&[4.0], true, 0.0), (2.0, 8.0));
        assert_eq!(of(&[], true, 0.0), (1.0, 10.0));
        assert_eq!(of(&[], false, 0.0), (0.0, 1.0));
    }
}
