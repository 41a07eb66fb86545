//! The shipped scenarios' expectations, and the errors for bad scenario files.

use hil_experiment::run::{Options, Outcome, run};
use hil_experiment::scenario::{SHIPPED, Scenario};
use hil_world::plant::Model;
use traces::input::BadInput;

const NOMINAL: Options = Options { seed: 1, model: Model::Averaged, trace: false };

fn shipped(name: &str) -> Scenario {
    Scenario::find(name).unwrap_or_else(|bad| panic!("{bad}"))
}

fn outcome(name: &str, options: &Options) -> Outcome {
    run(&shipped(name), options).unwrap_or_else(|bad| panic!("{name}: {bad}"))
}

fn unmet(model: Model) -> Vec<String> {
    let mut unmet = Vec::new();
    for scenario in SHIPPED {
        let outcome = outcome(scenario.name, &Options { model, ..NOMINAL });
        for verdict in outcome.expectations.iter().filter(|verdict| !verdict.ok) {
            let (name, value, want) = (&verdict.name, &verdict.value, &verdict.want);
            unmet.push(format!("{}: {name} = {value}, want {want}", scenario.name));
        }
    }
    unmet
}

#[test]
fn every_shipped_scenario_meets_its_expectations() {
    assert_eq!(unmet(Model::Averaged), Vec::<String>::new());
}

#[test]
fn every_shipped_scenario_meets_its_expectations_switching() {
    assert_eq!(unmet(Model::Switched), Vec::<String>::new());
}

#[test]
fn shipped_scenarios_are_the_files_and_carry_their_names() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios");
    let entries = std::fs::read_dir(folder).expect("the folder of scenarios");
    let mut files: Vec<String> =
        entries.map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    let mut names: Vec<String> = SHIPPED.iter().map(|scenario| format!("{}.toml", scenario.name)).collect();
    files.sort();
    names.sort();
    assert_eq!(files, names);
    for scenario in SHIPPED {
        let parsed = shipped(scenario.name);
        assert_eq!(parsed.name, scenario.name);
        assert!(!parsed.about.is_empty() && !parsed.expectations.is_empty(), "{}", scenario.name);
    }
}

#[test]
fn same_seed_same_outcome_to_the_last_bit() {
    let options = Options { trace: true, ..NOMINAL };
    let csv = |options: &Options| {
        let traces: Vec<_> =
            outcome("hall-glitch", options).runs.into_iter().filter_map(|run| run.trace).collect();
        let mut csv = Vec::new();
        hil_experiment::trace::write_csv(&mut csv, &traces).expect("memory is never full");
        csv
    };
    assert!(csv(&options) == csv(&options), "a run must not depend on anything but its input");
    assert!(csv(&options) != csv(&Options { seed: 2, ..options }), "the seed reaches the sensors' noise");
}

#[test]
fn the_trace_shows_the_run() {
    let options = Options { trace: true, ..NOMINAL };
    let scenario = shipped("spread-full-travel");
    let outcome = run(&scenario, &options).expect("a shipped scenario");
    let trace = outcome.runs.first().and_then(|run| run.trace.as_ref()).expect("a trace");
    assert_eq!(trace.rows().count() as u32, scenario.duration_ms + 1, "one row a tick and the start");
    let position = trace.column("position_counts");
    let peak = position.iter().copied().fold(f64::MIN, f64::max);
    assert_eq!(outcome.metrics.overshoot_counts, Some((peak - 166.0).max(0.0)));
}

/// A scenario that loads: each bad one below differs from it in one line.
const GOOD: &str = r#"name = "x"
about = "y"
motor = "link"
duration_ms = 500

[plant]
ke_v_s = 0.06

[set]
KP = 60

[[object]]
from_count = 10
side = "closing"
stiffness_n_m_rad = 1
damping_n_m_s = 0

[[at]]
ms = 20
move = 100

[[expect]]
metric = "arrival_ms"
min = 1
"#;

/// A line of `GOOD`, its replacement, the line that the message must name, and texts that it must contain.
const BAD: &[(&str, &str, &str, [&str; 3])] = &[
    ("about = \"y\"", "about = \"y\"\nspeed = 3", "x.toml:3", ["speed", "unknown field", "duration_ms"]),
    (
        "duration_ms = 500",
        "duration_s = 0.5",
        "x.toml:4",
        ["duration_s", "expected", "did you mean duration_ms"],
    ),
    (
        "duration_ms = 500",
        "duration_ms = \"500 ms\"",
        "x.toml:4",
        ["duration_ms", "\"500 ms\"", "1 to 600000"],
    ),
    (
        "duration_ms = 500",
        "duration_ms = 10_000_000_000",
        "x.toml:4",
        ["duration_ms", "10000000000", "1 to 600000"],
    ),
    ("duration_ms = 500", "duration_ms = 99999999999999999999", "x.toml:4", ["duration_ms", "99999", "next"]),
    ("duration_ms = 500", "duration_ms = 0", "x.toml:4", ["duration_ms", "`0`", "1 to 600000"]),
    ("duration_ms = 500", "duration_ms = -5", "x.toml:4", ["duration_ms", "-5", "1 to 600000"]),
    (
        "duration_ms = 500",
        "duration_ms = 0.5",
        "x.toml:4",
        ["duration_ms", "0.5", "whole number of milliseconds"],
    ),
    (
        "duration_ms = 500",
        "",
        "x.toml:1",
        ["duration_ms is missing", "duration_ms = 1000", "add duration_ms"],
    ),
    (
        "duration_ms = 500",
        "duration_ms = 500\nduration_ms = 600",
        "x.toml:5",
        ["duplicate key", "duration_ms", "remove one"],
    ),
    (
        "motor = \"link\"",
        "",
        "x.toml:1",
        ["motor is missing", "\"link\", \"spread\" or \"tip\"", "add motor"],
    ),
    ("motor = \"link\"", "motor = \"thumb\"", "x.toml:3", ["motor", "thumb", "\"spread\""]),
    ("motor = \"link\"", "motor = [\"tip\", \"tip\"]", "x.toml:3", ["motor", "tip", "each motor once"]),
    ("motor = \"link\"", "motor = []", "x.toml:3", ["motor", "invalid length", "\"tip\""]),
    ("motor = \"link\"", "motor =", "x.toml:3", ["motor", "expected", "next"]),
    ("ke_v_s = 0.06", "ke_v_s = nan", "x.toml:7", ["ke_v_s", "NaN", "a finite number"]),
    ("ke_v_s = 0.06", "ke_v_s = inf", "x.toml:7", ["ke_v_s", "inf", "a finite number"]),
    ("ke_v_s = 0.06", "ke_v_s = 7", "x.toml:7", ["ke_v_s is out of range", "ke_v_s = 7", "0.001 to 5"]),
    ("ke_v_s = 0.06", "bus_v = 0", "x.toml:7", ["bus_v is out of range", "bus_v = 0", "1 to 60"]),
    (
        "ke_v_s = 0.06",
        "min_count = 100",
        "x.toml:1",
        ["[initial] position_counts is out of range", "position_counts = 0", "give [initial]"],
    ),
    (
        "ke_v_s = 0.06",
        "ke_mv_s = 60",
        "x.toml:7",
        ["[plant] has no ke_mv_s", "ke_v_s", "did you mean ke_v_s"],
    ),
    ("ke_v_s = 0.06", "ke_v_s = \"0.06 V s\"", "x.toml:7", ["ke_v_s", "\"0.06 V s\"", "number"]),
    ("ke_v_s = 0.06", "zero_sector = 0.5", "x.toml:7", ["zero_sector", "not a whole number", "round"]),
    ("ke_v_s = 0.06", "zero_sector = 300", "x.toml:7", ["zero_sector = 300", "expected", "correct"]),
    ("KP = 60", "KQ = 60", "x.toml:10", ["KQ is not a property", "KQ = 60", "one of KP, KD"]),
    ("KP = 60", "KP = 99999", "x.toml:10", ["KP = 99999 is out of range", "0 to 32767", "choose"]),
    ("KP = 60", "MT = -1", "x.toml:10", ["MT = -1", "0 to 990", "choose"]),
    ("KP = 60", "KP = 60\nkp = 61", "x.toml:11", ["KP is set twice", "each property once", "remove"]),
    ("KP = 60", "KP = 0.5", "x.toml:10", ["KP", "0.5", "whole number"]),
    ("side = \"closing\"", "side = \"left\"", "x.toml:14", ["side", "left", "closing"]),
    ("side = \"closing\"", "", "x.toml:12", ["side", "missing", "add side"]),
    (
        "stiffness_n_m_rad = 1",
        "stiffness_n_m_rad = -1",
        "x.toml:15",
        ["stiffness_n_m_rad = -1", "0 to", "correct"],
    ),
    ("ms = 20", "ms = -20", "x.toml:19", ["ms", "-20", "whole number, 0 or more"]),
    ("ms = 20", "ms = 500", "x.toml:19", ["found:    ms = 500", "0 to 499", "duration_ms longer"]),
    ("move = 100", "go = 100", "x.toml:20", ["unknown field", "go", "`move`"]),
    ("move = 100", "", "x.toml:18", ["found:    0 commands", "torque_close", "one [[at]] for each"]),
    (
        "move = 100",
        "move = 100\nhome = true",
        "x.toml:18",
        ["found:    2 commands", "one command beside ms", "one [[at]] for each"],
    ),
    ("move = 100", "move = 99999", "x.toml:20", ["move", "99999", "-32767 to 32767"]),
    ("move = 100", "mode = \"duty\"", "x.toml:20", ["mode", "duty", "\"trapezoidal\""]),
    ("move = 100", "set = { MV = 15 }", "x.toml:20", ["MV = 15", "16 to 4080", "choose"]),
    (
        "metric = \"arrival_ms\"",
        "metric = \"arival_ms\"",
        "x.toml:22",
        ["arival_ms", "arrival_ms", "did you mean arrival_ms"],
    ),
    (
        "min = 1",
        "equals = 1\ntolerance = -1",
        "x.toml:25",
        ["tolerance", "found:    tolerance = -1", "a tolerance, 0 or more"],
    ),
    ("min = 1", "", "x.toml:22", ["arrival_ms", "min, max or both", "add or remove one"]),
];

/// A metric, a text that it never is, and texts that the message must contain.
const BAD_WORDS: &[(&str, &str, [&str; 3])] = &[
    ("end_reason", "arived", ["equals = \"arived\"", "arrived, stalled, aborted", "did you mean arrived"]),
    ("mode", "holding", ["equals = \"holding\"", "idle, torque, pid", "use one of those"]),
    ("faults", "over-heat", ["equals = \"over-heat\"", "none, halls, over-current", "next"]),
    ("faults", "halls, ", ["equals = \"halls, \"", "under-voltage", "next"]),
];

#[test]
fn impossible_text_of_a_metric_is_refused() {
    let expect = |metric: &str, word: &str| {
        let (head, _) = GOOD.split_once("metric =").expect("an expectation");
        format!("{head}metric = \"{metric}\"\nequals = \"{word}\"\n")
    };
    for (metric, word, words) in BAD_WORDS {
        assert_style(&refusal(&expect(metric, word)), "x.toml:22", words);
    }
    for (metric, word) in [("end_reason", "none"), ("mode", "pid"), ("faults", "halls, under-voltage")] {
        assert!(Scenario::parse("x.toml", &expect(metric, word)).is_ok(), "{metric} = {word}");
    }
}

#[test]
fn endless_name_is_shortened_in_the_message() {
    let long = "k".repeat(100_000);
    let with = |line: &str, instead: String| GOOD.replacen(line, &instead, 1);
    for text in [
        with("about", long.clone()),
        with("about = \"y\"", format!("{long} = 3\n{long} = 4")),
        with("ke_v_s", long.clone()),
        with("KP", long.clone()),
        with("arrival_ms", long.clone()),
        with("\"link\"", format!("\"{long}\"")),
        with("move = 100", format!("{long} = 1")),
        with("\"arrival_ms\"\nmin = 1", format!("\"mode\"\nequals = \"{long}\"")),
    ] {
        let bad = refusal(&text);
        // The longest list of known names has 1000 characters.
        assert!(bad.to_string().chars().count() < 2000, "{} characters", bad.to_string().chars().count());
        assert!(bad.to_string().contains('…'), "{bad}");
    }
    let bad = shipped("link-fast").set(&format!("{long}=1")).expect_err("no such property");
    assert!(bad.to_string().chars().count() < 2000);
}

fn refusal(text: &str) -> BadInput {
    match Scenario::parse("x.toml", text) {
        Err(bad) => bad,
        Ok(_) => panic!("this scenario must be refused:\n{text}"),
    }
}

fn assert_style(bad: &BadInput, place: &str, words: &[&str]) {
    let message = bad.to_string();
    assert_eq!(bad.place, place, "{message}");
    let words = words.iter().chain(&["\n  found:    ", "\n  expected: ", "\n  next:     "]);
    for word in words {
        assert!(message.contains(word), "no {word:?} in\n{message}");
    }
    for part in [&bad.problem, &bad.found, &bad.expected, &bad.next] {
        assert!(!part.is_empty(), "{message}");
    }
    assert!(!message.contains(['\u{0}', '\u{7f}', '\u{1b}']), "{message:?}");
}

#[test]
fn good_scenario_loads() {
    let good = Scenario::parse("x.toml", GOOD).unwrap_or_else(|bad| panic!("{bad}"));
    assert_eq!((good.duration_ms, good.timeline.len(), good.objects.len()), (500, 1, 1));
}

#[test]
fn bad_line_error_names_found_expected_and_next_step() {
    for (line, instead, place, words) in BAD {
        assert!(GOOD.contains(&format!("{line}\n")), "{line}");
        assert_style(&refusal(&GOOD.replacen(line, instead, 1)), place, words);
    }
}

#[test]
fn file_that_is_no_scenario_is_refused() {
    let cases = [
        ("", "x.toml:1", "name is missing"),
        ("hello world", "x.toml:1", "expected"),
        ("{\"name\": \"json\"}", "x.toml:1", "expected"),
        ("name = \"x\u{1b}[31m\"", "x.toml:1", "found"),
        ("[[[", "x.toml:1", "expected"),
        ("name = \"x\nabout = \"y\"", "x.toml:1", "name"),
    ];
    for (text, place, word) in cases {
        assert_style(&refusal(text), place, &[word]);
    }
}

#[test]
fn unreadable_file_is_named() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("bad-scenarios");
    std::fs::create_dir_all(folder.join("directory.toml")).expect("a folder for the test");
    let file =
        |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("a file for the test");
    file("binary.toml", &[0x7f, b'E', b'L', b'F', 0xff, 0xfe, 0]);
    file("large.toml", &vec![b'#'; (1 << 20) + 1]);
    file("empty.toml", b"");
    let cases = [
        ("directory.toml", "directory"),
        ("binary.toml", "not UTF-8"),
        ("large.toml", "1048577 bytes"),
        ("missing.toml", "hil-sim list"),
    ];
    for (name, word) in cases {
        let path = folder.join(name).to_string_lossy().into_owned();
        let bad = Scenario::find(&path).err().unwrap_or_else(|| panic!("{name} must be refused"));
        assert_style(&bad, &path, &[word]);
    }
    let path = folder.join("empty.toml").to_string_lossy().into_owned();
    let bad = Scenario::find(&path).expect_err("an empty file is no scenario");
    assert_style(&bad, &format!("{path}:1"), &["missing"]);
    let bad = Scenario::find("spread-ful-travel").expect_err("no such scenario");
    assert_style(&bad, "spread-ful-travel", &["did you mean spread-full-travel"]);
}

#[test]
fn properties_from_the_command_line_are_checked_like_those_of_a_file() {
    let mut scenario = shipped("link-fast");
    scenario.set("kp=120").unwrap_or_else(|bad| panic!("{bad}"));
    assert!(scenario.cases.iter().all(|case| case.config.kp == 120));
    let cases = [
        ("KP", "PROPERTY=VALUE"),
        ("KP=", "whole number"),
        ("KP=1.5", "whole number"),
        ("KP=-1", "0 to 32767"),
        ("NOPE=1", "one of KP"),
        ("=5", "one of KP"),
        ("KP=999999999999999999999", "out of range"),
    ];
    for (assignment, word) in cases {
        let bad = scenario.set(assignment).expect_err(assignment);
        assert_style(&bad, &format!("--set {assignment}"), &[word]);
    }
}

fn timed(motor: &str, commands: &[(u32, &str)]) -> hil_experiment::metrics::Metrics {
    let at: String = commands.iter().map(|(ms, what)| format!("[[at]]\nms = {ms}\n{what}\n")).collect();
    let text = format!("name = \"x\"\nabout = \"y\"\nmotor = \"{motor}\"\nduration_ms = 3000\n{at}");
    let scenario = Scenario::parse("x.toml", &text).unwrap_or_else(|bad| panic!("{bad}"));
    run(&scenario, &NOMINAL).unwrap_or_else(|bad| panic!("{bad}")).metrics
}

#[test]
fn move_time_starts_at_its_first_driven_tick() {
    let from_rest = |end| timed("link", &[(0, &format!("move = {end}"))]).end_ms.expect("an end");
    let after_velocity =
        timed("link", &[(0, "velocity = 60"), (0, "mode = \"velocity\""), (1000, "move = 300")]);
    let took = after_velocity.arrival_ms().expect("an arrival");
    assert!(took < from_rest(300), "{took} ms for a part of the way");
    // Aborted at 400 ms, from there back or on to 100, in the same millisecond.
    let after_abort = timed("link", &[(0, "move = 300"), (400, "abort = true"), (400, "move = 100")]);
    let took = after_abort.arrival_ms().expect("an arrival");
    assert!(took < from_rest(100), "{took} ms");
    assert_eq!(after_abort.ends, 2);
    // It is at the goal already.
    for motor in ["link", "spread"] {
        let metrics = timed(motor, &[(0, "move = 0")]);
        assert_eq!((metrics.end_ms, metrics.arrival_ms()), (Some(0.0), Some(0.0)), "{motor}");
    }
}
