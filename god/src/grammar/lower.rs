//! The lower grammar, of the walk-through (manual 3, decision 0029): `<nodes> S <property> <value>`, `<nodes> G <property>`, WAKE, SAVE.
//!
//! White space is optional. Properties are the boards' own, in hall counts, by the names of their table; M means MODE, AP means P and STATUS
//! means STAT, as in the manual. Node 0 is GOD, whose one property is REPLY.

use tater_wire::Property;

use crate::motors::{Motor, Motors};
use crate::status::Status;

/// What a line asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// WAKE: wakes all boards.
    Wake,
    /// SAVE: makes the hand ready for power-off.
    Save,
    /// Sets a property of boards.
    Set(Motors, Property, i64),
    /// Prints a property of boards.
    Get(Motors, Property),
    /// Sets REPLY.
    SetReply(i64),
    /// Prints REPLY.
    GetReply,
}

/// A line of this grammar, for help.
#[derive(Clone, Copy, Debug)]
pub struct LineSpec {
    /// The name under which help finds it.
    pub name: &'static str,
    /// The line, as typed.
    pub line: &'static str,
    /// Help text.
    pub help: &'static str,
}

/// Every line of this grammar.
pub const ROWS: &[LineSpec] = &[
    LineSpec { name: "WAKE", line: "WAKE", help: "wakes the boards, which sleep after power-on" },
    LineSpec {
        name: "SAVE",
        line: "SAVE",
        help: "stops the motors, and stores positions and parameters for power-off",
    },
    LineSpec {
        name: "S",
        line: "<boards> S <property> <value>",
        help: "sets a property of boards, as 4 S E 82",
    },
    LineSpec { name: "G", line: "<boards> G <property>", help: "prints a property of boards, as 123 G TEMP" },
];

/// How far a line is one of this grammar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// It names nodes, S or G, and a property; what follows may be wrong.
    Line {
        /// The request, or what is wrong with it.
        request: Result<Request, Status>,
        /// Whether white space precedes the property's name: the higher grammar has none there.
        spaced: bool,
    },
    /// It does not.
    Other(Status),
}

/// Reads a line in upper case, without white space at its ends.
#[must_use]
pub fn read(line: &str) -> Reading {
    let word = |request| Reading::Line { request: Ok(request), spaced: true };
    match line {
        "WAKE" => return word(Request::Wake),
        "SAVE" => return word(Request::Save),
        _ => {}
    }
    let end = line.find(|c: char| !c.is_ascii_digit() && !c.is_ascii_whitespace()).unwrap_or(line.len());
    let (nodes, rest) = line.split_at_checked(end).unwrap_or((line, ""));
    let (is_set, rest) = match (rest.strip_prefix('S'), rest.strip_prefix('G')) {
        _ if nodes.is_empty() => return Reading::Other(Status::UNKNOWN_COMMAND),
        (Some(rest), _) => (true, rest),
        (_, Some(rest)) => (false, rest),
        _ => return Reading::Other(Status::UNKNOWN_COMMAND),
    };
    let is_space = |c: char| c.is_ascii_whitespace();
    let spaced = nodes.contains(is_space) || rest.starts_with(is_space);
    let text = rest.trim_ascii_start();
    // GOD and the boards have no property in common.
    let is_god = nodes.contains('0');
    let Some((name, value)) =
        split(text, |name| if is_god { name == "REPLY" } else { named(name).is_some() })
    else {
        return Reading::Other(Status::UNKNOWN_PARAMETER);
    };
    Reading::Line { request: request(nodes, is_set, name, value), spaced }
}

fn request(nodes: &str, is_set: bool, name: &str, value: &str) -> Result<Request, Status> {
    let mut motors = Motors::NONE;
    for node in nodes.bytes().filter(|node| matches!(node, b'1'..=b'9')) {
        motors = motors.with(Motor::new(node - b'0').ok_or(Status::NO_MOTOR)?);
    }
    if name == "REPLY" {
        return match (motors.is_empty(), is_set) {
            (false, _) => Err(Status::UNKNOWN_PARAMETER),
            (true, true) => number(value).map(Request::SetReply),
            (true, false) => none(value).map(|()| Request::GetReply),
        };
    }
    let property = named(name).ok_or(Status::UNKNOWN_PARAMETER)?;
    if is_set {
        number(value).map(|value| Request::Set(motors, property, value))
    } else {
        none(value).map(|()| Request::Get(motors, property))
    }
}

/// A property's name and the text after it. Without white space between them the name is the shortest that has all letters: `X012` is X0
/// and 12.
fn split(text: &str, is_name: impl Fn(&str) -> bool) -> Option<(&str, &str)> {
    let end = |is: fn(char) -> bool| text.find(is).unwrap_or(text.len());
    let letters = end(|c| !c.is_ascii_alphabetic());
    [end(|c| c.is_ascii_whitespace()), letters, letters + 1]
        .into_iter()
        .filter_map(|end| text.split_at_checked(end))
        .find(|(name, _)| is_name(name))
        .map(|(name, value)| (name, value.trim_ascii()))
}

fn number(value: &str) -> Result<i64, Status> {
    if value.contains(|c: char| c.is_ascii_whitespace()) {
        return Err(Status::TOO_MANY_ARGUMENTS);
    }
    value.parse().map_err(|_| Status::INVALID_VALUE)
}

const fn none(value: &str) -> Result<(), Status> {
    if value.is_empty() { Ok(()) } else { Err(Status::TOO_MANY_ARGUMENTS) }
}

fn named(name: &str) -> Option<Property> {
    match name {
        "M" => Some(Property::MODE),
        "AP" => Some(Property::P),
        "STATUS" => Some(Property::STAT),
        name => Property::named(name),
    }
}
