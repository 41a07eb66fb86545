//! `hil-sim margins`: a file with a frequency response in, the margins of that loop out.

use std::error::Error;
use std::path::PathBuf;

use serde_json::{Map, Value};

use super::open;
use super::output::print;
use hil_tuning::frf;
use hil_tuning::response::{FEWEST, Margins, Response, ResponseError};
use programs::output::warn;
use traces::input::{BadInput, shorten};
use traces::names::TIME;
use traces::numbers::Numbers;

/// The arguments of `hil-sim margins`.
#[derive(clap::Args)]
pub struct MarginsArgs {
    /// The response of the open loop: .csv, .mcap or .parquet with freq_hz, and re and im, or mag (or mag_db) and phase_deg; headers of
    /// common analyzers are known.
    frf: PathBuf,
    /// Which column is which, such as "mag_db=Channel 2 Magnitude (dB)"; NAME is freq_hz, freq_rad_s, re, im, mag, mag_db, phase_deg or
    /// phase_rad. Repeatable.
    #[arg(long, value_name = "NAME=HEADER")]
    columns: Vec<String>,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
}

/// Prints the margins.
///
/// # Errors
/// A file that cannot be read or is no frequency response.
pub fn margins(args: &MarginsArgs) -> Result<bool, Box<dyn Error>> {
    let table = open::numbers(&args.frf)?;
    let (response, doubt) = response(&table, &given(&args.columns)?)?;
    let mut margins = response.margins();
    margins.doubts.extend(doubt);
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

/// Names of `--columns` with the headers that they mean.
fn given(columns: &[String]) -> Result<Vec<(String, String)>, BadInput> {
    let part = |text: &String| {
        let (name, header) = text.split_once('=').ok_or_else(|| {
            BadInput::new("--columns", "names no column")
                .found(shorten(text))
                .expected("NAME=HEADER, such as \"mag_db=Channel 2 Magnitude (dB)\"")
                .next(format!("give NAME as one of {}", frf::NAMES.join(", ")))
        })?;
        Ok((name.trim().to_ascii_lowercase(), header.trim().to_owned()))
    };
    columns.iter().map(part).collect()
}

/// The response in a table, and what raises a doubt in its columns.
fn response(table: &Numbers, given: &[(String, String)]) -> Result<(Response, Option<String>), BadInput> {
    let columns = frf::Columns::find(table, given).map_err(|error| match table.find(&[TIME]) {
        Some(_) => BadInput {
            next: format!(
                "this is a recording: measure its response with `hil-sim bode --from {} --input T --output V`",
                table.place()
            ),
            ..error
        },
        None => error,
    })?;
    let mut points = Vec::with_capacity(table.len());
    let mut rows = Vec::with_capacity(table.len());
    for row in 0..table.len() {
        let point = columns.point(table, row)?;
        if point.hz == 0.0 && points.is_empty() {
            warn("note: the row of 0 Hz is left out: a logarithmic axis has no 0");
            continue;
        }
        points.push(point);
        rows.push(row);
    }
    let doubt = columns.doubt(table, &points);
    let response = Response::new(points).map_err(|error| match error {
        ResponseError::TooFew { found } => table.bad_file(
            "too few points".to_owned(),
            format!("{found} rows"),
            format!("{FEWEST} at least"),
            "give more frequencies, at best ten a decade",
        ),
        ResponseError::Frequency { at } => table.bad(
            rows[at],
            columns.frequency(),
            "a frequency that is not above 0",
            "a frequency in Hz, above 0",
        ),
        ResponseError::Order { at } => table.bad(
            rows[at],
            columns.frequency(),
            "a frequency that is not above the one before",
            "each frequency once, in rising order",
        ),
        ResponseError::Value { at } => table.bad(
            rows[at],
            columns.value(),
            "a response without magnitude or phase",
            "a magnitude of 1e-150 to 1e150",
        ),
    })?;
    Ok((response, doubt))
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
