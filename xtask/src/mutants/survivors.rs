//! The list of mutants that may survive, each with a reason.

use std::path::Path;

use serde_json::Value;

use super::outcomes::Mutant;
use crate::files;

pub const LIST: &str = "xtask/mutants.json";

struct Entry {
    /// As [`Mutant::place`] and [`Mutant::code`].
    mutant: String,
    code: String,
    reason: String,
}

pub struct Known(Vec<Entry>);

impl Known {
    /// # Errors
    /// The file cannot be read, or an entry lacks its mutant, code or reason.
    pub fn read(path: &Path) -> Result<Self, String> {
        Self::parse(&String::from_utf8_lossy(&files::read(path)?))
            .map_err(|error| format!("{}: {error}", path.display()))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let value: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let rows = value.as_array().ok_or("expected a list")?;
        let entry = |(i, row): (usize, &Value)| {
            let field = |name| {
                let text = row[name].as_str().filter(|text| !text.is_empty());
                text.map(String::from).ok_or_else(|| format!("entry {}: \"{name}\" is missing", i + 1))
            };
            Ok(Entry { mutant: field("mutant")?, code: field("code")?, reason: field("reason")? })
        };
        rows.iter().enumerate().map(entry).collect::<Result<_, String>>().map(Self)
    }

    pub fn reason(&self, mutant: &Mutant) -> Option<&str> {
        self.0
            .iter()
            .find(|entry| entry.mutant == mutant.place && entry.code == mutant.code)
            .map(|entry| entry.reason.as_str())
    }

    /// # Errors
    /// An entry for these files names no mutant: the code has changed.
    pub fn all_exist(&self, files: &[&str], listed: &[Mutant]) -> Result<(), String> {
        let ours = |entry: &&Entry| {
            files.iter().any(|file| match file.strip_suffix("**") {
                Some(folder) => entry.mutant.starts_with(folder),
                None => entry.mutant.strip_prefix(file).is_some_and(|rest| rest.starts_with(':')),
            })
        };
        let exists = |entry: &Entry| {
            listed.iter().any(|mutant| mutant.place == entry.mutant && mutant.code == entry.code)
        };
        match self.0.iter().filter(ours).find(|entry| !exists(entry)) {
            None => Ok(()),
            Some(Entry { mutant, code, .. }) => Err(format!(
                "{LIST}: there is no mutant \"{mutant}\" of `{code}`\n  next: remove the entry, or take name and code from the list of survivors"
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mutant(place: &str, code: &str) -> Mutant {
        Mutant { name: String::new(), place: place.into(), code: code.into() }
    }

    #[test]
    fn entry_excuses_one_line_alone() {
        let known = Known::parse(r#"[{ "mutant": "a.rs: replace f", "code": "f()", "reason": "equal" }]"#);
        let known = known.expect("complete");
        assert_eq!(known.reason(&mutant("a.rs: replace f", "f()")), Some("equal"));
        assert_eq!(known.reason(&mutant("a.rs: replace f", "f() + 1")), None);
        assert_eq!(known.reason(&mutant("b.rs: replace f", "f()")), None);
    }

    #[test]
    fn entry_without_its_mutant_is_an_error() {
        let known = r#"[{ "mutant": "s/a.rs: replace f", "code": "f()", "reason": "equal" }]"#;
        let known = Known::parse(known).expect("complete");
        let other = [mutant("s/a.rs: replace f", "g()")];
        assert!(known.all_exist(&["s/**"], &other).is_err_and(|error| error.contains("s/a.rs: replace f")));
        assert!(known.all_exist(&["s/a.rs"], &other).is_err());
        assert_eq!(known.all_exist(&["s/a"], &other), Ok(()));
        assert_eq!(known.all_exist(&["s/**"], &[mutant("s/a.rs: replace f", "f()")]), Ok(()));
    }

    #[test]
    fn entry_without_reason_is_an_error() {
        let error = Known::parse(r#"[{ "mutant": "a", "code": "f()", "reason": "" }]"#).err();
        assert_eq!(error.as_deref(), Some("entry 1: \"reason\" is missing"));
    }
}
