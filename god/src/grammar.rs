//! Parses a line: `[X]<motorPrefixes><command> [<arguments>]` (manual 5.1.1), or one of the lower grammar ([`lower`], manual 3). Case is
//! free, and white space is optional; only two names, or two numbers, need it between them.
//!
//! A line that both grammars can read (decision 0054; the table is in docs/hand.md) is one of the lower grammar if white
//! space precedes its property, where the higher grammar has none: `1 S M 5` sets the mode of motor 1, `1SM5` and `1SM 5` move finger 1 and
//! the spread. A motor named twice is no prefix of the higher grammar, so `4SM5` is `4 S M 5`.

pub mod lower;

use crate::command::{self, GclCommand};
use crate::motors::Prefix;
use crate::status::Status;
use lower::{Reading, Request};

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
    /// A line of the lower grammar.
    Lower(Request),
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
/// [`Status::UNKNOWN_COMMAND`]; [`Status::NO_MOTOR`]: the prefix names a motor that does not exist, or one twice. Of a line of the lower
/// grammar: what is wrong with it.
pub fn parse(line: &str) -> Result<Statement<'_>, Status> {
    let line = line.trim_ascii();
    if line.is_empty() {
        return Ok(Statement::Empty);
    }
    let higher = parse_command(line);
    match lower::read(line) {
        Reading::Line { request, spaced } if spaced || !higher.as_ref().is_ok_and(is_complete) => {
            request.map(Statement::Lower)
        }
        // `123 G FROB` is no command, but looks like one of the lower grammar.
        Reading::Other(status) if matches!(higher, Err(Status::UNKNOWN_COMMAND)) => Err(status),
        Reading::Line { .. } | Reading::Other(_) => higher,
    }
}

fn parse_command(line: &str) -> Result<Statement<'_>, Status> {
    let (prefix, rest) = line.split_at_checked(prefix_len(line)).unwrap_or((line, ""));
    let rest = rest.trim_ascii_start();
    let (name, arguments) = split(rest, |c| c.is_ascii_alphabetic() || c == '?');
    let (name, arguments) = NAMING
        .iter()
        .find_map(|&naming| Some((naming, rest.strip_prefix(naming)?)))
        .unwrap_or((name, arguments));
    let Some(command) = command::find(name) else {
        return Err(if line == "X" { Status::NO_MOTOR } else { Status::UNKNOWN_COMMAND });
    };
    let prefix = Prefix::parse(prefix.as_bytes()).ok_or(Status::NO_MOTOR)?;
    Ok(Statement::Command { command, prefix, arguments: Arguments::of(arguments) })
}

/// Whether a command has a prefix only where it takes one, and as many arguments as it takes, numbers where it takes numbers.
/// The commands that take names are never asked: no property of the lower grammar has the name of one.
fn is_complete(statement: &Statement<'_>) -> bool {
    let Statement::Command { command, prefix, arguments } = statement else { return true };
    let Some(row) = command.row().filter(|row| row.prefix || *prefix == Prefix::default()) else {
        return false;
    };
    match row.arguments.as_bytes() {
        [] => arguments.clone().none().is_ok(),
        [b'[', ..] => arguments.clone().only_number().is_ok(),
        _ => matches!(arguments.clone().only_number(), Ok(Some(_))),
    }
}

/// The commands whose arguments are names. A name may follow one of these without white space.
const NAMING: [&str; 5] = ["?", "FSET", "FGET", "PSET", "PGET"];

/// Length of a line's motor prefix: digits, X, G and S, and white space between them.
fn prefix_len(line: &str) -> usize {
    let is_prefix = |byte: u8| matches!(byte, b'0'..=b'9' | b'X' | b'G' | b'S');
    let end = line.bytes().position(|byte| !is_prefix(byte) && !byte.is_ascii_whitespace());
    end.unwrap_or(line.len())
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
            Ok(Statement::Lower(request)) => format!("{request:?}"),
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
            ("S G HOME", "1111 Home []"),
            ("X 5 G C", "ERR 2"),
            ("14 SM5", "Set(Motors(9), MODE, 5)"),
            ("1 2 S E 82", "Set(Motors(3), E, 82)"),
            ("M -5", "0 M [\"-5\"]"),
            ("M-5", "0 M [\"-5\"]"),
            ("M x5", "0 M [\"x\", \"5\"]"),
            ("4 S E 82", "Set(Motors(8), E, 82)"),
            ("4 S M 5", "Set(Motors(8), MODE, 5)"),
            ("4SM 5", "Set(Motors(8), MODE, 5)"),
            ("4SM5", "Set(Motors(8), MODE, 5)"),
            ("12SM 5", "1011 M [\"5\"]"),
            ("11C", "ERR 2"),
            ("S4C", "ERR 2"),
            ("4SE82", "Set(Motors(8), E, 82)"),
            ("1ST", "1001 T []"),
            ("1ST5", "Set(Motors(1), T, 5)"),
            ("1SVERS5", "Set(Motors(1), VERS, 5)"),
            ("4GVERS", "Get(Motors(8), VERS)"),
            ("XC", "X0 C []"),
            ("123 G TEMP", "Get(Motors(7), TEMP)"),
            ("123GTEMP", "Get(Motors(7), TEMP)"),
            ("123 G FROB", "ERR 64"),
            ("1SX012", "Set(Motors(1), X0, 12)"),
            ("1S STATUS2", "Set(Motors(1), STAT, 2)"),
            ("1GM", "Get(Motors(1), MODE)"),
            ("WAKE", "Wake"),
            ("SAVE", "Save"),
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
