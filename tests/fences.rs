//! Fences: the dependencies and invariants of ARCHITECTURE.md that can be checked by reading source text.
//!
//! Each fence is a function from a source text to its violations. It runs over every file of the workspace,
//! and over offending texts beside its definition, which show that it can fail.

mod arrows;
mod circles;
mod docs;
mod judge;
mod lengths;
mod metal;
mod modules;
mod motion_only;
mod tokens;
mod used;
mod world;

use std::fmt;
use std::path::{Path, PathBuf};

/// A violation, printed as `file:line: problem, remedy`.
#[derive(Debug)]
struct Violation {
    file: String,
    line: usize,
    text: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.file, self.line, self.text)
    }
}

/// A source file: path from the workspace's root with `/` between its parts, and text.
pub struct Source {
    pub path: String,
    pub text: String,
}

impl Source {
    fn new(path: &str, text: &str) -> Self {
        Self { path: path.into(), text: text.into() }
    }

    fn violation(&self, line: usize, text: impl Into<String>) -> Violation {
        Violation { file: self.path.clone(), line, text: text.into() }
    }

    fn is_in(&self, folder: &str) -> bool {
        self.path.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/'))
    }
}

/// The workspace's root. Read at run time, so that a built binary can check another checkout.
pub fn root() -> PathBuf {
    let manifest = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_else(|_| env!("CARGO_MANIFEST_DIR").into());
    Path::new(&manifest).parent().expect("tests/ lies in the workspace").to_path_buf()
}

/// Every file outside `target`, `out` and hidden folders.
fn paths(root: &Path) -> Vec<PathBuf> {
    let (mut found, mut folders) = (Vec::new(), vec![root.to_path_buf()]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("the workspace can be read") {
            let path = entry.expect("the workspace can be read").path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if !path.is_dir() {
                found.push(path);
            } else if name != "target" && name != "out" && !name.starts_with('.') {
                folders.push(path);
            }
        }
    }
    found
}

/// The sources named `name` or `*.name`.
pub fn files(name: &str) -> Vec<Source> {
    let (root, suffix) = (root(), format!(".{name}"));
    let mut found = Vec::new();
    for path in paths(&root) {
        let file = path.file_name().unwrap_or_default().to_string_lossy();
        if file == name || file.ends_with(&suffix) {
            let text = std::fs::read_to_string(&path).expect("sources are UTF-8");
            let path = path.strip_prefix(&root).expect("found below the root");
            found.push(Source::new(&path.to_string_lossy().replace('\\', "/"), &text));
        }
    }
    assert!(found.len() > 3, "only {} files {name} under {}", found.len(), root.display());
    found
}

fn assert_none(violations: &[Violation]) {
    let lines: Vec<String> = violations.iter().map(ToString::to_string).collect();
    assert!(lines.is_empty(), "{} violations:\n{}", lines.len(), lines.join("\n"));
}

fn check_workspace(fence: fn(&Source) -> Vec<Violation>) {
    assert_none(&files("rs").iter().flat_map(fence).collect::<Vec<_>>());
}

/// Asserts that a fence finds exactly one violation in each offending text, and none in a clean one.
fn check_fence(fence: fn(&Source) -> Vec<Violation>, path: &str, offending: &[&str], clean: &[&str]) {
    for text in offending {
        let found = fence(&Source::new(path, text));
        assert_eq!(found.len(), 1, "in {path}: {text}\nfound {found:?}");
    }
    for text in clean {
        assert_none(&fence(&Source::new(path, text)));
    }
}
