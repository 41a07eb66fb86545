//! `hil-sim sweep` and `hil-sim merge`: arguments, progress, and the lines that continue and reproduce a sweep.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::time::Duration;

use clap::value_parser;
use indicatif::{ProgressBar, ProgressStyle};

use super::output::{COMMIT, print, quoted};
use super::sweep_folder::{Header, Shard, Table, Tally, failed, free_bytes, merge as merge_folders};
use super::sweep_report;
use hil_experiment::motor_file::MotorFile;
use hil_experiment::scenario::{SHIPPED, Scenario};
use hil_tuning::sweep::{Flow, Sweep, execute};
use programs::interrupt;
use programs::output::warn;
use traces::input::BadInput;

/// Longest sweep file, bytes.
const MOST_BYTES: u64 = 1 << 20;

/// Threads: far more than any machine has cores.
const MOST_JOBS: u64 = 256;

/// Real time since the program started.
type Clock<'a> = &'a dyn Fn() -> Duration;

/// The arguments of `hil-sim sweep`.
#[derive(clap::Args)]
pub struct SweepArgs {
    /// What to vary, in which scenarios (docs/sweep.md).
    sweep: PathBuf,
    /// A motor that a file describes, in the place of each scenario's (docs/motor.md).
    #[arg(long, value_name = "FILE")]
    motor: Option<PathBuf>,
    /// A new folder for results.csv, results.parquet, sweep.json and report.html.
    #[arg(long, value_name = "DIR", required_unless_present_any = ["dry_run", "row"])]
    out: Option<PathBuf>,
    /// Threads; default: one for each core. They change no byte of the results.
    #[arg(long, value_parser = value_parser!(u64).range(1..=MOST_JOBS))]
    jobs: Option<u64>,
    /// Make only part i of n, for `hil-sim merge`.
    #[arg(long, value_name = "i/n")]
    shard: Option<Shard>,
    /// Continue what a sweep with the same arguments has left in DIR.
    #[arg(long)]
    resume: bool,
    /// Check the sweep, print the number of its runs, and run nothing.
    #[arg(long)]
    dry_run: bool,
    /// Print the line that makes run N of the table alone, and run nothing.
    #[arg(long, value_name = "N", conflicts_with = "dry_run")]
    row: Option<u64>,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
}

/// The arguments of `hil-sim merge`.
#[derive(clap::Args)]
pub struct MergeArgs {
    /// The folders of all shards of one sweep, in any order.
    #[arg(required = true, value_name = "DIR")]
    shards: Vec<PathBuf>,
    /// A new folder: the bytes are those of the sweep in one part.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts =
            text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
        match parts {
            Some((number, of)) if 1 <= number && number <= of => Ok(Self { number, of }),
            _ => Err("expected i/n with i from 1 to n, such as 2/8".to_owned()),
        }
    }
}

/// Makes the runs of a sweep. Returns whether each could be made.
///
/// # Errors
/// A bad sweep or folder, or a full disk.
pub fn sweep(args: &SweepArgs, clock: Clock) -> Result<bool, Box<dyn Error>> {
    let motor = args.motor.as_deref().map(MotorFile::read).transpose()?;
    let sweep = read(&args.sweep, motor)?;
    let shard = args.shard.unwrap_or(Shard::WHOLE);
    let header = Header::new(&sweep, shard);
    let runs = header.range().end - header.range().start;
    if let Some(row) = args.row {
        if row >= sweep.rows() {
            return Err(Box::new(
                BadInput::new(format!("--row {row}"), "the sweep has no such run")
                    .found(row.to_string())
                    .expected(format!("0 to {}", sweep.rows() - 1))
                    .next("take a number of the column index"),
            ));
        }
        let found = |name: &str| quoted(&found_at(&args.sweep, name));
        let line = sweep.line(&sweep.run(row), &found, &quoted);
        print(&if args.json {
            format!("{}\n", serde_json::json!({ "row": row, "line": line, "commit": COMMIT }))
        } else {
            format!("{line}\n")
        })?;
        return Ok(true);
    }
    let Some(out) = args.out.as_deref().filter(|_| !args.dry_run) else {
        let size = header.estimate_bytes();
        print(&if args.json {
            let json = serde_json::json!({
                "runs": runs, "shard": shard.to_string(), "sweep": header.sweep, "commit": COMMIT, "most_bytes": size as f64,
            });
            format!("{json}\n")
        } else {
            format!("{runs} runs, at most {}\n", bytes_text(size))
        })?;
        return Ok(true);
    };
    fits(&header, out)?;
    let mut table = Table::open(out, &header, args.resume)?;
    let first = table.next;
    interrupt::finish_first();
    let begun = clock();
    let whole = make_runs(args, &sweep, &header, &mut table)?;
    let wall_s = (clock() - begun).as_secs_f64();
    let (tally, made) = (table.tally, table.next - first);
    if !whole {
        table.flush().map_err(|e| stopped(args, &failed(out, &e)))?;
        warn(&format!(
            "interrupted: {} of {runs} runs are in {}; continue with\n  {}",
            tally.runs,
            out.join("results.csv").display(),
            line(args, true)
        ));
        return Ok(true);
    }
    table.finish(&header).map_err(|bad| stopped(args, &bad))?;
    if shard == Shard::WHOLE {
        sweep_report::write(out, &header).map_err(|bad| stopped(args, &bad))?;
    }
    report(args, out, &header, tally, (made, wall_s))?;
    Ok(tally.errors == 0)
}

/// Makes the runs that the table lacks. Returns whether all were made; not so after ^C.
fn make_runs(args: &SweepArgs, sweep: &Sweep, header: &Header, table: &mut Table) -> Result<bool, BadInput> {
    let (range, next) = (header.range(), table.next);
    let bar = (!args.json).then(|| bar(range.end - range.start, next - range.start));
    let jobs = args.jobs.map_or_else(cores, |jobs| jobs as usize);
    let mut error = None;
    let made = execute(sweep, next..range.end, jobs, COMMIT, &mut |_, line| {
        if let Err(e) = table.push(line) {
            error = Some(e);
            return Flow::Stop;
        }
        if let Some(bar) = &bar {
            bar.inc(1);
        }
        if interrupt::interrupted() { Flow::Stop } else { Flow::Continue }
    });
    if let Some(bar) = bar {
        bar.finish_and_clear();
    }
    let out = args.out.as_deref().unwrap_or(Path::new("."));
    match (error, made) {
        (Some(e), _) | (None, Err(e)) => Err(stopped(args, &failed(out, &e))),
        (None, Ok(whole)) => Ok(whole),
    }
}

/// An error that leaves a part of the results, and how to continue.
fn stopped(args: &SweepArgs, bad: &BadInput) -> BadInput {
    BadInput { next: format!("free space, then continue with: {}", line(args, true)), ..bad.clone() }
}

/// Progress on standard error, if that is a terminal.
fn bar(runs: u64, done: u64) -> ProgressBar {
    let bar = ProgressBar::new(runs);
    if let Ok(style) = ProgressStyle::with_template("{bar:40} {pos} of {len} runs, {per_sec}, {eta} left") {
        bar.set_style(style);
    }
    bar.set_position(done);
    bar.reset_eta();
    bar
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, Into::into)
}

/// Whether the table fits on the disk.
fn fits(header: &Header, out: &Path) -> Result<(), BadInput> {
    let (size, free) = (header.estimate_bytes(), free_bytes(out));
    match free {
        Some(free) if size > free => {
            Err(BadInput::new(format!("--out {}", out.display()), "the results may not fit on the disk")
                .found(format!("{} free", bytes_text(free)))
                .expected(format!(
                    "{} for {} runs",
                    bytes_text(size),
                    header.range().end - header.range().start
                ))
                .next("take fewer values or samples, use --shard, or choose a larger disk"))
        }
        _ => Ok(()),
    }
}

fn bytes_text(bytes: u128) -> String {
    match bytes {
        0..1_000_000 => format!("{} kB", bytes.div_ceil(1000)),
        1_000_000..1_000_000_000 => format!("{} MB", bytes.div_ceil(1_000_000)),
        _ => format!("{} GB", bytes.div_ceil(1_000_000_000)),
    }
}

fn read(path: &Path, motor: Option<MotorFile>) -> Result<Sweep, BadInput> {
    let bad = |problem: &str, found: String| {
        BadInput::new(path.display().to_string(), problem)
            .found(found)
            .expected("a sweep as TOML (docs/sweep.md)")
            .next("check the path")
    };
    let meta = path.metadata().map_err(|e| bad("cannot be read", e.to_string()))?;
    if !meta.is_file() || meta.len() > MOST_BYTES {
        return Err(bad("is no file of a sweep", format!("{} bytes", meta.len())));
    }
    let bytes = fs::read(path).map_err(|e| bad("cannot be read", e.to_string()))?;
    let text = String::from_utf8(bytes).map_err(|e| bad("is no text", e.to_string()))?;
    let name = path.display().to_string();
    Sweep::parse(&name, &text, motor, &mut |scenario| Scenario::text(&found_at(path, scenario)))
}

/// A scenario as `hil-sim run` finds it: shipped, or a file beside the sweep's, or any other.
fn found_at(sweep: &Path, name: &str) -> String {
    let beside = sweep.parent().map(|folder| folder.join(name)).filter(|path| path.is_file());
    match beside {
        Some(path) if SHIPPED.iter().all(|shipped| shipped.name != name) => path.display().to_string(),
        _ => name.to_owned(),
    }
}

/// The line of this sweep.
fn line(args: &SweepArgs, resumes: bool) -> String {
    let mut line = format!("hil-sim sweep {}", quoted(&args.sweep.display().to_string()));
    if let Some(motor) = &args.motor {
        line.push_str(&format!(" --motor {}", quoted(&motor.display().to_string())));
    }
    if let Some(out) = &args.out {
        line.push_str(&format!(" --out {}", quoted(&out.display().to_string())));
    }
    if let Some(shard) = args.shard {
        line.push_str(&format!(" --shard {shard}"));
    }
    if let Some(jobs) = args.jobs {
        line.push_str(&format!(" --jobs {jobs}"));
    }
    if resumes {
        line.push_str(" --resume");
    }
    line
}

fn report(
    args: &SweepArgs,
    out: &Path,
    header: &Header,
    tally: Tally,
    (made, wall_s): (u64, f64),
) -> Result<(), BadInput> {
    let files = files(out, header.shard);
    let runs_per_s = if wall_s > 0.0 { made as f64 / wall_s } else { 0.0 };
    if args.json {
        let json = serde_json::json!({
            "runs": tally.runs, "passed": tally.passed, "errors": tally.errors, "made": made, "wall_s": wall_s,
            "runs_per_s": runs_per_s, "shard": header.shard.to_string(), "sweep": header.sweep, "commit": COMMIT,
            "files": files, "reproduce": line(args, false),
        });
        return print(&format!("{json}\n"));
    }
    print(&format!(
        "{}\n{made} made in {wall_s:.1} s, {runs_per_s:.0} runs/s\n{}\nreproduce at commit {COMMIT}: {}\n",
        tally_text(tally),
        files.join("\n"),
        line(args, false)
    ))
}

fn tally_text(tally: Tally) -> String {
    let Tally { runs, passed, errors } = tally;
    let errors = match errors {
        0 => String::new(),
        errors => format!(", {errors} could not be made (column error)"),
    };
    format!("{runs} runs: {passed} met their expectations{errors}")
}

fn files(out: &Path, shard: Shard) -> Vec<String> {
    let names: &[&str] = if shard == Shard::WHOLE {
        &["results.csv", "results.parquet", "sweep.json", "report.html"]
    } else {
        &["results.csv", "sweep.json"]
    };
    names.iter().map(|name| out.join(name).display().to_string()).collect()
}

/// Merges shards.
///
/// # Errors
/// A shard is missing, incomplete, twice or of another sweep; the folder is not empty; a full disk.
pub fn merge(args: &MergeArgs) -> Result<bool, Box<dyn Error>> {
    let tally = merge_folders(&args.shards, &args.out)?;
    if let Some(header) = Header::read(&args.out)? {
        sweep_report::write(&args.out, &header)?;
    }
    let files = files(&args.out, Shard::WHOLE);
    if args.json {
        let json = serde_json::json!({
            "runs": tally.runs, "passed": tally.passed, "errors": tally.errors, "files": files,
        });
        print(&format!("{json}\n"))?;
    } else {
        print(&format!("{}\n{}\n", tally_text(tally), files.join("\n")))?;
    }
    Ok(tally.errors == 0)
}
