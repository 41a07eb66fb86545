//! Parses a line: `[X]<motorPrefixes><command> [<arguments>]` (manual 5.1.1). Case is free, and so is white space where a line can be read in
//! one way only. Two names, or two numbers, need it between them.
//!
//! The walk-through's grammar, `<nodes> S <property> <value>` and `<nodes> G <property>` (manual 3), takes precedence where white space
//! separates its numbers from its letter: `4 S M 5` sets a mode, `4SM 5` and `SM 5` move the spread.

use crate::command::{self, GclCommand};
use crate::motors::Prefix;
use crate::status::Status;

/// Lines of the walk-through's grammar that name no node.
pub const WALK_THROUGH: [&str; 2] = ["WAKE", "SAVE"];

/// A parsed line.
#[derive(Clone, Debug)]
pub enum Statement<'a> {
    /// White space only.
    Empty,
    /// A command of the Grasper Control Language.
    Command {
        /// The command.
        command: GclCommand,
        /// Its motor prefix.
        prefix: Prefix,
        /// The text after it.
        arguments: Arguments<'a>,
    },
    /// A line of the walk-through's grammar.
    WalkThrough(&'a str),
}

/// The arguments of a command: names and numbers, one after another.
#[derive(Clone, Debug)]
pub struct Arguments<'a>(&'a str);

impl<'a> Arguments<'a> {
    /// The arguments in a text.
    #[must_use]
    pub const fn of(text: &'a str) -> Self {
        Self(text)
    }

    /// The next argument as an integer; `None` at the end.
    ///
    /// # Errors
    /// [`Status::INVALID_VALUE`]: not a number.
    pub fn number(&mut self) -> Option<Result<i64, Status>> {
        self.next().map(|word| word.parse().map_err(|_| Status::INVALID_VALUE))
    }

    /// A command's only argument, a number, which may be missing.
    ///
    /// # Errors
    /// [`Status::INVALID_VALUE`]: not a number. [`Status::TOO_MANY_ARGUMENTS`]: another argument follows.
    pub fn only_number(mut self) -> Result<Option<i64>, Status> {
        let number = self.number().transpose()?;
        self.none().map(|()| number)
    }

    /// Checks that no argument is left.
    ///
    /// # Errors
    /// [`Status::TOO_MANY_ARGUMENTS`]: one is.
    pub fn none(mut self) -> Result<(), Status> {
        if self.next().is_none() { Ok(()) } else { Err(Status::TOO_MANY_ARGUMENTS) }
    }
}

impl<'a> Iterator for Arguments<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        let text = self.0.trim_ascii_start();
        // No name contains a digit, so its number may follow without white space.
        let is_name = text.starts_with(|c: char| c.is_ascii_alphabetic());
        let ends =
            |c: char| c.is_ascii_whitespace() || is_name && (c.is_ascii_digit() || matches!(c, '-' | '+'));
        let (word, rest) = split(text, |c| !ends(c));
        self.0 = rest;
        (!word.is_empty()).then_some(word)
    }
}

/// Parses a line in upper case.
///
/// # Errors
/// [`Status::UNKNOWN_COMMAND`], or [`Status::NO_MOTOR`]: the prefix names a motor that does not exist.
pub fn parse(line: &str) -> Result<Statement<'_>, Status> {
    let line = line.trim_ascii();
    if line.is_empty() {
        return Ok(Statement::Empty);
    }
    if is_walk_through(line) {
        return Ok(Statement::WalkThrough(line));
    }
    let (prefix, rest) = line.split_at_checked(prefix_len(line)).unwrap_or((line, ""));
    let rest = rest.trim_ascii_start();
    let (name, arguments) = split(rest, |c| c.is_ascii_alphabetic() || c == '?');
    let (name, arguments) = NAMING
        .iter()
        .find_map(|&naming| Some((naming, rest.strip_prefix(naming)?)))
        .unwrap_or((name, arguments));
    let Some(command) = command::find(name) else {
        // `4SE82` is no command, but the walk-through's grammar without its spaces; `WAKE` and `SAVE` are its words.
        return if line == "X" {
            Err(Status::NO_MOTOR)
        } else if prefix.starts_with(|c: char| c.is_ascii_digit()) || WALK_THROUGH.contains(&line) {
            Ok(Statement::WalkThrough(line))
        } else {
            Err(Status::UNKNOWN_COMMAND)
        };
    };
    let prefix = Prefix::parse(prefix.as_bytes()).ok_or(Status::NO_MOTOR)?;
    Ok(Statement::Command { command, prefix, arguments: Arguments::of(arguments) })
}

/// The commands whose arguments are names. A name may follow one of these without white space.
const NAMING: [&str; 5] = ["?", "FSET", "FGET", "PSET", "PGET"];

/// Length of a line's motor prefix: digits, X, G and S, and white space before digits; S or G after white space belongs to the walk-through's
/// grammar.
fn prefix_len(line: &str) -> usize {
    let mut len = 0;
    for (at, byte) in line.bytes().enumerate() {
        match byte {
            b'0'..=b'9' => len = at + 1,
            b'X' | b'G' | b'S' if len == at => len = at + 1,
            _ if byte.is_ascii_whitespace() => {}
            _ => break,
        }
    }
    len
}

/// Whether a line begins as the walk-through's grammar does: numbers, white space, S or G, and more.
fn is_walk_through(line: &str) -> bool {
    let (nodes, rest) = split(line, |c| c.is_ascii_digit());
    let words = rest.trim_ascii_start();
    !nodes.is_empty()
        && words.len() < rest.len()
        && words
            .strip_prefix(['S', 'G'])
            .is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_whitespace()))
}

/// Splits off the longest start whose characters are all `wanted`.
fn split(text: &str, wanted: impl Fn(char) -> bool) -> (&str, &str) {
    let end = text.find(|c| !wanted(c)).unwrap_or(text.len());
    text.split_at_checked(end).unwrap_or((text, ""))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::format;
    use std::string::String;

    fn parsed(line: &str) -> String {
        match parse(line) {
            Ok(Statement::Empty) => "-".into(),
            Ok(Statement::WalkThrough(line)) => format!("walk-through {line}"),
            Ok(Statement::Command { command, prefix, arguments }) => {
                let exclusive = if prefix.exclusive { "X" } else { "" };
                let words: std::vec::Vec<_> = arguments.collect();
                format!("{exclusive}{:b} {command:?} {words:?}", prefix.named.bits())
            }
            Err(status) => format!("ERR {}", status.code()),
        }
    }

    #[test]
    fn parse_reads_lines_as_the_manual_means() {
        for (line, expected) in [
            ("", "-"),
            ("  ", "-"),
            ("C", "0 C []"),
            ("SC", "1000 C []"),
            ("GO", "111 O []"),
            ("STC", "1000 Tc []"),
            ("SGHOME", "1111 Home []"),
            ("12IO 5000", "11 Io [\"5000\"]"),
            ("13M1000", "101 M [\"1000\"]"),
            ("X567PTM -5000", "X1110000 Ptm [\"-5000\"]"),
            ("X35C", "X10100 C []"),
            ("SFSET DS 100", "1000 Fset [\"DS\", \"100\"]"),
            ("  123 FSET  LCV 1 LCVC 1", "111 Fset [\"LCV\", \"1\", \"LCVC\", \"1\"]"),
            ("?HI", "0 Help [\"HI\"]"),
            ("?", "0 Help []"),
            ("A?", "0 HelpAll []"),
            ("ERR 3", "0 Err [\"3\"]"),
            ("ERR3", "0 Err [\"3\"]"),
            ("FGETP DP", "0 Fget [\"P\", \"DP\"]"),
            ("SFSETDS100", "1000 Fset [\"DS\", \"100\"]"),
            ("1 2FSET\tDS-100 DP 5", "11 Fset [\"DS\", \"-100\", \"DP\", \"5\"]"),
            ("PGETTEMP", "0 Pget [\"TEMP\"]"),
            ("X 1 5 FGET P", "X10001 Fget [\"P\"]"),
            ("S 1HOME", "1001 Home []"),
            ("S G HOME", "ERR 32"),
            ("14 SM5", "walk-through 14 SM5"),
            ("1 2 S E 82", "walk-through 1 2 S E 82"),
            ("M -5", "0 M [\"-5\"]"),
            ("M-5", "0 M [\"-5\"]"),
            ("M x5", "0 M [\"x\", \"5\"]"),
            ("4 S E 82", "walk-through 4 S E 82"),
            ("4 S M 5", "walk-through 4 S M 5"),
            ("4SM 5", "1000 M [\"5\"]"),
            ("4SE82", "walk-through 4SE82"),
            ("123 G TEMP", "walk-through 123 G TEMP"),
            ("123GTEMP", "walk-through 123GTEMP"),
            ("1GM", "111 M []"),
            ("WAKE", "walk-through WAKE"),
            ("SAVE", "walk-through SAVE"),
            ("5C", "ERR 2"),
            ("1XC", "ERR 2"),
            ("FROB", "ERR 32"),
            ("S", "ERR 32"),
            ("X", "ERR 2"),
            ("XS", "ERR 32"),
            ("FGETS", "0 Fget [\"S\"]"),
            ("=", "ERR 32"),
        ] {
            assert_eq!(parsed(line), expected, "{line:?}");
        }
    }
}
