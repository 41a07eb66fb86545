//! `hil-sim compare`: differences of runs, and their curves on one page.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn hil_sim(args: &[&str], folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    command.args(args).current_dir(folder).output().expect("the binary starts")
}

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

fn run(folder: &Path, out: &str, more: &[&str]) {
    let scenario = "name = 'x'\nabout = 'y'\nmotor = 'tip'\nduration_ms = 300\n[[at]]\nms = 10\nmove = 60\n";
    std::fs::write(folder.join("x.toml"), scenario).expect("ours");
    let output = hil_sim(&[&["run", "x.toml", "--out", out], more].concat(), folder);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
}

fn json(folder: &Path, args: &[&str]) -> Value {
    let output = hil_sim(&[&["compare", "--json"], args].concat(), folder);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

fn row<'a>(compared: &'a Value, part: &str, name: &str) -> &'a Value {
    let rows = compared["groups"][0][part].as_array().expect("rows");
    rows.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("{part} {name}"))
}

#[test]
fn differences_are_those_of_the_runs() {
    let folder = folder("compare-runs");
    run(&folder, "a", &[]);
    run(&folder, "b", &["--set", "KP=20", "--seed", "3"]);
    let compared = json(&folder, &["a", "b", "--out", "c.html"]);
    assert_eq!(row(&compared, "properties", "KP")["differences"], serde_json::json!([0.0, -100.0]));
    let own = |name: &str| -> f64 {
        let bytes = std::fs::read(folder.join(name).join("run.json")).expect("written");
        let run: Value = serde_json::from_slice(&bytes).expect("JSON");
        assert_eq!(run["motors"][0]["node"], 5);
        assert!(
            run["reproduce"].as_str().is_some_and(|line| line.starts_with("hil-sim run x.toml")),
            "{run}"
        );
        run["motors"][0]["metrics"]["tracking_rms_counts"].as_f64().expect("a number")
    };
    let [a, b] = ["a", "b"].map(own);
    let tracking = row(&compared, "metrics", "tracking_rms_counts");
    assert_eq!(tracking["values"], serde_json::json!([a, b]));
    // The trace has three digits after the point.
    let of_trace = row(&compared, "figures", "lag, RMS in mode 5")["values"][1].as_f64().expect("a number");
    assert!((of_trace - b).abs() < 0.01, "{of_trace}, {b}");
    let page = std::fs::read_to_string(folder.join("c.html")).expect("written");
    assert!(
        page.contains("Velocity") && page.contains("hil-sim run x.toml --set KP=20 --seed 3"),
        "curves and lines"
    );
    let text = hil_sim(&["compare", "a", "b"], &folder);
    let text = String::from_utf8(text.stdout).expect("text");
    assert!(text.contains("20 (−100)") && text.contains("metrics of the runs"), "{text}");
}

#[test]
fn other_rates_lengths_columns_and_formats_are_compared() {
    let folder = folder("compare-recordings");
    run(&folder, "a", &[]);
    let convert = hil_sim(&["convert", "a/trace.csv", "a.parquet"], &folder);
    assert_eq!(convert.status.code(), Some(0));
    let recorded: String = (0..40).map(|i| format!("{},{},{}\n", 5 * i, 2 * i, i % 7)).collect();
    let recorded = format!("time_ms,position_estimated_counts,torque_per_1024\n{recorded}");
    std::fs::write(folder.join("bench.csv"), recorded).expect("ours");
    let compared = json(&folder, &["a", "bench.csv", "a.parquet"]);
    assert_eq!(row(&compared, "figures", "duration")["values"], serde_json::json!([300.0, 195.0, 300.0]));
    assert_eq!(row(&compared, "figures", "travel")["values"][1], 78.0);
    assert_eq!(row(&compared, "figures", "peak speed")["values"][1], Value::Null);
    let same = row(&compared, "figures", "peak speed")["differences"][2].as_f64();
    assert_eq!(same, Some(0.0), "one trace in two formats");
    let notes = compared["notes"].to_string();
    for note in ["bench.csv has no columns for: Lag, Velocity", "bench.csv has no run.json", "estimates"] {
        assert!(notes.contains(note), "{note}: {notes}");
    }
}

/// Programs with one type for all numbers write the node as 4.0.
#[test]
fn node_written_as_a_decimal_keeps_motors_apart() {
    let folder = folder("compare-nodes");
    let rows = |point: &str| -> String {
        let row = |node, i| format!("{i},{node}{point},{}\n", 10 * node + i);
        (0..9).flat_map(|i| [1, 4].map(|node| row(node, i))).collect()
    };
    for (file, point) in [("whole.csv", ""), ("decimal.csv", ".0"), ("half.csv", ".5")] {
        let text = format!("time_ms,motor,position_counts\n{}", rows(point));
        std::fs::write(folder.join(file), text).expect("ours");
    }
    let compared = json(&folder, &["whole.csv", "decimal.csv"]);
    assert_eq!(compared["groups"].as_array().map(Vec::len), Some(2), "{compared}");
    assert_eq!(row(&compared, "figures", "travel")["values"], serde_json::json!([8.0, 8.0]));
    let output = hil_sim(&["compare", "whole.csv", "half.csv"], &folder);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(errors.contains("half.csv:2: column motor"), "{errors}");
}

#[test]
fn bad_inputs_name_the_place_and_a_next_step() {
    let folder = folder("compare-bad");
    run(&folder, "a", &[]);
    std::fs::create_dir(folder.join("empty")).expect("ours");
    std::fs::create_dir(folder.join("torn")).expect("ours");
    std::fs::copy(folder.join("a/trace.csv"), folder.join("torn/trace.csv")).expect("ours");
    std::fs::write(folder.join("torn/run.json"), "{").expect("ours");
    std::fs::write(folder.join("back.csv"), "time_ms,bus_v\n0,24\n5,24\n4,24\n").expect("ours");
    std::fs::write(folder.join("none.csv"), "time_ms,bus_v\n").expect("ours");
    std::fs::write(folder.join("x.toml"), "").expect("ours");
    let nine = ["a"; 9];
    for (args, what) in [
        (&["a"][..], "2 to 8"),
        (&nine[..], "9 inputs"),
        (&["a", "empty"], "no trace.csv in the folder"),
        (&["a", "missing.csv"], "missing.csv"),
        (&["a", "torn"], "torn/run.json"),
        (&["a", "back.csv"], "expected: more than 5"),
        (&["a", "none.csv"], "has no rows"),
        (&["a", "x.toml"], "a header and rows"),
        (&["a/trace.csv", "a", "--out", "a/trace.csv"], "would overwrite an input"),
        (&["a", "torn/trace.csv", "--out", "a/trace.csv"], "would overwrite an input"),
        (&["a", "gone"], "No such file"),
        (&["a", "a", "--out", "nowhere/c.html"], "cannot be written"),
    ] {
        let output = hil_sim(&[&["compare"], args].concat(), &folder);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
        assert!(
            text.contains(what) && text.contains("next:") && output.stdout.is_empty(),
            "{args:?}: {text}"
        );
    }
}
