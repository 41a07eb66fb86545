//! `board-emu`: runs a scenario of `hil-sim` on emulated boards. A thin shell; `cargo xtask emu` makes the image and calls it.
#![forbid(unsafe_code)]

use std::io::{ErrorKind, IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use board_emu::board::Board;
use board_emu::image::Programs;
use board_emu::session::{self, Nodes};
use clap::Parser;
use hil_sim::over_can::{POLL_MS, Progress, Watcher, gap, judge};
use hil_sim::scenario::Scenario;
use hil_sim::{Model, Options};

mod print;

/// Runs a scenario of hil-sim on emulated boards, over CAN only: the bytes that are flashed, from erased flash on. Exit code 1 if
/// an expectation fails, 2 for bad input or a board that stops.
#[derive(Parser)]
#[command(version)]
struct Args {
    /// What `cargo xtask image` has written.
    #[arg(long, value_name = "DIR")]
    image: PathBuf,
    /// How many boards, 1 to 7, or which nodes, such as 2-4.
    #[arg(long, default_value = "1")]
    nodes: Nodes,
    /// A shipped scenario (see `hil-sim list`) or a TOML file.
    #[arg(long, value_name = "NAME", default_value = "spread-full-travel")]
    scenario: String,
    /// Print one JSON object and nothing else.
    #[arg(long)]
    json: bool,
    /// How often the host polls, ms; 0: MODE alone, ten times a second, which tells less and loads the board less.
    #[arg(long, value_name = "MS", default_value_t = POLL_MS)]
    poll_ms: u32,
}

fn main() -> ExitCode {
    match emulate(&Args::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            let _ = writeln!(std::io::stderr(), "error: {error}");
            ExitCode::from(2)
        }
    }
}

/// Returns whether all expectations were met.
fn emulate(args: &Args) -> Result<bool, String> {
    let scenario = Scenario::find(&args.scenario).map_err(|bad| bad.to_string())?;
    let programs = Programs::load(&args.image)?;
    let options = Options { seed: 1, model: Model::Averaged, trace: false };
    let begun = Instant::now();
    let clock = || begun.elapsed().as_secs_f64();
    let mut watcher = || Some(watcher(begun));
    let session =
        session::run(&scenario, args.nodes, &programs, &options, args.poll_ms, &mut watcher, &clock)?;
    let wall_s = begun.elapsed().as_secs_f64();
    clear();
    let (outcome, gaps) = judge(&scenario, &session.ran, &options, args.poll_ms);
    let known = |name: &str| hil_sim::metrics::find(name).is_none_or(|m| gap(m, args.poll_ms).is_none());
    let told = print::Told { outcome: &outcome, session: &session, gaps: &gaps, wall_s, known: &known };
    let text = if args.json { told.json() } else { told.text() };
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        // That nobody reads on is no error of ours.
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(format!("standard output: {error}")),
        _ => Ok(outcome.passed()),
    }
}

/// Tells of progress, on a terminal only.
fn watcher(begun: Instant) -> Watcher<Board> {
    let mut told_s = 0;
    Box::new(move |_, Progress { what, done, of }| {
        let now_s = begun.elapsed().as_secs();
        if now_s > told_s && std::io::stderr().is_terminal() {
            told_s = now_s;
            let _ = write!(std::io::stderr(), "\r\x1b[K{what} {} %", 100 * done / of.max(1));
        }
    })
}

fn clear() {
    if std::io::stderr().is_terminal() {
        let _ = write!(std::io::stderr(), "\r\x1b[K");
    }
}
