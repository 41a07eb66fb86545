//! Figures of documents, held by what measures them or by the code that has them: each as tight as it is printed.
//!
//! [`claim`] finds a sentence of a page, in which `{}` stands for each number, and compares the numbers with what a test has found. A
//! change fails the test that measures; `BLESS_FIGURES=1` before the same command writes the new numbers into the page.

use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use hil_experiment::run::{Options, run};
use hil_experiment::scenario::Scenario;
use hil_torture::kinds::ROWS;
use hil_world::plant::Model;
use serde_json::Value;
use servo_core::Motor;
use servo_core::guard::direction::Starts;
use tater_f103::map::{APPLICATION, MONITOR};
use tater_wire::MotorKind;
use tater_wire::map::Area;

use crate::fences::{Source, files, root};

/// What a number of a page has to be.
#[derive(Clone, Copy, Debug)]
pub enum Figure {
    /// This, rounded to the number's decimals.
    Near(f64),
    /// The least number with its decimals that is not below this: "at worst", "under".
    AtMost(f64),
}

impl Figure {
    fn text(self, decimals: usize) -> String {
        let scale = 10_f64.powi(decimals as i32);
        let value = match self {
            Self::Near(value) => (value * scale).round() / scale,
            // What differs from a printed number by the error of the arithmetic alone is that number.
            Self::AtMost(value) => (value * scale - 1e-6).ceil().max(0.0) / scale,
        };
        let text = format!("{value:.decimals$}");
        let (whole, rest) = text.split_once('.').map_or((&*text, ""), |(whole, rest)| (whole, rest));
        let mut grouped = String::new();
        for (place, digit) in whole.chars().enumerate() {
            let left = whole.len() - place;
            if place > 0 && left.is_multiple_of(3) && !grouped.ends_with('-') {
                grouped.push(',');
            }
            grouped.push(digit);
        }
        if rest.is_empty() { grouped } else { format!("{grouped}.{rest}") }
    }
}

/// The end of a number that begins a text: digits, commas between them, a point and decimals.
fn number(text: &str) -> Option<usize> {
    let mut len = text.strip_prefix('-').map_or(0, |_| 1);
    let digits =
        |from: usize| text.get(from..).map_or(0, |text| text.bytes().take_while(u8::is_ascii_digit).count());
    let whole = digits(len);
    len += whole;
    while text.get(len..)?.starts_with(',') && digits(len + 1) == 3 {
        len += 4;
    }
    if text.get(len..)?.starts_with('.') && digits(len + 1) > 0 {
        len += 1 + digits(len + 1);
    }
    (whole > 0).then_some(len)
}

/// The end of `part` at `at`; a blank of it is any run of blanks and line ends.
fn literal(text: &str, mut at: usize, part: &str) -> Option<usize> {
    let mut wanted = part.chars().peekable();
    while let Some(character) = wanted.next() {
        let rest = text.get(at..)?;
        if character == ' ' {
            let blanks = rest.len() - rest.trim_start_matches([' ', '\n']).len();
            if blanks == 0 {
                return None;
            }
            at += blanks;
            while wanted.next_if_eq(&' ').is_some() {}
        } else {
            at += rest.strip_prefix(character).map(|_| character.len_utf8())?;
        }
    }
    Some(at)
}

/// Where the numbers of a sentence are that begins at `at`.
fn numbers(text: &str, at: usize, sentence: &str) -> Option<Vec<Range<usize>>> {
    let mut parts = sentence.split("{}");
    let mut at = literal(text, at, parts.next()?)?;
    let mut found = Vec::new();
    for part in parts {
        let end = at + number(text.get(at..)?)?;
        found.push(at..end);
        at = literal(text, end, part)?;
    }
    Some(found)
}

/// The page with the figures in the place of its numbers, or why the sentence has not that many numbers or places.
fn with_figures(text: &str, sentence: &str, figures: &[Figure]) -> Result<String, String> {
    let begins = text.char_indices().filter_map(|(at, _)| numbers(text, at, sentence));
    let all: Vec<Vec<Range<usize>>> = begins.collect();
    let [places] = &all[..] else { return Err(format!("found {} times, expected once", all.len())) };
    if places.len() != figures.len() {
        return Err(format!("has {} numbers, expected {}", places.len(), figures.len()));
    }
    let mut text = text.to_owned();
    for (place, figure) in places.iter().zip(figures).rev() {
        let decimals = text[place.clone()].split_once('.').map_or(0, |(_, decimals)| decimals.len());
        text.replace_range(place.clone(), &figure.text(decimals));
    }
    Ok(text)
}

/// Holds a sentence of a page, in which `{}` stands for each number, to what was found.
pub fn claim(page: &str, sentence: &str, figures: &[Figure]) {
    // Several tests may write one page.
    static PAGES: Mutex<()> = Mutex::new(());
    let _alone = PAGES.lock().unwrap_or_else(PoisonError::into_inner);
    let path = root().join(page);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{page}: {error}"));
    let right =
        with_figures(&text, sentence, figures).unwrap_or_else(|why| panic!("{page}: {sentence:?} {why}"));
    if right == text {
        return;
    }
    if std::env::var_os("BLESS_FIGURES").is_some() {
        std::fs::write(&path, right).unwrap_or_else(|error| panic!("{page}: {error}"));
        return;
    }
    let (was, is) = text.lines().zip(right.lines()).find(|(was, is)| was != is).unwrap_or_default();
    panic!(
        "{page}: found\n  {is}\nexpected, as the page says,\n  {was}\nif that is meant, BLESS_FIGURES=1 before the same command writes the page"
    );
}

/// The number of a constant in a source file: `const NAME: ... = 12;`, also in brackets, with `_` and products.
fn constant(file: &str, name: &str) -> f64 {
    let text = std::fs::read_to_string(root().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
    let value = text.split_once(&format!("const {name}: ")).and_then(|(_, rest)| {
        let (_, value) = rest.split_once(" = ")?;
        let value = value.split_once(';')?.0;
        let inner = value.split_once('(').map_or(value, |(_, inner)| inner.trim_end_matches(')'));
        inner.replace('_', "").parse().ok()
    });
    value.unwrap_or_else(|| panic!("{file} has no number {name}"))
}

use Figure::{AtMost, Near};

/// How a wrong direction is met: docs/safety.md, docs/board.md, decision 0047.
#[test]
fn documents_have_the_limits_of_the_direction_guard() {
    let of = |name| Near(constant("servo-core/src/guard/direction.rs", name));
    let starts = Starts::new(&Motor::HAND);
    let [start, most] = [starts.start, starts.most].map(|torque| Near(f64::from(torque.0)));
    let [loose, wedged] = [starts.loose, starts.wedged].map(|units| Near(f64::from(units)));
    let (right, rate, patience) = (of("RIGHT"), of("WEDGED_RATE"), of("PATIENCE_MS"));
    let page = "docs/safety.md";
    claim(page, "Its torque is at most {} of 1024 until it has turned six counts", &[wedged]);
    claim(
        page,
        "| {} of 1024 of torque, up to {} while the rotor stands, until six counts were right;",
        &[start, wedged],
    );
    claim("docs/board.md", "seconds, at most {} of 1024 of torque)", &[most]);
    let page = "docs/decisions/0047-direction-guard.md";
    claim(
        page,
        "until the rotor has run {} counts with its torque, torque is limited to {} of 1024.",
        &[right, start],
    );
    claim(
        page,
        "A motor that stands still for {} ms gets one unit more a ms, up to {}, then {}, up to {}:",
        &[patience, most, rate, wedged],
    );
    claim(page, "Once it moves the limit is {} at most.", &[loose]);
    claim(
        page,
        "one against a load above {} stalls. So does one of a joint that is wedged by more than {}:",
        &[loose, wedged],
    );
}

/// At 1.5 cycles an instruction and 72 MHz.
const US_PER_INSTRUCTION: f64 = 1.5 / 72.0;

fn json(file: &str) -> Value {
    let text = std::fs::read_to_string(root().join(file)).unwrap_or_else(|error| panic!("{file}: {error}"));
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{file}: {error}"))
}

/// The instructions of the flashed image, as `tests/emulated/budgets.rs` counts them, and the time of the one lock that follows.
#[test]
fn documents_have_the_instructions_of_the_image() {
    let counted = json("tests/emulated/budgets.json");
    let all = |key: &str| -> Vec<f64> {
        let cases = counted.as_object().expect("an object");
        // A hall edge and a driven tick need a motor that runs.
        let cases = cases.iter().filter(|(name, _)| *name != "idle");
        cases.filter_map(|(_, case)| case[key].as_f64()).collect()
    };
    let most = |key| all(key).into_iter().fold(0.0, f64::max);
    let least = all("tick_mean").into_iter().fold(f64::INFINITY, f64::min);
    let budget = |name| Near(constant("tests/emulated/budgets.rs", name));
    claim(
        "docs/figures.md",
        "hall edge to bridge {} of {}; control tick while driven {} to {} on average of {}, {} at worst of {} |",
        &[
            Near(most("hall_max")),
            budget("HALL_MAX"),
            Near(least),
            Near(most("tick_mean")),
            budget("TICK_MEAN"),
            Near(most("tick_max")),
            budget("TICK_MAX"),
        ],
    );
    let lock_us = Near(most("tick_max") * US_PER_INSTRUCTION);
    claim(
        "docs/board.md",
        "| `tick` | TIM3 | {} | 0xD0 | every {} ms | {} |",
        &[Near(3.0), Near(1.0), lock_us],
    );
    let page = "docs/decisions/0053-boards-protect-their-supply.md";
    claim(page, "which holds it up by {} µs a tick,", &[lock_us]);
}

#[test]
fn readme_has_the_size_of_the_image() {
    let size = json("xtask/size.json");
    let kib = |program: &str| Near(size[program]["flash"].as_f64().expect("bytes") / 1024.0);
    let text = std::fs::read_to_string(root().join("xtask/src/size/figures.rs")).expect("readable");
    let (_, reserve) = text.split_once("const RESERVE: u32 = ").expect("a reserve");
    let (reserve, _) = reserve.split_once(" * 1024;").expect("in KiB");
    let reserve: f64 = reserve.parse().expect("a number");
    let limit = |area: Area| Near(f64::from(area.len) / 1024.0 - reserve);
    claim(
        "docs/figures.md",
        "| production image | application {} of {} KiB, monitor {} of {} KiB;",
        &[kib("tater"), limit(APPLICATION), kib("monitor"), limit(MONITOR)],
    );
}

/// Lines of a crate outside its tests.
fn lines(package: &str) -> f64 {
    let own = |source: &&Source| {
        let inside = source.path.strip_prefix(package).and_then(|rest| rest.strip_prefix('/'));
        inside
            .is_some_and(|rest| (rest.starts_with("src/") || rest == "build.rs") && !rest.contains("/tests"))
    };
    let files = files("rs");
    files.iter().filter(own).map(|source| source.text.lines().count() as f64).sum()
}

#[test]
fn porting_has_the_lines_of_each_crate() {
    for package in
        ["servo-core", "tater-wire", "boot", "tater-fw", "bsp-stm32f1", "boards/tater-f103", "boards/stub"]
    {
        claim("docs/porting.md", &format!("| `{package}` | {{}} |"), &[Near(lines(package) / 1000.0)]);
    }
}

/// What `hil-sim run NAME` prints.
#[test]
fn readme_has_the_times_of_full_travel() {
    let metrics = |name: &str| {
        let scenario = Scenario::find(name).expect("a shipped scenario");
        run(&scenario, &Options { seed: 1, model: Model::Averaged, trace: false }).expect("valid").metrics
    };
    let ms = |name: &str| metrics(name).arrival_ms().expect("it arrives");
    let spread = metrics("spread-full-travel");
    let (arrival, overshoot) = (ms("spread-full-travel"), spread.overshoot_counts.expect("a move"));
    claim(
        "README.md",
        "| the spread through its full travel | {} ms, overshoot {}° (manual: {} s) |",
        &[Near(arrival), AtMost(overshoot * degrees(MotorKind::Spread)), Near(0.88)],
    );
    claim("README.md", "drawn by the simulator: {} s, the manual's figure.*", &[Near(arrival / 1000.0)]);
    claim(
        "docs/figures.md",
        "| link and tip, full travel at ACCEL {} | {} ms and {} ms (manual: {} s and {} s) |",
        &[Near(60.0), Near(ms("link-fast")), Near(ms("tip-fast")), Near(0.72), Near(1.0)],
    );
}

/// Degrees of a joint in a hall count.
pub fn degrees(kind: MotorKind) -> f64 {
    360.0 / MotorKind::COUNTS_PER_TURN as f64 * 100.0 / kind.gear_hundredths() as f64
}

#[test]
fn figures_have_the_degrees_of_a_hall_count() {
    let [link, tip, spread] =
        [MotorKind::Link, MotorKind::Tip, MotorKind::Spread].map(|kind| Near(degrees(kind)));
    claim(
        "docs/figures.md",
        "A hall count is {}° of a finger's link, {}° of its tip and {}° of the spread; a revolution of the motor has {}.",
        &[link, tip, spread, Near(MotorKind::COUNTS_PER_TURN as f64)],
    );
}

#[test]
fn readme_has_the_kinds_of_fault() {
    claim("README.md", "under random programs and {} kinds of fault |", &[Near(ROWS.len() as f64)]);
}

#[test]
fn figure_is_printed_with_the_decimals_and_groups_of_its_page() {
    for (figure, decimals, text) in [
        (Near(0.884), 2, "0.88"),
        (Near(883.6), 0, "884"),
        (AtMost(0.21), 1, "0.3"),
        (AtMost(0.2), 1, "0.2"),
        (AtMost(-1.0), 1, "0.0"),
        (Near(1476.0), 0, "1,476"),
        (Near(1_234_567.21), 1, "1,234,567.2"),
        (Near(-123.0), 0, "-123"),
    ] {
        assert_eq!(figure.text(decimals), text, "{figure:?}");
    }
}

#[test]
fn sentence_is_found_across_lines_and_its_numbers_replaced() {
    let page = "a 5.50 of 1,000\nb, at\n  most 12. And 7 of 1,000 b, at most 3,\n";
    let replaced = with_figures(page, "a {} of {} b, at most {}.", &[Near(1.234), Near(2000.0), AtMost(1.5)]);
    assert_eq!(replaced, Ok("a 1.23 of 2,000\nb, at\n  most 2. And 7 of 1,000 b, at most 3,\n".to_owned()));
    for (sentence, count, why) in [
        ("of {} b", 1, "found 2 times, expected once"),
        ("a {} of {} c", 2, "found 0 times, expected once"),
        ("a {} of {} b,", 1, "has 2 numbers, expected 1"),
        ("a {}of", 1, "found 0 times, expected once"),
    ] {
        let found = with_figures(page, sentence, &vec![Near(1.0); count]);
        assert_eq!(found, Err(why.to_owned()), "{sentence}");
    }
}
