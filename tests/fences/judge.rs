//! What judges a hand by physics knows the plant, the wire and the documents, and nothing of the code that it judges.

use super::tokens::tokens;
use super::{Source, Violation, check_fence, check_workspace};

/// The judge's file and folder, and the crates whose names it may not have.
const JUDGE: &str = "hil-sim/torture/src/invariant.rs";
const FOLDER: &str = "hil-sim/torture/src/invariant/";
const JUDGED: [&str; 3] = ["servo_core", "tater_fw", "god"];

/// The only file of the judge that names kinds of fault: it has a reason for each.
const EXCUSES: &str = "hil-sim/torture/src/invariant/excuse.rs";

/// The one file that translates for the judge.
const TRANSLATOR: &str = "hil-sim/torture/src/observe.rs";

fn violations(source: &Source) -> Vec<Violation> {
    if source.path != JUDGE && !source.path.starts_with(FOLDER) {
        return Vec::new();
    }
    let tokens = match tokens(source) {
        Ok(tokens) => tokens,
        Err(violation) => return vec![violation],
    };
    let problem = |name: &str| {
        if JUDGED.contains(&name) {
            Some(format!(
                "the judge names {name}: take it from the plant or the wire, or let {TRANSLATOR} translate it"
            ))
        } else if name == "FaultKind" && source.path != EXCUSES {
            Some(format!("a check names kinds of fault: an excuse is a row of {EXCUSES}, with its reason"))
        } else {
            None
        }
    };
    tokens.iter().filter_map(|token| Some(source.violation(token.line, problem(&token.text)?))).collect()
}

#[test]
fn judge_knows_nothing_of_what_it_judges() {
    for path in [JUDGE, FOLDER, EXCUSES, TRANSLATOR] {
        assert!(super::root().join(path).exists(), "{path} is gone: correct this fence");
    }
    check_workspace(violations);
    let a_file = format!("{FOLDER}contact.rs");
    for path in [JUDGE, &a_file] {
        check_fence(
            violations,
            path,
            &[
                "use servo_core::mode::Mode;",
                "fn f() { tater_fw::g() }",
                "use god::io::ABORT;",
                "use crate::kinds::{FaultKind, Kinds};",
            ],
            &["// god\nuse tater_wire::Property;"],
        );
    }
    check_fence(
        violations,
        EXCUSES,
        &["use servo_core::mode::Mode;"],
        &["use crate::kinds::{FaultKind as F, Kinds};"],
    );
}
