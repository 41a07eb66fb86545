//! `hil-sim bode`: a loop of the servo, or a recording, in; responses and margins out.

use std::error::Error;
use std::path::{Path, PathBuf};

use clap::{ValueEnum, value_parser};
use num_complex::Complex64;
use serde_json::{Map, Value};

use super::figures::{Figures, MotorArg};

use super::margins;
use super::open;
use super::output::{print, write_folder};
use hil_tuning::bode::{Loop, Setup, measure, page, scenario};
use hil_tuning::response::{FEWEST, Margins, Point, Response};
use hil_tuning::spectrum;
use programs::output::warn;
use tater_wire::MotorKind;
use traces::input::BadInput;
use traces::names::{MOTOR, clock_unit};
use traces::numbers::Numbers;

/// Relative standard deviation above which a line is left out: its phase is off by 20° and more.
const MOST_DEVIATION: f64 = 0.35;

/// Time between two rows of a motor's recording, ms. A scope's or a slow logger's is possible; a wrong unit is more likely.
const SENSIBLE_MS: std::ops::Range<f64> = 0.01..1000.0;

/// Share of ticks at a limit from which a loop is another one.
const MOST_LIMITED: f64 = 0.05;

/// The arguments of `hil-sim bode`.
#[derive(clap::Args)]
pub struct BodeArgs {
    /// The motor: link, spread or tip, or a file that describes another (docs/motor.md); default: link. Of a recording with several the one to
    /// take.
    #[arg(long, value_name = "MOTOR")]
    motor: Option<MotorArg>,
    /// The loop: position (mode 3) or velocity (mode 4).
    #[arg(long, value_enum, default_value_t = LoopName::Velocity)]
    mode: LoopName,
    /// Set a property of the servo, such as KPV=48; repeatable.
    #[arg(long, value_name = "PROPERTY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    figures: Figures,
    /// RMS of the excitation, counts of P or counts/s of V; default: 3 or 100.
    #[arg(long, value_name = "RMS", value_parser = amplitude)]
    amplitude: Option<f64>,
    /// Realizations of the excitation, of 10 s each.
    #[arg(long, default_value_t = 16, value_parser = value_parser!(u32).range(2..=1000))]
    realizations: u32,
    /// Seed of excitation and noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Take a recording instead of the servo: .csv, .mcap or .parquet with time_ms or time_s, or the folder of a run.
    #[arg(
        long, value_name = "TRACE", requires_all = ["input", "output"],
        conflicts_with_all = ["mode", "set", "plant", "rig", "supply", "amplitude", "realizations", "seed"]
    )]
    from: Option<PathBuf>,
    /// The recording's column that goes into the response: a name, or T, V or P.
    #[arg(long, value_name = "COLUMN", requires = "from")]
    input: Option<String>,
    /// The column that comes out.
    #[arg(long, value_name = "COLUMN", requires = "from")]
    output: Option<String>,
    /// The column that was injected, if input and output are in a closed loop.
    #[arg(long, value_name = "COLUMN", requires = "from")]
    reference: Option<String>,
    /// The response is that of a closed loop T, from set-point to output: the open loop is T/(1 - T).
    #[arg(long, requires = "from")]
    closed: bool,
    /// Factor of the open loop: what a proportional law makes of the recorded response.
    #[arg(long, requires = "from", conflicts_with = "closed", value_parser = amplitude)]
    gain: Option<f64>,
    /// Write frf.csv and bode.html into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum LoopName {
    /// Mode 3.
    Position,
    /// Mode 4.
    Velocity,
}

fn amplitude(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number > 0.0 && number <= 1000.0 => Ok(number),
        _ => Err("give a number above 0, 1000 at most, such as 3".to_owned()),
    }
}

/// A line of the open loop; deviations absolute.
struct Line {
    point: Point,
    noise: f64,
    nonlinear: f64,
    total: f64,
}

struct Found {
    title: String,
    lines: Vec<Line>,
    /// More keys of JSON.
    facts: Vec<(&'static str, Value)>,
    doubts: Vec<String>,
}

/// Measures, and prints the margins.
///
/// # Errors
/// Bad input, a recording that says nothing, or files that cannot be written.
pub fn bode(args: &BodeArgs) -> Result<bool, Box<dyn Error>> {
    let found = match &args.from {
        Some(path) => recorded(args, path)?,
        None => simulated(args)?,
    };
    let Found { title, lines, facts, doubts } = found;
    let all = lines.len();
    let lines: Vec<Line> =
        lines.into_iter().filter(|line| line.total <= MOST_DEVIATION * line.point.value.norm()).collect();
    let response = Response::new(lines.iter().map(|line| line.point).collect()).map_err(|_| {
        BadInput::new(title.clone(), "too few frequencies with a sure response")
            .found(format!("{} of {all}", lines.len()))
            .expected(format!("{FEWEST} at least"))
            .next("excite the loop more, and for longer")
    })?;
    let mut margins = response.margins();
    margins.doubts.extend(doubts);
    if lines.len() < all {
        let left_out = all - lines.len();
        margins
            .doubts
            .push(format!("{left_out} of {all} frequencies are left out: their response is not sure"));
    }
    margins::notes(&title, &margins);
    if let Some(dir) = &args.out {
        write_files(dir, &title, &lines, &response, &margins)?;
    }
    show(args, &title, &lines, &margins, facts)?;
    Ok(true)
}

fn show(
    args: &BodeArgs,
    title: &str,
    lines: &[Line],
    margins: &Margins,
    facts: Vec<(&'static str, Value)>,
) -> Result<(), BadInput> {
    let median = |of: fn(&Line) -> f64| {
        let mut all: Vec<f64> = lines.iter().map(|line| of(line) / line.point.value.norm()).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or_default()
    };
    let (noise, nonlinear) = (median(|line| line.noise), median(|line| line.nonlinear));
    let deviation = margins.crossover_hz.and_then(|hz| {
        let near = |line: &&Line| (line.point.hz / hz).ln().abs();
        let line = lines.iter().min_by(|a, b| near(a).total_cmp(&near(b)))?;
        Some((line.total / line.point.value.norm()).to_degrees())
    });
    if args.json {
        let mut object: Map<String, Value> = margins::json(margins);
        let levels = [
            ("noise_level", noise.into()),
            ("nonlinear_level", nonlinear.into()),
            ("phase_margin_std_deg", deviation.into()),
            ("points", lines.len().into()),
        ];
        object.extend(levels.into_iter().chain(facts).map(|(name, value)| (name.to_owned(), value)));
        return print(&format!("{}\n", Value::Object(object)));
    }
    let mut text = format!("{title}\n\n{}", margins::text(margins));
    text.push_str(&format!("{:<20} {noise:>10.4} of the loop\n", "noise_level"));
    text.push_str(&format!("{:<20} {nonlinear:>10.4} of the loop\n", "nonlinear_level"));
    if let Some(deviation) = deviation {
        text.push_str(&format!("{:<20} {deviation:>10.4} deg\n", "phase_margin_std_deg"));
    }
    if let Some(dir) = &args.out {
        text.push_str(&format!("\n{}\n{}\n", dir.join("bode.html").display(), dir.join("frf.csv").display()));
    }
    print(&text)
}

fn simulated(args: &BodeArgs) -> Result<Found, BadInput> {
    let (motor, motor_file) = args.motor.as_ref().map_or(Ok((MotorKind::Link, None)), MotorArg::read)?;
    let figures = Figures { motor_file, ..args.figures.clone() };
    let of = match args.mode {
        LoopName::Position => Loop::Position,
        LoopName::Velocity => Loop::Velocity,
    };
    let mode = of.name();
    let mut scenario = scenario(motor)?;
    figures.take_motor(&mut scenario)?;
    for assignment in &args.set {
        scenario.set(assignment)?;
    }
    figures.apply(&mut scenario)?;
    let amplitude = args.amplitude.unwrap_or_else(|| of.amplitude());
    let setup = Setup { of, amplitude, realizations: args.realizations, seed: args.seed };
    let measured = measure(&scenario, &setup)?;
    let lines = measured.open_loop.iter().map(|estimate| Line {
        point: Point { hz: estimate.hz, value: estimate.value },
        noise: estimate.noise,
        nonlinear: estimate.nonlinear,
        total: estimate.total,
    });
    let mut doubts = Vec::new();
    if measured.limited > MOST_LIMITED {
        let share = 100.0 * measured.limited;
        doubts.push(format!(
            "a limit held the torque in {share:.0} % of the ticks: choose a smaller --amplitude"
        ));
    }
    if measured.stops {
        doubts.push("the joint met its stop: choose a smaller --amplitude".to_owned());
    }
    let facts = vec![
        ("mode", mode.into()),
        ("amplitude", amplitude.into()),
        ("seed", args.seed.into()),
        ("realizations", args.realizations.into()),
        ("limited_share", measured.limited.into()),
        ("travel_counts", measured.travel.into()),
    ];
    let arguments = &scenario.arguments;
    let title = format!(
        "hil-sim {arguments} --mode {mode} --amplitude {amplitude} --realizations {} --seed {}",
        args.realizations, args.seed
    );
    Ok(Found { title, lines: lines.collect(), facts, doubts })
}

fn recorded(args: &BodeArgs, path: &Path) -> Result<Found, BadInput> {
    let table = open::numbers(path)?;
    let name = |name: &Option<String>| column(&table, name.as_deref().unwrap_or_default());
    let (input, output) = (name(&args.input)?, name(&args.output)?);
    let reference = if args.reference.is_some() { name(&args.reference)? } else { input };
    let rows = rows(args, &table, &[input, output, reference])?;
    let times = times_s(&table, &rows)?;
    let (input_name, output_name) = (table.name(input).to_owned(), table.name(output).to_owned());
    let signal = |column: usize| -> Result<Vec<f64>, BadInput> {
        let values: Result<Vec<f64>, BadInput> = rows.iter().map(|row| table.number(*row, column)).collect();
        Ok(spectrum::even(&times, &values?))
    };
    let (input, output, reference) = (signal(input)?, signal(output)?, signal(reference)?);
    let step_s = times.last().copied().unwrap_or_default() / (times.len() - 1) as f64;
    if !spectrum::is_even(&times) {
        warn(&format!(
            "note: {}: rows are not evenly sampled: the signals are read every {:.3} ms in between; the longest gap has {:.3} ms",
            path.display(),
            1e3 * step_s,
            1e3 * times.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
        ));
    }
    let is_setpoint = input_name.to_ascii_lowercase().contains("setpoint");
    if is_setpoint && !args.closed {
        warn(&format!(
            "note: {input_name} is a set-point: the response is a closed loop's, as with --closed"
        ));
    }
    let closed = args.closed || is_setpoint;
    let gain = args.gain.unwrap_or(1.0);
    let one = Complex64::new(1.0, 0.0);
    let lines = spectrum::response(step_s, &input, &output, &reference).into_iter().map(|line| {
        // dL = dT/(1 − T)² in a closed loop.
        let (value, factor) = if closed {
            let rest = one - line.value;
            (line.value / rest, rest.norm_sqr().recip())
        } else {
            (line.value * gain, gain)
        };
        let deviation = line.deviation * factor;
        let point = Point { hz: line.hz, value };
        Line { point, noise: deviation, nonlinear: 0.0, total: deviation }
    });
    let lines: Vec<Line> = lines.filter(|line| line.point.value.is_finite()).collect();
    let title = format!("{}: {input_name} to {output_name}", path.display());
    let response = if closed { "closed" } else { "open" };
    let facts =
        vec![("response", response.into()), ("input", input_name.into()), ("output", output_name.into())];
    Ok(Found { title, lines, facts, doubts: Vec::new() })
}

/// A column by its name, or by the property that it shows in a trace of `hil-sim run`.
fn column(table: &Numbers, name: &str) -> Result<usize, BadInput> {
    let property = match name.to_ascii_uppercase().as_str() {
        "T" => "torque_per_1024",
        "V" => "velocity_estimated_counts_s",
        "P" => "position_estimated_counts",
        _ => name,
    };
    table.need(&[name, property], "a column of the recording")
}

/// The rows of a recording that count: those of one motor with a number in each of the needed columns.
fn rows(args: &BodeArgs, table: &Numbers, needed: &[usize]) -> Result<Vec<usize>, BadInput> {
    let motor = table.find(&[MOTOR]);
    let kind = args.motor.as_ref().map(MotorArg::read).transpose()?;
    let node = kind.map(|(kind, _)| f64::from(kind.first_node()));
    let (mut rows, mut only, mut empty) = (Vec::new(), node, 0);
    for row in 0..table.len() {
        if let Some(column) = motor {
            let of = table.number(row, column)?;
            if node.is_none() && *only.get_or_insert(of) != of {
                let expected = "one motor: choose it with --motor link, --motor spread or --motor tip";
                return Err(table.bad(row, column, "the recording has several motors", expected));
            }
            if only != Some(of) {
                continue;
            }
        }
        // What is no number at all is an error later.
        if needed.iter().any(|column| matches!(table.maybe(row, *column), Ok(None))) {
            empty += 1;
        } else {
            rows.push(row);
        }
    }
    if empty > 0 {
        warn(&format!("note: {}: {empty} rows without a number are left out", table.place()));
    }
    if rows.len() < spectrum::FEWEST {
        return Err(table.bad_file(
            "too few rows".to_owned(),
            rows.len().to_string(),
            format!("{} at least", spectrum::FEWEST),
            "record for longer",
        ));
    }
    Ok(rows)
}

/// Times of those rows, s.
fn times_s(table: &Numbers, rows: &[usize]) -> Result<Vec<f64>, BadInput> {
    let column = table.need(&["time_ms", "time_s", "t_ms", "t_s"], "time_ms or time_s")?;
    let scale = if table.name(column).to_ascii_lowercase().ends_with("_ms") { 1e-3 } else { 1.0 };
    let times: Vec<f64> = rows.iter().map(|row| table.number(*row, column)).collect::<Result<_, _>>()?;
    let step = times[1] - times[0];
    if let Some(unit) = clock_unit(1e3 * scale, times[0], step) {
        let name = if scale < 1.0 { "milliseconds" } else { "seconds" };
        let expected = format!("{name}: these times are {unit} since 1970");
        return Err(table.bad(rows[0], column, "times in another unit", &expected));
    }
    // Sampling that is not even is read between the rows; where some are missing there is nothing to read.
    if let Some(at) = spectrum::unreadable(&times) {
        if times[at] <= times[at - 1] {
            let expected = "times in rising order, of one motor";
            return Err(table.bad(rows[at], column, "a time that is not above the one before", expected));
        }
        let problem = format!("a gap of {} after the row before", times[at] - times[at - 1]);
        let expected = format!("a row every {} or so: record it again", spectrum::step(&times));
        return Err(table.bad(rows[at], column, &problem, &expected));
    }
    let step_ms = 1e3 * scale * spectrum::step(&times);
    if !SENSIBLE_MS.contains(&step_ms) {
        warn(&format!(
            "note: {}: a row every {step_ms:e} ms: check that {} has the unit that its name says",
            table.place(),
            table.name(column)
        ));
    }
    // A clock's times lose their digits in f64 if they are scaled first.
    let first = times.first().copied().unwrap_or_default();
    Ok(times.iter().map(|time| (time - first) * scale).collect())
}

fn write_files(
    dir: &Path,
    title: &str,
    lines: &[Line],
    response: &Response,
    margins: &Margins,
) -> Result<(), BadInput> {
    let html = page::html(title, response, &margins::text(margins));
    write_folder(dir, &[("frf.csv", csv(lines).as_bytes()), ("bode.html", html.as_bytes())])
}

/// L with its deviations, T and S. `hil-sim margins` reads it.
fn csv(lines: &[Line]) -> String {
    let mut text =
        String::from("freq_hz,re,im,mag,phase_deg,noise,nonlinear,std,t_mag,t_phase_deg,s_mag,s_phase_deg\n");
    let one = Complex64::new(1.0, 0.0);
    for Line { point: Point { hz, value }, noise, nonlinear, total } in lines {
        let (t, s) = (value / (one + value), one / (one + value));
        text.push_str(&format!(
            "{hz},{},{},{},{}",
            value.re,
            value.im,
            value.norm(),
            value.arg().to_degrees()
        ));
        text.push_str(&format!(",{noise},{nonlinear},{total}"));
        for part in [t, s] {
            text.push_str(&format!(",{},{}", part.norm(), part.arg().to_degrees()));
        }
        text.push('\n');
    }
    text
}
