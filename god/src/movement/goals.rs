//! The goals of each motor for commands that go to positions, GCL counts.
//!
//! Without X a finger's tip moves along with its link ([`units::tip_travel_along`]): an absolute command puts it where it belongs to the link's
//! goal, an incremental one moves it by its share of the link's travel. In a finger that has broken away (BD) and closes further, the tip
//! keeps its lead, and C takes it to its own CT: closing it to the link's share would release the object. Opening couples the two again.
//!
//! Goals are not clamped to a joint's range: a motor that meets its stop stalls there (manual 5.5).

use tater_wire::{Cmd, Property};

use crate::boards::Answers;
use crate::command::GclCommand;
use crate::god::God;
use crate::memory::Positions;
use crate::motion::{Breakaway, Plan};
use crate::motors::{Motor, Motors, Selection};
use crate::query::{check_ready, counts, positions, property};
use crate::status::Status;
use crate::units;

/// Farthest position of the language, GCL counts (manual 5.3).
const MAX_POSITION: i64 = 32_767;

/// The spread counts as closed from half of its range on, GCL counts (manual table 1: 0 to 9130): fingers 1 and 2 are nearer to beside
/// finger 3 than to opposite it.
const SPREAD_CLOSED: i64 = 9130 / 2;

/// The plan of a command for its `motors`, those of the selection that it moves.
///
/// # Errors
/// [`Status::INVALID_VALUE`]: degrees or percents beyond the positions of the language. [`Status::NO_BOARD`]: a board does not answer.
/// [`Status::NOT_INITIALIZED`]: PTM has to know where the spread is.
pub(super) async fn plan(
    god: &God<'_>,
    command: GclCommand,
    argument: Option<i64>,
    selection: Selection,
    motors: Motors,
) -> Result<Plan, Status> {
    let from = positions(god, motors).await?;
    if command == GclCommand::Ptm {
        let goals = parallel(god, argument, motors, &from).await?;
        let together = [motors, Motors::NONE, Motors::NONE];
        return Ok(Plan { breakaway: Breakaway::Off, together, ..Plan::to(goals, from) });
    }
    let is_wiper = command == GclCommand::Wm;
    // WM with X: the named tips follow their links.
    let axes = if is_wiper { motors.intersection(Motors::LINKS) } else { selection.axes };
    let mut goals = axis_goals(god, command, argument, axes, &from).await?;
    let tips = motors.intersection(if is_wiper { axes.tips() } else { selection.followers });
    let mut breakaway = if selection.exclusive { Breakaway::Off } else { Breakaway::TipGoesOn };
    if is_wiper {
        for tip in tips.iter() {
            put_tip(&mut goals, tip, &from, |travel| {
                units::tip_travel_against(travel.link_travel()) + travel.tip_from
            });
        }
        if !selection.exclusive {
            breakaway = Breakaway::TipStops;
        }
    } else if !tips.is_empty() {
        let broken =
            property(god, axes.intersection(Motors::LINKS), Property::BD).await?.filter(|bd| bd != 0);
        let close = if command == GclCommand::C {
            counts(god, tips, Property::CT).await?
        } else {
            Answers::default()
        };
        for tip in tips.iter() {
            let broken = tip.link().is_some_and(|link| broken.has(link));
            put_tip(&mut goals, tip, &from, |travel| along(command, travel, broken, close.get(tip)));
        }
        if command == GclCommand::C {
            breakaway = Breakaway::TipGoesTo(close);
        }
    }
    let is_judged = !matches!(command, GclCommand::C | GclCommand::O);
    // CMD O goes to OT as well, and clears a breakaway.
    let order = (command == GclCommand::O).then_some((axes, Cmd::O));
    Ok(Plan { breakaway, is_judged, order, together: fingers(tips), ..Plan::to(goals, from) })
}

/// The plan to go to stored positions: a tip has its own, so it does not follow its link.
///
/// # Errors
/// [`Status::NO_BOARD`]: a board does not answer.
pub(super) async fn stored(
    god: &God<'_>,
    positions: &Positions,
    selection: Selection,
) -> Result<Plan, Status> {
    let from = crate::query::positions(god, selection.motors()).await?;
    let goals = from.map(|motor, _| positions.get(motor.index()).copied().unwrap_or(0).into());
    let plan = Plan::to(goals, from);
    Ok(if selection.exclusive {
        Plan { breakaway: Breakaway::Off, ..plan }
    } else {
        Plan { together: fingers(selection.followers), ..plan }
    })
}

pub(super) fn fingers(tips: Motors) -> [Motors; 3] {
    let mut fingers = [Motors::NONE; 3];
    for (finger, tip) in fingers.iter_mut().zip(tips.iter()) {
        *finger = tip.link().map_or(Motors::NONE, |link| Motors::only(link).with(tip));
    }
    fingers
}

/// The goals of all motors but tips that follow their links.
async fn axis_goals(
    god: &God<'_>,
    command: GclCommand,
    argument: Option<i64>,
    axes: Motors,
    from: &Answers,
) -> Result<Answers, Status> {
    let default = match (command, argument) {
        (GclCommand::C, _) => Property::CT,
        (GclCommand::O, _) => Property::OT,
        (GclCommand::Mper, Some(_)) => Property::CT,
        (GclCommand::Io | GclCommand::Ic, _) => Property::DS,
        // For MDEG and MPER as well, in counts (decision 0001).
        _ => Property::DP,
    };
    let needed = command != GclCommand::Home && (argument.is_none() || command == GclCommand::Mper);
    let set = if needed { counts(god, axes, default).await? } else { Answers::default() };
    let goal = |motor: Motor| {
        let number = argument.or(set.get(motor));
        match (command, argument) {
            (GclCommand::Home, _) => Some(0),
            (GclCommand::Io, _) => Some(from.get(motor)? - number?),
            (GclCommand::Ic, _) => Some(from.get(motor)? + number?),
            (GclCommand::Mdeg, Some(degrees)) => Some(units::gcl_from_degrees(motor.kind(), degrees)),
            (GclCommand::Mper, Some(percent)) => Some(units::gcl_from_percent(percent, set.get(motor)?)),
            _ => number,
        }
    };
    let mut goals = Answers::default();
    for motor in axes.iter() {
        let goal = goal(motor).ok_or(Status::NO_BOARD)?;
        if matches!(command, GclCommand::Mdeg | GclCommand::Mper) && goal.saturating_abs() > MAX_POSITION {
            return Err(Status::INVALID_VALUE);
        }
        goals.set(motor, goal);
    }
    Ok(goals)
}

#[derive(Clone, Copy)]
struct Travel {
    link_from: i64,
    link_goal: i64,
    tip_from: i64,
}

impl Travel {
    const fn link_travel(self) -> i64 {
        self.link_goal - self.link_from
    }
}

fn put_tip(goals: &mut Answers, tip: Motor, from: &Answers, goal: impl Fn(Travel) -> i64) {
    let travel = tip.link().and_then(|link| {
        Some(Travel { link_from: from.get(link)?, link_goal: goals.get(link)?, tip_from: from.get(tip)? })
    });
    if let Some(travel) = travel {
        goals.set(tip, goal(travel));
    }
}

/// The goal of a tip that moves along with its link; `close` is its own CT if the command is C.
fn along(command: GclCommand, travel: Travel, broken: bool, close: Option<i64>) -> i64 {
    let relative = travel.tip_from + units::tip_travel_along(travel.link_travel());
    match close {
        Some(close) if broken => close,
        _ if matches!(command, GclCommand::Io | GclCommand::Ic) => relative,
        None if broken && travel.link_travel() > 0 => relative,
        _ => units::tip_travel_along(travel.link_goal),
    }
}

/// PTM: motor 7 moves by the argument or its DS; the others move in the same direction while the spread is closed, in the other one while
/// it is open (manual 5.2.1). For these the spread must be initialized, though it does not move.
async fn parallel(
    god: &God<'_>,
    argument: Option<i64>,
    tips: Motors,
    from: &Answers,
) -> Result<Answers, Status> {
    let steps = match argument {
        Some(step) => from.map(|_, _| step),
        None => counts(god, tips, Property::DS).await?,
    };
    let leader = Motor::new(7).map_or(Motors::NONE, Motors::only);
    let mut turned = Motors::NONE;
    if !tips.difference(leader).is_empty() {
        check_ready(god, Motors::SPREAD, true).await?;
        let spread = positions(god, Motors::SPREAD).await?.get(Motor::SPREAD);
        if spread.is_some_and(|counts| counts < SPREAD_CLOSED) {
            turned = tips.difference(leader);
        }
    }
    Ok(steps.map(|motor, step| {
        let step = if turned.has(motor) { -step } else { step };
        from.get(motor).unwrap_or(0) + step
    }))
}
