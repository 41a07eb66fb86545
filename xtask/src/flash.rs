//! `cargo xtask flash`: writes monitor and application to a board through a debug probe, and optionally its
//! node number and the kind of its motor. Drives the probe with probe-rs 0.29 or later.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use tater_f103::map::STORAGE;
use tater_wire::image::Crc32;

use crate::image::{self, Profile};
use crate::program::{program, run, succeeds, target, typed};
use crate::{Failure, files};
use programs::output::warn;

const CHIP: &str = "STM32F103CB";

/// How to install probe-rs, from <https://probe.rs>, with its Debian packages.
pub const INSTALL: &str = "cargo install probe-rs-tools --locked";

/// Arguments of `flash`.
#[derive(clap::Args)]
pub struct FlashArgs {
    /// The probe, if there are several: VID:PID or VID:PID:SERIAL, as listed by `probe-rs list`
    #[arg(long, value_name = "SELECTOR")]
    probe: Option<String>,
    /// Store the board's number (property ID), whatever its straps are; other stored properties stay
    #[arg(long, value_parser = node)]
    node: Option<u8>,
    /// Store the kind of its motor (property KIND), whatever its straps and its number are
    #[arg(long, value_enum)]
    kind: Option<Kind>,
    /// The motor is not wired as shipped: store no wiring, so that FIND must learn it. Otherwise the standard wiring is stored, unless
    /// the board has one
    #[arg(long)]
    rewired: bool,
    /// With log strings or without
    #[arg(long, value_enum, default_value = "production")]
    profile: Profile,
}

#[derive(Clone, Copy, clap::ValueEnum)]
enum Kind {
    Link = 1,
    Spread = 2,
    Tip = 3,
}

/// A hand's node: alone, or beside an arm.
fn node(text: &str) -> Result<u8, String> {
    let hand = |node: &u8| matches!(node, 1..=7 | 11..=17);
    text.parse()
        .ok()
        .filter(hand)
        .ok_or_else(|| "expected 1 to 7, or 11 to 17 for a hand beside an arm".into())
}

/// # Errors
/// probe-rs is missing, the images cannot be built, or flashing failed.
pub fn flash(args: &FlashArgs) -> Result<(), Failure> {
    if !succeeds("probe-rs --version") {
        return Err(Failure::Unusable(format!(
            "found no program probe-rs, expected it to drive the debug probe\n  install it: {INSTALL}\n  (on Debian and \
             Ubuntu before: apt-get install pkg-config libudev-dev cmake; other ways: https://probe.rs)"
        )));
    }
    let images = image::build(args.profile)?;
    // Read the storage first: a running application writes counters, a new monitor prepares the pages.
    let node = args.node.map(|node| format!("ID={node}"));
    let kind = args.kind.map(|kind| format!("KIND={}", kind as u8));
    let wiring = if args.rewired { "WIRING=0" } else { "WIRING?=2" };
    let values: Vec<String> = node.into_iter().chain(kind).chain([wiring.to_owned()]).collect();
    let storage = stored(args, &values)?;
    for elf in [&images.monitor, &images.tater] {
        let mut download = probe(args, "download");
        download.arg("--verify").arg(elf);
        reach(download)?;
    }
    if let Some(storage) = storage {
        let mut download = probe(args, "download");
        download.args(["--verify", "--binary-format", "bin", "--base-address"]);
        download.arg(format!("{:#010x}", STORAGE.start)).arg(storage);
        reach(download)?;
    }
    reach(probe(args, "reset"))?;
    let number = args.node.map_or_else(String::new, |node| format!(" as node {node}"));
    warn(&format!("flashed; the board waits in its monitor{number} for SET STAT 2"));
    Ok(())
}

fn probe(args: &FlashArgs, what: &str) -> Command {
    let mut command = program(&format!("probe-rs {what} --chip {CHIP}"));
    if let Some(selector) = &args.probe {
        command.args(["--probe", selector]);
    }
    command
}

fn reach(command: Command) -> Result<(), Failure> {
    run(command).map_err(|error| {
        Failure::Judged(format!(
            "probe-rs: {error}\n  next: see that the board has power and the probe is connected (`probe-rs list`)"
        ))
    })
}

/// A file with the board's storage and these properties; `None` if the board has them already.
fn stored(args: &FlashArgs, values: &[String]) -> Result<Option<PathBuf>, Failure> {
    let folder = target().join("flash");
    fs::create_dir_all(&folder)
        .map_err(|error| Failure::Unusable(format!("{}: {error}", folder.display())))?;
    let (before, after) = (folder.join("storage.bin"), folder.join("storage-named.bin"));
    // Remove an old file: it must not pass for a storage that could not be read.
    if before.exists() {
        fs::remove_file(&before).map_err(|error| format!("{}: {error}", before.display()))?;
    }
    let mut read = probe(args, "read");
    read.args(["--format", "binary", "--output"]).arg(&before);
    read.args(["b8", &format!("{:#010x}", STORAGE.start), &STORAGE.len.to_string()]);
    reach(read)?;
    let found = files::read(&before)?;
    // Named by its content and kept: a backup if the board is unplugged halfway.
    let mut crc = Crc32::default();
    crc.update(&found);
    let kept = folder.join(format!("storage-{:08x}.bin", crc.finish()));
    files::replace(&kept, &found).map_err(Failure::Unusable)?;
    let bytes = with(&before, values)?;
    if bytes == found {
        return Ok(None);
    }
    warn(&format!("the storage as it was is kept in {}", kept.display()));
    files::replace(&after, &bytes).map_err(Failure::Unusable)?;
    Ok(Some(after))
}

/// The storage in a file with these properties, written by the firmware's own journal.
fn with(storage: &Path, values: &[String]) -> Result<Vec<u8>, Failure> {
    let values = values.join(" ");
    let mut journal = program(&format!("cargo run --quiet --bin storage-id -- {values}"));
    let line = typed(&journal);
    let file = File::open(storage).map_err(|error| files::unreadable(storage, &error))?;
    let output = journal.stdin(Stdio::from(file)).stderr(Stdio::inherit()).output();
    let failed = |what: String| {
        Failure::Judged(format!(
            "{}: {values} cannot be stored: {what}\n  repeat with: {line} < FILE",
            storage.display()
        ))
    };
    let output = output.map_err(|error| failed(error.to_string()))?;
    if output.status.success() { Ok(output.stdout) } else { Err(failed(output.status.to_string())) }
}
