//! What judges a hand by physics knows the plant, the wire and the documents, and nothing of the code that it judges.

use super::tokens::tokens;
use super::{Source, Violation, check_fence, check_workspace};

/// The judge's file and folder, and the crates whose names it may not have.
const JUDGE: &str = "hil-sim/src/experiment/torture/invariant.rs";
const FOLDER: &str = "hil-sim/src/experiment/torture/invariant/";
const JUDGED: [&str; 3] = ["servo_core", "tater_fw", "god"];

/// The one file that translates for the judge.
const TRANSLATOR: &str = "hil-sim/src/experiment/torture/observe.rs";

fn violations(source: &Source) -> Vec<Violation> {
    if source.path != JUDGE && !source.path.starts_with(FOLDER) {
        return Vec::new();
    }
    match tokens(source) {
        Ok(tokens) => tokens
            .iter()
            .filter(|token| JUDGED.contains(&token.text.as_str()))
            .map(|token| {
                source.violation(
                    token.line,
                    format!(
                        "the judge names {}: take it from the plant or the wire, or let {TRANSLATOR} translate it",
                        token.text
                    ),
                )
            })
            .collect(),
        Err(violation) => vec![violation],
    }
}

#[test]
fn judge_knows_nothing_of_what_it_judges() {
    for path in [JUDGE, FOLDER, TRANSLATOR] {
        assert!(super::root().join(path).exists(), "{path} is gone: correct this fence");
    }
    check_workspace(violations);
    let a_file = format!("{FOLDER}contact.rs");
    for path in [JUDGE, &a_file] {
        check_fence(
            violations,
            path,
            &["use servo_core::mode::Mode;", "fn f() { tater_fw::g() }", "use god::io::ABORT;"],
            &["// god\nuse tater_wire::Property;"],
        );
    }
}
