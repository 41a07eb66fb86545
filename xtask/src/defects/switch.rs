//! One build with many defects: the body of a function that a defect changes gets a version for each of them, of which the environment
//! chooses one at run time. Only a copy of the project is changed so (`tree`).

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::functions::{Body, constants, enclosing};
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

/// What the compiler has refused so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Refused {
    /// Defects that do not compile beside the original.
    pub defects: BTreeSet<String>,
    /// `const` functions that call one with versions: file and name. They cannot be `const` either.
    constants: BTreeSet<(String, String)>,
}

impl Refused {
    /// Adds others; returns whether any is new.
    pub fn add(&mut self, others: Self) -> bool {
        let before = self.clone();
        self.defects.extend(others.defects);
        self.constants.extend(others.constants);
        *self != before
    }
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
    /// Plans the build, without what the compiler has refused. `read` returns the text of a file.
    ///
    /// # Errors
    /// A text that a defect replaces does not occur exactly once; the error of `read`.
    pub fn plan(
        defects: &[&Defect],
        refused: &Refused,
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
                .or(refused.defects.contains(&defect.name).then_some("does not compile beside the original"));
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
        for (file, function) in &refused.constants {
            let mut text = planned.files.remove(file).map_or_else(|| read(file), Ok)?;
            constants(&text, function).into_iter().rev().for_each(|word| text.replace_range(word, ""));
            planned.files.insert(file.clone(), text);
        }
        for name in files.keys() {
            let package = name.split_once("/src/").map_or("", |(package, _)| package);
            let root = format!("{package}/src/lib.rs");
            let text = match planned.files.remove(&root) {
                Some(text) => text,
                None => read(&root)?,
            };
            let text = if text.ends_with(MODULE) { text } else { text + MODULE };
            planned.files.insert(root, text);
        }
        Ok(planned)
    }

    /// What the compiler refuses, by its messages: the defects in whose versions it has found errors, and what it says of `const`, as
    /// "cannot call non-const method `a::B::name` in constant functions".
    pub fn blamed(&self, messages: &str, read: impl Fn(&str) -> Result<String, String>) -> Refused {
        let mut refused = Refused::default();
        for line in messages.lines() {
            let Some((place, message)) = line.split_once(": error") else { continue };
            let mut parts = place.trim().split(':');
            let (file, number) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
            let Ok(number) = number.parse::<usize>() else { continue };
            if message.contains("non-const") {
                let text = self.files.get(file).cloned().or_else(|| read(file).ok()).unwrap_or_default();
                let at =
                    text.split_inclusive('\n').take(number).map(str::len).sum::<usize>().saturating_sub(1);
                if let Some(body) = enclosing(&text, &(at..at)).filter(|body| body.constant.is_some()) {
                    refused.constants.insert((file.to_owned(), body.name));
                    continue;
                }
                let name = message.split('`').nth(1).and_then(|path| path.split("::").last());
                let called = |function: &String| Some(function.as_str()) == name;
                // One that calls it, if it has no versions itself: of which, is not known here.
                let is_direct = self.inconstant.iter().any(|(function, _)| called(function));
                let all = self.inconstant.iter().filter(|(function, _)| !is_direct || called(function));
                refused.defects.extend(all.map(|(_, defect)| defect.clone()));
            }
            let hit =
                |(name, lines, _): &&(String, Range<usize>, String)| name == file && lines.contains(&number);
            refused.defects.extend(self.versions.iter().filter(hit).map(|(.., defect)| defect.clone()));
        }
        refused
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

    const FILE: &str = "c/src/a.rs";
    const TEXT: &str = "const A: u8 = 1;\nfn f() -> u8 {\n    1 + A\n}\npub const fn g() -> u8 {\n    7\n}\nconst fn h() -> u8 {\n    g()\n}\n";

    type Row<'a> = (&'a str, &'a str, &'a str);

    const ROWS: [Row; 3] = [("two", "1 + A", "2 + A"), ("three", "    1", "    3"), ("g", "7", "8")];

    fn read(file: &str) -> Result<String, String> {
        Ok(if file == FILE { TEXT } else { "mod a;\n" }.to_owned())
    }

    fn plan(rows: &[Row], refused: &Refused) -> Switched {
        let rows = rows.iter().map(|(name, from, to)| {
            serde_json::json!({ "name": name, "invariants": ["i"], "file": FILE, "from": from, "to": to, "what": "w" })
        });
        let all = list::parse(&serde_json::Value::from_iter(rows).to_string()).expect("complete");
        Switched::plan(&all.iter().collect::<Vec<_>>(), refused, read).expect("planned")
    }

    fn text(plan: &Switched) -> &str {
        plan.files.get(FILE).expect("it has versions")
    }

    #[test]
    fn body_gets_a_version_for_each_defect() {
        let plan = plan(&ROWS, &Refused::default());
        let expected = format!(
            "const A: u8 = 1;\nfn f() -> u8 {{match crate::planted::defect() {{\n{:#x} => {{\n    3 + A\n\n}}\n{:#x} => {{\n    2 + A\n\n}}\n\
             _ => {{\n    1 + A\n\n}}\n}}}}\npub  fn g() -> u8 {{match crate::planted::defect() {{\n{:#x} => {{\n    8\n\n}}\n\
             _ => {{\n    7\n\n}}\n}}}}\nconst fn h() -> u8 {{\n    g()\n}}\n",
            number("three"),
            number("two"),
            number("g")
        );
        assert_eq!(text(&plan), expected);
        assert_eq!(plan.files.get("c/src/lib.rs"), Some(&format!("mod a;\n{MODULE}")));
        assert!(plan.alone.is_empty());
        for word in [VARIABLE, "0xCBF2_9CE4_8422_2325", "0x0100_0000_01B3"] {
            assert!(MODULE.contains(word), "{word}");
        }
    }

    #[test]
    fn lines_around_a_change_may_reach_into_another_function() {
        let row = ("two", "fn f() -> u8 {\n    1 + A\n}\npub", "fn f() -> u8 {\n    2 + A\n}\npub");
        let plan = plan(&[row], &Refused::default());
        assert!(text(&plan).contains("{\n    2 + A\n\n}\n_ => {\n    1 + A"), "{}", text(&plan));
    }

    #[test]
    fn defect_that_is_no_version_of_a_body_gets_a_build_of_its_own() {
        let refused = Refused { defects: BTreeSet::from(["g".to_owned()]), ..Refused::default() };
        let plan = plan(&[("a", "A: u8 = 1", "A: u8 = 2"), ("g", "7", "8")], &refused);
        let alone: Vec<(&str, &str)> = plan.alone.iter().map(|(name, why)| (name.as_str(), *why)).collect();
        assert_eq!(alone, [("a", "outside of a function"), ("g", "does not compile beside the original")]);
        assert!(plan.files.is_empty());
    }

    #[test]
    fn compiler_blames_the_version_of_its_line() {
        let plan = plan(&ROWS, &Refused::default());
        let blamed = |text: &str| plan.blamed(text, read).defects.into_iter().collect::<Vec<_>>().join(" ");
        let message = "c/src/a.rs:4:5: error[E0308]: mismatched types\nerror: could not compile";
        assert_eq!(blamed(message), "three");
        assert_eq!(blamed("c/src/a.rs:8:5: error: no"), "two");
        assert_eq!(blamed("c/src/a.rs:11:5: error: no\nc/src/b.rs:4:5: error: no"), "");
    }

    #[test]
    fn function_that_calls_one_with_versions_is_const_no_more() {
        let first = plan(&ROWS, &Refused::default());
        let line = text(&first).lines().position(|line| line == "    g()").expect("in h") + 1;
        let error = "error[E0015]: cannot call non-const function `a::g` in";
        let mut refused = first.blamed(&format!("{FILE}:{line}:5: {error} constant functions"), read);
        assert_eq!(refused.defects, BTreeSet::new());
        assert!(text(&plan(&ROWS, &refused)).contains("\n fn h() -> u8 {\n    g()\n}\n"));
        // In a constant nothing helps.
        let constant = first.blamed(&format!("{FILE}:1:15: {error} constants"), read);
        assert_eq!(constant.defects, BTreeSet::from(["g".to_owned()]));
        assert!(refused.add(constant.clone()) && !refused.add(constant));
    }

    #[test]
    fn each_defect_of_the_list_is_planned() {
        let all = list::read(&crate::program::root().join(list::LIST)).expect("complete");
        let all: Vec<&Defect> = all.iter().collect();
        let plan = Switched::plan(&all, &Refused::default(), crate::defects::tree::text).expect("planned");
        // Each costs a build of the simulator, minutes.
        let alone: Vec<&str> = plan.alone.keys().map(String::as_str).collect();
        assert_eq!(alone, ["storage-3"]);
        let numbers: BTreeSet<u64> = all.iter().map(|defect| number(&defect.name)).collect();
        assert_eq!(numbers.len(), all.len(), "two names have one number");
        assert!(!numbers.contains(&0));
    }
}
