//! The figures of plant, sensors and supply that a command line or a job overrides.

use crate::experiment::input::BadInput;
use crate::experiment::scenario::Scenario;

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

    /// As arguments of a command line, each with a space before it.
    pub fn arguments(&self) -> String {
        self.all().into_iter().map(|(option, assignment)| format!(" --{option} {assignment}")).collect()
    }
}
