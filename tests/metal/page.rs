//! `docs/board.md` against the code: generated tables, required figures, interrupts, the pins in the picture.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use bsp_stm32f1::timing;
use tater_f103::map::{APPLICATION, MAP, MONITOR, STACK, STORAGE};
use tater_f103::pins::{BUS, MOTOR};
use tater_wire::FaultCode;

const PAGE: &str = "docs/board.md";

/// With this environment variable set, the test writes the tables instead of comparing them.
const MAKE: &str = "MAKE_BOARD_PAGE";

fn file(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

fn read(path: &str) -> String {
    fs::read_to_string(file(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn made(name: &str) -> String {
    let mut table = String::new();
    let mut row = |cells: &[&str]| writeln!(table, "| {} |", cells.join(" | ")).expect("a string takes all");
    match name {
        "pins" => {
            row(&["pin", "name", "signal", "set up as", "by", "what"]);
            row(&["---"; 6]);
            for (by, pin) in
                BUS.iter().map(|pin| ("both", pin)).chain(MOTOR.iter().map(|pin| ("application", pin)))
            {
                let mode = format!("`{}`", pin.mode.replace(' ', ""));
                row(&[pin.pin, &format!("`{}`", pin.name), pin.signal, &mode, by, pin.what]);
            }
        }
        "memory" => {
            row(&["from", "to", "bytes", "what"]);
            row(&["---"; 4]);
            for (area, what) in [
                (MONITOR, "flash: monitor, entered at reset, never written in the field"),
                (APPLICATION, "flash: application, with the image's header in its vector table"),
                (MAP.staging, "flash: where a download is gathered"),
                (STORAGE, "flash: properties and counters"),
                (STACK, "RAM: stack, growing down"),
                (MAP.statics, "RAM: variables"),
                (MAP.kept, "RAM: what survives a reset"),
            ] {
                let (from, to) = (format!("0x{:08X}", area.start), format!("0x{:08X}", area.end() - 1));
                row(&[&from, &to, &area.len.to_string(), what]);
            }
        }
        _ => panic!("no table {name}"),
    }
    table
}

fn remade(page: &str) -> String {
    let mut whole = page.to_string();
    for name in ["pins", "memory"] {
        let mark = format!("<!-- made: {name} -->\n");
        let start = whole.find(&mark).unwrap_or_else(|| panic!("{PAGE}: no line {mark}")) + mark.len();
        let len = whole[start..].find("<!-- end -->").unwrap_or_else(|| panic!("{PAGE}: {name} has no end"));
        whole.replace_range(start..start + len, &made(name));
    }
    whole
}

fn difference(found: &str, expected: &str) -> Option<String> {
    let mut pairs = found.lines().zip(expected.lines()).enumerate();
    let differs = pairs.find(|(_, (found, expected))| found != expected);
    differs
        .map(|(at, (found, expected))| format!("{PAGE}:{}: found `{found}`, expected `{expected}`", at + 1))
        .or_else(|| (found != expected).then(|| format!("{PAGE}: one is longer than the other")))
}

#[test]
fn tables_match_the_code() {
    let page = read(PAGE);
    let expected = remade(&page);
    if std::env::var_os(MAKE).is_some() {
        let new = file("docs/board.md.new");
        fs::write(&new, &expected).and_then(|()| fs::rename(&new, file(PAGE))).expect("docs/ can be written");
        return;
    }
    if let Some(what) = difference(&page, &expected) {
        panic!("{what}\n  run `{MAKE}=1 cargo test -p system-tests metal`, and commit the page");
    }
}

#[test]
fn changed_table_is_found() {
    let page = read(PAGE);
    for (from, to) in [("| PA8 |", "| PA7 |"), ("| 8192 |", "| 8191 |"), ("<!-- end -->", "x\n<!-- end -->")]
    {
        assert!(page.contains(from), "{from}");
        let changed = page.replacen(from, to, 1);
        assert!(difference(&changed, &remade(&changed)).is_some(), "{from} as {to}");
    }
}

/// Phrases that the page must contain, made from constants: a constant that changes makes another phrase.
fn phrases() -> Vec<String> {
    use timing::{adc, can, hall, pwm, tick, tick_watchdog, watchdog};
    let mega = |hz: u32| hz / 1_000_000;
    let us = |ns: u32| f64::from(ns) / 1e3;
    let ticks = |count: u16| f64::from(count) / f64::from(timing::CORE_HZ) * 1e6;
    let share = |part: u32| f64::from(part) / 10.0;
    let count = f64::from(tick::SLOW_DIVISION) / f64::from(timing::CORE_HZ) * 1e9;
    let mut phrases = vec![
        format!(
            "{} MHz crystal -> PLL × {} -> {} MHz",
            mega(timing::CRYSTAL_HZ),
            timing::PLL_FACTOR,
            mega(timing::CORE_HZ)
        ),
        format!("= {} MHz APB1: bxCAN; × 2 = {} MHz: TIM2", mega(timing::APB1_HZ), mega(timing::TIMER_HZ)),
        format!("= {} MHz ADC", mega(timing::ADC_HZ)),
        format!("{} kHz RC", timing::WATCHDOG_HZ / 1000),
        format!("pairs at {} kHz, centered: the counter goes to {}", pwm::HZ / 1000, pwm::TOP),
        format!("the dead time is {} ns, {} ticks", pwm::DEAD_TIME_NS, pwm::DEAD_TIME),
        format!("up and down | {} µs |", 1_000_000 / pwm::HZ),
        format!("compare value {}: on the way down, {:.2} µs before", pwm::CONVERT, ticks(pwm::CONVERT)),
        format!("for {} cycles, {} µs", f64::from(adc::SAMPLE_HALF_CYCLES) / 2.0, us(adc::SAMPLE_NS)),
        format!("takes {:.2} µs; all four {:.1} µs", us(adc::CONVERSION_NS), us(adc::INJECTED_NS)),
        format!("8 equal samples, {:.1} µs", us(hall::FILTER_NS)),
        format!("| TIM3 | the control tick | 1 µs | {} ms |", 1000 / tick::HZ),
        format!("| SysTick | housekeeping | {count:.0} ns | {} ms |", 1000 / tick::SLOW_HZ),
        format!("/ {} = {} MHz SysTick", tick::SLOW_DIVISION, mega(timing::CORE_HZ / tick::SLOW_DIVISION)),
        format!("{} Mbit/s: {} MHz by {}", mega(can::HZ), mega(timing::APB1_HZ), can::PRESCALER),
        format!(
            "1 + {} + {}, sample point {:.1} %",
            can::SEGMENT_1,
            can::SEGMENT_2,
            share(can::SAMPLE_POINT)
        ),
        format!("jump width {}", can::JUMP),
        format!("nothing can stop it: {} ms", watchdog::MS),
        format!("by 64 counts, {:.1} ms", f64::from(tick_watchdog::US) / 1e3),
        format!("may be an erase, {} ms", tick_watchdog::ERASE_US / 1000),
        format!("the {} kept bytes", MAP.kept.len),
    ];
    let told =
        [FaultCode::Bridge, FaultCode::Watchdog, FaultCode::Panic, FaultCode::HardFault, FaultCode::Clock];
    phrases.extend(told.map(|code| format!("| {} ({})", code.code(), code.row().name)));
    phrases
}

fn missing(page: &str) -> Vec<String> {
    let text = page.split_whitespace().collect::<Vec<_>>().join(" ");
    phrases().into_iter().filter(|phrase| !text.contains(phrase.as_str())).collect()
}

#[test]
fn figures_match_the_code() {
    let missing = missing(&read(PAGE));
    assert!(missing.is_empty(), "{PAGE} does not say, as the code does:\n  {}", missing.join("\n  "));
}

#[test]
fn missing_figure_is_found() {
    let text = read(PAGE).split_whitespace().collect::<Vec<_>>().join(" ");
    for phrase in phrases() {
        assert!(missing(&text.replace(&phrase, "")).contains(&phrase), "{phrase}");
    }
}

/// `task`, vector and priority of each of the application's tasks, as bound in `app.rs`.
fn tasks(app: &str) -> Vec<(String, String, u8)> {
    let value = |attribute: &str, key: &str| -> String {
        let from = attribute.find(key).unwrap_or_else(|| panic!("{attribute}: no {key}")) + key.len();
        attribute[from..].chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
    };
    let attributes = app.split("#[task(").skip(1);
    let task = |text: &str| {
        let priority = value(text, "priority = ").parse().expect("a priority is a number");
        (value(text, "fn "), value(text, "binds = "), priority)
    };
    attributes.map(task).collect()
}

#[test]
fn interrupts_match_the_application() {
    let (page, tasks) = (read(PAGE), tasks(&read("boards/tater-f103/src/app.rs")));
    assert!(tasks.len() > 5, "{tasks:?}");
    for (task, vector, priority) in &tasks {
        // Four bits of priority, the highest first (RTIC's 16 is 0).
        let row = format!("| `{task}` | {vector} | {priority} | 0x{:X}0 |", 16 - priority);
        assert!(page.contains(&row), "{PAGE}: no row {row}");
    }
    let shown: Vec<&str> =
        page.lines().filter(|line| line.contains(" | 0x") && line.starts_with("| `")).collect();
    assert_eq!(shown.len(), tasks.len(), "{PAGE} has a row that is no task: {shown:#?}");
}

/// Errors in the lock times of a page's table of tasks. A further time must name its case (`15; 100 for SAVE`).
fn wrong_locks(page: &str) -> Vec<String> {
    let mut wrong = Vec::new();
    let rows = page.lines().skip_while(|line| !line.ends_with("| lock, µs |")).skip(2);
    for row in rows.take_while(|line| line.starts_with('|')) {
        let mut times = row.trim_end_matches(" |").rsplit(" | ").next().unwrap_or_default().split("; ");
        let number = |text: &str| text.replace(',', "").parse::<u32>().is_ok();
        let for_what =
            |time: &str| time.split_once(' ').is_some_and(|(us, what)| number(us) && what.contains("for "));
        if !(times.next().is_some_and(number) && times.all(for_what)) {
            wrong.push(format!("{PAGE}: found `{row}`, expected a lock of `NN` or `NN; NN for ...`"));
        }
    }
    wrong
}

#[test]
fn every_lock_has_its_time() {
    let page = read(PAGE);
    assert!(!page.contains("TODO"), "{PAGE}: something is left to do");
    assert_eq!(wrong_locks(&page), [""; 0]);
    // Each row without its last cell, or with a word there, is an error.
    let rows = page.lines().skip_while(|line| !line.ends_with("| lock, µs |")).skip(2);
    let rows: Vec<&str> = rows.take_while(|line| line.starts_with('|')).collect();
    assert_eq!(rows.len(), tasks(&read("boards/tater-f103/src/app.rs")).len() + 1, "the tasks and idle");
    for row in rows {
        let (head, _) = row.trim_end_matches(" |").rsplit_once(" | ").expect("cells");
        for cell in ["", "soon", "15; SAVE", "15; 100"] {
            assert_eq!(wrong_locks(&page.replace(row, &format!("{head} | {cell} |"))).len(), 1, "{cell}");
        }
    }
}

#[test]
fn picture_shows_every_pin() {
    let picture = read("docs/board.svg");
    let text: Vec<&str> = picture.split(|c: char| !c.is_alphanumeric()).collect();
    for pin in BUS.iter().chain(MOTOR) {
        assert!(text.contains(&pin.pin), "docs/board.svg: no {} ({})", pin.pin, pin.name);
    }
}
