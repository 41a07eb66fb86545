//! What judges forces by physics knows the plant, the wire and the documents, and nothing of the code that it judges.

use super::tokens::tokens;
use super::{Source, Violation, check_fence, check_workspace};

/// The file of the judge, and the crates whose names it may not have.
const JUDGE: &str = "hil-sim/src/experiment/torture/invariant/contact.rs";
const JUDGED: [&str; 3] = ["servo_core", "tater_fw", "god"];

fn violations(source: &Source) -> Vec<Violation> {
    if source.path != JUDGE {
        return Vec::new();
    }
    match tokens(source) {
        Ok(tokens) => tokens
            .iter()
            .filter(|token| JUDGED.contains(&token.text.as_str()))
            .map(|token| {
                source.violation(
                    token.line,
                    format!("the judge names {}: take it from the plant or the wire", token.text),
                )
            })
            .collect(),
        Err(violation) => vec![violation],
    }
}

#[test]
fn judge_knows_nothing_of_what_it_judges() {
    assert!(super::root().join(JUDGE).is_file(), "{JUDGE} is gone: correct this fence");
    check_workspace(violations);
    check_fence(
        violations,
        JUDGE,
        &["use servo_core::mode::Mode;", "fn f() { tater_fw::g() }"],
        &["// god\nuse tater_wire::Property;"],
    );
}
