//! Movement commands but LOOP (manual 5.2.1): which motors they move, and what their end is reported as (5.5).
//!
//! * **Motors**: without a prefix those with EN; a finger of which only one motor has it is no finger, and that motor moves alone. With X
//!   exactly the named ones.
//!   None: ERR 2. WM is for fingers and PTM for tips; other selected motors stand still.
//! * **Refusals**, where nothing moves: a number that is missing or out of range (128), one too many (1024), a hand hotter than OTEMP (8192), a
//!   board that does not answer, or two that have one number (1), a motor whose position is not known (4; HI finds it). T switches off the motors that it reaches
//!   nevertheless.
//! * **Faults** that boards keep from former motions are cleared by the next command that moves their motor: its user has seen what
//!   stopped the last one. A fault that persists ends the motion at once.
//! * **Results**: each motor goes on to its own end, then the sum of their codes is reported; parameter S has each motor's own. 16 is for
//!   commands that go to a position: the motor ended farther from it than MPE, or by a fault. C, O, TC and TO end where they end. An
//!   overheated motor is 8192, one that has lost its position (hall fault) 4, one whose board fell silent 1; any other fault or refusal is 8,
//!   and a board that does not move because its flash is broken 512, each where nothing else is reported.
//! * **HI** (findZero in manual 7): links to their open stops and to 0; then the spread to its open stop and the tips to their closed stops,
//!   out of the links' way, and to 0. Each board knows the way from its stop to 0 (IVEL, IHIT, IOFF). A motor that does not find its stop, or
//!   refuses (IVEL 0), ends this for itself only, so that one bad finger does not keep the hand from starting: ERR 4 at the end.
//!
//! The goals of each motor are in [`goals`], a motion from its start to its ends in [`motion`](crate::motion).

mod goals;

use tater_wire::{Cmd, Property};

use crate::boards::REPORTS;
use crate::command::GclCommand;
use crate::god::God;
use crate::grammar::Arguments;
use crate::memory::Positions;
use crate::motion::{self, Plan};
use crate::motors::{Motors, Prefix, Selection};
use crate::status::Status;
use crate::{order, query};

/// Greatest distance or position of an argument, GCL counts (manual 5.2.1).
const MAX_COUNTS: i64 = 20_000;

pub(crate) async fn execute(
    god: &God<'_>,
    command: GclCommand,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Status {
    run(god, command, prefix, arguments).await.unwrap_or_else(|refusal| refusal)
}

async fn run(
    god: &God<'_>,
    command: GclCommand,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Result<Status, Status> {
    let argument = argument(command, arguments)?;
    let selection = query::selection(god, prefix).await?;
    let motors = movers(command, selection);
    if motors.is_empty() {
        return Err(Status::NO_MOTOR);
    }
    if command == GclCommand::T {
        return Ok(terminate(god, motors).await);
    }
    if command == GclCommand::Hi {
        // HI comes before all motions: two boards with one number would each move their motor.
        god.boards.find_doubled(motors).await;
    }
    order::make_ready(god, motors, command != GclCommand::Hi).await?;
    Ok(match command {
        GclCommand::Hi => initialize(god, motors).await,
        GclCommand::Tc | GclCommand::To => {
            let cmd = if command == GclCommand::Tc { Cmd::Tc } else { Cmd::To };
            motion::run(god, &Plan::by_command(motors, cmd, goals::fingers(selection.followers))).await
        }
        _ => {
            let plan = goals::plan(god, command, argument, selection, motors).await?;
            motion::run(god, &plan).await
        }
    })
}

/// Moves the motors of a prefix to positions, GCL counts, each to its own: MAC.
pub(crate) async fn to_positions(god: &God<'_>, prefix: Prefix, positions: &Positions) -> Status {
    let moved = async {
        let selection = query::selection(god, prefix).await?;
        order::make_ready(god, selection.motors(), true).await?;
        let plan = goals::stored(god, positions, selection).await?;
        Ok(motion::run(god, &plan).await)
    };
    moved.await.unwrap_or_else(|refusal: Status| refusal)
}

/// Makes the motors of a prefix ready for RealTime; ^C stops them from now on.
///
/// # Errors
/// As for any other command.
pub(crate) async fn begin_realtime(god: &God<'_>, prefix: Prefix) -> Result<Selection, Status> {
    let selection = query::selection(god, prefix).await?;
    let motors = selection.motors();
    order::make_ready(god, motors, true).await?;
    god.boards.set(motors, Property::LFLAGS, REPORTS).await;
    let holding = query::property(god, motors, Property::HOLD).await?.filter(|hold| hold != 0);
    motors.iter().for_each(|motor| god.session.set_result(motor, Status::OK));
    god.session.begin_motion(motors, holding);
    Ok(selection)
}

/// Ends RealTime: its motors stop as HOLD demands, and get their own KPV back. `silent` ones are not waited for.
pub(crate) async fn end_realtime(god: &God<'_>, silent: Motors) {
    order::stop_moving(god, silent).await;
    order::restore_properties(god, silent).await;
}

/// The number after a command, within its range (manual 5.2.1): 0 to 20000 for M, WM, IO and IC, -20000 to 20000 for PTM. Degrees and
/// percents have no range of their own, but the resulting positions have one ([`goals`]).
///
/// # Errors
/// [`Status::INVALID_VALUE`]: not a number, or out of range. [`Status::TOO_MANY_ARGUMENTS`].
fn argument(command: GclCommand, arguments: Arguments<'_>) -> Result<Option<i64>, Status> {
    let range = match command {
        GclCommand::M | GclCommand::Wm | GclCommand::Io | GclCommand::Ic => 0..=MAX_COUNTS,
        GclCommand::Ptm => -MAX_COUNTS..=MAX_COUNTS,
        GclCommand::Mdeg | GclCommand::Mper => i64::MIN..=i64::MAX,
        _ => return arguments.none().map(|()| None),
    };
    let number = arguments.only_number()?;
    if number.is_none_or(|number| range.contains(&number)) { Ok(number) } else { Err(Status::INVALID_VALUE) }
}

fn movers(command: GclCommand, selection: Selection) -> Motors {
    let motors = selection.motors();
    match command {
        GclCommand::Ptm => motors.intersection(Motors::TIPS),
        // A tip keeps its direction while its link moves: without its link it has nothing to do.
        GclCommand::Wm => {
            let links = motors.intersection(Motors::LINKS);
            links.union(motors.intersection(links.tips()))
        }
        _ => motors,
    }
}

async fn initialize(god: &God<'_>, motors: Motors) -> Status {
    let mut sum = Status::OK;
    // The others wait for seconds: one that is driven in mode 2 or 4 would lose its host.
    order::stop_driven(god, motors.difference(Motors::LINKS)).await;
    for stage in [motors.intersection(Motors::LINKS), motors.difference(Motors::LINKS)] {
        if !stage.is_empty() {
            sum |= motion::run(god, &Plan::by_command(stage, Cmd::Hi, [Motors::NONE; 3])).await;
        }
    }
    sum
}

/// T: switches off every motor first; a hot hand, a motor that is not initialized and a silent board are reported afterwards.
async fn terminate(god: &God<'_>, motors: Motors) -> Status {
    // ^C may drop the order before it leaves: it switches these off instead.
    god.session.begin_motion(motors, Motors::NONE);
    god.boards.set(motors, Property::CMD, Cmd::T.into()).await;
    // A board that answers this has the order.
    god.boards.get(motors, Property::STAT).await;
    god.session.end_motion(motors);
    query::check_ready(god, motors, true).await.err().unwrap_or_default()
}
