//! Errors in a TOML file: its line, and the field.

use traces::input::{BadInput, clipped, did_you_mean, shorten};

/// A file's text and name, to turn byte offsets into line numbers.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// The file's name.
    pub file: &'a str,
    /// Its text.
    pub text: &'a str,
}

impl Source<'_> {
    /// An error at `span`, the bytes of the text; what was found is its line.
    #[must_use]
    pub fn error(
        self,
        span: std::ops::Range<usize>,
        problem: impl Into<String>,
        expected: impl Into<String>,
        next: impl Into<String>,
    ) -> BadInput {
        let start = span.start.min(self.text.len());
        let line = 1 + self.text.bytes().take(start).filter(|byte| *byte == b'\n').count();
        let found = self.text.lines().nth(line - 1).unwrap_or("").trim();
        let found = if found.is_empty() { "the end of the file" } else { found };
        BadInput {
            place: format!("{}:{line}", self.file),
            // Room for an unknown key, its value, and the problem.
            problem: clipped(&problem.into(), 200),
            found: shorten(found),
            expected: expected.into(),
            next: next.into(),
        }
    }

    /// The place of `field = ...` in the table that begins at `table`, or the table's.
    pub fn field(self, table: std::ops::Range<usize>, field: &str) -> std::ops::Range<usize> {
        let mut at = table.start.min(self.text.len());
        for (number, line) in self.text[at..].split_inclusive('\n').enumerate() {
            let is_header = line.trim_start().starts_with('[');
            if is_header && number > 0 {
                break;
            }
            if line.split_once('=').is_some_and(|(key, _)| !is_header && key.trim() == field) {
                return at..at + line.len();
            }
            at += line.len();
        }
        table
    }

    /// The error of the parser.
    #[must_use]
    pub fn reader_error(self, error: &toml::de::Error) -> BadInput {
        let span = error.span().unwrap_or(0..0);
        let message = error.message().trim();
        let (problem, expected) = match message.split_once(", expected ") {
            Some((problem, expected)) => (problem, plain_type(expected)),
            None => (message, "TOML with the keys of a scenario".to_owned()),
        };
        if let Some(field) = problem.strip_prefix("missing field ") {
            return self.missing(span, field);
        }
        if problem == "duplicate key" {
            let key = self.key_at(span.start).unwrap_or_else(|| "a table".to_owned());
            let problem = format!("{key}: duplicate key");
            return self.error(span, problem, "each key once", "remove one of the two");
        }
        let field = self.key_at(span.start);
        let next = match problem.strip_prefix("unknown field ") {
            Some(key) => suggestion(key.trim_matches('`'), &expected),
            None => "correct this line, then run it again".to_owned(),
        };
        let problem = match field {
            Some(field) if !problem.contains(&field) => format!("{field}: {problem}"),
            _ => problem.to_owned(),
        };
        self.error(span, problem, expected, next)
    }

    fn missing(self, span: std::ops::Range<usize>, field: &str) -> BadInput {
        let name = field.trim_matches('`');
        let example = match name {
            "motor" => "motor = \"link\", \"spread\" or \"tip\"".to_owned(),
            "duration_ms" => "duration_ms = 1000".to_owned(),
            name => format!("{name} = ..."),
        };
        let mut error = self.error(
            span,
            format!("{name} is missing"),
            example,
            format!("add {name}; `hil-sim list` names scenarios that can serve as a pattern"),
        );
        error.found = format!("no {field} here");
        error
    }

    fn key_at(self, offset: usize) -> Option<String> {
        let before = self.text.get(..offset)?;
        let start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let line = self.text.get(start..)?.lines().next()?;
        let (key, _) = line.split_once('=')?;
        Some(shorten(key.trim()))
    }
}

fn plain_type(expected: &str) -> String {
    match expected {
        "u8" | "u16" | "u32" | "u64" => "a whole number, 0 or more".to_owned(),
        "i8" | "i16" | "i32" | "i64" => "a whole number".to_owned(),
        "f64" => "a number".to_owned(),
        other => other.to_owned(),
    }
}

/// The next step for an unknown key, given the parser's list of known ones.
pub(crate) fn suggestion(key: &str, expected: &str) -> String {
    let known: Vec<&str> = expected.split('`').skip(1).step_by(2).collect();
    match did_you_mean(key, known.iter().copied()) {
        Some(question) => format!("{question} (a name's end is its unit)"),
        None => "remove this key or use one of those expected".to_owned(),
    }
}
