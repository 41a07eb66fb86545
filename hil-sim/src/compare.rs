//! `hil-sim compare`: runs and recordings, read from files.

use std::error::Error;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::open;
use super::output::{is_same_file, print};
use hil_tuning::compare::{Comparison, MOST, Recording, Row, compare as side_by_side, tracks};
use programs::files;
use programs::output::warn;
use traces::input::BadInput;
use traces::numbers::bad;

/// The arguments of `hil-sim compare`.
#[derive(clap::Args)]
pub struct CompareArgs {
    /// Folders of `hil-sim run --out`, or traces (.csv, .mcap, .parquet): 2 to 8; the others are compared with the first.
    #[arg(required = true, value_name = "RUN")]
    inputs: Vec<PathBuf>,
    /// Write a page with all curves on the same axes.
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
}

/// Compares runs.
///
/// # Errors
/// Inputs that are no traces, too few or too many, or a page that cannot be written.
pub fn compare(args: &CompareArgs) -> Result<(), Box<dyn Error>> {
    let found = args.inputs.len();
    if !(2..=MOST).contains(&found) {
        return Err(Box::new(
            BadInput::new(
                "compare",
                if found < 2 { "nothing to compare with" } else { "too many for one page" }.to_owned(),
            )
            .found(format!("{found} inputs"))
            .expected(format!("2 to {MOST}"))
            .next("give folders of `hil-sim run --out` or traces"),
        ));
    }
    let names = names(&args.inputs);
    let inputs: Result<Vec<Recording>, BadInput> =
        args.inputs.iter().zip(names).map(|(path, name)| read(path, name)).collect();
    let comparison = side_by_side(inputs?);
    if let Some(out) = &args.out {
        write(out, &args.inputs, &comparison)?;
    }
    if args.json {
        let mut json = comparison.json();
        json["file"] = args.out.as_ref().map(|out| out.display().to_string()).into();
        print(&format!("{json}\n"))?;
    } else {
        print(&text(&comparison))?;
        if let Some(out) = &args.out {
            print(&format!("\n{}\n", out.display()))?;
        }
    }
    for note in &comparison.notes {
        warn(&format!("note: {note}"));
    }
    Ok(())
}

/// The last word of each path, or the whole path where that is not unique.
fn names(paths: &[PathBuf]) -> Vec<String> {
    let full = |path: &PathBuf| path.display().to_string();
    let last = |path: &PathBuf| {
        // `trace.csv` says less than its folder.
        let is_trace = path.file_stem().is_some_and(|stem| stem == "trace");
        let folder = path.parent().filter(|parent| is_trace && parent.file_name().is_some());
        let name = folder.unwrap_or(path).file_name();
        name.map_or_else(|| full(path), |name| name.to_string_lossy().into_owned())
    };
    let is_unique = |of: &dyn Fn(&PathBuf) -> String, path: &PathBuf| {
        paths.iter().filter(|other| of(other) == of(path)).count() == 1
    };
    let name = |(number, path): (usize, &PathBuf)| match path {
        path if is_unique(&last, path) => last(path),
        path if is_unique(&full, path) => full(path),
        path => format!("{} ({number})", last(path)),
    };
    (1..).zip(paths).map(name).collect()
}

fn read(path: &Path, name: String) -> Result<Recording, BadInput> {
    let (trace, source) = open::trace(path)?;
    let run = if path.is_dir() { stored(&path.join("run.json"))? } else { Value::Null };
    let facts = source.heading().metadata.clone();
    let tracks = tracks(source.as_ref()).map_err(|error| bad(&trace.display().to_string(), error))?;
    Ok(Recording { name, place: path.display().to_string(), tracks, run, facts })
}

/// What a run has stored of itself; null if there is none.
fn stored(path: &Path) -> Result<Value, BadInput> {
    if !path.exists() {
        return Ok(Value::Null);
    }
    let error = |found: String| {
        BadInput::new(path.display().to_string(), "is no description of a run")
            .found(found)
            .expected("a file that `hil-sim run --out` has written")
            .next("make the run again, or give its trace.csv alone")
    };
    let text = files::read_text(path).map_err(|e| error(e.to_string()))?;
    serde_json::from_str(&text).map_err(|e| error(e.to_string()))
}

fn write(out: &Path, inputs: &[PathBuf], comparison: &Comparison) -> Result<(), BadInput> {
    let error = |problem: &str, found: String, expected: &str| {
        BadInput::new(format!("--out {}", out.display()), problem)
            .found(found)
            .expected(expected)
            .next("choose another path, such as compare.html")
    };
    let is_of = |input: &Path| {
        is_same_file(out, input)
            || ["trace.csv", "run.json", "report.html"]
                .iter()
                .any(|name| is_same_file(out, &input.join(name)))
    };
    if let Some(input) = inputs.iter().find(|input| is_of(input)) {
        let found = format!("a file of {}", input.display());
        return Err(error("the page would overwrite an input", found, "a file of its own"));
    }
    files::replace(out, comparison.html().as_bytes())
        .map_err(|e| error("cannot be written", e.to_string(), "a file in an existing folder"))
}

fn text(comparison: &Comparison) -> String {
    let names = comparison.inputs.iter().map(|input| input.name.clone());
    let head: Vec<String> = [String::new(), String::new()].into_iter().chain(names).collect();
    let mut text = String::new();
    for group in &comparison.groups {
        if !group.motor.is_empty() {
            text.push_str(&format!("{}\n", group.motor));
        }
        let words = group
            .words
            .iter()
            .map(|(name, words)| [vec![name.clone(), String::new()], words.clone()].concat());
        let parts: [(&str, &[Row]); 3] = [
            ("properties that differ", &group.properties),
            ("figures of the traces", &group.figures),
            ("metrics of the runs", &group.metrics),
        ];
        for (title, rows) in parts.into_iter().filter(|(_, rows)| !rows.is_empty()) {
            let mut lines = vec![head.clone()];
            lines.extend(
                rows.iter().map(|row| [vec![row.name.clone(), row.unit.clone()], row.cells()].concat()),
            );
            if title.starts_with("metrics") {
                lines.extend(words.clone());
            }
            text.push_str(&format!("{title}\n{}\n", aligned(&lines)));
        }
    }
    text.trim_end().to_owned() + "\n"
}

/// Columns of equal width: names to the left, numbers to the right.
fn aligned(lines: &[Vec<String>]) -> String {
    let columns = lines.iter().map(Vec::len).max().unwrap_or(0);
    let length = |cell: &String| cell.chars().count();
    let widths: Vec<usize> = (0..columns)
        .map(|at| lines.iter().filter_map(|line| line.get(at)).map(length).max().unwrap_or(0))
        .collect();
    let mut text = String::new();
    for line in lines {
        let cells = line.iter().zip(&widths).enumerate().map(|(at, (cell, width))| {
            if at < 2 { format!("{cell:<width$}") } else { format!("{cell:>width$}") }
        });
        text.push_str(&format!("  {}\n", cells.collect::<Vec<_>>().join("  ").trim_end()));
    }
    text
}
