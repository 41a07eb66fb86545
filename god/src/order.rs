//! Orders to the boards: make motors ready, override properties and restore them, stop, set parameters.

use core::convert::Infallible;

use tater_wire::{Cmd, FaultCode, ModeCode, Property};

use crate::boards::{Answers, REPORTS};
use crate::god::God;
use crate::io::NEVER;
use crate::memory::MotorParameters;
use crate::motors::Motors;
use crate::parameter::{ParameterSpec, Source};
use crate::query;
use crate::session::{OVERRIDABLE, Stopping};
use crate::status::Status;

/// Interval of keep-alives to boards whose motors press, µs. V may have taken over from TC or TO: then a board lets go after HOSTMS
/// of silence (decision 0013).
const KEEPALIVE_US: u64 = 200_000;

/// Makes motors ready to move, all or none: awake, without faults of former motions. A storage fault stays: it stops no motor.
///
/// # Errors
/// As those of [`query::check_ready`].
pub(crate) async fn make_ready(god: &God<'_>, motors: Motors, initialized: bool) -> Result<(), Status> {
    query::check_ready(god, motors, initialized).await?;
    leave_velocity_mode(god, motors.difference(god.session.pressing())).await;
    let faults = god.boards.get(motors, Property::ERROR).await;
    let storage = i64::from(FaultCode::Storage);
    god.boards.set(faults.filter(|code| code != 0 && code != storage), Property::STAT, 2).await;
    // Boards that did not confirm this after the last motion.
    restore_properties(god, Motors::NONE).await;
    god.session.cease_pressing(motors);
    Ok(())
}

/// Ends mode 4 of another host. It would never end by itself, and a motion under way keeps its END, so the board could not report that it
/// refuses an order (decision 0036).
async fn leave_velocity_mode(god: &God<'_>, motors: Motors) {
    let moving = god.boards.get(motors, Property::END).await.filter(|end| end == 0);
    let mode = god.boards.get(moving, Property::MODE).await;
    let velocity = mode.filter(|mode| ModeCode::of(mode) == Some(ModeCode::Velocity));
    god.boards.set(velocity, Property::MODE, ModeCode::Idle.into()).await;
}

/// Stops motors as HOLD demands: in mode 3 where they are, or without power (manual 5.5).
pub(crate) async fn stop(god: &God<'_>, motors: Motors, holding: Motors) {
    god.boards.set(motors.intersection(holding), Property::MODE, ModeCode::Pid.into()).await;
    god.boards.set(motors.difference(holding), Property::MODE, ModeCode::Idle.into()).await;
}

/// Stops motors that are driven, as HOLD demands; those that hold go on. Returns which were driven.
pub(crate) async fn stop_driven(god: &God<'_>, motors: Motors) -> Motors {
    let modes = god.boards.get(motors, Property::MODE).await;
    let driven = modes.filter(|mode| !matches!(ModeCode::of(mode), Some(ModeCode::Idle | ModeCode::Pid)));
    let holding = god.boards.get(driven, Property::HOLD).await.filter(|hold| hold != 0);
    stop(god, driven, holding).await;
    driven
}

/// Stops every moving motor. Asks the boards for MODE then: with their answers the orders have left, and no later ^C drops them with
/// other queued frames. The motors stay the session's until then. Boards in `silent` are not asked.
pub(crate) async fn stop_moving(god: &God<'_>, silent: Motors) -> Motors {
    let Stopping { motors, holding } = god.session.moving();
    stop(god, motors, holding).await;
    god.boards.get(motors.difference(silent), Property::MODE).await;
    god.session.end_motion(motors);
    motors
}

/// ^C has dropped a command: stops every motor that it moved.
pub(crate) async fn abort_motion(god: &God<'_>) {
    let motors = stop_moving(god, Motors::NONE).await;
    motors.iter().for_each(|motor| god.session.set_result(motor, Status::ABORTED));
    restore_properties(god, Motors::NONE).await;
}

pub(crate) async fn send_keepalives(god: &God<'_>) -> Infallible {
    loop {
        let pressing = || Some(god.session.pressing()).filter(|motors| !motors.is_empty());
        god.io.wait_until(NEVER, pressing).await;
        god.io.sleep_until(god.io.after_us(KEEPALIVE_US)).await;
        // The boards have this value already, and do not answer.
        god.boards.set(god.session.pressing(), Property::LFLAGS, REPORTS).await;
    }
}

/// Overrides a property of [`OVERRIDABLE`] until [`restore_properties`] sets it to `own` again.
pub(crate) async fn override_property(god: &God<'_>, property: Property, values: &Answers, own: &Answers) {
    let overridden = god.session.overridden(property);
    // One that a board has not got back yet is older than `own`.
    let own = Answers::from_fn(values.motors(), |motor| own.get(motor)).overridden_by(&overridden.get());
    // Noted before the first order: ^C may come at any time.
    overridden.set(own);
    god.boards.set_each(property, values).await;
}

/// Restores all overridden properties. Boards in `silent` get the order but are not asked; what a board does not confirm is tried again
/// before the next motion.
pub(crate) async fn restore_properties(god: &God<'_>, silent: Motors) {
    let mut silent = silent;
    for property in OVERRIDABLE {
        let own = god.session.overridden(property).get();
        if own.motors().is_empty() {
            continue;
        }
        god.boards.set_each(property, &own).await;
        let asked = own.motors().difference(silent);
        let found = god.boards.get(asked, property).await;
        // A board that does not answer is asked once, and not for each property.
        silent = silent.union(asked.difference(found.motors()));
        god.session.overridden(property).set(own.different_from(&found));
    }
}

/// Restores the velocities of motors that continue alone; [`restore_properties`] follows at the end.
pub(crate) async fn restore_speed(god: &God<'_>, motors: Motors) {
    for property in [Property::MV, Property::MCV, Property::MOV] {
        let own = god.session.overridden(property).get();
        god.boards.set_each(property, &Answers::from_fn(motors, |motor| own.get(motor))).await;
    }
}

/// Sets a parameter. A SET to a board is verified by a GET. Returns [`Status::NO_BOARD`] and [`Status::INVALID_VALUE`], where a board has
/// another value.
pub(crate) async fn set_parameter(god: &God<'_>, spec: &ParameterSpec, values: &Answers) -> Status {
    match spec.source {
        Source::Board(property) => set_verified(god, property, values).await,
        Source::Counts { property, place, .. } => {
            let on_board = values.map(|motor, value| query::counts_on_board(motor, property, value));
            let status = set_verified(god, property, &on_board).await;
            set_kept(god, values, |of, value| {
                if let (Some(to), Ok(value)) = (of.as_set.get_mut(usize::from(place)), value.try_into()) {
                    *to = value;
                }
            });
            status
        }
        Source::Kept { kept, .. } => {
            set_kept(god, values, |of, value| of.set(kept, value));
            Status::OK
        }
        // Its only value is in range, so it is set already.
        Source::Fixed(_) => Status::OK,
        Source::Measured(_) | Source::Status => Status::READ_ONLY,
    }
}

async fn set_verified(god: &God<'_>, property: Property, values: &Answers) -> Status {
    god.boards.set_each(property, values).await;
    let found = god.boards.get(values.motors(), property).await;
    let mut status = Status::OK;
    for motor in values.motors().iter() {
        status |= match found.get(motor) {
            None => Status::NO_BOARD,
            found if found == values.get(motor) => Status::OK,
            Some(_) => Status::INVALID_VALUE,
        };
    }
    status
}

fn set_kept(god: &God<'_>, values: &Answers, set: impl Fn(&mut MotorParameters, i64)) {
    god.memory.change_parameters(|parameters| {
        for motor in values.motors().iter() {
            if let (Some(of), Some(value)) = (parameters.motors.get_mut(motor.index()), values.get(motor)) {
                set(of, value);
            }
        }
    });
}

/// Whether a SET of the host may start a motion, which a hot hand refuses.
pub(crate) fn begins_motion(property: Property, value: i64) -> bool {
    match property {
        Property::MODE => value != 0,
        Property::M => true,
        Property::CMD => {
            !matches!(Cmd::of(value), Some(Cmd::T | Cmd::Load | Cmd::Save | Cmd::Def | Cmd::Reset))
        }
        _ => false,
    }
}

pub(crate) fn changes_motion(property: Property, value: i64) -> bool {
    match property {
        Property::MODE | Property::M | Property::V | Property::T => true,
        // 2 clears faults and ends no motion.
        Property::STAT => value != 2,
        Property::CMD => !matches!(Cmd::of(value), Some(Cmd::Load | Cmd::Save | Cmd::Def)),
        _ => false,
    }
}
