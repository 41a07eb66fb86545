//! `hil-sim log` with a board of `hil-sim bus`.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use crate::served::{damaging, serve};

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

fn hil_sim(folder: &Path, args: &[&str]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    let Output { status, stderr, .. } =
        command.args(args).current_dir(folder).output().expect("the binary starts");
    (status.code(), String::from_utf8(stderr).expect("text"))
}

#[test]
fn board_is_recorded_with_its_gains_in_every_format() {
    let folder = folder("log");
    let served = serve("4");
    for file in ["log.csv", "log.mcap", "log.parquet"] {
        let args = ["log", "--slcan", &served.address, "--node", "4", "--seconds", "0.3", "--out", file];
        let (code, errors) = hil_sim(&folder, &args);
        assert_eq!(code, Some(0), "{errors}");
        let (code, errors) = hil_sim(&folder, &["convert", file, "read.csv"]);
        assert_eq!(code, Some(0), "{errors}");
        let csv = std::fs::read_to_string(folder.join("read.csv")).expect("text");
        for fact in ["# node=4", "# KP=120", "# ROLE=2051", "# VERS=600", "# MKA="] {
            assert!(csv.lines().any(|line| line.starts_with(fact)), "no {fact} in {file}");
        }
        let rows: Vec<&str> = csv.lines().skip_while(|line| line.starts_with('#')).collect();
        assert!(rows[0].starts_with("time_ms,mode,position_estimated_counts,"), "{}", rows[0]);
        // A slow machine gives few rows, but a board that answers gives one.
        let row: Vec<&str> = rows.get(1).expect("a row").split(',').collect();
        let names: Vec<&str> = rows[0].split(',').collect();
        let value = |name: &str| row[names.iter().position(|other| *other == name).expect("a column")];
        assert_eq!((value("time_ms").split('.').count(), value("mode"), value("ERROR")), (2, "0", "0"));
        let volts: f64 = value("bus_v").parse().expect("a number");
        assert!((20.0..=26.0).contains(&volts), "the source has 24 V: {volts}");
    }
}

#[test]
fn silent_board_and_missing_adapter_are_named() {
    let folder = folder("log-silent");
    let served = serve("4");
    let log = |address: &str, node: &str| {
        let args = ["log", "--slcan", address, "--node", node, "--out", "log.csv"];
        let (code, errors) = hil_sim(&folder, &args);
        assert_eq!(code, Some(2), "{errors}");
        assert!(!folder.join("log.csv").exists());
        errors
    };
    let errors = log(&served.address, "5");
    assert!(errors.contains("node 5 is silent") && errors.contains("no answer"), "{errors}");
    let address = served.address.clone();
    drop(served);
    let errors = log(&address, "4");
    assert!(errors.contains(&format!("--slcan {address}")), "{errors}");
}

#[cfg(unix)]
#[test]
fn interrupted_log_keeps_its_file() {
    for signal in ["-INT", "-TERM"] {
        keeps_its_file(signal);
    }
}

#[cfg(unix)]
fn keeps_its_file(signal: &str) {
    let folder = folder("log-interrupted");
    let served = serve("4");
    let mut process = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .args(["log", "--slcan", &served.address, "--node", "4", "--out", "log.csv"])
        .current_dir(&folder)
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    let mut lines = BufReader::new(process.stderr.take().expect("piped")).lines().map_while(Result::ok);
    assert!(lines.any(|line| line == "recording node 4; ^C ends it and keeps the file"));
    let killed = Command::new("kill").args([signal, &process.id().to_string()]).status().expect("kill");
    assert!(killed.success());
    let last = lines.last().unwrap_or_default();
    assert_eq!(process.wait().expect("it ends").code(), Some(130), "{last}");
    let csv = std::fs::read_to_string(folder.join("log.csv")).expect("kept");
    let rows = csv.lines().filter(|line| !line.starts_with('#')).count() - 1;
    assert_eq!(last, format!("log.csv: {rows} rows of node 4"));
}

/// Rows of a file that is being written: lines after the header, the last of which may be a part.
fn rows(csv: &Path) -> usize {
    let text = std::fs::read_to_string(csv).unwrap_or_default();
    text.lines().filter(|line| !line.starts_with('#')).count().saturating_sub(1)
}

#[cfg(unix)]
#[test]
fn killed_log_keeps_whole_rows() {
    let folder = folder("log-killed");
    let served = serve("4");
    for name in ["log.csv", "log.mcap"] {
        let file = folder.join(name);
        let mut process = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .args(["log", "--slcan", &served.address, "--node", "4", "--out", name])
            .current_dir(&folder)
            .stderr(Stdio::null())
            .spawn()
            .expect("the binary starts");
        // It grows twice after its heading: the rows of two seconds.
        let size = || std::fs::metadata(&file).map_or(0, |data| data.len());
        let mut seen = 0;
        for _ in 0..3 {
            while size() == seen {
                assert_eq!(process.try_wait().expect("ours"), None, "it goes on");
                std::thread::yield_now();
            }
            seen = size();
        }
        process.kill().expect("ours");
        process.wait().expect("ours");
        let (code, errors) = hil_sim(&folder, &["convert", name, "read.csv"]);
        assert_eq!(code, Some(0), "{name}: {errors}");
        assert!(rows(&folder.join("read.csv")) > 10, "{name}");
    }
    // A kill may also cut a write, between two pages of the file.
    let whole = std::fs::read_to_string(folder.join("read.csv")).expect("text");
    std::fs::write(folder.join("cut.csv"), &whole[..whole.len() - 3]).expect("ours");
    let (code, errors) = hil_sim(&folder, &["convert", "cut.csv", "read.csv"]);
    assert_eq!(code, Some(0), "{errors}");
    let read = std::fs::read_to_string(folder.join("read.csv")).expect("text");
    assert_eq!(read, whole[..=whole[..whole.len() - 1].rfind('\n').expect("many rows")]);
}

#[test]
fn rows_with_damaged_answers_are_marked_and_counted() {
    let folder = folder("log-damaged");
    let served = serve("4");
    let address = damaging(&served.address);
    let args = ["log", "--slcan", &address, "--node", "4", "--seconds", "1.5", "--out", "log.csv"];
    let (code, errors) = hil_sim(&folder, &args);
    assert_eq!(code, Some(0), "{errors}");
    let csv = std::fs::read_to_string(folder.join("log.csv")).expect("text");
    assert!(csv.lines().any(|line| line == "# KP=120"), "no damaged fact: {csv}");
    let mut lines = csv.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().expect("a header").split(',').collect();
    assert_eq!(names.last(), Some(&"untrusted"));
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    let marked = rows.iter().filter(|row| row.last() != Some(&"0")).count();
    assert!(marked > 0, "each third row has one: {csv}");
    for row in &rows {
        let absent = row.iter().filter(|cell| cell.is_empty()).count();
        assert!(absent == 0 || row.last() != Some(&"0"), "{row:?}");
    }
    assert!(
        errors.contains(&format!("warning: {marked} of {} rows could not be trusted", rows.len())),
        "{errors}"
    );
}

#[test]
fn parquet_says_that_a_kill_loses_it() {
    let folder = folder("log-parquet");
    let served = serve("4");
    let args = ["log", "--slcan", &served.address, "--node", "4", "--seconds", "0.2", "--out", "log.parquet"];
    let (code, errors) = hil_sim(&folder, &args);
    assert_eq!(code, Some(0), "{errors}");
    assert!(
        errors.contains("a kill loses log.parquet") && errors.contains("record .csv or .mcap"),
        "{errors}"
    );
}
