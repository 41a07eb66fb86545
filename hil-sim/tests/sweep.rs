//! `hil-sim sweep`, `merge` and `worker`: the same bytes however the runs are spread, and errors that lose nothing.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use traces::parquet::Reader;
use traces::table::Cell;
use traces::table::Source;

fn hil_sim(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hil-sim")).args(args).output().expect("the binary starts")
}

fn ok(args: &[&str]) -> String {
    let output = hil_sim(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// The error of arguments that are refused.
fn bad(args: &[&str]) -> String {
    let output = hil_sim(args);
    let text = String::from_utf8(output.stderr).expect("text");
    assert_eq!(output.status.code(), Some(2), "{args:?}: {text}");
    assert!(output.stdout.is_empty() && text.starts_with("error: ") && text.contains("next:"), "{text}");
    text
}

/// A folder with a short scenario and a sweep of 24 runs over it and a shipped one.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    let scenario = "name = \"short\"\nabout = \"A short move.\"\nmotor = \"tip\"\nduration_ms = 60\n\
                    [[at]]\nms = 5\nmove = 20\n[[expect]]\nmetric = \"sim_s\"\nequals = 0.06\n";
    std::fs::write(folder.join("short.toml"), scenario).expect("ours");
    let sweep = "scenario = \"short.toml\"\nseed = 5\nsamples = 4\nrepeats = 2\n\
                 [grid]\nset.KP = [80, 120]\nplant.friction = [\"0.5x\", \"1x\", \"9x\"]\nplant.stiction = \"1x\"\n\
                 [latin]\nplant.inertia = { from = \"0.5x\", to = \"2x\" }\n";
    std::fs::write(folder.join("sweep.toml"), sweep).expect("ours");
    folder
}

fn path(folder: &Path, name: &str) -> String {
    folder.join(name).to_string_lossy().into_owned()
}

const FILES: [&str; 4] = ["results.csv", "results.parquet", "sweep.json", "report.html"];

fn bytes(folder: &Path, name: &str) -> Vec<Vec<u8>> {
    FILES.map(|file| std::fs::read(folder.join(name).join(file)).expect(file)).into()
}

/// Nine times the friction is above the stiction: those runs are errors, and the exit code is 1.
fn sweep(folder: &Path, out: &str, more: &[&str]) -> Output {
    let (file, out) = (path(folder, "sweep.toml"), path(folder, out));
    let output = hil_sim(&[&["sweep", &file, "--out", &out], more].concat());
    let code = output.status.code();
    assert!(code == Some(1) || code == Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    output
}

#[test]
fn bytes_are_the_same_for_any_jobs_and_shards() {
    let folder = folder("sweep-bytes");
    let first = sweep(&folder, "one", &["--jobs", "1"]);
    assert_eq!(first.status.code(), Some(1));
    let text = String::from_utf8(first.stdout).expect("text");
    assert!(text.starts_with("48 runs: 32 met their expectations, 16 could not be made"), "{text}");
    assert!(text.contains("reproduce at commit ") && text.contains("--out"), "{text}");
    let one = bytes(&folder, "one");
    for jobs in ["2", "3"] {
        sweep(&folder, jobs, &["--jobs", jobs]);
        assert_eq!(bytes(&folder, jobs), one, "{jobs} jobs");
    }
    let shards = ["1/5", "2/5", "3/5", "4/5", "5/5"].map(|shard| {
        let out = format!("shard-{}", &shard[..1]);
        sweep(&folder, &out, &["--shard", shard]);
        path(&folder, &out)
    });
    let mut args: Vec<&str> = vec!["merge"];
    args.extend(shards.iter().rev().map(String::as_str));
    let merged = path(&folder, "merged");
    args.extend(["--out", &merged]);
    assert_eq!(hil_sim(&args).status.code(), Some(1), "runs that could not be made");
    assert_eq!(bytes(&folder, "merged"), one);
}

/// A kill leaves any beginning of the table.
#[test]
fn resume_after_a_cut_anywhere_gives_the_same_bytes() {
    let folder = folder("sweep-resume");
    sweep(&folder, "whole", &[]);
    let whole = bytes(&folder, "whole");
    let mut rng = Pcg64Mcg::new(1);
    let random = (0..12).map(|_| rng.random_range(0..whole[0].len()));
    let cuts: Vec<usize> = [0, 1, whole[0].len() - 1, whole[0].len()].into_iter().chain(random).collect();
    let cut = folder.join("cut");
    for at in cuts {
        std::fs::write(cut_table(&cut, &whole), &whole[0][..at]).expect("ours");
        sweep(&folder, "cut", &["--resume"]);
        assert_eq!(bytes(&folder, "cut"), whole, "cut at byte {at}");
    }
    // Bytes that a crash of the system has left behind a whole line.
    let end = 1 + whole[0][..whole[0].len() / 2].iter().rposition(|byte| *byte == b'\n').expect("lines");
    let mut torn = whole[0][..end].to_vec();
    torn.extend_from_slice(b"\0\0\0\n17,1,,\n");
    std::fs::write(cut_table(&cut, &whole), torn).expect("ours");
    sweep(&folder, "cut", &["--resume"]);
    assert_eq!(bytes(&folder, "cut"), whole);
    // A cell that is no number: from there on the runs are made again.
    let text = String::from_utf8(whole[0].clone()).expect("text");
    let line = text.lines().nth(2).expect("a run");
    let (before, _) = line.rsplit_once(',').expect("cells");
    let text = text.replace(line, &format!("{before},x"));
    std::fs::write(cut_table(&cut, &whole), text).expect("ours");
    sweep(&folder, "cut", &["--resume"]);
    assert_eq!(bytes(&folder, "cut"), whole);
}

/// The path of the table in a folder that is as a sweep leaves it before its first line.
fn cut_table(folder: &Path, whole: &[Vec<u8>]) -> PathBuf {
    let _ = std::fs::remove_dir_all(folder);
    std::fs::create_dir_all(folder).expect("ours");
    std::fs::write(folder.join("sweep.json"), &whole[2]).expect("ours");
    folder.join("results.csv")
}

#[test]
fn report_has_charts_worst_runs_and_the_line_of_each() {
    let folder = folder("sweep-report");
    sweep(&folder, "out", &[]);
    let page = String::from_utf8(bytes(&folder, "out")[3].clone()).expect("text");
    let (_, data) = page.split_once("id=\"data\">").expect("numbers");
    let data: serde_json::Value =
        serde_json::from_str(data.split_once("</script>").expect("an end").0).expect("JSON");
    let fields = data["charts"][0]["explore"]["fields"].as_array().expect("columns to choose from");
    let column = |name: &str| {
        let field = fields.iter().find(|field| field["name"] == name).unwrap_or_else(|| panic!("{name}"));
        data["columns"][field["column"].as_u64().expect("a place") as usize]["values"]
            .as_array()
            .expect("numbers")
    };
    // 16 of the 48 runs could not be made.
    assert_eq!((column("set.KP").len(), column("iae").len()), (32, 32));
    assert!(fields.iter().all(|field| field["name"] != "sim_s"), "what does not vary is left out");
    let (_, worst) = page.split_once("<summary>iae: up to").expect("the worst runs of a metric");
    let line = worst.split_once("<code>").and_then(|(_, rest)| rest.split_once("</code>")).expect("a line").0;
    let args: Vec<&str> = line.strip_prefix("hil-sim ").expect("this program").split(' ').collect();
    let mut run = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    let again = run.args(&args).arg("--json").current_dir(&folder).output().expect("the binary starts");
    let again: serde_json::Value = serde_json::from_slice(&again.stdout).expect("JSON");
    let largest = column("iae").iter().filter_map(serde_json::Value::as_f64).fold(0.0, f64::max);
    // The page has seven digits.
    assert!((again["iae"].as_f64().expect("a number") / largest - 1.0).abs() < 1e-6, "{line}");
    assert!(page.contains("could not be made: ") && page.contains("<h2>sweep.toml</h2>"));
}

#[test]
fn table_has_every_metric_with_its_unit_and_a_row_runs_alone() {
    let folder = folder("sweep-table");
    sweep(&folder, "out", &[]);
    let csv = String::from_utf8(bytes(&folder, "out")[0].clone()).expect("text");
    let head: Vec<&str> = csv.lines().next().expect("a head").split(',').collect();
    let reader = Reader::new(bytes(&folder, "out")[1].clone()).expect("a Parquet file");
    let columns = &reader.heading().columns;
    assert_eq!(columns.iter().map(|column| column.name.as_str()).collect::<Vec<_>>(), head);
    let unit =
        |name: &str| columns.iter().find(|column| column.name == name).map(|column| column.unit.as_str());
    assert_eq!(unit("plant.j_kg_m2.x"), Some("x"));
    for metric in &hil_experiment::metrics::METRICS {
        assert_eq!(unit(metric.name), Some(metric.unit()), "{}", metric.name);
    }
    assert_eq!(
        reader.heading().fact("file"),
        std::fs::read_to_string(folder.join("sweep.toml")).ok().as_deref()
    );
    let mut rows = Vec::new();
    reader
        .rows(&mut |row| {
            rows.push(row.to_vec());
            Ok(())
        })
        .expect("whole");
    assert_eq!(rows.len(), 48);
    let at = |name: &str| head.iter().position(|column| *column == name).expect("a column");
    assert_eq!(rows[7][at("index")], Cell::Int(7));
    assert_eq!(rows[7][at("seed")], Cell::Int(12));
    assert!(
        matches!(&rows[40][at("error")], Cell::Text(text) if text.contains("static_n_m")),
        "{:?}",
        rows[40]
    );
    assert_eq!(rows[40][at("end_ms")], Cell::Absent);

    let line = ok(&["sweep", &path(&folder, "sweep.toml"), "--row", "7"]);
    let words: Vec<&str> = line.split_whitespace().collect();
    assert_eq!(words[..2], ["hil-sim", "run"]);
    let json = ok(&[&words[1..], &["--json"]].concat());
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    for metric in hil_experiment::metrics::METRICS.iter().filter(|metric| !metric.is_word()) {
        let found = match rows[7][at(metric.name)] {
            Cell::Float(value) => Some(value),
            _ => None,
        };
        assert_eq!(found, json[metric.name].as_f64(), "{}", metric.name);
    }
}

/// Its description is part of the sweep: a change of the file is another sweep, and a row alone runs with it.
#[test]
fn described_motor_takes_the_place_of_the_scenarios() {
    let folder = folder("sweep-motor");
    let shipped = format!("{}/../tests/motors/ec-45-flat.toml", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(shipped).expect("a file");
    std::fs::write(folder.join("motor.toml"), &text).expect("ours");
    let motor = path(&folder, "motor.toml");
    sweep(&folder, "out", &["--motor", &motor]);
    let csv = String::from_utf8(bytes(&folder, "out")[0].clone()).expect("text");
    let mut rows = csv.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let (head, row) = (rows.next().expect("a head"), rows.nth(7).expect("row 7"));
    let file = path(&folder, "sweep.toml");
    let line = ok(&["sweep", &file, "--motor", &motor, "--row", "7"]);
    assert!(line.contains(&format!(" --motor {motor} ")), "{line}");
    let words: Vec<&str> = line.split_whitespace().collect();
    let json: serde_json::Value =
        serde_json::from_str(&ok(&[&words[1..], &["--json"]].concat())).expect("JSON");
    let mut compared = 0;
    for metric in hil_experiment::metrics::METRICS.iter().filter(|metric| !metric.is_word()) {
        let at = head.iter().position(|column| *column == metric.name).expect("a column");
        assert_eq!(row[at].parse().ok(), json[metric.name].as_f64(), "{}", metric.name);
        compared += u32::from(!row[at].is_empty());
    }
    assert!(compared > 10, "{compared} metrics");
    let digest = |more: &[&str]| {
        let json = ok(&[&["sweep", &file, "--dry-run", "--json"], more].concat());
        serde_json::from_str::<serde_json::Value>(&json).expect("JSON")["sweep"].clone()
    };
    let before = digest(&["--motor", &motor]);
    std::fs::write(&motor, format!("{text}# changed\n")).expect("ours");
    assert!(before != digest(&["--motor", &motor]) && before != digest(&[]));
    assert!(bad(&["sweep", &file, "--motor", &file, "--dry-run"]).contains("sweep.toml"));
}

#[test]
fn bad_arguments_are_refused_and_keep_what_is_there() {
    let folder = folder("sweep-bad");
    let file = path(&folder, "sweep.toml");
    sweep(&folder, "out", &[]);
    let whole = bytes(&folder, "out");
    let out = path(&folder, "out");
    assert!(bad(&["sweep", &file, "--out", &out]).contains("continue it with --resume"));
    assert!(bad(&["sweep", &file, "--out", &out, "--resume", "--shard", "1/2"]).contains("another shard"));
    let other = folder.join("other.toml");
    let text = std::fs::read_to_string(&file).expect("ours").replace("seed = 5", "seed = 6");
    std::fs::write(&other, text).expect("ours");
    let other = other.to_string_lossy().into_owned();
    assert!(bad(&["sweep", &other, "--out", &out, "--resume"]).contains("another sweep"));
    assert_eq!(bytes(&folder, "out"), whole);
    // Files of somebody else.
    let own = folder.join("own");
    std::fs::create_dir_all(&own).expect("ours");
    std::fs::write(own.join("thesis.txt"), "x").expect("ours");
    let own_path = path(&folder, "own");
    for more in [&[][..], &["--resume"]] {
        let args = [&["sweep", &file, "--out", &own_path], more].concat();
        assert!(bad(&args).contains("is not empty"), "{more:?}");
    }
    assert_eq!(std::fs::read_dir(&own).expect("ours").count(), 1);
    assert!(bad(&["sweep", &path(&folder, "none.toml"), "--out", "x"]).contains("cannot be read"));
    for shard in ["0/2", "3/2", "1", "a/b"] {
        let output = hil_sim(&["sweep", &file, "--out", "x", "--shard", shard]);
        assert_eq!(output.status.code(), Some(2), "{shard}");
    }
    assert!(bad(&["sweep", &file, "--row", "48"]).contains("0 to 47"));
}

/// A table of 10^15 runs is larger than any disk.
#[test]
#[cfg(unix)]
fn sweep_larger_than_the_free_disk_is_refused_before_it_begins() {
    let folder = folder("sweep-disk");
    let file = folder.join("huge.toml");
    let text =
        "scenario = 'tip-fast'\nsamples = 1000000000000000\n[random]\nset.KP = { from = 1, to = 200 }\n";
    std::fs::write(&file, text).expect("ours");
    let out = path(&folder, "out");
    let error = bad(&["sweep", &file.to_string_lossy(), "--out", &out]);
    assert!(error.contains("may not fit on the disk") && error.contains("--shard"), "{error}");
    assert!(!Path::new(&out).exists());
    let dry = ok(&["sweep", &file.to_string_lossy(), "--dry-run"]);
    assert!(dry.starts_with("1000000000000000 runs, at most "), "{dry}");
}

#[test]
fn merge_refuses_shards_that_are_missing_twice_incomplete_or_of_another_sweep() {
    let folder = folder("merge-bad");
    for shard in ["1/3", "2/3", "3/3"] {
        sweep(&folder, &shard[..1], &["--shard", shard]);
    }
    sweep(&folder, "half", &["--shard", "1/2"]);
    let text = std::fs::read_to_string(folder.join("sweep.toml")).expect("ours");
    std::fs::write(folder.join("sweep.toml"), text.replace("seed = 5", "seed = 6")).expect("ours");
    sweep(&folder, "other", &["--shard", "2/3"]);
    let out = path(&folder, "out");
    let merge = |names: &[&str]| {
        let folders: Vec<String> = names.iter().map(|name| path(&folder, name)).collect();
        let mut args = vec!["merge"];
        args.extend(folders.iter().map(String::as_str));
        args.extend(["--out", &out]);
        bad(&args)
    };
    assert!(merge(&["1", "3"]).contains("shard 2/3 is missing"));
    assert!(merge(&["1", "2"]).contains("shard 3/3 is missing"));
    assert!(merge(&["1", "2", "2", "3"]).contains("is given twice"));
    assert!(merge(&["1", "2", "3", "3"]).contains("is given twice"));
    assert!(merge(&["1", "other", "3"]).contains("another sweep"));
    assert!(merge(&["half", "2", "3"]).contains("another division"));
    assert!(merge(&["1", "nowhere", "3"]).contains("has no results"));
    let table = folder.join("2/results.csv");
    let bytes = std::fs::read(&table).expect("ours");
    std::fs::write(&table, &bytes[..bytes.len() - 3]).expect("ours");
    let error = merge(&["1", "2", "3"]);
    assert!(error.contains("shard 2/3 is not complete") && error.contains("--resume"), "{error}");
    assert!(!Path::new(&out).exists(), "no half-written table");
}

#[test]
fn worker_answers_each_line_in_order_and_survives_bad_ones() {
    let toml = "name = 'x'\nabout = 'y'\nmotor = 'tip'\nduration_ms = 20";
    let jobs = [
        r#"{"id": "a", "scenario": "tip-fast", "set": {"KP": 120}, "plant": {"inertia": "1.2x"}, "seed": 3}"#
            .to_owned(),
        "no JSON".to_owned(),
        serde_json::json!({"id": 7, "toml": toml, "supply": ["volts=22"], "model": "switched"}).to_string(),
        r#"{"id": [1], "scenario": "tip-fats"}"#.to_owned(),
        r#"{"id": 2, "scenario": "tip-fast", "sed": 3}"#.to_owned(),
        r#"{"id": 3, "scenario": "tip-fast", "set": {"KP": 1e9}}"#.to_owned(),
        String::new(),
        r#"[null, "tip-fast", null, [], [], [], [], 1, "averaged"]"#.to_owned(),
        r#"{"id": "a", "scenario": "tip-fast", "set": {"KP": 120}, "plant": {"inertia": "1.2x"}, "seed": 3}"#
            .to_owned(),
    ];
    let mut child = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .arg("worker")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    let mut input = child.stdin.take().expect("piped");
    // The last line has no end.
    input.write_all(jobs.join("\n").as_bytes()).expect("a reader");
    input.write_all(b"\n\xFF\xFE").expect("a reader");
    drop(input);
    let output = child.wait_with_output().expect("ends with its input");
    assert_eq!(output.status.code(), Some(0));
    let text = String::from_utf8(output.stdout).expect("text");
    let answers: Vec<serde_json::Value> =
        text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let ids: Vec<String> = answers.iter().map(|answer| answer["id"].to_string()).collect();
    assert_eq!(ids, ["\"a\"", "null", "7", "[1]", "2", "3", "null", "\"a\"", "null"]);
    let oks: Vec<bool> = answers.iter().filter_map(|answer| answer["ok"].as_bool()).collect();
    assert_eq!(oks, [true, false, true, false, false, false, false, true, false]);
    assert_eq!(answers[0], answers[7], "equal jobs, equal bytes");
    assert_eq!(answers[2]["result"]["model"], "switched");
    let message = |n: usize| answers[n]["error"]["message"].as_str().unwrap_or("").to_owned();
    assert!(message(1).starts_with("standard input:2"), "{}", message(1));
    assert!(message(3).contains("did you mean tip-fast?"), "{}", message(3));
    assert!(
        message(4).contains("sed") && message(5).contains("whole number"),
        "{}{}",
        message(4),
        message(5)
    );
    let run = ok(&["run", "tip-fast", "--set", "KP=120", "--plant", "inertia=1.2x", "--seed", "3", "--json"]);
    let mut run: serde_json::Value = serde_json::from_str(&run).expect("JSON");
    run.as_object_mut().expect("an object").remove("wall_s");
    assert_eq!(answers[0]["result"], run);
}

/// The example of docs/sweep.md, a part of it.
#[test]
fn documented_example_runs() {
    let page = std::fs::read_to_string("../docs/sweep.md").expect("the page");
    let example =
        page.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).expect("an example");
    let folder = folder("sweep-example");
    std::fs::write(folder.join("gains.toml"), example).expect("ours");
    let file = path(&folder, "gains.toml");
    let dry = ok(&["sweep", &file, "--dry-run"]);
    assert!(dry.starts_with("7200 runs, "), "{dry}");
    let json = ok(&["sweep", &file, "--out", &path(&folder, "out"), "--shard", "1/300", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&json).expect("one JSON object");
    assert_eq!((&json["runs"], &json["errors"]), (&24.into(), &0.into()));
}
