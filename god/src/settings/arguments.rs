//! Names and values of parameters in a line, and a parameter's row in a list.

use crate::god::God;
use crate::grammar::Arguments;
use crate::parameter::Category;
use crate::status::Status;
use crate::words::words;

pub(super) struct Rule {
    pub writable: bool,
    pub min: i64,
    pub max: i64,
}

pub(super) type Named<R> = fn(&str) -> Option<&'static R>;

/// The pairs of name and value in a line, by the row that `named` finds; the first invalid pair gives an error.
pub(super) fn pairs<R: 'static>(
    mut arguments: Arguments<'_>,
    named: Named<R>,
    rule: fn(&R) -> Rule,
) -> impl Iterator<Item = Result<(&'static R, i64), Status>> {
    let mut first = true;
    core::iter::from_fn(move || {
        let is_first = core::mem::replace(&mut first, false);
        let name = match arguments.next() {
            Some(name) => name,
            // A command without arguments names no parameter.
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
/// [`Status::UNKNOWN_PARAMETER`]: a name is unknown, or missing.
pub(super) fn names<R: 'static>(
    mut arguments: Arguments<'_>,
    named: Named<R>,
) -> Result<impl Iterator<Item = &'static R>, Status> {
    let all = arguments.clone().all(|name| named(name).is_some());
    if !all || arguments.clone().next().is_none() {
        return Err(Status::UNKNOWN_PARAMETER);
    }
    Ok(core::iter::from_fn(move || named(arguments.next()?)))
}

pub(super) const fn is_listed(category: Category, all: bool) -> bool {
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

/// Prints a row of FLIST or PLIST: name, range, purpose.
pub(super) async fn describe(god: &God<'_>, name: &str, rule: Rule, help: &str) {
    let Rule { writable, min, max } = rule;
    let access = if writable { "" } else { ", read only" };
    god.print_line(words![name, " ", min, "..", max, access, "; ", help]).await;
}

#[cfg(test)]
mod tests {
    use crate::{io, parameter};
    use std::format;

    /// A longer one would be cut off.
    #[test]
    fn longest_row_fits_an_output_text() {
        let motors = parameter::MOTOR.iter().map(|row| (row.name, row.min(), row.max(), row.help));
        let hand = parameter::HAND.iter().map(|row| (row.name, row.min, row.max, row.help));
        for (name, min, max, help) in motors.chain(hand) {
            let line = format!("\r\n\r{name} {min}..{max}, read only; {help}");
            assert!(line.len() <= io::TEXT, "{line}");
        }
    }
}
