//! Scenarios over CAN alone: what a host can do and see, on any board that is a station of the bus. The same driver runs the
//! native board and an emulated one, so that one can be compared with the other ([`compare`]).
//!
//! Commands are SET frames. What the servo thinks is polled, and it reports ends and breakaways by itself (LFLAGS); what is
//! really so comes from the rig, as ever. What neither can tell is not judged: [`gap`] says what and why.

pub mod compare;
mod download;
mod seat;
mod talk;
mod timeline;

use tater_wire::MotorKind;
use tater_wire::{Destination, Message, Node as Id, Property};

use crate::experiment::metrics::{Metric, Metrics};
use crate::experiment::run::{MotorRun, Options, Outcome, rig, unexpected_refusals};
use crate::experiment::scenario::{Case, Scenario, Verdict, motor_name};
use crate::world::bus::{Adapter, Bus, Station};
use crate::world::node::Node;
use crate::world::plant::ParamError;
use crate::world::rig::Rig;
use compare::Path;

/// How often the host asks a board for T, MODE and P unless told otherwise, ms, by the number of boards on the bus: a round takes
/// 0.6 ms of bus a board. No round begins before the last one is answered.
pub const POLL_MS: u32 = 1;

/// A board on the bus, as its bench sees it.
pub trait Watched: Station {
    /// The motor and its sensors.
    fn rig(&self) -> &Rig;

    /// The motor and its sensors, to disturb or to exchange them.
    fn rig_mut(&mut self) -> &mut Rig;

    /// Since when the bridge is on, us since power-up of the bus; `None` while it is off.
    fn driven_since_us(&self) -> Option<u64>;

    /// Whether the brake is told to release.
    fn is_brake_released(&self) -> bool;

    /// The supply of the board's logic comes on.
    fn power_on(&mut self);

    /// Why the board stands still for good, if it does: where, and what to do.
    fn problem(&self) -> Option<String> {
        None
    }
}

impl Watched for Node {
    fn rig(&self) -> &Rig {
        self.board().rig()
    }

    fn rig_mut(&mut self) -> &mut Rig {
        Self::rig_mut(self)
    }

    fn driven_since_us(&self) -> Option<u64> {
        self.board().driven_since_us()
    }

    fn is_brake_released(&self) -> bool {
        self.board().is_brake_released()
    }

    fn power_on(&mut self) {
        Self::power_on(self);
    }
}

/// Why a metric is not judged over CAN; `None` if it is. Without polls (`poll_ms` 0) less is known.
#[must_use]
pub fn gap(metric: &Metric, poll_ms: u32) -> Option<&'static str> {
    match metric.name {
        "tracking_rms_counts" => Some("the set-point of a move is no property"),
        "glitches" => Some("no property counts glitches, and only a log of level debug tells them"),
        "peak_torque" | "hold_error_counts" | "peak_hold_error_counts" if poll_ms == 0 => {
            Some("T and P are not polled")
        }
        _ => None,
    }
}

/// The motor of a case while its board boots: at rest where the scenario begins, its sensors without the scenario's faults.
///
/// # Errors
/// A plant parameter out of range; [`Scenario::parse`] lets none through.
pub fn parked(scenario: &Scenario, case: &Case, options: &Options) -> Result<Rig, ParamError> {
    let mut scenario = scenario.clone();
    scenario.initial.velocity_counts_s = 0.0;
    scenario.rig.glitches.clear();
    scenario.rig.stuck = None;
    rig(&scenario, case, options)
}

/// One board's part in a run.
#[derive(Clone, Debug)]
pub struct Job {
    /// Its node on the bus.
    pub node: Id,
    /// The motor that it has, and the properties that it gets.
    pub case: Case,
    /// The motor at the start of the scenario.
    pub rig: Rig,
    /// Whether the scenario's expectations are for it.
    pub judged: bool,
}

/// What came of one board's run.
#[derive(Clone, Debug)]
pub struct Ran {
    /// Its node on the bus.
    pub node: Id,
    /// As of a run without a bus; has no trace.
    pub run: MotorRun,
    /// Where the rotor was, and when the last move was driven and ended.
    pub path: Path,
    /// GETs that nobody answered.
    pub unanswered: u32,
    /// Whether the scenario's expectations are for it.
    pub judged: bool,
}

/// How far a long operation is.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// What it does.
    pub what: &'static str,
    /// How much is done.
    pub done: u64,
    /// Of how much.
    pub of: u64,
}

/// Who looks on: called every 10 ms of simulated time or more often, to read a board's logs or tell of progress.
pub type Watcher<S> = Box<dyn FnMut(&mut Bus<S>, Progress)>;

/// A host, and boards on its bus.
pub struct OverCan<S> {
    bus: Bus<S>,
    nodes: Vec<Id>,
    watcher: Option<Watcher<S>>,
    /// How long after a whole millisecond a scenario begins, us: the native board ticks at these.
    pub phase_us: u64,
}

impl<S: Watched> OverCan<S> {
    /// The host plugged into a bus with these boards, each of that node.
    #[must_use]
    pub fn new(stations: Vec<(Id, S)>) -> Self {
        let (nodes, stations) = stations.into_iter().unzip();
        let mut bus = Bus::new(stations);
        // The bus is new and has none.
        let _ = bus.plug_host("scenario", Adapter::default());
        Self { bus, nodes, watcher: None, phase_us: 0 }
    }

    /// The bus.
    #[must_use]
    pub const fn bus(&self) -> &Bus<S> {
        &self.bus
    }

    /// The bus, to get at its boards.
    pub const fn bus_mut(&mut self) -> &mut Bus<S> {
        &mut self.bus
    }

    /// Lets somebody look on.
    pub fn watch(&mut self, watcher: Watcher<S>) {
        self.watcher = Some(watcher);
    }

    fn tell(&mut self, what: &'static str, done: u64, of: u64) {
        if let Some(watcher) = &mut self.watcher {
            watcher(&mut self.bus, Progress { what, done, of });
        }
    }

    /// All boards' power comes on; waits for their monitors.
    ///
    /// # Errors
    /// A board that does not answer.
    pub fn power_on(&mut self) -> Result<(), String> {
        self.power_on_first(self.nodes.len())
    }

    /// The same of the first `count` boards.
    ///
    /// # Errors
    /// A board that does not answer.
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

    /// STAT 2 to every board; waits for their applications, and until these have prepared their storage.
    ///
    /// # Errors
    /// A board that does not wake, with its ERROR.
    pub fn wake(&mut self) -> Result<(), String> {
        for node in self.nodes.clone() {
            self.set(node, Property::STAT, 2)?;
        }
        for node in self.nodes.clone() {
            self.until(node, Property::STAT, 2, WAKE_US)?;
        }
        self.rest("first start", PREPARE_US)
    }

    /// An error if a board stands still for good.
    fn check(&self) -> Result<(), String> {
        let problem =
            |(node, station): (&Id, &S)| Some(format!("node {}: {}", node.number(), station.problem()?));
        self.nodes.iter().zip(self.bus.stations()).find_map(problem).map_or(Ok(()), Err)
    }

    fn send_get(&mut self, node: Id, property: Property) {
        // The host is plugged since the beginning.
        let _ = self.bus.send(Message::get(Destination::Node(node), property).frame());
    }
}

/// From power-on to a monitor that answers, us: crystal, clocks and the sum over an image take under 100 ms.
const BOOT_US: u64 = 1_000_000;

/// From STAT 2 to an application that answers, us: it may copy 52 pages first, of 60 ms each.
const WAKE_US: u64 = 10_000_000;

/// What an application takes to prepare an erased storage, us: 8 pages of up to 40 ms, and as much again.
const PREPARE_US: u64 = 700_000;

/// Judges what came of a scenario's motors, as [`crate::run()`] does, but for what is not known: name and reason of these.
#[must_use]
pub fn judge(
    scenario: &Scenario,
    ran: &[Ran],
    options: &Options,
    poll_ms: u32,
) -> (Outcome, Vec<(&'static str, &'static str)>) {
    let judged: Vec<&Ran> = ran.iter().filter(|ran| ran.judged).collect();
    let mut expectations = Vec::new();
    for ran in &judged {
        let known = scenario.expectations.iter().filter(|e| gap(e.metric, poll_ms).is_none());
        let mut verdicts: Vec<Verdict> = known.map(|e| e.judge(&ran.run.metrics)).collect();
        verdicts.extend(unexpected_refusals(scenario, &ran.run.metrics));
        verdicts.extend(unanswered(ran));
        if judged.len() > 1 {
            for verdict in &mut verdicts {
                verdict.name =
                    format!("{} (node {}): {}", motor_name(ran.run.motor), ran.node.number(), verdict.name);
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

/// Polls that are lost are figures that are missed.
fn unanswered(ran: &Ran) -> Option<Verdict> {
    (ran.unanswered > 0).then(|| Verdict {
        name: "unanswered".to_owned(),
        ok: false,
        value: ran.unanswered.into(),
        want: "0".to_owned(),
    })
}

/// The case of a scenario for a kind of motor, if it names that kind.
#[must_use]
pub fn case_of(scenario: &Scenario, motor: MotorKind) -> Option<&Case> {
    scenario.cases.iter().find(|case| case.motor == motor)
}
