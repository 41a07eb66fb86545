//! The binary for a person or a program: output, files and exit codes.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn hil_sim(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_hil-sim")).args(args).output().expect("the binary starts")
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).expect("text")
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).expect("text")
}

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

fn scenario(folder: &Path, expect: &str) -> String {
    let path = folder.join("x.toml");
    let head = "name = \"x\"\nabout = \"y\"\nmotor = \"link\"\nduration_ms = 20\n";
    std::fs::write(&path, format!("{head}[[expect]]\nmetric = \"sim_s\"\n{expect}\n"))
        .expect("a file for the test");
    path.to_string_lossy().into_owned()
}

#[test]
fn json_prints_one_object_with_the_documented_keys() {
    let output = hil_sim(&["run", "spread-full-travel", "--json", "--seed", "7", "--model", "switched"]);
    let text = stdout(&output);
    let json: serde_json::Value = serde_json::from_str(&text).expect("one JSON object and nothing else");
    let object = json.as_object().expect("an object");
    let mut keys: Vec<&str> = object.keys().map(String::as_str).collect();
    // Every metric, and what is said of the run.
    let metrics = hil_experiment::metrics::METRICS.iter().map(|metric| metric.name);
    let mut promised: Vec<&str> =
        metrics.chain(["scenario", "seed", "model", "wall_s", "expectations"]).collect();
    keys.sort_unstable();
    promised.sort_unstable();
    assert_eq!(keys, promised);
    assert_eq!((&json["seed"], &json["model"]), (&7.into(), &"switched".into()));
    let verdict = json["expectations"][0].as_object().expect("an object");
    let keys: Vec<&str> = verdict.keys().map(String::as_str).collect();
    for key in ["name", "ok", "value", "want"] {
        assert!(keys.contains(&key), "{key} in {keys:?}");
    }
    assert_eq!(keys.len(), 4);
}

#[test]
fn exit_codes_distinguish_met_unmet_and_bad_input() {
    let folder = folder("exit-codes");
    let met = hil_sim(&["run", &scenario(&folder, "equals = 0.02")]);
    assert_eq!(met.status.code(), Some(0), "{}", stderr(&met));
    assert!(stdout(&met).contains("sim_s = 0.020, want 0.02"), "{}", stdout(&met));
    let unmet = hil_sim(&["run", &scenario(&folder, "min = 1")]);
    assert_eq!(unmet.status.code(), Some(1));
    assert!(stdout(&unmet).contains("FAILED"), "{}", stdout(&unmet));
    let path = scenario(&folder, "mn = 1");
    let bad = hil_sim(&["run", &path, "--json"]);
    assert_eq!(bad.status.code(), Some(2));
    assert_eq!(stdout(&bad), "");
    for word in [&format!("error: {path}:7"), "mn", "found:", "expected:", "next:"] {
        assert!(stderr(&bad).contains(word), "no {word} in {}", stderr(&bad));
    }
    for args in [
        &["run", "no-such-scenario"][..],
        &["run", "link-fast", "--set", "KP=many"],
        &["run", "link-fast", "--set", "KQ=1"],
        &["run", "link-fast", "--model", "exact"],
        &["run", "link-fast", "--seed", "-1"],
        &["run", "link-fast", "--out", "/dev/null/x"],
        &["run"],
        &["fly"],
    ] {
        let output = hil_sim(args);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {}", stderr(&output));
        assert!(stderr(&output).starts_with("error: ") || stderr(&output).contains("Usage"), "{args:?}");
    }
}

#[test]
fn out_writes_its_files_and_no_others() {
    let folder = folder("files");
    let out = folder.join("deep/report");
    let out_text = out.to_string_lossy().into_owned();
    let path = scenario(&folder, "min = 0");
    for kp in ["kp=1", "kp=2"] {
        // A second run replaces the files of the first.
        let output = hil_sim(&["run", &path, "--out", &out_text, "--set", kp]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    }
    let entries = std::fs::read_dir(&out).expect("the folder is made");
    let mut names: Vec<_> = entries.map(|entry| entry.expect("an entry").file_name()).collect();
    names.sort();
    assert_eq!(names, ["report.html", "run.json", "trace.csv"]);
    let csv = std::fs::read_to_string(out.join("trace.csv")).expect("text");
    assert_eq!(csv.lines().count(), 1 + 21, "a header, the start and 20 ticks");
    assert!(csv.starts_with("time_ms,mode,position_counts,"));

    let html = std::fs::read_to_string(out.join("report.html")).expect("text");
    assert!(
        html.contains(&format!("hil-sim run {path} --set KP=2 --seed 1 --model averaged")),
        "how to run it again"
    );

    let empty = self::folder("no-files");
    let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .args(["run", &path, "--set", "KP=120"])
        .current_dir(&empty)
        .output()
        .expect("the binary starts");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(std::fs::read_dir(&empty).expect("the folder").count(), 0);
}

/// A limit on the size of files acts as a full disk, for root too: the trace fits, and the report does not.
#[cfg(unix)]
#[test]
fn report_that_does_not_fit_leaves_trace_and_report_of_the_last_run() {
    let folder = folder("no-room-for-the-report");
    let (path, out) = (scenario(&folder, "min = 0"), folder.join("out"));
    // Another seed has another noise in the trace.
    let run = |limit: &str, seed: u8| {
        let line = format!("trap '' XFSZ; {limit} exec \"$0\" run \"$1\" --out \"$2\" --seed {seed}");
        let mut shell = Command::new("sh");
        shell.args(["-c", &line, env!("CARGO_BIN_EXE_hil-sim"), &path]).arg(&out).output().expect("a shell")
    };
    let files =
        || ["trace.csv", "report.html"].map(|name| std::fs::read(out.join(name)).expect("it is there"));
    assert_eq!(run("", 1).status.code(), Some(0));
    let before = files();
    // In units of 512 bytes, or 1024 in some shells.
    let units = before[0].len() / 512 + 1;
    assert!(before[1].len() > 1024 * units, "the report is the longer one: {} bytes", before[1].len());
    let full = run(&format!("ulimit -f {units};"), 2);
    assert_eq!(full.status.code(), Some(2), "{}", stderr(&full));
    assert!(stderr(&full).contains("report.html cannot be written"), "{}", stderr(&full));
    assert!(files() == before);
    assert_eq!(std::fs::read_dir(&out).expect("the folder").count(), 3, "no part is left");
}

/// Types lines at `hil-sim gcl`.
fn gcl(args: &[&str], input: &[u8]) -> Output {
    use std::io::Write;
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    command.arg("gcl").args(args).stdin(std::process::Stdio::piped());
    command.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    let mut process = command.spawn().expect("the binary starts");
    // It may end before it has read everything.
    let _ = process.stdin.take().expect("piped").write_all(input);
    process.wait_with_output().expect("it ends")
}

#[test]
fn gcl_answers_each_command_of_a_line() {
    for input in [&b"VERS\nFROB\nPGET LFT"[..], b"VERS\rFROB\rPGET LFT\r", b"VERS\r\nFROB\r\nPGET LFT\r\n"] {
        let output = gcl(&["--json"], input);
        let json: serde_json::Value = serde_json::from_str(&stdout(&output)).expect("one JSON object");
        let lines = json["lines"].as_array().expect("lines");
        let said: Vec<(&str, &str)> = lines
            .iter()
            .map(|line| (line["line"].as_str().expect("text"), line["answer"].as_str().expect("text")))
            .collect();
        assert_eq!(said.len(), 3, "{said:?}");
        assert_eq!(said[..2], [("VERS", "600"), ("FROB", "ERR 32")]);
        assert_eq!(output.status.code(), Some(1));
    }
}

/// As `printf 'HI\nLOOP\nVERS\nBOGUS\n' | hil-sim gcl`.
#[test]
fn gcl_keeps_step_after_loop() {
    let output = gcl(&[], b"HI\nLOOP\nVERS\nBOGUS\n");
    assert!(
        stdout(&output).ends_with("=> HI\n=> LOOP\n*\n=> VERS\n600\n=> BOGUS\nERR 32\n"),
        "{}",
        stdout(&output)
    );
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn gcl_refuses_bytes_that_the_hand_would_drop() {
    for (input, found) in [
        (&b"\xEF\xBB\xBFVERS\n"[..], "byte 0xEF in column 1, of a byte order mark"),
        (b"VERS\0\n", "byte 0x00 in column 5"),
        ("FS\u{e9}T\n".as_bytes(), "byte 0xC3 in column 3"),
        (b"VERS\x1b[A\n", "byte 0x1B in column 5"),
        (b"VERS\xFF\n", "bytes that are not UTF-8"),
    ] {
        let output = gcl(&[], input);
        assert_eq!(output.status.code(), Some(2), "{}", stdout(&output));
        let error = stderr(&output);
        for word in ["error: standard input:1: ", found, "\n  expected: ", "\n  next: "] {
            assert!(error.contains(word), "{error}");
        }
    }
    // In a comment they do no harm; tab and backspace are keys.
    assert_eq!(gcl(&[], "# \u{e9}\nVERSX\x08\n\tVERS\n".as_bytes()).status.code(), Some(0));
}

#[test]
fn list_names_every_shipped_scenario() {
    let text = stdout(&hil_sim(&["list"]));
    for shipped in hil_experiment::scenario::SHIPPED {
        assert!(text.lines().any(|line| line.starts_with(&format!("{} ", shipped.name))), "{}", shipped.name);
    }
}

#[test]
fn hall_capture_gives_one_line_per_sample() {
    let folder = folder("replay");
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    // Two revolutions of 6 codes at 100 samples each: 300 counts/s at 30 kHz.
    let codes = [1u8, 3, 2, 6, 4, 5].repeat(2).into_iter().flat_map(|code| [code; 100]);
    let mut capture: Vec<u8> = codes.flat_map(|code| [0x5a, code, 0]).collect();
    // A sample that is cut off does not count.
    capture.push(0x5a);
    std::fs::write(path("x.dat"), &capture).expect("a file for the test");
    let replay = |capture: &str, csv: &str, rev: &str| {
        hil_sim(&["replay-halls", capture, "--counts-per-rev", rev, "--rate-hz", "30000", "--csv", csv])
    };
    let output = replay(&path("x.dat"), &path("x.csv"), "18");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let csv = std::fs::read_to_string(path("x.csv")).expect("text");
    let rows: Vec<Vec<f64>> =
        csv.lines().map(|line| line.split(',').map(|n| n.parse().expect("a number")).collect()).collect();
    assert_eq!((rows.len(), rows.iter().all(|row| row.len() == 2)), (1200, true));
    let (first, last) = (&rows[0], &rows[1199]);
    assert!((last[0] - first[0]).abs() > 10.0, "{} to {} counts", first[0], last[0]);
    assert!(!folder.join("x.part").exists());

    assert_eq!(stderr(&output), "");

    capture[1500] = 0;
    std::fs::write(path("dirty.dat"), &capture).expect("a file for the test");
    let output = replay(&path("dirty.dat"), &path("dirty.csv"), "18");
    assert_eq!((output.status.code(), stdout(&output).as_str()), (Some(0), ""));
    assert!(stderr(&output).contains("1 of 1200 samples do not begin with 0x5A"), "{}", stderr(&output));
    assert_eq!(std::fs::read_to_string(path("dirty.csv")).expect("text"), csv);

    let large = std::fs::File::create(path("large.dat")).expect("a file for the test");
    large.set_len((64 << 20) + 1).expect("a file for the test");
    std::fs::write(path("text.dat"), "no capture").expect("a file for the test");
    for (capture, csv, rev) in [
        (path("missing.dat"), path("y.csv"), "18"),
        (path("text.dat"), path("y.csv"), "18"),
        (path("large.dat"), path("y.csv"), "18"),
        (path("."), path("y.csv"), "18"),
        ("/dev/zero".to_owned(), path("y.csv"), "18"),
        (path("x.dat"), path("y.csv"), "17"),
        (path("x.dat"), path("no/folder/y.csv"), "18"),
    ] {
        let output = replay(&capture, &csv, rev);
        assert_eq!(output.status.code(), Some(2), "{capture} {csv}: {}", stderr(&output));
        for word in ["error: ", "\n  found: ", "\n  expected: ", "\n  next: "] {
            assert!(stderr(&output).contains(word), "{}", stderr(&output));
        }
    }
    for device in ["/dev/zero", "/"] {
        let output = replay(device, &path("y.csv"), "18");
        assert!(stderr(&output).contains("this is not a file"), "{}", stderr(&output));
    }
    assert!(!folder.join("y.csv").exists(), "no file for bad input");
}

/// Each is a line on standard error; the estimate is written.
#[test]
fn doubtful_hall_capture_gives_warnings() {
    let folder = folder("doubtful");
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    // 25,000 counts/s at 1 MHz.
    let mut capture: Vec<u8> = (0..9000).flat_map(|i| [0x5a, [1u8, 3, 2, 6, 4, 5][i / 40 % 6], 0]).collect();
    capture.remove(2000);
    capture[3000] = 7;
    std::fs::write(path("x.dat"), capture).expect("a file for the test");
    let output = hil_sim(&["replay-halls", &path("x.dat"), "--rate-hz", "1000000", "--csv", &path("x.csv")]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let errors = stderr(&output);
    let lines: Vec<&str> = errors.lines().collect();
    assert_eq!(lines.len(), 3, "{errors}");
    assert!(lines[0].contains("2 bytes that belong to no sample were dropped, the first at byte 1998"));
    assert!(lines[1].contains("1 of 8999 samples have the impossible code 0 or 7"), "{errors}");
    assert!(lines[2].contains("velocities are at the estimator's limit of 16384 counts/s"), "{errors}");
}

/// A recording may exist only once.
#[cfg(unix)]
#[test]
fn recording_is_not_overwritten_by_its_estimate() {
    let folder = folder("recording");
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let capture = [0x5a, 1, 0].repeat(100);
    std::fs::create_dir(path("deep")).expect("a folder");
    std::fs::write(path("x.dat"), &capture).expect("a file for the test");
    std::os::unix::fs::symlink("x.dat", path("link")).expect("a link");
    std::fs::hard_link(path("x.dat"), path("twin")).expect("a link");
    for (capture, csv) in [
        ("x.dat", "x.dat"),
        ("x.dat", "deep/../x.dat"),
        ("x.dat", "link"),
        ("link", "x.dat"),
        ("x.dat", "twin"),
    ] {
        let output = hil_sim(&["replay-halls", &path(capture), "--csv", &path(csv)]);
        assert_eq!(output.status.code(), Some(2), "{capture} {csv}");
        let error = stderr(&output);
        let place = format!("error: --csv {}: the estimate would overwrite the recording", path(csv));
        assert!(error.starts_with(&place) && error.contains("\n  next: "), "{error}");
    }
    let appended = std::fs::OpenOptions::new().append(true).open(path("x.dat")).expect("ours");
    let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .args(["replay-halls", &path("x.dat"), "--csv", "/dev/stdout"])
        .stdout(appended)
        .output()
        .expect("the binary starts");
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    for name in ["x.dat", "link", "twin"] {
        assert_eq!(std::fs::read(path(name)).expect("it is there"), capture, "{name}");
    }
}

#[cfg(unix)]
#[test]
fn output_touches_only_the_named_file() {
    use std::os::unix::fs::{FileTypeExt, symlink};
    let folder = folder("only-named");
    let path = |name: &str| folder.join(name).to_string_lossy().into_owned();
    let capture: Vec<u8> = [1u8, 3, 2, 6, 4, 5].into_iter().flat_map(|code| [0x5a, code, 0]).collect();
    std::fs::write(path("x.dat"), &capture).expect("a file for the test");
    let replay =
        |csv: &str| hil_sim(&["replay-halls", &path("x.dat"), "--counts-per-rev", "18", "--csv", csv]);
    let lines = |name: &str| std::fs::read_to_string(path(name)).expect("text").lines().count();

    // A user's file with a similar name.
    std::fs::write(path("x.part"), "mine").expect("a file for the test");
    assert_eq!(replay(&path("x.csv")).status.code(), Some(0));
    assert_eq!(
        (std::fs::read_to_string(path("x.part")).expect("text").as_str(), lines("x.csv")),
        ("mine", 5)
    );

    std::fs::create_dir(path("far")).expect("a folder");
    std::fs::write(path("far/old.csv"), "old").expect("a file for the test");
    for (link, to) in [("old-link.csv", "far/old.csv"), ("new-link.csv", "far/new.csv")] {
        symlink(to, path(link)).expect("a link");
        let output = replay(&path(link));
        assert_eq!(output.status.code(), Some(0), "{link}: {}", stderr(&output));
        assert!(folder.join(link).is_symlink(), "{link}");
        assert_eq!(lines(to), 5, "{link}");
    }

    assert!(Command::new("mkfifo").arg(path("fifo")).status().expect("mkfifo").success());
    let reader = std::thread::spawn({
        let fifo = path("fifo");
        move || std::fs::read_to_string(fifo).expect("text")
    });
    assert_eq!(replay(&path("fifo")).status.code(), Some(0));
    // Check before waiting for the reader, which would wait forever on a pipe that no longer exists.
    assert!(std::fs::metadata(path("fifo")).expect("it is there").file_type().is_fifo());
    assert_eq!(reader.join().expect("read").lines().count(), 5);
    assert_eq!(replay("/dev/stdout").stdout.iter().filter(|byte| **byte == b'\n').count(), 5);

    std::fs::create_dir(path("folder.csv")).expect("a folder");
    assert_eq!(replay(&path("folder.csv")).status.code(), Some(2));
    let full = replay("/dev/full");
    assert_eq!(full.status.code(), Some(2), "{}", stderr(&full));
    // A file size limit of zero acts as a full disk.
    let none = "trap '' XFSZ; ulimit -f 0; exec \"$0\" replay-halls \"$1\" --counts-per-rev 18 --csv \"$2\"";
    let args = [none, env!("CARGO_BIN_EXE_hil-sim"), &path("x.dat"), &path("x.csv")];
    let no_room = Command::new("sh").arg("-c").args(args).output().expect("a shell");
    assert_eq!((no_room.status.code(), lines("x.csv")), (Some(2), 5), "{}", stderr(&no_room));
    let entries = std::fs::read_dir(&folder).expect("the folder");
    let mut names: Vec<_> =
        entries.map(|e| e.expect("an entry").file_name().into_string().expect("text")).collect();
    names.sort();
    let expected = ["far", "fifo", "folder.csv", "new-link.csv", "old-link.csv", "x.csv", "x.dat", "x.part"];
    assert_eq!(names, expected);
}

#[cfg(target_os = "linux")]
#[test]
fn full_disk_fails_and_closed_pipe_succeeds() {
    for args in [&["run", "spread-full-travel", "--json"][..], &["run", "spread-full-travel"], &["list"]] {
        let full = std::fs::File::create("/dev/full").expect("Linux has one");
        let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .args(args)
            .stdout(full)
            .output()
            .expect("the binary starts");
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(
            stderr(&output).starts_with("error: standard output: cannot be written"),
            "{}",
            stderr(&output)
        );

        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let status = Command::new(env!("CARGO_BIN_EXE_hil-sim")).args(args).stdout(writer).status();
        assert_eq!(status.expect("the binary starts").code(), Some(0), "{args:?}");
    }
}

/// As `hil-sim gcl | head -1` does.
#[test]
fn gcl_without_a_reader_keeps_its_exit_code() {
    use std::io::Write;
    for (input, code) in [(&b"FROB\nVERS\n"[..], 1), (b"VERS\nFROB\n", 1), (b"VERS\n", 0)] {
        for args in [&["gcl"][..], &["gcl", "--json"]] {
            let (reader, stdout) = std::io::pipe().expect("a pipe");
            drop(reader);
            let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
            let mut process = command
                .args(args)
                .stdin(std::process::Stdio::piped())
                .stdout(stdout)
                .spawn()
                .expect("it starts");
            process.stdin.take().expect("piped").write_all(input).expect("it reads all");
            assert_eq!(process.wait().expect("it ends").code(), Some(code), "{args:?}");
        }
    }
}

/// Command lines that serve, or connect to a server, have tests of their own.
#[test]
fn documented_command_lines_end_well() {
    let documents = [
        include_str!("../../README.md"),
        include_str!("../../docs/simulator.md"),
        include_str!("../../docs/hosts.md"),
    ];
    let command = "cargo run --bin hil-sim -- ";
    let lines = || documents.iter().flat_map(|document| document.lines());
    let typed = lines().filter_map(|line| line.strip_prefix(command));
    let serves = |line: &&str| ["bus", "hand"].contains(&line.split(' ').next().unwrap_or(line));
    let (serving, typed): (Vec<&str>, Vec<&str>) = typed.partition(serves);
    let hand = "hand --listen 127.0.0.1:11001 --slcan 127.0.0.1:7100 --state hand.state";
    let bus = "bus --nodes 1-7 --slcan 127.0.0.1:7100";
    let truth = "bus --nodes 11,12,13,14 --slcan 127.0.0.1:7100 --host-units 280 --truth 127.0.0.1:7101";
    assert_eq!(serving, ["hand", bus, truth, hand], "see tests/bus.rs, tests/hand.rs");
    assert!(typed.len() >= 3, "{typed:?}");
    let documents_folder = folder("documents");
    // A checkout has cargo's.
    std::fs::create_dir_all(documents_folder.join("target")).expect("a folder");
    for line in typed {
        let args: Vec<&str> = line.split_whitespace().collect();
        let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .args(args)
            .current_dir(&documents_folder)
            .output()
            .expect("the binary starts");
        assert_eq!(output.status.code(), Some(0), "{line}: {}{}", stdout(&output), stderr(&output));
    }

    // Pipes run in the user's shell.
    let mut piped: Vec<&str> = lines().filter(|line| line.contains(&format!("| {command}"))).collect();
    piped.dedup();
    assert_eq!(piped.len(), 1, "{piped:?}");
    for line in piped {
        let grasps = concat!(env!("CARGO_MANIFEST_DIR"), "/grasps");
        let line = line.replace(command, "\"$0\" ").replace("hil-sim/grasps", grasps);
        let output = Command::new("sh")
            .args(["-c", &line, env!("CARGO_BIN_EXE_hil-sim")])
            .current_dir(&documents_folder)
            .output()
            .expect("a shell");
        assert_eq!(output.status.code(), Some(0), "{line}: {}{}", stdout(&output), stderr(&output));
    }
}

#[test]
fn torture_plays_a_seed_however_short_the_time_is() {
    let output =
        hil_sim(&["torture", "--seed", "863", "--minutes", "1e-300", "--jobs", "1", "--json", "--no-shrink"]);
    let json: serde_json::Value = serde_json::from_str(&stdout(&output)).expect("one JSON object");
    assert_eq!((&json["first_seed"], &json["seeds"]), (&863.into(), &1.into()));
}

#[test]
fn torture_notes_steps_after_the_end() {
    let args = [
        "torture",
        "--seed",
        "863",
        "--steps",
        "0,7",
        "--faults",
        "none",
        "--stop-ms",
        "1",
        "--json",
        "--no-shrink",
    ];
    let output = hil_sim(&args);
    assert!(stderr(&output).contains("steps are not played, because --stop-ms 1 "), "{}", stderr(&output));
}

#[cfg(unix)]
#[test]
fn torture_report_and_json_are_never_mixed() {
    let folder = folder("mixed");
    let out = folder.join("out.txt");
    for report in ["/dev/stdout", out.to_str().expect("text")] {
        let file = std::fs::File::create(&out).expect("a file for the test");
        let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .args(["torture", "--seed", "863", "--json", "--replay", report])
            .stdout(file)
            .output()
            .expect("the binary starts");
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        let place = format!("error: --replay {report}: the report would be mixed with the JSON object");
        assert!(stderr(&output).starts_with(&place), "{}", stderr(&output));
        assert_eq!(std::fs::read(&out).expect("it is there"), b"");
    }
}

#[cfg(unix)]
fn press_ctrl_c(process: &std::process::Child) {
    let killed = Command::new("kill").args(["-INT", &process.id().to_string()]).status().expect("kill");
    assert!(killed.success());
}

#[cfg(unix)]
#[test]
fn interrupted_torture_reports_what_it_has_played() {
    use std::io::{BufRead, BufReader};
    let mut process = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
        .args(["torture", "--minutes", "10080", "--jobs", "1", "--json"])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the binary starts");
    // ^C is handled before this line is printed.
    let mut lines = BufReader::new(process.stderr.take().expect("piped")).lines();
    let seed = lines.next().expect("a line").expect("text");
    press_ctrl_c(&process);
    let status = process.wait().expect("it ends");
    let output = std::io::read_to_string(process.stdout.take().expect("piped")).expect("text");
    assert_eq!(status.code(), Some(130), "{output}");
    let json: serde_json::Value = serde_json::from_str(&output).expect("one JSON object");
    assert_eq!(format!("first seed: {}", json["first_seed"]), seed);
    assert!(json["seeds"].as_u64().is_some_and(|seeds| seeds > 0), "{json}");
    let note = lines.last().expect("a line").expect("text");
    assert_eq!(note, format!("interrupted: these are the results of {} seeds", json["seeds"]));
}
