//! What is visible is used: `pub` hides from the compiler that nobody calls an item. Names are compared, so an item passes if anything that has
//! its name is used.

use std::collections::{BTreeMap, BTreeSet};

use super::tokens::{Token, closing, item_end, reads, tokens, without_tests};
use super::{Source, Violation, assert_none, files};

/// Crates of the firmware: what only tests use is in the image for nothing, or is not what the image does.
const FIRMWARE: [&str; 7] =
    ["servo-core", "tater-wire", "boot", "tater-fw", "bsp-stm32f1", "boards/tater-f103", "god"];

/// Crates that only this workspace uses: what no other crate needs is `pub(crate)`.
const OWN: [&str; 5] =
    ["commission", "hil-sim/world", "hil-sim/experiment", "hil-sim/torture", "hil-sim/tuning"];

/// An item by name, where it is defined.
struct Item {
    name: String,
    line: usize,
    is_pub: bool,
}

/// Attributes of functions that the hardware or another language calls.
const ENTRIES: [&str; 4] = ["exception", "export_name", "no_mangle", "panic_handler"];

/// The functions, constants and modules that a text defines outside of implementations of traits, whose methods others call.
fn items(tokens: &[Token]) -> Vec<Item> {
    let mut found = Vec::new();
    let (mut at, mut is_pub, mut is_entry) = (0, false, false);
    while at < tokens.len() {
        let text = tokens[at].text.as_str();
        match text {
            "impl" | "trait" => {
                let open = (at..tokens.len()).find(|&i| tokens[i].text == "{").unwrap_or(tokens.len());
                let is_of_trait = text == "trait" || tokens[at..open].iter().any(|token| token.text == "for");
                at = if is_of_trait { item_end(tokens, at) + 1 } else { open + 1 };
                (is_pub, is_entry) = (false, false);
                continue;
            }
            "macro_rules" => {
                at = item_end(tokens, at) + 1;
                (is_pub, is_entry) = (false, false);
                continue;
            }
            "#" if reads(tokens, at + 1, &["["]) => {
                let end = closing(tokens, at + 1);
                is_entry |= tokens[at..end].iter().any(|token| ENTRIES.contains(&token.text.as_str()));
                at = end;
            }
            "pub" => is_pub = !reads(tokens, at + 1, &["("]),
            "fn" | "const" | "mod" => {
                let name = tokens.get(at + 1).map_or("", |token| token.text.as_str());
                let is_name = name.starts_with(|letter: char| letter.is_alphabetic());
                if is_name && !["fn", "unsafe", "async", "extern"].contains(&name) {
                    if !is_entry {
                        found.push(Item { name: name.to_owned(), line: tokens[at].line, is_pub });
                    }
                    (is_pub, is_entry) = (false, false);
                }
            }
            ";" | "{" | "}" => is_pub = false,
            _ => {}
        }
        at += 1;
    }
    found
}

/// Whether a file is a crate's test, by its place.
fn is_test(path: &str) -> bool {
    let is_folder = path.split('/').any(|part| part == "tests" || part == "examples" || part == "benches");
    is_folder || path.ends_with("/tests.rs") || path.ends_with("/testing.rs") || path.starts_with("fuzz/")
}

/// The crate whose `src` holds the file, or its folder for another file.
fn crate_of(path: &str) -> &str {
    path.split_once("/src/").map_or_else(|| path.split('/').next().unwrap_or_default(), |(crate_, _)| crate_)
}

/// The crates that have each name in their code, apart from its definitions; tests apart, as "CRATE tests".
type Uses = BTreeMap<String, BTreeSet<String>>;

fn uses(sources: &[Source]) -> Result<Uses, Violation> {
    let mut uses = Uses::new();
    for source in sources {
        let all = tokens(source)?;
        let code: BTreeSet<usize> = without_tests(tokens(source)?).iter().map(|token| token.line).collect();
        let own = crate_of(&source.path);
        for (at, token) in all.iter().enumerate() {
            let before = at.checked_sub(1).map_or("", |before| all[before].text.as_str());
            // `const A` without a type is an operand of assembler.
            if ["fn", "mod"].contains(&before) || before == "const" && reads(&all, at + 1, &[":"]) {
                continue;
            }
            let is_code = !is_test(&source.path) && code.contains(&token.line);
            let user = if is_code { own.to_owned() } else { format!("{own} tests") };
            let mut add = |name: &str| _ = uses.entry(name.to_owned()).or_default().insert(user.clone());
            if token.is_literal {
                // What a text formats: "{NAME}".
                token.text.split('{').skip(1).filter_map(|part| Some(part.split_once('}')?.0)).for_each(add);
            } else {
                add(&token.text);
            }
        }
    }
    Ok(uses)
}

fn unused(sources: &[Source]) -> Vec<Violation> {
    let uses = match uses(sources) {
        Ok(uses) => uses,
        Err(violation) => return vec![violation],
    };
    let none = BTreeSet::new();
    let mut violations = Vec::new();
    for source in sources.iter().filter(|source| !is_test(&source.path) && source.path.contains("/src/")) {
        let own = crate_of(&source.path);
        let Ok(tokens) = tokens(source) else { continue };
        for item in items(&without_tests(tokens)) {
            let users = uses.get(&item.name).unwrap_or(&none);
            if FIRMWARE.contains(&own) && !users.iter().any(|user| !user.ends_with(" tests")) {
                let text = format!("only tests use {}: delete it, or move it to them", item.name);
                violations.push(source.violation(item.line, text));
            } else if OWN.contains(&own) && item.is_pub && users.iter().all(|user| user == own) {
                let text = format!("no other crate uses {}: make it pub(crate)", item.name);
                violations.push(source.violation(item.line, text));
            }
        }
    }
    violations
}

#[test]
fn visible_items_are_used() {
    assert_none(&unused(&files("rs")));
}

#[test]
fn use_fence_finds_each_violation() {
    let found = |texts: &[(&str, &str)]| {
        let sources: Vec<Source> = texts.iter().map(|(path, text)| Source::new(path, text)).collect();
        unused(&sources).iter().map(ToString::to_string).collect::<Vec<_>>()
    };
    let lib =
        ("servo-core/src/lib.rs", "pub fn a() {}\npub const fn b() { a() }\nimpl T for U { fn c() {} }");
    let test = "#[cfg(test)]\nmod tests { fn d() { b() } }";
    assert_eq!(found(&[lib]), ["servo-core/src/lib.rs:2: only tests use b: delete it, or move it to them"]);
    assert_eq!(found(&[lib, ("servo-core/src/e.rs", test), ("tests/f.rs", "fn g() { b() }")]).len(), 1);
    assert_eq!(found(&[lib, ("hil-sim/world/src/f.rs", "fn g() { b() }")]), Vec::<String>::new());
    let entries = "#[exception]\nunsafe fn e() {}\nconst F: u8 = 1;\nfn g() { asm!(const F) }\nfn h() { g(); h(\"{I}\") }\nconst I: u8 = 2;";
    assert_eq!(found(&[("bsp-stm32f1/src/a.rs", entries)]), Vec::<String>::new());
    let own = ("commission/src/lib.rs", "pub mod a;\npub(crate) fn b() { a() }");
    assert_eq!(found(&[own]), ["commission/src/lib.rs:1: no other crate uses a: make it pub(crate)"]);
    assert_eq!(found(&[own, ("hil-sim/tests/b.rs", "use commission::a;")]), Vec::<String>::new());
    let private = ("commission/src/lib.rs", "pub trait T {}\nconst A: u8 = 1;\nfn b() { A; b() }");
    assert_eq!(found(&[private]), Vec::<String>::new());
}
