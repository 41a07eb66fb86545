//! Tests and simulations that repeat: no clock, no sleep; and no work left out silently.

use super::tokens::{closing, reads, scan};
use super::{Source, Violation, check_fence, check_workspace};

/// Nothing waits: a test that sleeps is slow, and fails when the machine is busy.
fn waiting(source: &Source) -> Vec<Violation> {
    scan(source, |tokens, at| {
        reads(tokens, at, &["sleep", "("]).then(|| "sleep: time is passed in, never waited for".into())
    })
}

/// Time is passed in, never read; only programs may say how long something took.
fn clock(source: &Source) -> Vec<Violation> {
    let programs = ["hil-sim/src/main.rs", "board-emu/src/main.rs"];
    if programs.contains(&source.path.as_str()) || source.is_in("hil-sim/examples") || source.is_in("xtask") {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let token = &tokens[at];
        (!token.is_literal && ["Instant", "SystemTime"].contains(&token.text.as_str()))
            .then(|| format!("{}: time is passed in, never read", token.text))
    })
}

/// A test that does not run, or code that is not there.
fn unfinished(source: &Source) -> Vec<Violation> {
    scan(source, |tokens, at| {
        let name = tokens[at].text.as_str();
        if ["todo", "unimplemented"].contains(&name) && reads(tokens, at + 1, &["!"]) {
            return Some(format!("{name}!: finish it, or leave it out"));
        }
        let ignores = reads(tokens, at, &["#", "["])
            && tokens[at..closing(tokens, at + 1)]
                .iter()
                .any(|token| !token.is_literal && token.text == "ignore");
        ignores.then(|| "an ignored test proves nothing: mend it or remove it".into())
    })
}

/// A lint switched off without a reason.
fn reasonless(source: &Source) -> Vec<Violation> {
    scan(source, |tokens, at| {
        let open = at + 1 + usize::from(reads(tokens, at + 1, &["!"]));
        let is_attribute = tokens[at].text == "#" && reads(tokens, open, &["["]);
        let name = tokens
            .get(open + 1)
            .filter(|name| is_attribute && ["allow", "expect"].contains(&name.text.as_str()))?;
        let reasoned = (open..closing(tokens, open)).any(|i| reads(tokens, i, &["reason", "="]));
        (!reasoned).then(|| format!("#[{}] without reason = \"...\"", name.text))
    })
}

#[test]
fn nothing_sleeps() {
    check_workspace(waiting);
}

#[test]
fn nothing_reads_a_clock() {
    check_workspace(clock);
}

#[test]
fn nothing_is_left_unfinished() {
    check_workspace(unfinished);
}

#[test]
fn every_silenced_lint_has_a_reason() {
    check_workspace(reasonless);
}

#[test]
fn the_sleep_fence_can_fail() {
    check_fence(
        waiting,
        "tests/a.rs",
        &["fn f() { std::thread::sleep(d); }", "fn f() { sleep(d) }"],
        &["fn f() { asleep(d) } // sleep("],
    );
}

#[test]
fn the_clock_fence_can_fail() {
    let now = "fn f() { std::time::Instant::now(); }";
    check_fence(
        clock,
        "hil-sim/src/trace.rs",
        &[now, "use std::time::SystemTime;"],
        &["/// Instant\nfn f() {}"],
    );
    check_fence(clock, "xtask/src/ci.rs", &[], &[now]);
}

#[test]
fn the_unfinished_fence_can_fail() {
    check_fence(
        unfinished,
        "tests/a.rs",
        &[
            "fn f() { todo!() }",
            "fn f() { unimplemented!(\"x\") }",
            "#[ignore] fn t() {}",
            "#[ignore = \"slow\"] fn t() {}",
            "#[cfg_attr(a, ignore)] fn t() {}",
        ],
        &["fn f() { ignore(a[0]) } // todo!()", "/// ignore\nfn f() {}"],
    );
}

#[test]
fn the_reason_fence_can_fail() {
    check_fence(
        reasonless,
        "a/src/b.rs",
        &["#[allow(dead_code)] fn f() {}", "#![expect(clippy::all)]"],
        &["#[allow(dead_code, reason = \"the metal calls it\")] fn f() {}", "fn f() { a.expect(\"b\") }"],
    );
}
