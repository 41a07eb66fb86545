//! Runs a scenario: every motor of it, from time zero to its end, judged by its expectations.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use servo_core::mode::Mode;
use servo_core::{Command, Event};
use tater_fw::codes::mode_code;
use tater_fw::SetError;
use tater_wire::{Cmd, Destination, Message, ModeCode, MotorKind, Property};

use crate::experiment::metrics::{Meter, Metrics, Value, end_word, fault_word, mode_word};
use crate::experiment::properties::PROPERTIES;
use crate::experiment::scenario::{Action, Case, Scenario, Verdict, motor_name};
use crate::experiment::trace::Trace;
use crate::world::board::SimBoard;
use crate::world::node::{Node, Sample};
use crate::world::plant::{Model, ParamError};
use crate::world::rig::{Rig, RigParams};

/// How to run a scenario.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Seed of the sensors' noise and of the plant's scatter, where a scenario scatters it.
    pub seed: u64,
    /// How the inverter is computed.
    pub model: Model,
    /// Whether to keep a trace.
    pub trace: bool,
}

/// What came of a scenario.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// The scenario's name.
    pub scenario: String,
    /// As asked for.
    pub options: Options,
    /// Figures; of several motors the worst of each.
    pub metrics: Metrics,
    /// The expectations of every motor.
    pub expectations: Vec<Verdict>,
    /// Each motor's own.
    pub runs: Vec<MotorRun>,
}

/// What came of one motor's run.
#[derive(Clone, Debug)]
pub struct MotorRun {
    /// Which.
    pub motor: MotorKind,
    /// Its figures.
    pub metrics: Metrics,
    /// Its trace, if asked for.
    pub trace: Option<Trace>,
    /// What the servo reported and refused, with the time in ms.
    pub log: Vec<(u32, String)>,
}

impl Outcome {
    /// Whether every expectation was met.
    #[must_use]
    pub fn passed(&self) -> bool {
        self.expectations.iter().all(|verdict| verdict.ok)
    }
}

/// Runs a scenario. Same scenario, options and commit: same outcome, to the last bit.
///
/// # Errors
/// A plant parameter out of range; [`Scenario::parse`] lets none through.
pub fn run(scenario: &Scenario, options: &Options) -> Result<Outcome, ParamError> {
    let mut runs = Vec::new();
    let mut expectations = Vec::new();
    for case in &scenario.cases {
        let run = run_case(scenario, case, options)?;
        let mut verdicts: Vec<Verdict> =
            scenario.expectations.iter().map(|e| e.judge(&run.metrics)).collect();
        verdicts.extend(unexpected_refusals(scenario, &run.metrics));
        if scenario.cases.len() > 1 {
            for verdict in &mut verdicts {
                verdict.name = format!("{}: {}", motor_name(case.motor), verdict.name);
            }
        }
        expectations.extend(verdicts);
        runs.push(run);
    }
    let metrics = runs.iter().map(|run| run.metrics.clone()).reduce(Metrics::worst).unwrap_or_default();
    Ok(Outcome { scenario: scenario.name.clone(), options: *options, metrics, expectations, runs })
}

/// A refused command means that the scenario did not do what it says, unless it expects refusals.
pub(crate) fn unexpected_refusals(scenario: &Scenario, metrics: &Metrics) -> Option<Verdict> {
    let expected = scenario.expectations.iter().any(|e| e.metric.name == "refusals");
    (!expected && metrics.refusals > 0).then(|| Verdict {
        name: "refusals".to_owned(),
        ok: false,
        value: Value::from(metrics.refusals),
        want: "0".to_owned(),
    })
}

/// The node of a motor of that kind, and its number: a finger's link, the spread, a finger's tip.
#[must_use]
pub const fn node_of(motor: MotorKind) -> u8 {
    match motor {
        MotorKind::Link => 1,
        MotorKind::Spread => 4,
        MotorKind::Tip => 5,
    }
}

/// The board of one motor at the start of a scenario: awake, its position and properties set over the bus.
///
/// # Errors
/// A plant parameter out of range; [`Scenario::parse`] lets none through.
pub fn board(scenario: &Scenario, case: &Case, options: &Options) -> Result<Node, ParamError> {
    let rig = rig(scenario, case, options)?;
    let straps = tater_wire::Node::new(node_of(case.motor)).unwrap_or(tater_wire::Node::HOST);
    let count = rig.truth().counts.round() as i32;
    let mut node = Node::awake(SimBoard::new(rig, straps));
    set(&mut node, Property::P, i64::from(count)).map_err(|e| refused("position_counts", count.into(), e))?;
    let defaults = crate::defaults(case.motor);
    for property in &PROPERTIES {
        let value = property.get(&case.config);
        if value != property.get(&defaults) {
            set(&mut node, property.property, value).map_err(|e| refused(property.name, value, e))?;
        }
    }
    Ok(node)
}

/// The motor of a case with its sensors, at the start of a scenario.
///
/// # Errors
/// A plant parameter out of range; [`Scenario::parse`] lets none through.
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

/// SETs a property of a board, as a host does.
///
/// # Errors
/// Why the board did not take it.
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

/// How often the scenario's host asks for MODE, ms: hosts poll, and modes 2 and 4 end without one.
pub(crate) const POLL_MS: u32 = 100;

fn run_case(scenario: &Scenario, case: &Case, options: &Options) -> Result<MotorRun, ParamError> {
    let mut node = board(scenario, case, options)?;
    let mut log = Vec::new();
    let mut trace = options.trace.then(|| Trace::new(case.motor, scenario.duration_ms));
    let mut timeline = scenario.timeline.iter().peekable();
    let mut last = watch(&node);
    let mut meter = Meter::new(&last);
    if let Some(trace) = &mut trace {
        trace.record(&last);
    }
    for ms in 0..scenario.duration_ms {
        while let Some(timed) = timeline.next_if(|timed| timed.ms <= ms) {
            act(&timed.action, &mut node, &mut meter, &last, &mut log);
            last = watch(&node);
        }
        if ms.is_multiple_of(POLL_MS) {
            let poll = Message::get(Destination::Node(node.straps()), Property::MODE);
            // Answered or not, the board has heard its host.
            let _ = node.receive(&poll.frame());
        }
        while let Some(answer) = node.mailboxes().first().copied() {
            node.sent(&answer);
        }
        node.step();
        last = watch(&node);
        let ms = last.ms;
        let events = std::iter::from_fn(|| node.event()).inspect(|event| log.push((ms, event_words(event))));
        meter.tick(&last, events);
        last.zero_counts = meter.zero_counts();
        if let Some(trace) = &mut trace {
            trace.record(&last);
        }
    }
    Ok(MotorRun { motor: case.motor, metrics: meter.finish(&last), trace, log })
}

fn watch(node: &Node) -> Sample {
    node.sample().expect("no scenario sends a board back into its monitor")
}

/// Lets a timed action happen.
fn act(action: &Action, node: &mut Node, meter: &mut Meter, last: &Sample, log: &mut Vec<(u32, String)>) {
    let command = match action {
        Action::Command(command) => command,
        Action::Set(rows) => {
            for (property, value) in rows {
                // In range: the scenario's reader has checked it.
                let _ = set(node, property.property, *value);
            }
            return;
        }
        Action::Disturbance(n_m) => return node.rig_mut().set_disturbance(*n_m),
        Action::Bus(v) => return node.rig_mut().set_bus(*v),
    };
    let answer = say(command, node);
    // First what the command ended, then what it began.
    while let Some(event) = node.event() {
        log.push((last.ms, event_words(&event)));
        meter.event(&event, last);
    }
    meter.command(command, answer.is_ok(), last, watch(node).estimated_counts());
    if let Err(refusal) = answer {
        log.push((last.ms, format!("refused {action}: {refusal:?}")));
    }
}

/// Says a command as a host does, in properties.
fn say(command: &Command, node: &mut Node) -> Result<(), SetError> {
    let cmd = |cmd: Cmd| (Property::CMD, i64::from(cmd.number()));
    let status = watch(node).status;
    let (property, value) = match *command {
        Command::Mode(mode) => (Property::MODE, mode_code(mode).into()),
        Command::Torque(torque) => (Property::T, i64::from(torque.0)),
        Command::Velocity(velocity) => (Property::V, i64::from(velocity.round())),
        Command::Position(counts) => (Property::P, i64::from(counts)),
        Command::End(counts) => (Property::E, i64::from(counts)),
        Command::Move(counts) => (Property::M, i64::from(counts)),
        Command::TorqueControlled { closing: true } => cmd(Cmd::Tc),
        Command::TorqueControlled { closing: false } => cmd(Cmd::To),
        Command::Home => cmd(Cmd::Hi),
        Command::Terminate => cmd(Cmd::T),
        Command::ClearFault => (Property::STAT, 2),
        // A host that ends a move leaves the motor as HOLD has it (manual 5.5 case 3).
        Command::Abort if status.mode == Mode::Idle => return Ok(()),
        Command::Abort if holds(node) => (Property::MODE, ModeCode::Pid.into()),
        Command::Abort => (Property::MODE, ModeCode::Idle.into()),
        // The scenario's reader makes neither.
        Command::Configure(_) | Command::ClearBreakaway => return Err(SetError::Unknown),
    };
    set(node, property, value)
}

fn holds(node: &Node) -> bool {
    node.application().is_some_and(|tater| tater.config().hold)
}

/// A report of the servo in words.
pub(crate) fn event_words(event: &Event) -> String {
    match event {
        Event::Ended { reason, mode } => format!("{}, then {}", end_word(*reason), mode_word(*mode)),
        Event::Breakaway { position, stop_tip: false } => format!("breakaway at {position}"),
        Event::Breakaway { position, stop_tip: true } => format!("breakaway at {position}, tip stops too"),
        Event::Fault(fault) => format!("fault: {}", fault_word(*fault)),
        Event::Glitch(glitch) => format!("glitch: {glitch:?}"),
        Event::Homed => "homed".to_owned(),
    }
}
