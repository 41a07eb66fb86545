//! Instructions of a tick and of a hall edge in every mode, against the budget and the committed `budgets.json`.

use std::fmt::Write as _;
use std::path::PathBuf;

use board_emu::image::Programs;
use board_emu::meter::Figures;
use serde_json::{Value, json};
use tater_f103::map::STACK;
use tater_wire::{Cmd, Property};

use super::bench::{Bench, NODE, flashed, production};

/// Instructions of a control tick (decision 0064: 650 and 900 were wanted), and of a hall edge until the bridge is written (decision 0004).
// 900 and 1500 before the motor was described: its thresholds are loads, where they were constants (decision 0083).
const TICK_MEAN: f64 = 950.0;
const TICK_MAX: u64 = 1560;
const HALL_MAX: u64 = 250;
const LOAD_PCT: f64 = 25.0;
/// Full speed in counts/s: the range of a tip, 350 counts, allows no more at the greatest ACCEL.
const FAST: f64 = 900.0;
/// Measuring time of the load: no longer than the top speed lasts.
const WINDOW_MS: u64 = 50;
/// Stack that must stay untouched: an exception frame for each of 6 priorities, 104 bytes with registers, twice.
const STACK_SPARE: u32 = 2 * 6 * 104;
/// Tolerance against the committed figure: more than the effect of the seeds of noise and RAM.
const TOLERANCE: f64 = 0.03;

/// Fewer ticks give no useful mean.
const LEAST_MS: u64 = 100;

struct Case {
    name: &'static str,
    node: u8,
    start: &'static [(Property, i64, u64)],
    /// Measured while the bridge is on: the time after an arrival would lower the mean.
    orders: &'static [(Property, i64, u64)],
    /// The host's requests, with the time of each in ms.
    asks: (&'static [Property], u64),
}

const SELDOM: (&[Property], u64) = (&[Property::MODE], 100);
const EACH_MS: (&[Property], u64) = (&[Property::P, Property::MODE, Property::T], 1);

/// Moves that are replanned on the way, in both directions; none arrives.
const MOVES: &[(Property, i64, u64)] =
    &[(Property::M, 160, 300), (Property::M, 20, 300), (Property::M, 150, 350), (Property::M, 5, 250)];

const CASES: [Case; 9] = [
    Case { name: "idle", node: NODE, start: &[], orders: &[(Property::MODE, 0, 1000)], asks: SELDOM },
    Case {
        name: "torque",
        node: NODE,
        start: &[(Property::MODE, 2, 0), (Property::T, 150, 50)],
        orders: &[(Property::T, 150, 400), (Property::T, -150, 400)],
        asks: SELDOM,
    },
    Case {
        name: "pid",
        node: NODE,
        start: &[(Property::MODE, 3, 50)],
        orders: &[(Property::MODE, 3, 1000)],
        asks: SELDOM,
    },
    Case {
        name: "velocity",
        node: NODE,
        start: &[(Property::MODE, 4, 0), (Property::V, 150, 50)],
        orders: &[(Property::V, 150, 400), (Property::V, -150, 400)],
        asks: SELDOM,
    },
    Case { name: "trapezoidal", node: NODE, start: &[(Property::M, 160, 50)], orders: MOVES, asks: SELDOM },
    Case {
        name: "trapezoidal, polled",
        node: NODE,
        start: &[(Property::M, 160, 50)],
        orders: MOVES,
        asks: EACH_MS,
    },
    Case {
        name: "trapezoidal, link",
        node: 1,
        start: &[(Property::M, 160, 50)],
        orders: MOVES,
        asks: SELDOM,
    },
    Case {
        name: "closing",
        node: 1,
        start: &[
            (Property::HOLD, 1, 0),
            (Property::MT, 400, 0),
            (Property::MCV, 300, 0),
            (Property::CMD, Cmd::Tc as i64, 50),
        ],
        orders: &[(Property::MCV, 300, 2500)],
        asks: SELDOM,
    },
    Case {
        name: "homing",
        node: NODE,
        start: &[(Property::CMD, Cmd::Hi as i64, 50)],
        orders: &[(Property::MCV, 1000, 5000)],
        asks: SELDOM,
    },
];

/// Figures at the last ms with the bridge on (idle: off), and the number of ms.
fn figures(programs: &Programs, case: &Case) -> (Figures, u64) {
    let mut bench = Bench::with(flashed(programs, case.node));
    for &(property, value, ms) in case.start {
        bench.set(property, value);
        bench.wait_ms(ms);
    }
    let driven = !case.start.is_empty();
    bench.board_mut().begin_figures();
    let (mut figures, mut measured_ms) = (Figures::default(), 0);
    let (asked, every_ms) = case.asks;
    for &(property, value, order_ms) in case.orders {
        bench.set(property, value);
        for ms in 0..order_ms {
            if ms % every_ms == 0 {
                asked.iter().for_each(|&property| bench.ask(property));
            }
            bench.wait_ms(1);
            if bench.is_driven() == driven {
                figures = bench.board().figures();
                measured_ms += 1;
            }
        }
    }
    (figures, measured_ms)
}

fn golden() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("emulated/budgets.json")
}

#[test]
fn ticks_and_edges_match_golden_and_budget() {
    let Some(programs) = production() else { return };
    let mut found = serde_json::Map::new();
    let mut bad = String::new();
    for case in &CASES {
        let (of, measured_ms) = figures(&programs, case);
        let name = case.name;
        let (tick_mean, tick_max, hall_max) =
            (of.tick_instructions_mean, of.tick_instructions_max, of.hall_instructions_max);
        println!(
            "figure: {name}: tick {tick_mean:.0} instructions, at worst {tick_max}; edge to bridge {hall_max}"
        );
        if measured_ms < LEAST_MS {
            let _ = writeln!(bad, "{name}: measured for {measured_ms} ms alone");
        }
        if tick_mean > TICK_MEAN || tick_max > TICK_MAX || hall_max > HALL_MAX {
            let _ = writeln!(bad, "{name}: {tick_mean:.0}, {tick_max}, {hall_max}");
        }
        let row =
            json!({ "tick_mean": tick_mean.round() as u64, "tick_max": tick_max, "hall_max": hall_max });
        found.insert(name.to_owned(), row);
    }
    let found = Value::Object(found);
    if std::env::var_os("BLESS_BUDGETS").is_some() {
        std::fs::write(golden(), format!("{found:#}\n")).expect("writable");
    }
    assert!(bad.is_empty(), "over {TICK_MEAN}, {TICK_MAX} or {HALL_MAX} instructions:\n{bad}");
    let text = std::fs::read_to_string(golden()).expect("committed");
    let golden: Value = serde_json::from_str(&text).expect("JSON");
    for (mode, row) in found.as_object().expect("made above") {
        for (key, value) in row.as_object().expect("made above") {
            let Some(is) = value.as_f64() else { continue };
            let was = golden[mode][key].as_f64();
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
fn full_speed_leaves_processor_and_stack_mostly_free() {
    let Some(programs) = production() else { return };
    // A tip's motor is the fastest; its joint has 350 counts.
    let mut bench = Bench::powered(flashed(&programs, 5));
    bench.board_mut().begin_figures();
    bench.wait_ms(100);
    bench.wake();
    bench.wait_ms(1000);
    for (property, value) in [(Property::MV, 4000), (Property::ACCEL, 80), (Property::MT, 990)] {
        bench.set(property, value);
    }
    bench.set(Property::SAVE, -1);
    bench.wait_ms(500);
    let (mut fastest, mut load) = (0.0_f64, 0.0_f64);
    bench.set(Property::M, 340);
    for _ in 0..10 {
        let counts = bench.board().machine().cpu.counts.instructions;
        for _ in 0..WINDOW_MS {
            EACH_MS.0.iter().for_each(|&property| bench.ask(property));
            bench.wait_ms(1);
            fastest = fastest.max(bench.board().rig().truth().counts_per_s);
        }
        let spent = bench.board().machine().cpu.counts.instructions - counts;
        // 1.5 cycles an instruction, 72000 cycles a ms.
        load = load.max(spent as f64 * 1.5 / (72_000.0 * WINDOW_MS as f64) * 100.0);
    }
    bench.set(Property::STAT, 0);
    bench.wait_ms(500);
    assert_eq!(bench.get(Property::STAT), Some(0), "in the monitor again");
    let stack = bench.board().figures().stack_bytes_max;
    println!(
        "figure: at {fastest:.0} counts/s the load is {load:.1} %, the stack {stack} of {} bytes",
        STACK.len
    );
    assert!(fastest >= FAST, "{fastest} counts/s");
    assert!(load <= LOAD_PCT, "{load} %");
    assert!(stack + STACK_SPARE <= STACK.len, "{stack} bytes of stack");
}
