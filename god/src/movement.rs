//! Movement commands but LOOP (manual 5.2.1): what they ask of which motor, and how a motion ends (5.5).
//!
//! * **Who**: without a prefix the motors with EN; a finger goes by its link's EN, and its tip moves with it. With X exactly those named.
//!   Nobody: ERR 2. WM is for fingers and PTM for tips; who else is selected stands still.
//! * **Refused**, and then nothing moves: a number out of range or none (128), one too many (1024), a hand hotter than OTEMP (8192), a
//!   board that does not answer (1), a motor whose position is not known (4; HI finds it). T switches off whom it can all the same.
//! * **Faults** that boards have kept from former motions are cleared by the next command that moves their motor: who types it has seen
//!   what stopped the last one. A fault that goes on ends the motion at once.
//! * **Told**: each motor goes on to its own end, and then the sum of their codes is told; parameter S has each motor's own. 16 is for
//!   commands that go to a position: the motor ended farther from it than MPE, or by a fault. C, O, TC and TO end where they end. An
//!   overheated motor is 8192, one that has lost its position (hall fault) 4, one whose board fell silent 1, which is told to stop; any other fault that ends
//!   a motion is 8, and a board that does not begin one because its flash is broken 512, where nothing else is to be told.
//!
//! Where to look: who can move is in [`ready`], where it goes in [`goals`], how link and tip arrive together in [`pace`], a motion from
//! its start to its ends in [`motion`], HI in [`homing`], what ^C and the time between two commands need in [`moves`].

mod goals;
mod homing;
mod motion;
mod moves;
mod pace;
mod ready;

use tater_wire::{Cmd, Property};

use crate::boards::REPORTS;
use crate::command::Command;
use crate::god::God;
use crate::memory::Positions;
use crate::motors::{Motors, Prefix, Selection};
use crate::status::Status;
use crate::words::Arguments;

pub(crate) use moves::{Moves, abort, keep_company, lend};
pub(crate) use ready::{is_too_hot, lost};

/// Greatest distance or position that is typed, GCL counts (manual 5.2.1).
const MOST_COUNTS: i64 = 20_000;

/// Does it.
pub(crate) async fn execute(
    god: &God<'_>,
    command: Command,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Status {
    attempt(god, command, prefix, arguments).await.unwrap_or_else(|refusal| refusal)
}

/// Moves the motors of a prefix to positions, GCL counts, each to its own: for MAC.
pub(crate) async fn to_positions(god: &God<'_>, prefix: Prefix, positions: &Positions) -> Status {
    let moved = async {
        let selection = god.selection(prefix).await?;
        begin(god, selection.motors(), true).await?;
        let plan = goals::stored(god, positions, selection).await?;
        Ok(motion::run(god, &plan).await)
    };
    moved.await.unwrap_or_else(|refusal: Status| refusal)
}

/// What it has come to, or why it was refused.
async fn attempt(
    god: &God<'_>,
    command: Command,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Result<Status, Status> {
    let argument = argument(command, arguments)?;
    let selection = god.selection(prefix).await?;
    let motors = movers(command, selection);
    if motors.is_empty() {
        return Err(Status::NO_MOTOR);
    }
    if command == Command::T {
        return Ok(terminate(god, motors).await);
    }
    begin(god, motors, command != Command::Hi).await?;
    Ok(match command {
        Command::Hi => homing::initialize(god, motors).await,
        Command::Tc | Command::To => {
            let cmd = if command == Command::Tc { Cmd::Tc } else { Cmd::To };
            let tips = if selection.exclusive { Motors::NONE } else { motors.intersection(Motors::TIPS) };
            motion::run(god, &motion::Plan::ordered(motors, cmd, goals::fingers(tips))).await
        }
        _ => motion::run(god, &goals::plan(god, command, argument, selection, motors).await?).await,
    })
}

/// The motors of a prefix for RealTime, ready to move; ^C ends what they do from now on.
///
/// # Errors
/// As for any other command.
pub(crate) async fn take_over(god: &God<'_>, prefix: Prefix) -> Result<Selection, Status> {
    let selection = god.selection(prefix).await?;
    let motors = selection.motors();
    begin(god, motors, true).await?;
    god.boards.set(motors, Property::LFLAGS, REPORTS).await;
    let holding = ready::all(god, motors, Property::HOLD).await?.filter(|hold| hold != 0);
    motors.iter().for_each(|motor| god.note(motor, Status::OK));
    god.moves.begin(motors, holding);
    god.lower.forget(motors);
    Ok(selection)
}

/// The end of RealTime: its motors stop as HOLD says, and have their own KPV again. `silent` ones are not waited for.
pub(crate) async fn let_go(god: &God<'_>, silent: Motors) {
    let motors = god.moves.ends();
    moves::stop(god, motors).await;
    moves::give_back_but(god, silent).await;
}

/// Makes motors ready to move, all of them or none.
///
/// # Errors
/// Why they cannot: as those of [`ready::look`].
async fn begin(god: &God<'_>, motors: Motors, initialized: bool) -> Result<(), Status> {
    ready::ready(god, motors, initialized).await?;
    // What a board did not confirm after the last motion.
    moves::give_back(god).await;
    god.moves.cease_pressing(motors);
    Ok(())
}

/// The number after a command, within its range (manual 5.2.1): positions of M and WM and distances of IO and IC 0 to 20000, PTM's
/// distance -20000 to 20000; degrees and percents have no range, but what they come to has ([`goals`]).
///
/// # Errors
/// No number, or out of range: [`Status::INVALID_VALUE`]. More than the command takes: [`Status::TOO_MANY_ARGUMENTS`].
fn argument(command: Command, arguments: Arguments<'_>) -> Result<Option<i64>, Status> {
    let range = match command {
        Command::M | Command::Wm | Command::Io | Command::Ic => 0..=MOST_COUNTS,
        Command::Ptm => -MOST_COUNTS..=MOST_COUNTS,
        Command::Mdeg | Command::Mper => i64::MIN..=i64::MAX,
        _ => return arguments.none().map(|()| None),
    };
    let number = arguments.only_number()?;
    if number.is_none_or(|number| range.contains(&number)) { Ok(number) } else { Err(Status::INVALID_VALUE) }
}

/// Those of a selection that a command moves.
fn movers(command: Command, selection: Selection) -> Motors {
    let motors = selection.motors();
    match command {
        Command::Ptm => motors.intersection(Motors::TIPS),
        // A tip keeps its direction while its link moves: without its link there is nothing to do for it.
        Command::Wm => {
            let links = motors.intersection(Motors::LINKS);
            links.union(motors.intersection(links.tips()))
        }
        _ => motors,
    }
}

/// T: switches off the power of every motor, and then looks whether it should have: a hand that is too hot, a motor that is not initialised
/// and one that does not answer are told all the same.
async fn terminate(god: &God<'_>, motors: Motors) -> Status {
    god.moves.cease_pressing(motors);
    god.lower.forget(motors);
    god.boards.set(motors, Property::CMD, Cmd::T.number().into()).await;
    // Who answers has been told.
    god.boards.get(motors, Property::STAT).await;
    ready::look(god, motors, true).await.err().unwrap_or_default()
}
