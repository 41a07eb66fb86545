//! Draws defects at random: mutants of cargo-mutants, in an order that the seed alone determines, so many of each area.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use serde_json::{Value, json};

use super::list::{Defect, Edit, Origin};
use super::tree::{self, Tree};
use crate::mutants::{self, sample};
use crate::program::{output, root};

/// Counted defects of each area.
pub const EACH: usize = 4;

pub struct Area {
    pub name: &'static str,
    package: &'static [&'static str],
    files: &'static [&'static str],
    without: &'static [&'static str],
}

pub const AREAS: [Area; 5] = [
    Area {
        name: "guards",
        package: &["servo-core"],
        files: &["servo-core/src/guard/**"],
        without: &["servo-core/src/guard/limits.rs"],
    },
    Area {
        name: "limits",
        package: &["servo-core"],
        files: &["servo-core/src/guard/limits.rs", "servo-core/src/config.rs"],
        without: &[],
    },
    Area {
        name: "storage",
        package: &["tater-fw"],
        files: &["boot/src/storage.rs", "boot/src/storage/**"],
        without: &[],
    },
    Area {
        name: "motion",
        package: &["servo-core", "tater-fw"],
        files: &["servo-core/src/motion/**", "servo-core/src/servo.rs", "tater-fw/src/motion.rs"],
        without: &["servo-core/src/motion/velocity_loop.rs"],
    },
    Area {
        name: "realtime",
        package: &["god", "servo-core"],
        files: &["god/src/realtime.rs", "god/src/realtime/**", "servo-core/src/motion/velocity_loop.rs"],
        without: &[],
    },
];

/// A change of cargo-mutants.
#[derive(Debug, PartialEq)]
struct Mutant {
    /// File and change, without line and column, which any edit above would change; a number where several are alike.
    key: String,
    edit: Edit,
}

/// The entries of the list that a seed draws, as JSON. Those that do not compile are passed over, and those that `known` says are equivalent.
///
/// # Errors
/// Cargo-mutants' or cargo's.
pub fn draw(seed: u64, known: &[Defect], folder: &Path) -> Result<String, String> {
    let tool = mutants::tool()?;
    let mut drawn = Vec::new();
    for area in &AREAS {
        let mut list = Command::new(&tool);
        list.current_dir(root()).args(["mutants", "--list", "--json"]);
        list.args(area.package.iter().flat_map(|name| ["--package", name]));
        list.args(area.files.iter().flat_map(|file| ["--file", file]));
        list.args(area.without.iter().flat_map(|file| ["--exclude", file]));
        list.args(mutants::EXCLUDED.iter().flat_map(|pattern| ["--exclude-re", pattern]));
        let listed = parse(&output(list)?, &tree::text)?;
        let mut counted = 0;
        for (mutant, key) in order(&listed, seed) {
            if counted == EACH {
                break;
            }
            let changed = tree::edited(std::slice::from_ref(&mutant.edit))?;
            let package = mutant.edit.file.split('/').next().unwrap_or_default();
            if Tree::copy(folder, "tree-single", &changed)?.check(package).is_err() {
                continue;
            }
            let is_it =
                |defect: &&Defect| matches!(&defect.origin, Origin::Equivalent(_)) && defect.what == *key;
            let proof = known.iter().find(is_it).map(|defect| &defect.origin);
            let mut entry = json!({
                "name": format!("{}-{}", area.name, drawn_of(&drawn, area.name) + 1),
                "drawn": area.name,
                "file": mutant.edit.file,
                "from": mutant.edit.from,
                "to": mutant.edit.to,
                "what": key,
            });
            match proof {
                Some(Origin::Equivalent(proof)) => entry["equivalent"] = json!(proof),
                _ => counted += 1,
            }
            drawn.push(entry);
        }
    }
    serde_json::to_string_pretty(&drawn).map_err(|error| error.to_string())
}

fn drawn_of(drawn: &[Value], area: &str) -> usize {
    drawn.iter().filter(|entry| entry["drawn"] == area).count()
}

/// The mutants in the order of their hashes.
fn order(mutants: &[Mutant], seed: u64) -> impl Iterator<Item = (&Mutant, &str)> {
    let keys = sample::choose(mutants.iter().map(|mutant| mutant.key.as_str()), mutants.len(), seed);
    keys.into_iter().filter_map(|key| Some((mutants.iter().find(|mutant| mutant.key == key)?, key)))
}

/// Reads what `cargo mutants --list --json` prints.
fn parse(list: &str, read: &impl Fn(&str) -> Result<String, String>) -> Result<Vec<Mutant>, String> {
    let rows: Vec<Value> = serde_json::from_str(list).map_err(|error| format!("list of mutants: {error}"))?;
    let (mut mutants, mut alike, mut texts) = (Vec::new(), BTreeMap::new(), BTreeMap::new());
    for row in &rows {
        let bad = || format!("list of mutants: expected file, name, span, genre and replacement: {row}");
        let file = row["file"].as_str().ok_or_else(bad)?;
        let name = row["name"].as_str().and_then(|name| name.strip_prefix(file)).ok_or_else(bad)?;
        let place = format!("{file}: {}", name.splitn(4, ':').nth(3).ok_or_else(bad)?.trim());
        let nth: &mut u32 = alike.entry(place.clone()).or_default();
        *nth += 1;
        let key = if *nth == 1 { place } else { format!("{place}, number {nth}") };
        if !texts.contains_key(file) {
            texts.insert(file, read(file)?);
        }
        let text = &texts[file];
        let at = |end: &str| offset(text, &row["span"][end]).ok_or_else(bad);
        let (start, end) = (at("start")?, at("end")?);
        let new = row["replacement"].as_str().ok_or_else(bad)?;
        // Instead of a whole body: a return before it.
        let indent = &text[text[..start].rfind('\n').map_or(0, |found| found + 1)..start];
        let (end, new) = match row["genre"].as_str() {
            Some("FnValue") => (start, format!("return {new};\n{indent}")),
            _ => (end, new.to_owned()),
        };
        mutants.push(Mutant { key, edit: edit(file, text, start..end, &new) });
    }
    Ok(mutants)
}

/// Byte of a line and column of characters, both from 1 on.
fn offset(text: &str, place: &Value) -> Option<usize> {
    let number = |name: &str| usize::try_from(place[name].as_u64()?.checked_sub(1)?).ok();
    let line = text.split_inclusive('\n').take(number("line")?).map(str::len).sum::<usize>();
    let (column, _) = text[line..].char_indices().chain([(text.len() - line, ' ')]).nth(number("column")?)?;
    Some(line + column)
}

/// A change of so few lines that they occur once.
fn edit(file: &str, text: &str, place: std::ops::Range<usize>, new: &str) -> Edit {
    let begin = |at: usize| text[..at].rfind('\n').map_or(0, |found| found + 1);
    let end = |at: usize| text[at..].find('\n').map_or(text.len(), |found| at + found + 1);
    let (mut from, mut to) = (begin(place.start), end(place.end.max(place.start + 1) - 1));
    while text.matches(&text[from..to]).count() > 1 {
        to = end(to.min(text.len() - 1));
        if text.matches(&text[from..to]).count() > 1 {
            from = begin(from.saturating_sub(1));
        }
    }
    Edit {
        file: file.to_owned(),
        from: text[from..to].to_owned(),
        to: [&text[from..place.start], new, &text[place.end..to]].concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "fn f(a: u8) -> bool {\n    // é\n    a < 3\n}\nfn g(a: u8) -> bool {\n    a < 3\n}\n";

    fn mutant(line: u32, column: u32, end: u32, genre: &str, name: &str, replacement: &str) -> Value {
        json!({ "file": "a.rs", "name": format!("a.rs:{line}:{column}: {name}"), "genre": genre, "replacement": replacement,
            "span": { "start": { "line": line, "column": column }, "end": { "line": line, "column": end } } })
    }

    fn parsed(rows: &[Value]) -> Vec<Mutant> {
        let list = serde_json::to_string(rows).expect("JSON");
        parse(&list, &|_| Ok(TEXT.to_owned())).expect("complete")
    }

    #[test]
    fn mutant_becomes_an_edit_of_lines_that_occur_once() {
        let rows = [
            mutant(3, 7, 8, "BinaryOperator", "replace < with == in f", "=="),
            mutant(6, 7, 8, "BinaryOperator", "replace < with == in g", "=="),
            mutant(6, 5, 10, "FnValue", "replace g -> bool with true", "true"),
        ];
        let all = parsed(&rows);
        for (mutant, (from, to)) in all.iter().zip([
            ("    // é\n    a < 3\n}\n", "    // é\n    a == 3\n}\n"),
            ("fn g(a: u8) -> bool {\n    a < 3\n}\n", "fn g(a: u8) -> bool {\n    a == 3\n}\n"),
            (
                "fn g(a: u8) -> bool {\n    a < 3\n}\n",
                "fn g(a: u8) -> bool {\n    return true;\n    a < 3\n}\n",
            ),
        ]) {
            assert_eq!((mutant.edit.from.as_str(), mutant.edit.to.as_str()), (from, to));
            assert_eq!(TEXT.matches(from).count(), 1);
        }
        assert_eq!(all[2].key, "a.rs: replace g -> bool with true");
    }

    #[test]
    fn order_depends_on_seed_and_keys_alone() {
        let row = |line| mutant(line, 7, 8, "BinaryOperator", "replace < with ==", "==");
        let all = parsed(&[row(3), row(6)]);
        assert_eq!(all[1].key, "a.rs: replace < with ==, number 2");
        let keys = |seed| order(&all, seed).map(|(_, key)| key.to_owned()).collect::<Vec<_>>();
        assert_eq!(keys(1), keys(1));
        assert!((0..64).any(|seed| keys(seed) != keys(1)), "one order only");
    }
}
