//! Opens the tables that a user names, the same for every command: CSV of any program, MCAP and Parquet.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use tater_wire::property::ROWS;

use hil_experiment::trace::COLUMNS;
use programs::output::warn;
use traces::format::Format;
use traces::input::BadInput;
use traces::names::{self, MOTOR, UNTRUSTED};
use traces::numbers::{Numbers, bad};
use traces::table::{Source, TableError};

/// Largest file: a log of a day and a half.
const MOST_BYTES: u64 = 1 << 30;

/// Names of the columns of a run, and of what a board says of its properties.
fn known() -> Vec<&'static str> {
    let properties = ROWS.iter().map(|row| row.name);
    COLUMNS.iter().map(|column| column.name).chain([MOTOR, UNTRUSTED]).chain(properties).collect()
}

/// Opens a table. A folder is one of `hil-sim run --out`. What was guessed about the file goes to standard error.
///
/// # Errors
/// A file that cannot be read, is too large, or is no table.
pub fn table(path: &Path) -> Result<(PathBuf, Box<dyn Source>), BadInput> {
    let path = if path.is_dir() { in_folder(path)? } else { path.to_owned() };
    let place = path.display().to_string();
    let bytes = bytes(&path)?;
    let (format, other) = Format::of_file(&path, &bytes);
    if let Some(note) = other {
        warn(&format!("note: {place}: {note}"));
    }
    let source = format.source(bytes).map_err(|error| bad(&place, error))?;
    for note in source.notes() {
        warn(&format!("note: {place}: {note}"));
    }
    Ok((path, source))
}

/// Opens a trace: a table whose columns are those of runs or boards.
///
/// # Errors
/// As [`table`], and a table that is no trace.
pub fn trace(path: &Path) -> Result<(PathBuf, Box<dyn Source>), BadInput> {
    let (path, source) = table(path)?;
    names::check(source.as_ref(), &known()).map_err(|error| bad(&path.display().to_string(), error))?;
    Ok((path, source))
}

/// Reads a table's numbers.
///
/// # Errors
/// As [`table`], and two columns of one name.
pub fn numbers(path: &Path) -> Result<Numbers, BadInput> {
    let (path, source) = table(path)?;
    Numbers::read(&path.display().to_string(), source.as_ref())
}

fn in_folder(folder: &Path) -> Result<PathBuf, BadInput> {
    let trace = folder.join("trace.csv");
    if trace.is_file() {
        return Ok(trace);
    }
    Err(BadInput::new(folder.display().to_string(), "has no trace")
        .found("no trace.csv in the folder")
        .expected("a folder that `hil-sim run --out` has written")
        .next("make it with `hil-sim run NAME --out FOLDER`, or give a trace's file"))
}

fn bytes(path: &Path) -> Result<Vec<u8>, BadInput> {
    let place = path.display().to_string();
    let mut bytes = Vec::new();
    // A device or a pipe has no length before it is read.
    let read = File::open(path).and_then(|file| file.take(MOST_BYTES + 1).read_to_end(&mut bytes));
    read.map_err(|error| bad(&place, TableError::Io(error)))?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(BadInput::new(place, "is too large")
            .found(format!("more than {} MiB", MOST_BYTES >> 20))
            .expected(format!("{} MiB or less", MOST_BYTES >> 20))
            .next("give a part of it"));
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use traces::names::unit;

    #[test]
    fn every_quantity_of_a_trace_has_a_unit() {
        let without: Vec<&str> =
            COLUMNS.iter().map(|column| column.name).filter(|name| unit(name).is_empty()).collect();
        assert_eq!(without, ["mode", "halls_code", "strain", "bridge_on", "brake_released"]);
        assert_eq!(
            (unit("velocity_counts_s"), unit("phase_a_a"), unit("load_n_m")),
            ("counts/s", "A", "N·m")
        );
    }
}
