//! Questions to the boards: which motors are selected, whether they can move, values and positions in the language's units.

use tater_wire::{FaultCode, Property};

use crate::boards::Answers;
use crate::god::God;
use crate::memory::MotorParameters;
use crate::motors::{Motor, Motors, Prefix, Selection};
use crate::parameter::{MOTOR, ParameterSpec, Source};
use crate::status::Status;
use crate::units;

/// HALLH: the board knows its motor's position.
const POSITION_KNOWN: i64 = 1 << 30;

/// OTEMP of a hand without a limit, 0.1 °C (manual 5.4.1).
const NO_LIMIT: i16 = -551;

/// The motors of a prefix. Without one those with EN, for which all boards are woken. A board that does not answer counts as enabled, so
/// that a hand with a dead board reports it.
///
/// # Errors
/// [`Status::NO_MOTOR`]: none is selected.
pub(crate) async fn selection(god: &God<'_>, prefix: Prefix) -> Result<Selection, Status> {
    let mut enabled = Motors::ALL;
    if !prefix.given && !prefix.exclusive {
        let awake = god.boards.wake(Motors::ALL).await;
        enabled = enabled.difference(god.boards.get(awake, Property::EN).await.filter(|en| en == 0));
    }
    let selection = prefix.select(enabled);
    if selection.axes.is_empty() { Err(Status::NO_MOTOR) } else { Ok(selection) }
}

/// Wakes the boards of motors.
///
/// # Errors
/// [`Status::NO_BOARD`]: one does not answer.
pub(crate) async fn wake(god: &God<'_>, motors: Motors) -> Result<(), Status> {
    let silent = motors.difference(god.boards.wake(motors).await);
    if silent.is_empty() { Ok(()) } else { Err(Status::NO_BOARD) }
}

/// The motors whose number two boards have. Asks only about suspects, so that a hand whose boards are seven loses no time.
pub(crate) async fn doubled(god: &God<'_>, motors: Motors) -> Motors {
    let suspects = god.boards.suspects().intersection(motors);
    if suspects.is_empty() {
        return Motors::NONE;
    }
    let (_, second) = god.boards.find_doubled(suspects).await;
    second.motors()
}

pub(crate) fn is_too_hot(god: &God<'_>) -> bool {
    let limit = god.memory.parameters().hand.otemp;
    limit != NO_LIMIT && god.io.temperature() > limit
}

/// Checks that motors can move: the hand is not hotter than OTEMP, one board of each answers, and, if they must be `initialized`, know their
/// positions. Wakes those that sleep.
///
/// # Errors
/// [`Status::OVER_TEMPERATURE`] alone, or the sum of [`Status::NO_BOARD`] and [`Status::NOT_INITIALIZED`]. S has each motor's own.
pub(crate) async fn check_ready(god: &God<'_>, motors: Motors, initialized: bool) -> Result<(), Status> {
    if is_too_hot(god) {
        motors.iter().for_each(|motor| god.session.set_result(motor, Status::OVER_TEMPERATURE));
        return Err(Status::OVER_TEMPERATURE);
    }
    let awake = god.boards.wake(motors).await;
    let halls = if initialized { god.boards.get(awake, Property::HALLH).await } else { Answers::default() };
    let doubled = doubled(god, awake).await;
    let mut sum = Status::OK;
    for motor in motors.iter() {
        let status = match halls.get(motor) {
            _ if !awake.has(motor) || doubled.has(motor) => Status::NO_BOARD,
            None if initialized => Status::NO_BOARD,
            Some(bits) if bits & POSITION_KNOWN == 0 => Status::NOT_INITIALIZED,
            _ => continue,
        };
        god.session.set_result(motor, status);
        sum |= status;
    }
    if sum.is_ok() { Ok(()) } else { Err(sum) }
}

/// The motors whose boards answer that they do not know their position.
pub(crate) async fn uninitialized(god: &God<'_>, motors: Motors) -> Motors {
    god.boards.get(motors, Property::HALLH).await.filter(|bits| bits & POSITION_KNOWN == 0)
}

/// A property of each of those motors, in the board's unit.
///
/// # Errors
/// [`Status::NO_BOARD`]: one does not answer.
pub(crate) async fn property(god: &God<'_>, motors: Motors, property: Property) -> Result<Answers, Status> {
    complete(god, motors, god.boards.get(motors, property).await)
}

/// The position of each of those motors, GCL counts.
///
/// # Errors
/// [`Status::NO_BOARD`]: one does not answer.
pub(crate) async fn positions(god: &God<'_>, motors: Motors) -> Result<Answers, Status> {
    complete(god, motors, known_positions(god, motors).await)
}

/// The same of those that answer.
pub(crate) async fn known_positions(god: &God<'_>, motors: Motors) -> Answers {
    god.boards.get(motors, Property::P).await.map(|_, halls| units::gcl_from_halls(halls))
}

/// A parameter in counts of each of those motors, as FGET prints it, by its property.
///
/// # Errors
/// [`Status::NO_BOARD`]: one does not answer.
pub(crate) async fn counts(god: &God<'_>, motors: Motors, property: Property) -> Result<Answers, Status> {
    complete(god, motors, known_counts(god, motors, property).await)
}

/// The same of those that answer.
pub(crate) async fn known_counts(god: &God<'_>, motors: Motors, property: Property) -> Answers {
    let is =
        |spec: &&ParameterSpec| matches!(spec.source, Source::Counts { property: of, .. } if of == property);
    match MOTOR.iter().find(is) {
        Some(spec) => parameter(god, spec, motors).await,
        None => Answers::default(),
    }
}

fn complete(god: &God<'_>, motors: Motors, answers: Answers) -> Result<Answers, Status> {
    let silent = motors.difference(answers.motors());
    silent.iter().for_each(|motor| god.session.set_result(motor, Status::NO_BOARD));
    if silent.is_empty() { Ok(answers) } else { Err(Status::NO_BOARD) }
}

/// The values of a parameter; a motor whose board does not answer has none.
pub(crate) async fn parameter(god: &God<'_>, spec: &ParameterSpec, motors: Motors) -> Answers {
    match spec.source {
        Source::Board(property) => god.boards.get(motors, property).await,
        Source::Measured(Property::OD) => god
            .boards
            .get(motors, Property::OD)
            .await
            .map(|_, revolutions| units::gcl_thousands_from_revolutions(revolutions)),
        Source::Measured(property) => {
            god.boards.get(motors, property).await.map(|_, halls| units::gcl_from_halls(halls))
        }
        Source::Counts { property, place, .. } => {
            let on_board = god.boards.get(motors, property).await;
            let as_set = |motor: Motor| {
                let as_set = motor_parameters(god, motor)?.as_set.get(usize::from(place)).copied()?;
                Some(i64::from(as_set))
            };
            on_board.map(|motor, halls| {
                // Another host may have changed the board's value.
                let same = as_set(motor).filter(|&as_set| counts_on_board(motor, property, as_set) == halls);
                same.unwrap_or(units::gcl_from_halls(halls))
            })
        }
        Source::Kept { kept, .. } => {
            Answers::from_fn(motors, |motor| motor_parameters(god, motor).map(|of| of.value(kept).into()))
        }
        Source::Status => status(god, motors).await,
        Source::Fixed(value) => Answers::uniform(motors, value),
    }
}

/// S of each motor: what ended its last motion, and what would refuse the next one now. Every motor has one: of a silent board it is 1.
pub(crate) async fn status(god: &God<'_>, motors: Motors) -> Answers {
    let halls = god.boards.get(motors, Property::HALLH).await;
    let errors = god.boards.get(halls.motors(), Property::ERROR).await;
    let doubled = doubled(god, halls.motors()).await;
    let is_hot = is_too_hot(god);
    Answers::from_fn(motors, |motor| {
        let mut status = god.session.result(motor).of_motion();
        let (Some(halls), Some(error)) = (halls.get(motor), errors.get(motor)) else {
            return Some((status | Status::NO_BOARD).code().into());
        };
        let fault = FaultCode::of(error);
        if doubled.has(motor) {
            status |= Status::NO_BOARD;
        }
        if halls & POSITION_KNOWN == 0 {
            status |= Status::NOT_INITIALIZED;
        }
        if is_hot || fault == Some(FaultCode::OverTemperature) {
            status |= Status::OVER_TEMPERATURE;
        }
        // As of a motion: 8 where nothing else says it. A storage fault stops no motor.
        if status.is_ok() && error != 0 && fault != Some(FaultCode::Storage) {
            status |= Status::FAULT;
        }
        Some(status.code().into())
    })
}

/// The board's value of a parameter in GCL counts: the nearest hall count in the property's range. MPE below 0 is 0 there, which is the
/// same to the board: the motion ends as near as possible, and GOD judges it.
#[must_use]
pub(crate) fn counts_on_board(motor: Motor, property: Property, gcl: i64) -> i64 {
    let rules = property.rules();
    let halls = units::halls_from_gcl(gcl).max(rules.min()).min(rules.max());
    // A row of counts fits 32 bits.
    i32::try_from(halls).map_or(halls, |halls| motor.kind().bounded(property, halls).into())
}

fn motor_parameters(god: &God<'_>, motor: Motor) -> Option<MotorParameters> {
    god.memory.parameters().motors.get(motor.index()).copied()
}
