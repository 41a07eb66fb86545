//! `hil-sim margins`: a file with a frequency response in, the margins of that loop out.

use std::error::Error;
use std::path::PathBuf;

use num_complex::Complex64;
use serde_json::{Map, Value};

use super::output::{print, warn};
use super::table::{Table, TableFile};
use hil_tuning::response::{FEWEST, Margins, Point, Response, ResponseError};
use traces::input::BadInput;

/// The arguments of `hil-sim margins`.
#[derive(clap::Args)]
pub struct MarginsArgs {
    /// CSV: freq_hz with re and im, or with mag (or mag_db) and phase_deg, of the open loop.
    frf: PathBuf,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
}

const COLUMNS: &str = "freq_hz with re, im or mag, phase_deg (or mag_db, phase_deg)";

/// Prints the margins.
///
/// # Errors
/// A file that cannot be read or is no frequency response.
pub fn margins(args: &MarginsArgs) -> Result<bool, Box<dyn Error>> {
    let file = TableFile::read(&args.frf)?;
    let table = file.table()?;
    let response = response(&table)?;
    let margins = response.margins();
    let place = args.frf.display().to_string();
    notes(&place, &margins);
    if args.json {
        let mut object = json(&margins);
        object.insert("points".to_owned(), response.points().len().into());
        print(&format!("{}\n", Value::Object(object)))?;
    } else {
        print(&text(&margins))?;
    }
    Ok(true)
}

#[derive(Clone, Copy)]
enum Format {
    Parts(usize, usize),
    Linear(usize, usize),
    Decibels(usize, usize),
}

/// The response in a table.
fn response(table: &Table) -> Result<Response, BadInput> {
    let hz = table.need(&["freq_hz", "frequency_hz", "freq", "f_hz"], COLUMNS)?;
    let find = |names: &[&str]| table.find(names);
    let format = match (find(&["re"]), find(&["im"]), find(&["mag"]), find(&["mag_db"]), find(&["phase_deg"]))
    {
        (Some(re), Some(im), ..) => Format::Parts(re, im),
        (_, _, Some(mag), _, Some(phase)) => Format::Linear(mag, phase),
        (_, _, None, Some(mag), Some(phase)) => Format::Decibels(mag, phase),
        (Some(_), None, ..) => return Err(missing(table, "im")),
        (None, Some(_), ..) => return Err(missing(table, "re")),
        (_, _, None, None, Some(_)) => return Err(missing(table, "mag")),
        (_, _, Some(_), _, None) | (_, _, _, Some(_), None) => return Err(missing(table, "phase_deg")),
        (None, None, None, None, None) => return Err(missing(table, "re")),
    };
    let mut points = Vec::with_capacity(table.len());
    let mut rows = Vec::with_capacity(table.len());
    for row in 0..table.len() {
        let freq = table.number(row, hz)?;
        if freq == 0.0 && points.is_empty() {
            warn("note: the row of 0 Hz is left out: a logarithmic axis has no 0");
            continue;
        }
        points.push(Point { hz: freq, value: value(table, row, format)? });
        rows.push(row);
    }
    let column = match format {
        Format::Parts(a, _) | Format::Linear(a, _) | Format::Decibels(a, _) => a,
    };
    Response::new(points).map_err(|error| match error {
        ResponseError::TooFew { found } => table.bad_file(
            "too few points".to_owned(),
            format!("{found} rows"),
            format!("{FEWEST} at least"),
            "give more frequencies, at best ten a decade",
        ),
        ResponseError::Frequency { at } => {
            table.bad(rows[at], hz, "a frequency that is not above 0", "a frequency in Hz, above 0")
        }
        ResponseError::Order { at } => table.bad(
            rows[at],
            hz,
            "a frequency that is not above the one before",
            "each frequency once, in rising order",
        ),
        ResponseError::Value { at } => table.bad(
            rows[at],
            column,
            "a response without magnitude or phase",
            "a magnitude of 1e-150 to 1e150",
        ),
    })
}

fn value(table: &Table, row: usize, format: Format) -> Result<Complex64, BadInput> {
    match format {
        Format::Parts(re, im) => Ok(Complex64::new(table.number(row, re)?, table.number(row, im)?)),
        Format::Linear(mag, phase) => {
            let found = table.number(row, mag)?;
            if found < 0.0 {
                return Err(table.bad(
                    row,
                    mag,
                    "negative",
                    "a linear magnitude above 0; name it mag_db if it is in dB",
                ));
            }
            Ok(Complex64::from_polar(found, table.number(row, phase)?.to_radians()))
        }
        Format::Decibels(mag, phase) => Ok(Complex64::from_polar(
            10f64.powf(table.number(row, mag)? / 20.0),
            table.number(row, phase)?.to_radians(),
        )),
    }
}

fn missing(table: &Table, name: &str) -> BadInput {
    // `need` words what is missing; none of the names exists.
    table.need(&[name], COLUMNS).err().unwrap_or_else(|| {
        table.bad_file("wrong columns".to_owned(), name.to_owned(), COLUMNS.to_owned(), "rename the columns")
    })
}

/// The keys of JSON. What does not exist is null, with a sentence in `reasons`.
pub fn json(margins: &Margins) -> Map<String, Value> {
    let reasons: Map<String, Value> =
        margins.reasons.iter().map(|(name, why)| ((*name).to_owned(), why.as_str().into())).collect();
    // Numbers and strings only: this cannot fail.
    let list = |all: Result<Value, serde_json::Error>| all.unwrap_or_default();
    let entries: [(&str, Value); 15] = [
        ("phase_margin_deg", margins.phase_margin_deg.into()),
        ("gain_margin", margins.gain_margin.into()),
        ("gain_margin_low", margins.gain_margin_low.into()),
        ("ms", margins.ms.into()),
        ("ms_hz", margins.ms_hz.into()),
        ("disk_margin", margins.disk_margin.into()),
        ("bandwidth_hz", margins.bandwidth_hz.into()),
        ("crossover_hz", margins.crossover_hz.into()),
        ("phase_crossover_hz", margins.phase_crossover_hz.into()),
        ("delay_margin_ms", margins.delay_margin_ms.into()),
        ("closed_loop_stable", margins.stable.into()),
        ("gain_crossings", list(serde_json::to_value(&margins.gain_crossings))),
        ("phase_crossings", list(serde_json::to_value(&margins.phase_crossings))),
        ("reasons", Value::Object(reasons)),
        ("doubts", list(serde_json::to_value(&margins.doubts))),
    ];
    entries.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
}

/// One line each.
pub fn text(margins: &Margins) -> String {
    let number = |name: &str, value: Option<f64>, unit: &str| {
        let why = || margins.reasons.iter().find(|(of, _)| *of == name).map(|(_, why)| why.as_str());
        match value {
            Some(value) => format!("{name:<20} {value:>10.4} {unit}").trim_end().to_owned() + "\n",
            None => format!("{name:<20}       none {}\n", why().unwrap_or_default()),
        }
    };
    let mut text = String::new();
    for (name, value, unit) in [
        ("phase_margin_deg", margins.phase_margin_deg, "deg"),
        ("crossover_hz", margins.crossover_hz, "Hz"),
        ("gain_margin", margins.gain_margin, ""),
        ("phase_crossover_hz", margins.phase_crossover_hz, "Hz"),
        ("gain_margin_low", margins.gain_margin_low, ""),
        ("ms", Some(margins.ms), ""),
        ("ms_hz", Some(margins.ms_hz), "Hz"),
        ("disk_margin", margins.disk_margin, ""),
        ("bandwidth_hz", margins.bandwidth_hz, "Hz"),
        ("delay_margin_ms", margins.delay_margin_ms, "ms"),
    ] {
        text.push_str(&number(name, value, unit));
    }
    let stable = match margins.stable {
        Some(true) => "yes, if the open loop has no unstable pole",
        Some(false) => "no",
        None => "not known from this band",
    };
    text.push_str(&format!("{:<20} {stable}\n", "closed_loop_stable"));
    text
}

/// Doubts, and the margins asked for that do not exist, on standard error.
pub fn notes(place: &str, margins: &Margins) {
    for (name, why) in &margins.reasons {
        if ["phase_margin_deg", "gain_margin"].contains(name) {
            warn(&format!("note: {place}: no {name}: {why}"));
        }
    }
    for doubt in &margins.doubts {
        warn(&format!("warning: {place}: {doubt}"));
    }
}
