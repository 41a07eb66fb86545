//! Scenarios over CAN alone: limited to what a host can do and see, for any board that is a bus station. The same driver runs the
//! native board and an emulated one, so that they can be compared ([`compare`]).
//!
//! Commands are SET frames. The servo's state is polled, ends and breakaways are reported (LFLAGS), and the true state comes from
//! the rig. Metrics that need more are not judged; [`gap`] lists them with the reason.

mod board_view;
pub mod compare;
mod download;
mod requests;
mod timeline;

use tater_fw::tater::heat::COLD;
use tater_wire::MotorKind;
use tater_wire::{Destination, Message, Node as Id, Property};

use crate::metrics::{Metric, Metrics, Window};
use crate::run::{MotorRun, Options, Outcome, rig, unexpected_refusals};
use crate::scenario::{Case, Scenario, Verdict};
use compare::Path;
use hil_world::bus::{Adapter, Bus};
use hil_world::hand::Motorized;
use hil_world::node::Node;
use hil_world::plant::{ParamError, PlantParams};
use hil_world::rig::Rig;

/// Default interval at which the host polls T, MODE and P, ms per board on the bus: a round takes 0.6 ms of bus time per board. No
/// round starts before the last one is answered.
pub const POLL_MS: u32 = 1;

/// A board on the bus with its rig.
pub trait ObservedBoard: Motorized {
    /// Time at which the bridge was switched on, us since power-up of the bus; `None` while it is off.
    fn driven_since_us(&self) -> Option<u64>;

    /// Whether the brake is commanded to release.
    fn is_brake_released(&self) -> bool;

    /// Powers the board's logic up.
    fn power_on(&mut self);

    /// Writes the word of RAM that keeps the winding's heat over a reset.
    fn keep_heat(&mut self, word: u32);

    /// Why the board has stopped for good, if it has: where, and the next step.
    fn problem(&self) -> Option<String> {
        None
    }
}

impl ObservedBoard for Node {
    fn driven_since_us(&self) -> Option<u64> {
        self.board().driven_since_us()
    }

    fn is_brake_released(&self) -> bool {
        self.board().is_brake_released()
    }

    fn power_on(&mut self) {
        Self::power_on(self);
    }

    fn keep_heat(&mut self, word: u32) {
        Self::keep_heat(self, word);
    }
}

/// Why a metric is not judged over CAN; `None` if it is. Without polls (`poll_ms` 0) fewer are.
#[must_use]
pub fn gap(metric: &Metric, poll_ms: u32) -> Option<&'static str> {
    match metric.name {
        "tracking_rms_counts" | "ripple_counts_s" | "mean_velocity_counts_s" => {
            Some("the set-point of a move is no property")
        }
        "chatter" => Some("T is not read each tick"),
        "glitches" => Some("no property counts glitches, and only a log of level debug tells them"),
        "peak_torque" | "hold_error_counts" | "peak_hold_error_counts" if poll_ms == 0 => {
            Some("T and P are not polled")
        }
        _ => None,
    }
}

/// The motor of a case while its board boots: at rest at the scenario's start, without its sensor faults, and with no more friction than
/// its kind has: one that the scenario jams has turned before.
///
/// # Errors
/// A plant parameter out of range; [`Scenario::parse`] rejects those.
pub fn parked(scenario: &Scenario, case: &Case, options: &Options) -> Result<Rig, ParamError> {
    let mut scenario = scenario.clone();
    scenario.initial.velocity_counts_s = 0.0;
    scenario.rig.glitches.clear();
    scenario.rig.stuck = None;
    let usual = PlantParams::for_motor(case.motor);
    let mut case = case.clone();
    case.plant.coulomb_n_m = case.plant.coulomb_n_m.min(usual.coulomb_n_m);
    case.plant.static_n_m = case.plant.static_n_m.min(usual.static_n_m);
    rig(&scenario, &case, options)
}

/// One board's part in a run.
#[derive(Clone, Debug)]
pub struct Job {
    /// Its node on the bus.
    pub node: Id,
    /// Its motor and properties.
    pub case: Case,
    /// The motor at the start of the scenario.
    pub rig: Rig,
    /// Whether the scenario's expectations apply to it.
    pub judged: bool,
    /// The windows of those.
    pub windows: Vec<Window>,
}

/// The result of one board.
#[derive(Clone, Debug)]
pub struct BoardResult {
    /// Its node on the bus.
    pub node: Id,
    /// As for a run without a bus, without a trace.
    pub run: MotorRun,
    /// The rotor's path, and when the last move was driven and ended.
    pub path: Path,
    /// GETs without an answer.
    pub unanswered: u32,
    /// Whether the scenario's expectations apply to it.
    pub judged: bool,
}

/// Progress of a long operation.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// The operation.
    pub what: &'static str,
    /// The amount done.
    pub done: u64,
    /// The total.
    pub of: u64,
}

/// A callback at least every 10 ms of simulated time, to read a board's logs or show progress.
pub type Observer<S> = Box<dyn FnMut(&mut Bus<S>, Progress)>;

/// A host and the boards on its bus.
pub struct OverCan<S> {
    bus: Bus<S>,
    nodes: Vec<Id>,
    observer: Option<Observer<S>>,
    /// Offset of the scenario's start from a whole millisecond, us: the native board ticks at these.
    pub phase_us: u64,
}

impl<S: ObservedBoard> OverCan<S> {
    /// Connects the host to a bus with these boards and their nodes.
    #[must_use]
    pub fn new(stations: Vec<(Id, S)>) -> Self {
        let (nodes, stations) = stations.into_iter().unzip();
        let mut bus = Bus::new(stations);
        // A new bus has no host.
        let _ = bus.plug_host("scenario", Adapter::default());
        Self { bus, nodes, observer: None, phase_us: 0 }
    }

    /// The bus.
    #[must_use]
    pub const fn bus(&self) -> &Bus<S> {
        &self.bus
    }

    /// The bus, mutable.
    pub const fn bus_mut(&mut self) -> &mut Bus<S> {
        &mut self.bus
    }

    /// Sets the callback.
    pub fn observe(&mut self, observer: Observer<S>) {
        self.observer = Some(observer);
    }

    fn report_progress(&mut self, what: &'static str, done: u64, of: u64) {
        if let Some(observer) = &mut self.observer {
            observer(&mut self.bus, Progress { what, done, of });
        }
    }

    /// Powers all boards up; waits for their monitors.
    ///
    /// # Errors
    /// A board does not answer.
    pub fn power_on(&mut self) -> Result<(), String> {
        self.power_on_first(self.nodes.len())
    }

    /// Powers the first `count` boards up; waits for their monitors.
    ///
    /// # Errors
    /// A board does not answer.
    pub fn power_on_first(&mut self, count: usize) -> Result<(), String> {
        for index in 0..count {
            if let Some(station) = self.bus.station_mut(index) {
                station.power_on();
            }
        }
        for node in self.nodes.iter().take(count).copied().collect::<Vec<_>>() {
            self.until(node, Property::STAT, 0, BOOT_US)?;
        }
        Ok(())
    }

    /// Sends STAT 2 to every board; waits until their applications run and have prepared their storage. Their motors have rested for
    /// long: after a loss of power alone a board assumes that its winding has 100 °C (decision 0051).
    ///
    /// # Errors
    /// A board does not start, with its ERROR.
    pub fn wake(&mut self) -> Result<(), String> {
        for index in 0..self.nodes.len() {
            if let Some(station) = self.bus.station_mut(index) {
                station.keep_heat(COLD);
            }
        }
        for node in self.nodes.clone() {
            self.set(node, Property::STAT, 2)?;
        }
        for node in self.nodes.clone() {
            self.until(node, Property::STAT, 2, WAKE_US)?;
        }
        self.rest("first start", PREPARE_US)
    }

    /// Turns every motor by some counts and back, so that its board sees that the wiring is right: until then torque is limited
    /// (decision 0047), and a scenario begins in the middle of use. The motors are then as before.
    ///
    /// # Errors
    /// A motor does not turn, or a board has stopped for good.
    pub fn turn_once(&mut self) -> Result<(), String> {
        let rigs: Vec<Rig> = self.bus.stations().map(|station| station.rig().clone()).collect();
        let mut starts = Vec::new();
        for (node, rig) in self.nodes.clone().into_iter().zip(&rigs) {
            // The motor's place in its joint: beyond that a board takes no goal (decision 0068).
            let start = rig.truth().counts.round() as i64;
            let way = if start < TURN { TURN } else { -TURN };
            self.put(node, Property::P, start)?;
            starts.push((node, start, start + way));
            self.put(node, Property::MODE, 3)?;
        }
        self.rest("turning the motors", BRAKE_US)?;
        for &(node, _, there) in &starts {
            self.set(node, Property::P, there)?;
        }
        self.rest("turning the motors", TURN_US)?;
        for &(node, start, there) in &starts {
            self.expect_turned(node, there)?;
            self.set(node, Property::P, start)?;
        }
        self.rest("turning the motors", TURN_US)?;
        for &(node, start, _) in &starts {
            self.expect_turned(node, start)?;
            self.put(node, Property::MODE, 0)?;
        }
        for (index, rig) in rigs.into_iter().enumerate() {
            let now_us = self.bus.now_us();
            if let Some(station) = self.bus.station_mut(index) {
                *station.rig_mut() = rig.starting_at(now_us);
            }
        }
        self.rest("turning the motors", SETTLE_US)
    }

    fn expect_turned(&mut self, node: Id, to: i64) -> Result<(), String> {
        let found = self.get(node, Property::P);
        if found.is_some_and(|found| found.abs_diff(to) <= 1) {
            return Ok(());
        }
        Err(format!(
            "node {}: P is {found:?} in a turn there and back, expected {to}\n  next: see decision 0047",
            node.number()
        ))
    }

    fn check(&self) -> Result<(), String> {
        let problem =
            |(node, station): (&Id, &S)| Some(format!("node {}: {}", node.number(), station.problem()?));
        self.nodes.iter().zip(self.bus.stations()).find_map(problem).map_or(Ok(()), Err)
    }

    fn send_get(&mut self, node: Id, property: Property) {
        // The host is connected since `new`.
        let _ = self.bus.send(Message::get(Destination::Node(node), property).frame());
    }
}

/// Time limit from power-up to an answering monitor, us: crystal, clocks and an image's checksum take under 100 ms.
const BOOT_US: u64 = 1_000_000;

/// Time limit from STAT 2 to an answering application, us: it may copy 52 pages of 60 ms first.
const WAKE_US: u64 = 10_000_000;

/// Time for an application to prepare an erased storage, us: 8 pages of up to 40 ms, doubled.
const PREPARE_US: u64 = 700_000;

/// Counts that a motor turns before a scenario: an electrical revolution proves the direction.
const TURN: i64 = 9;

/// Times for a brake to release, and for the way there or back, us.
const BRAKE_US: u64 = 100_000;
const TURN_US: u64 = 400_000;

/// Time in which a board follows a rotor that is put back by a count, us.
const SETTLE_US: u64 = 300_000;

/// Judges the results like [`run`](crate::run::run); returns the metrics not judged with their reasons.
#[must_use]
pub fn judge(
    scenario: &Scenario,
    ran: &[BoardResult],
    options: &Options,
    poll_ms: u32,
) -> (Outcome, Vec<(&'static str, &'static str)>) {
    let judged: Vec<&BoardResult> = ran.iter().filter(|ran| ran.judged).collect();
    let mut expectations = Vec::new();
    for ran in &judged {
        let known = scenario.expectations.iter().filter(|e| gap(e.metric, poll_ms).is_none());
        let mut verdicts: Vec<Verdict> = known.map(|e| e.judge(ran.run.within(e.window))).collect();
        verdicts.extend(unexpected_refusals(scenario, &ran.run.metrics));
        verdicts.extend(unanswered(ran));
        if judged.len() > 1 {
            for verdict in &mut verdicts {
                verdict.name =
                    format!("{} (node {}): {}", ran.run.motor.name(), ran.node.number(), verdict.name);
            }
        }
        expectations.extend(verdicts);
    }
    let gaps = scenario.expectations.iter();
    let gaps = gaps.filter_map(|e| Some((e.metric.name, gap(e.metric, poll_ms)?))).collect();
    let metrics = judged.iter().map(|ran| ran.run.metrics.clone()).reduce(Metrics::worst).unwrap_or_default();
    let runs = judged.into_iter().map(|ran| ran.run.clone()).collect();
    (Outcome { scenario: scenario.name.clone(), options: *options, metrics, expectations, runs }, gaps)
}

/// A failed verdict for lost polls: they make the metrics unreliable.
fn unanswered(ran: &BoardResult) -> Option<Verdict> {
    (ran.unanswered > 0).then(|| Verdict {
        name: "unanswered".to_owned(),
        ok: false,
        value: ran.unanswered.into(),
        want: "0".to_owned(),
    })
}

/// The case of a scenario for a kind of motor, if it has one.
#[must_use]
pub fn case_of(scenario: &Scenario, motor: MotorKind) -> Option<&Case> {
    scenario.cases.iter().find(|case| case.motor == motor)
}
