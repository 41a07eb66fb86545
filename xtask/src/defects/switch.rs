//! One build with many defects: the body of a function that a defect changes gets a version for each of them, of which the environment
//! chooses one at run time. Only a copy of the project is changed so (`tree`).

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::functions::{Body, enclosing};
use super::list::{Defect, Edit, Plant};

/// The variable that names the planted defect. Without it the program is the unchanged one.
pub const VARIABLE: &str = "PLANTED_DEFECT";

/// What each crate gets at the end of its root: the number of the chosen defect, a hash of its name, and 0 without one. Private to the crate, so
/// that tests of a crate alone have it as well.
const MODULE: &str = r#"
/// The planted defect: `cargo xtask defects`.
#[allow(missing_docs, unused)]
mod planted {
    extern crate std;

    pub(crate) fn defect() -> u64 {
        static NUMBER: std::sync::OnceLock<u64> = std::sync::OnceLock::new();
        *NUMBER.get_or_init(|| match std::env::var("PLANTED_DEFECT") {
            Ok(name) if !name.is_empty() => name
                .bytes()
                .fold(0xCBF2_9CE4_8422_2325_u64, |sum, byte| (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3)),
            _ => 0,
        })
    }
}
"#;

/// The number of a defect: FNV-1a of its name, as in [`MODULE`].
fn number(name: &str) -> u64 {
    name.bytes()
        .fold(0xCBF2_9CE4_8422_2325, |sum, byte| (sum ^ u64::from(byte)).wrapping_mul(0x0100_0000_01B3))
}

/// The files of the build with switches.
#[derive(Debug, Default)]
pub struct Switched {
    /// Texts by the file's name.
    pub files: BTreeMap<String, String>,
    /// The lines of each version: file, lines from 1 on, name of the defect.
    versions: Vec<(String, Range<usize>, String)>,
    /// Functions that are `const` no more, and the defect there.
    inconstant: Vec<(String, String)>,
    /// The defects that need a build of their own, and why.
    pub alone: BTreeMap<String, &'static str>,
}

impl Switched {
    /// Plans the build, without those that `excluded` says do not compile in it. `read` returns the text of a file.
    ///
    /// # Errors
    /// A text that a defect replaces does not occur exactly once; the error of `read`.
    pub fn plan(
        defects: &[&Defect],
        excluded: &BTreeSet<String>,
        read: impl Fn(&str) -> Result<String, String>,
    ) -> Result<Self, String> {
        let mut planned = Self::default();
        let mut files: BTreeMap<String, File> = BTreeMap::new();
        for defect in defects {
            let Plant::Texts(edits) = &defect.plant else { continue };
            let mut places = Vec::new();
            for edit in edits {
                if !files.contains_key(&edit.file) {
                    files.insert(edit.file.clone(), File { text: read(&edit.file)?, versions: Vec::new() });
                }
                places.push(files[&edit.file].place(edit)?);
            }
            let obstacle = places.iter().find_map(|place| place.as_ref().err().copied());
            let obstacle = obstacle
                .or(excluded.contains(&defect.name).then_some("does not compile beside the original"));
            if let Some(why) = obstacle {
                planned.alone.insert(defect.name.clone(), why);
                continue;
            }
            for (edit, place) in edits.iter().zip(places.into_iter().flatten()) {
                let file = files.get_mut(&edit.file).ok_or("a file that was read")?;
                let (change, body) = place;
                if body.constant.is_some() {
                    planned.inconstant.push((body.name.clone(), defect.name.clone()));
                }
                file.versions.push((body, &defect.name, change));
            }
        }
        files.retain(|_, file| !file.versions.is_empty());
        for (name, file) in &files {
            let (text, versions) = file.switched();
            planned
                .versions
                .extend(versions.into_iter().map(|(lines, defect)| (name.clone(), lines, defect)));
            planned.files.insert(name.clone(), text);
        }
        for name in files.keys() {
            let root = format!("{}/src/lib.rs", name.split('/').next().unwrap_or_default());
            let text = match planned.files.remove(&root) {
                Some(text) => text,
                None => read(&root)?,
            };
            let text = if text.ends_with(MODULE) { text } else { text + MODULE };
            planned.files.insert(root, text);
        }
        Ok(planned)
    }

    /// The defects in whose versions the compiler has found errors.
    pub fn blamed(&self, messages: &str) -> BTreeSet<String> {
        let places = messages.lines().filter_map(|line| {
            let (place, _) = line.split_once(": error")?;
            let mut parts = place.trim().split(':');
            Some((parts.next()?, parts.next()?.parse::<usize>().ok()?))
        });
        let mut blamed = BTreeSet::new();
        for (file, line) in places {
            let hit =
                |(name, lines, _): &&(String, Range<usize>, String)| name == file && lines.contains(&line);
            blamed.extend(self.versions.iter().filter(hit).map(|(.., defect)| defect.clone()));
        }
        // `cannot call non-const method `a::B::name` in constants`
        for line in messages.lines().filter(|line| line.contains("non-const")) {
            let name = line.split('`').nth(1).and_then(|path| path.split("::").last()).unwrap_or_default();
            let called = self.inconstant.iter().filter(|(function, _)| function == name);
            blamed.extend(called.map(|(_, defect)| defect.clone()));
        }
        blamed
    }
}

struct Change<'a> {
    at: Range<usize>,
    to: &'a str,
}

struct File<'a> {
    text: String,
    /// The body, the defect and its change there.
    versions: Vec<(Body, &'a str, Change<'a>)>,
}

impl<'a> File<'a> {
    /// What an edit changes, and the function's body around it; or why it cannot be switched.
    fn place<'e>(&self, edit: &'e Edit) -> Result<Result<(Change<'e>, Body), &'static str>, String> {
        let Edit { file, from, to } = edit;
        let at = self.text.find(from.as_str()).filter(|_| self.text.matches(from.as_str()).count() == 1);
        let at = at.ok_or_else(|| format!("{file}: expected once: {from}"))?;
        // Without the lines around it, which may reach into the next function.
        let same = |pairs: &mut dyn Iterator<Item = (char, char)>| {
            pairs.take_while(|(old, new)| old == new).map(|(c, _)| c.len_utf8()).sum::<usize>()
        };
        let before = same(&mut from.chars().zip(to.chars()));
        let after = same(&mut from[before..].chars().rev().zip(to[before..].chars().rev()));
        let change = Change { at: at + before..at + from.len() - after, to: &to[before..to.len() - after] };
        Ok(match enclosing(&self.text, &change.at) {
            None => Err("outside of a function"),
            Some(body) if body.is_opaque => Err("in a function that returns impl Trait"),
            Some(body) => Ok((change, body)),
        })
    }

    /// The text with all versions, and the lines of each.
    fn switched(&self) -> (String, Vec<(Range<usize>, String)>) {
        let mut bodies: BTreeMap<usize, (&Body, BTreeMap<&str, Vec<&Change>>)> = BTreeMap::new();
        for (body, defect, change) in &self.versions {
            // A function inside of another one that has versions.
            let has = |other: &&Body| {
                other.inside.start <= body.inside.start && body.inside.end <= other.inside.end
            };
            let around = self.versions.iter().map(|(other, ..)| other).filter(has);
            let body = around.max_by_key(|other| other.inside.len()).unwrap_or(body);
            let (_, defects) = bodies.entry(body.inside.start).or_insert_with(|| (body, BTreeMap::new()));
            defects.entry(defect).or_default().push(change);
        }
        let (mut text, mut lines, mut from) = (String::new(), Vec::new(), 0);
        let line = |text: &str| text.matches('\n').count() + 1;
        for (body, defects) in bodies.values() {
            if let Some(word) = &body.constant {
                text += &self.text[from..word.start];
                from = word.end;
            }
            text += &self.text[from..body.inside.start];
            text += "match crate::planted::defect() {\n";
            for (defect, changes) in defects {
                let begin = line(&text);
                text += &format!("{:#x} => {{", number(defect));
                text += &changed(&self.text, &body.inside, changes);
                text += "\n}\n";
                lines.push((begin..line(&text), (*defect).to_owned()));
            }
            text += "_ => {";
            text += &self.text[body.inside.clone()];
            text += "\n}\n}";
            from = body.inside.end;
        }
        text += &self.text[from..];
        (text, lines)
    }
}

/// A part of the text with changes.
fn changed(text: &str, part: &Range<usize>, changes: &[&Change]) -> String {
    let mut changes: Vec<&&Change> = changes.iter().collect();
    changes.sort_by_key(|change| change.at.start);
    let (mut result, mut from) = (String::new(), part.start);
    for change in changes {
        result += text.get(from..change.at.start).unwrap_or_default();
        result += change.to;
        from = change.at.end;
    }
    result + text.get(from..part.end).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::defects::list;

    const TEXT: &str = "const A: u8 = 1;\nfn f() -> u8 {\n    1 + A\n}\npub const fn g() -> u8 {\n    7\n}\n";

    #[test]
    fn lines_around_a_change_may_reach_into_another_function() {
        let plan =
            plan(&[("two", "fn f() -> u8 {\n    1 + A\n}\npub", "fn f() -> u8 {\n    2 + A\n}\npub")], &[]);
        assert!(
            plan.files
                .get("c/src/a.rs")
                .is_some_and(|text| text.contains("{\n    2 + A\n\n}\n_ => {\n    1 + A"))
        );
    }

    fn plan(edits: &[(&str, &str, &str)], excluded: &[&str]) -> Switched {
        let rows = edits.iter().map(|(name, from, to)| {
            serde_json::json!({ "name": name, "invariants": ["i"], "file": "c/src/a.rs", "from": from, "to": to, "what": "w" })
        });
        let all = list::parse(&serde_json::Value::from_iter(rows).to_string()).expect("complete");
        let excluded = excluded.iter().map(|name| (*name).to_owned()).collect();
        let read =
            |file: &str| Ok(if file == "c/src/a.rs" { TEXT.to_owned() } else { "mod a;\n".to_owned() });
        Switched::plan(&all.iter().collect::<Vec<_>>(), &excluded, read).expect("planned")
    }

    #[test]
    fn body_gets_a_version_for_each_defect() {
        let plan = plan(&[("two", "1 + A", "2 + A"), ("three", "    1", "    3"), ("g", "7", "8")], &[]);
        let expected = format!(
            "const A: u8 = 1;\nfn f() -> u8 {{match crate::planted::defect() {{\n{:#x} => {{\n    3 + A\n\n}}\n{:#x} => {{\n    2 + A\n\n}}\n\
             _ => {{\n    1 + A\n\n}}\n}}}}\npub  fn g() -> u8 {{match crate::planted::defect() {{\n{:#x} => {{\n    8\n\n}}\n\
             _ => {{\n    7\n\n}}\n}}}}\n",
            number("three"),
            number("two"),
            number("g")
        );
        assert_eq!(plan.files.get("c/src/a.rs"), Some(&expected));
        assert_eq!(plan.files.get("c/src/lib.rs"), Some(&format!("mod a;\n{MODULE}")));
        assert!(plan.alone.is_empty());
        assert!(
            MODULE.contains(VARIABLE)
                && MODULE.contains("0xCBF2_9CE4_8422_2325")
                && MODULE.contains("0x0100_0000_01B3")
        );
    }

    #[test]
    fn defect_that_is_no_version_of_a_body_gets_a_build_of_its_own() {
        let plan = plan(&[("a", "A: u8 = 1", "A: u8 = 2"), ("g", "7", "8")], &["g"]);
        let alone: Vec<(&str, &str)> = plan.alone.iter().map(|(name, why)| (name.as_str(), *why)).collect();
        assert_eq!(alone, [("a", "outside of a function"), ("g", "does not compile beside the original")]);
        assert!(plan.files.is_empty());
    }

    #[test]
    fn compiler_blames_the_version_of_its_line_and_a_function_that_is_no_longer_const() {
        let plan = plan(&[("two", "1 + A", "2 + A"), ("three", "    1", "    3"), ("g", "7", "8")], &[]);
        let blamed = |text: &str| plan.blamed(text).into_iter().collect::<Vec<_>>().join(" ");
        assert_eq!(
            blamed("c/src/a.rs:4:5: error[E0308]: mismatched types\nerror: could not compile"),
            "three"
        );
        assert_eq!(blamed("c/src/a.rs:8:5: error: no"), "two");
        assert_eq!(blamed("c/src/a.rs:11:5: error: no\nc/src/b.rs:4:5: error: no"), "");
        assert_eq!(
            blamed("c/src/b.rs:1:9: error[E0015]: cannot call non-const function `a::g` in constants"),
            "g"
        );
    }

    #[test]
    fn each_defect_of_the_list_is_planned() {
        let all = list::read(&crate::program::root().join(list::LIST)).expect("complete");
        let all: Vec<&Defect> = all.iter().collect();
        let plan = Switched::plan(&all, &BTreeSet::new(), crate::defects::tree::text).expect("planned");
        // Each costs a build of the simulator, minutes.
        let alone: Vec<&str> = plan.alone.keys().map(String::as_str).collect();
        assert_eq!(alone, ["storage-3"]);
        let numbers: BTreeSet<u64> = all.iter().map(|defect| number(&defect.name)).collect();
        assert_eq!(numbers.len(), all.len(), "two names have one number");
        assert!(!numbers.contains(&0));
    }
}
