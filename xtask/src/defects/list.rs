//! The list of planted defects.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;

use crate::files;

pub const LIST: &str = "xtask/defects.json";

/// Instead of the names of invariants: each of them.
pub const ANY: &str = "any";

/// A mistake that an invariant of the torture chamber finds.
#[derive(Clone, Debug, PartialEq)]
pub struct Defect {
    pub name: String,
    /// Any of these may find it. Exactly one where the defect shows that the invariant can fail.
    pub invariants: Vec<String>,
    pub plant: Plant,
    pub origin: Origin,
    /// What is wrong, as one sentence.
    pub what: String,
    /// It shows only after minutes: the long seeds are played.
    pub is_long: bool,
    /// Why no check finds it: a hole in the chamber, stated.
    pub missed: Option<String>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Origin {
    /// A person's idea, or a mistake of this project's past.
    Chosen,
    /// A mutant of this area, drawn by a seed.
    Drawn(String),
    /// As `Drawn`, but left out of the score, because no behavior differs: with the proof.
    Equivalent(String),
}

impl Defect {
    /// Whether a run of torture or unit tests can have it.
    pub const fn is_planted(&self) -> bool {
        matches!(self.plant, Plant::Texts(_)) && !matches!(self.origin, Origin::Equivalent(_))
    }
}

/// How a defect is planted.
#[derive(Clone, Debug, PartialEq)]
pub enum Plant {
    /// One replacement, or several where the code guards twice.
    Texts(Vec<Edit>),
    /// No native hand can show it: which test does.
    Elsewhere(String),
}

/// `from`, which occurs once in the file, becomes `to`.
#[derive(Clone, Debug, PartialEq)]
pub struct Edit {
    pub file: String,
    pub from: String,
    pub to: String,
}

/// # Errors
/// The file cannot be read, or an entry lacks something.
pub fn read(path: &Path) -> Result<Vec<Defect>, String> {
    parse(&String::from_utf8_lossy(&files::read(path)?))
        .map_err(|error| format!("{}: {error}", path.display()))
}

pub fn parse(text: &str) -> Result<Vec<Defect>, String> {
    let value: Value = serde_json::from_str(text).map_err(|error| error.to_string())?;
    let rows = value.as_array().ok_or("expected a list")?;
    let all: Vec<Defect> =
        rows.iter().enumerate().map(|(at, row)| entry(row, at + 1)).collect::<Result<_, _>>()?;
    let mut names = BTreeSet::new();
    match all.iter().find(|defect| !names.insert(&defect.name)) {
        Some(twice) => Err(format!("the name \"{}\" occurs twice", twice.name)),
        None => Ok(all),
    }
}

fn entry(row: &Value, number: usize) -> Result<Defect, String> {
    let optional = |row: &Value, name: &str| row[name].as_str().map(String::from);
    let field = |row: &Value, name: &str| {
        let text = optional(row, name).filter(|text| !text.is_empty() || name == "to");
        text.ok_or_else(|| format!("entry {number}: \"{name}\" is missing"))
    };
    let edit = |row: &Value| {
        Ok(Edit { file: field(row, "file")?, from: field(row, "from")?, to: field(row, "to")? })
    };
    let invariants: Option<Vec<String>> = row["invariants"]
        .as_array()
        .filter(|names| !names.is_empty())
        .and_then(|names| names.iter().map(|name| name.as_str().map(String::from)).collect());
    let plant = match optional(row, "elsewhere") {
        Some(test) => Plant::Elsewhere(test),
        None => {
            let others = row["also"].as_array().into_iter().flatten();
            Plant::Texts(std::iter::once(row).chain(others).map(edit).collect::<Result<_, String>>()?)
        }
    };
    let origin = match (optional(row, "drawn"), optional(row, "equivalent")) {
        (None, _) => Origin::Chosen,
        (Some(area), None) => Origin::Drawn(area),
        (Some(_), Some(proof)) => Origin::Equivalent(proof),
    };
    let drawn = (origin != Origin::Chosen).then(|| vec![ANY.to_owned()]);
    Ok(Defect {
        name: field(row, "name")?,
        invariants: invariants
            .or(drawn)
            .ok_or_else(|| format!("entry {number}: \"invariants\" is missing"))?,
        plant,
        origin,
        what: field(row, "what")?,
        is_long: row["long"].as_bool().unwrap_or(false),
        missed: optional(row, "missed"),
    })
}

/// The defects with these names, or with an invariant of these names.
///
/// # Errors
/// A name that is neither.
pub fn choose<'a>(all: &'a [Defect], names: &[String]) -> Result<Vec<&'a Defect>, String> {
    let is = |defect: &Defect, name: &String| defect.name == *name || defect.invariants.contains(name);
    if let Some(name) = names.iter().find(|name| !all.iter().any(|defect| is(defect, name))) {
        let known: Vec<&str> = all.iter().map(|defect| defect.name.as_str()).collect();
        return Err(format!("there is no defect or invariant \"{name}\"; use {}", known.join(", ")));
    }
    Ok(all.iter().filter(|defect| names.is_empty() || names.iter().any(|name| is(defect, name))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::defects::draw;
    use crate::program::root;

    fn committed() -> Vec<Defect> {
        read(&root().join(LIST)).expect("complete")
    }

    /// The names in the first table of docs/torture.md, which a test of `tests/torture.rs` compares with the code.
    fn invariants() -> Vec<String> {
        let page = std::fs::read_to_string(root().join("docs/torture.md")).expect("there");
        let rows = page.lines().skip_while(|line| !line.starts_with("| Invariant")).skip(2);
        let rows = rows.take_while(|line| line.starts_with('|'));
        rows.map(|row| row.split('|').nth(1).expect("a name").trim().to_owned()).collect()
    }

    #[test]
    fn each_defect_can_be_planted() {
        for defect in committed() {
            let Plant::Texts(edits) = &defect.plant else { continue };
            for Edit { file, from, to } in edits {
                let text =
                    std::fs::read_to_string(root().join(file)).unwrap_or_else(|e| panic!("{file}: {e}"));
                assert_eq!(text.matches(from.as_str()).count(), 1, "{}: {file}: {from}", defect.name);
                assert_ne!(from, to, "{}", defect.name);
                // A check that is broken itself would show nothing.
                assert!(!file.contains("/experiment/"), "{}: {file}", defect.name);
            }
        }
    }

    #[test]
    fn each_invariant_has_a_defect_that_it_alone_must_find() {
        let (all, known) = (committed(), invariants());
        assert!(known.len() >= 33, "{}", known.len());
        for invariant in &known {
            let alone = |defect: &Defect| defect.invariants == [invariant.clone()] && defect.missed.is_none();
            assert!(all.iter().any(alone), "{invariant}");
        }
        for defect in &all {
            for invariant in &defect.invariants {
                let is_known = known.contains(invariant) || defect.invariants == [ANY];
                assert!(is_known, "{}: {invariant} is unknown", defect.name);
            }
        }
    }

    #[test]
    fn each_area_has_its_share_of_drawn_defects() {
        let all = committed();
        for area in &draw::AREAS {
            let of = |defect: &&Defect| defect.origin == Origin::Drawn(area.name.to_owned());
            assert_eq!(all.iter().filter(of).count(), draw::EACH, "{}", area.name);
        }
    }

    #[test]
    fn entry_without_its_text_or_with_a_known_name_is_an_error() {
        let row = |name: &str, from: &str| {
            format!(r#"{{"name":"{name}","invariants":["a"],"file":"f","from":"{from}","to":"","what":"w"}}"#)
        };
        let text = format!("[{},{}]", row("x", "1"), row("y", "2"));
        assert_eq!(parse(&text).map(|all| all.len()), Ok(2));
        let text = format!("[{},{}]", row("x", "1"), row("x", "2"));
        assert_eq!(parse(&text), Err("the name \"x\" occurs twice".to_owned()));
        assert_eq!(parse(&format!("[{}]", row("x", ""))), Err("entry 1: \"from\" is missing".to_owned()));
    }

    #[test]
    fn names_choose_defects_and_invariants() {
        let text = r#"[{"name":"x","invariants":["a","b"],"elsewhere":"t","what":"w"},
                       {"name":"y","invariants":["b"],"elsewhere":"t","what":"w"}]"#;
        let all = parse(text).expect("two");
        let chosen = |names: &[&str]| {
            let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
            choose(&all, &names)
                .map(|chosen| chosen.iter().map(|defect| defect.name.clone()).collect::<String>())
        };
        assert_eq!(chosen(&[]), Ok("xy".to_owned()));
        assert_eq!(chosen(&["a"]), Ok("x".to_owned()));
        assert_eq!(chosen(&["y", "b"]), Ok("xy".to_owned()));
        assert_eq!(chosen(&["z"]), Err("there is no defect or invariant \"z\"; use x, y".to_owned()));
    }
}
