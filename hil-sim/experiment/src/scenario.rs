//! Scenarios: what to simulate and what to expect, as TOML.
//!
//! A file that parses can run: every name, unit and range is checked here. A key's name ends in its unit. Everything but the
//! first keys is optional:
//!
//! ```
//! let scenario = hil_experiment::scenario::Scenario::parse("push.toml", r#"
//!     name = "push"
//!     about = "A link closes on something soft while the supply sags."
//!     motor = "link"                   # or "spread", "tip", or a list of them, run one after another
//!     duration_ms = 1000
//!     scatter = 0.3                    # the seed scatters inertia, friction, Ke and R by ±30 %, the bus 20..28 V
//!     hall_scatter_deg = 10            # and the halls' placement by ±10° electrical
//!
//!     plant = { coulomb_n_m = 0.02 }   # fields of `PlantParams`
//!     rig = { rise_delay_us = 100 }    # fields of `RigParams`
//!     set = { ACCEL = 60, HOLD = 1 }   # properties, as `--set` takes them
//!     initial = { position_counts = 20, housing_c = 30 }
//!
//!     [[object]]                       # fields of `Object`
//!     from_count = 150
//!     side = "closing"
//!     stiffness_n_m_rad = 0.5
//!     damping_n_m_s = 0.005
//!
//!     [[at]]                           # a time and one command: move, end, position, mode, torque, velocity,
//!     ms = 50                          # torque_close, torque_open, home, abort, terminate, clear_fault, set,
//!     move = 300                       # disturbance_n_m or bus_v
//!
//!     [[at]]
//!     ms = 200
//!     bus_v = 21
//!
//!     [[expect]]                       # a metric: min, max or both; or equals, with a tolerance or without
//!     metric = "position_counts"
//!     min = 150
//!     from_ms = 500                    # measured in this window only; to_ms ends it
//! "#).unwrap();
//! assert_eq!(scenario.timeline.len(), 2);
//! ```

mod figures;
mod file;
mod read;
mod shipped;

pub use figures::{FIGURES, Figure};
pub use shipped::{SHIPPED, Shipped};

use servo_core::mode::Mode;
use servo_core::{Command, Config};
use tater_wire::MotorKind;
use tater_wire::property::Range;

use crate::metrics::{self, Metric, Metrics, Value, Window};
use crate::properties::Property;
use hil_world::plant::{Heat, Model, ParamError, PlantParams, Start};
use hil_world::rig::{Object, Rig, RigParams};
use servo_core::way::Way;

/// A scenario.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name, as printed.
    pub name: String,
    /// One sentence for `hil-sim list` and the report.
    pub about: String,
    /// Arguments of `hil-sim run` that reproduce this scenario: its name or file, and `--set`s.
    pub arguments: String,
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
    /// Objects in the joint's way.
    pub objects: Vec<Object>,
    /// Timed actions, in order of time.
    pub timeline: Vec<Timed>,
    /// Expected results.
    pub expectations: Vec<Expectation>,
}

impl Scenario {
    /// The windows of its expectations, each once, without that of the whole run.
    #[must_use]
    pub fn windows(&self) -> Vec<Window> {
        let mut windows = Vec::new();
        for window in self.expectations.iter().map(|expectation| expectation.window) {
            if window != Window::ALL && !windows.contains(&window) {
                windows.push(window);
            }
        }
        windows
    }
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
    /// Its joint's range, JLO and JHI; `None`: that of the kind.
    pub range: Option<Range>,
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
    /// Housing temperature; `None`: ambient.
    pub housing_c: Option<f64>,
}

impl Initial {
    /// The plant's start for these values.
    #[must_use]
    pub fn start(&self, plant: &PlantParams) -> Start {
        let housing_c = self.housing_c.unwrap_or(plant.ambient_c);
        let heat = Heat { winding_c: self.winding_c.unwrap_or(housing_c), housing_c };
        Start { count: self.position_counts, counts_per_s: self.velocity_counts_s, heat }
    }

    /// Checks the values against the plant; the error names the field as in the file.
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

/// An action and its time.
#[derive(Clone, Debug)]
pub struct Timed {
    /// When, ms since the start of the run.
    pub ms: u32,
    /// The action.
    pub action: Action,
}

/// An action on a motor board.
#[derive(Clone, Debug)]
pub enum Action {
    /// A host's order.
    Order(Order),
    /// Properties set by a host.
    Set(Vec<(&'static Property, i64)>),
    /// An external torque on the motor's shaft from now on, N·m, positive closing.
    Disturbance(f64),
    /// The supply voltage from now on.
    Bus(f64),
}

/// A host's order to a motor.
#[derive(Clone, Copy)]
pub enum Order {
    /// A command of the servo.
    Command(Command),
    /// Ends the motion, as ^C does: the host sets MODE 3 with HOLD 1, and MODE 0 with HOLD 0 (manual 5.5 case 3).
    Abort,
}

impl Order {
    /// The command as which the metrics count the order. An abort starts no motion, whatever follows it: it counts as MODE 0.
    pub(super) const fn counts_as(&self) -> Command {
        match self {
            Self::Command(command) => *command,
            Self::Abort => Command::Mode(Mode::Idle),
        }
    }
}

impl std::fmt::Debug for Order {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Command(command) => command.fmt(f),
            Self::Abort => f.write_str("Abort"),
        }
    }
}

impl std::fmt::Display for Action {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Order(Order::Abort) => f.write_str("abort"),
            Self::Order(Order::Command(command)) => match command {
                Command::Mode(mode) => write!(f, "mode {}", metrics::mode_word(*mode)),
                Command::Torque(torque) => write!(f, "T = {}", torque.0),
                Command::Velocity(velocity) => write!(f, "V = {}", velocity.round()),
                Command::Position(position) => write!(f, "P = {position}"),
                Command::End(end) => write!(f, "E = {end}"),
                Command::Move(end) => write!(f, "move to {end}"),
                Command::TorqueControlled { way: Way::Closing } => f.write_str("TC"),
                Command::TorqueControlled { way: Way::Opening } => f.write_str("TO"),
                Command::Home => f.write_str("HI"),
                Command::Find => f.write_str("FIND"),
                Command::Terminate => f.write_str("terminate"),
                Command::Configure(_) => f.write_str("configure"),
                Command::ClearFault => f.write_str("clear fault"),
                Command::ClearBreakaway => f.write_str("clear breakaway"),
                Command::MoveToEnd => f.write_str("mode trapezoidal, as HOLD says"),
            },
            Self::Set(rows) => {
                let words: Vec<_> =
                    rows.iter().map(|(row, value)| format!("{} = {value}", row.name)).collect();
                f.write_str(&words.join(", "))
            }
            Self::Disturbance(n_m) => write!(f, "disturbance {n_m} N·m"),
            Self::Bus(v) => write!(f, "bus {v} V"),
        }
    }
}

/// An expected metric.
#[derive(Clone, Debug)]
pub struct Expectation {
    /// The metric.
    pub metric: &'static Metric,
    /// The expected value.
    pub want: Want,
    /// The part of the run in which it is measured.
    pub window: Window,
}

/// The expected value of a metric.
#[derive(Clone, Debug, PartialEq)]
pub enum Want {
    /// A range, both ends included.
    Within(f64, f64),
    /// A word.
    Word(String),
}

/// The result of an expectation.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// The metric, prefixed with the motor where a scenario has several.
    pub name: String,
    /// Whether it was met.
    pub ok: bool,
    /// The actual value.
    pub value: Value,
    /// The expected value, in words.
    pub want: String,
}

impl Expectation {
    /// The metric, with the window if it is not the whole run.
    fn name(&self) -> String {
        let name = self.metric.name;
        match self.window {
            Window::ALL => name.to_owned(),
            Window { from_ms, to_ms: u32::MAX } => format!("{name} from {from_ms} ms"),
            Window { from_ms, to_ms } => format!("{name}, {from_ms} to {to_ms} ms"),
        }
    }

    /// Judges the metrics of a run within the window. A missing value fails a numeric expectation.
    #[must_use]
    pub fn judge(&self, metrics: &Metrics) -> Verdict {
        let value = (self.metric.get)(metrics);
        let ok = match (&self.want, &value) {
            (Want::Within(min, max), Value::Number(value)) => value >= min && value <= max,
            (Want::Word(word), Value::Text(text)) => word == text,
            _ => false,
        };
        Verdict { name: self.name(), ok, value, want: self.want.to_string() }
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
