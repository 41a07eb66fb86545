//! Whether motors can move, and what has to be known of them before.

use tater_wire::{FaultCode, Property};

use crate::boards::Answers;
use crate::god::God;
use crate::motors::{Motor, Motors};
use crate::parameter::{MOTOR, Row, Source};
use crate::settings;
use crate::status::Status;
use crate::units;

/// HALLH: the board knows where its motor is.
const KNOWN: i64 = 1 << 30;

/// OTEMP of a hand that stands any temperature, 0.1 °C (manual 5.4.1).
const NO_LIMIT: i16 = -551;

/// Makes motors ready to move: awake, and without faults of the past. A failed flash stays known, it stops no motor.
///
/// # Errors
/// As those of [`look`].
pub(super) async fn ready(god: &God<'_>, motors: Motors, initialized: bool) -> Result<(), Status> {
    look(god, motors, initialized).await?;
    let faults = god.boards.get(motors, Property::ERROR).await;
    let storage = i64::from(FaultCode::Storage.code());
    god.boards.set(faults.filter(|code| code != 0 && code != storage), Property::STAT, 2).await;
    Ok(())
}

/// Whether the hand is hotter than OTEMP.
pub(crate) fn is_too_hot(god: &God<'_>) -> bool {
    let limit = god.parameters.borrow().hand.otemp;
    limit != NO_LIMIT && god.io.temperature() > limit
}

/// Looks whether motors can move: that the hand is not hotter than OTEMP, that their boards answer, and, if they are to be `initialized`, that
/// they know where they are. Wakes those that sleep.
///
/// # Errors
/// The sum of what is against it: [`Status::OVER_TEMPERATURE`] alone, or [`Status::NO_BOARD`] and [`Status::NOT_INITIALIZED`]. S of each motor tells
/// its own.
pub(super) async fn look(god: &God<'_>, motors: Motors, initialized: bool) -> Result<(), Status> {
    if is_too_hot(god) {
        motors.iter().for_each(|motor| god.note(motor, Status::OVER_TEMPERATURE));
        return Err(Status::OVER_TEMPERATURE);
    }
    let awake = god.boards.wake(motors).await;
    let known = if initialized { god.boards.get(awake, Property::HALLH).await } else { Answers::default() };
    let mut sum = Status::OK;
    for motor in motors.iter() {
        let status = match known.get(motor) {
            _ if !awake.has(motor) => Status::NO_BOARD,
            None if initialized => Status::NO_BOARD,
            Some(bits) if bits & KNOWN == 0 => Status::NOT_INITIALIZED,
            _ => continue,
        };
        god.note(motor, status);
        sum |= status;
    }
    if sum.is_ok() { Ok(()) } else { Err(sum) }
}

/// Those of motors whose boards say that they do not know where they are.
pub(crate) async fn lost(god: &God<'_>, motors: Motors) -> Motors {
    god.boards.get(motors, Property::HALLH).await.filter(|bits| bits & KNOWN == 0)
}

/// A property of each of those motors.
///
/// # Errors
/// One does not answer: [`Status::NO_BOARD`].
pub(super) async fn all(god: &God<'_>, motors: Motors, property: Property) -> Result<Answers, Status> {
    complete(god, motors, god.boards.get(motors, property).await)
}

fn complete(god: &God<'_>, motors: Motors, answers: Answers) -> Result<Answers, Status> {
    let silent = motors.difference(answers.motors());
    silent.iter().for_each(|motor| god.note(motor, Status::NO_BOARD));
    if silent.is_empty() { Ok(answers) } else { Err(Status::NO_BOARD) }
}

/// Where each of those motors is, GCL counts.
///
/// # Errors
/// One does not answer: [`Status::NO_BOARD`].
pub(super) async fn positions(god: &God<'_>, motors: Motors) -> Result<Answers, Status> {
    complete(god, motors, known_positions(god, motors).await)
}

/// The same of those that answer.
pub(super) async fn known_positions(god: &God<'_>, motors: Motors) -> Answers {
    mapped(&god.boards.get(motors, Property::P).await, |_, halls| units::gcl(halls))
}

/// A parameter of positions or distances of each of those motors, GCL counts, as FGET tells it.
///
/// # Errors
/// One does not answer: [`Status::NO_BOARD`].
pub(super) async fn counts(god: &God<'_>, motors: Motors, property: Property) -> Result<Answers, Status> {
    complete(god, motors, known_counts(god, motors, property).await)
}

/// The same of those that answer.
pub(super) async fn known_counts(god: &God<'_>, motors: Motors, property: Property) -> Answers {
    let is = |row: &&Row| matches!(row.source, Source::Counts(of, _) if of == property);
    match MOTOR.iter().find(is) {
        Some(row) => settings::motors::values(god, row, motors).await,
        None => Answers::default(),
    }
}

/// The same motors with other values.
pub(super) fn mapped(answers: &Answers, to: impl Fn(Motor, i64) -> i64) -> Answers {
    let mut mapped = Answers::default();
    for motor in answers.motors().iter() {
        mapped.set(motor, to(motor, answers.get(motor).unwrap_or(0)));
    }
    mapped
}
