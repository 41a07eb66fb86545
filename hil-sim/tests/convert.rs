//! `hil-sim convert`: traces from one format into another and back.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

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

fn convert(folder: &Path, from: &str, to: &str) {
    let output = hil_sim(&["convert", from, to], folder);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{from} -> {to}: {errors}");
}

fn read(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).expect("written")
}

#[test]
fn trace_is_byte_identical_after_all_formats() {
    let folder = folder("convert-round-trip");
    let scenario =
        "name = 'x'\nabout = 'y'\nmotor = ['link', 'tip']\nduration_ms = 300\n[[at]]\nms = 10\nmove = 100\n";
    std::fs::write(folder.join("x.toml"), scenario).expect("ours");
    let run = hil_sim(&["run", "x.toml", "--out", "."], &folder);
    assert_eq!(run.status.code(), Some(0), "{}", String::from_utf8_lossy(&run.stderr));
    convert(&folder, "trace.csv", "a.mcap");
    convert(&folder, "a.mcap", "b.parquet");
    convert(&folder, "b.parquet", "c.csv");
    assert!(read(&folder, "c.csv") == read(&folder, "trace.csv"));
    convert(&folder, "c.csv", "d.parquet");
    convert(&folder, "d.parquet", "e.mcap");
    assert!(read(&folder, "d.parquet") == read(&folder, "b.parquet"));
    assert!(read(&folder, "e.mcap") == read(&folder, "a.mcap"));
}

#[test]
fn metadata_absent_numbers_and_uneven_digits_survive() {
    let folder = folder("convert-odd");
    let csv = "# seed=7\n# commit=a=b µ\n# empty=\ntime_ms,bus_v,IMOTOR,strain\n0,24.5,,-0\n1,24,-3,0\n2,-0.125,999999999999,1\n";
    std::fs::write(folder.join("a.csv"), csv).expect("ours");
    convert(&folder, "a.csv", "b.mcap");
    convert(&folder, "b.mcap", "c.parquet");
    convert(&folder, "c.parquet", "d.csv");
    assert_eq!(String::from_utf8_lossy(&read(&folder, "d.csv")), csv);
}

#[test]
fn bad_input_is_named_by_file_and_place() {
    let folder = folder("convert-bad");
    for (csv, words) in [
        ("time_ms,bus_v\n0,1\n1\n", &["in.csv:3: bad row", "1 columns", "2 columns"][..]),
        ("time_ms,bus_v\n0,NaN\n", &["in.csv:2: column bus_v", "NaN", "finite"]),
        ("\u{feff}time_ms,bus_v\n0,24 V\n", &["in.csv:2: column bus_v", "24 V"]),
        (
            "time_ms,windng_c\n0,1\n",
            &["in.csv:1: column windng_c", "unknown column", "did you mean winding_c?"],
        ),
        ("time_ms,bus_v\n0,1\n1", &["in.csv:3", "1 columns"]),
        ("time_ms,bus_v\n0,1\n0,2\n", &["in.csv:3: column time_ms", "more than 0"]),
        ("time_ms,bus_v\n1,1\n0,2\n", &["in.csv:3: column time_ms", "more than 1"]),
        ("time_ms,bus_v\n0,1e300\n", &["in.csv:2: column bus_v", "-1e12 to 1e12"]),
        ("", &["in.csv", "truncated"]),
        ("name = 'x'\n", &["in.csv:1", "time_ms"]),
    ] {
        std::fs::write(folder.join("in.csv"), csv).expect("ours");
        let output = hil_sim(&["convert", "in.csv", "out.mcap"], &folder);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{csv:?}: {errors}");
        for word in words {
            assert!(errors.contains(word), "no {word} in {errors}");
        }
        assert!(!folder.join("out.mcap").exists(), "{csv:?}");
    }
    std::fs::write(folder.join("in.csv"), "time_ms,bus_v\n0,1\n").expect("ours");
    for name in ["in.mcap", "in.parquet"] {
        convert(&folder, "in.csv", name);
        let whole = read(&folder, name);
        for end in [0, 3, whole.len() / 2, whole.len() - 1] {
            std::fs::write(folder.join(name), &whole[..end]).expect("ours");
            let output = hil_sim(&["convert", name, "out.csv"], &folder);
            let errors = String::from_utf8_lossy(&output.stderr).into_owned();
            assert_eq!(output.status.code(), Some(2), "{name} of {end} bytes: {errors}");
            assert!(errors.starts_with(&format!("error: {name}: ")), "{errors}");
        }
    }
    for (from, to) in [("in.csv", "in.csv"), ("in.csv", "out.txt"), ("none.csv", "out.csv")] {
        assert_eq!(hil_sim(&["convert", from, to], &folder).status.code(), Some(2), "{from} {to}");
    }
}
