//! `hil-sim tune` from the command line.

use std::process::{Command, Output};

use serde_json::Value;

fn tune(line: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .arg("tune")
        .args(line.split(' '))
        .output()
        .expect("hil-sim starts")
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

const SMALL: &str =
    "--motor spread --objective step --robust 2 --candidates 12 --unseen 50 --set KP=8 --set KD=0 --seed 5";

#[test]
fn result_is_the_same_for_any_jobs_and_from_its_own_line() {
    let one = tune(&format!("{SMALL} --json --jobs 1"));
    let two = tune(&format!("{SMALL} --json --jobs 2"));
    assert_eq!(one.stdout, two.stdout);
    let object = json(&one);
    let line = object["reproduce"].as_str().expect("a line").to_owned();
    let again = tune(&format!("{} --json", line.strip_prefix("hil-sim tune ").expect("this program")));
    assert_eq!(one.stdout, again.stdout, "{line}");
    let motor = &object["motors"][0];
    assert!(
        motor["validation"]["improvement_percent"].as_f64().is_some_and(|percent| percent > 10.0),
        "{motor}"
    );
    assert_eq!(motor["validation"]["plants"], 50);
    assert_eq!(object["passed"], one.status.success());
}

#[test]
fn folder_has_the_result_and_scenarios_that_run() {
    let dir = std::env::temp_dir().join(format!("tune-{}", std::process::id()));
    let output = tune(&format!("{SMALL} --pareto settling_ms,chatter --out {}", dir.display()));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(text.contains("reproduce with: hil-sim tune --motor spread"), "{text}");
    assert!(text.contains(" --pareto settling_ms,chatter\n"), "{text}");
    let tuned: Value =
        serde_json::from_slice(&std::fs::read(dir.join("tuned.json")).expect("written")).expect("JSON");
    assert!(tuned["motors"][0]["pareto"].as_array().is_some_and(|front| !front.is_empty()), "{tuned}");
    let page = std::fs::read_to_string(dir.join("report.html")).expect("written");
    for part in [
        "hil-sim tune --motor spread",
        "before: median",
        "tuned: half of them",
        "Terms of the cost",
        "Candidates",
    ] {
        assert!(page.contains(part), "{part}");
    }
    let scenario = dir.join("step-spread.toml");
    let run = Command::new(env!("CARGO_BIN_EXE_hil-sim")).arg("run").arg(&scenario).output().expect("starts");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    // With the values found, not those of the board.
    let text = std::fs::read_to_string(&scenario).expect("written");
    let properties = tuned["motors"][0]["properties"].as_object().expect("values");
    for (name, value) in properties {
        assert!(text.contains(&format!("{name} = {value}")), "{name} = {value} in {text}");
    }
    std::fs::remove_dir_all(&dir).expect("removed");
}

#[test]
fn bad_arguments_name_the_option_and_a_next_step() {
    let base = "--motor link --objective step --candidates 1";
    for (more, what) in [
        ("--robust 0", "--robust"),
        ("--budget 0s", "60s"),
        ("--properties KQ", "no property has this name"),
        ("--properties KPW", "did you mean KP?"),
        ("--pareto chatter", "two different names"),
        ("--pareto chatter,chatter", "two different names"),
        ("--plant ke_v_s=0.0075", "ke_v_s is out of range"),
        ("--out tests/tune.rs", "cannot be written"),
        ("--out /dev/full", "cannot be written"),
        ("--pareto chatter,settling", "did you mean settling_ms?"),
        ("--plant inertai=3x", "did you mean inertia?"),
        ("--supply volts=99", "out of range"),
        ("--set KP=99999", "out of range"),
        ("--objective all", "--objective"),
    ] {
        let base = if more == "--budget 0s" { "--motor link --objective step" } else { base };
        let output = tune(&format!("{base} {more}"));
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{more}: {text}");
        assert!(text.contains(what) && output.stdout.is_empty(), "{more}: {text}");
    }
}

#[test]
fn folder_of_a_sweep_is_kept() {
    let dir = std::env::temp_dir().join(format!("tune-sweep-{}", std::process::id()));
    std::fs::create_dir_all(&dir).expect("made");
    std::fs::write(dir.join("sweep.json"), "{}").expect("written");
    let output = tune(&format!("{SMALL} --out {}", dir.display()));
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("has the results of a sweep"), "{text}");
    assert_eq!(std::fs::read_dir(&dir).expect("readable").count(), 1);
    std::fs::remove_dir_all(&dir).expect("removed");
}

#[test]
fn limits_that_nothing_keeps_are_an_error() {
    let output = tune("--motor link --objective move --robust 1 --candidates 2 --set MT=20");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("no candidate keeps the limits") && text.contains("--budget"), "{text}");
}

/// The defaults come from long runs (docs/tune.md); a short one finds nothing that is much better. Which plants its 24 candidates suit changes with
/// every change of the servo: links gained 4.7 % before the supply current bounded the EMF, and 5.2 % since.
#[test]
fn short_search_beats_the_defaults_by_6_percent_at_most() {
    let output = tune("--motor all --objective all --robust 4 --candidates 24 --unseen 40 --seed 7 --json");
    let object = json(&output);
    for motor in object["motors"].as_array().expect("motors") {
        let validation = &motor["validation"];
        assert_eq!(validation["start_broken"], 0, "{motor}");
        let percent = validation["improvement_percent"].as_f64().expect("a number");
        println!("figure: {}: {percent:.1} % less cost by 24 candidates", motor["motor"]);
        assert!(percent <= 6.0, "{motor}");
    }
}
