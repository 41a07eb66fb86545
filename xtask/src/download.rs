//! `cargo xtask download`: sends a `.tek` file to boards, over a CAN adapter or through a hand. `wraptor` does it; this module has the file,
//! the arguments and the progress bar.

use std::fmt::Write;
use std::io::{self, IsTerminal};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use wraptor::{Boards, Bus, CallError, Connect, ConnectError, DownloadProgress, Firmware, Hand, Node};

use crate::{Failure, files, tek};
use programs::output::warn;

/// Limit of a connection.
const CONNECT: Duration = Duration::from_secs(5);

/// Limit of one board: over a serial line at 9600 baud it takes some 4 minutes, and 25 character by character.
const LIMIT: Duration = Duration::from_secs(30 * 60);

/// Arguments of `download`.
#[derive(clap::Args)]
pub struct DownloadArgs {
    /// The .tek file, made by `cargo xtask image`
    file: PathBuf,
    /// The boards, one after the other: 1 to 3 links, 4 the spread, 5 to 7 tips; such as 4, 1-3 or 1,5
    #[arg(long, value_name = "NODES", value_parser = nodes)]
    node: Nodes,
    #[command(flatten)]
    way: Way,
}

#[derive(clap::Args)]
#[group(required = true, multiple = false)]
struct Way {
    /// A hand over TCP: through its GOD, to boards 1 to 7
    #[arg(long, value_name = "HOST:PORT")]
    host: Option<String>,
    /// A hand on a serial port, at 9600 baud
    #[cfg(unix)]
    #[arg(long, value_name = "PORT")]
    serial: Option<String>,
    /// A CAN adapter: SLCAN over TCP, as served by `hil-sim bus`
    #[arg(long, value_name = "HOST:PORT")]
    slcan: Option<String>,
    /// A CAN adapter: an interface of Linux, such as can0
    #[cfg(target_os = "linux")]
    #[arg(long, value_name = "IFACE")]
    can: Option<String>,
}

/// Baud rate of a hand's serial line unless its parameter BAUD says otherwise.
#[cfg(unix)]
const BAUD: u32 = 9600;

#[derive(Clone)]
struct Nodes(Vec<Node>);

/// Parses `4`, `1-3` or `1,5`.
fn nodes(text: &str) -> Result<Nodes, String> {
    let node = |text: &str| text.trim().parse().ok().filter(|node| (1..=31).contains(node));
    let mut nodes: Vec<u8> = Vec::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        let (Some(first), Some(last)) = (node(first), node(last)) else {
            return Err("expected nodes 1 to 31, such as 4, 1-3 or 1,5".into());
        };
        nodes.extend((first..=last).filter(|node| !nodes.contains(node)).collect::<Vec<u8>>());
    }
    match nodes.is_empty() {
        true => Err("expected a range that rises, such as 1-3".into()),
        false => Ok(Nodes(nodes.into_iter().filter_map(Node::new).collect())),
    }
}

enum Connected {
    Hand(Box<Hand>),
    Bus(Bus),
}

impl DownloadArgs {
    pub fn new(file: PathBuf, node: Node, slcan: &str) -> Self {
        let way = Way {
            host: None,
            #[cfg(unix)]
            serial: None,
            slcan: Some(slcan.to_owned()),
            #[cfg(target_os = "linux")]
            can: None,
        };
        Self { file, node: Nodes(vec![node]), way }
    }
}

impl Way {
    /// `None`: clap requires one of them.
    fn connect(&self) -> Option<Result<Connected, ConnectError>> {
        let hand = |connect: Connect| {
            connect.boards(Boards::Any).connect(CONNECT).map(Box::new).map(Connected::Hand)
        };
        if let Some(address) = &self.host {
            return Some(hand(Connect::tcp(address)));
        }
        #[cfg(unix)]
        if let Some(path) = &self.serial {
            return Some(hand(Connect::serial(path, BAUD)));
        }
        #[cfg(target_os = "linux")]
        if let Some(interface) = &self.can {
            return Some(Bus::can(interface).map(Connected::Bus));
        }
        self.slcan.as_ref().map(|address| Bus::slcan(address, CONNECT).map(Connected::Bus))
    }
}

/// # Errors
/// The file or the way to the boards cannot be used, or a board rejected the download.
pub fn download(args: &DownloadArgs) -> Result<(), Failure> {
    let firmware =
        Firmware::new(files::read(&args.file)?).map_err(|error| tek::defect(&args.file, &error))?;
    let connected = args.way.connect().map(|way| way.map_err(|error| Failure::Unusable(error.to_string())));
    let Some(connected) = connected else {
        return Err(Failure::Unusable(
            "found no way to the boards, expected --host, --slcan or --can".into(),
        ));
    };
    let mut connected = connected?;
    let header = firmware.header();
    for &node in &args.node.0 {
        warn(&format!(
            "node {}: version {}, {} bytes; ^C is harmless: the old application stays until the new one is whole",
            node.number(),
            header.version,
            header.len
        ));
        let begun = Instant::now();
        run(&mut connected, node, &firmware)?;
        warn(&format!(
            "node {}: version {} runs, after {:.1} s",
            node.number(),
            header.version,
            begun.elapsed().as_secs_f64()
        ));
    }
    if let Connected::Bus(bus) = &connected
        && bus.health().refusals > 0
    {
        warn(&format!("the adapter refused {} frames; each was sent again", bus.health().refusals));
    }
    Ok(())
}

fn run(connected: &mut Connected, node: Node, firmware: &Firmware) -> Result<(), Failure> {
    let bar = bar();
    let progress = &mut |progress: &DownloadProgress| {
        bar.set_length(progress.of.into());
        // Ticks show activity while the board is busy; a thread of the bar would panic where the system refuses it.
        bar.tick();
        bar.set_position(progress.characters.into());
        if progress.characters == progress.of {
            set_style(&bar, "100 % sent; the board copies and checks, {elapsed} since the start");
        }
        ControlFlow::Continue(())
    };
    let outcome = match connected {
        Connected::Hand(hand) => hand.download(&node.number().to_string(), firmware, LIMIT, progress),
        Connected::Bus(bus) => bus.download(node, firmware, LIMIT, progress),
    };
    // Removed, so that later text is not appended to it.
    bar.finish_and_clear();
    outcome.map_err(|error: CallError| match error.failure {
        // What the board says of the file or of itself.
        wraptor::Failure::Download { .. } => Failure::Judged(error.to_string()),
        _ => Failure::Unusable(error.to_string()),
    })
}

/// Progress bar with rate and remaining time; hidden unless standard error is a terminal.
fn bar() -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(0);
    set_style(&bar, "{percent:>3} % [{bar:40}] {rate} characters/s, {eta} left");
    bar
}

fn set_style(bar: &ProgressBar, line: &str) {
    let rate = |state: &ProgressState, text: &mut dyn Write| {
        // Writing to memory cannot fail.
        let _ = write!(text, "{:.0}", state.per_sec());
    };
    if let Ok(style) = ProgressStyle::with_template(line) {
        bar.set_style(style.with_key("rate", rate));
    }
}
