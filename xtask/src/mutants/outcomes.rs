//! What cargo-mutants writes: the mutants that it finds, and what became of each.

use serde_json::Value;

use super::sample::interval;

/// A change of the code in one place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mutant {
    /// File, line, column and change, as cargo-mutants prints it.
    pub name: String,
    /// The name without line and column, which every edit above would change.
    pub place: String,
    /// The first changed line, before the change.
    pub code: String,
}

impl Mutant {
    fn new(value: &Value) -> Option<Self> {
        let (file, name) = (value["file"].as_str()?, value["name"].as_str()?);
        let change = name.strip_prefix(file)?.splitn(4, ':').nth(3)?;
        let place = format!("{file}:{change}");
        Some(Self { name: name.to_owned(), place, code: String::new() })
    }

    fn with_diff(self, diff: &str) -> Option<Self> {
        // The first two lines are the names of the files.
        let code = diff.lines().skip(2).find_map(|line| line.strip_prefix('-'))?;
        Some(Self { code: code.trim().to_owned(), ..self })
    }
}

/// The list printed by `--list --json`.
///
/// # Errors
/// Another format than expected.
pub fn listed(text: &str) -> Result<Vec<Mutant>, String> {
    // Printed for a diff that changes no code.
    if text.trim().is_empty() {
        return Ok(Vec::new());
    }
    let value: Value = serde_json::from_str(text).map_err(|error| format!("list of mutants: {error}"))?;
    let read = |value: &Value| Mutant::new(value)?.with_diff(value["diff"].as_str()?);
    let mutants = value.as_array().and_then(|rows| rows.iter().map(read).collect());
    mutants.ok_or_else(|| "list of mutants: expected name, file and diff of each".into())
}

/// How many mutants ended in which way.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// A test failed, or had no end.
    pub caught: u32,
    pub survived: u32,
    /// Does not compile.
    pub unviable: u32,
}

impl Tally {
    pub const fn plus(self, other: Self) -> Self {
        Self {
            caught: self.caught + other.caught,
            survived: self.survived + other.survived,
            unviable: self.unviable + other.unviable,
        }
    }
}

impl Tally {
    /// Percent of the viable mutants that were caught; 100 without any.
    pub fn score(self) -> f64 {
        let viable = self.caught + self.survived;
        if viable == 0 { 100.0 } else { 100.0 * f64::from(self.caught) / f64::from(viable) }
    }

    pub fn line(self) -> String {
        let viable = self.caught + self.survived;
        let (low, high) = interval(self.caught, viable);
        format!(
            "{} of {viable} viable ones caught: {:.1} % ({low:.1} to {high:.1} %)",
            self.caught,
            self.score()
        )
    }
}

/// The mutants of `outcomes.json`, each with its own tally. Its list has no code: it comes from `listed`.
///
/// # Errors
/// Another format than expected, or tests that fail without a mutant.
pub fn tested(text: &str, listed: &[Mutant]) -> Result<Vec<(Mutant, Tally)>, String> {
    let value: Value = serde_json::from_str(text).map_err(|error| format!("outcomes.json: {error}"))?;
    let rows = value["outcomes"].as_array().ok_or("outcomes.json: expected outcomes")?;
    let mut tested = Vec::new();
    for row in rows {
        let Some(name) = row["scenario"]["Mutant"]["name"].as_str() else { continue };
        let mutant = listed.iter().find(|mutant| mutant.name == name);
        let mutant = mutant.ok_or_else(|| format!("outcomes.json: {name} was not listed"))?;
        let one = match row["summary"].as_str().unwrap_or_default() {
            "CaughtMutant" | "Timeout" => Tally { caught: 1, ..Tally::default() },
            "MissedMutant" => Tally { survived: 1, ..Tally::default() },
            "Unviable" => Tally { unviable: 1, ..Tally::default() },
            other => return Err(format!("outcomes.json: {name}: result \"{other}\" is unknown")),
        };
        tested.push((mutant.clone(), one));
    }
    Ok(tested)
}

/// The first results, with those that a second pass has tested again replaced.
pub fn replaced(first: Vec<(Mutant, Tally)>, second: Vec<(Mutant, Tally)>) -> Vec<(Mutant, Tally)> {
    let is_new = |mutant: &Mutant| second.iter().any(|(other, _)| other == mutant);
    first.into_iter().filter(|(mutant, _)| !is_new(mutant)).chain(second.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str = r#"[{
        "name": "a/b.rs:3:5: replace A::f -> u32 with 0", "file": "a/b.rs",
        "diff": "--- a/b.rs\n+++ replace A::f\n@@ -1,2 +1,2 @@\n fn f() -> u32 {\n-    self.x\n+    0\n }\n"
    }]"#;

    #[test]
    fn listed_mutant_has_its_place_and_code() {
        let [mutant] = &listed(LIST).expect("one")[..] else { panic!("one") };
        assert_eq!(mutant.name, "a/b.rs:3:5: replace A::f -> u32 with 0");
        assert_eq!(mutant.place, "a/b.rs: replace A::f -> u32 with 0");
        assert_eq!(mutant.code, "self.x");
        assert_eq!(listed(" \n"), Ok(Vec::new()));
        assert!(listed("{}").is_err());
    }

    #[test]
    fn timeout_counts_as_caught_and_unviable_as_nothing() {
        let row = |summary: &str| {
            format!(
                r#"{{ "scenario": {{ "Mutant": {{ "name": "a/b.rs:3:5: replace A::f -> u32 with 0" }} }}, "summary": "{summary}" }}"#
            )
        };
        let rows = ["CaughtMutant", "Timeout", "MissedMutant", "Unviable"].map(row).join(",");
        let text =
            format!(r#"{{ "outcomes": [{{ "scenario": "Baseline", "summary": "Success" }}, {rows}] }}"#);
        let listed = listed(LIST).expect("one");
        let tested = tested(&text, &listed).expect("four");
        let tally = tested.iter().fold(Tally::default(), |sum, (_, tally)| sum.plus(*tally));
        assert_eq!(tally, Tally { caught: 2, survived: 1, unviable: 1 });
        assert_eq!(tally.line(), "2 of 3 viable ones caught: 66.7 % (20.8 to 93.9 %)");
        assert_eq!(
            super::tested(&text, &[]).err().as_deref(),
            Some("outcomes.json: a/b.rs:3:5: replace A::f -> u32 with 0 was not listed")
        );
    }
}
