//! The figures of plant, sensors and supply that a command line or a job overrides.

use std::path::PathBuf;

use tater_wire::MotorKind;

use super::output::quoted;
use hil_experiment::motor_file::MotorFile;
use hil_experiment::run::{Options, rig};
use hil_experiment::scenario::Scenario;
use hil_world::plant::{Model, ParamError};
use hil_world::rig::Rig;
use traces::input::BadInput;

/// Options `--plant`, `--rig` and `--supply`, each repeatable.
#[derive(clap::Args, Clone, Default)]
pub(super) struct Figures {
    /// Set a figure of the motor or its joint, such as inertia=1.3x or coulomb_n_m=0.02 (see `list --plant`); repeatable.
    #[arg(long, value_name = "NAME=VALUE")]
    pub plant: Vec<String>,
    /// Set a figure of the board's sensors, such as hall_offset_deg=7; repeatable.
    #[arg(long, value_name = "NAME=VALUE")]
    pub rig: Vec<String>,
    /// Set the supply, such as volts=22.
    #[arg(long, value_name = "NAME=VALUE")]
    pub supply: Vec<String>,
    /// A motor that a file describes.
    #[arg(skip)]
    pub motor_file: Option<MotorFile>,
}

/// A motor of a command line: a kind of the hand's, or the path of a file that describes another (docs/motor.md).
#[derive(Clone, Debug)]
pub(super) enum MotorArg {
    /// One of the hand's.
    Kind(MotorKind),
    /// The path of a file.
    File(PathBuf),
}

impl std::str::FromStr for MotorArg {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let kinds = [MotorKind::Link, MotorKind::Spread, MotorKind::Tip];
        let kind = kinds.into_iter().find(|kind| kind.name() == text);
        Ok(kind.map_or_else(|| Self::File(PathBuf::from(text)), Self::Kind))
    }
}

impl MotorArg {
    /// The kind, and the file if there is one, whose motor is in the place of a link.
    ///
    /// # Errors
    /// Those of [`MotorFile::read`].
    pub fn read(&self) -> Result<(MotorKind, Option<MotorFile>), BadInput> {
        match self {
            Self::Kind(kind) => Ok((*kind, None)),
            Self::File(path) => MotorFile::read(path).map(|file| (MotorKind::Link, Some(file))),
        }
    }
}

impl Figures {
    /// Options and assignments, in the order in which they are applied.
    fn all(&self) -> Vec<(&str, &str)> {
        [("plant", &self.plant), ("rig", &self.rig), ("supply", &self.supply)]
            .into_iter()
            .flat_map(|(option, all)| all.iter().map(move |assignment| (option, assignment.as_str())))
            .collect()
    }

    /// Overrides them in the scenario.
    ///
    /// # Errors
    /// Those of [`Scenario::override_figures`].
    pub fn apply(&self, scenario: &mut Scenario) -> Result<(), BadInput> {
        scenario.override_figures(&self.all())
    }

    /// Puts the motor of the file, if there is one, in the place of the scenario's: before its properties are set.
    ///
    /// # Errors
    /// Those of [`Scenario::take_motor`].
    pub fn take_motor(&self, scenario: &mut Scenario) -> Result<(), BadInput> {
        self.motor_file.as_ref().map_or(Ok(()), |file| scenario.take_motor(file))
    }

    /// A motor of a kind with these figures, at rest.
    ///
    /// # Errors
    /// Those of [`Scenario::override_figures`].
    pub fn motor(&self, kind: MotorKind, position_counts: f64, seed: u64) -> Result<Rig, BadInput> {
        let name = kind.name();
        let text = format!(
            "name = 'motor'\nabout = 'a motor at rest'\nmotor = '{name}'\nduration_ms = 1\ninitial = {{ position_counts = {position_counts:.1} }}\n"
        );
        let mut scenario = Scenario::parse("motor", &text)?;
        self.take_motor(&mut scenario)?;
        self.apply(&mut scenario)?;
        let wrong = |error: &ParamError| {
            BadInput::new(format!("the {name}"), format!("{} is out of range", error.field))
                .found(error.found.to_string())
                .expected(error.expected.clone())
                .next("give other figures")
        };
        let options = Options { seed, model: Model::Averaged, trace: false };
        let built = scenario.cases.first().map(|case| rig(&scenario, case, &options));
        // A scenario with a motor has a case.
        built
            .unwrap_or_else(|| Err(ParamError { field: "motor", found: 0.0, expected: "one".to_owned() }))
            .map_err(|e| wrong(&e))
    }

    /// As arguments of a command line, each with a space before it.
    pub fn arguments(&self) -> String {
        let file = self.motor_file.iter().map(|file| format!(" --motor {}", quoted(file.path())));
        let overrides = self.all();
        let overrides =
            overrides.into_iter().map(|(option, assignment)| format!(" --{option} {}", quoted(assignment)));
        file.chain(overrides).collect()
    }
}
