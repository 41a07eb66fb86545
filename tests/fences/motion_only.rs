//! Restrictions on the crates of the board: no std, float, heap, cast, panic or simulator; one file orders the tick.

use super::tokens::{Token, item_end, reads, scan, scan_tokens, tokens, without_tests};
use super::{Source, Violation, check_fence, check_workspace, files};

const BOARD: [&str; 6] = ["servo-core", "tater-wire", "boot", "tater-fw", "bsp-stm32f1", "boards"];

fn is_on_board(source: &Source) -> bool {
    BOARD.iter().any(|package| source.is_in(package))
}

fn is_float_literal(token: &Token) -> bool {
    let text = token.text.as_str();
    let is_number = token.is_literal && text.starts_with(|c: char| c.is_ascii_digit());
    let is_decimal = !["0x", "0b", "0o"].iter().any(|radix| text.starts_with(radix));
    let digits = text.trim_end_matches("usize").trim_end_matches("isize");
    is_number && is_decimal && digits.contains(['.', 'e', 'E', 'f'])
}

/// No float, not even in tests: they must compute what the microcontroller computes.
fn float(source: &Source) -> Vec<Violation> {
    if !is_on_board(source) {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let token = &tokens[at];
        let is_type = !token.is_literal && ["f16", "f32", "f64", "f128"].contains(&token.text.as_str());
        (is_type || is_float_literal(token))
            .then(|| format!("{}: the board has no floating point; use `fixed` or integers", token.text))
    })
}

/// Neither std nor a heap; in servo-core not even in tests.
fn freestanding(source: &Source) -> Vec<Violation> {
    if source.is_in("servo-core") { scan(source, named_std) } else { scan_board(source, named_std) }
}

fn named_std(tokens: &[Token], at: usize) -> Option<String> {
    let name = &tokens[at].text;
    // `core::alloc::` is another module: `alloc` must begin the path.
    let continues = at >= 3
        && reads(tokens, at - 2, &[":", ":"])
        && tokens[at - 3].text.ends_with(|c: char| c.is_alphanumeric() || c == '_');
    let is_path = reads(tokens, at + 1, &[":", ":"]) && !continues;
    let is_extern = at > 0 && tokens[at - 1].text == "crate";
    let is_import = at > 0 && tokens[at - 1].text == "use";
    // `extern crate std` of tests is behind `cfg(test)`, which `without_tests` removes.
    (["std", "alloc"].contains(&name.as_str()) && (is_path || is_extern || is_import))
        .then(|| format!("{name}: what runs on the board stands on `core` alone"))
}

/// `as` truncates silently: only two files use it.
fn cast(source: &Source) -> Vec<Violation> {
    let homes = ["servo-core/src/units.rs", "servo-core/src/num.rs"];
    if homes.contains(&source.path.as_str()) {
        return Vec::new();
    }
    // tater-wire packs and unpacks bits: it may cast. So may tests, which compare with exact arithmetic.
    if source.is_in("servo-core") || source.is_in("tater-fw") {
        scan_board(source, wrong_cast)
    } else {
        Vec::new()
    }
}

fn wrong_cast(tokens: &[Token], at: usize) -> Option<String> {
    const PRIMITIVES: [&str; 17] = [
        "u8", "u16", "u32", "u64", "u128", "usize", "i8", "i16", "i32", "i64", "i128", "isize", "f32", "f64",
        "char", "_", "*",
    ];
    let to = tokens.get(at + 1).filter(|to| PRIMITIVES.contains(&to.text.as_str()))?;
    // `use A as _` renames, it does not cast.
    let renames = tokens[..at]
        .iter()
        .rev()
        .take_while(|t| ![";", "}"].contains(&t.text.as_str()))
        .any(|t| t.text == "use");
    (tokens[at].text == "as" && !renames)
        .then(|| format!("as {}: put a named conversion into units.rs or num.rs", to.text))
}

/// Skips tests.
fn scan_board(source: &Source, wrong: impl Fn(&[Token], usize) -> Option<String>) -> Vec<Violation> {
    let is_test_file = source.path.ends_with("/tests.rs") || source.path.contains("/tests/");
    if !is_on_board(source) || !source.path.contains("/src/") || is_test_file {
        return Vec::new();
    }
    match tokens(source) {
        Ok(tokens) => scan_tokens(source, &without_tests(tokens), wrong),
        Err(violation) => vec![violation],
    }
}

/// No panic outside tests. (Indexing and overflow are clippy's: see the lints in lib.rs.)
fn panic_path(source: &Source) -> Vec<Violation> {
    const METHODS: [&str; 4] = ["unwrap", "expect", "unwrap_err", "expect_err"];
    const MACROS: [&str; 8] = [
        "panic",
        "unreachable",
        "assert",
        "assert_eq",
        "assert_ne",
        "debug_assert",
        "debug_assert_eq",
        "debug_assert_ne",
    ];
    scan_board(source, |tokens, at| {
        let name = tokens[at].text.as_str();
        let is_method =
            METHODS.contains(&name) && at > 0 && tokens[at - 1].text == "." && reads(tokens, at + 1, &["("]);
        let is_macro = MACROS.contains(&name) && reads(tokens, at + 1, &["!"]);
        // `const _: () = assert!(..)` fails the build, not the motor.
        let at_build = at >= 6 && reads(tokens, at - 6, &["const", "_", ":", "(", ")", "="]);
        let at_build = at_build || at >= 2 && reads(tokens, at - 2, &["const", "{"]);
        (is_method || is_macro && !at_build)
            .then(|| format!("{name}: the control path does not panic; return or saturate"))
    })
}

/// `lit` of `fixed` parses its string at run time outside constants: some hundred instructions at every tick.
fn literal(source: &Source) -> Vec<Violation> {
    // Neither `const fn` nor a generic `<const N: usize>` is a constant.
    let is_constant = |tokens: &[Token], at: usize| {
        tokens[at].text == "const"
            && !reads(tokens, at + 1, &["fn"])
            && !(at > 0 && ["<", ","].contains(&tokens[at - 1].text.as_str()))
    };
    scan_board(source, |tokens, at| {
        let in_constant = || (0..at).any(|c| is_constant(tokens, c) && item_end(tokens, c) >= at);
        (reads(tokens, at, &["lit", "("]) && !in_constant())
            .then(|| "lit outside a `const` is parsed when it runs: make it a constant".into())
    })
}

/// Firmware and simulation run the same code: no feature distinguishes them.
fn simulation_feature(source: &Source) -> Vec<Violation> {
    scan(source, |tokens, at| {
        let names_sim = tokens.get(at + 2).is_some_and(|value| value.text.contains("sim"));
        (reads(tokens, at, &["feature", "="]) && names_sim)
            .then(|| "the servo does not know whether it is simulated: pass the difference in".into())
    })
}

/// Only `servo.rs` composes loops: another module that uses two of them would order a tick of its own.
fn tick_order(source: &Source) -> Vec<Violation> {
    const LOOPS: [&str; 3] = ["pid", "profile", "velocity_loop"];
    let is_servo = source.path == "servo-core/src/servo.rs" || source.is_in("servo-core/src/servo");
    let is_code = is_on_board(source) || source.is_in("hil-sim");
    if is_servo || !is_code {
        return Vec::new();
    }
    let tokens = match tokens(source) {
        Ok(tokens) => without_tests(tokens),
        Err(violation) => return vec![violation],
    };
    let named = |name: &str| {
        (0..tokens.len()).find(|at| reads(&tokens, *at, &[name, ":", ":"])).map(|at| tokens[at].line)
    };
    let lines: Vec<usize> = LOOPS.into_iter().filter_map(named).collect();
    match lines[..] {
        [_, second, ..] => vec![source.violation(second, "names two loops: only servo.rs composes them")],
        _ => Vec::new(),
    }
}

/// Every duty is made in `guard/limits`.
fn bridge(source: &Source) -> Vec<Violation> {
    // units.rs defines it; the commutator only distributes its sign to the legs.
    let homes = ["guard/limits.rs", "units.rs", "sense/commutation.rs"];
    if homes.iter().any(|home| source.path == format!("servo-core/src/{home}")) {
        return Vec::new();
    }
    scan_board(source, |tokens, at| {
        let makes = reads(tokens, at, &["Duty", "("]) || reads(tokens, at, &["Duty", ":", ":", "from_bits"]);
        makes.then(|| "a duty made outside guard/limits escapes its bounds".into())
    })
}

/// Firmware and simulation run the same `Tater`: simulator and tests hold no `Servo`.
fn second_servo(source: &Source) -> Vec<Violation> {
    // An example counts the instructions of a tick alone.
    if source.is_in("hil-sim/examples") || !source.is_in("hil-sim") && !source.is_in("tests") {
        return Vec::new();
    }
    scan(source, |tokens, at| {
        let names = !tokens[at].is_literal && tokens[at].text == "Servo";
        names.then(|| "Servo: the simulator runs Tater, and tests reach it by frames".into())
    })
}

/// A board that uses a row of the tables would link all their texts, 13 KiB.
fn texts(source: &Source) -> Vec<Violation> {
    if !source.is_in("tater-fw/src") && !source.is_in("boot/src") {
        return Vec::new();
    }
    scan_board(source, |tokens, at| {
        let row =
            reads(tokens, at, &[".", "row", "("]) || !tokens[at].is_literal && tokens[at].text == "ROWS";
        row.then(|| "the board goes by `rules()`; rows hold texts that it has no room for".into())
    })
}

/// No unbounded loop in the control path; `for` is bounded by its range.
fn unbounded(source: &Source) -> Vec<Violation> {
    // Storage and monitor run outside it, in steps.
    let is_control_path = source.is_in("servo-core/src") || source.path.starts_with("tater-fw/src/tater");
    if !is_control_path {
        return Vec::new();
    }
    scan_board(source, |tokens, at| {
        let token = &tokens[at];
        (!token.is_literal && ["loop", "while"].contains(&token.text.as_str()))
            .then(|| format!("{}: the control path's loops are bounded; use `for` over a range", token.text))
    })
}

fn attributes(source: &Source) -> Vec<Violation> {
    let wanted: &[&[&str]] = match source.path.as_str() {
        "servo-core/src/lib.rs"
        | "tater-wire/src/lib.rs"
        | "boot/src/lib.rs"
        | "tater-fw/src/lib.rs"
        | "boards/tater-f103/src/lib.rs" => &[&["no_std"], &["forbid", "(", "unsafe_code", ")"]],
        "bsp-stm32f1/src/lib.rs" => &[&["no_std"]],
        "hil-sim/world/src/lib.rs"
        | "hil-sim/experiment/src/lib.rs"
        | "hil-sim/torture/src/lib.rs"
        | "hil-sim/tuning/src/lib.rs"
        | "hil-sim/src/lib.rs"
        | "hil-sim/src/main.rs"
        | "programs/src/lib.rs"
        | "commission/src/lib.rs"
        | "traces/src/lib.rs"
        | "charts/src/lib.rs"
        | "xtask/src/main.rs"
        | "boards/tater-f103/src/main.rs"
        | "boards/tater-f103/src/bin/monitor.rs" => &[&["forbid", "(", "unsafe_code", ")"]],
        _ => return Vec::new(),
    };
    let tokens = match tokens(source) {
        Ok(tokens) => tokens,
        Err(violation) => return vec![violation],
    };
    let promised = |promise: &[&str]| {
        let attribute: Vec<&str> = ["#", "!", "["].iter().chain(promise).chain(&["]"]).copied().collect();
        (0..tokens.len()).any(|at| reads(&tokens, at, &attribute))
    };
    wanted
        .iter()
        .filter(|promise| !promised(promise))
        .map(|promise| source.violation(1, format!("#![{}] is missing", promise.concat())))
        .collect()
}

#[test]
fn board_code_has_no_float() {
    check_workspace(float);
}

#[test]
fn board_code_uses_core_alone() {
    check_workspace(freestanding);
}

#[test]
fn casts_are_in_two_files() {
    check_workspace(cast);
}

#[test]
fn control_path_has_no_panic() {
    check_workspace(panic_path);
}

#[test]
fn literals_are_in_constants() {
    check_workspace(literal);
}

#[test]
fn no_feature_distinguishes_simulation() {
    check_workspace(simulation_feature);
}

#[test]
fn one_file_orders_the_tick() {
    check_workspace(tick_order);
}

#[test]
fn duties_are_made_in_limits() {
    check_workspace(bridge);
}

#[test]
fn only_tater_holds_a_servo() {
    check_workspace(second_servo);
}

#[test]
fn board_code_links_no_texts() {
    check_workspace(texts);
}

#[test]
fn loops_are_bounded() {
    check_workspace(unbounded);
}

#[test]
fn crate_roots_have_their_attributes() {
    check_workspace(attributes);
    let roots = [
        "servo-core/src/lib.rs",
        "tater-wire/src/lib.rs",
        "bsp-stm32f1/src/lib.rs",
        "hil-sim/world/src/lib.rs",
        "hil-sim/experiment/src/lib.rs",
        "hil-sim/torture/src/lib.rs",
        "hil-sim/tuning/src/lib.rs",
        "hil-sim/src/lib.rs",
        "hil-sim/src/main.rs",
        "programs/src/lib.rs",
        "commission/src/lib.rs",
        "traces/src/lib.rs",
        "charts/src/lib.rs",
        "xtask/src/main.rs",
    ];
    let files = files("rs");
    assert!(roots.iter().all(|root| files.iter().any(|file| file.path == *root)));
}

#[test]
fn float_fence_finds_each_violation() {
    check_fence(
        float,
        "servo-core/src/a/tests.rs",
        &["fn f(a: f32) {}", "const A: u8 = 1.5;", "g!(2e3);", "g!(1f64);", "g!(1.);", "use core::f64;"],
        &[
            "const A: u32 = 0x1e3; // 1.5",
            "const B: usize = 0usize;",
            "g!(0..5, t.0, 7i8, \"1.5 f32\");",
            "const F: u8 = 0xf3;",
        ],
    );
    check_fence(float, "hil-sim/src/a.rs", &[], &["fn f(a: f64) {}"]);
}

#[test]
fn std_fence_finds_each_violation() {
    check_fence(
        freestanding,
        "servo-core/src/a.rs",
        &["use std::vec::Vec;", "extern crate std;", "extern crate alloc;", "fn f() { ::alloc::x() }"],
        &["use core::fmt; // std::fmt", "use core::alloc::Layout;", "fn std() {}"],
    );
    let tested = "#[cfg(test)] mod t { use std::vec::Vec; }";
    check_fence(freestanding, "servo-core/src/a.rs", &[tested], &[]);
    check_fence(freestanding, "tater-fw/src/a.rs", &["use std::vec::Vec;"], &[tested]);
}

#[test]
fn cast_fence_finds_each_violation() {
    check_fence(
        cast,
        "servo-core/src/a.rs",
        &["fn f(a: u8) -> i8 { a as i8 }", "g!(1 as _);", "const A: *const u8 = B as *const u8;"],
        &["use a::B as _;", "fn f() { <A as B>::c() }"],
    );
    check_fence(
        cast,
        "tater-fw/src/a.rs",
        &["fn f(a: u8) -> i8 { a as i8 }"],
        &["fn f(a: u8) -> u16 { a.into() }"],
    );
    check_fence(cast, "servo-core/src/units.rs", &[], &["fn f(a: u8) -> i8 { a as i8 }"]);
}

#[test]
fn panic_fence_finds_each_violation() {
    check_fence(
        panic_path,
        "servo-core/src/a.rs",
        &[
            "fn f() { a.unwrap() }",
            "fn f() { a.expect(\"b\") }",
            "fn f() { panic!() }",
            "fn f() { assert!(a) }",
            "#[cfg(test)] mod t {} fn f() { a.unwrap() }",
        ],
        &[
            "fn f() { a.unwrap_or(0) }",
            "#[cfg(test)] mod t { fn f() { a.unwrap() } }",
            "const _: () = assert!(A < B);",
            "fn f<F: A>() { const { assert!(F::B) }; }",
            "#[expect(lint)] fn f() {}",
        ],
    );
}

#[test]
fn literal_fence_finds_each_violation() {
    check_fence(
        literal,
        "servo-core/src/a.rs",
        &[
            "fn f() { Law::lit(\"1\") }",
            "const fn f() -> Law { Law::lit(\"1\") }",
            "impl<const N: u8> A<N> { fn f() { Law::lit(\"1\") } }",
            "const A: u8 = 1; fn f() { lit(\"1\") }",
        ],
        &[
            "const A: Law = Law::lit(\"1\");",
            "const A: [Law; 1] = [Law::lit(\"1\")];",
            "fn f() { const { Law::lit(\"1\") } }",
            "const A: B = B { c: Law::lit(\"1\") };",
            "#[cfg(test)] mod t { fn f() { Law::lit(\"1\") } }",
        ],
    );
}

#[test]
fn feature_fence_finds_each_violation() {
    check_fence(
        simulation_feature,
        "servo-core/src/a.rs",
        &["#[cfg(feature = \"sim\")] fn f() {}", "fn f() { if cfg!(feature = \"simulation\") {} }"],
        &["#[cfg(feature = \"defmt\")] fn f() {}"],
    );
}

#[test]
fn tick_order_fence_finds_each_violation() {
    let two = "use crate::motion::{pid::Pid, profile::Profile};";
    check_fence(tick_order, "servo-core/src/mode.rs", &[two], &["pub mod pid; pub mod profile;"]);
    check_fence(tick_order, "hil-sim/src/a.rs", &[two], &["use servo_core::motion::pid::Pid;"]);
    check_fence(tick_order, "servo-core/src/servo.rs", &[], &[two]);
}

#[test]
fn duty_fence_finds_each_violation() {
    let made = ["fn f() -> Duty { Duty(a) }", "fn f() -> Duty { Duty::from_bits(1) }"];
    check_fence(bridge, "servo-core/src/servo.rs", &made, &["fn f(a: Duty) -> bool { a == Duty::ZERO }"]);
    check_fence(bridge, "servo-core/src/guard/limits.rs", &[], &made);
}

#[test]
fn second_servo_fence_finds_each_violation() {
    check_fence(
        second_servo,
        "hil-sim/src/a.rs",
        &["use servo_core::Servo;"],
        &["use tater_fw::Tater; // Servo"],
    );
    check_fence(second_servo, "tests/a.rs", &["fn f(a: Servo) {}"], &["fn f() { g(\"Servo\") }"]);
    check_fence(second_servo, "tater-fw/src/tater.rs", &[], &["use servo_core::Servo;"]);
}

#[test]
fn texts_fence_finds_each_violation() {
    let bad = ["fn f(p: Property) { p.row(); }", "use tater_wire::property::ROWS;"];
    check_fence(texts, "tater-fw/src/a.rs", &bad, &["fn f(p: Property) { p.rules(); }"]);
    check_fence(texts, "hil-sim/src/a.rs", &[], &bad);
}

#[test]
fn loop_fence_finds_each_violation() {
    check_fence(
        unbounded,
        "servo-core/src/a.rs",
        &["fn f() { loop {} }", "fn f() { while a {} }", "fn f() { while let Some(b) = a.pop() {} }"],
        &[
            "fn f() { for i in 0..3 {} } // loop",
            "#[cfg(test)] mod t { fn f() { loop {} } }",
            "fn f() -> &str { \"while\" }",
        ],
    );
    check_fence(unbounded, "tater-fw/src/tater/a.rs", &["fn f() { loop {} }"], &[]);
}

#[test]
fn attribute_fence_finds_each_violation() {
    let one = ["#![no_std]", "#![forbid(unsafe_code)]", "#![no_std]\n// #![forbid(unsafe_code)]"];
    check_fence(attributes, "servo-core/src/lib.rs", &one, &["#![no_std]\n#![forbid(unsafe_code)]"]);
    check_fence(
        attributes,
        "hil-sim/src/main.rs",
        &["fn main() {}"],
        &["#![forbid(unsafe_code)]\nfn main() {}"],
    );
}
