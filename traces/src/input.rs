//! Errors in what the user gave: where, what was found, what was expected, what to do next.

use std::fmt;

/// An error in a scenario file, another input file, or the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadInput {
    /// `file:line`, a file, or the command line's option.
    pub place: String,
    /// The problem, naming the field where there is one.
    pub problem: String,
    /// The text or value found.
    pub found: String,
    /// Valid input.
    pub expected: String,
    /// The next step.
    pub next: String,
}

impl BadInput {
    /// A problem at a place. What follows says the rest: `.found(..).expected(..).next(..)`.
    pub fn new(place: impl Into<String>, problem: impl Into<String>) -> Self {
        let [found, expected, next] = [const { String::new() }; 3];
        Self { place: place.into(), problem: problem.into(), found, expected, next }
    }

    /// What was found.
    #[must_use]
    pub fn found(mut self, found: impl Into<String>) -> Self {
        self.found = found.into();
        self
    }

    /// What is valid.
    #[must_use]
    pub fn expected(mut self, expected: impl Into<String>) -> Self {
        self.expected = expected.into();
        self
    }

    /// The next step.
    #[must_use]
    pub fn next(mut self, next: impl Into<String>) -> Self {
        self.next = next.into();
        self
    }
}

impl fmt::Display for BadInput {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { place, problem, found, expected, next } = self;
        write!(f, "{place}: {problem}\n  found:    {found}\n  expected: {expected}\n  next:     {next}")
    }
}

impl std::error::Error for BadInput {}

/// The question after a misspelt word, where a known name is like it.
#[must_use]
pub fn did_you_mean<'a>(found: &str, names: impl Iterator<Item = &'a str>) -> Option<String> {
    closest(found, names).map(|name| format!("did you mean {name}?"))
}

fn closest<'a>(found: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    // A Jaro-Winkler similarity of 0.8 admits typos and other units, not other words.
    names
        .map(|name| (strsim::jaro_winkler(&found.to_lowercase(), &name.to_lowercase()), name))
        .filter(|(likeness, _)| *likeness > 0.8)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, name)| name)
}

/// At most 80 characters of what was found, none of them a control character.
#[must_use]
pub fn shorten(found: &str) -> String {
    clipped(found, 80)
}

/// At most so many characters of a text, none of them a control character.
#[must_use]
pub fn clipped(text: &str, most: usize) -> String {
    let clean: String = text.chars().take(most).map(|c| if c.is_control() { '?' } else { c }).collect();
    if text.chars().nth(most).is_some() { clean + "…" } else { clean }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelt_name_is_asked_for() {
        let names = ["winding_c", "bus_v", "bus_a"];
        let asked = |found| did_you_mean(found, names.into_iter());
        assert_eq!(asked("windng_c").as_deref(), Some("did you mean winding_c?"));
        assert_eq!(asked("BUS_V").as_deref(), Some("did you mean bus_v?"));
        assert_eq!(asked("overshoot"), None);
    }

    #[test]
    fn found_text_is_bounded_and_printable() {
        assert_eq!(shorten("a\tb\x1b[2J"), "a?b?[2J");
        let (fits, long) = ("µ".repeat(80), "µ".repeat(81));
        assert_eq!(shorten(&fits), fits);
        assert_eq!(shorten(&long), format!("{fits}…"));
        assert_eq!(clipped("abc", 2), "ab…");
    }

    #[test]
    fn error_says_where_what_and_what_to_do() {
        let bad =
            BadInput::new("a.toml:3", "motor: unknown").found("thumb").expected("link").next("correct it");
        let want = "a.toml:3: motor: unknown\n  found:    thumb\n  expected: link\n  next:     correct it";
        assert_eq!(bad.to_string(), want);
    }
}
