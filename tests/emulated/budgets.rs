//! What the image takes of the processor: instructions of the tick and of a hall edge in every mode, against the budget and
//! against what they were (`budgets.json`).

use std::fmt::Write as _;
use std::path::PathBuf;

use board_emu::meter::Figures;
use serde_json::{Value, json};
use tater_wire::memory::STACK;
use tater_wire::{Cmd, Property};

use super::bench::{Bench, flashed, production};

/// Instructions of a control tick (DESIGN: 500 in the mean, 900 at worst), of a hall edge until the bridge is written.
const TICK_MEAN: f64 = 500.0;
const TICK_MAX: u64 = 900;
const HALL_MAX: u64 = 250;
/// Share of the processor at full speed.
const LOAD_PCT: f64 = 25.0;
/// Share of the stack that must never have been touched: as much as one more exception frame of every priority, 6 of 104 bytes
/// (frame and registers), and as much again.
const STACK_SPARE: u32 = 2 * 6 * 104;
/// By how much a figure may differ from the golden: the seeds of noise and RAM move it by less.
const TOLERANCE: f64 = 0.03;

/// A mode and what a host says to be in it, each order with the ms for which it lasts.
const MODES: [(&str, &[(Property, i64, u64)]); 6] = [
    ("idle", &[(Property::MODE, 0, 1000)]),
    (
        "torque",
        &[
            (Property::MODE, 2, 0),
            (Property::T, 150, 400),
            (Property::T, -150, 400),
            (Property::MODE, 0, 100),
        ],
    ),
    ("pid", &[(Property::MODE, 3, 1000), (Property::MODE, 0, 100)]),
    (
        "velocity",
        &[
            (Property::MODE, 4, 0),
            (Property::V, 150, 400),
            (Property::V, -150, 400),
            (Property::MODE, 0, 100),
        ],
    ),
    ("trapezoidal", &[(Property::M, 160, 300), (Property::M, 20, 200), (Property::M, 150, 1500)]),
    ("homing", &[(Property::CMD, Cmd::Hi as i64, 5000)]),
];

/// How often a host asks for the mode, ms.
const POLL_MS: u64 = 100;

fn figures(bench: &mut Bench, orders: &[(Property, i64, u64)]) -> Figures {
    bench.board_mut().begin_figures();
    for &(property, value, ms) in orders {
        bench.set(property, value);
        for _ in 0..ms / POLL_MS {
            bench.wait_ms(POLL_MS - 1);
            bench.get(Property::MODE).expect("answers");
        }
    }
    bench.board().figures()
}

fn golden() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("emulated/budgets.json")
}

#[test]
fn ticks_and_edges_take_what_they_took_and_no_more_than_they_may() {
    let Some(programs) = production() else { return };
    let mut found = serde_json::Map::new();
    let mut over = String::new();
    for (mode, orders) in MODES {
        let mut bench = Bench::awake(&programs);
        let of = figures(&mut bench, orders);
        let (tick_mean, tick_max, hall_max) =
            (of.tick_instructions_mean, of.tick_instructions_max, of.hall_instructions_max);
        println!(
            "figure: {mode}: tick {tick_mean:.0} instructions, at worst {tick_max}; edge to bridge {hall_max}"
        );
        if tick_mean > TICK_MEAN || tick_max > TICK_MAX || hall_max > HALL_MAX {
            let _ = writeln!(over, "{mode}: {tick_mean:.0}, {tick_max}, {hall_max}");
        }
        let row =
            json!({ "tick_mean": tick_mean.round() as u64, "tick_max": tick_max, "hall_max": hall_max });
        found.insert(mode.to_owned(), row);
    }
    assert!(over.is_empty(), "over {TICK_MEAN}, {TICK_MAX} or {HALL_MAX} instructions:\n{over}");
    let found = Value::Object(found);
    if std::env::var_os("BLESS_BUDGETS").is_some() {
        std::fs::write(golden(), format!("{found:#}\n")).expect("writable");
    }
    let text = std::fs::read_to_string(golden()).expect("committed");
    let golden: Value = serde_json::from_str(&text).expect("JSON");
    for (mode, row) in found.as_object().expect("made above") {
        for (key, value) in row.as_object().expect("made above") {
            let (is, was) = (value.as_f64().expect("a number"), golden[mode][key].as_f64());
            let was = was
                .unwrap_or_else(|| panic!("budgets.json has no {key} of {mode}: BLESS_BUDGETS=1 writes it"));
            assert!(
                (is - was).abs() <= TOLERANCE * was,
                "{key} of {mode} is {is}, was {was}: if that is meant, BLESS_BUDGETS=1 cargo test -p system-tests budgets"
            );
        }
    }
}

#[test]
fn at_full_speed_the_processor_is_mostly_idle_and_the_stack_mostly_untouched() {
    let Some(programs) = production() else { return };
    // A finger's tip has the longest way: 11 revolutions a joint radian; it gets to its top speed in between.
    let board = flashed(&programs, 5);
    let mut bench = Bench::with(board);
    bench.set(Property::MV, 4000);
    bench.set(Property::ACCEL, 200);
    bench.board_mut().begin_figures();
    let begin = bench.board().machine().now();
    bench.set(Property::M, 1500);
    let mut fastest = 0.0_f64;
    let mut load = 0.0_f64;
    for _ in 0..15 {
        let counts = bench.board().machine().cpu.counts.instructions;
        bench.wait_ms(100);
        let spent = bench.board().machine().cpu.counts.instructions - counts;
        fastest = fastest.max(bench.board().rig().truth().counts_per_s);
        // 1.5 cycles an instruction, of 7.2 million in 100 ms.
        load = load.max(spent as f64 * 1.5 / 7.2e6 * 100.0);
    }
    assert!(bench.board().machine().now() > begin);
    let stack = bench.board().figures().stack_bytes_max;
    println!(
        "figure: at {fastest:.0} counts/s the load is {load:.1} %, the stack {stack} of {} bytes",
        STACK.len
    );
    assert!(load <= LOAD_PCT, "{load} %");
    assert!(stack + STACK_SPARE <= STACK.len, "{stack} bytes of stack");
}
