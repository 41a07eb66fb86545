//! Functions fit a screen, and names are specific. A file is as long as its one subject.

use super::tokens::{item_end, scan, tokens};
use super::{Source, Violation, check_fence, check_workspace};

const FUNCTION_LINES: usize = 70;

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
