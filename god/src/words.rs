//! A line becomes a command: `[X]<motorPrefixes><command> [<arguments>]` (manual 5.1.1), case and white space free: there may be more of it
//! than is needed, or none, as far as a line can then be read in one way. Two names, or two numbers, need it between them.
//!
//! The walk-through's lower grammar, `<nodes> S <property> <value>` and `<nodes> G <property>` (manual 3), goes first where white space
//! parts its numbers from its letter: `4 S M 5` sets a mode, `4SM 5` and `SM 5` move the spread.

use crate::command::{self, Command};
use crate::motors::Prefix;
use crate::status::Status;

/// Lines of the lower grammar that name no node.
pub const LOWER: [&str; 2] = ["WAKE", "SAVE"];

/// What a line says.
#[derive(Clone, Debug)]
pub enum Words<'a> {
    /// Nothing.
    Empty,
    /// A command of the Grasper Control Language.
    Command {
        /// Which.
        command: Command,
        /// Its motors.
        prefix: Prefix,
        /// What follows it.
        arguments: Arguments<'a>,
    },
    /// A line of the lower grammar.
    Lower(&'a str),
}

/// What follows a command: names and numbers, one after another.
#[derive(Clone, Debug)]
pub struct Arguments<'a>(&'a str);

impl<'a> Arguments<'a> {
    /// The words of a text.
    #[must_use]
    pub const fn of(text: &'a str) -> Self {
        Self(text)
    }

    /// The next one, as a whole number; `None` if there is none.
    ///
    /// # Errors
    /// Not a number: [`Status::INVALID_VALUE`].
    pub fn number(&mut self) -> Option<Result<i64, Status>> {
        self.next().map(|word| word.parse().map_err(|_| Status::INVALID_VALUE))
    }

    /// A command's only argument, which may be missing.
    ///
    /// # Errors
    /// Not a number, or another one after it.
    pub fn only_number(mut self) -> Result<Option<i64>, Status> {
        let number = self.number().transpose()?;
        self.none().map(|()| number)
    }

    /// That there is nothing more.
    ///
    /// # Errors
    /// There is: [`Status::TOO_MANY_ARGUMENTS`].
    pub fn none(mut self) -> Result<(), Status> {
        if self.next().is_none() { Ok(()) } else { Err(Status::TOO_MANY_ARGUMENTS) }
    }
}

impl<'a> Iterator for Arguments<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        let text = self.0.trim_ascii_start();
        // No name has a digit in it: its number may follow at once.
        let is_name = text.starts_with(|c: char| c.is_ascii_alphabetic());
        let ends =
            |c: char| c.is_ascii_whitespace() || is_name && (c.is_ascii_digit() || matches!(c, '-' | '+'));
        let (word, rest) = split(text, |c| !ends(c));
        self.0 = rest;
        (!word.is_empty()).then_some(word)
    }
}

/// Reads a line in upper case.
///
/// # Errors
/// There is no such command, or its prefix selects motors that there are not.
pub fn parse(line: &str) -> Result<Words<'_>, Status> {
    let line = line.trim_ascii();
    if line.is_empty() {
        return Ok(Words::Empty);
    }
    if is_lower(line) {
        return Ok(Words::Lower(line));
    }
    let (prefix, rest) = line.split_at_checked(prefix_len(line)).unwrap_or((line, ""));
    let rest = rest.trim_ascii_start();
    let (name, arguments) = split(rest, |c| c.is_ascii_alphabetic() || c == '?');
    // A name may follow these at once.
    let (name, arguments) = NAMING
        .iter()
        .find_map(|&naming| Some((naming, rest.strip_prefix(naming)?)))
        .unwrap_or((name, arguments));
    let Some(command) = command::named(name) else {
        // `4SE82`: no command, but the lower grammar without its spaces; `WAKE` and `SAVE` are its words.
        return if line == "X" {
            Err(Status::NO_MOTOR)
        } else if prefix.starts_with(|c: char| c.is_ascii_digit()) || LOWER.contains(&line) {
            Ok(Words::Lower(line))
        } else {
            Err(Status::UNKNOWN_COMMAND)
        };
    };
    let prefix = Prefix::parse(prefix.as_bytes()).ok_or(Status::NO_MOTOR)?;
    Ok(Words::Command { command, prefix, arguments: Arguments::of(arguments) })
}

/// The commands that take names.
const NAMING: [&str; 5] = ["?", "FSET", "FGET", "PSET", "PGET"];

/// How many characters of a line are its motors: digits, X, G and S, and white space before digits; S or G after white space is the
/// lower grammar's.
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

/// Whether a line begins as the lower grammar does: numbers, white space, S or G, and not its end.
fn is_lower(line: &str) -> bool {
    let (nodes, rest) = split(line, |c| c.is_ascii_digit());
    let words = rest.trim_ascii_start();
    !nodes.is_empty()
        && words.len() < rest.len()
        && words
            .strip_prefix(['S', 'G'])
            .is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_whitespace()))
}

/// The longest beginning whose characters all are `wanted`, and the rest.
fn split(text: &str, wanted: impl Fn(char) -> bool) -> (&str, &str) {
    let end = text.find(|c| !wanted(c)).unwrap_or(text.len());
    text.split_at_checked(end).unwrap_or((text, ""))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::format;
    use std::string::String;

    fn told(line: &str) -> String {
        match parse(line) {
            Ok(Words::Empty) => "-".into(),
            Ok(Words::Lower(line)) => format!("lower {line}"),
            Ok(Words::Command { command, prefix, arguments }) => {
                let exclusive = if prefix.exclusive { "X" } else { "" };
                let words: std::vec::Vec<_> = arguments.collect();
                format!("{exclusive}{:b} {command:?} {words:?}", prefix.named.bits())
            }
            Err(status) => format!("ERR {}", status.code()),
        }
    }

    #[test]
    fn lines_are_what_the_manual_means() {
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
            ("14 SM5", "lower 14 SM5"),
            ("1 2 S E 82", "lower 1 2 S E 82"),
            ("M -5", "0 M [\"-5\"]"),
            ("M-5", "0 M [\"-5\"]"),
            ("M x5", "0 M [\"x\", \"5\"]"),
            ("4 S E 82", "lower 4 S E 82"),
            ("4 S M 5", "lower 4 S M 5"),
            ("4SM 5", "1000 M [\"5\"]"),
            ("4SE82", "lower 4SE82"),
            ("123 G TEMP", "lower 123 G TEMP"),
            ("123GTEMP", "lower 123GTEMP"),
            ("1GM", "111 M []"),
            ("WAKE", "lower WAKE"),
            ("SAVE", "lower SAVE"),
            ("5C", "ERR 2"),
            ("1XC", "ERR 2"),
            ("FROB", "ERR 32"),
            ("S", "ERR 32"),
            ("X", "ERR 2"),
            ("XS", "ERR 32"),
            ("FGETS", "0 Fget [\"S\"]"),
            ("=", "ERR 32"),
        ] {
            assert_eq!(told(line), expected, "{line:?}");
        }
    }
}
