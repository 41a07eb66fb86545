//! The motors' parameters: FSET, FGET, FLOAD, FSAVE, FDEF and their lists.
//!
//! Without X a finger is one axis: its parameters are set on link and tip, which have the same defaults of DP, DS, CT and OT (manual
//! 5.3), and read from the link. Those of ACCEL differ: X tells them apart.

use tater_wire::Property;

use super::{Rule, describe, is_listed, names, pairs};
use crate::boards::Answers;
use crate::command::Command;
use crate::god::God;
use crate::memory::OfMotor;
use crate::motors::{Motor, Motors, Prefix, Selection};
use crate::movement;
use crate::parameter::{self, MOTOR, Row, Source};
use crate::status::Status;
use crate::units;
use crate::words::Arguments;

/// Does one that takes a prefix.
pub(super) async fn execute(
    god: &God<'_>,
    command: Command,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Status {
    // What a line says is checked before boards are woken for it.
    let checked = match command {
        Command::Fset => {
            pairs(arguments.clone(), parameter::motor, rule).try_for_each(|pair| pair.map(|_| ()))
        }
        Command::Fget => names(arguments.clone(), parameter::motor).map(|_| ()),
        _ => Ok(()),
    };
    if let Err(status) = checked {
        return status;
    }
    let selection = match god.selected(prefix).await {
        Ok(selection) => selection,
        Err(status) => return status,
    };
    let motors = selection.motors();
    match command {
        Command::Fset => set(god, arguments, motors).await,
        Command::Fget => get(god, arguments, selection).await,
        Command::Fload => load(god, motors).await,
        Command::Fsave => save(god, motors).await,
        Command::Fdef => default(god, motors).await,
        Command::Flistv => list_values(god, selection, false).await,
        Command::Flistav => list_values(god, selection, true).await,
        _ => Status::UNKNOWN_COMMAND,
    }
}

const fn rule(row: &Row) -> Rule {
    Rule { writable: row.writable, min: row.min, max: row.max }
}

// --- one parameter --------------------------------------------------------------------------------------

/// What a property of a board is while the parameter has that value, GCL counts: the nearest that it can be. MPE is no less than 0
/// there, which comes to the same: a motion ends as near as can be, and GOD judges it (DESIGN 6).
#[must_use]
fn on_board(property: Property, value: i64) -> i64 {
    let rules = property.rules();
    units::halls(value).max(rules.min()).min(rules.max())
}

/// The values of a parameter; of a motor whose board does not answer there is none.
pub(crate) async fn values(god: &God<'_>, row: &Row, motors: Motors) -> Answers {
    match row.source {
        Source::Board(property) => god.boards.get(motors, property).await,
        Source::Measured(property) => {
            let halls = god.boards.get(motors, property).await;
            each(motors, |motor| halls.get(motor).map(units::gcl))
        }
        Source::Counts(property, place) => {
            let halls = god.boards.get(motors, property).await;
            each(motors, |motor| {
                let halls = halls.get(motor)?;
                let as_set = of_motor(god, motor)
                    .and_then(|of| of.as_set.get(usize::from(place)).copied())
                    .map(i64::from)
                    .filter(|&as_set| on_board(property, as_set) == halls);
                // Somebody else has set it on the board.
                Some(as_set.unwrap_or(units::gcl(halls)))
            })
        }
        Source::Kept(kept) => each(motors, |motor| of_motor(god, motor).map(|of| of.of(kept).into())),
        Source::Status => status_of(god, motors).await,
        Source::Fixed(value) => each(motors, |_| Some(value)),
    }
}

/// The status of motors: what their last motion came to, and whether they know where they are now.
async fn status_of(god: &God<'_>, motors: Motors) -> Answers {
    let lost = movement::lost(god, motors).await;
    each(motors, |motor| {
        // Where it once did not, it may now.
        let last = god.result(motor).code() & !Status::NOT_INITIALIZED.code();
        let lost = if lost.has(motor) { Status::NOT_INITIALIZED } else { Status::OK };
        Some((Status::of(last) | lost).code().into())
    })
}

/// Sets a parameter. A SET to a board is verified by a GET.
///
/// # Errors
/// A board does not answer, or has another value.
async fn put(god: &God<'_>, row: &Row, values: &Answers) -> Status {
    match row.source {
        Source::Board(property) => put_on_boards(god, property, values).await,
        Source::Counts(property, place) => {
            let halls =
                each(values.motors(), |motor| values.get(motor).map(|value| on_board(property, value)));
            let status = put_on_boards(god, property, &halls).await;
            change(god, values, |of, value| {
                if let (Some(to), Ok(value)) = (of.as_set.get_mut(usize::from(place)), value.try_into()) {
                    *to = value;
                }
            });
            status
        }
        Source::Kept(kept) => {
            change(god, values, |of, value| of.keep(kept, value));
            Status::OK
        }
        // There is one value, and it is in range.
        Source::Fixed(_) => Status::OK,
        Source::Measured(_) | Source::Status => Status::READ_ONLY,
    }
}

async fn put_on_boards(god: &God<'_>, property: Property, values: &Answers) -> Status {
    let motors = values.motors();
    god.boards.set_each(property, values).await;
    let found = god.boards.get(motors, property).await;
    let mut status = Status::OK;
    for motor in motors.iter() {
        status |= match found.get(motor) {
            None => Status::NO_BOARD,
            found if found == values.get(motor) => Status::OK,
            Some(_) => Status::INVALID_VALUE,
        };
    }
    status
}

fn each(motors: Motors, value: impl Fn(Motor) -> Option<i64>) -> Answers {
    let mut answers = Answers::default();
    for motor in motors.iter() {
        if let Some(value) = value(motor) {
            answers.set(motor, value);
        }
    }
    answers
}

fn of_motor(god: &God<'_>, motor: Motor) -> Option<OfMotor> {
    god.parameters.borrow().motors.get(motor.index()).copied()
}

fn change(god: &God<'_>, values: &Answers, change: impl Fn(&mut OfMotor, i64)) {
    let mut parameters = god.parameters.borrow_mut();
    for motor in values.motors().iter() {
        if let (Some(of), Some(value)) = (parameters.motors.get_mut(motor.index()), values.get(motor)) {
            change(of, value);
        }
    }
}

// --- the commands ---------------------------------------------------------------------------------------

async fn set(god: &God<'_>, arguments: Arguments<'_>, motors: Motors) -> Status {
    let mut status = Status::OK;
    for (row, value) in pairs(arguments, parameter::motor, rule).flatten() {
        status |= put(god, row, &each(motors, |_| Some(value))).await;
    }
    status
}

async fn get(god: &God<'_>, arguments: Arguments<'_>, selection: Selection) -> Status {
    let Ok(rows) = names(arguments, parameter::motor) else { return Status::UNKNOWN_PARAMETER };
    let mut before = crate::god::LINE_END;
    for row in rows {
        let status = print(god, row, selection, before).await;
        if !status.is_ok() {
            return status;
        }
        before = " ";
    }
    Status::OK
}

/// Says the values of a parameter after something else, one an axis.
async fn print(god: &God<'_>, row: &Row, selection: Selection, before: &str) -> Status {
    let axes = selection.axes;
    let mut values = values(god, row, axes).await;
    if row.source == Source::Status && !selection.exclusive {
        // What has come to the tip has come to the finger.
        let tips = status_of(god, axes.tips()).await;
        values = each(axes, |motor| {
            let of_tip = motor.tip().and_then(|tip| tips.get(tip)).unwrap_or(0);
            Some(values.get(motor)? | of_tip)
        });
    }
    if !axes.difference(values.motors()).is_empty() {
        return Status::NO_BOARD;
    }
    if row.source == Source::Measured(Property::P) {
        note_reported(god, &values);
    }
    let mut before = before;
    for motor in axes.iter() {
        god.io.print(format_args!("{before}{}", values.get(motor).unwrap_or(0))).await;
        before = " ";
    }
    Status::OK
}

/// RealTime counts its changes of position from what the host has heard last (manual 6.2.3).
fn note_reported(god: &God<'_>, values: &Answers) {
    let mut reported = god.reported.get();
    for motor in values.motors().iter() {
        let value = values.get(motor).and_then(|value| value.try_into().ok());
        if let (Some(to), Some(value)) = (reported.get_mut(motor.index()), value) {
            *to = value;
        }
    }
    god.reported.set(reported);
}

/// The properties behind the parameters that can be set.
fn properties() -> impl Iterator<Item = Property> {
    MOTOR.iter().filter(|row| row.writable).filter_map(|row| match row.source {
        Source::Board(property) | Source::Counts(property, _) => Some(property),
        Source::Measured(_) | Source::Kept(_) | Source::Status | Source::Fixed(_) => None,
    })
}

async fn save(god: &God<'_>, motors: Motors) -> Status {
    let status = god.boards.save(motors, properties().map(|property| property.id().into())).await;
    let present = *god.parameters.borrow();
    god.memory.change(|stored| copy(&present.motors, &mut stored.parameters.motors, motors));
    status
}

async fn load(god: &God<'_>, motors: Motors) -> Status {
    for property in properties() {
        god.boards.set(motors, Property::LOAD, property.id().into()).await;
    }
    // An answer comes after what was asked before it.
    let silent = motors.difference(god.boards.get(motors, Property::STAT).await.motors());
    let status = if silent.is_empty() { Status::OK } else { Status::NO_BOARD };
    let stored = god.memory.look(|stored| stored.parameters);
    copy(&stored.motors, &mut god.parameters.borrow_mut().motors, motors);
    status
}

fn copy(from: &[OfMotor], to: &mut [OfMotor], motors: Motors) {
    for motor in motors.iter() {
        if let (Some(from), Some(to)) = (from.get(motor.index()), to.get_mut(motor.index())) {
            *to = *from;
        }
    }
}

/// SETs of the defaults: the boards' DEF would reset what is stored, too.
async fn default(god: &God<'_>, motors: Motors) -> Status {
    let mut status = Status::OK;
    for row in MOTOR.iter().filter(|row| row.writable) {
        status |= put(god, row, &each(motors, |motor| Some(row.default_for(motor.kind())))).await;
    }
    status
}

pub(super) async fn list(god: &God<'_>, all: bool) -> Status {
    for row in MOTOR.iter().filter(|row| is_listed(row.category, all)) {
        describe(god, row.name, rule(row), row.help).await;
    }
    Status::OK
}

async fn list_values(god: &God<'_>, selection: Selection, all: bool) -> Status {
    for row in MOTOR.iter().filter(|row| is_listed(row.category, all)) {
        god.answer(format_args!("{}", row.name)).await;
        let status = print(god, row, selection, " ").await;
        if !status.is_ok() {
            return status;
        }
    }
    Status::OK
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::Memory;
    use crate::{Io, io};
    use std::pin::pin;
    use std::string::String;
    use tater_wire::{Body, Destination, Message};

    /// What GOD says to a line while seven boards are awake that obey nothing and answer 42 to whatever is asked.
    fn told(line: &str) -> String {
        let (io, memory) = (Io::default(), Memory::default());
        let mut god = pin!(crate::run(&io, &memory));
        let mut said = String::new();
        line.bytes().chain([b'\r']).for_each(|byte| io.push_rx(byte));
        for ms in 0..1000 {
            io::poll(god.as_mut(), &io, ms * 1000);
            while let Some(frame) = io.pop_frame() {
                let message = Message::parse(&frame).expect("GOD's");
                let (Destination::Node(node), Body::Get(id)) = (message.to, message.body) else { continue };
                let property = Property::of(id).expect("GOD's");
                let value = if property == Property::STAT { 2 } else { 42 };
                io.push_frame(&Message::reply(node, property, value).expect("it fits").frame());
            }
            said.extend(core::iter::from_fn(|| io.pop_tx()).map(char::from));
        }
        said.rsplit_once(line).expect("the echo").1.into()
    }

    #[test]
    fn what_a_board_does_not_do_is_told() {
        assert_eq!(told("1FSET TSTOP 43"), "\r\n\rERR 128\r\n\r=> ");
        assert_eq!(told("1FSET TSTOP 42"), "\r\n\r=> ");
        assert_eq!(told("1FGET TSTOP"), "\r\n\r42\r\n\r=> ");
    }
}
