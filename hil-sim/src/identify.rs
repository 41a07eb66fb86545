//! `hil-sim identify`: a motor's figures from a recorded move, as text, JSON, properties and a page of residuals.

use std::error::Error;
use std::path::{Path, PathBuf};

use super::figures::MotorArg;
use super::open;
use super::output::{print, write_folder};
use charts::{Chart, Series, Sheet, escape};
use hil_tuning::identify::{Estimate, Identified, Known, Recording, identify as fit};
use programs::output::warn;
use serde_json::{Map, Value, json};
use traces::input::BadInput;

#[derive(clap::Args)]
pub struct IdentifyArgs {
    /// A recorded move: the folder of `hil-sim run --out`, or a file of `hil-sim excite` or `hil-sim log` (.csv, .mcap, .parquet).
    trace: PathBuf,
    /// The motor: link, spread or tip, of a trace with several the one to take, which coasts without power if it is no spread; or a file that
    /// describes another in the place of a link (docs/motor.md).
    #[arg(long, value_name = "MOTOR")]
    motor: Option<MotorArg>,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
    /// Write residuals.html into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Returns whether all figures are determined.
pub fn identify(args: &IdentifyArgs) -> Result<bool, Box<dyn Error>> {
    let numbers = open::numbers(&args.trace)?;
    let file = numbers.place().to_owned();
    let (kind, described) = args.motor.as_ref().map(MotorArg::read).transpose()?.unzip();
    let recording = Recording::read(&numbers, kind)?;
    let known = described.flatten().as_ref().map_or_else(Known::hands, Known::described);
    let found = fit(&recording, &known);
    if let Some(dir) = &args.out {
        write_page(dir, &file, &found)?;
    }
    for remark in &found.remarks {
        warn(&format!("warning: {file}: {remark}"));
    }
    if args.json {
        print(&format!("{}\n", object(&found)))?;
    } else {
        print(&lines(&found))?;
        if let Some(dir) = &args.out {
            print(&format!("\n{}\n", dir.join(PAGE).display()))?;
        }
    }
    let beyond = found.beyond();
    for error in &beyond {
        warn(&format!(
            "error: {}",
            BadInput::new(file.clone(), "the board's model of this motor has a value that no board takes").found(error.found()).expected(error.expected()).next("compare the figures with the motor's data sheet, and record again; a board without this property has its default")
        ));
    }
    Ok(found.missing.is_empty() && beyond.is_empty())
}

const PAGE: &str = "residuals.html";

/// Four significant digits.
fn number(value: f64) -> String {
    if !value.is_finite() {
        return "-".to_owned();
    }
    let size = value.abs();
    match size {
        0.01..1e4 => {
            let decimals = (3.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
            format!("{value:.decimals$}")
        }
        0.0 => "0".to_owned(),
        _ => format!("{value:.3e}"),
    }
}

fn lines(found: &Identified) -> String {
    let mut text = String::new();
    for (name, unit, of) in found.figures() {
        let mark = if of.is_determined { "" } else { "   NOT DETERMINED" };
        let range = format!("{} to {}", number(of.low), number(of.high));
        text.push_str(&format!("{name:<18} {:>10}   95 %: {range:<24} {unit}{mark}\n", number(of.value)));
    }
    text.push_str("\nHall errors are those of the upper boundaries of sectors 0 to 5, less their mean, which no move shows.\n");
    let properties = found.properties();
    if !properties.is_empty() {
        let set: Vec<String> =
            properties.iter().map(|(name, value)| format!("--set {name}={value}")).collect();
        text.push_str(&format!("\nThe board's model of this motor: {}\n", set.join(" ")));
    }
    if !found.missing.is_empty() {
        text.push_str("\nTo determine the rest, record:\n");
        found.missing.iter().for_each(|advice| text.push_str(&format!("  {advice}\n")));
    }
    text
}

fn estimate(of: &Estimate) -> Value {
    // serde_json writes a number that is not finite as null.
    json!({ "value": of.value, "low": of.low, "high": of.high, "determined": of.is_determined })
}

fn object(found: &Identified) -> Value {
    let mut object = Map::new();
    let figures = [
        ("r_ohm", &found.r_ohm),
        ("ke_v_s", &found.ke_v_s),
        ("j_kg_m2", &found.j_kg_m2),
        ("coulomb_n_m", &found.coulomb_n_m),
        ("viscous_n_m_s", &found.viscous_n_m_s),
        ("friction_n_m", &found.friction_n_m),
        ("delay_ms", &found.delay_ms),
    ];
    figures.into_iter().for_each(|(name, of)| _ = object.insert(name.to_owned(), estimate(of)));
    let halls: Vec<Value> = found.hall_error_deg.iter().map(estimate).collect();
    object.insert("hall_error_deg".to_owned(), Value::Array(halls));
    let properties: Map<String, Value> =
        found.properties().into_iter().map(|(name, value)| (name.to_owned(), value.into())).collect();
    object.insert("properties".to_owned(), Value::Object(properties));
    let beyond: Vec<String> = found.beyond().iter().map(ToString::to_string).collect();
    object.insert("out_of_range".to_owned(), json!(beyond));
    object.insert("record".to_owned(), json!(found.missing));
    object.insert("remarks".to_owned(), json!(found.remarks));
    Value::Object(object)
}

/// One curve over time.
struct Plot {
    /// What it shows.
    title: &'static str,
    /// Its unit.
    unit: &'static str,
    /// Least span of the axis.
    least_span: f64,
    /// Times, ms.
    times: Vec<f64>,
    /// Values.
    values: Vec<f64>,
}

/// A page with a table and curves. `head` and the `rows` are plain text; the first column is on the left.
fn plots(name: &str, about: &str, head: &[&str], rows: &[Vec<String>], plots: &[Plot]) -> String {
    let mut sheet = Sheet::new(name);
    sheet.push(&format!("<header><h1>{}</h1>\n<p>{}</p></header>\n", escape(name), escape(about)));
    sheet.table(head, rows, usize::MAX);
    sheet.push("<h2>Residuals</h2>\n");
    sheet.help();
    for plot in plots {
        let (x, y) = (sheet.column(plot.times.clone(), None), sheet.column(plot.values.clone(), Some(5)));
        let mut chart = Chart::new(plot.title, plot.unit, "ms");
        chart.series.push(Series::line(plot.title, "c1", x, y));
        (chart.height, chart.least_span) = (220.0, plot.least_span);
        chart.x.group = Some("time".to_owned());
        sheet.chart(&chart);
    }
    sheet.finish()
}

fn write_page(dir: &Path, file: &str, found: &Identified) -> Result<(), BadInput> {
    let row = |(name, unit, of): (String, &str, Estimate)| {
        let verdict = if of.is_determined { "determined" } else { "not determined" };
        vec![name, number(of.value), number(of.low), number(of.high), unit.to_owned(), verdict.to_owned()]
    };
    let rows: Vec<Vec<String>> = found.figures().into_iter().map(row).collect();
    let plot = |title, unit, least_span, of: &[(f64, f64)]| {
        let (times, values) = of.iter().copied().unzip();
        Plot { title, unit, least_span, times, values }
    };
    let curves = [
        plot("bus current, measured less expected", "A", 0.1, &found.residuals.bus_a),
        plot("hall edges, boundary less expected place", "counts", 0.5, &found.residuals.edge_counts),
    ];
    let head = ["figure", "value", "low", "high", "unit", "95 %"];
    let html =
        plots("identify", &format!("{file}: figures with their 95 % intervals"), &head, &rows, &curves);
    write_folder(dir, &[(PAGE, html.as_bytes())])
}
