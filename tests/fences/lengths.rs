//! Functions fit a screen, and names are specific. A file is as long as its one subject.

use std::path::Path;

use super::tokens::{item_end, scan, tokens};
use super::{Source, Violation, check_fence, check_workspace, paths, root};

const FUNCTION_LINES: usize = 70;

/// The largest file is docs/tuning/report.html, 1.3 MB. A library or program that a build left behind is larger.
const FILE_BYTES: u64 = 2 << 20;

/// Files that are no source, with their bytes.
fn large_files(folder: &Path) -> Vec<String> {
    let bytes = |path: &Path| path.symlink_metadata().map_or(0, |file| file.len());
    let large = paths(folder).into_iter().filter(|path| bytes(path) > FILE_BYTES);
    large.map(|path| format!("{}: {} bytes, at most {FILE_BYTES}", path.display(), bytes(&path))).collect()
}

fn function_length(source: &Source) -> Vec<Violation> {
    scan(source, |tokens, at| {
        // `fn(` is the type of a function pointer.
        let name = tokens.get(at + 1).filter(|next| tokens[at].text == "fn" && next.text != "(")?;
        let end = tokens.get(item_end(tokens, at))?;
        let lines = end.line - tokens[at].line + 1;
        (lines > FUNCTION_LINES)
            .then(|| format!("fn {} has {lines} lines, at most {FUNCTION_LINES}", name.text))
    })
}

fn names(source: &Source) -> Vec<Violation> {
    let file = source.path.rsplit('/').next().unwrap_or_default();
    if ["utils.rs", "util.rs", "common.rs", "helpers.rs"].contains(&file) {
        return vec![source.violation(1, "a file name that says nothing: name what it decides")];
    }
    scan(source, |tokens, at| {
        let token = &tokens[at];
        (!token.is_literal && token.text.ends_with("Manager"))
            .then(|| format!("{}: name what it does, not that it does something", token.text))
    })
}

#[test]
fn functions_fit_a_screen() {
    check_workspace(function_length);
}

#[test]
fn files_are_no_products_of_a_build() {
    assert_eq!(large_files(&root()), Vec::<String>::new(), "delete them, or move them below target/ or out/");
}

#[test]
fn large_file_is_found() {
    let folder = std::env::temp_dir().join(format!("fence-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("src")).expect("a folder");
    let write = |name: &str, bytes| std::fs::write(folder.join(name), vec![0; bytes]).expect("written");
    write("src/small", 2 << 20);
    write("src/lib.a", (2 << 20) + 1);
    let found = large_files(&folder);
    std::fs::remove_dir_all(&folder).expect("removed");
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].contains("lib.a: 2097153 bytes"), "{found:?}");
}

#[test]
fn names_are_specific() {
    check_workspace(names);
}

#[test]
fn length_fence_finds_each_violation() {
    let function = |lines: usize| format!("fn f(a: [u8; 3]) {{{}}}", "\n".repeat(lines - 1));
    let inside_a_macro = format!("proptest! {{ {} }}", function(71));
    check_fence(
        function_length,
        "a/src/b.rs",
        &[&function(71), &inside_a_macro],
        &[&function(70), "type F = fn(u8);", "trait T { fn f(); }"],
    );
}

#[test]
fn name_fence_finds_each_violation() {
    check_fence(names, "a/src/b.rs", &["struct MotorManager;"], &["struct Motor; // not a Manager"]);
    check_fence(names, "a/src/utils.rs", &[""], &[]);
}

#[test]
fn lexer_reports_invalid_source() {
    assert!(tokens(&Source::new("a.rs", "fn f( {")).is_err());
    check_fence(function_length, "a.rs", &["fn f( {"], &[]);
}
