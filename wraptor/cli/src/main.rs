//! `wraptor`: the terminal program of a hand (docs/terminal.md).
#![forbid(unsafe_code)]

mod console;
mod drive;
mod entry;
mod input;
mod output;
mod tables;
mod trouble;
mod watch;

use std::io::Write;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::{Args, Parser, Subcommand};
use programs::interrupt;
use wraptor::discovery::{EVERYWHERE, MOST, PORT};
use wraptor::{Hand, discover};

use crate::console::Console;
use crate::entry::Way;
use crate::input::Input;
use crate::output::print;
use crate::trouble::Trouble;

/// Speaks with a hand: its language with help and completion, downloads, scripts.
#[derive(Parser)]
#[command(version, args_conflicts_with_subcommands = true)]
struct Arguments {
    #[command(subcommand)]
    task: Option<Task>,
    #[command(flatten)]
    console: ConsoleArgs,
}

#[derive(Subcommand)]
enum Task {
    /// List the hands in the network
    Discover(DiscoverArgs),
    /// Send a .tek file to boards, one after the other
    Download(DownloadArgs),
}

/// Without --connect, --serial and --can: the one hand that answers a search.
#[derive(Args)]
struct Place {
    /// The hand, over TCP
    #[arg(long, value_name = "HOST:PORT")]
    connect: Option<String>,
    /// The hand, on a serial port
    #[cfg(unix)]
    #[arg(long, value_name = "PORT", conflicts_with_all = ["connect", "can"])]
    serial: Option<String>,
    /// The hand's motor boards, by CAN without its GOD: an interface such as can0, or an SLCAN adapter, HOST:PORT or /dev/ttyACM0
    #[arg(long, value_name = "PLACE", conflicts_with = "connect")]
    can: Option<String>,
    /// Baud rate of the serial port (parameter BAUD)
    #[cfg(unix)]
    #[arg(long, default_value_t = entry::BAUD, requires = "serial", value_parser = clap::value_parser!(u32).range(600..=115_200))]
    baud: u32,
}

#[derive(Args)]
struct ConsoleArgs {
    #[command(flatten)]
    place: Place,
    /// Begin with the walk-through of the manual (3), as after the entry `walk`
    #[arg(long)]
    walk: bool,
    /// A file with an entry a line, instead of standard input; ends at the first error
    #[arg(long, value_name = "FILE")]
    script: Option<PathBuf>,
    /// Limit of an entry; then the hand is told to abort
    #[arg(long, value_name = "SECONDS", default_value_t = 120, value_parser = clap::value_parser!(u64).range(1..=86_400))]
    limit: u64,
}

#[derive(Args)]
struct DiscoverArgs {
    /// Addresses to ask instead, such as the broadcast address of another network
    #[arg(long, value_name = "IP[:PORT]", value_parser = address)]
    to: Vec<SocketAddrV4>,
    /// How long to listen
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=60))]
    seconds: u64,
    /// Print one JSON object and nothing else
    #[arg(long)]
    json: bool,
}

#[derive(Args)]
struct DownloadArgs {
    /// The .tek file, made by `cargo xtask image`
    file: PathBuf,
    /// Boards 1 to 7, such as 123
    #[arg(long, value_name = "NODES", value_parser = |text: &str| entry::boards("--node", text))]
    node: String,
    #[command(flatten)]
    place: Place,
}

fn address(text: &str) -> Result<SocketAddrV4, String> {
    let with_port = text.parse().ok();
    let ip = || text.parse::<Ipv4Addr>().ok().map(|ip| SocketAddrV4::new(ip, PORT));
    with_port.or_else(ip).ok_or_else(|| "expected an IPv4 address, such as 192.168.1.255".to_owned())
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    interrupt::handle();
    let outcome = match arguments.task {
        Some(Task::Discover(args)) => discovered(&args).map(|()| 0),
        Some(Task::Download(args)) => download(&args).map(|()| 0),
        None => console(&arguments.console),
    };
    match outcome {
        Ok(code) => code.into(),
        Err(trouble) => {
            // Nobody reads a standard error that is closed.
            let _ = writeln!(std::io::stderr(), "error: {trouble}");
            trouble.code().into()
        }
    }
}

fn console(args: &ConsoleArgs) -> Result<u8, Trouble> {
    let input = Input::open(args.script.as_deref())?;
    let hand = match find(&args.place) {
        Ok(hand) => Some(hand),
        // A person can connect to another one.
        Err(trouble) if input.is_typed() => {
            eprintln!("{trouble}");
            None
        }
        Err(trouble) => return Err(trouble),
    };
    Console::new(input, hand, Duration::from_secs(args.limit), args.walk).run()
}

fn discovered(args: &DiscoverArgs) -> Result<(), Trouble> {
    let to = if args.to.is_empty() { &EVERYWHERE[..] } else { &args.to };
    let found = discover(to, Duration::from_secs(args.seconds))?;
    let is_cut = found.len() >= MOST;
    if is_cut {
        eprintln!(
            "warning: {MOST} hands are listed, and more may have answered\n  next: ask a part of the network, with --to"
        );
    }
    if !args.json {
        return print(&console::list(&found));
    }
    let hand = |found: &wraptor::Found| serde_json::json!({ "address": found.address.to_string(), "hardware": console::hardware(found) });
    let hands: Vec<_> = found.iter().map(hand).collect();
    print(&format!("{}\n", serde_json::json!({ "hands": hands, "truncated": is_cut })))
}

fn download(args: &DownloadArgs) -> Result<(), Trouble> {
    let firmware = console::firmware(&args.file)?;
    console::download(&mut find(&args.place)?, &args.node, &firmware)
}

/// Connects to the given hand, or to the only one that answers a search.
fn find(place: &Place) -> Result<Hand, Trouble> {
    if let Some(address) = &place.connect {
        return console::connect(&Way::Tcp(address.clone()));
    }
    #[cfg(unix)]
    if let Some(path) = &place.serial {
        return console::connect(&Way::Serial(path.clone(), place.baud));
    }
    if let Some(place) = &place.can {
        return console::connect(&Way::Can(place.clone()));
    }
    match &discover(&EVERYWHERE, console::SEARCH)?[..] {
        [hand] => console::connect(&Way::Tcp(hand.address.to_string())),
        [] => Err(Trouble::Input(
            "found no hand, expected one that answers a search\n  next: --connect HOST:PORT, or start `hil-sim hand`".into(),
        )),
        several => Err(Trouble::Input(format!(
            "found several hands, expected one\n{}  next: choose one with --connect HOST:PORT",
            console::list(several)
        ))),
    }
}
