//! Who is selected, and whether it can move.

use tater_wire::{FaultCode, Property};

use crate::boards::Answers;
use crate::god::God;
use crate::motors::{Motors, Prefix, Selection};
use crate::parameter::{MOTOR, Source};
use crate::status::Status;
use crate::units;

/// HALLH: the board knows where its motor is.
const KNOWN: i64 = 1 << 30;

/// OTEMP of a hand that stands any temperature, 0.1 °C (manual 5.4.1).
const NO_LIMIT: i16 = -551;

/// The motors of a prefix. Without one those with EN, which their boards say, awake for it; one that says nothing is not taken for
/// disabled, so that a hand with a dead board says so (ERR 1).
///
/// # Errors
/// None: [`Status::NO_MOTOR`].
pub(super) async fn select(god: &God<'_>, prefix: Prefix) -> Result<Selection, Status> {
    let mut enabled = Motors::ALL;
    if !prefix.given && !prefix.exclusive {
        let awake = god.boards.wake(Motors::ALL).await;
        let axes = awake.of(Motors::LINKS.and(Motors::SPREAD));
        enabled = enabled.but(god.boards.get(axes, Property::EN).await.which(|en| en == 0));
    }
    let selection = prefix.select(enabled);
    if selection.axes.is_empty() { Err(Status::NO_MOTOR) } else { Ok(selection) }
}

/// Makes motors ready to move: awake, and without faults of the past. A failed flash stays known, it stops no motor.
///
/// # Errors
/// As those of [`look`].
pub(super) async fn ready(god: &God<'_>, motors: Motors, initialized: bool) -> Result<(), Status> {
    look(god, motors, initialized).await?;
    let faults = god.boards.get(motors, Property::ERROR).await;
    let storage = i64::from(FaultCode::Storage.code());
    god.boards.set(faults.which(|code| code != 0 && code != storage), Property::STAT, 2).await;
    Ok(())
}

/// Looks whether motors can move: that the hand is not hotter than OTEMP, that their boards answer, and, if they are to be `initialized`, that
/// they know where they are. Wakes those that sleep.
///
/// # Errors
/// The sum of what is against it: [`Status::OVER_TEMPERATURE`] alone, or [`Status::NO_BOARD`] and [`Status::NOT_INITIALIZED`]. S of each motor tells
/// its own.
pub(super) async fn look(god: &God<'_>, motors: Motors, initialized: bool) -> Result<(), Status> {
    let limit = god.parameters.borrow().hand.otemp;
    if limit != NO_LIMIT && god.io.temperature() > limit {
        motors.iter().for_each(|motor| god.note(motor, Status::OVER_TEMPERATURE));
        return Err(Status::OVER_TEMPERATURE);
    }
    let awake = god.boards.wake(motors).await;
    let known = if initialized { god.boards.get(awake, Property::HALLH).await } else { Answers::default() };
    let mut sum = Status::OK;
    for motor in motors.iter() {
        let status = match known.of(motor) {
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
pub(super) async fn lost(god: &God<'_>, motors: Motors) -> Motors {
    god.boards.get(motors, Property::HALLH).await.which(|bits| bits & KNOWN == 0)
}

/// A property of each of those motors.
///
/// # Errors
/// One does not answer: [`Status::NO_BOARD`].
pub(super) async fn all(god: &God<'_>, motors: Motors, property: Property) -> Result<Answers, Status> {
    let answers = god.boards.get(motors, property).await;
    let silent = motors.but(answers.motors());
    silent.iter().for_each(|motor| god.note(motor, Status::NO_BOARD));
    if silent.is_empty() { Ok(answers) } else { Err(Status::NO_BOARD) }
}

/// Where each of those motors is, GCL counts.
///
/// # Errors
/// One does not answer: [`Status::NO_BOARD`].
pub(super) async fn positions(god: &God<'_>, motors: Motors) -> Result<Answers, Status> {
    Ok(mapped(&all(god, motors, Property::P).await?, |_, halls| units::gcl(halls)))
}

/// A parameter of positions or distances of each of those motors, GCL counts: as it was set, while the board's property is the rounding of
/// that (DESIGN 6); what the board cannot hold, such as a negative MPE, it holds as its nearest.
///
/// # Errors
/// One does not answer: [`Status::NO_BOARD`].
pub(super) async fn counts(god: &God<'_>, motors: Motors, property: Property) -> Result<Answers, Status> {
    let halls = all(god, motors, property).await?;
    let place = MOTOR.iter().find_map(|row| match row.source {
        Source::Counts(of, place) if of == property => Some(usize::from(place)),
        _ => None,
    });
    let spec = property.spec();
    let parameters = god.parameters.borrow();
    Ok(mapped(&halls, |motor, halls| {
        let of = parameters.motors.get(motor.index());
        let as_set = of.and_then(|of| of.as_set.get(place?)).map(|&set| i64::from(set));
        let held = |set: i64| units::halls(set).max(spec.min()).min(spec.max());
        as_set.filter(|&set| held(set) == halls).unwrap_or(units::gcl(halls))
    }))
}

/// The same motors with other values.
pub(super) fn mapped(answers: &Answers, to: impl Fn(crate::motors::Motor, i64) -> i64) -> Answers {
    let mut mapped = Answers::default();
    for motor in answers.motors().iter() {
        mapped.put(motor, to(motor, answers.of(motor).unwrap_or(0)));
    }
    mapped
}
