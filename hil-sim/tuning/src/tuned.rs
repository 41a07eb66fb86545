//! The file of tuned values that goes from `hil-sim export` to `apply`: JSON that a person can read.
//!
//! It is made only from a result of `tune` that passed its validation, and read only if it says so. Names and ranges are those of the table
//! of properties.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use tater_wire::{MotorKind, Property};

use hil_experiment::properties::{self, PROPERTIES, PropertyError};
use traces::input::{self, BadInput};

/// Version of the file; another meaning of a key is another version.
pub const FORMAT: u64 = 1;

/// The file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tuned {
    /// [`FORMAT`].
    pub format: u64,
    /// The commit of the program that tuned; "unknown" of a debug build.
    pub commit: String,
    /// The command line that gives the same values again.
    pub reproduce: String,
    /// One entry for each kind of motor.
    pub motors: Vec<Motor>,
}

/// The values of one kind of motor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// `link`, `spread` or `tip`.
    pub motor: String,
    /// What a board shall have: the tuned values, and those of `--set`, on which they rest.
    pub properties: BTreeMap<String, i64>,
    /// Where the search began; not for those of `--set`.
    pub tuned_from: BTreeMap<String, i64>,
    /// The trial on plants that the search has not seen.
    pub validation: Validation,
}

/// The trial on plants that the search has not seen.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Validation {
    /// Whether no plant broke a limit.
    pub passed: bool,
    /// How many plants.
    pub plants: u64,
    /// The seed of the first of them.
    pub first_seed: u64,
    /// Their cost before (1: docs/tune.md).
    pub cost_start: f64,
    /// Their cost with the tuned values.
    pub cost_tuned: f64,
}

impl Motor {
    /// The kind of motor; `None` if the name is none.
    #[must_use]
    pub fn kind(&self) -> Option<MotorKind> {
        KINDS.into_iter().find(|kind| kind.name() == self.motor)
    }

    /// The properties with their values, in the order of the names.
    #[must_use]
    pub fn values(&self) -> Vec<(Property, i64)> {
        let of = |(name, value): (&String, &i64)| Some((properties::find(name)?.property, *value));
        self.properties.iter().filter_map(of).collect()
    }
}

const KINDS: [MotorKind; 3] = [MotorKind::Link, MotorKind::Spread, MotorKind::Tip];

impl Tuned {
    /// Reads the file `place` and checks each entry.
    ///
    /// # Errors
    /// No JSON, another format, a validation that was not passed, an unknown motor or property, or a value out of range.
    pub fn parse(place: &str, text: &str) -> Result<Self, BadInput> {
        let value = json(place, text, "give a file of `hil-sim export`")?;
        if value.get("format").is_none() && value.get("reproduce").is_some() {
            return Err(BadInput::new(place, "is a result of `hil-sim tune`, not an export of it")
                .found("no key \"format\"")
                .expected(format!("\"format\": {FORMAT}"))
                .next("export it: hil-sim export DIR --to tuned.json, with DIR the folder of --out"));
        }
        if value.get("format") != Some(&Value::from(FORMAT)) {
            let found =
                value.get("format").map_or_else(|| "none".to_owned(), |f| input::shorten(&f.to_string()));
            return Err(BadInput::new(place, "has another format")
                .found(format!("format {found}"))
                .expected(format!("\"format\": {FORMAT}"))
                .next("export it again with this version's `hil-sim export`"));
        }
        // From the text: its errors have lines.
        let tuned: Self = serde_json::from_str(text).map_err(|error| {
            BadInput::new(format!("{place}:{}", error.line()), "has another form")
                .found(input::shorten(&error.to_string()))
                .expected("the keys of `hil-sim export` (docs/tuning.md)")
                .next("export it again")
        })?;
        tuned.check(place)?;
        Ok(tuned)
    }

    fn check(&self, place: &str) -> Result<(), BadInput> {
        let bad = |problem: String, found: String, expected: &str, next: &str| {
            BadInput::new(place, problem).found(found).expected(expected).next(next)
        };
        if self.motors.is_empty() {
            return Err(bad(
                "has no motor".to_owned(),
                "motors: []".to_owned(),
                "one or more",
                "export it again",
            ));
        }
        for (index, motor) in self.motors.iter().enumerate() {
            let name = input::shorten(&motor.motor);
            if motor.kind().is_none() {
                let known = KINDS.map(MotorKind::name);
                let next = input::did_you_mean(&name, known.into_iter()).unwrap_or_default();
                let next = if next.is_empty() { "use one of those".to_owned() } else { next };
                return Err(bad(
                    "motor: no node has a motor of this kind".to_owned(),
                    name,
                    &known.join(", "),
                    &next,
                ));
            }
            if self.motors[..index].iter().any(|other| other.motor == motor.motor) {
                return Err(bad(
                    format!("{name} is there twice"),
                    name,
                    "each motor once",
                    "remove one of the two",
                ));
            }
            if !motor.validation.passed {
                return Err(bad(
                    format!("{name} did not pass its validation"),
                    "\"passed\": false".to_owned(),
                    "values that break no limit on any plant",
                    "tune again; values of such a file are not written to a motor",
                ));
            }
            motor.check(place)?;
        }
        Ok(())
    }

    /// Makes the file from the result of `tune` in the file `place`.
    ///
    /// # Errors
    /// No JSON, no result of `tune`, or one that did not pass its validation: the motor, the limit and the plant's seed.
    pub fn of_result(place: &str, text: &str) -> Result<Self, BadInput> {
        let value = json(place, text, "give the folder of `hil-sim tune --out`")?;
        let result: Outcome = serde_json::from_value(value).map_err(|error| {
            BadInput::new(place, "is no result of `hil-sim tune`")
                .found(input::shorten(&error.to_string()))
                .expected("the keys of docs/tune.md")
                .next("tune again with --out")
        })?;
        let mut motors = Vec::new();
        for of in result.motors {
            if !of.passed || !of.validation.broken.is_empty() {
                return Err(of.refusal(place));
            }
            let mut properties = of.properties;
            properties.extend(of.set);
            motors.push(Motor {
                motor: of.motor,
                properties,
                tuned_from: of.start,
                validation: Validation {
                    passed: true,
                    plants: of.validation.plants,
                    first_seed: of.validation.first_seed,
                    cost_start: of.validation.cost_start,
                    cost_tuned: of.validation.cost_tuned,
                },
            });
        }
        let tuned = Self { format: FORMAT, commit: result.commit, reproduce: result.reproduce, motors };
        tuned.check(place)?;
        Ok(tuned)
    }

    /// The file's text.
    #[must_use]
    pub fn text(&self) -> String {
        // Plain structures with names as keys always have a text.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}

impl Motor {
    fn check(&self, place: &str) -> Result<(), BadInput> {
        let motor = &self.motor;
        let bad = |problem: String, error: &PropertyError, next: String| {
            BadInput::new(place, format!("{motor}: {problem}"))
                .found(input::shorten(&error.found()))
                .expected(error.expected())
                .next(next)
        };
        if self.properties.is_empty() {
            let error = PropertyError::Unknown { name: String::new() };
            return Err(bad("no property is tuned".to_owned(), &error, "export it again".to_owned()));
        }
        for (name, &value) in &self.properties {
            let Some(property) = properties::find(name) else {
                let error = PropertyError::Unknown { name: name.clone() };
                let known = PROPERTIES.map(|property| property.name);
                let next = input::did_you_mean(name, known.into_iter());
                let next = next.unwrap_or_else(|| "remove it, or use one of those".to_owned());
                return Err(bad("no property that shapes a motion has this name".to_owned(), &error, next));
            };
            let (min, max) = property.range();
            if !(min..=max).contains(&value) {
                let error = PropertyError::Range { name: property.name, found: value, min, max };
                return Err(bad(
                    "a value is out of range".to_owned(),
                    &error,
                    "tune and export again".to_owned(),
                ));
            }
        }
        Ok(())
    }
}

fn json(place: &str, text: &str, next: &str) -> Result<Value, BadInput> {
    serde_json::from_str(text).map_err(|error| {
        BadInput::new(
            format!("{place}:{}", error.line()),
            if error.is_eof() { "ends too early" } else { "is no JSON" }.to_owned(),
        )
        .found(input::shorten(&error.to_string()))
        .expected("one whole JSON object")
        .next(next)
    })
}

/// The result of `tune`: of its keys (docs/tune.md) those that matter here.
#[derive(Deserialize)]
struct Outcome {
    commit: String,
    reproduce: String,
    motors: Vec<OfMotor>,
}

#[derive(Deserialize)]
struct OfMotor {
    motor: String,
    passed: bool,
    properties: BTreeMap<String, i64>,
    start: BTreeMap<String, i64>,
    set: BTreeMap<String, i64>,
    validation: OfValidation,
}

#[derive(Deserialize)]
struct OfValidation {
    plants: u64,
    first_seed: u64,
    cost_start: f64,
    cost_tuned: f64,
    broken: Vec<Limit>,
}

#[derive(Deserialize)]
struct Limit {
    objective: String,
    seed: u64,
    what: String,
}

impl OfMotor {
    fn refusal(&self, place: &str) -> BadInput {
        let Self { motor, validation: OfValidation { plants, broken, .. }, .. } = self;
        let found = match broken.as_slice() {
            [Limit { objective, seed, what }, more @ ..] => {
                format!("{objective} on the plant of seed {seed}: {what}; {} more", more.len())
            }
            [] => "a limit broken on a plant of the search".to_owned(),
        };
        BadInput::new(place, format!("{} did not pass its validation", input::shorten(motor)))
            .found(found)
            .expected(format!("no broken limit on {plants} unseen plants"))
            .next("tune again with a longer --budget or more plants (--robust), or ask less of the motor")
    }
}

#[cfg(test)]
mod tests;
