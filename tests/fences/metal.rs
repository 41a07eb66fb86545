//! What has registers: where it may be named, that its `unsafe` is explained, and that it decides nothing.

use super::tokens::{Token, closing, item_end, reads, scan};
use super::{Source, Violation, check_fence, check_workspace, files};

/// The board's folder, and its root module.
fn is_bsp(source: &Source) -> bool {
    source.path == "tater-fw/src/bsp.rs" || source.is_in("tater-fw/src/bsp")
}

/// The line on which the statement or item before the one of `tokens[at]` ends, or the block around it begins. Brackets
/// that are closed are stepped over; out of those that are open, the walk goes on outside.
fn end_of_previous(tokens: &[Token], at: usize) -> usize {
    let mut depth = 0_usize;
    for token in tokens[..at].iter().rev() {
        match token.text.as_str() {
            ")" | "]" => depth += 1,
            "(" | "[" => depth = depth.saturating_sub(1),
            ";" | "{" | "}" if depth == 0 => return token.line,
            _ => {}
        }
    }
    0
}

/// `unsafe` is the board's alone; and between the statement or item that it is part of and the one before stands a comment
/// with `SAFETY:` or a section `# Safety`. An attribute (`#[unsafe(..)]`) is part of its item.
fn unexplained(source: &Source) -> Vec<Violation> {
    let lines: Vec<&str> = source.text.lines().map(str::trim_start).collect();
    scan(source, |tokens, at| {
        let token = &tokens[at];
        if token.is_literal || token.text != "unsafe" {
            return None;
        }
        if !is_bsp(source) {
            return Some("unsafe: only tater-fw/src/bsp has registers".into());
        }
        let above = lines.get(end_of_previous(tokens, at)..token.line - 1).unwrap_or_default();
        let explained = above
            .iter()
            .any(|line| line.starts_with("//") && line.contains("SAFETY:") || *line == "/// # Safety");
        (!explained)
            .then(|| "unsafe without reason: `// SAFETY: ..` above its statement says why it holds".into())
    })
}

/// In tater-fw every module but the board's forbids `unsafe`.
fn unforbidden(source: &Source) -> Vec<Violation> {
    if source.path != "tater-fw/src/lib.rs" {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let name = tokens.get(at + 1).filter(|name| tokens[at].text == "mod" && name.text != "bsp")?;
        let is_public = at > 0 && tokens[at - 1].text == "pub";
        let start = at - usize::from(is_public);
        let forbidden =
            start >= 7 && reads(tokens, start - 7, &["#", "[", "forbid", "(", "unsafe_code", ")", "]"]);
        (!forbidden).then(|| format!("mod {}: directly above it stands #[forbid(unsafe_code)]", name.text))
    })
}

/// Registers are named by the board and by the two programs that start on it.
fn registers(source: &Source) -> Vec<Violation> {
    const CRATES: [&str; 6] =
        ["stm32f1xx_hal", "bxcan", "cortex_m", "cortex_m_rt", "cortex_m_rtic", "embedded_hal"];
    const PROGRAMS: [&str; 2] = ["tater-fw/src/app.rs", "tater-fw/src/bin/monitor.rs"];
    if is_bsp(source) || PROGRAMS.contains(&source.path.as_str()) {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let token = &tokens[at];
        (!token.is_literal && CRATES.contains(&token.text.as_str()))
            .then(|| format!("{}: a register; what needs one goes through trait Board", token.text))
    })
}

/// The board decides nothing: a method that it must have is shorter than this.
const METHOD_LINES: usize = 10;

fn long_method(source: &Source) -> Vec<Violation> {
    if !is_bsp(source) {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let name = tokens.get(at + 1).filter(|_| tokens[at].text == "fn")?;
        let of_the_board = (0..at).rev().any(|start| {
            let implements = |name| (start..at).any(|i| reads(tokens, i, &[name, "for"]));
            tokens[start].text == "impl"
                && item_end(tokens, start) > at
                && (implements("Board") || implements("Motor"))
        });
        let lines = tokens.get(item_end(tokens, at))?.line - tokens[at].line + 1;
        (of_the_board && lines >= METHOD_LINES).then(|| {
            format!("fn {} has {lines} lines, under {METHOD_LINES}: the board decides nothing", name.text)
        })
    })
}

/// A task of the application is one call into [`Tater`](tater_fw::Tater): it locks once.
fn locks(source: &Source) -> Vec<Violation> {
    if source.path != "tater-fw/src/app.rs" {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let is_task = ["task", "idle"].iter().any(|kind| reads(tokens, at, &["#", "[", kind]));
        if !is_task {
            return None;
        }
        let end = item_end(tokens, closing(tokens, at + 1));
        let locks = (at..end).filter(|i| reads(tokens, *i, &[".", "lock", "("])).count();
        (locks != 1).then(|| format!("a task that locks {locks} times: one call into Tater each"))
    })
}

/// The board loops only while it waits for the hardware: nothing is done in the loop, and the watchdog ends it.
fn busy(source: &Source) -> Vec<Violation> {
    if !is_bsp(source) {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let token = &tokens[at];
        let waits = || {
            let body = (at..tokens.len()).find(|i| tokens[*i].text == "{");
            body.is_some_and(|body| reads(tokens, body, &["{", "}"]))
        };
        let wrong = token.text == "loop" || token.text == "while" && !waits();
        (!token.is_literal && wrong)
            .then(|| format!("{}: the board's loops wait for hardware, and do nothing else", token.text))
    })
}

#[test]
fn unsafe_is_the_board_s_and_explained() {
    check_workspace(unexplained);
    let uses = |source: &Source| source.text.matches("unsafe {").count();
    let found: usize = files("rs").iter().filter(|source| is_bsp(source)).map(uses).sum();
    assert!(found > 10, "{found} blocks: does the fence see the board?");
}

#[test]
fn every_module_but_the_board_s_forbids_unsafe() {
    check_workspace(unforbidden);
}

#[test]
fn registers_are_named_by_board_and_programs() {
    check_workspace(registers);
}

#[test]
fn the_board_s_methods_are_short() {
    check_workspace(long_method);
}

#[test]
fn a_task_is_one_call() {
    check_workspace(locks);
}

#[test]
fn the_board_only_waits() {
    check_workspace(busy);
}

#[test]
fn the_unsafe_fence_can_fail() {
    let explained = [
        "// SAFETY: a\nunsafe { b() }",
        "let a = 1;\n// SAFETY: b\nlet c: [u8; 3] =\n    d(|w| unsafe { e([1; 2]) });",
        "/// A.\n///\n/// # Safety\n/// B.\n#[c]\n#[unsafe(naked)]\nunsafe extern \"C\" fn d() {}",
    ];
    check_fence(
        unexplained,
        "tater-fw/src/bsp/a.rs",
        &[
            "unsafe { a() }",
            "// SAFETY: a\nb();\nunsafe { c() }",
            "// SAFETY: a\nfn f() {\n    unsafe { b() }\n}",
            "// Safe, surely.\nunsafe impl Send for A {}",
            "// SAFETY: a\nunsafe { b() }\nlet d = unsafe { e() };",
            "/// A.\n#[unsafe(no_mangle)]\nfn a() {}",
        ],
        &explained,
    );
    check_fence(
        unexplained,
        "tater-fw/src/app.rs",
        &explained[..2],
        &["// unsafe\nfn f(a: &str) { g(\"unsafe\") }"],
    );
}

#[test]
fn the_forbid_fence_can_fail() {
    check_fence(
        unforbidden,
        "tater-fw/src/lib.rs",
        &[
            "mod a;",
            "#[forbid(unsafe_code)] mod a; pub mod b;",
            "#[deny(unsafe_code)] mod a;",
            "#[forbid(unsafe_code)] use a; mod b;",
        ],
        &["#[forbid(unsafe_code)]\npub mod a;\n#[forbid(unsafe_code)]\nmod b;\npub mod bsp;"],
    );
}

#[test]
fn the_register_fence_can_fail() {
    let names = ["use cortex_m::asm;", "fn f() { bxcan::g() }", "use embedded_hal as e;"];
    check_fence(registers, "tater-fw/src/tater.rs", &names, &["// bxcan\nconst A: &str = \"bxcan\";"]);
    check_fence(registers, "tater-fw/src/main.rs", &["#[cortex_m_rt::entry] fn main() {}"], &[]);
    check_fence(registers, "tater-fw/src/bsp/can.rs", &[], &names);
}

#[test]
fn the_method_fence_can_fail() {
    let method = |lines: usize| format!("fn a(&self) {{{}}}", "\n".repeat(lines - 1));
    let of = |head: &str, lines: usize| format!("{head} {{ fn b() {{}} {} }}", method(lines));
    let (board, motor) = ("impl<M: Motor> Board for Metal<M>", "impl Motor for Armed");
    check_fence(
        long_method,
        "tater-fw/src/bsp/a.rs",
        &[&of(board, 10), &of(motor, 10)],
        &[&of(board, 9), &of("impl Flash for Metal", 10), &of("impl<M: Motor> Metal<M>", 10)],
    );
    check_fence(long_method, "hil-sim/src/board.rs", &[], &[&of(board, 10)]);
}

#[test]
fn the_task_fence_can_fail() {
    check_fence(
        locks,
        "tater-fw/src/app.rs",
        &[
            "#[task(binds = A)] fn a(c: C) { c.lock(|t| t.d()); c.lock(|t| t.e()); }",
            "#[task(binds = A)] fn a(c: C) { d(); }",
            "#[idle(shared = [t])] fn a(c: C) -> ! { c.lock(d); loop { c.lock(e); } }",
        ],
        &[
            "#[init] fn a() {} #[task(binds = A)] fn a(c: C) { c.lock(|t| t.d()); } #[idle] fn b(c: C) { c.lock(d) }",
        ],
    );
}

#[test]
fn the_waiting_fence_can_fail() {
    check_fence(
        busy,
        "tater-fw/src/bsp/a.rs",
        &[
            "fn f() { loop {} }",
            "fn f() { while a() { b(); } }",
            "fn f() { while let Some(a) = b() { c(a) } }",
        ],
        &["fn f() { while a.read().b() {} for i in 0..3 { c() } }"],
    );
}
