//! Commands on parameters (manual 5.2.2, 5.2.3), and their lists.
//!
//! Several names, or pairs of name and value, may be in one line, as clients send them. All of it is checked before any of it is
//! done: where a pair is wrong, nothing is set.

pub(crate) mod hand;
pub(crate) mod motors;

use crate::command::Command;
use crate::god::God;
use crate::motors::Prefix;
use crate::parameter::Category;
use crate::status::Status;
use crate::words::Arguments;

/// Does it.
pub(crate) async fn execute(
    god: &God<'_>,
    command: Command,
    prefix: Prefix,
    arguments: Arguments<'_>,
) -> Status {
    let takes_arguments = matches!(command, Command::Fset | Command::Fget | Command::Pset | Command::Pget);
    if let (false, Err(status)) = (takes_arguments, arguments.clone().none()) {
        return status;
    }
    match command {
        Command::Pset => hand::set(god, arguments),
        Command::Pget => hand::get(god, arguments).await,
        Command::Pload => hand::load(god),
        Command::Psave => hand::save(god),
        Command::Pdef => hand::default(god),
        Command::Plist => hand::list(god, false).await,
        Command::Plista => hand::list(god, true).await,
        Command::Plistv => hand::list_values(god, false).await,
        Command::Plistav => hand::list_values(god, true).await,
        Command::Flist => motors::list(god, false).await,
        Command::Flista => motors::list(god, true).await,
        command => motors::execute(god, command, prefix, arguments).await,
    }
}

/// Whether a list has a parameter: those for `all` have the advanced ones.
const fn is_listed(category: Category, all: bool) -> bool {
    match category {
        Category::Later => false,
        Category::Advanced => all,
        Category::Movement
        | Category::Status
        | Category::RealTime
        | Category::Global
        | Category::GlobalStatus => true,
    }
}

/// Access and range of a parameter, for what reads names and values.
struct Rule {
    writable: bool,
    min: i64,
    max: i64,
}

/// Finds the row of a name.
type Named<R> = fn(&str) -> Option<&'static R>;

/// The pairs of name and value in a line, by the row that `named` finds; then an error, if one is wrong.
fn pairs<R: 'static>(
    mut arguments: Arguments<'_>,
    named: Named<R>,
    rule: fn(&R) -> Rule,
) -> impl Iterator<Item = Result<(&'static R, i64), Status>> {
    let mut first = true;
    core::iter::from_fn(move || {
        let is_first = core::mem::replace(&mut first, false);
        let name = match arguments.next() {
            Some(name) => name,
            // A command without anything names nothing.
            None => return is_first.then_some(Err(Status::UNKNOWN_PARAMETER)),
        };
        Some(pair(name, arguments.number(), is_first, named, rule))
    })
}

fn pair<R>(
    name: &str,
    value: Option<Result<i64, Status>>,
    is_first: bool,
    named: Named<R>,
    rule: fn(&R) -> Rule,
) -> Result<(&'static R, i64), Status> {
    if value.is_none() && !is_first {
        // A pair and something more.
        return Err(Status::TOO_MANY_ARGUMENTS);
    }
    let row = named(name).ok_or(Status::UNKNOWN_PARAMETER)?;
    let Rule { writable, min, max } = rule(row);
    if !writable {
        return Err(Status::READ_ONLY);
    }
    let value = value.unwrap_or(Err(Status::INVALID_VALUE))?;
    if (min..=max).contains(&value) { Ok((row, value)) } else { Err(Status::INVALID_VALUE) }
}

/// The parameters that a line names.
///
/// # Errors
/// There is none of a name, or no name.
fn names<R: 'static>(
    mut arguments: Arguments<'_>,
    named: Named<R>,
) -> Result<impl Iterator<Item = &'static R>, Status> {
    let all = arguments.clone().all(|name| named(name).is_some());
    if !all || arguments.clone().next().is_none() {
        return Err(Status::UNKNOWN_PARAMETER);
    }
    Ok(core::iter::from_fn(move || named(arguments.next()?)))
}

/// A row of FLIST or PLIST: name, range, what it is for.
async fn describe(god: &God<'_>, name: &str, rule: Rule, help: &str) {
    let Rule { writable, min, max } = rule;
    let access = if writable { "" } else { ", read only" };
    god.answer(format_args!("{name} {min}..{max}{access}; {help}")).await;
}

#[cfg(test)]
mod tests {
    use crate::{io, parameter};
    use std::format;

    /// A longer one would be cut off.
    #[test]
    fn the_longest_row_fits() {
        let motors = parameter::MOTOR.iter().map(|row| (row.name, row.min, row.max, row.help));
        let global = parameter::GLOBAL.iter().map(|row| (row.name, row.min, row.max, row.help));
        for (name, min, max, help) in motors.chain(global) {
            let line = format!("\r\n\r{name} {min}..{max}, read only; {help}");
            assert!(line.len() <= io::TEXT, "{line}");
        }
    }
}
