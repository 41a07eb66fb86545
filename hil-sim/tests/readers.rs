//! Every producer of tables with every consumer, in every format.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use tater_wire::{Destination, Message, Node, Property};
use traces::format::Format;
use traces::table::Source;

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

fn hil_sim(folder: &Path, args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    command.args(args).current_dir(folder).output().expect("the binary starts")
}

/// Runs a command that gives one of these exit codes, and returns what it says.
#[track_caller]
fn says(folder: &Path, args: &[&str], codes: &[i32]) -> (String, String) {
    let output = hil_sim(folder, args);
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (out, errors) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.code().is_some_and(|code| codes.contains(&code)), "{args:?}: {errors}");
    (out, errors)
}

/// Brings a trace into each format, beside it.
fn in_all_formats(folder: &Path, file: &str) -> Vec<String> {
    let stem = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
    ["csv", "mcap", "parquet"]
        .map(|extension| {
            let to = format!("{stem}-as.{extension}");
            says(folder, &["convert", file, &to], &[0]);
            to
        })
        .into()
}

/// A trace is taken by each consumer: `identify` gives figures of it, though it may call some undetermined; `bode` a response, or that the
/// move says nothing of one; `margins` says what to do instead. Returns the figures.
#[track_caller]
fn is_taken(folder: &Path, trace: &str, input: &str, output: &str) -> String {
    let (figures, _) = says(folder, &["identify", trace, "--json"], &[0, 1]);
    assert!(figures.starts_with("{\"r_ohm\":") || figures.contains("\"r_ohm\":{"), "{trace}: {figures}");
    let bode = ["bode", "--from", trace, "--input", input, "--output", output, "--json"];
    let (margins, errors) = says(folder, &bode, &[0, 2]);
    // A slow move excites no frequency enough; it was read all the same.
    let is_read =
        margins.contains("\"points\":") || errors.contains("too few frequencies with a sure response");
    assert!(is_read, "{trace}: {errors}");
    says(folder, &["compare", trace, trace], &[0]);
    for extension in ["csv", "mcap", "parquet"] {
        says(folder, &["convert", trace, &format!("again.{extension}")], &[0]);
    }
    let (_, errors) = says(folder, &["margins", trace], &[2]);
    assert!(errors.contains("hil-sim bode --from"), "{trace}: {errors}");
    figures
}

/// A move of some seconds, to and fro.
const SCENARIO: &str = "name = 'x'\nabout = 'y'\nmotor = 'link'\nduration_ms = 4000\n[[at]]\nms = 10\nmove = 300\n\
                        [[at]]\nms = 1500\nmove = 20\n[[at]]\nms = 2500\nmove = 200\n";

#[test]
fn run_is_taken_by_all() {
    let folder = folder("readers-run");
    std::fs::write(folder.join("x.toml"), SCENARIO).expect("ours");
    says(&folder, &["run", "x.toml", "--out", "run"], &[0]);
    for trace in ["run".to_owned(), "run/trace.csv".to_owned()]
        .into_iter()
        .chain(in_all_formats(&folder, "run/trace.csv"))
    {
        is_taken(&folder, &trace, "T", "V");
    }
}

#[test]
fn run_of_several_motors_is_taken_one_by_one() {
    let folder = folder("readers-several");
    std::fs::write(folder.join("x.toml"), SCENARIO.replace("'link'", "['link', 'tip']")).expect("ours");
    says(&folder, &["run", "x.toml", "--out", "run"], &[0]);
    for trace in in_all_formats(&folder, "run/trace.csv") {
        let bode = ["bode", "--from", &trace, "--input", "T", "--output", "V"];
        for args in [&["identify", &trace][..], &bode] {
            let (_, errors) = says(&folder, args, &[2]);
            assert!(errors.contains("several motors") && errors.contains("--motor tip"), "{errors}");
            says(&folder, &[args, &["--motor", "tip"]].concat(), &[0, 1]);
        }
    }
}

#[test]
fn excitation_is_taken_by_all() {
    let folder = folder("readers-excite");
    for file in ["e.csv", "e.mcap", "e.parquet"] {
        says(&folder, &["excite", "--motor", "tip", "--out", file], &[0]);
        let figures = is_taken(&folder, file, "T", "P");
        assert!(!figures.contains("\"determined\":false"), "{file}: {figures}");
    }
    for trace in in_all_formats(&folder, "e.mcap") {
        is_taken(&folder, &trace, "T", "P");
    }
}

/// Orders a served board before its recorder comes: one host at a time.
fn order(address: &str, orders: &[(Property, i64)]) {
    let limit = Duration::from_secs(5);
    let mut bus = wraptor::Bus::slcan(address, limit).expect("it listens");
    for (property, value) in orders {
        let to = Destination::Node(Node::new(1).expect("a node"));
        bus.send(&Message::set(to, *property, *value).expect("it has a frame").frame(), limit).expect("sent");
        // The board reads one before the next comes.
        let _ = bus.receive(Duration::from_millis(if *property == Property::STAT { 1500 } else { 20 }));
    }
}

#[test]
fn log_of_a_moving_board_is_taken_by_all() {
    let folder = folder("readers-log");
    let served = crate::served::serve("1");
    for (file, goal) in [("l.csv", 250), ("l.mcap", 30), ("l.parquet", 250)] {
        let orders = [(Property::STAT, 2), (Property::MV, 60), (Property::E, goal), (Property::MODE, 5)];
        order(&served.address, &orders);
        let log = ["log", "--slcan", &served.address, "--node", "1", "--seconds", "5", "--out", file];
        says(&folder, &log, &[0]);
        is_taken(&folder, file, "T", "P");
    }
    for trace in in_all_formats(&folder, "l.mcap") {
        is_taken(&folder, &trace, "T", "P");
    }
}

/// A table as programs elsewhere write it is taken as the plain one is.
#[test]
fn tables_from_elsewhere_are_taken() {
    let folder = folder("readers-elsewhere");
    says(&folder, &["excite", "--motor", "tip", "--out", "e.csv"], &[0]);
    let whole = std::fs::read_to_string(folder.join("e.csv")).expect("written");
    // A part of it, because `identify` computes for seconds with the whole.
    let plain: String = whole.lines().take(4000).map(|line| format!("{line}\n")).collect();
    std::fs::write(folder.join("e.csv"), &plain).expect("ours");
    let want = is_taken(&folder, "e.csv", "T", "P");
    let determined = |figures: &str| figures.matches("\"determined\":true").count();
    assert!(determined(&want) > 0, "{want}");
    let epoch = |text: &str| {
        let shift = |line: &str| match line.split_once(',') {
            Some((ms, rest)) => match ms.parse::<f64>() {
                Ok(ms) => format!("{:.3},{rest}\n", ms + 1_764_000_000_000.0),
                Err(_) => format!("{line}\n"),
            },
            None => String::new(),
        };
        text.lines().map(shift).collect::<String>()
    };
    let capitals = plain.lines().next().unwrap_or_default().to_uppercase().replace(',', " , ");
    for (name, text) in [
        ("python", plain.replace('\n', "\r\n")),
        ("mac", plain.replace('\n', "\r")),
        ("spreadsheet", format!("\u{feff}{}", plain.replace(',', ";").replace('.', ","))),
        ("tabs", plain.replace(',', "\t")),
        (
            "frame",
            (0..)
                .zip(plain.lines())
                .map(|(i, line)| if i == 0 { format!(",{line}\n") } else { format!("{i},{line}\n") })
                .collect(),
        ),
        ("comments", format!("# a bench\n\n{}\n\n% the end\n", plain.trim_end())),
        ("capitals", plain.replacen(plain.lines().next().unwrap_or_default(), &capitals, 1)),
        ("sep", format!("sep=;\r\n{}", plain.replace(',', ";"))),
        ("epoch", epoch(&plain)),
    ] {
        let file = format!("{name}.csv");
        std::fs::write(folder.join(&file), text).expect("ours");
        if name == "capitals" {
            assert_eq!(says(&folder, &["identify", &file, "--json"], &[0, 1]).0, want);
            // The names of a trace that is kept or compared are those of docs/traces.md.
            let (_, errors) = says(&folder, &["convert", &file, "again.csv"], &[2]);
            assert!(errors.contains("expected: time_ms, the first column"), "{errors}");
            continue;
        }
        let found = is_taken(&folder, &file, "T", "P");
        // The times of a clock have a digit less.
        let is_alike = if name == "epoch" { determined(&found) == determined(&want) } else { found == want };
        assert!(is_alike, "{name}: {found}\n{want}");
    }
}

/// Responses in every format, and with the headers of others.
#[test]
fn responses_are_taken_in_all_formats() {
    let folder = folder("readers-responses");
    says(&folder, &["bode", "--realizations", "2", "--out", "."], &[0]);
    let (want, _) = says(&folder, &["margins", "frf.csv", "--json"], &[0]);
    let source =
        traces::csv::Reader::new(std::fs::read(folder.join("frf.csv")).expect("written")).expect("a table");
    for (name, format) in [("frf.mcap", Format::Mcap), ("frf.parquet", Format::Parquet)] {
        let mut bytes = Vec::new();
        let mut sink = format.sink(&mut bytes, source.heading()).expect("begun");
        source.rows(&mut |row| sink.row(row)).expect("written");
        sink.finish().expect("ended");
        drop(sink);
        std::fs::write(folder.join(name), bytes).expect("ours");
        assert_eq!(says(&folder, &["margins", name, "--json"], &[0]).0, want, "{name}");
    }
    let analyzer = "#Network Analyzer\n\nFrequency (Hz),Channel 1 Magnitude (dB),Channel 2 Magnitude (dB),Channel 2 Phase (deg)\n";
    let rows: String =
        (1..40).map(|i| format!("{i},0,{},-90\n", 20.0 * (10.0 / f64::from(i)).log10())).collect();
    std::fs::write(folder.join("a.csv"), format!("{analyzer}{rows}")).expect("ours");
    let (margins, _) = says(&folder, &["margins", "a.csv", "--json"], &[0]);
    assert!(margins.contains("\"phase_margin_deg\":90"), "{margins}");
    let chosen = ["margins", "a.csv", "--columns", "mag_db=Channel 1 Magnitude (dB)", "--json"];
    assert!(says(&folder, &chosen, &[0]).0.contains("\"phase_margin_deg\":null"));
    std::fs::write(folder.join("b.csv"), format!("{analyzer}{}", rows.replace("-90", "-1.5708")))
        .expect("ours");
    let (_, errors) = says(&folder, &["margins", "b.csv"], &[0]);
    assert!(errors.contains("if these are radians"), "{errors}");
}

/// A file whose name or encoding says another thing than its content is read by its content, or refused with a next step.
#[test]
fn files_under_other_names_are_read_by_their_content() {
    let folder = folder("readers-names");
    says(&folder, &["excite", "--motor", "tip", "--out", "e.csv"], &[0]);
    let (want, _) = says(&folder, &["identify", "e.csv", "--json"], &[0]);
    let plain = std::fs::read_to_string(folder.join("e.csv")).expect("written");
    let wide = format!("\u{feff}{}", plain.replace(',', "\t"));
    std::fs::write(
        folder.join("wide.txt"),
        wide.encode_utf16().flat_map(u16::to_le_bytes).collect::<Vec<u8>>(),
    )
    .expect("ours");
    in_all_formats(&folder, "e.csv");
    for (from, to) in [
        ("e.csv", "csv.parquet"),
        ("e.csv", "csv.mcap"),
        ("e-as.parquet", "parquet.csv"),
        ("e-as.mcap", "mcap.parquet"),
    ] {
        std::fs::copy(folder.join(from), folder.join(to)).expect("ours");
    }
    for file in ["csv.parquet", "csv.mcap", "parquet.csv", "mcap.parquet", "wide.txt"] {
        let (found, errors) = says(&folder, &["identify", file, "--json"], &[0]);
        assert!(found == want && errors.contains("note: "), "{file}: {errors}");
    }
    for (file, bytes) in
        [("a.parquet", "PAR1"), ("a.mcap", "\0"), ("b.parquet", ""), ("a.xlsx", "PK\u{3}\u{4}")]
    {
        std::fs::write(folder.join(file), bytes).expect("ours");
        let (_, errors) = says(&folder, &["identify", file], &[2]);
        assert!(errors.contains(&format!("error: {file}")) && errors.contains("next:"), "{errors}");
    }
}

/// Pipes have no length and no end before they are read.
#[cfg(unix)]
#[test]
fn pipe_is_read_as_a_file() {
    let folder = folder("readers-pipe");
    says(&folder, &["excite", "--motor", "tip", "--out", "e.mcap"], &[0]);
    let (want, _) = says(&folder, &["identify", "e.mcap", "--json"], &[0]);
    let mut cat = Command::new("cat");
    let mut cat =
        cat.arg(folder.join("e.mcap")).stdout(std::process::Stdio::piped()).spawn().expect("cat starts");
    let mut hil_sim = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    hil_sim.args(["identify", "/dev/stdin", "--json"]).stdin(cat.stdout.take().expect("piped"));
    let output = hil_sim.output().expect("the binary starts");
    assert!(cat.wait().expect("it ends").success());
    assert_eq!(String::from_utf8_lossy(&output.stdout), want);
}

/// Times since 1970 in another unit than their column's name says would shift a response by decades.
#[test]
fn response_of_times_in_another_unit_is_refused() {
    let folder = folder("readers-units");
    let trace = |header: &str, time: fn(f64) -> f64| {
        let row = |i: u32| format!("{},{},{}\n", time(f64::from(i)), i * 7919 % 101, i * 7919 % 103);
        format!("{header},x,y\n{}", (0..1000).map(row).collect::<String>())
    };
    let bode = |file: &str, text: String, codes: &[i32]| {
        std::fs::write(folder.join(file), text).expect("ours");
        says(&folder, &["bode", "--from", file, "--input", "x", "--output", "y"], codes).1
    };
    for (text, unit) in [
        (trace("time_ms", |ms| 1.764e18 + ms * 1e6), "nanoseconds"),
        (trace("time_ms", |ms| 1.764e15 + ms * 1e3), "microseconds"),
        (trace("time_ms", |ms| 1.764e9 + ms / 1e3), "seconds"),
        (trace("time_s", |ms| 1.764e12 + ms), "milliseconds"),
    ] {
        let errors = bode("other.csv", text, &[2]);
        assert!(errors.contains(&format!("these times are {unit} since 1970")), "{errors}");
    }
    let errors = bode("short.csv", trace("time_ms", |ms| ms / 1e3), &[0, 2]);
    assert!(errors.contains("check that time_ms has the unit that its name says"), "{errors}");
    for text in [trace("time_s", |ms| 1.764e9 + ms / 1e3), trace("time_ms", |ms| 1.764e12 + ms)] {
        let errors = bode("own.csv", text, &[0, 2]);
        assert!(!errors.contains("unit"), "{errors}");
    }
}
