//! Sweeps: one scenario or several over sets of parameters, each run on a row of a table.
//!
//! A run is known by its number. Scenarios, then the combinations of the grid, then the samples, then their repeats are counted
//! through, the repeats fastest. Everything about a run comes from the number and the file: it is the same in each shard and thread.
//!
//! A sample has the same draws and the same seeds at each point of the grid and in each scenario, so that two of them are compared
//! on the same plants and the same noise.

mod draw;
mod execute;
mod file;
mod report;
mod table;

pub use draw::digest;
pub use execute::{Flow, execute};
pub use report::Report;
pub use table::{ResultColumn, fields, head};

use draw::Stream;
use hil_experiment::motor_file::MotorFile;
use hil_experiment::report::model_name;
use hil_experiment::run::{Options, Outcome, run};
use hil_experiment::scenario::Scenario;
use hil_world::plant::Model;
use traces::input::BadInput;

/// Returns the file name and the text of a scenario, by its name in a sweep's file.
pub type Load<'a> = &'a mut dyn FnMut(&str) -> Result<(String, String), BadInput>;

/// A sweep.
#[derive(Clone, Debug)]
pub struct Sweep {
    text: String,
    /// In the place of each scenario's motor.
    motor: Option<MotorFile>,
    entries: Vec<Entry>,
    model: Model,
    seed: u64,
    repeats: u64,
    samples: u64,
    axes: Vec<Axis>,
    rows: u64,
}

/// A scenario of a sweep.
#[derive(Clone, Debug)]
struct Entry {
    name: String,
    text: String,
    scenario: Scenario,
}

/// A parameter that is varied.
#[derive(Clone, Debug)]
struct Axis {
    /// The option of `hil-sim run` that sets it.
    option: &'static str,
    name: &'static str,
    unit: &'static str,
    is_whole: bool,
    /// Whether its values multiply what the scenario says.
    is_factor: bool,
    places: Places,
}

#[derive(Clone, Debug)]
enum Places {
    Levels(Vec<f64>),
    Drawn { stream: Stream, is_latin: bool, from: f64, to: f64, is_log: bool },
}

impl Axis {
    /// Its column's name, such as `set.KP`, `plant.j_kg_m2` or `plant.j_kg_m2.x` for multiples.
    fn column(&self) -> String {
        format!("{}.{}{}", self.option, self.name, if self.is_factor { ".x" } else { "" })
    }

    fn is_same(&self, other: &Self) -> bool {
        (self.option, self.name) == (other.option, other.name)
    }

    /// As `hil-sim run` takes it.
    fn assignment(&self, value: f64) -> String {
        format!("{}={value}{}", self.name, if self.is_factor { "x" } else { "" })
    }

    /// The values that show whether all are in range.
    fn extremes(&self) -> Vec<f64> {
        match &self.places {
            Places::Levels(levels) => levels.clone(),
            Places::Drawn { from, to, .. } => vec![*from, *to],
        }
    }

    fn levels(&self) -> u64 {
        match &self.places {
            Places::Levels(levels) => levels.len() as u64,
            Places::Drawn { .. } => 1,
        }
    }

    fn value(&self, level: u64, sample: u64, samples: u64) -> f64 {
        match &self.places {
            Places::Levels(levels) => levels.get(level as usize).copied().unwrap_or(0.0),
            Places::Drawn { stream, is_latin, from, to, is_log } => {
                let share = if *is_latin { stream.stratum(sample, samples) } else { stream.uniform(sample) };
                if self.is_whole {
                    // Each whole number has an equal part of the interval.
                    between(*from, to + 1.0, *is_log, share).floor().clamp(*from, *to)
                } else {
                    round(between(*from, *to, *is_log, share)).clamp(*from, *to)
                }
            }
        }
    }
}

/// The value at a share of an interval.
fn between(from: f64, to: f64, is_log: bool, share: f64) -> f64 {
    if is_log { from * (to / from).powf(share) } else { from + share * (to - from) }
}

/// To nine digits, so that a line that reproduces a run stays short.
fn round(value: f64) -> f64 {
    format!("{value:.8e}").parse().unwrap_or(value)
}

/// One run of a sweep.
#[derive(Clone, Debug)]
pub struct Run {
    /// Its number.
    pub index: u64,
    /// The number of its scenario.
    entry: usize,
    /// The values of the parameters, in the order of the axes.
    values: Vec<f64>,
    /// Its seed.
    pub seed: u64,
}

impl Sweep {
    /// Number of runs.
    #[must_use]
    pub const fn rows(&self) -> u64 {
        self.rows
    }

    /// The file's text.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The motor in the place of each scenario's, if it is another.
    #[must_use]
    pub const fn motor(&self) -> Option<&MotorFile> {
        self.motor.as_ref()
    }

    /// Name and text of each scenario.
    pub fn scenarios(&self) -> impl Iterator<Item = (&str, &str)> {
        self.entries.iter().map(|entry| (entry.name.as_str(), entry.text.as_str()))
    }

    /// Tells it from other sweeps: hexadecimal, of the texts of the file, of its scenarios and of the motor.
    #[must_use]
    pub fn digest(&self) -> String {
        let texts = self.scenarios().flat_map(|(name, text)| [name.as_bytes(), text.as_bytes()]);
        let motor = self.motor.iter().flat_map(|file| [file.path().as_bytes(), file.text().as_bytes()]);
        format!("{:016x}", digest(std::iter::once(self.text.as_bytes()).chain(texts).chain(motor)))
    }

    fn grid(&self) -> Option<u64> {
        self.axes.iter().try_fold(1u64, |product, axis| product.checked_mul(axis.levels()))
    }

    fn count(&self) -> Option<u64> {
        let rows = self.grid()?.checked_mul(self.entries.len() as u64)?;
        let rows = rows.checked_mul(self.samples)?.checked_mul(self.repeats)?;
        i64::try_from(rows).ok().map(|_| rows)
    }

    /// The runs of shard `shard` (1 to `of`): neighbors in number, and in total all of them.
    #[must_use]
    pub fn shard(&self, shard: u64, of: u64) -> std::ops::Range<u64> {
        shard_of(self.rows, shard, of)
    }

    /// A run by its number.
    #[must_use]
    pub fn run(&self, index: u64) -> Run {
        let (rest, repeat) = (index / self.repeats, index % self.repeats);
        let (rest, sample) = (rest / self.samples, rest % self.samples);
        let grid = self.grid().unwrap_or(1);
        let (entry, mut point) = ((rest / grid) as usize, rest % grid);
        let mut values = vec![0.0; self.axes.len()];
        // The last parameter of the grid varies fastest.
        for (axis, value) in self.axes.iter().zip(&mut values).rev() {
            let level = point % axis.levels();
            point /= axis.levels();
            *value = axis.value(level, sample, self.samples);
        }
        let seed = self.seed.wrapping_add(sample.wrapping_mul(self.repeats).wrapping_add(repeat));
        Run { index, entry, values, seed }
    }

    /// Runs it.
    ///
    /// # Errors
    /// Parameters that do not fit together.
    pub fn simulate(&self, of: &Run) -> Result<Outcome, BadInput> {
        let mut scenario = self.entries[of.entry].scenario.clone();
        let assignments: Vec<(&str, String)> = self
            .axes
            .iter()
            .zip(&of.values)
            .map(|(axis, value)| (axis.option, axis.assignment(*value)))
            .collect();
        let (set, figures): (Vec<_>, Vec<_>) = assignments
            .iter()
            .map(|(option, text)| (*option, text.as_str()))
            .partition(|(option, _)| *option == "set");
        for (_, assignment) in set {
            scenario.set(assignment)?;
        }
        scenario.override_figures(&figures)?;
        let options = Options { seed: of.seed, model: self.model, trace: false };
        run(&scenario, &options).map_err(|e| {
            BadInput::new(self.entries[of.entry].name.clone(), format!("{} is out of range", e.field))
                .found(e.found.to_string())
                .expected(e.expected)
                .next("narrow the parameters")
        })
    }

    /// The line that runs it alone; `name` is how its scenario is found from there, `quoted` a path as an argument.
    #[must_use]
    pub fn line(&self, of: &Run, name: &dyn Fn(&str) -> String, quoted: &dyn Fn(&str) -> String) -> String {
        let mut line = format!("hil-sim run {}", name(&self.entries[of.entry].name));
        if let Some(motor) = &self.motor {
            line.push_str(&format!(" --motor {}", quoted(motor.path())));
        }
        for (axis, value) in self.axes.iter().zip(&of.values) {
            line.push_str(&format!(" --{} {}", axis.option, axis.assignment(*value)));
        }
        format!("{line} --seed {} --model {}", of.seed, model_name(self.model))
    }
}

/// The runs of shard `shard` (1 to `of`) of `rows`.
#[must_use]
pub fn shard_of(rows: u64, shard: u64, of: u64) -> std::ops::Range<u64> {
    let part = |shard: u64| (u128::from(rows) * u128::from(shard) / u128::from(of.max(1))) as u64;
    part(shard.saturating_sub(1))..part(shard)
}

#[cfg(test)]
mod tests;
