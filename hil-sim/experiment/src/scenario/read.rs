//! Finds and parses scenario files, with the checks that need several fields or the plant.

use std::num::IntErrorKind;
use std::path::Path;

use servo_core::Command;
use servo_core::units::{CountsPerSec, Torque};
use tater_wire::MotorKind;
use toml::Spanned;

use super::{Action, Case, Expectation, Initial, Order, SHIPPED, Scenario, Timed, Want, file};
use crate::metrics::{self, Window};
use crate::properties::{self, Property, PropertyError};
use crate::toml_text::{self, Source};
use hil_world::plant::{Model, ParamError, PlantParams};
use hil_world::rig::{Object, Rig, RigParams, Side};
use servo_core::way::Way;
use traces::input::{self, BadInput};

/// Size limit of a scenario file, bytes; the shipped ones have under 2 kB.
const MAX_FILE_BYTES: u64 = 1 << 20;

impl Scenario {
    /// A shipped scenario by name, or the TOML file at this path.
    ///
    /// # Errors
    /// No such scenario or file, or an invalid file.
    pub fn find(name: &str) -> Result<Self, BadInput> {
        let (file, text) = Self::text(name)?;
        Ok(Self { arguments: name.to_owned(), ..Self::parse(&file, &text)? })
    }

    /// The file name and the text of a shipped scenario, or of the TOML file at this path.
    ///
    /// # Errors
    /// No such scenario or file.
    pub fn text(name: &str) -> Result<(String, String), BadInput> {
        if let Some(shipped) = SHIPPED.iter().find(|shipped| shipped.name == name) {
            return Ok((shipped.file.to_owned(), shipped.text.to_owned()));
        }
        let path = Path::new(name);
        let io_error = |problem: &str, found: String| {
            BadInput::new(name, problem)
                .found(found)
                .expected("the name of a shipped scenario, or a TOML file")
                .next(match input::did_you_mean(name, SHIPPED.iter().map(|shipped| shipped.name)) {
                    Some(question) => format!("{question} `hil-sim list` names all that are shipped"),
                    None => "`hil-sim list` names those shipped; check the path of a file".to_owned(),
                })
        };
        let meta = path
            .metadata()
            .map_err(|e| io_error("no scenario and no file of this name can be read", e.to_string()))?;
        if !meta.is_file() {
            return Err(io_error("this is not a file", "a directory or a device".to_owned()));
        }
        if meta.len() > MAX_FILE_BYTES {
            return Err(io_error("too large for a scenario", format!("{} bytes", meta.len())));
        }
        let bytes = std::fs::read(path).map_err(|e| io_error("cannot be read", e.to_string()))?;
        let text = String::from_utf8(bytes).map_err(|e| {
            let at = e.utf8_error().valid_up_to();
            io_error("this is not text", format!("a byte that is not UTF-8 at offset {at}"))
        })?;
        Ok((name.to_owned(), text))
    }

    /// Parses a scenario; errors name it `file`.
    ///
    /// # Errors
    /// An invalid key or value, with its line.
    pub fn parse(file: &str, text: &str) -> Result<Self, BadInput> {
        scenario(Source { file, text })
    }

    /// Sets a property of every motor from `NAME=VALUE` (`--set`).
    ///
    /// # Errors
    /// Another form, an unknown property, or a value out of range.
    pub fn set(&mut self, assignment: &str) -> Result<(), BadInput> {
        let bad = |problem: &str, found: &str, expected: String| {
            BadInput::new(format!("--set {}", input::shorten(assignment)), problem)
                .found(input::shorten(found))
                .expected(expected)
                .next("give --set PROPERTY=VALUE, for example --set KP=120")
        };
        let Some((name, value)) = assignment.split_once('=') else {
            return Err(bad("no = in it", assignment, "PROPERTY=VALUE".to_owned()));
        };
        // One beyond 64 bits is out of every range.
        let value = value.trim().parse::<i64>().or_else(|error| match error.kind() {
            IntErrorKind::PosOverflow => Ok(i64::MAX),
            IntErrorKind::NegOverflow => Ok(i64::MIN),
            _ => Err(bad("the value is not a whole number", assignment, "a whole number".to_owned())),
        })?;
        for case in &mut self.cases {
            properties::set(&mut case.config, name.trim(), value).map_err(|e| match &e {
                PropertyError::Unknown { name } => {
                    let error = bad("no property has this name", &e.found(), e.expected());
                    let known = properties::PROPERTIES.map(|property| property.name);
                    match input::did_you_mean(name, known.into_iter()) {
                        Some(next) => BadInput { next, ..error },
                        None => error,
                    }
                }
                PropertyError::Range { .. } => bad("the value is out of range", assignment, e.expected()),
            })?;
        }
        self.arguments.push_str(&format!(" --set {}={value}", name.trim().to_uppercase()));
        Ok(())
    }
}

fn scenario(source: Source<'_>) -> Result<Scenario, BadInput> {
    let parsed: file::File = toml::from_str(source.text).map_err(|e| source.reader_error(&e))?;
    let mut cases = Vec::new();
    for motor in &parsed.motor.0 {
        let mut config = tater_fw::motion::defaults(*motor);
        for (property, value) in settings(source, &parsed.set)? {
            // Already checked: the ranges do not depend on the motor.
            let _ = property.set(&mut config, value);
        }
        cases.push(Case { motor: *motor, plant: plant(source, *motor, &parsed.plant)?, config, range: None });
    }
    let rig = match &parsed.rig {
        None => RigParams::default(),
        Some(rig) => checked(source, rig, RigParams::validate)?,
    };
    let mut objects = Vec::new();
    for object in &parsed.object {
        // An object's ranges do not depend on the plant.
        let nominal = PlantParams::for_motor(MotorKind::Link);
        objects.push(checked(source, object, |object| check_object(object, &nominal))?);
    }
    let duration_ms = parsed.duration_ms.get_ref().0;
    let mut timeline = Vec::new();
    for at in &parsed.at {
        timeline.push(timed(source, at, duration_ms)?);
    }
    timeline.sort_by_key(|timed| timed.ms);
    let initial = match &parsed.initial {
        None => Initial::default(),
        Some(initial) => initial.get_ref().into(),
    };
    for case in &cases {
        match &parsed.initial {
            Some(table) => _ = checked(source, table, |_| initial.check(&case.plant))?,
            None => initial.check(&case.plant).map_err(|e| {
                let problem = format!("[initial] {} is out of range without that table", e.field);
                let mut error = source.error(0..0, problem, &e.expected, "give [initial] and this key in it");
                error.found = format!("{} = {}", e.field, e.found);
                error
            })?,
        }
        for object in &parsed.object {
            let start = initial.start(&case.plant);
            let placed = |object: &Object| {
                let rig = RigParams::default();
                Rig::new(case.plant.clone(), rig, &[*object], Model::Averaged, start, 0).map(|_| ())
            };
            checked(source, object, placed)?;
        }
    }
    let expectations =
        parsed.expect.iter().map(|e| expectation(source, e, duration_ms)).collect::<Result<_, _>>()?;
    Ok(Scenario {
        name: parsed.name,
        about: parsed.about,
        arguments: source.file.to_owned(),
        cases,
        duration_ms,
        scatter: parsed.scatter.0,
        hall_scatter_deg: parsed.hall_scatter_deg.0,
        rig,
        initial,
        objects,
        timeline,
        expectations,
    })
}

fn checked<T: Clone>(
    source: Source<'_>,
    value: &Spanned<T>,
    check: impl Fn(&T) -> Result<(), ParamError>,
) -> Result<T, BadInput> {
    match check(value.get_ref()) {
        Ok(()) => Ok(value.get_ref().clone()),
        Err(e) => {
            let next = "correct it, or leave it out for the default";
            let mut error = source.error(
                source.field(value.span(), e.field),
                format!("{} is out of range", e.field),
                &e.expected,
                next,
            );
            error.found = format!("{} = {}", e.field, e.found);
            Err(error)
        }
    }
}

fn check_object(object: &Object, plant: &PlantParams) -> Result<(), ParamError> {
    // A start that is clear of any object; the scenario's own is checked later.
    let plant = PlantParams { min_count: -1e6, max_count: 1e6, ..plant.clone() };
    let at = if object.side == Side::Closing { plant.min_count } else { plant.max_count };
    let start = Initial { position_counts: at, ..Initial::default() }.start(&plant);
    let rig = RigParams::default();
    Rig::new(plant, rig, &[*object], Model::Averaged, start, 0).map(|_| ())
}

fn plant(source: Source<'_>, motor: MotorKind, overrides: &file::Numbers) -> Result<PlantParams, BadInput> {
    let nominal = PlantParams::for_motor(motor);
    let Ok(mut table) = toml::Table::try_from(&nominal) else { return Ok(nominal) };
    for (name, value) in overrides {
        let Some(slot) = table.get_mut(name.get_ref().as_str()) else {
            let known: Vec<String> = table.keys().map(|key| format!("`{key}`")).collect();
            let known = known.join(", ");
            let next = toml_text::suggestion(name.get_ref(), &known);
            return Err(source.error(name.span(), format!("[plant] has no {}", name.get_ref()), known, next));
        };
        let number = value.get_ref().0;
        let whole = number == number.trunc();
        *slot = match slot {
            toml::Value::Integer(_) if whole => toml::Value::Integer(number as i64),
            toml::Value::Integer(_) => {
                let problem = format!("[plant] {} is not a whole number", name.get_ref());
                return Err(source.error(name.span(), problem, "a whole number", "round it"));
            }
            _ => toml::Value::Float(number),
        };
    }
    // Types were preserved; only an integer may be out of its type's range.
    let plant: PlantParams = table.try_into().map_err(|e: toml::de::Error| {
        let span = overrides.keys().next().map_or(0..0, Spanned::span);
        source.error(span, format!("[plant]: {}", e.message()), "numbers in their ranges", "correct it")
    })?;
    plant.validate().map_err(|e| {
        let named = |(name, _): &(&Spanned<String>, _)| name.get_ref() == e.field;
        let problem = format!("[plant] {} is out of range", e.field);
        let Some((name, _)) = overrides.iter().find(named) else {
            // A default that another key has put out of range.
            let span = overrides.keys().next().map_or(0..0, Spanned::span);
            let next = format!("correct the keys of [plant], or give {} as well", e.field);
            let error = source.error(span, problem, &e.expected, next);
            return BadInput { found: format!("{} = {}, its default", e.field, e.found), ..error };
        };
        let next = "correct it, or leave it out for the default";
        source.error(name.span(), problem, &e.expected, next)
    })?;
    Ok(plant)
}

fn settings(source: Source<'_>, set: &file::Settings) -> Result<Vec<(&'static Property, i64)>, BadInput> {
    let mut rows: Vec<(&'static Property, i64)> = Vec::new();
    for (name, value) in set {
        let fail = |problem: String, expected: String, next: &str| {
            Err(source.error(name.span(), problem, expected, next))
        };
        let Some(property) = properties::find(name.get_ref()) else {
            let expected = format!("one of {}", properties::names());
            return fail(format!("{} is not a property", name.get_ref()), expected, "use one of those");
        };
        if rows.iter().any(|(row, _)| row.name == property.name) {
            let problem = format!("{} is set twice (case does not matter)", property.name);
            return fail(problem, "each property once".to_owned(), "remove one of the two");
        }
        let value = *value.get_ref();
        let mut scratch = tater_fw::motion::defaults(MotorKind::Link);
        if let Err(e) = property.set(&mut scratch, value) {
            let problem = format!("{} = {value} is out of range", property.name);
            return fail(problem, e.expected(), "choose a value in the range");
        }
        rows.push((property, value));
    }
    Ok(rows)
}

fn timed(source: Source<'_>, at: &Spanned<file::At>, duration_ms: u32) -> Result<Timed, BadInput> {
    let file::At { ms, .. } = *at.get_ref();
    let fail = |problem: &str, found: String, expected: String, next: &str| {
        Err(BadInput { found, ..source.error(at.span(), problem, expected, next) })
    };
    if ms >= duration_ms {
        let problem = "[[at]] ms is not before the end of the run";
        let expected = format!("0 to {}", duration_ms.saturating_sub(1));
        let next = "make duration_ms longer or the command earlier";
        let error = source.error(source.field(at.span(), "ms"), problem, expected, next);
        return Err(BadInput { found: format!("ms = {ms}"), ..error });
    }
    let mut actions = actions(source, at.get_ref())?;
    match (actions.pop(), actions.len()) {
        (Some(action), 0) => Ok(Timed { ms, action }),
        (found, more) => fail(
            "[[at]] needs one command",
            format!("{} commands at ms = {ms}", more + usize::from(found.is_some())),
            "one command beside ms: move, end, position, mode, torque, velocity, torque_close, torque_open, home, \
             abort, terminate, clear_fault, set, disturbance_n_m or bus_v"
                .to_owned(),
            "write one [[at]] for each command; equal times keep their order",
        ),
    }
}

fn actions(source: Source<'_>, at: &file::At) -> Result<Vec<Action>, BadInput> {
    let set = at.set.as_ref().map(|set| settings(source, set)).transpose()?;
    let commands = [
        at.r#move.as_ref().map(|e| Command::Move(e.0)),
        at.end.as_ref().map(|e| Command::End(e.0)),
        at.position.as_ref().map(|p| Command::Position(p.0)),
        at.mode.as_ref().map(|mode| Command::Mode(mode.0)),
        at.torque.as_ref().map(|t| Command::Torque(Torque(t.0))),
        at.velocity.as_ref().map(|v| Command::Velocity(CountsPerSec::from_int(v.0))),
        at.torque_close.as_ref().map(|_| Command::TorqueControlled { way: Way::Closing }),
        at.torque_open.as_ref().map(|_| Command::TorqueControlled { way: Way::Opening }),
        at.home.as_ref().map(|_| Command::Home),
        at.terminate.as_ref().map(|_| Command::Terminate),
        at.clear_fault.as_ref().map(|_| Command::ClearFault),
    ];
    let commands = commands.into_iter().flatten().map(Order::Command);
    let abort = at.abort.as_ref().map(|_| Order::Abort);
    let orders = commands.chain(abort).map(Action::Order);
    let others = [
        set.map(Action::Set),
        at.disturbance_n_m.map(|n_m| Action::Disturbance(n_m.0)),
        at.bus_v.map(|v| Action::Bus(v.0)),
    ];
    Ok(orders.chain(others.into_iter().flatten()).collect())
}

fn expectation(
    source: Source<'_>,
    expect: &Spanned<file::Expect>,
    duration_ms: u32,
) -> Result<Expectation, BadInput> {
    let file::Expect { metric: name, min, max, equals, tolerance, from_ms, to_ms } = expect.get_ref();
    let short = input::shorten(name);
    let fail = |problem: &str, found: String, expected: &str, next: &str| {
        let problem = format!("[[expect]] {short} {problem}");
        Err(BadInput { found, ..source.error(expect.span(), problem, expected, next) })
    };
    let named = format!("metric = \"{short}\"");
    let Some(metric) = metrics::find(name) else {
        let known = metrics::METRICS.map(|metric| metric.name);
        return fail("is not a metric", named, &known.join(", "), &did_you_mean(name, &known));
    };
    let want = match (metric.is_word(), equals, min, max, tolerance) {
        (true, Some(file::Wanted::Text(word)), None, None, None) => {
            if !metric.can_be(word) {
                let found = format!("equals = \"{}\"", input::shorten(word));
                let next = did_you_mean(word, metric.words);
                return fail("is never that", found, &metric.words.join(", "), &next);
            }
            Want::Word(word.clone())
        }
        (false, Some(file::Wanted::Number(value)), None, None, tolerance) => {
            let tolerance = tolerance.map_or(0.0, |t| t.0);
            Want::Within(value - tolerance, value + tolerance)
        }
        (false, None, min, max, None) if min.is_some() || max.is_some() => {
            Want::Within(min.map_or(f64::NEG_INFINITY, |n| n.0), max.map_or(f64::INFINITY, |n| n.0))
        }
        (true, ..) => {
            return fail("is a word", named, "equals = \"...\"", "use equals and nothing else");
        }
        (false, ..) => {
            let expected = "min, max or both; or equals = number, with a tolerance or without";
            let problem = "has no number to compare with, or too many";
            return fail(problem, named, expected, "add or remove one of those");
        }
    };
    if matches!(want, Want::Within(min, max) if min > max) {
        return fail("has its min above its max", named, "min at most max", "exchange them");
    }
    let window =
        Window { from_ms: from_ms.unwrap_or(Window::ALL.from_ms), to_ms: to_ms.unwrap_or(Window::ALL.to_ms) };
    if to_ms.is_some_and(|to_ms| to_ms > duration_ms) {
        let found = format!("to_ms = {}", window.to_ms);
        let expected = format!("at most the {duration_ms} ms of the run");
        return fail(
            "has a window that ends after the run",
            found,
            &expected,
            "move its end, or leave it out",
        );
    }
    if window.from_ms > window.to_ms || window.from_ms > duration_ms {
        let found = format!("from_ms = {}, to_ms = {}", window.from_ms, window.to_ms.min(duration_ms));
        let expected = format!("from_ms at most to_ms, within the {duration_ms} ms of the run");
        return fail("has an empty window", found, &expected, "move its ends");
    }
    Ok(Expectation { metric, want, window })
}

fn did_you_mean(word: &str, known: &[&str]) -> String {
    input::did_you_mean(word, known.iter().copied()).unwrap_or_else(|| "use one of those".to_owned())
}
