//! Runs a scenario on each of its motors and judges the results.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use servo_core::Command;
use servo_core::mode::Mode;
pub use tater_fw::SetError;
use tater_fw::codes::mode_code;
use tater_wire::property::Range;
use tater_wire::{Cmd, Destination, Message, MotorKind, Property};

use crate::events::{self, motor_text, of_board};
use crate::metrics::{Meters, Metrics, Value, Window};
use crate::properties::PROPERTIES;
use crate::scenario::{Action, Case, Order, Scenario, Verdict};
use crate::trace::Trace;
use hil_world::board::SimBoard;
use hil_world::node::{Node, Sample};
use hil_world::plant::{Model, ParamError};
use hil_world::rig::{Rig, RigParams};
use servo_core::way::Way;

/// Options of a run.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Seed of the sensor noise and, where a scenario has scatter, of the plant's parameters.
    pub seed: u64,
    /// Model of the inverter.
    pub model: Model,
    /// Whether to keep a trace.
    pub trace: bool,
}

/// The result of a scenario.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The scenario's name.
    pub scenario: String,
    /// The options of the run.
    pub options: Options,
    /// Metrics; the worst of each over several motors.
    pub metrics: Metrics,
    /// The verdicts for every motor.
    pub expectations: Vec<Verdict>,
    /// The result of each motor.
    pub runs: Vec<MotorRun>,
}

/// The result of one motor.
#[derive(Clone, Debug)]
pub struct MotorRun {
    /// The kind of motor.
    pub motor: MotorKind,
    /// Its metrics.
    pub metrics: Metrics,
    /// Those of the windows of expectations.
    pub windows: Vec<(Window, Metrics)>,
    /// Its trace, if requested.
    pub trace: Option<Trace>,
    /// The servo's reports and refusals, with their time in ms.
    pub log: Vec<(u32, String)>,
    /// The board's event log at the end of the run; empty for runs over CAN.
    pub events: Vec<events::Event>,
}

impl MotorRun {
    /// The metrics of a window of an expectation; of the whole run if there is none such.
    #[must_use]
    pub fn within(&self, window: Window) -> &Metrics {
        self.windows.iter().find(|(of, _)| *of == window).map_or(&self.metrics, |(_, metrics)| metrics)
    }
}

impl Outcome {
    /// Whether all expectations were met.
    #[must_use]
    pub fn passed(&self) -> bool {
        self.expectations.iter().all(|verdict| verdict.ok)
    }
}

/// Runs a scenario. The same scenario, options and commit give the same outcome bit for bit.
///
/// # Errors
/// A plant parameter out of range; [`Scenario::parse`] rejects those.
pub fn run(scenario: &Scenario, options: &Options) -> Result<Outcome, ParamError> {
    let mut runs = Vec::new();
    let mut expectations = Vec::new();
    for case in &scenario.cases {
        let run = run_case(scenario, case, options)?;
        let mut verdicts: Vec<Verdict> =
            scenario.expectations.iter().map(|e| e.judge(run.within(e.window))).collect();
        verdicts.extend(unexpected_refusals(scenario, &run.metrics));
        if scenario.cases.len() > 1 {
            for verdict in &mut verdicts {
                verdict.name = format!("{}: {}", case.motor.name(), verdict.name);
            }
        }
        expectations.extend(verdicts);
        runs.push(run);
    }
    let metrics = runs.iter().map(|run| run.metrics.clone()).reduce(Metrics::worst).unwrap_or_default();
    Ok(Outcome { scenario: scenario.name.clone(), options: *options, metrics, expectations, runs })
}

pub(crate) fn unexpected_refusals(scenario: &Scenario, metrics: &Metrics) -> Option<Verdict> {
    let expected = scenario.expectations.iter().any(|e| e.metric.name == "refusals");
    (!expected && metrics.refusals > 0).then(|| Verdict {
        name: "refusals".to_owned(),
        ok: false,
        value: Value::from(metrics.refusals),
        want: "0".to_owned(),
    })
}

/// The board of one motor at the start of a scenario: awake, position and properties set over the bus.
///
/// # Errors
/// A plant parameter out of range; [`Scenario::parse`] rejects those.
pub fn board(scenario: &Scenario, case: &Case, options: &Options) -> Result<Node, ParamError> {
    let rig = rig(scenario, case, options)?;
    let straps = tater_wire::Node::new(case.motor.first_node()).unwrap_or(tater_wire::Node::HOST);
    let count = rig.truth().counts.round() as i32;
    let mut node = Node::awake(SimBoard::new(rig, straps));
    // A scenario begins in the middle of use, unless it is about the wiring.
    if scenario.rig.is_wired_as_standard() {
        node.trust_direction();
    }
    if let Some(Range { low, high }) = case.range {
        set(&mut node, Property::JLO, low.into()).map_err(|e| refused("min_count", low.into(), e))?;
        set(&mut node, Property::JHI, high.into()).map_err(|e| refused("max_count", high.into(), e))?;
    }
    set(&mut node, Property::P, i64::from(count)).map_err(|e| refused("position_counts", count.into(), e))?;
    for property in &PROPERTIES {
        let value = property.get(&case.config);
        // What has another unit with MR, MPK or POLES is set after them.
        let present = node.application().map(|board| property.get(board.config()));
        if present != Some(value) {
            set(&mut node, property.property, value).map_err(|e| refused(property.name, value, e))?;
        }
    }
    Ok(node)
}

/// The motor of a case with its sensors, at the start of a scenario.
///
/// # Errors
/// A plant parameter out of range; [`Scenario::parse`] rejects those.
pub fn rig(scenario: &Scenario, case: &Case, options: &Options) -> Result<Rig, ParamError> {
    let plant = match scenario.scatter {
        0.0 => case.plant.clone(),
        scatter => case.plant.scattered(options.seed, scatter),
    };
    let rig_params = scattered_halls(scenario, options.seed);
    let start = scenario.initial.start(&plant);
    Rig::new(plant, rig_params, &scenario.objects, options.model, start, options.seed)
}

fn refused(field: &'static str, found: i64, why: SetError) -> ParamError {
    ParamError { field, found: found as f64, expected: format!("a value that the board takes ({why:?})") }
}

/// SETs a property of a board over the bus.
///
/// # Errors
/// Why the board refused it.
pub fn set(node: &mut Node, property: Property, value: i64) -> Result<(), SetError> {
    let to = Destination::Node(node.straps());
    let message = Message::set(to, property, value).ok_or(SetError::Range(property))?;
    node.receive(&message.frame())
}

fn scattered_halls(scenario: &Scenario, seed: u64) -> RigParams {
    let mut rig = scenario.rig.clone();
    let most = scenario.hall_scatter_deg;
    if most > 0.0 {
        let mut rng = Pcg64Mcg::new(u128::from(seed) << 64 | 0xa11);
        for error in &mut rig.hall_error_deg {
            *error = (*error + rng.random_range(-most..=most)).clamp(-25.0, 25.0);
        }
    }
    rig
}

/// Interval at which the host polls MODE, ms: modes 2 and 4 end without a host.
pub(crate) const POLL_MS: u32 = 100;

fn run_case(scenario: &Scenario, case: &Case, options: &Options) -> Result<MotorRun, ParamError> {
    let mut node = board(scenario, case, options)?;
    let mut log = Vec::new();
    let mut trace = options.trace.then(|| Trace::new(case.motor, scenario.duration_ms));
    let mut timeline = scenario.timeline.iter().peekable();
    let mut last = observe(&node);
    let mut meters = Meters::new(&last, &scenario.windows());
    if let Some(trace) = &mut trace {
        trace.record(&last);
    }
    for ms in 0..scenario.duration_ms {
        while let Some(timed) = timeline.next_if(|timed| timed.ms <= ms) {
            apply(&timed.action, &mut node, &mut meters, &last, &mut log);
            last = observe(&node);
        }
        if ms.is_multiple_of(POLL_MS) {
            let poll = Message::get(Destination::Node(node.straps()), Property::MODE);
            // The request alone keeps the host watchdog fed.
            let _ = node.receive(&poll.frame());
        }
        while let Some(answer) = node.mailboxes().first().copied() {
            node.sent(&answer);
        }
        node.step();
        last = observe(&node);
        let ms = last.ms;
        let events = std::iter::from_fn(|| node.event()).inspect(|event| log.push((ms, motor_text(event))));
        meters.tick(&last, events);
        last.zero_counts = meters.zero_counts();
        if let Some(trace) = &mut trace {
            trace.record(&last);
        }
    }
    let (metrics, windows) = meters.finish(&last);
    Ok(MotorRun { motor: case.motor, metrics, windows, trace, log, events: of_board(&node) })
}

fn observe(node: &Node) -> Sample {
    node.sample().expect("no scenario sends a board back into its monitor")
}

fn apply(action: &Action, node: &mut Node, meters: &mut Meters, last: &Sample, log: &mut Vec<(u32, String)>) {
    let order = match action {
        Action::Order(order) => order,
        Action::Set(rows) => {
            for (property, value) in rows {
                // In range: checked when the scenario was parsed.
                let _ = set(node, property.property, *value);
            }
            return;
        }
        Action::Disturbance(n_m) => return node.rig_mut().set_disturbance(*n_m),
        Action::Bus(v) => return node.rig_mut().set_bus(*v),
    };
    let answer = send_order(order, node);
    // Events of the motion that the order ended come before those of its own.
    while let Some(event) = node.event() {
        log.push((last.ms, motor_text(&event)));
        meters.event(&event, last);
    }
    meters.command(&order.counts_as(), answer.is_ok(), last, observe(node).estimated_counts());
    if let Err(refusal) = answer {
        log.push((last.ms, format!("refused {action}: {refusal:?}")));
    }
}

fn send_order(order: &Order, node: &mut Node) -> Result<(), SetError> {
    let cmd = |cmd: Cmd| (Property::CMD, i64::from(cmd.number()));
    let command = match *order {
        Order::Command(command) => command,
        Order::Abort if observe(node).status.mode == Mode::Idle => return Ok(()),
        Order::Abort => Command::Mode(if holds(node) { Mode::Pid } else { Mode::Idle }),
    };
    let (property, value) = match command {
        Command::Mode(mode) => (Property::MODE, mode_code(mode).into()),
        Command::Torque(torque) => (Property::T, i64::from(torque.0)),
        Command::Velocity(velocity) => (Property::V, i64::from(velocity.round())),
        Command::Position(counts) => (Property::P, i64::from(counts)),
        Command::End(counts) => (Property::E, i64::from(counts)),
        Command::Move(counts) => (Property::M, i64::from(counts)),
        Command::TorqueControlled { way: Way::Closing } => cmd(Cmd::Tc),
        Command::TorqueControlled { way: Way::Opening } => cmd(Cmd::To),
        Command::Home => cmd(Cmd::Hi),
        Command::Find => (Property::FIND, 1),
        Command::Terminate => cmd(Cmd::T),
        Command::ClearFault => (Property::STAT, 2),
        // Not available in scenarios.
        Command::Configure(_) | Command::ClearBreakaway | Command::MoveToEnd => {
            return Err(SetError::Unknown);
        }
    };
    set(node, property, value)
}

fn holds(node: &Node) -> bool {
    node.application().is_some_and(|tater| tater.config().hold)
}
