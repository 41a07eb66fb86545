//! `hil-sim excite` and `hil-sim identify` from the command line.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

fn sim(line: &str, dir: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    command.args(line.split(' ')).current_dir(dir).output().expect("hil-sim starts")
}

fn folder(name: &str) -> PathBuf {
    let dir = std::env::temp_dir().join(format!("identify-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&dir).expect("a folder");
    dir
}

fn value(object: &Value, name: &str) -> f64 {
    object[name]["value"].as_f64().unwrap_or(f64::NAN)
}

#[test]
fn recorded_move_gives_every_figure_and_a_page_of_residuals() {
    let dir = folder("tip");
    let excite = sim("excite --motor tip --plant inertia=1.2x --plant resistance=0.9x --out t.csv", &dir);
    assert!(excite.status.success(), "{excite:?}");
    let identify = sim("identify t.csv --motor tip --json --out page", &dir);
    let object: Value = serde_json::from_slice(&identify.stdout).expect("one JSON object alone");
    assert!(identify.status.success(), "{object:#}");
    // The limits: R 2 %, inertia 3 %.
    assert!((value(&object, "r_ohm") / (0.9 * 2.405) - 1.0).abs() < 0.02, "{object:#}");
    assert!((value(&object, "j_kg_m2") / 2.4e-5 - 1.0).abs() < 0.03, "{object:#}");
    let determined = |name: &str| object[name]["determined"] == true;
    for name in ["ke_v_s", "coulomb_n_m", "viscous_n_m_s", "friction_n_m", "delay_ms"] {
        assert!(determined(name), "{name}: {object:#}");
    }
    let page = std::fs::read_to_string(dir.join("page/residuals.html")).expect("written");
    assert_eq!(page.matches("<figure").count(), 2, "bus current and edges");
    assert!(!page.contains("NaN"));
    std::fs::remove_dir_all(dir).expect("removed");
}

/// Each motor that the repository describes, with another resistance and inertia than its file has: what is told is right.
#[test]
fn described_motor_is_identified_or_the_reason_told() {
    let dir = folder("described");
    // Which of R, Ke and J the move tells.
    for (name, told) in [("57blf01", 3), ("ec-45-flat", 2), ("2250-s-024", 2)] {
        let path = format!("{}/../tests/motors/{name}.toml", env!("CARGO_MANIFEST_DIR"));
        let table: toml::Table = std::fs::read_to_string(&path).expect("a file").parse().expect("TOML");
        let figure = |table_name: &str, key: &str| {
            table.get(table_name).and_then(|of| of.get(key)).and_then(toml::Value::as_float).unwrap_or(0.0)
        };
        let excite =
            format!("excite --motor {path} --plant inertia=1.05x --plant resistance=0.95x --out t.csv");
        let excite = sim(&excite, &dir);
        assert!(excite.status.success(), "{name}: {excite:?}");
        let identify = sim(&format!("identify t.csv --motor {path} --json"), &dir);
        let object: Value = serde_json::from_slice(&identify.stdout).expect("one JSON object alone");
        let j_kg_m2 = 1.05 * (figure("motor", "j_kg_m2") + figure("joint", "load_j_kg_m2"));
        let truths = [
            ("r_ohm", 0.95 * figure("motor", "r_ohm"), 0.02),
            ("ke_v_s", figure("motor", "kt_n_m_a"), 0.01),
            ("j_kg_m2", j_kg_m2, 0.03),
        ];
        for (at, (key, truth, most)) in truths.into_iter().enumerate() {
            let error = value(&object, key) / truth - 1.0;
            assert_eq!(object[key]["determined"], at < told, "{name} {key}: {object:#}");
            assert!(at >= told || error.abs() < most, "{name} {key}: {error:+.4}");
        }
        let j = &object["j_kg_m2"];
        let bounds = ["low", "high"].map(|end| j[end].as_f64().expect("a number"));
        assert!((bounds[0]..=bounds[1]).contains(&j_kg_m2), "{name}: {j_kg_m2} is outside {j:#}");
        assert_eq!(object["record"].to_string().contains("data sheet"), told == 2, "{object:#}");
    }
    // What it returns when it brakes raises the voltage of a supply that takes nothing back.
    let hub = format!("{}/../tests/motors/hoverboard-hub.toml", env!("CARGO_MANIFEST_DIR"));
    let excite = sim(&format!("excite --motor {hub} --out u.csv"), &dir);
    assert_eq!(excite.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&excite.stderr).contains("ERROR 4"), "{excite:?}");
    std::fs::remove_dir_all(dir).expect("removed");
}

#[test]
fn motor_that_cannot_make_the_move_is_an_error_without_a_file() {
    let dir = folder("stuck");
    for (line, problem) in [
        ("excite --motor link --plant coulomb_n_m=1 --plant static_n_m=1 --out t.csv", "ERROR"),
        ("excite --motor link --supply volts=5 --out t.csv", "node 1"),
        ("excite --motor link --plant inertia=oops --out t.csv", "inertia"),
        ("excite --motor link --out none/t.csv", "none/t.csv"),
    ] {
        let output = sim(line, &dir);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{line}: {text}");
        assert!(text.contains(problem) && text.contains("next:"), "{line}: {text}");
        assert!(output.stdout.is_empty(), "{line}");
        assert_eq!(std::fs::read_dir(&dir).expect("a folder").count(), 0, "{line}");
    }
    std::fs::remove_dir_all(dir).expect("removed");
}

#[test]
fn bad_recordings_are_refused_and_nothing_is_written() {
    let dir = folder("bad");
    let head = "time_ms,halls_code,bus_v,bus_a,duty_percent,bridge_on,torque_per_1024\n";
    for (name, text, problem) in [
        ("empty.csv", Vec::new(), "a header and rows"),
        ("binary.csv", vec![0xff, 0xfe, 0x00], "no text"),
        ("nan.csv", format!("{head}0,2,nan,0.1,20.0,1,100\n").into_bytes(), "bus_v: no number"),
        ("short.csv", format!("{head}0,2,24.0,0.1,20.0,1,100\n").into_bytes(), "too short"),
        (
            "gap.csv",
            format!("{head}0,2,24,0.1,20,1,100\n50,6,24,0.1,20,1,100\n").into_bytes(),
            "a gap of 50.0 ms",
        ),
    ] {
        std::fs::write(dir.join(name), text).expect("written");
        let output = sim(&format!("identify {name} --json --out page"), &dir);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{name}: {text}");
        assert!(text.contains(problem) && text.contains("next:"), "{name}: {text}");
        assert!(output.stdout.is_empty() && !dir.join("page").exists(), "{name}");
    }
    std::fs::remove_dir_all(dir).expect("removed");
}

#[test]
fn recording_without_a_place_moves_no_motor() {
    let dir = folder("place");
    for out in ["none/trace.csv", "."] {
        let output = sim(&format!("excite --motor link --out {out}"), &dir);
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{out}: {text}");
        assert!(text.contains("cannot be written") && !text.contains("finding the stop"), "{out}: {text}");
    }
    assert_eq!(std::fs::read_dir(&dir).expect("readable").count(), 0);
    std::fs::remove_dir_all(dir).expect("removed");
}

/// A quarter of the inertia makes MKA some 5,850.
#[test]
fn model_of_a_light_motor_is_a_value_of_its_property() {
    let dir = folder("beyond");
    let excite = sim("excite --motor link --plant inertia=0.25x --out t.csv", &dir);
    assert!(excite.status.success(), "{excite:?}");
    let identify = sim("identify t.csv --motor link --json", &dir);
    let object: Value = serde_json::from_slice(&identify.stdout).expect("one JSON object alone");
    assert_eq!(object["j_kg_m2"]["determined"], true, "{object:#}");
    assert_eq!((identify.status.code(), &object["out_of_range"]), (Some(0), &serde_json::json!([])));
    let mka = object["properties"]["MKA"].as_i64().expect("a number");
    assert!((5_500..6_200).contains(&mka), "{object:#}");
    std::fs::remove_dir_all(dir).expect("removed");
}
