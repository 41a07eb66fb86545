//! Reproducible tests and simulations: no clock, no sleep, floors of the simulator, no work skipped silently.

use super::tokens::{Token, closing, reads, scan, scan_tokens, tokens, without_tests};
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
    if programs.contains(&source.path.as_str()) || source.is_in("hil-sim/examples") || source.is_in("xtask") {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let token = &tokens[at];
        (!token.is_literal && ["Instant", "SystemTime"].contains(&token.text.as_str()))
            .then(|| format!("{}: time is passed in, never read", token.text))
    })
}

/// The floors of hil-sim, the lowest first, each with what of std and of other crates it does without.
const FLOORS: [(&str, &[&str], &[&str]); 4] = [
    ("world", &["env", "fs", "io", "net", "os", "process", "thread", "time"], &TERMINALS),
    ("experiment", &["env", "net", "os", "process", "thread", "time"], &TERMINALS),
    ("tuning", &["env", "fs", "net", "os", "process", "time"], &TERMINALS),
    ("ports", &[], &[]),
];

const TERMINALS: [&str; 8] =
    ["clap", "eprint", "eprintln", "indicatif", "print", "println", "rustix", "socketcan"];

/// Each floor imports itself and those below it, and nothing of the outside above `ports`.
fn floors(source: &Source) -> Vec<Violation> {
    let Some(path) = source.path.strip_prefix("hil-sim/src/").and_then(|path| path.strip_suffix(".rs"))
    else {
        return Vec::new();
    };
    let modules: Vec<&str> = path.split('/').filter(|module| *module != "mod").collect();
    let Some(floor) = FLOORS.iter().position(|(name, ..)| *name == modules[0]) else { return Vec::new() };
    let (name, std, others) = FLOORS[floor];
    let below = &FLOORS[..=floor];
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
            "crate" if reads(tokens, at + 1, &[":", ":"]) => {
                let to = tokens.get(at + 3)?.text.as_str();
                (!below.iter().any(|(floor, ..)| *floor == to)).then(|| {
                    format!(
                        "crate::{to}: {name} may import only crate::{}",
                        below.iter().map(|(floor, ..)| *floor).collect::<Vec<_>>().join(", crate::")
                    )
                })
            }
            "super" if starts => {
                let supers = (0..).take_while(|i| reads(tokens, at + 3 * i, &["super", ":", ":"])).count();
                (supers >= modules.len() + blocks(tokens, at))
                    .then(|| format!("super leaves {name}: write crate:: and the floor"))
            }
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

fn blocks(tokens: &[Token], at: usize) -> usize {
    let around = |open: &usize| reads(tokens, open + 2, &["{"]) && closing(tokens, open + 2) > at;
    (0..at).filter(|open| tokens[*open].text == "mod").filter(around).count()
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
fn floors_of_the_simulator_import_downwards() {
    check_workspace(floors);
    for (floor, ..) in FLOORS {
        let path = format!("hil-sim/src/{floor}.rs");
        assert!(files("rs").iter().any(|file| file.path == path), "no {path}: its fence guards nothing");
    }
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
        "hil-sim/src/experiment/trace.rs",
        &[now, "use std::time::SystemTime;"],
        &["/// Instant\nfn f() {}"],
    );
    check_fence(clock, "xtask/src/ci.rs", &[], &[now]);
    check_fence(clock, "wraptor/src/deadline.rs", &[], &[now]);
    check_fence(clock, "wraptor/src/hand.rs", &[now], &[]);
}

#[test]
fn floor_fence_finds_each_breach() {
    check_fence(
        floors,
        "hil-sim/src/world/hand.rs",
        &[
            "use crate::experiment::run::Options;",
            "use crate::ports::keep::Keeper;",
            "use crate::Model;",
            "use crate::{world::bus, ports};",
            "use super::super::experiment;",
            "mod a { use super::super::super::ports::b; }",
            "use std::fs::File;",
            "use std::{collections::BTreeMap, io::Write};",
            "fn f() { std::net::TcpStream::connect(a); }",
            "use std::time::SystemTime;",
            "fn f() { std::thread::spawn(g); }",
            "fn f() { println!(); }",
            "use indicatif::ProgressBar;",
        ],
        &[
            "use crate::world::bus::Bus; use super::bus; mod a { use super::super::bus; }",
            "use std::{collections::VecDeque, fmt}; use std::rc::Rc; // std::fs",
            "fn f(print: u8) { a.print(); b::print::c(); \"crate::ports\"; }",
        ],
    );
    check_fence(
        floors,
        "hil-sim/src/experiment/run.rs",
        &["use crate::ports::output::print;", "use std::net::UdpSocket;", "fn f() { eprintln!(); }"],
        &["use crate::world::bus::Bus; use crate::experiment::trace; use std::io::Write;"],
    );
    let any = "use crate::{world, experiment}; use std::net::TcpStream; fn f() { println!(); }";
    check_fence(
        floors,
        "hil-sim/src/ports/tcp.rs",
        &["use crate::Model;", any],
        &["use std::net::TcpStream; fn f() { println!(); }"],
    );
    check_fence(floors, "hil-sim/src/lib.rs", &[], &["pub use ports::cli; use crate::Model;"]);
    check_fence(floors, "board-emu/src/world/a.rs", &[], &["use std::net::TcpStream;"]);
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
