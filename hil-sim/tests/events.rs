//! The event logs that `hil-sim` prints.

use std::io::Write;
use std::process::{Command, Output, Stdio};

fn hil_sim(args: &[&str], input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    child.stdin.take().expect("piped").write_all(input.as_bytes()).expect("it reads");
    child.wait_with_output().expect("it ends")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("text")
}

/// Time in ms, source and event of each line of a log.
fn events(stderr: &str) -> Vec<(f64, String, String)> {
    let lines = stderr.lines().skip_while(|line| !line.starts_with("last events")).skip(1);
    let event = |line: &str| {
        let (ms, rest) = line.split_once(" ms  ")?;
        let (source, event) = rest.split_once("  ")?;
        Some((ms.trim().parse().ok()?, source.trim().to_owned(), event.trim().to_owned()))
    };
    lines.map_while(event).collect()
}

const OVER_TEMPERATURE: &str = "WAKE\n1 S OTEMP 250\n1HI\n";

#[test]
fn gcl_events_lists_orders_and_faults_by_time() {
    let output = hil_sim(&["gcl", "--events"], OVER_TEMPERATURE);
    assert_eq!(output.status.code(), Some(1), "HI ends in an error");
    let events = events(&text(&output.stderr));
    assert!(events.is_sorted_by_key(|event| event.0), "{events:?}");
    let at = |source: &str, event: &str| {
        events.iter().position(|(_, s, e)| s == source && e.contains(event)).unwrap_or_else(|| {
            panic!("no {event:?} of {source} in {events:?}");
        })
    };
    let order = at("GOD", "motor 1: SET OTEMP 250");
    let taken = at("board 1", "SET OTEMP 250");
    let fault = at("board 1", "fault: over-temperature");
    assert!(order < taken && taken < fault, "{events:?}");
    assert!(!text(&output.stdout).contains(" ms  "), "the transcript stays as it is");
}

#[test]
fn gcl_without_events_prints_none() {
    let output = hil_sim(&["gcl"], OVER_TEMPERATURE);
    assert_eq!((output.status.code(), text(&output.stderr).as_str()), (Some(1), ""));
}

#[test]
fn gcl_json_has_events_on_request_only() {
    let object = |args: &[&str]| -> serde_json::Value {
        serde_json::from_slice(&hil_sim(args, "WAKE\n").stdout).expect("an object")
    };
    let with = object(&["gcl", "--json", "--events"]);
    let events = with["events"].as_array().expect("a list");
    let wakes =
        |event: &&serde_json::Value| event["source"] == "GOD" && event["event"] == "motor 7: SET STAT 2";
    assert_eq!(events.iter().filter(wakes).count(), 1, "{events:?}");
    assert!(events.iter().all(|event| event["ms"].is_number()), "{events:?}");
    assert_eq!(object(&["gcl", "--json"]).get("events"), None);
}

#[test]
fn failed_run_prints_the_boards_events() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("events");
    std::fs::create_dir_all(&folder).expect("a folder");
    let path = folder.join("short.toml");
    let scenario = |arrived: &str| {
        let scenario = format!(
            "name = 'short'\nabout = 'a short move'\nmotor = 'spread'\nduration_ms = 1000\n\
             [[at]]\nms = 10\nmove = 20\n[[expect]]\nmetric = 'end_reason'\nequals = '{arrived}'\n"
        );
        std::fs::write(&path, scenario).expect("written");
        hil_sim(&["run", path.to_str().expect("text")], "")
    };
    let passed = scenario("arrived");
    assert_eq!((passed.status.code(), text(&passed.stderr).as_str()), (Some(0), ""));
    let failed = scenario("stalled");
    assert_eq!(failed.status.code(), Some(1));
    let events = events(&text(&failed.stderr));
    let found: Vec<&str> = events.iter().map(|(_, _, event)| event.as_str()).collect();
    assert!(found.windows(2).any(|pair| pair == ["SET M 20", "mode trapezoidal"]), "{events:?}");
    assert!(found.contains(&"arrived, then idle") || found.contains(&"arrived, then pid"), "{events:?}");
    assert!(events.iter().all(|(ms, source, _)| source == "board 4" && *ms <= 1000.0), "{events:?}");
}
