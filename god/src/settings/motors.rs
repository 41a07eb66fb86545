//! The motors' parameters: FSET, FGET, FLOAD, FSAVE, FDEF and their lists.
//!
//! Without X a finger is one axis: its parameters are set on link and tip, which have the same defaults of DP, DS, CT and OT (manual 5.3),
//! and read from the link. Their defaults of ACCEL differ: X sets each one's own.
//!
//! Without a prefix FSET and FDEF set EN of all seven motors, and everything else of those that have EN: by EN alone no such line would reach a
//! disabled motor again, and FDEF would leave a hand that does not move (decision 0001).

use tater_wire::Property;

use super::arguments::{Rule, describe, is_listed, names, pairs};
use crate::boards::Answers;
use crate::command::GclCommand;
use crate::god::{God, LINE_END};
use crate::grammar::Arguments;
use crate::memory::MotorParameters;
use crate::motors::{Motor, Motors, Prefix, Selection};
use crate::parameter::{self, Kept, MOTOR, ParameterSpec, Source};
use crate::status::Status;
use crate::words::words;
use crate::{order, query};

pub(super) async fn execute(
    god: &God<'_>,
    command: GclCommand,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Status {
    let rule = if god.memory.parameters().hand.compat_262 { rule_262 } else { rule };
    // The line is checked before boards are woken for it.
    let checked = match command {
        GclCommand::Fset => {
            pairs(arguments.clone(), parameter::motor, rule).try_for_each(|pair| pair.map(|_| ()))
        }
        GclCommand::Fget => names(arguments.clone(), parameter::motor).map(|_| ()),
        _ => Ok(()),
    };
    if let Err(status) = checked {
        return status;
    }
    let is_plain = !prefix.given && !prefix.exclusive;
    let set_en = is_plain && matches!(command, GclCommand::Fset | GclCommand::Fdef);
    let selection = match query::selection(god, prefix).await {
        Err(Status::NO_MOTOR) if set_en && sets_en_alone(command, arguments.clone(), rule) => {
            prefix.select(Motors::NONE)
        }
        Ok(selection) => selection,
        Err(status) => return status,
    };
    let motors = selection.motors();
    let is_for_silent = command == GclCommand::Fget && is_status_alone(arguments.clone());
    match query::wake(god, motors).await {
        Err(status) if !is_for_silent => return status,
        _ => {}
    }
    let with_en = if set_en { Motors::ALL } else { motors };
    match command {
        GclCommand::Fset => set(god, pairs(arguments, parameter::motor, rule), motors, with_en).await,
        GclCommand::Fget => get(god, arguments, selection).await,
        GclCommand::Fload => load(god, motors).await,
        GclCommand::Fsave => save(god, motors).await,
        GclCommand::Fdef => reset_to_defaults(god, motors, with_en).await,
        GclCommand::Flistv => list_values(god, selection, false).await,
        GclCommand::Flistav => list_values(god, selection, true).await,
        _ => Status::UNKNOWN_COMMAND,
    }
}

const EN: Source = Source::Board(Property::EN);

/// Whether a line that no motor has EN for has something to do: `FSET EN 1` and FDEF.
fn sets_en_alone(command: GclCommand, arguments: Arguments<'_>, rule: fn(&ParameterSpec) -> Rule) -> bool {
    command == GclCommand::Fdef
        || pairs(arguments, parameter::motor, rule).flatten().all(|(spec, _)| spec.source == EN)
}

/// Whether a FGET asks for S alone, which says of a silent board that it is silent.
fn is_status_alone(arguments: Arguments<'_>) -> bool {
    names(arguments, parameter::motor).is_ok_and(|mut specs| specs.all(|spec| spec.source == Source::Status))
}

fn rule(spec: &ParameterSpec) -> Rule {
    let (min, max) = spec.limits(false);
    Rule { writable: spec.writable, min, max }
}

/// With COMPAT 262.
fn rule_262(spec: &ParameterSpec) -> Rule {
    let (min, max) = spec.limits(true);
    Rule { writable: spec.writable, min, max }
}

type Pair = (&'static ParameterSpec, i64);

/// Sets parameters of motors, and EN of those `with_en`.
async fn set(
    god: &God<'_>,
    pairs: impl Iterator<Item = Result<Pair, Status>>,
    motors: Motors,
    with_en: Motors,
) -> Status {
    let mut status = Status::OK;
    for (spec, value) in pairs.flatten() {
        let motors = if spec.source == EN { with_en } else { motors };
        // A finger is one axis, and has no torque of its own.
        if matches!(spec.source, Source::Kept { kept: Kept::Lct, .. })
            && value != 0
            && motors != Motors::only(Motor::SPREAD)
        {
            status |= Status::INVALID_VALUE;
            continue;
        }
        status |= order::set_parameter(god, spec, &Answers::uniform(motors, value)).await;
    }
    status
}

async fn get(god: &God<'_>, arguments: Arguments<'_>, selection: Selection) -> Status {
    let Ok(specs) = names(arguments, parameter::motor) else { return Status::UNKNOWN_PARAMETER };
    let mut separator = LINE_END;
    for spec in specs {
        let status = print(god, spec, selection, separator).await;
        if !status.is_ok() {
            return status;
        }
        separator = " ";
    }
    Status::OK
}

/// Prints the values of a parameter after a separator, one for each axis.
async fn print(god: &God<'_>, spec: &ParameterSpec, selection: Selection, separator: &str) -> Status {
    let axes = selection.axes;
    let mut values = query::parameter(god, spec, axes).await;
    if spec.source == Source::Status && !selection.exclusive {
        // A finger's status is that of its link and its tip.
        let tips = query::status(god, selection.followers).await;
        values = values.map(|motor, status| status | motor.tip().and_then(|tip| tips.get(tip)).unwrap_or(0));
    }
    if !axes.difference(values.motors()).is_empty() {
        return Status::NO_BOARD;
    }
    if spec.source == Source::Measured(Property::P) {
        note_reported(god, &values);
    }
    let mut separator = separator;
    for motor in axes.iter() {
        god.io.print(words![separator, values.get(motor).unwrap_or(0)]).await;
        separator = " ";
    }
    Status::OK
}

/// RealTime counts its changes of position from the one that the host knows (manual 6.2.3).
fn note_reported(god: &God<'_>, positions: &Answers) {
    for motor in positions.motors().iter() {
        if let Some(Ok(position)) = positions.get(motor).map(TryInto::try_into) {
            god.session.set_reported(motor, position);
        }
    }
}

/// The properties behind the parameters that can be set.
fn properties() -> impl Iterator<Item = Property> {
    MOTOR.iter().filter(|spec| spec.writable).filter_map(|spec| match spec.source {
        Source::Board(property) | Source::Counts { property, .. } => Some(property),
        Source::Measured(_) | Source::Kept { .. } | Source::Status | Source::Fixed(_) => None,
    })
}

async fn save(god: &God<'_>, motors: Motors) -> Status {
    let status = god.boards.save(motors, properties().map(|property| property.id().into())).await;
    let present = god.memory.parameters();
    god.memory.update(|stored| copy(&present.motors, &mut stored.parameters.motors, motors));
    status
}

async fn load(god: &God<'_>, motors: Motors) -> Status {
    for property in properties() {
        god.boards.set(motors, Property::LOAD, property.id().into()).await;
    }
    // A board that answers this has taken the orders before it.
    let silent = motors.difference(god.boards.get(motors, Property::STAT).await.motors());
    let status = if silent.is_empty() { Status::OK } else { Status::NO_BOARD };
    let stored = god.memory.read(|stored| stored.parameters);
    god.memory.change_parameters(|parameters| copy(&stored.motors, &mut parameters.motors, motors));
    status
}

fn copy(from: &[MotorParameters], to: &mut [MotorParameters], motors: Motors) {
    for motor in motors.iter() {
        if let (Some(from), Some(to)) = (from.get(motor.index()), to.get_mut(motor.index())) {
            *to = *from;
        }
    }
}

/// Sets each default, that of EN of those `with_en`: the boards' DEF would reset what is stored as well. Ends at a board that does not answer.
async fn reset_to_defaults(god: &God<'_>, motors: Motors, with_en: Motors) -> Status {
    let mut status = Status::OK;
    for spec in MOTOR.iter().filter(|spec| spec.writable) {
        let motors = if spec.source == EN { with_en } else { motors };
        let defaults = Answers::from_fn(motors, |motor| Some(spec.default_for(motor.kind())));
        status |= order::set_parameter(god, spec, &defaults).await;
        if status.has(Status::NO_BOARD) {
            break;
        }
    }
    status
}

pub(super) async fn list(god: &God<'_>, all: bool) -> Status {
    for spec in MOTOR.iter().filter(|spec| is_listed(spec.category, all)) {
        describe(god, spec.name, rule(spec), spec.help).await;
    }
    Status::OK
}

/// Prints a row for each parameter, below the numbers of the axes.
async fn list_values(god: &God<'_>, selection: Selection, all: bool) -> Status {
    god.print_line(words!["motor"]).await;
    for motor in selection.axes.iter() {
        god.io.print(words![" ", motor.number()]).await;
    }
    for spec in MOTOR.iter().filter(|spec| is_listed(spec.category, all)) {
        god.print_line(words![spec.name]).await;
        let status = print(god, spec, selection, " ").await;
        if !status.is_ok() {
            return status;
        }
    }
    Status::OK
}

#[cfg(test)]
mod tests {
    use crate::testing::type_line;

    #[test]
    fn od_reads_in_thousands_of_gcl_counts() {
        // 110 revolutions of 18 hall counts are 108,900 GCL counts.
        assert_eq!(type_line("1FGET OD", |_, _, _| Some(110)).0, "\r\n\r108\r\n\r=> ");
    }

    #[test]
    fn fset_that_a_board_does_not_take_is_err_128() {
        for (line, answer) in [
            ("1FSET TSTOP 43", "\r\n\rERR 128\r\n\r=> "),
            ("1FSET TSTOP 42", "\r\n\r=> "),
            ("1FGET TSTOP", "\r\n\r42\r\n\r=> "),
        ] {
            assert_eq!(type_line(line, |_, _, _| Some(42)).0, answer);
        }
    }
}
