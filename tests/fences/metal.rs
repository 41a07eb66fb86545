//! Code for the hardware: where registers may be used, explained `unsafe`, and no decisions.

use super::tokens::{Token, closing, item_end, reads, scan};
use super::{Source, Violation, assert_none, check_fence, check_workspace, files};

fn is_bsp(source: &Source) -> bool {
    source.is_in("bsp-stm32f1")
}

/// A board's crate: pins and interrupts, no registers.
fn is_of_a_board(source: &Source) -> bool {
    source.is_in("boards")
}

/// Where a board binds its interrupts.
fn is_app(source: &Source) -> bool {
    is_of_a_board(source) && source.path.ends_with("/src/app.rs")
}

/// The C ABI: what other languages pass is checked in `border.rs`.
fn is_foreign(source: &Source) -> bool {
    source.is_in("wraptor/c")
}

/// The last line of the previous statement or item, or of the start of the enclosing block.
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

/// `unsafe` is allowed only in `bsp` and in `wraptor/c`, with a `SAFETY:` comment or `# Safety` section directly above its statement or item.
fn unexplained(source: &Source) -> Vec<Violation> {
    let lines: Vec<&str> = source.text.lines().map(str::trim_start).collect();
    scan(source, |tokens, at| {
        let token = &tokens[at];
        if token.is_literal || token.text != "unsafe" {
            return None;
        }
        if !is_bsp(source) && !is_foreign(source) {
            return Some("unsafe: only bsp-stm32f1 has registers, and wraptor/c foreign callers".into());
        }
        let above = lines.get(end_of_previous(tokens, at)..token.line - 1).unwrap_or_default();
        let explained = above
            .iter()
            .any(|line| line.starts_with("//") && line.contains("SAFETY:") || *line == "/// # Safety");
        (!explained)
            .then(|| "unsafe without reason: `// SAFETY: ..` above its statement says why it holds".into())
    })
}

/// Register crates may be used only by bsp crates and boards; where interrupts are bound, only by a board's app.rs.
fn registers(source: &Source) -> Vec<Violation> {
    const CRATES: [&str; 6] = ["stm32f1xx_hal", "bxcan", "cortex_m", "cortex_m_rt", "rtic", "embedded_hal"];
    let is_app = is_app(source);
    let may = is_bsp(source) || is_of_a_board(source);
    scan(source, |tokens, at| {
        let token = &tokens[at];
        let allowed = if token.text == "rtic" { is_app } else { may };
        (!token.is_literal && !allowed && CRATES.contains(&token.text.as_str()))
            .then(|| format!("{}: a register; what needs one goes through trait Board", token.text))
    })
}

/// A method of `Board` or `Chip` makes no decision: it is shorter than this.
const METHOD_LINES: usize = 10;
/// Other functions are not longer than this, the longest register set-up of a peripheral.
const HELPER_LINES: usize = 40;

fn long_method(source: &Source) -> Vec<Violation> {
    if !is_bsp(source) && !is_of_a_board(source) {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let name = tokens.get(at + 1).filter(|_| tokens[at].text == "fn")?;
        let of_the_board = (0..at).rev().any(|start| {
            let implements = |name| (start..at).any(|i| reads(tokens, i, &[name, "for"]));
            tokens[start].text == "impl"
                && item_end(tokens, start) > at
                && (implements("Board") || implements("Chip"))
        });
        let lines = tokens.get(item_end(tokens, at))?.line - tokens[at].line + 1;
        let allowed = if of_the_board { METHOD_LINES - 1 } else { HELPER_LINES };
        (lines > allowed).then(|| {
            format!(
                "fn {} has {lines} lines, expected {allowed} at most: the board decides nothing",
                name.text
            )
        })
    })
}

/// Methods called on the locked Tater between two tokens, except `board_mut()`: see [`long_method`].
fn calls(tokens: &[Token], from: usize, to: usize) -> Vec<&str> {
    let called = |i: &usize| reads(tokens, *i, &["tater", "."]) && tokens[i + 3].text == "(";
    let names = (from..to).filter(|i| (*i == 0 || tokens[i - 1].text != ".") && called(i));
    names.map(|i| tokens[i + 2].text.as_str()).filter(|name| *name != "board_mut").collect()
}

/// The one call of each task into `Tater`; `receive` may also flush, and idle takes an event to log.
fn may_call(name: &str) -> &'static [&'static str] {
    match name {
        "hall" => &["hall"],
        "bridge_fault" => &["bridge_fault"],
        "tick" => &["tick"],
        "receive" => &["receive", "flush"],
        "sent" => &["flush"],
        "housekeeping" => &["housekeeping"],
        "idle" => &["store", "next_event"],
        _ => &[],
    }
}

/// A task locks once, makes its call into [`Tater`](tater_fw::Tater), and has no loop (except idle).
fn tasks(source: &Source) -> Vec<Violation> {
    if !is_app(source) {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let is_task = ["task", "idle"].iter().any(|kind| reads(tokens, at, &["#", "[", kind]));
        if !is_task {
            return None;
        }
        let start = closing(tokens, at + 1) + 1;
        let end = item_end(tokens, start);
        let name = tokens.get(start + 1)?.text.as_str();
        let locks = (start..end).filter(|i| reads(tokens, *i, &[".", "lock", "("])).count();
        let called = calls(tokens, start, end);
        let looped = tokens[start..end].iter().find(|t| ["loop", "while", "for"].contains(&t.text.as_str()));
        match looped {
            Some(word) if name != "idle" => Some(format!("task {name}: {}: a task is one call", word.text)),
            _ if locks != 1 => Some(format!("task {name} locks {locks} times: one call into Tater each")),
            _ if called != may_call(name) => {
                Some(format!("task {name} calls {called:?}, expected {:?}: one call each", may_call(name)))
            }
            _ => None,
        }
    })
}

/// Loops in `bsp` only wait for the hardware; the watchdog bounds them.
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

/// A file of `bsp` that waits, in a loop or by a counted iterator, is listed in docs/board.md (text `page`).
fn unlisted_wait(source: &Source, page: &str) -> Vec<Violation> {
    let file = source.path.rsplit('/').next().unwrap_or_default();
    let row = format!("| `{file}`");
    let told = page
        .split_once("Loops that wait for hardware")
        .is_some_and(|(_, table)| table.lines().any(|line| line.starts_with(&row)));
    if !is_bsp(source) || told {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let looks = ["any", "all", "find", "find_map", "position", "for_each", "try_for_each"]
            .iter()
            .any(|name| reads(tokens, at, &[".", name, "(", "|", "_", "|"]));
        let waits = !tokens[at].is_literal && tokens[at].text == "while" || looks;
        waits.then(|| {
            format!("waits: docs/board.md, \"Loops that wait\", names `{file}`, for what, and what ends it")
        })
    })
}

#[test]
fn page_lists_every_waiting_loop() {
    let page = &files("md").into_iter().find(|page| page.path == "docs/board.md").expect("the page").text;
    let sources = files("rs");
    assert_none(&sources.iter().flat_map(|source| unlisted_wait(source, page)).collect::<Vec<_>>());
    let waiting = sources.iter().filter(|source| !unlisted_wait(source, "").is_empty()).count();
    assert!(waiting >= 4, "{waiting} files wait: does the fence see them?");
}

#[test]
fn waiting_page_fence_finds_each_violation() {
    let found = |path: &str, text: &str, page: &str| unlisted_wait(&Source::new(path, text), page).len();
    let (table, other) =
        ("Loops that wait for hardware\n| `a.rs` | b |", "| `a.rs` | b |\nLoops that wait for hardware");
    let waits = ["fn f() { while a() {} }", "fn f() { (0..N).any(|_| a()) }"];
    for text in waits {
        assert_eq!(found("bsp-stm32f1/src/a.rs", text, other), 1, "{text}");
        assert_eq!(found("bsp-stm32f1/src/b.rs", text, table), 1, "{text}");
        assert_eq!(found("bsp-stm32f1/src/a.rs", text, table), 0, "{text}");
    }
    assert_eq!(found("bsp-stm32f1/src/a.rs", "fn f() { b.iter().any(|c| c.d) }", ""), 0);
}

#[test]
fn unsafe_is_in_bsp_and_explained() {
    check_workspace(unexplained);
    let uses = |source: &Source| source.text.matches("unsafe {").count();
    let found: usize = files("rs").iter().filter(|source| is_bsp(source)).map(uses).sum();
    assert!(found > 10, "{found} blocks: does the fence see the board?");
}

#[test]
fn register_crates_are_used_in_bsp_and_boards() {
    check_workspace(registers);
}

#[test]
fn methods_of_boards_are_short() {
    check_workspace(long_method);
}

#[test]
fn task_is_one_call() {
    check_workspace(tasks);
}

#[test]
fn loops_in_bsp_only_wait() {
    check_workspace(busy);
}

#[test]
fn unsafe_fence_finds_each_violation() {
    let explained = [
        "// SAFETY: a\nunsafe { b() }",
        "let a = 1;\n// SAFETY: b\nlet c: [u8; 3] =\n    d(|w| unsafe { e([1; 2]) });",
        "/// A.\n///\n/// # Safety\n/// B.\n#[c]\n#[unsafe(naked)]\nunsafe extern \"C\" fn d() {}",
    ];
    check_fence(
        unexplained,
        "bsp-stm32f1/src/a.rs",
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
        "boards/tater-f103/src/app.rs",
        &explained[..2],
        &["// unsafe\nfn f(a: &str) { g(\"unsafe\") }"],
    );
}

#[test]
fn register_fence_finds_each_violation() {
    let names = ["use cortex_m::asm;", "fn f() { bxcan::g() }", "use embedded_hal as e;"];
    check_fence(registers, "tater-fw/src/tater.rs", &names, &["// bxcan\nconst A: &str = \"bxcan\";"]);
    check_fence(registers, "boot/src/lib.rs", &["#[cortex_m_rt::entry] fn main() {}"], &[]);
    check_fence(registers, "boards/a/src/pins.rs", &["fn f() { rtic::pend(a) }"], &names);
    check_fence(registers, "boards/tater-f103/src/app.rs", &[], &["#[rtic::app(device = a)] mod app {}"]);
}

#[test]
fn method_fence_finds_each_violation() {
    let method = |lines: usize| format!("fn a(&self) {{{}}}", "\n".repeat(lines - 1));
    let of = |head: &str, lines: usize| format!("{head} {{ fn b() {{}} {} }}", method(lines));
    let (board, motor) = ("impl<M> Chip for Metal<M>", "impl Board for Metal<Armed>");
    check_fence(
        long_method,
        "bsp-stm32f1/src/a.rs",
        &[&of(board, 10), &of(motor, 10), &of("impl Flash for Metal", 41), &method(41)],
        &[&of(board, 9), &of("impl Flash for Metal", 40), &of("impl<M> Metal<M>", 40)],
    );
    check_fence(long_method, "boards/a/src/metal.rs", &[&of(motor, 10)], &[]);
    check_fence(long_method, "hil-sim/world/src/board.rs", &[], &[&of(board, 10)]);
}

#[test]
fn task_fence_finds_each_violation() {
    let locked = |head: &str, body: &str| format!("{head}(c: C) {{ c.tater.lock(|tater| {{ {body} }}); }}");
    let (slow, hall) = ("#[task(binds = A)] fn housekeeping", "#[task(binds = A)] fn hall");
    check_fence(
        tasks,
        "boards/tater-f103/src/app.rs",
        &[
            "#[task(binds = A)] fn housekeeping(c: C) { c.lock(|tater| tater.housekeeping(d)); c.lock(|t| t.e()); }",
            "#[task(binds = A)] fn housekeeping(c: C) { d(); }",
            "#[idle(shared = [t])] fn idle(c: C) -> ! { c.lock(d); loop { c.lock(e); } }",
            &locked(slow, "tater.housekeeping(now); tater.flush();"),
            &locked(slow, "tater.tick(now);"),
            &locked(slow, ""),
            &locked(hall, "for _ in 0..2 { tater.hall(at); }"),
            &locked(hall, "while a() { tater.hall(at); }"),
            &locked("#[task(binds = A)] fn new", "tater.hall(at);"),
        ],
        &[
            "#[init] fn a() {} #[task(binds = A)] fn tick(c: C) { c.lock(|tater| tater.tick(d)); }",
            "#[idle] fn idle(c: C) -> ! { loop { c.tater.lock(|tater| (tater.store(), tater.next_event())); } }",
            &locked(hall, "let at = tater.board_mut().edge(); tater.hall(at);"),
        ],
    );
}

#[test]
fn busy_loop_fence_finds_each_violation() {
    check_fence(
        busy,
        "bsp-stm32f1/src/a.rs",
        &[
            "fn f() { loop {} }",
            "fn f() { while a() { b(); } }",
            "fn f() { while let Some(a) = b() { c(a) } }",
        ],
        &["fn f() { while a.read().b() {} for i in 0..3 { c() } }"],
    );
}
