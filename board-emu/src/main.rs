//! `board-emu`: runs a scenario of `hil-sim` on emulated boards, or serves a hand of them. `cargo xtask emu` builds the image and calls
//! it.
#![forbid(unsafe_code)]

use std::io::{IsTerminal, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use board_emu::board::Board;
use board_emu::gdb::{self, Server};
use board_emu::hand;
use board_emu::image::Programs;
use board_emu::rtt::Probe;
use board_emu::session::{self, Nodes};
use clap::Parser;
use hil_experiment::over_can::{Observer, OverCan, POLL_MS, Progress, gap, judge};
use hil_experiment::run::Options;
use hil_experiment::scenario::Scenario;
use hil_world::hand::Hand;
use hil_world::plant::Model;

mod print;

/// Runs a scenario of hil-sim on emulated boards over CAN: the flashed bytes, from erased flash. Exit code 1
/// if an expectation fails, 2 for bad input or a board that stops.
#[derive(Parser)]
#[command(version)]
struct Args {
    /// Folder written by `cargo xtask image`.
    #[arg(long, value_name = "DIR")]
    image: PathBuf,
    /// Number of boards, 1 to 7, or a range of nodes, such as 2-4.
    #[arg(long, default_value = "1")]
    nodes: Nodes,
    /// A shipped scenario (`hil-sim list`) or a TOML file.
    #[arg(long, value_name = "NAME", default_value = "spread-full-travel")]
    scenario: String,
    /// Print one JSON object, and nothing else, to standard output.
    #[arg(long)]
    json: bool,
    /// Wait for a GDB on this port of 127.0.0.1; it debugs the first board, and time stands still while that
    /// is stopped.
    #[arg(long, value_name = "PORT")]
    gdb: Option<u16>,
    /// Print the boards' defmt logs; needs an image of --profile release.
    #[arg(long)]
    rtt: bool,
    /// Poll period of the host for each board, ms; 0 polls MODE alone, ten times a second, at a lower load.
    #[arg(long, value_name = "MS", default_value_t = POLL_MS)]
    poll_ms: u32,
    /// Instead of a scenario: serve a hand of seven boards here, as fast as the machine can, to one host after another; port 0 picks a
    /// free one. Prints `gcl HOST:PORT`. ^C ends it.
    #[arg(long, value_name = "HOST:PORT", conflicts_with_all = ["nodes", "scenario", "json", "gdb", "rtt", "poll_ms"])]
    listen: Option<String>,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let ended = match &args.listen {
        Some(address) => serve(&args.image, address),
        None => emulate(&args),
    };
    match ended {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(1),
        Err(error) => {
            clear();
            tell(&format!("error: {error}"));
            ExitCode::from(2)
        }
    }
}

/// Serves a hand; ends with an error alone.
fn serve(image: &Path, address: &str) -> Result<bool, String> {
    let wrong = |error: std::io::Error| {
        format!(
            "--listen {address}: {error}\n  next: give a free address of this machine, such as 127.0.0.1:11001"
        )
    };
    let mut hand = Hand::with(hand::boards(&Programs::load(image)?), Default::default());
    let listener = TcpListener::bind(address).map_err(wrong)?;
    let line = format!("gcl {}\n", listener.local_addr().map_err(wrong)?);
    std::io::stdout()
        .lock()
        .write_all(line.as_bytes())
        .map_err(|error| format!("standard output: {error}"))?;
    hand::serve(&listener, &mut hand).map_err(wrong)?;
    Ok(true)
}

/// Returns whether all expectations were met.
fn emulate(args: &Args) -> Result<bool, String> {
    let scenario = Scenario::find(&args.scenario).map_err(|bad| bad.to_string())?;
    let programs = Programs::load(&args.image)?;
    let options = Options { seed: 1, model: Model::Averaged, trace: false };
    let begun = Instant::now();
    let clock = || begun.elapsed().as_secs_f64();
    let elf = args.rtt.then(|| args.image.join("tater.elf"));
    let mut debugger = args.gdb.map(gdb::listen).transpose()?;
    let mut attach = |host: &mut OverCan<Board>| {
        let probes = probes(elf.as_deref(), host)?;
        host.observe(observer(begun, probes));
        match debugger.take() {
            Some(listener) => debug(&listener, host),
            None => Ok(()),
        }
    };
    let session =
        session::run(&scenario, args.nodes, &programs, &options, (args.poll_ms, true), &mut attach, &clock)?;
    let wall_s = begun.elapsed().as_secs_f64();
    clear();
    let (outcome, gaps) = judge(&scenario, &session.ran, &options, args.poll_ms);
    let known =
        |name: &str| hil_experiment::metrics::find(name).is_none_or(|m| gap(m, args.poll_ms).is_none());
    let told = print::Told { outcome: &outcome, session: &session, gaps: &gaps, wall_s, known: &known };
    let text = if args.json { told.json() } else { told.text() };
    programs::output::print(&text).map_err(|error| format!("standard output: {error}"))?;
    Ok(outcome.passed())
}

fn probes(elf: Option<&Path>, host: &OverCan<Board>) -> Result<Vec<Probe>, String> {
    let elf = elf.into_iter();
    elf.flat_map(|elf| host.bus().stations().map(move |_| Probe::new(elf))).collect()
}

fn debug(listener: &TcpListener, host: &mut OverCan<Board>) -> Result<(), String> {
    let address = listener.local_addr().map_err(|error| format!("--gdb: {error}"))?;
    let symbols = "target/image/PROFILE/tater.elf";
    tell(&format!("waiting for: gdb-multiarch {symbols} -ex 'target remote {address}'"));
    let Some(board) = host.bus_mut().station_mut(0) else { return Ok(()) };
    let mut server = Server::accept(listener, board)?;
    board.set_runner(Box::new(move |board, until| server.run(board, until)));
    Ok(())
}

fn observer(begun: Instant, mut probes: Vec<Probe>) -> Observer<Board> {
    let mut told_s = 0;
    Box::new(move |bus, Progress { what, done, of }| {
        let now_us = bus.now_us();
        for (index, probe) in probes.iter_mut().enumerate() {
            let Some(board) = bus.station_mut(index) else { continue };
            let node = board.node().number();
            for line in probe.read(board.machine_mut().chip_mut()) {
                clear();
                tell(&format!("{:11.6} s node {node}: {line}", now_us as f64 * 1e-6));
            }
        }
        let now_s = begun.elapsed().as_secs();
        if now_s > told_s && std::io::stderr().is_terminal() {
            told_s = now_s;
            let _ = write!(std::io::stderr(), "\r\x1b[K{what} {} %", 100 * done / of.max(1));
        }
    })
}

/// A failed write to standard error cannot be reported.
fn tell(line: &str) {
    let _ = writeln!(std::io::stderr(), "{line}");
}

fn clear() {
    if std::io::stderr().is_terminal() {
        let _ = write!(std::io::stderr(), "\r\x1b[K");
    }
}
