//! The command line of `hil-sim`: arguments in, files and text out.

use std::error::Error;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use clap::{Parser, Subcommand, ValueEnum};
use hil_experiment::recorded::SPEED_MAX;
use tater_wire::MotorKind;

use super::apply::{self, ApplyArgs};
use super::bode::{self, BodeArgs};
use super::compare::{self, CompareArgs};
use super::convert::{self, ConvertArgs};
use super::excite::{self, ExciteArgs};
use super::export::{self, ExportArgs};
use super::figures::Figures;
use super::gcl::{self, GclArgs};
use super::identify::{self, IdentifyArgs};
use super::log::{self, LogArgs};
use super::margins::{self, MarginsArgs};
use super::output::{COMMIT, is_same_file, print, write_folder};
use super::serve::{self, BusArgs, HandArgs};
use super::sweep::{self, MergeArgs, SweepArgs};
use super::thread;
use super::torture::{self, TortureArgs};
use super::tune::{self, TuneArgs};
use super::worker;
use hil_experiment::events::{self, Event};
use hil_experiment::folder;
use hil_experiment::motor_file::MotorFile;
use hil_experiment::replay::{Replayed, Tally, replay};
use hil_experiment::report;
use hil_experiment::run::{Options, Outcome, run as simulate};
use hil_experiment::scenario::{FIGURES, SHIPPED, Scenario};
use hil_world::plant::Model;
use programs::files;
use programs::interrupt;
use programs::output::warn;
use traces::input::BadInput;

/// Period of the sign of life.
const TICK: Duration = Duration::from_millis(100);

/// Simulates the servo of a robot hand's motor board in closed loop with its motor.
#[derive(Parser)]
#[command(version)]
struct Args {
    #[command(subcommand)]
    command: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Run a scenario and check its expectations. Exit code 1 if one fails, 2 for bad input.
    Run(RunArgs),
    /// Compare runs or recordings: a table of differences, and with --out a page with their curves on the same axes.
    Compare(CompareArgs),
    /// List the shipped scenarios, or the figures that `run` can override.
    List(ListArgs),
    /// Serve boards on a CAN bus in real time, for CAN tools. Stop with ^C.
    Bus(BusArgs),
    /// Serve a whole hand in real time, for its hosts. Stop with ^C.
    Hand(HandArgs),
    /// Type Grasper Control Language at a simulated hand, as fast as possible. Exit code 1 if a line ends in an error.
    Gcl(GclArgs),
    /// Torture the whole hand with random programs and faults, and check its invariants. Exit code 1 if one fails. ^C begins no new
    /// seed and prints the results so far, with exit code 130; a second ^C ends at once.
    Torture(TortureArgs),
    /// Measure the response of a position or velocity loop, or of a recording; its margins, noise and nonlinearity.
    Bode(BodeArgs),
    /// Margins of an open loop from its frequency response.
    Margins(MarginsArgs),
    /// Convert a trace between CSV, MCAP and Parquet, by the files' extensions.
    Convert(ConvertArgs),
    /// Record a live board over its bus into a trace. ^C ends it and keeps the file.
    Log(LogArgs),
    /// Tune properties on an ensemble of plants. Exit code 1 if the result breaks a limit on a plant that the search has not seen. ^C ends
    /// the search and keeps the best so far.
    Tune(TuneArgs),
    /// Export a result of `tune` that passed its validation, as the file that `apply` takes.
    Export(ExportArgs),
    /// Write tuned values to boards on all boards or none, read back and stored; --undo takes them back. Exit code 1 if a board does not take
    /// them, 2 if nothing was written.
    Apply(ApplyArgs),
    /// Run scenarios over sets of parameters, with the results as CSV and Parquet. Exit code 1 if a run could not be made. ^C keeps
    /// what is done and prints the line that continues it, with exit code 130.
    Sweep(SweepArgs),
    /// Merge the shards of a sweep.
    Merge(MergeArgs),
    /// Run one JSON job for each line of standard input, and print one JSON result for each, in order.
    Worker,
    /// Identify a motor from a recorded move: resistance, EMF, inertia, friction, delay and hall placement, with 95 % intervals. Exit
    /// code 1 if the move does not determine all of them.
    Identify(IdentifyArgs),
    /// Record the move that `identify` needs, on a simulated or a real board over its bus. ^C idles the motor, with exit code 130.
    Excite(ExciteArgs),
    /// Replay recorded hall lines through the servo's decoder and estimator.
    ReplayHalls(ReplayArgs),
}

#[derive(clap::Args)]
struct ReplayArgs {
    /// Samples of three bytes: 0x5A, then the hall code as a little-endian word; may be gzipped.
    capture: PathBuf,
    /// Hall counts per motor revolution.
    #[arg(long, default_value_t = 90)]
    counts_per_rev: u32,
    /// Sample rate, 1/s.
    #[arg(long, default_value_t = 30_000)]
    rate_hz: u32,
    /// Output file: one `position,velocity` line per sample but the last, in counts and counts/s.
    #[arg(long, value_name = "OUT")]
    csv: PathBuf,
}

#[derive(clap::Args)]
struct ListArgs {
    /// Name each figure of the plant, its sensors and its supply, with unit and source.
    #[arg(long)]
    plant: bool,
}

#[derive(clap::Args)]
struct RunArgs {
    /// A shipped scenario (see `hil-sim list`) or a TOML file.
    scenario: String,
    /// Set a property of the servo, such as KP=120; repeatable.
    #[arg(long, value_name = "PROPERTY=VALUE")]
    set: Vec<String>,
    /// A motor that a file describes, in the place of the scenario's (docs/motor.md).
    #[arg(long, value_name = "FILE")]
    motor: Option<PathBuf>,
    #[command(flatten)]
    figures: Figures,
    /// Write trace.csv, run.json and report.html into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
    /// Seed of noise and scatter.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Model of the inverter.
    #[arg(long, value_enum, default_value_t = ModelName::Averaged)]
    model: ModelName,
}

#[derive(Clone, Copy, ValueEnum)]
enum ModelName {
    /// Means over the PWM period.
    Averaged,
    /// Every switching instant.
    Switched,
}

/// Real time since the program started.
pub type Clock<'a> = &'a dyn Fn() -> Duration;

/// Runs the program with the process's arguments. Returns its exit code: 1 if an expectation failed or a line ended in an
/// error, 2 for bad input, 130 after ^C.
pub fn run(clock: Clock) -> ExitCode {
    ExitCode::from(execute(std::env::args_os(), clock))
}

/// Runs one command line, the program's name included, as [`run`] does. Returns the exit code.
pub fn execute(line: impl IntoIterator<Item: Into<OsString> + Clone>, clock: Clock) -> u8 {
    let args = match Args::try_parse_from(line) {
        Ok(args) => args,
        Err(error) => {
            // As clap itself does: help goes to standard output, and a closed one is no error.
            let _ = error.print();
            return u8::try_from(error.exit_code()).unwrap_or(2);
        }
    };
    // 64 bits of microseconds last for the life of the process, so a service never ends by itself.
    let mut clock_us = || u64::try_from(clock().as_micros()).ok();
    let done = match args.command {
        Task::Run(args) => run_scenario(&args, clock),
        Task::List(args) => {
            print(&if args.plant { figures() } else { list() }).map(|()| true).map_err(Into::into)
        }
        Task::Compare(args) => compare::compare(&args).map(|()| true),
        Task::Bus(args) => serve::bus(&args, &mut clock_us).map(|()| true),
        Task::Hand(args) => serve::hand(&args, &mut clock_us).map(|()| true),
        Task::Gcl(args) => gcl::gcl(&args, clock),
        Task::Torture(args) => torture::torture(&args, clock),
        Task::Bode(args) => bode::bode(&args),
        Task::Margins(args) => margins::margins(&args),
        Task::Convert(args) => convert::convert(&args).map(|()| true).map_err(Into::into),
        Task::Log(args) => log::log(&args, clock).map(|()| true),
        Task::Tune(mut args) => tune::tune(&mut args, clock),
        Task::Export(args) => export::export(&args).map(|()| true),
        Task::Apply(args) => apply::apply(&args, clock),
        Task::Sweep(args) => sweep::sweep(&args, clock),
        Task::Merge(args) => sweep::merge(&args),
        Task::Worker => worker::worker(),
        Task::Identify(args) => identify::identify(&args),
        Task::Excite(args) => excite::excite(&args, clock),
        Task::ReplayHalls(args) => replay_halls(&args),
    };
    match done {
        Ok(_) if interrupt::interrupted() => interrupt::CODE,
        Ok(true) => 0,
        Ok(false) => 1,
        Err(bad) => {
            warn(&format!("error: {bad}"));
            2
        }
    }
}

fn list() -> String {
    let mut text = String::new();
    for shipped in SHIPPED {
        let about = Scenario::parse(shipped.file, shipped.text).map(|s| s.about).unwrap_or_default();
        text.push_str(&format!("{:<24} {about}\n", shipped.name));
    }
    text
}

/// The figures: option, name, word, value of each kind of motor, unit and source.
fn figures() -> String {
    let kinds = [MotorKind::Link, MotorKind::Spread, MotorKind::Tip];
    let mut text = String::new();
    for figure in &FIGURES {
        let mut values: Vec<String> = kinds.map(|kind| figure.nominal(kind).to_string()).into();
        values.dedup();
        let (name, value) = (format!("--{} {}", figure.option, figure.name), values.join(", "));
        let word = if figure.word == figure.name { String::new() } else { format!(" (or {})", figure.word) };
        text.push_str(&format!(
            "{:<44} {value} {}: {}\n",
            format!("{name}{word}"),
            figure.unit,
            figure.source
        ));
    }
    text.push_str("\nThree values are those of a link, the spread and a tip. NAME=1.3x multiplies.\n");
    text
}

fn run_scenario(args: &RunArgs, clock: Clock) -> Result<bool, Box<dyn Error>> {
    let mut scenario = Scenario::find(&args.scenario)?;
    if let Some(path) = &args.motor {
        scenario.take_motor(&MotorFile::read(path)?)?;
    }
    for assignment in &args.set {
        scenario.set(assignment)?;
    }
    args.figures.apply(&mut scenario)?;
    let model = match args.model {
        ModelName::Averaged => Model::Averaged,
        ModelName::Switched => Model::Switched,
    };
    let options = Options { seed: args.seed, model, trace: args.out.is_some() };
    let spinner = spinner(&scenario);
    let begun = clock();
    let outcome = simulate(&scenario, &options).map_err(|e| {
        BadInput::new(args.scenario.clone(), format!("{} is out of range", e.field))
            .found(e.found.to_string())
            .expected(e.expected.clone())
            .next("correct the scenario")
    })?;
    let wall_s = (clock() - begun).as_secs_f64();
    drop(spinner);
    if let Some(dir) = &args.out {
        write_files(dir, &scenario, &outcome)?;
    }
    if args.json {
        print(&format!("{}\n", report::json(&outcome, wall_s)))?;
    } else {
        print(&report::text(&outcome, wall_s))?;
        if let Some(dir) = &args.out {
            print(&format!(
                "\n{}\n{}\n",
                dir.join("report.html").display(),
                dir.join("trace.csv").display()
            ))?;
        }
    }
    if !outcome.passed() {
        let events: Vec<Event> = outcome.runs.iter().flat_map(|run| run.events.clone()).collect();
        warn(events::text(&events).trim_end());
    }
    Ok(outcome.passed())
}

/// A sign of life on standard error; dropping it ends it.
fn spinner(scenario: &Scenario) -> Option<Sender<()>> {
    let total_ms = u64::from(scenario.duration_ms) * scenario.cases.len() as u64;
    // At 100 times real time (the switched model) this is a second.
    if total_ms < 100_000 {
        return None;
    }
    let (alive, ended) = channel();
    // A thread of ours: that of the progress bar would panic where the system refuses it.
    let shown = thread::start(move || {
        let spinner = indicatif::ProgressBar::new_spinner();
        spinner.set_message(format!("simulating {} s", total_ms / 1000));
        while ended.recv_timeout(TICK) == Err(RecvTimeoutError::Timeout) {
            spinner.tick();
        }
        spinner.finish_and_clear();
    });
    shown.ok().map(|()| alive)
}

fn write_files(dir: &Path, scenario: &Scenario, outcome: &Outcome) -> Result<(), BadInput> {
    let files = folder::files(scenario, outcome, COMMIT);
    write_folder(dir, &files.each_ref().map(|(name, bytes)| (*name, bytes.as_slice())))
}

fn replay_halls(args: &ReplayArgs) -> Result<bool, Box<dyn Error>> {
    if is_same_file(&args.csv, &args.capture) {
        return Err(Box::new(
            BadInput::new(
                format!("--csv {}", args.csv.display()),
                "the estimate would overwrite the recording",
            )
            .found(format!("the same file as {}", args.capture.display()))
            .expected("a file of its own for the estimate")
            .next("choose another path"),
        ));
    }
    let mut csv = Vec::new();
    let replayed = replay(&args.capture, args.counts_per_rev, args.rate_hz, &mut csv)?;
    files::replace(&args.csv, &csv).map_err(|e| {
        BadInput::new(format!("--csv {}", args.csv.display()), "cannot be written")
            .found(e.to_string())
            .expected("a file in an existing folder")
            .next("choose another path or free space")
    })?;
    for warning in warnings(&replayed) {
        warn(&format!("warning: {}: {warning}", args.capture.display()));
    }
    Ok(true)
}

/// What is doubtful about a replay, one line each.
fn warnings(replayed: &Replayed) -> Vec<String> {
    let Replayed { samples, bad, dropped, impossible, saturated } = replayed;
    let mut all = Vec::new();
    if *bad > 0 {
        all.push(format!("{bad} of {samples} samples do not begin with 0x5A; their codes were used anyway"));
    }
    if dropped.count > 0 {
        let Tally { count, first } = dropped;
        all.push(format!("{count} bytes that belong to no sample were dropped, the first at byte {first}"));
    }
    if impossible.count > 0 {
        let Tally { count, first } = impossible;
        all.push(format!(
            "{count} of {samples} samples have the impossible code 0 or 7, or other bits set; the first is line {first}"
        ));
    }
    if saturated.count > 0 {
        let Tally { count, first } = saturated;
        all.push(format!(
            "{count} of {samples} velocities are at the estimator's limit of {} counts/s, so their true speed is unknown; the first is \
             line {first}; check --rate-hz",
            SPEED_MAX.0
        ));
    }
    all
}
