//! Scenarios: what to simulate and what must come of it, as TOML.
//!
//! A file that loads can run: every name, unit and range is checked here, so that a run never meets bad input.

mod error;
mod file;
mod shipped;

pub use error::BadInput;
pub use shipped::{SHIPPED, Shipped};

use std::path::Path;

use servo_core::units::{CountsPerSec, Torque};
use servo_core::{Command, Config, MotorKind};
use toml::Spanned;

use crate::metrics::{self, Metric, Metrics, Value};
use crate::plant::{Heat, Model, ParamError, PlantParams, Start};
use crate::properties::{self, Property, PropertyError};
use crate::rig::{Object, Rig, RigParams};
use error::Source;

/// Largest scenario file read: the shipped ones have under 2 kB, so this is not one.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// What to simulate and what must come of it.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name, as printed.
    pub name: String,
    /// One sentence for `hil-sim list` and the report.
    pub about: String,
    /// The motors on which it runs, one after another.
    pub cases: Vec<Case>,
    /// Length of a run, 1..=600000.
    pub duration_ms: u32,
    /// Relative scatter of the plant (inertia, friction, Ke, R; bus 20..28 V) with the seed; 0 = nominal.
    pub scatter: f64,
    /// Scatter of the halls' placement with the seed, ± degrees electrical.
    pub hall_scatter_deg: f64,
    /// The board's sensors.
    pub rig: RigParams,
    /// The plant's state at the start.
    pub initial: Initial,
    /// What stands in the joint's way.
    pub objects: Vec<Object>,
    /// What happens when, in order of time.
    pub timeline: Vec<Timed>,
    /// What must come of it.
    pub expectations: Vec<Expectation>,
}

/// One motor of a scenario with its plant and its properties.
#[derive(Clone, Debug)]
pub struct Case {
    /// The kind of motor.
    pub motor: MotorKind,
    /// Its plant before any scatter.
    pub plant: PlantParams,
    /// Its properties at the start.
    pub config: Config,
}

/// The plant's state at the start of a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Initial {
    /// Rotor position, counts.
    pub position_counts: f64,
    /// Rotor velocity, counts/s.
    pub velocity_counts_s: f64,
    /// Winding temperature; `None`: that of the housing.
    pub winding_c: Option<f64>,
    /// Housing temperature; `None`: that of the surroundings.
    pub housing_c: Option<f64>,
}

impl Initial {
    /// The start of a run on `plant`.
    #[must_use]
    pub fn start(&self, plant: &PlantParams) -> Start {
        let housing_c = self.housing_c.unwrap_or(plant.ambient_c);
        let heat = Heat { winding_c: self.winding_c.unwrap_or(housing_c), housing_c };
        Start { count: self.position_counts, counts_per_s: self.velocity_counts_s, heat }
    }

    /// Whether a rig takes it; the error names the field as the file does.
    fn check(&self, plant: &PlantParams) -> Result<(), ParamError> {
        let rig = RigParams::default();
        let made = Rig::new(plant.clone(), rig, &[], Model::Averaged, self.start(plant), 0);
        made.map(|_| ()).map_err(|e| match e.field {
            "start_count" => ParamError { field: "position_counts", ..e },
            "start_counts_per_s" => ParamError { field: "velocity_counts_s", ..e },
            _ => e,
        })
    }
}

/// An action at a time.
#[derive(Clone, Debug)]
pub struct Timed {
    /// When, ms since the start of the run.
    pub ms: u32,
    /// What.
    pub action: Action,
}

/// What can happen to a motor board.
#[derive(Clone, Debug)]
pub enum Action {
    /// A host's command.
    Command(Command),
    /// Properties set by a host.
    Set(Vec<(&'static Property, i64)>),
    /// A torque from outside on the motor's shaft from now on, N·m, positive closing.
    Disturbance(f64),
    /// The supply voltage from now on.
    Bus(f64),
}

impl std::fmt::Display for Action {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Command(command) => match command {
                Command::Mode(mode) => write!(f, "mode {}", metrics::mode_word(*mode)),
                Command::Torque(torque) => write!(f, "T = {}", torque.0),
                Command::Velocity(velocity) => write!(f, "V = {}", velocity.round()),
                Command::Position(position) => write!(f, "P = {position}"),
                Command::End(end) => write!(f, "E = {end}"),
                Command::Move(end) => write!(f, "move to {end}"),
                Command::TorqueControlled { closing: true } => f.write_str("TC"),
                Command::TorqueControlled { closing: false } => f.write_str("TO"),
                Command::Home => f.write_str("HI"),
                Command::Abort => f.write_str("abort"),
                Command::Terminate => f.write_str("terminate"),
                Command::Configure(_) => f.write_str("configure"),
                Command::ClearFault => f.write_str("clear fault"),
                Command::ClearBreakaway => f.write_str("clear breakaway"),
            },
            Self::Set(rows) => {
                let words: Vec<_> = rows.iter().map(|(row, value)| format!("{} = {value}", row.name)).collect();
                f.write_str(&words.join(", "))
            }
            Self::Disturbance(n_m) => write!(f, "disturbance {n_m} N·m"),
            Self::Bus(v) => write!(f, "bus {v} V"),
        }
    }
}

/// What a metric must be.
#[derive(Clone, Debug)]
pub struct Expectation {
    /// Which.
    pub metric: &'static Metric,
    /// What it must be.
    pub want: Want,
}

/// The wanted value of a metric.
#[derive(Clone, Debug, PartialEq)]
pub enum Want {
    /// A number within both ends.
    Within(f64, f64),
    /// A word.
    Word(String),
}

/// What became of an expectation.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The metric, with the motor before it where a scenario has several.
    pub name: String,
    /// Whether it was met.
    pub ok: bool,
    /// What it was.
    pub value: Value,
    /// What was wanted, in words.
    pub want: String,
}

impl Expectation {
    /// Judges a run; an absent value meets no number.
    #[must_use]
    pub fn judge(&self, metrics: &Metrics) -> Verdict {
        let value = (self.metric.get)(metrics);
        let ok = match (&self.want, &value) {
            (Want::Within(min, max), Value::Number(value)) => value >= min && value <= max,
            (Want::Word(word), Value::Text(text)) => word == text,
            _ => false,
        };
        Verdict { name: self.metric.name.to_owned(), ok, value, want: self.want.to_string() }
    }
}

impl std::fmt::Display for Want {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Within(min, max) if min == max => write!(f, "{min}"),
            Self::Within(min, max) if *max == f64::INFINITY => write!(f, "at least {min}"),
            Self::Within(min, max) if *min == f64::NEG_INFINITY => write!(f, "at most {max}"),
            Self::Within(min, max) => write!(f, "{min} to {max}"),
            Self::Word(word) => f.write_str(word),
        }
    }
}

/// The name of a kind of motor.
#[must_use]
pub fn motor_name(kind: MotorKind) -> &'static str {
    match kind {
        MotorKind::Link => "link",
        MotorKind::Spread => "spread",
        MotorKind::Tip => "tip",
    }
}

impl Scenario {
    /// A shipped scenario by name, or else the TOML file at this path.
    ///
    /// # Errors
    /// No such scenario or file, or a file that no run can be made of.
    pub fn find(name: &str) -> Result<Self, BadInput> {
        if let Some(shipped) = SHIPPED.iter().find(|shipped| shipped.name == name) {
            return Self::parse(shipped.file, shipped.text);
        }
        let path = Path::new(name);
        let io_error = |problem: &str, found: String| BadInput {
            place: name.to_owned(),
            problem: problem.to_owned(),
            found,
            expected: "the name of a shipped scenario, or a TOML file".to_owned(),
            next: match error::closest(name, SHIPPED.iter().map(|shipped| shipped.name)) {
                Some(like) => format!("did you mean {like}? `hil-sim list` names all that are shipped"),
                None => "`hil-sim list` names those shipped; check the path of a file".to_owned(),
            },
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
        Self::parse(name, &text)
    }

    /// The scenario in `text`; `file` is what errors call it.
    ///
    /// # Errors
    /// What is wrong, with the line.
    pub fn parse(file: &str, text: &str) -> Result<Self, BadInput> {
        let source = Source { file, text };
        let parsed: file::File = toml::from_str(text).map_err(|e| source.reader_error(&e))?;
        let mut cases = Vec::new();
        for motor in &parsed.motor.0 {
            let mut config = Config::for_motor(*motor);
            for (property, value) in settings(source, &parsed.set)? {
                // Checked by `settings`: the range does not depend on the motor.
                let _ = property.set(&mut config, value);
            }
            cases.push(Case { motor: *motor, plant: plant(source, *motor, &parsed.plant)?, config });
        }
        let rig = match &parsed.rig {
            None => RigParams::default(),
            Some(rig) => checked(source, rig, RigParams::validate)?,
        };
        let mut objects = Vec::new();
        for object in &parsed.object {
            // An object's ranges do not depend on the plant; any will do to check it.
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
            if let Some(table) = &parsed.initial {
                checked(source, table, |_| initial.check(&case.plant))?;
            }
        }
        let expectations = parsed.expect.iter().map(|e| expectation(source, e)).collect::<Result<_, _>>()?;
        Ok(Self {
            name: parsed.name,
            about: parsed.about,
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

    /// Sets a property of every motor from `NAME=VALUE`, as `--set` gives it.
    ///
    /// # Errors
    /// Not of that form, no such property, or a value out of range.
    pub fn set(&mut self, assignment: &str) -> Result<(), BadInput> {
        let bad = |problem: &str, found: &str, expected: String| BadInput {
            place: format!("--set {assignment}"),
            problem: problem.to_owned(),
            found: found.to_owned(),
            expected,
            next: "give --set PROPERTY=VALUE, for example --set KP=120".to_owned(),
        };
        let Some((name, value)) = assignment.split_once('=') else {
            return Err(bad("no = in it", assignment, "PROPERTY=VALUE".to_owned()));
        };
        let value: i64 = value
            .trim()
            .parse()
            .map_err(|_| bad("the value is not a whole number", value, "a whole number".to_owned()))?;
        for case in &mut self.cases {
            properties::set(&mut case.config, name.trim(), value).map_err(|e| match &e {
                PropertyError::Unknown { .. } => bad("no property has this name", &e.found(), e.expected()),
                PropertyError::Range { .. } => bad("the value is out of range", &e.found(), e.expected()),
            })?;
        }
        Ok(())
    }
}

/// A value of the file that the plant's own check accepts.
fn checked<T: Clone>(
    source: Source<'_>,
    value: &Spanned<T>,
    check: impl Fn(&T) -> Result<(), ParamError>,
) -> Result<T, BadInput> {
    match check(value.get_ref()) {
        Ok(()) => Ok(value.get_ref().clone()),
        Err(e) => {
            let next = "correct it, or leave it out for the default";
            let mut error =
                source.error(value.span(), format!("{} is out of range", e.field), &e.expected, next);
            error.found = format!("{} = {}", e.field, e.found);
            Err(error)
        }
    }
}

/// Whether a rig takes an object.
fn check_object(object: &Object, plant: &PlantParams) -> Result<(), ParamError> {
    let (rig, start) = (RigParams::default(), Initial::default().start(plant));
    Rig::new(plant.clone(), rig, &[*object], Model::Averaged, start, 0).map(|_| ())
}

/// The nominal plant of a motor with the file's overrides.
fn plant(source: Source<'_>, motor: MotorKind, overrides: &file::Numbers) -> Result<PlantParams, BadInput> {
    let nominal = PlantParams::for_motor(motor);
    let Ok(mut table) = toml::Table::try_from(&nominal) else { return Ok(nominal) };
    for (name, value) in overrides {
        let Some(slot) = table.get_mut(name.get_ref().as_str()) else {
            let known: Vec<String> = table.keys().map(|key| format!("`{key}`")).collect();
            let known = known.join(", ");
            let next = error::suggestion(name.get_ref(), &known);
            return Err(source.error(name.span(), format!("[plant] has no {}", name.get_ref()), known, next));
        };
        *slot = toml::Value::Float(value.get_ref().0);
    }
    let plant = table.try_into().unwrap_or(nominal);
    plant.validate().map_err(|e| {
        let named = |(name, _): &(&Spanned<String>, _)| name.get_ref() == e.field;
        let span = overrides.iter().find(named).map_or(0..0, |(name, _)| name.span());
        let next = "correct it, or leave it out for the default";
        source.error(span, format!("[plant] {} is out of range", e.field), &e.expected, next)
    })?;
    Ok(plant)
}

/// Properties by name, each once, in range.
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
        let mut scratch = Config::for_motor(MotorKind::Link);
        if let Err(e) = property.set(&mut scratch, value) {
            let problem = format!("{} = {value} is out of range", property.name);
            return fail(problem, e.expected(), "choose a value in the range");
        }
        rows.push((property, value));
    }
    Ok(rows)
}

/// One `[[at]]` table: a time and exactly one action.
fn timed(source: Source<'_>, at: &Spanned<file::At>, duration_ms: u32) -> Result<Timed, BadInput> {
    let file::At { ms, .. } = *at.get_ref();
    let fail = |problem: String, expected: String, next: &str| {
        Err(source.error(at.span(), problem, expected, next))
    };
    if ms >= duration_ms {
        return fail(
            format!("[[at]] ms = {ms} is not before the end of the run"),
            format!("0 to {}", duration_ms.saturating_sub(1)),
            "make duration_ms longer or the command earlier",
        );
    }
    let mut actions = actions(source, at.get_ref())?;
    match (actions.pop(), actions.len()) {
        (Some(action), 0) => Ok(Timed { ms, action }),
        (found, more) => fail(
            format!("[[at]] ms = {ms} has {} commands", more + usize::from(found.is_some())),
            "one command beside ms: move, end, position, mode, torque, velocity, torque_close, torque_open, home, \
             abort, terminate, clear_fault, clear_breakaway, set, disturbance_n_m or bus_v"
                .to_owned(),
            "write one [[at]] for each command; equal times keep their order",
        ),
    }
}

/// All actions in an `[[at]]` table.
fn actions(source: Source<'_>, at: &file::At) -> Result<Vec<Action>, BadInput> {
    let set = at.set.as_ref().map(|set| settings(source, set)).transpose()?;
    let commands = [
        at.r#move.as_ref().map(|e| Command::Move(e.0)),
        at.end.as_ref().map(|e| Command::End(e.0)),
        at.position.as_ref().map(|p| Command::Position(p.0)),
        at.mode.as_ref().map(|mode| Command::Mode(mode.0)),
        at.torque.as_ref().map(|t| Command::Torque(Torque(t.0))),
        at.velocity.as_ref().map(|v| Command::Velocity(CountsPerSec::from_int(v.0))),
        at.torque_close.as_ref().map(|_| Command::TorqueControlled { closing: true }),
        at.torque_open.as_ref().map(|_| Command::TorqueControlled { closing: false }),
        at.home.as_ref().map(|_| Command::Home),
        at.abort.as_ref().map(|_| Command::Abort),
        at.terminate.as_ref().map(|_| Command::Terminate),
        at.clear_fault.as_ref().map(|_| Command::ClearFault),
        at.clear_breakaway.as_ref().map(|_| Command::ClearBreakaway),
    ];
    let commands = commands.into_iter().flatten().map(Action::Command);
    let others = [
        set.map(Action::Set),
        at.disturbance_n_m.map(|n_m| Action::Disturbance(n_m.0)),
        at.bus_v.map(|v| Action::Bus(v.0)),
    ];
    Ok(commands.chain(others.into_iter().flatten()).collect())
}

/// One `[[expect]]` table.
fn expectation(source: Source<'_>, expect: &Spanned<file::Expect>) -> Result<Expectation, BadInput> {
    let file::Expect { metric: name, min, max, equals, tolerance } = expect.get_ref();
    let fail = |problem: String, expected: String, next: &str| {
        Err(source.error(expect.span(), problem, expected, next))
    };
    let Some(metric) = metrics::find(name) else {
        let known = metrics::METRICS.map(|metric| metric.name).join(", ");
        let next = match error::closest(name, metrics::METRICS.iter().map(|metric| metric.name)) {
            Some(like) => format!("did you mean {like}?"),
            None => "use one of those".to_owned(),
        };
        return fail(format!("[[expect]] metric {name} is not known"), known, &next);
    };
    let want = match (metric.word, equals, min, max, tolerance) {
        (true, Some(file::Wanted::Text(word)), None, None, None) => Want::Word(word.clone()),
        (false, Some(file::Wanted::Number(value)), None, None, tolerance) => {
            let tolerance = tolerance.map_or(0.0, |t| t.0.abs());
            Want::Within(value - tolerance, value + tolerance)
        }
        (false, None, min, max, None) if min.is_some() || max.is_some() => {
            Want::Within(min.map_or(f64::NEG_INFINITY, |n| n.0), max.map_or(f64::INFINITY, |n| n.0))
        }
        (true, ..) => {
            return fail(format!("[[expect]] {name} is a word"), "equals = \"...\"".to_owned(), "use equals");
        }
        (false, ..) => {
            let expected = "min, max or both; or equals = number, with a tolerance or without";
            let problem = format!("[[expect]] {name} says nothing to compare with");
            return fail(problem, expected.to_owned(), "add one of those");
        }
    };
    if matches!(want, Want::Within(min, max) if min > max) {
        let problem = format!("[[expect]] {name}: min is above max");
        return fail(problem, "min at most max".to_owned(), "exchange them");
    }
    Ok(Expectation { metric, want })
}
