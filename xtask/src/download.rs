//! `cargo xtask download`: sends a `.tek` file to a board over a CAN adapter. The protocol is in
//! `tater_wire::download`; this module has the file, the adapter, the clock and the progress bar.

mod adapter;
mod can;
mod slcan;

use std::fmt::Write;
use std::io::{self, IsTerminal};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use tater_wire::Node;
use tater_wire::download::{DownloadError, Downloader, Next};

use crate::{Failure, files, tek};
use adapter::Adapter;

/// Longest time without a sign of life on the progress bar.
const TICK: Duration = Duration::from_millis(200);

/// Arguments of `download`.
#[derive(clap::Args)]
pub struct DownloadArgs {
    /// The .tek file, made by `cargo xtask image`
    file: PathBuf,
    /// The board: 1 to 3 links, 4 the spread, 5 to 7 tips
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=31))]
    node: u8,
    /// The adapter: SLCAN over TCP, as served by `hil-sim bus`
    #[arg(long, value_name = "HOST:PORT", required_unless_present = "can", conflicts_with = "can")]
    slcan: Option<String>,
    /// The adapter: a CAN interface of Linux, such as can0
    #[arg(long, value_name = "IFACE")]
    can: Option<String>,
}

impl DownloadArgs {
    pub fn new(file: PathBuf, node: u8, slcan: &str) -> Self {
        Self { file, node, slcan: Some(slcan.to_owned()), can: None }
    }
}

/// # Errors
/// The file or adapter cannot be used, or the board rejected the download.
pub fn download(args: &DownloadArgs) -> Result<(), Failure> {
    let file = files::read(&args.file)?;
    let header = tek::sealed(&args.file, &file)?;
    let mut adapter: Box<dyn Adapter> = match (&args.slcan, &args.can) {
        (Some(address), _) => Box::new(slcan::Slcan::connect(address)?),
        (None, Some(interface)) => can::open(interface)?,
        // clap requires one of them.
        (None, None) => return Err(Failure::Unusable("found no adapter, expected --slcan or --can".into())),
    };
    let node = Node::new(args.node).unwrap_or(Node::HOST);
    eprintln!(
        "node {}: version {}, {} bytes; ^C is harmless: the old application stays until the new one is whole",
        args.node, header.version, header.len
    );
    let begun = Instant::now();
    run(node, &file, adapter.as_mut())?;
    eprintln!(
        "node {}: version {} runs, after {:.1} s",
        args.node,
        header.version,
        begun.elapsed().as_secs_f64()
    );
    Ok(())
}

fn run(node: Node, file: &[u8], adapter: &mut dyn Adapter) -> Result<(), Failure> {
    let begun = Instant::now();
    let now = || u64::try_from(begun.elapsed().as_micros()).unwrap_or(u64::MAX);
    let mut host = Downloader::new(node, file, now());
    let bar = bar(host.progress().1);
    let end = loop {
        match host.next(now()) {
            Next::Send(frame) => adapter.send(&frame).map_err(Failure::Unusable)?,
            Next::Wait(until) => {
                // Ticks show activity while the board is busy; a thread of the bar would panic where the system refuses it.
                bar.tick();
                let wait = Duration::from_micros(until.saturating_sub(now()).max(1)).min(TICK);
                if let Some(frame) = adapter.receive(wait).map_err(Failure::Unusable)? {
                    host.receive(&frame, now());
                }
                bar.set_position(host.progress().0.into());
                if host.is_sent() {
                    set_style(&bar, "100 % sent; the board copies and checks, {elapsed} since the start");
                }
            }
            Next::Done => break Ok(()),
            Next::Failed(error) => break Err(error),
        }
    };
    // Removed, so that later text is not appended to it.
    bar.finish_and_clear();
    end.map_err(|error: DownloadError| Failure::Judged(format!("node {}: {error}", node.number())))
}

/// Progress bar with rate and remaining time; hidden unless standard error is a terminal.
fn bar(characters: u32) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(characters.into());
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
