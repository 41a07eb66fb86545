//! Runs a scenario: every motor of it, from time zero to its end, judged by its expectations.

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use servo_core::{Command, Event, MotorKind};

use crate::board::{Sample, SimBoard};
use crate::metrics::{Meter, Metrics, Value, end_word, fault_word, mode_word};
use crate::plant::{Model, ParamError};
use crate::rig::{Rig, RigParams};
use crate::scenario::{Action, Case, Scenario, Verdict, motor_name};
use crate::trace::Trace;

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
fn unexpected_refusals(scenario: &Scenario, metrics: &Metrics) -> Option<Verdict> {
    let expected = scenario.expectations.iter().any(|e| e.metric.name == "refusals");
    (!expected && metrics.refusals > 0).then(|| Verdict {
        name: "refusals".to_owned(),
        ok: false,
        value: Value::from(metrics.refusals),
        want: "0".to_owned(),
    })
}

/// The board of one motor at the start of a scenario.
///
/// # Errors
/// A plant parameter out of range; [`Scenario::parse`] lets none through.
pub fn board(scenario: &Scenario, case: &Case, options: &Options) -> Result<SimBoard, ParamError> {
    let plant = match scenario.scatter {
        0.0 => case.plant.clone(),
        scatter => case.plant.scattered(options.seed, scatter),
    };
    let rig_params = scattered_halls(scenario, options.seed);
    let start = scenario.initial.start(&plant);
    let rig = Rig::new(plant, rig_params, &scenario.objects, options.model, start, options.seed)?;
    SimBoard::new(case.config, rig).map_err(|e| ParamError {
        field: e.property,
        found: f64::from(e.found),
        expected: format!("{} to {}", e.min, e.max),
    })
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

fn run_case(scenario: &Scenario, case: &Case, options: &Options) -> Result<MotorRun, ParamError> {
    let mut board = board(scenario, case, options)?;
    let mut log = Vec::new();
    let mut trace = options.trace.then(|| Trace::new(case.motor, scenario.duration_ms));
    let mut timeline = scenario.timeline.iter().peekable();
    let mut last = board.sample();
    let mut meter = Meter::new(&last);
    if let Some(trace) = &mut trace {
        trace.record(&last);
    }
    for ms in 0..scenario.duration_ms {
        while let Some(timed) = timeline.next_if(|timed| timed.ms <= ms) {
            act(&timed.action, &mut board, &mut meter, &last, &mut log);
            last = board.sample();
        }
        board.step();
        last = board.sample();
        let ms = last.ms;
        let events = std::iter::from_fn(|| board.event()).inspect(|event| log.push((ms, event_words(event))));
        meter.tick(&last, events);
        last.zero_counts = meter.zero_counts();
        if let Some(trace) = &mut trace {
            trace.record(&last);
        }
    }
    Ok(MotorRun { motor: case.motor, metrics: meter.finish(&last), trace, log })
}

/// Lets a timed action happen.
fn act(
    action: &Action,
    board: &mut SimBoard,
    meter: &mut Meter,
    last: &Sample,
    log: &mut Vec<(u32, String)>,
) {
    let command = match action {
        Action::Command(command) => *command,
        Action::Set(rows) => {
            let mut config = *board.config();
            for (property, value) in rows {
                // In range: the scenario's reader has checked it.
                let _ = property.set(&mut config, *value);
            }
            Command::Configure(config)
        }
        Action::Disturbance(n_m) => return board.rig_mut().set_disturbance(*n_m),
        Action::Bus(v) => return board.rig_mut().set_bus(*v),
    };
    let answer = board.command(command);
    // First what the command ended, then what it began.
    while let Some(event) = board.event() {
        log.push((last.ms, event_words(&event)));
        meter.event(&event, last);
    }
    meter.command(&command, answer.is_ok(), last, board.sample().estimated_counts());
    if let Err(refusal) = answer {
        log.push((last.ms, format!("refused {action}: {refusal:?}")));
    }
}

/// A report of the servo in words.
fn event_words(event: &Event) -> String {
    match event {
        Event::Ended { reason, mode } => format!("{}, then {}", end_word(*reason), mode_word(*mode)),
        Event::Breakaway { position, stop_tip: false } => format!("breakaway at {position}"),
        Event::Breakaway { position, stop_tip: true } => format!("breakaway at {position}, tip stops too"),
        Event::Fault(fault) => format!("fault: {}", fault_word(*fault)),
        Event::Glitch(glitch) => format!("glitch: {glitch:?}"),
        Event::Homed => "homed".to_owned(),
    }
}
