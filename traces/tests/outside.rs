//! Tables that other programs have written ([README](outside/README.md)).

use std::path::Path;

use traces::format::Format;
use traces::numbers::bad;
use traces::table::{Cell, Kind, Source};

/// Opens a file.
fn open(name: &str) -> Result<Box<dyn Source>, String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/outside").join(name);
    let bytes = std::fs::read(&path).expect("in the repository");
    let (format, note) = Format::of_file(&path, &bytes);
    assert_eq!(note, None, "{name}");
    format.source(bytes).map_err(|error| bad(name, error).to_string())
}

/// Names and rows of a file.
fn table(name: &str) -> (Vec<String>, Vec<Vec<Cell>>) {
    let source = open(name).unwrap_or_else(|error| panic!("{error}"));
    let mut rows = Vec::new();
    let done = source.rows(&mut |row| {
        rows.push(row.to_vec());
        Ok(())
    });
    done.unwrap_or_else(|error| panic!("{name}: {error}"));
    (source.heading().columns.iter().map(|column| column.name.clone()).collect(), rows)
}

/// The rows of `make.py`, with times in ms after `start_ms`, so many apart.
fn rows(start_ms: f64, step_ms: f64) -> Vec<Vec<Cell>> {
    let row = |row: i64| {
        vec![
            Cell::Float(start_ms + step_ms * row as f64),
            Cell::Int(row - 1),
            if row == 3 { Cell::Absent } else { Cell::Float((240 + row) as f64 / 10.0) },
            Cell::Int((row + 1) % 2),
            if row == 4 { Cell::Absent } else { Cell::from("arrived") },
        ]
    };
    (0..6).map(row).collect()
}

const NAMES: [&str; 5] = ["time_ms", "mode", "bus_v", "bridge_on", "end"];

#[test]
fn parquet_of_data_frames_is_read() {
    for name in [
        "pandas",
        "pandas-gzip",
        "pandas-none",
        "pandas-unnamed-index",
        "pandas-time-index",
        "pandas-32-bit",
        "arrow-groups",
    ] {
        let (names, cells) = table(&format!("{name}.parquet"));
        assert_eq!((names, cells), (NAMES.map(str::to_owned).to_vec(), rows(0.0, 0.5)), "{name}");
    }
    let kept = open("pandas-unnamed-index.parquet").expect("a table");
    assert_eq!(kept.heading().columns.len(), NAMES.len());
    assert!(kept.heading().metadata.is_empty(), "{:?}", kept.heading().metadata);
    assert_eq!(kept.notes(), ["an index without a name is left out"]);
}

/// 2026-11-28 is 20785 days after 1970.
#[test]
fn times_of_parquet_are_milliseconds_since_1970() {
    let start = 20_785.0 * 86_400e3;
    for (unit, step) in [("ms", 1.0), ("us", 0.5), ("ns", 0.5)] {
        let (_, cells) = table(&format!("pandas-{unit}.parquet"));
        assert_eq!(cells, rows(start, step), "{unit}");
    }
}

#[test]
fn unsigned_integers_of_parquet_keep_their_value() {
    let (_, cells) = table("arrow-unsigned.parquet");
    assert_eq!(cells[1], [Cell::Int(255), Cell::Int(u32::MAX.into()), Cell::Int(i64::MAX)]);
    let source = open("arrow-too-large.parquet").expect("a table");
    let error = source.rows(&mut |_| Ok(())).expect_err("too large").to_string();
    assert!(error.contains("column c") && error.contains("expected an integer up to 2^63"), "{error}");
}

#[test]
fn csv_of_data_frames_is_read() {
    for name in ["pandas.csv", "pandas-semicolon.csv"] {
        let source = open(name).expect("a table");
        let kinds: Vec<Kind> = source.heading().columns.iter().map(|column| column.kind).collect();
        assert_eq!(kinds, [Kind::Float, Kind::Int, Kind::Float, Kind::Text, Kind::Text], "{name}");
        let (names, cells) = table(name);
        assert_eq!(names, NAMES, "{name}");
        for (found, want) in cells.iter().zip(rows(0.0, 0.5)) {
            // Booleans are words here.
            assert_eq!((&found[..3], &found[4]), (&want[..3], &want[4]), "{name}");
        }
        assert_eq!(cells.len(), 6, "{name}");
    }
}

#[test]
fn mcap_of_another_library_is_read() {
    let (_, cells) = table("mcap-none.mcap");
    let want: Vec<Vec<Cell>> =
        (0..6).map(|row| vec![Cell::Float(0.5 * row as f64), Cell::Int(row - 1)]).collect();
    assert_eq!(cells, want);
}

/// What is not read says why, and how to make it readable.
#[test]
fn what_is_not_read_has_a_next_step() {
    let refused = |name: &str| match open(name) {
        Err(error) => error,
        Ok(source) => bad(name, source.rows(&mut |_| Ok(())).expect_err(name)).to_string(),
    };
    for (name, words) in [
        (
            "pandas-zstd.parquet",
            "found:    zstd\n  expected: snappy, gzip or none\n  next:     write it again",
        ),
        ("pandas-lz4.parquet", "found:    lz4_raw"),
        ("pandas-brotli.parquet", "found:    brotli"),
        ("pandas-list.parquet", "column time_ms has a type that is not read\n  found:    a list or a group"),
        ("pandas-spans.parquet", "column time_ms has a type that is not read\n  found:    spans of time"),
        ("mcap-lz4.mcap", "found:    lz4\n  expected: chunks that are not compressed\n  next:     unpack it"),
        ("mcap-zstd.mcap", "found:    zstd"),
        ("mcap-other.mcap", "found:    no metadata record trace"),
    ] {
        let error = refused(name);
        assert!(error.starts_with(&format!("{name}: ")) && error.contains(words), "{error}");
    }
}
