//! A sweep's file: which scenarios, over which parameters, how often.

use std::collections::BTreeMap;

use serde::Deserialize;
use toml::{Spanned, Value};

use super::draw::Stream;
use super::{Axis, Entry, Load, Places, Sweep};
use hil_experiment::motor_file::MotorFile;
use hil_experiment::properties;
use hil_experiment::scenario::{FIGURES, Figure, Scenario};
use hil_experiment::toml_text::Source;
use hil_world::plant::Model;
use traces::input::{self, BadInput};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    scenario: Spanned<Value>,
    #[serde(default = "one")]
    seed: Spanned<i64>,
    #[serde(default = "one")]
    repeats: Spanned<i64>,
    samples: Option<Spanned<i64>>,
    model: Option<Spanned<String>>,
    #[serde(default)]
    grid: Tables,
    #[serde(default)]
    random: Tables,
    #[serde(default)]
    latin: Tables,
}

fn one() -> Spanned<i64> {
    Spanned::new(0..0, 1)
}

type Table = BTreeMap<Spanned<String>, Spanned<Value>>;

/// Parameters by the option of `hil-sim run` that sets them.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Tables {
    #[serde(default)]
    set: Table,
    #[serde(default)]
    plant: Table,
    #[serde(default)]
    rig: Table,
    #[serde(default)]
    supply: Table,
}

impl Tables {
    /// In the order of the file: overrides are applied in this order.
    fn rows(&self) -> Vec<(&'static str, &Spanned<String>, &Spanned<Value>)> {
        let tables =
            [("set", &self.set), ("plant", &self.plant), ("rig", &self.rig), ("supply", &self.supply)];
        let mut rows: Vec<_> = tables
            .into_iter()
            .flat_map(|(option, table)| table.iter().map(move |(name, value)| (option, name, value)))
            .collect();
        rows.sort_by_key(|(_, name, _)| name.span().start);
        rows
    }
}

impl Sweep {
    /// Parses a sweep; errors name it `file`.
    ///
    /// # Errors
    /// An invalid key or value, with its line, an unknown parameter, a value out of range, an empty set, a bad scenario.
    pub fn parse(file: &str, text: &str, motor: Option<MotorFile>, load: Load<'_>) -> Result<Self, BadInput> {
        parse(Source { file, text }, motor, load)
    }
}

fn parse(source: Source<'_>, motor: Option<MotorFile>, load: Load<'_>) -> Result<Sweep, BadInput> {
    let file: File = toml::from_str(source.text).map_err(|e| {
        let error = source.reader_error(&e);
        BadInput { expected: error.expected.replace("of a scenario", "of a sweep (docs/sweep.md)"), ..error }
    })?;
    let count = |value: &Spanned<i64>, name: &str, least: u64| {
        u64::try_from(*value.get_ref()).ok().filter(|count| *count >= least).ok_or_else(|| {
            let problem = format!("{name} is below {least}");
            source.error(value.span(), problem, format!("a whole number from {least} on"), "correct it")
        })
    };
    let seed = count(&file.seed, "seed", 0)?;
    let mut sweep = Sweep {
        text: source.text.to_owned(),
        entries: entries(source, &file.scenario, motor.as_ref(), load)?,
        motor,
        model: model(source, file.model.as_ref())?,
        seed,
        repeats: count(&file.repeats, "repeats", 1)?,
        samples: file.samples.as_ref().map_or(Ok(1), |samples| count(samples, "samples", 1))?,
        axes: Vec::new(),
        rows: 0,
    };
    let (mut drawn, mut spans) = (Vec::new(), Vec::new());
    for (kind, tables) in [("grid", &file.grid), ("random", &file.random), ("latin", &file.latin)] {
        for (option, name, value) in tables.rows() {
            if kind != "grid" {
                drawn.push(name.span());
            }
            let axis = axis(source, (kind, option), name, value, seed)?;
            if let Some(same) = sweep.axes.iter().find(|known| known.is_same(&axis)) {
                let problem = format!("{} is varied twice", same.column());
                let next = "remove one of the two";
                return Err(source.error(name.span(), problem, "each parameter once", next));
            }
            sweep.axes.push(axis);
            spans.push(name.span());
        }
    }
    for (axis, span) in sweep.axes.iter().zip(spans) {
        in_range(source, span, axis, &sweep)?;
    }
    match (&file.samples, drawn.first()) {
        (None, Some(first)) => {
            let next = "add samples = 1000 above the first table";
            let problem = "[random] and [latin] need samples, the number of draws";
            return Err(source.error(first.clone(), problem, "samples = a whole number", next));
        }
        (Some(samples), None) => {
            let next = "give a parameter, or use repeats for more seeds";
            let problem = "samples draw nothing: neither [random] nor [latin] has a parameter";
            return Err(source.error(samples.span(), problem, "a parameter to draw", next));
        }
        _ => {}
    }
    let seeds = i64::try_from(u128::from(seed) + u128::from(sweep.samples) * u128::from(sweep.repeats));
    if seeds.is_err() {
        let next = "take a smaller seed, or fewer samples";
        let found = if seed > 0 { file.seed.span() } else { 0..0 };
        return Err(source.error(found, "the last seed is above 2^63", "smaller seeds", next));
    }
    sweep.rows = sweep.count().ok_or_else(|| {
        let problem = "scenarios x grid x samples x repeats is above 2^63 runs";
        source.error(0..0, problem, "fewer runs", "take fewer values or samples")
    })?;
    Ok(sweep)
}

fn model(source: Source<'_>, model: Option<&Spanned<String>>) -> Result<Model, BadInput> {
    match model.map(|name| (name.get_ref().as_str(), name.span())) {
        None | Some(("averaged", _)) => Ok(Model::Averaged),
        Some(("switched", _)) => Ok(Model::Switched),
        Some((_, span)) => {
            Err(source.error(span, "model is unknown", "\"averaged\" or \"switched\"", "correct it"))
        }
    }
}

fn entries(
    source: Source<'_>,
    names: &Spanned<Value>,
    motor: Option<&MotorFile>,
    load: Load<'_>,
) -> Result<Vec<Entry>, BadInput> {
    let fail = |problem: &str| {
        let expected = "the name of a shipped scenario, a file, or a list of them";
        Err(source.error(names.span(), problem, expected, "`hil-sim list` names those that are shipped"))
    };
    let list = match names.get_ref() {
        Value::Array(list) => list.clone(),
        one => vec![one.clone()],
    };
    if list.is_empty() {
        return fail("scenario is an empty list");
    }
    let mut entries: Vec<Entry> = Vec::new();
    for name in &list {
        let Some(name) = name.as_str() else { return fail("a scenario's name is no text") };
        if entries.iter().any(|entry| entry.name == name) {
            return fail(&format!("scenario {} is named twice", input::shorten(name)));
        }
        let (file, text) = load(name).map_err(|bad| {
            let error =
                source.error(names.span(), bad.problem.clone(), bad.expected.clone(), bad.next.clone());
            BadInput { found: format!("{}: {}", bad.place, bad.found), ..error }
        })?;
        let mut scenario = Scenario::parse(&file, &text)?;
        if let Some(motor) = motor {
            scenario.take_motor(motor)?;
        }
        entries.push(Entry { name: name.to_owned(), text, scenario });
    }
    Ok(entries)
}

fn axis(
    source: Source<'_>,
    (kind, option): (&str, &'static str),
    name: &Spanned<String>,
    value: &Spanned<Value>,
    seed: u64,
) -> Result<Axis, BadInput> {
    let unknown = |known: Vec<&str>| {
        let next = input::did_you_mean(name.get_ref(), known.iter().copied())
            .unwrap_or_else(|| "use one of those".to_owned());
        let problem = format!("{option} has no {}", input::shorten(name.get_ref()));
        Err(source.error(name.span(), problem, known.join(", "), next))
    };
    let (name_known, unit) = if option == "set" {
        match properties::find(name.get_ref()) {
            Some(property) => (property.name, property.unit()),
            None => return unknown(properties::PROPERTIES.map(|property| property.name).to_vec()),
        }
    } else {
        match Figure::find(option, name.get_ref()) {
            Some(figure) => (figure.name, figure.unit),
            None => {
                let of_option = FIGURES.iter().filter(|figure| figure.option == option);
                return unknown(of_option.flat_map(|figure| [figure.name, figure.word]).collect());
            }
        }
    };
    let is_whole = option == "set";
    let reader = Reader { source, name: name.get_ref(), span: value.span(), is_whole };
    let (places, is_factor) = match kind {
        "grid" => reader.levels(value.get_ref())?,
        _ => {
            let stream = Stream::new(seed, &format!("{option}.{name_known}"));
            reader.draws(value.get_ref(), stream, kind == "latin")?
        }
    };
    Ok(Axis { option, name: name_known, unit, is_whole, is_factor, places })
}

/// Reads the values of one parameter.
struct Reader<'a> {
    source: Source<'a>,
    name: &'a str,
    span: std::ops::Range<usize>,
    is_whole: bool,
}

struct Interval {
    from: f64,
    to: f64,
    is_log: bool,
    steps: Option<u64>,
    is_factor: bool,
}

impl Reader<'_> {
    fn fail<T>(&self, problem: &str, expected: &str, next: &str) -> Result<T, BadInput> {
        Err(self.source.error(self.span.clone(), format!("{} {problem}", self.name), expected, next))
    }

    /// A number, and whether it is a factor: 120, 0.5 or "1.3x".
    fn number(&self, value: &Value) -> Result<(f64, bool), BadInput> {
        let (number, is_factor) = match value {
            Value::Integer(number) => (Some(*number as f64), false),
            Value::Float(number) => (Some(*number), false),
            Value::String(text) => {
                let digits = text.trim().strip_suffix(['x', 'X']);
                (digits.and_then(|digits| digits.trim().parse().ok()), true)
            }
            _ => (None, false),
        };
        let Some(number) = number.filter(|number: &f64| number.is_finite()) else {
            return self.fail(
                "has a value that is no number",
                "a number, or a multiple of the scenario's value as text: \"1.3x\"",
                "correct it",
            );
        };
        if self.is_whole && (is_factor || number != number.trunc()) {
            return self.fail("is no whole number", "properties are whole numbers", "round it");
        }
        Ok((number, is_factor))
    }

    /// All with the same form.
    fn numbers(&self, values: &[Value]) -> Result<(Vec<f64>, bool), BadInput> {
        let numbers = values.iter().map(|value| self.number(value)).collect::<Result<Vec<_>, _>>()?;
        let is_factor = numbers.first().is_some_and(|(_, is_factor)| *is_factor);
        if numbers.iter().any(|(_, other)| *other != is_factor) {
            let expected = "one form: all numbers, or all multiples such as \"1.3x\"";
            return self.fail(
                "mixes numbers and multiples",
                expected,
                "write \"1x\" for the scenario's value",
            );
        }
        Ok((numbers.into_iter().map(|(number, _)| number).collect(), is_factor))
    }

    fn interval(&self, table: &toml::Table, keys: &[&str]) -> Result<Interval, BadInput> {
        if let Some(key) = table.keys().find(|key| !keys.contains(&key.as_str())) {
            let problem = format!("has an unknown key {}", input::shorten(key));
            return self.fail(&problem, &keys.join(", "), "remove it");
        }
        let (Some(from), Some(to)) = (table.get("from"), table.get("to")) else {
            return self.fail("lacks from or to", "{ from = ..., to = ... }", "give both ends");
        };
        let (ends, is_factor) = self.numbers(&[from.clone(), to.clone()])?;
        let is_log = match table.get("scale").map(|scale| scale.as_str()) {
            None | Some(Some("linear")) => false,
            Some(Some("log")) => true,
            Some(_) => {
                return self.fail("has an unknown scale", "\"linear\" or \"log\"", "correct it");
            }
        };
        let (from, to) = (ends[0], ends[1]);
        if from >= to {
            return self.fail("has from not below to", "from below to", "exchange them, or give one value");
        }
        if is_log && from <= 0.0 {
            return self.fail("has a scale of log from 0 or below", "from above 0", "use scale = \"linear\"");
        }
        let steps = match table.get("steps").map(toml::Value::as_integer) {
            None => None,
            Some(Some(steps)) if (2..=1_000_000).contains(&steps) => Some(steps as u64),
            Some(_) => return self.fail("has bad steps", "steps = 2 to 1000000", "correct it"),
        };
        Ok(Interval { from, to, is_log, steps, is_factor })
    }

    fn levels(&self, value: &Value) -> Result<(Places, bool), BadInput> {
        let (mut levels, is_factor) = match value {
            Value::Array(values) if values.is_empty() => {
                return self.fail("is an empty list", "at least one value", "give a value, or remove it");
            }
            Value::Array(values) => self.numbers(values)?,
            Value::Table(table) => {
                let interval = self.interval(table, &["from", "to", "steps", "scale"])?;
                let Some(steps) = interval.steps else {
                    return self.fail("lacks steps", "{ from, to, steps }", "say how many values");
                };
                let at = |step: u64| interval.at(step as f64 / (steps - 1) as f64);
                ((0..steps).map(at).collect(), interval.is_factor)
            }
            one => self.numbers(std::slice::from_ref(one))?,
        };
        if self.is_whole {
            levels.iter_mut().for_each(|level| *level = level.round());
        }
        let mut sorted = levels.clone();
        sorted.sort_by(f64::total_cmp);
        if sorted.windows(2).any(|pair| pair[0] == pair[1]) {
            return self.fail("has a value twice", "each value once", "remove one, or take fewer steps");
        }
        Ok((Places::Levels(levels), is_factor))
    }

    fn draws(&self, value: &Value, stream: Stream, is_latin: bool) -> Result<(Places, bool), BadInput> {
        let Value::Table(table) = value else {
            return self.fail(
                "is no interval",
                "{ from = ..., to = ... }",
                "use [grid] for a list of values",
            );
        };
        let Interval { from, to, is_log, is_factor, .. } = self.interval(table, &["from", "to", "scale"])?;
        Ok((Places::Drawn { stream, is_latin, from, to, is_log }, is_factor))
    }
}

impl Interval {
    fn at(&self, share: f64) -> f64 {
        super::round(super::between(self.from, self.to, self.is_log, share))
    }
}

/// Whether each scenario takes each value by itself. A value that another parameter may make room for shows only when both are set.
fn in_range(
    source: Source<'_>,
    span: std::ops::Range<usize>,
    axis: &Axis,
    sweep: &Sweep,
) -> Result<(), BadInput> {
    for Entry { scenario, name: of, .. } in &sweep.entries {
        for value in axis.extremes() {
            let assignment = axis.assignment(value);
            let done = if axis.option == "set" {
                scenario.clone().set(&assignment)
            } else {
                let mut put = scenario.clone();
                let misfit =
                    put.put_figure(axis.option, &assignment).map(|_| ()).map(|()| put.check_figures().err());
                match misfit {
                    Ok(Some(e))
                        if sweep.axes.iter().any(|other| other.name == e.field && !other.is_same(axis)) =>
                    {
                        Ok(())
                    }
                    _ => scenario.clone().override_figures(&[(axis.option, &assignment)]),
                }
            };
            if let Err(bad) = done {
                let problem = format!("{}: {}", axis.column(), bad.problem);
                let error = source.error(span, problem, bad.expected, bad.next);
                return Err(BadInput { found: format!("{assignment}, in {of}"), ..error });
            }
        }
    }
    Ok(())
}
