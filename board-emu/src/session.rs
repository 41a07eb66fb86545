//! Runs a scenario on emulated boards: assigns nodes, boots them from erased flash, and collects the verdict.

use hil_experiment::over_can::{BoardResult, Job, OverCan, case_of, parked};
use hil_experiment::properties;
use hil_experiment::run::{Options, rig};
use hil_experiment::scenario::{Case, Initial, Scenario};
use hil_world::plant::PlantParams;
use tater_f103::map::APPLICATION;
use tater_wire::MotorKind;
use tater_wire::Node;

use crate::board::Board;
use crate::image::Programs;
use crate::meter::Figures;

const HAND: std::ops::RangeInclusive<u8> = 1..=7;

/// Which boards take part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nodes {
    /// This many: one for each motor of the scenario first, then the lowest numbers. With one, the motors run
    /// one after another, as without a bus.
    Count(u8),
    /// A range of nodes.
    Range(u8, u8),
}

impl std::str::FromStr for Nodes {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!("found {text:?}, expected a number of boards from 1 to 7, or node numbers such as 2-4")
        };
        let number = |text: &str| text.parse().ok().filter(|n| HAND.contains(n)).ok_or_else(wrong);
        match text.split_once('-') {
            None => number(text).map(Self::Count),
            Some((from, to)) => match (number(from)?, number(to)?) {
                (from, to) if from <= to => Ok(Self::Range(from, to)),
                _ => Err(wrong()),
            },
        }
    }
}

/// Outcome of a session.
#[derive(Clone, Debug)]
pub struct Session {
    /// Outcome of each board.
    pub ran: Vec<BoardResult>,
    /// Figures of the worst board.
    pub figures: Figures,
    /// Simulated time of the scenario, s.
    pub scenario_s: f64,
    /// Wall-clock time of the scenario, s, by `clock`.
    pub scenario_wall_s: f64,
}

/// The nodes of each bus that a scenario runs on, one bus after another.
///
/// # Errors
/// Fewer boards than motors in the scenario, or none.
pub fn buses(scenario: &Scenario, nodes: Nodes) -> Result<Vec<Vec<u8>>, String> {
    let named: Vec<u8> = scenario.cases.iter().map(|case| case.motor.first_node()).collect();
    match nodes {
        Nodes::Count(1) => Ok(named.into_iter().map(|node| vec![node]).collect()),
        Nodes::Count(count) if usize::from(count) < named.len() => Err(format!(
            "--nodes {count}: {} is about {} motors\n  next: --nodes 1 runs them one after another, {} or more at once",
            scenario.name,
            named.len(),
            named.len()
        )),
        Nodes::Count(count) => {
            let others = HAND.filter(|node| !named.contains(node));
            let mut all: Vec<u8> = named.iter().copied().chain(others).take(count.into()).collect();
            all.sort_unstable();
            Ok(vec![all])
        }
        Nodes::Range(from, to) => {
            let all: Vec<u8> = (from..=to).collect();
            if all.iter().any(|&node| case_of(scenario, kind(node)).is_some()) {
                return Ok(vec![all]);
            }
            Err(format!(
                "--nodes {from}-{to}: none of these has a motor that {} is about\n  next: include one of nodes {named:?}",
                scenario.name
            ))
        }
    }
}

fn id(node: u8) -> Node {
    // All are 1 to 7.
    Node::new(node).unwrap_or(Node::HOST)
}

fn kind(node: u8) -> MotorKind {
    MotorKind::of(id(node))
}

/// The role of a board, and its motor while it boots. A board whose motor the scenario does not name runs the
/// scenario's commands with its own motor from position 0, and is not judged.
fn part(scenario: &Scenario, node: u8, options: &Options) -> Result<(Job, hil_world::rig::Rig), String> {
    let wrong = |error| format!("{}: node {node}: {error:?}\n  next: correct the scenario", scenario.name);
    let (case, scenario, judged) = match case_of(scenario, kind(node)) {
        Some(case) => (case.clone(), scenario.clone(), true),
        None => {
            (bystander(scenario, node), Scenario { initial: Initial::default(), ..scenario.clone() }, false)
        }
    };
    let at_first = parked(&scenario, &case, options).map_err(wrong)?;
    let rig = rig(&scenario, &case, options).map_err(wrong)?;
    Ok((Job { node: id(node), case, rig, judged, windows: scenario.windows() }, at_first))
}

fn bystander(scenario: &Scenario, node: u8) -> Case {
    let motor = kind(node);
    let mut config = properties::defaults(motor);
    if let Some(case) = scenario.cases.first() {
        let defaults = properties::defaults(case.motor);
        for property in &properties::PROPERTIES {
            let value = property.get(&case.config);
            if value != property.get(&defaults) {
                // The scenario has checked the range.
                let _ = properties::set(&mut config, property.name, value);
            }
        }
    }
    Case { motor, plant: PlantParams::for_motor(motor), config, range: None }
}

/// Writes the application to a board's flash, as a debug probe does.
pub fn load(board: &mut Board, programs: &Programs) {
    board.machine_mut().chip_mut().flash.load(APPLICATION.start, &programs.application);
}

/// Attaches tools to a bus of boards without power.
pub type Attach<'a> = &'a mut dyn FnMut(&mut OverCan<Board>) -> Result<(), String>;

/// Boots boards with both programs. The first downloads its application over the bus, from erased flash, by
/// the original downloader; the others get the same bytes by probe, which saves half a minute each.
///
/// # Errors
/// A board does not boot, download or wake.
pub fn bring_up(
    boards: Vec<(Node, Board)>,
    programs: &Programs,
    download: bool,
    attach: Attach<'_>,
) -> Result<OverCan<Board>, String> {
    let mut boards = boards;
    for (_, board) in boards.iter_mut().skip(usize::from(download)) {
        load(board, programs);
    }
    let first = boards.first().map(|(node, _)| *node);
    let mut host = OverCan::new(boards);
    attach(&mut host)?;
    if let Some(first) = first.filter(|_| download) {
        // A monitor never sleeps: the others would only cost time.
        host.power_on_first(1)?;
        host.download(first, programs.tek.as_bytes())?;
    }
    host.power_on()?;
    host.wake()?;
    Ok(host)
}

/// Runs a scenario on emulated boards, polled every `poll_ms`. With `download` the first board starts with
/// erased flash. `clock` returns the time in s; `attach` gets each bus before its power-up.
///
/// # Errors
/// A board stops, does not answer, or rejects a property: there is no verdict.
pub fn run(
    scenario: &Scenario,
    nodes: Nodes,
    programs: &Programs,
    options: &Options,
    (poll_ms, download): (u32, bool),
    attach: Attach<'_>,
    clock: &dyn Fn() -> f64,
) -> Result<Session, String> {
    let mut session =
        Session { ran: Vec::new(), figures: Figures::default(), scenario_s: 0.0, scenario_wall_s: 0.0 };
    for (index, bus) in buses(scenario, nodes)?.into_iter().enumerate() {
        let parts = bus.iter().map(|&node| part(scenario, node, options)).collect::<Result<Vec<_>, _>>()?;
        let (jobs, rigs): (Vec<Job>, Vec<_>) = parts.into_iter().unzip();
        let seed = options.seed;
        let board = |(job, rig): (&Job, _)| {
            (job.node, Board::new(rig, job.node, programs, seed + u64::from(job.node.number())))
        };
        let boards = jobs.iter().zip(rigs).map(board).collect();
        let mut host = bring_up(boards, programs, download && index == 0, attach)?;
        if scenario.rig.is_wired_as_standard() {
            host.turn_once()?;
        }
        for place in 0..jobs.len() {
            if let Some(board) = host.bus_mut().station_mut(place) {
                board.begin_figures();
            }
        }
        let begun_s = clock();
        session.ran.extend(host.run(scenario, jobs, poll_ms)?);
        session.figures = host.bus().stations().map(Board::figures).fold(session.figures, Figures::worst);
        session.scenario_wall_s += clock() - begun_s;
        session.scenario_s += f64::from(scenario.duration_ms) / 1000.0;
    }
    Ok(session)
}
