//! Documents name what exists: links, files, the code map, decisions.

use std::collections::BTreeSet;
use std::path::Path;

use super::{Source, Violation, assert_none, check_fence, files, root};

const NAMED: [&str; 4] = [".rs", ".toml", ".py", ".txt"];

fn normal(path: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()),
            _ => parts.push(part),
        }
    }
    parts.join("/")
}

/// Every relative link of a page leads to a file or folder, below `root`.
fn links(page: &Source, root: &Path) -> Vec<Violation> {
    let folder = page.path.rsplit_once('/').map_or("", |(folder, _)| folder);
    let mut found = Vec::new();
    for (index, line) in page.text.lines().enumerate() {
        for rest in line.split("](").skip(1) {
            let target = rest.split([')', '#']).next().unwrap_or_default();
            if target.is_empty() || target.contains(':') {
                continue;
            }
            if !root.join(normal(&format!("{folder}/{target}"))).exists() {
                found.push(page.violation(index + 1, format!("{target}: the link leads nowhere")));
            }
        }
    }
    found
}

/// Texts between backticks, outside fenced blocks, with their lines.
fn spans(page: &Source) -> Vec<(usize, &str)> {
    let mut found = Vec::new();
    let mut is_block = false;
    for (index, line) in page.text.lines().enumerate() {
        if line.starts_with("```") {
            is_block = !is_block;
        } else if !is_block {
            found.extend(line.split('`').skip(1).step_by(2).map(|span| (index + 1, span)));
        }
    }
    found
}

/// Every source file that a page names is the end of a path of the workspace.
fn named_files(page: &Source, paths: &[String]) -> Vec<Violation> {
    let is_file = |span: &str| {
        NAMED.iter().any(|end| span.ends_with(end))
            && !span.contains([' ', '*', '<'])
            && !span.starts_with('.')
    };
    let exists = |span: &str| paths.iter().any(|path| path == span || path.ends_with(&format!("/{span}")));
    spans(page)
        .into_iter()
        .filter(|(_, span)| is_file(span) && !exists(span))
        .map(|(line, span)| page.violation(line, format!("{span}: no file's path ends like this")))
        .collect()
}

/// The entries of the code map, each with its line and the path from the root. A line without indentation begins a folder;
/// one with two spaces has paths below it, or below its `src`, separated by commas, up to two spaces.
fn map(page: &Source) -> Vec<(usize, String, String)> {
    let mut entries = Vec::new();
    let mut folder = "";
    let block = page.text.lines().enumerate().skip_while(|(_, line)| *line != "## Code map");
    let block = block.skip_while(|(_, line)| !line.starts_with("```")).skip(1);
    for (index, line) in block.take_while(|(_, line)| !line.starts_with("```")) {
        let text = line.trim_start();
        let heads = text.split("  ").next().unwrap_or_default();
        match line.len() - text.len() {
            0 => folder = heads.trim_end_matches('/'),
            2 => entries.extend(heads.split(", ").map(|name| (index + 1, folder.into(), name.into()))),
            _ => {}
        }
    }
    entries
}

/// Every entry of the code map exists, and every module at the top of a crate's `src` has one.
fn code_map(page: &Source, root: &Path) -> Vec<Violation> {
    let mut found = Vec::new();
    let mut mapped = BTreeSet::new();
    let mut folders = BTreeSet::new();
    for (line, folder, name) in map(page) {
        let below = [root.join(&folder).join("src").join(&name), root.join(&folder).join(&name)];
        if !below.iter().any(|path| path.exists()) {
            found.push(page.violation(line, format!("{folder}/{name} is not there: correct the code map")));
        }
        let top = name.split('/').next().unwrap_or_default();
        mapped.insert(format!("{folder}/{}", top.trim_end_matches(".rs")));
        folders.insert(folder);
    }
    for folder in folders {
        let Ok(entries) = std::fs::read_dir(root.join(&folder).join("src")) else { continue };
        let names = entries.map(|entry| entry.expect("the workspace can be read").file_name());
        let stems: BTreeSet<String> =
            names.map(|name| name.to_string_lossy().trim_end_matches(".rs").into()).collect();
        for stem in stems {
            if !["lib", "main"].contains(&stem.as_str()) && !mapped.contains(&format!("{folder}/{stem}")) {
                found.push(page.violation(1, format!("{folder}/src/{stem} is not in the code map: add it")));
            }
        }
    }
    found
}

/// Every "decision 0007" has its record among `numbers`.
fn decisions(source: &Source, numbers: &BTreeSet<String>) -> Vec<Violation> {
    let mut found = Vec::new();
    for (index, line) in source.text.lines().enumerate() {
        for rest in line.split("ecision ").skip(1) {
            let number: String = rest.chars().take_while(char::is_ascii_digit).collect();
            if number.len() == 4 && !numbers.contains(&number) {
                found.push(source.violation(index + 1, format!("decision {number} has no record")));
            }
        }
    }
    found
}

/// Pages outside the repository, which no reader can look up.
const OUTSIDE: [&str; 3] = ["DESIGN", "PROTOCOL", "MANUAL-NOTES"];

fn outside_pages(source: &Source) -> Vec<Violation> {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    let cites = |line: &str| line.split(|c| !is_part(c)).any(|word| OUTSIDE.contains(&word));
    let lines = source.text.lines().enumerate().filter(|(_, line)| cites(line));
    lines
        .map(|(index, _)| {
            source.violation(index + 1, "cite the manual, a data sheet, a decision or a page of docs/")
        })
        .collect()
}

fn record(page: &Source) -> Vec<Violation> {
    let wanted = ["# ", "Date: 20", "Status: ", "## Context", "## Decision", "## Consequences"];
    let mut lines = page.text.lines();
    let missing = wanted.into_iter().find(|start| !lines.by_ref().any(|line| line.starts_with(start)));
    missing
        .map(|start| page.violation(1, format!("a record needs a line that begins with \"{start}\"")))
        .into_iter()
        .collect()
}

fn records() -> Vec<Source> {
    let pages = files("md").into_iter();
    pages.filter(|page| page.is_in("docs/decisions") && !page.path.ends_with("README.md")).collect()
}

fn numbers() -> BTreeSet<String> {
    let number = |page: &Source| page.path.trim_start_matches("docs/decisions/").chars().take(4).collect();
    records().iter().map(number).collect()
}

#[test]
fn links_lead_to_files() {
    assert_none(&files("md").iter().flat_map(|page| links(page, &root())).collect::<Vec<_>>());
}

#[test]
fn named_files_exist() {
    let paths: Vec<String> =
        NAMED.iter().flat_map(|end| files(end.trim_start_matches('.'))).map(|file| file.path).collect();
    assert_none(&files("md").iter().flat_map(|page| named_files(page, &paths)).collect::<Vec<_>>());
}

#[test]
fn the_code_map_is_the_tree() {
    let pages = files("md");
    let page = pages.iter().find(|page| page.path == "ARCHITECTURE.md").expect("the page");
    assert_none(&code_map(page, &root()));
}

#[test]
fn cited_decisions_have_records() {
    let numbers = numbers();
    let sources = ["rs", "md", "toml", "py"].into_iter().flat_map(files);
    assert_none(&sources.flat_map(|source| decisions(&source, &numbers)).collect::<Vec<_>>());
}

#[test]
fn no_page_from_outside_is_cited() {
    let sources = ["rs", "md", "toml", "py"].into_iter().flat_map(files);
    // This file names them.
    let sources = sources.filter(|source| source.path != "tests/fences/docs.rs");
    assert_none(&sources.flat_map(|source| outside_pages(&source)).collect::<Vec<_>>());
}

#[test]
fn records_are_whole_and_indexed() {
    assert_none(&records().iter().flat_map(record).collect::<Vec<_>>());
    assert_eq!(numbers().len(), records().len(), "two records have one number");
    let pages = files("md");
    let index = pages.iter().find(|page| page.path == "docs/decisions/README.md").expect("the index");
    for page in records() {
        let name = page.path.trim_start_matches("docs/decisions/");
        assert!(index.text.contains(&format!("({name})")), "{name} is not in docs/decisions/README.md");
    }
}

#[test]
fn the_document_fences_can_fail() {
    let here = root();
    check_fence(
        |page| links(page, &root()),
        "docs/a.md",
        &["[a](../nowhere.md)", "[a](board.md) [b](nowhere.md#there)"],
        &["[a](../README.md), [b](board.md#pins), [c](https://a.b/c.md)"],
    );
    check_fence(
        |page| named_files(page, &["a/src/b.rs".into()]),
        "a.md",
        &["`c.rs`", "see `b/src/b.rs`"],
        &["`b.rs`, `src/b.rs`, `a/src/b.rs`", "```\n`c.rs`\n```"],
    );
    check_fence(
        |page| decisions(page, &["0007".into()].into()),
        "a.rs",
        &["// decision 0008", "// Decision 0009."],
        &["// decision 0007, decision 12"],
    );
    check_fence(
        outside_pages,
        "a.rs",
        &["// as DESIGN 4.1 has it", "MANUAL-NOTES.md"],
        &["a design; PROTOCOL_VERSION"],
    );
    check_fence(
        record,
        "a.md",
        &[
            "# 1. A\nDate: 2026\nStatus: accepted\n## Context\n## Decision",
            "# 1. A\nDate: 2026\n## Context\n## Decision\n## Consequences",
        ],
        &["# 1. A\nDate: 2026\nStatus: accepted\n## Context\n## Decision\n## Consequences"],
    );
    let all_but = |name: &str| {
        let map = "## Code map\n```\nservo-core/  x\n  num.rs, units.rs  y\n  sense/, motion/, guard/, config.rs\n```\n";
        code_map(&Source::new("ARCHITECTURE.md", &map.replace(name, "nowhere.rs")), &here)
    };
    let (whole, wrong) = (all_but("none").len(), all_but("num.rs").len());
    assert_eq!(wrong, whole + 2, "an entry that is not there, and a file that has none");
}
