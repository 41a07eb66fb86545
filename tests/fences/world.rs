//! Reproducible tests and simulations: no clock, no sleep, the outside passed in, no work skipped silently.

use super::tokens::{closing, reads, scan, scan_tokens, tokens, without_tests};
use super::{Source, Violation, check_fence, check_workspace, files};

/// Sleeping makes tests slow, and fail on a busy machine.
fn waiting(source: &Source) -> Vec<Violation> {
    scan(source, |tokens, at| {
        reads(tokens, at, &["sleep", "("]).then(|| "sleep: time is passed in, never waited for".into())
    })
}

/// Time is passed in; only programs may measure their own time, and the host library, whose calls have deadlines in real time, in one place.
fn clock(source: &Source) -> Vec<Violation> {
    let programs = ["hil-sim/src/main.rs", "board-emu/src/main.rs", "wraptor/src/deadline.rs"];
    let folders = ["hil-sim/examples", "hil-sim/experiment/examples", "xtask"];
    if programs.contains(&source.path.as_str()) || folders.iter().any(|folder| source.is_in(folder)) {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let token = &tokens[at];
        (!token.is_literal && ["Instant", "SystemTime"].contains(&token.text.as_str()))
            .then(|| format!("{}: time is passed in, never read", token.text))
    })
}

/// Crates of the simulator and of its tools, each with what of std and of other crates it does without: which of ours it may import
/// is in [`super::arrows`].
const INSIDE: [(&str, &[&str], &[&str]); 7] = [
    ("hil-sim/world/src", &["env", "fs", "io", "net", "os", "process", "thread", "time"], &TERMINALS),
    ("hil-sim/experiment/src", &["env", "net", "os", "process", "thread", "time"], &TERMINALS),
    ("hil-sim/torture/src", &["env", "fs", "net", "os", "process", "thread", "time"], &TERMINALS),
    ("hil-sim/tuning/src", &["env", "fs", "net", "os", "process", "time"], &TERMINALS),
    ("commission/src", &["env", "net", "os", "process", "thread"], &TERMINALS),
    ("traces/src", &["env", "fs", "net", "os", "process", "thread", "time"], &TERMINALS),
    ("charts/src", &["env", "fs", "io", "net", "os", "process", "thread", "time"], &TERMINALS),
];

const TERMINALS: [&str; 8] =
    ["clap", "eprint", "eprintln", "indicatif", "print", "println", "rustix", "socketcan"];

/// Nothing of the outside, which only programs have: who calls these crates passes it in.
fn outside(source: &Source) -> Vec<Violation> {
    let Some((name, std, others)) = INSIDE.iter().find(|(folder, ..)| source.is_in(folder)) else {
        return Vec::new();
    };
    let tokens = match tokens(source) {
        Ok(tokens) => without_tests(tokens),
        Err(violation) => return vec![violation],
    };
    scan_tokens(source, &tokens, |tokens, at| {
        let token = &tokens[at];
        if token.is_literal {
            return None;
        }
        let starts = at == 0 || !["::", ":", "."].contains(&tokens[at - 1].text.as_str());
        match token.text.as_str() {
            "std" if starts && reads(tokens, at + 1, &[":", ":"]) => {
                let first = tokens.get(at + 3)?;
                let end = if first.text == "{" { closing(tokens, at + 3) } else { at + 4 };
                let found = tokens[at + 3..end].iter().find(|token| std.contains(&token.text.as_str()))?;
                Some(format!("std::{}: {name} does without; pass in what it needs", found.text))
            }
            other => {
                let is_path_or_macro = reads(tokens, at + 1, &[":", ":"]) || reads(tokens, at + 1, &["!"]);
                (starts && is_path_or_macro && others.contains(&other))
                    .then(|| format!("{other}: {name} has no terminal; return what is to be shown"))
            }
        }
    })
}

/// What the platform's own library computes, and not to the same bit everywhere.
const TRANSCENDENTAL: [&str; 22] = [
    "acos", "asin", "atan", "atan2", "cbrt", "cos", "cosh", "exp", "exp2", "exp_m1", "hypot", "ln", "ln_1p",
    "log10", "log2", "powf", "powi", "sin", "sin_cos", "sinh", "tan", "tanh",
];

/// The world and its judge give the same bits on every platform: their transcendental functions are libm's.
fn platform(source: &Source) -> Vec<Violation> {
    let folders = ["hil-sim/world/src", "hil-sim/torture/src", "kinematics/src"];
    if !folders.iter().any(|folder| source.is_in(folder)) {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let name = tokens[at].text.as_str();
        let is_call =
            at > 0 && [".", ":"].contains(&tokens[at - 1].text.as_str()) && reads(tokens, at + 1, &["("]);
        let is_libm = at > 2 && tokens[at - 3].text == "libm";
        (is_call && !is_libm && TRANSCENDENTAL.contains(&name))
            .then(|| format!("{name}: libm's gives the same bits on every platform"))
    })
}

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
fn only_programs_know_the_outside() {
    check_workspace(outside);
    for (folder, ..) in INSIDE {
        let root = format!("{folder}/lib.rs");
        assert!(files("rs").iter().any(|file| file.path == root), "no {root}: its fence guards nothing");
    }
}

#[test]
fn world_computes_the_same_bits_everywhere() {
    check_workspace(platform);
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
fn sleep_fence_finds_each_violation() {
    check_fence(
        waiting,
        "tests/a.rs",
        &["fn f() { std::thread::sleep(d); }", "fn f() { sleep(d) }"],
        &["fn f() { asleep(d) } // sleep("],
    );
}

#[test]
fn clock_fence_finds_each_violation() {
    let now = "fn f() { std::time::Instant::now(); }";
    check_fence(
        clock,
        "hil-sim/experiment/src/trace.rs",
        &[now, "use std::time::SystemTime;"],
        &["/// Instant\nfn f() {}"],
    );
    check_fence(clock, "xtask/src/ci.rs", &[], &[now]);
    check_fence(clock, "wraptor/src/deadline.rs", &[], &[now]);
    check_fence(clock, "wraptor/src/hand.rs", &[now], &[]);
}

#[test]
fn outside_fence_finds_each_breach() {
    check_fence(
        outside,
        "hil-sim/world/src/hand.rs",
        &[
            "use std::fs::File;",
            "use std::{collections::BTreeMap, io::Write};",
            "fn f() { std::net::TcpStream::connect(a); }",
            "use std::time::SystemTime;",
            "fn f() { std::thread::spawn(g); }",
            "fn f() { println!(); }",
            "use indicatif::ProgressBar;",
        ],
        &[
            "use crate::bus::Bus; use super::bus;",
            "use std::{collections::VecDeque, fmt}; use std::rc::Rc; // std::fs",
            "fn f(print: u8) { a.print(); b::print::c(); \"std::fs\"; }",
        ],
    );
    check_fence(
        outside,
        "hil-sim/experiment/src/run.rs",
        &["use std::net::UdpSocket;", "fn f() { eprintln!(); }"],
        &["use hil_world::bus::Bus; use std::io::Write;"],
    );
    let any = "use hil_world::bus; use std::net::TcpStream; fn f() { println!(); }";
    check_fence(outside, "hil-sim/src/tcp.rs", &[], &[any]);
}

#[test]
fn platform_fence_finds_each_breach() {
    check_fence(
        platform,
        "hil-sim/world/src/a.rs",
        &["fn f(a: f64) { a.exp(); }", "fn f(a: f64) { f64::sin(a); }", "fn f(a: f64) { a.powi(2) }"],
        &["fn f(a: f64) { libm::exp(a.sqrt()); exp(a) } // a.exp()"],
    );
    check_fence(platform, "hil-sim/tuning/src/a.rs", &[], &["fn f(a: f64) { a.exp(); }"]);
}

#[test]
fn unfinished_fence_finds_each_violation() {
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
fn reason_fence_finds_each_violation() {
    check_fence(
        reasonless,
        "a/src/b.rs",
        &["#[allow(dead_code)] fn f() {}", "#![expect(clippy::all)]"],
        &["#[allow(dead_code, reason = \"the metal calls it\")] fn f() {}", "fn f() { a.expect(\"b\") }"],
    );
}
