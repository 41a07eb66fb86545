//! Where a command that goes somewhere takes each motor, GCL counts.
//!
//! Without X a finger's tip goes along with its link ([`units::of_tip_along`]): an absolute command puts it where it belongs to the link's
//! goal, an incremental one moves it by its share of the link's way. A finger that has broken away (BD) and closes on is no more one: its
//! tip keeps its lead, and C takes it to its own CT, or closing again would open what the hand holds. Opening puts it right again.
//!
//! Goals are not clamped to a joint's range: a motor that meets its stop stalls there (5.5).

use tater_wire::{Cmd, Property};

use super::motion::{Breakaway, Plan};
use super::ready::{all, counts, mapped, positions};
use crate::boards::Answers;
use crate::command::Command;
use crate::god::God;
use crate::memory::Positions;
use crate::motors::{Motor, Motors, Selection};
use crate::status::Status;
use crate::units;

/// Furthest position of the language, GCL counts (5.3).
const FURTHEST: i64 = 32_767;

/// From half of its range on the spread is closed, GCL counts (table 1: 0 to 9130): fingers 1 and 2 are nearer to beside finger 3 than to
/// opposite it.
const SPREAD_CLOSED: i64 = 9130 / 2;

/// What a command asks of its `motors`, those of the selection that it moves.
///
/// # Errors
/// Degrees or percents that no position of the language is: [`Status::INVALID_VALUE`]. A board does not answer: [`Status::NO_BOARD`]. PTM has to
/// know where the spread is: [`Status::NOT_INITIALIZED`].
pub(super) async fn plan(
    god: &God<'_>,
    command: Command,
    argument: Option<i64>,
    selection: Selection,
    motors: Motors,
) -> Result<Plan, Status> {
    let from = positions(god, motors).await?;
    if command == Command::Ptm {
        let goals = parallel(god, argument, motors, &from).await?;
        let together = [motors, Motors::NONE, Motors::NONE];
        return Ok(Plan { breakaway: Breakaway::Off, together, ..Plan::to(goals, from) });
    }
    let wiper = command == Command::Wm;
    // WM with X: the tips that it names go by their links.
    let axes = if wiper { motors.intersection(Motors::LINKS) } else { selection.axes };
    let mut goals = axis_goals(god, command, argument, axes, &from).await?;
    let tips = if wiper || !selection.exclusive { motors.intersection(axes.tips()) } else { Motors::NONE };
    let mut breakaway = if selection.exclusive { Breakaway::Off } else { Breakaway::TipGoesOn };
    if wiper {
        for tip in tips.iter() {
            put_tip(&mut goals, tip, &from, |way| units::of_tip_against(way.link_way()) + way.tip_from);
        }
        if !selection.exclusive {
            breakaway = Breakaway::TipStops;
        }
    } else if !tips.is_empty() {
        let broken = all(god, axes.intersection(Motors::LINKS), Property::BD).await?.filter(|bd| bd != 0);
        let close =
            if command == Command::C { counts(god, tips, Property::CT).await? } else { Answers::default() };
        for tip in tips.iter() {
            let broken = tip.link().is_some_and(|link| broken.has(link));
            put_tip(&mut goals, tip, &from, |way| along(command, way, broken, close.get(tip)));
        }
        if command == Command::C {
            breakaway = Breakaway::TipGoesTo(close);
        }
    }
    let judged = !matches!(command, Command::C | Command::O);
    // CMD O forgets a breakaway as well; it goes where M to OT would.
    let order = (command == Command::O).then_some((axes, Cmd::O));
    Ok(Plan { breakaway, judged, order, together: fingers(tips), ..Plan::to(goals, from) })
}

/// Positions that were stored, a tip's too, are gone to as they are.
///
/// # Errors
/// A board does not answer: [`Status::NO_BOARD`].
pub(super) async fn stored(
    god: &God<'_>,
    positions: &Positions,
    selection: Selection,
) -> Result<Plan, Status> {
    let from = self::positions(god, selection.motors()).await?;
    let goals = mapped(&from, |motor, _| positions.get(motor.index()).copied().unwrap_or(0).into());
    let plan = Plan::to(goals, from);
    Ok(if selection.exclusive {
        Plan { breakaway: Breakaway::Off, ..plan }
    } else {
        Plan { together: fingers(selection.axes.tips()), ..plan }
    })
}

/// The fingers of tips: link and tip arrive together.
pub(super) fn fingers(tips: Motors) -> [Motors; 3] {
    let mut fingers = [Motors::NONE; 3];
    for (finger, tip) in fingers.iter_mut().zip(tips.iter()) {
        *finger = tip.link().map_or(Motors::NONE, |link| Motors::only(link).with(tip));
    }
    fingers
}

/// Goals of everything but tips that go with their links.
async fn axis_goals(
    god: &God<'_>,
    command: Command,
    argument: Option<i64>,
    axes: Motors,
    from: &Answers,
) -> Result<Answers, Status> {
    let default = match (command, argument) {
        (Command::C, _) => Property::CT,
        (Command::O, _) => Property::OT,
        (Command::Mper, Some(_)) => Property::CT,
        (Command::Io | Command::Ic, _) => Property::DS,
        // Of MDEG and MPER too, in counts (MANUAL-NOTES 20).
        _ => Property::DP,
    };
    let needed = command != Command::Home && (argument.is_none() || command == Command::Mper);
    let set = if needed { counts(god, axes, default).await? } else { Answers::default() };
    let goal = |motor: Motor| {
        let number = argument.or(set.get(motor));
        match (command, argument) {
            (Command::Home, _) => Some(0),
            (Command::Io, _) => Some(from.get(motor)? - number?),
            (Command::Ic, _) => Some(from.get(motor)? + number?),
            (Command::Mdeg, Some(degrees)) => Some(units::of_degrees(motor.kind(), degrees)),
            (Command::Mper, Some(percent)) => Some(units::of_percent(percent, set.get(motor)?)),
            _ => number,
        }
    };
    let mut goals = Answers::default();
    for motor in axes.iter() {
        let goal = goal(motor).ok_or(Status::NO_BOARD)?;
        if matches!(command, Command::Mdeg | Command::Mper) && goal.saturating_abs() > FURTHEST {
            return Err(Status::INVALID_VALUE);
        }
        goals.set(motor, goal);
    }
    Ok(goals)
}

/// A finger's way, GCL counts.
#[derive(Clone, Copy)]
struct Way {
    link_from: i64,
    link_goal: i64,
    tip_from: i64,
}

impl Way {
    const fn link_way(self) -> i64 {
        self.link_goal - self.link_from
    }
}

/// Puts in where a tip goes.
fn put_tip(goals: &mut Answers, tip: Motor, from: &Answers, goal: impl Fn(Way) -> i64) {
    let way = tip.link().and_then(|link| {
        Some(Way { link_from: from.get(link)?, link_goal: goals.get(link)?, tip_from: from.get(tip)? })
    });
    if let Some(way) = way {
        goals.set(tip, goal(way));
    }
}

/// Where a tip goes that goes along with its link; `close` is its own CT, if the command is C.
fn along(command: Command, way: Way, broken: bool, close: Option<i64>) -> i64 {
    let relative = way.tip_from + units::of_tip_along(way.link_way());
    match close {
        Some(close) if broken => close,
        _ if matches!(command, Command::Io | Command::Ic) => relative,
        None if broken && way.link_way() > 0 => relative,
        _ => units::of_tip_along(way.link_goal),
    }
}

/// PTM: motor 7 goes by so many counts, or its DS; the others go the same way as it while the spread is closed, the other way while it is
/// open (manual 5.2.1). For these the spread must be known, though it does not move.
async fn parallel(
    god: &God<'_>,
    argument: Option<i64>,
    tips: Motors,
    from: &Answers,
) -> Result<Answers, Status> {
    let steps = match argument {
        Some(step) => mapped(from, |_, _| step),
        None => counts(god, tips, Property::DS).await?,
    };
    let leader = Motor::new(7).map_or(Motors::NONE, |motor| Motors::only(motor));
    let mut turned = Motors::NONE;
    if !tips.difference(leader).is_empty() {
        super::ready::look(god, Motors::SPREAD, true).await?;
        let spread = positions(god, Motors::SPREAD).await?.get(Motor::SPREAD);
        if spread.is_some_and(|counts| counts < SPREAD_CLOSED) {
            turned = tips.difference(leader);
        }
    }
    Ok(mapped(&steps, |motor, step| {
        let step = if turned.has(motor) { -step } else { step };
        from.get(motor).unwrap_or(0) + step
    }))
}
