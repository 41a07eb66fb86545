//! `cargo xtask download`: a `.tek` file to a board over a CAN adapter. `tater_wire::download` is the
//! protocol; here are the file, the adapter, the clock and the user's output.

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

/// The arguments.
#[derive(clap::Args)]
pub struct DownloadArgs {
    /// The .tek file: `cargo xtask image` makes one
    file: PathBuf,
    /// The board: 1 to 3 links, 4 the spread, 5 to 7 tips
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=31))]
    node: u8,
    /// The adapter: SLCAN over TCP, such as what `hil-sim bus` prints
    #[arg(long, value_name = "HOST:PORT", required_unless_present = "can", conflicts_with = "can")]
    slcan: Option<String>,
    /// The adapter: a CAN interface of Linux, such as can0
    #[arg(long, value_name = "IFACE")]
    can: Option<String>,
}

impl DownloadArgs {
    /// For a file to a board by SLCAN.
    pub fn new(file: PathBuf, node: u8, slcan: &str) -> Self {
        Self { file, node, slcan: Some(slcan.to_owned()), can: None }
    }
}

/// Downloads a file.
///
/// # Errors
/// The file cannot be downloaded, the adapter cannot be used, or the board refused the file.
pub fn download(args: &DownloadArgs) -> Result<(), Failure> {
    let file = files::read(&args.file)?;
    let header = tek::sealed(&args.file, &file)?;
    let mut adapter: Box<dyn Adapter> = match (&args.slcan, &args.can) {
        (Some(address), _) => Box::new(slcan::Slcan::connect(address)?),
        (None, Some(interface)) => can::open(interface)?,
        // clap requires one.
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

/// Carries frames between the download and the adapter until it ends.
fn run(node: Node, file: &[u8], adapter: &mut dyn Adapter) -> Result<(), Failure> {
    let begun = Instant::now();
    let now = || u64::try_from(begun.elapsed().as_micros()).unwrap_or(u64::MAX);
    let mut host = Downloader::new(node, file, now());
    let bar = bar(host.progress().1);
    let end = loop {
        match host.next(now()) {
            Next::Send(frame) => adapter.send(&frame).map_err(Failure::Unusable)?,
            Next::Wait(until) => {
                let wait = Duration::from_micros(until.saturating_sub(now()).max(1));
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
    // Clear the line, so that later output is not appended to it.
    bar.finish_and_clear();
    end.map_err(|error: DownloadError| Failure::Judged(format!("node {}: {error}", node.number())))
}

/// Percent, rate, time left: on a terminal only.
fn bar(characters: u32) -> ProgressBar {
    if !io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(characters.into());
    set_style(&bar, "{percent:>3} % [{bar:40}] {rate} characters/s, {eta} left");
    // Shows that the board is still working.
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

fn set_style(bar: &ProgressBar, line: &str) {
    let rate = |state: &ProgressState, text: &mut dyn Write| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{:.0}", state.per_sec());
    };
    if let Ok(style) = ProgressStyle::with_template(line) {
        bar.set_style(style.with_key("rate", rate));
    }
}
