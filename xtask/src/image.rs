//! `cargo xtask image`: builds what is flashed and downloaded: monitor and application as ELF and flat files,
//! the sealed application also as a `.tek` file, and `image.json`, which describes them.
//!
//! The same commit gives the same bytes on every machine (`image/compile.rs`).

mod check;
mod compile;
mod profile;

use std::fs::{self, File};
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tater_f103::map::{APPLICATION, MONITOR};
use tater_wire::Property;
use tater_wire::image::{Crc32, Header};
use tater_wire::map::Area;

use crate::program::{output, program, root, target};
use crate::{Failure, files, setup, tek};
pub use check::{check, reproducible};
pub use profile::Profile;

/// Arguments of `image`.
#[derive(clap::Args)]
pub struct ImageArgs {
    /// With log strings or without
    #[arg(long, value_enum, default_value = "production")]
    profile: Profile,
    /// The folder to write into; created if missing [default: target/image/PROFILE]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print image.json, and nothing else, to standard output
    #[arg(long)]
    json: bool,
}

pub struct Images {
    /// The sealed application, an ELF file.
    pub tater: PathBuf,
    pub monitor: PathBuf,
    pub tater_bytes: u32,
    pub monitor_bytes: u32,
    /// Contents of image.json.
    about: Value,
}

/// # Errors
/// The images cannot be built or written.
pub fn image(args: &ImageArgs) -> Result<(), Failure> {
    let folder = args.out.clone().unwrap_or_else(|| folder(args.profile));
    let Images { about, .. } = build_into(args.profile, &folder)?;
    if args.json {
        return files::print(&format!("{about:#}\n")).map_err(Failure::from);
    }
    for (what, area) in [("application", APPLICATION), ("monitor", MONITOR)] {
        let text = |key: &str| about[what][key].as_str().unwrap_or_default().to_owned();
        println!(
            "{what:11} {} of {} bytes at {}, CRC-32 {}",
            about[what]["bytes"],
            area.len,
            text("address"),
            text("crc32")
        );
    }
    println!("version {}, in {}", about["version"], folder.display());
    Ok(())
}

pub fn folder(profile: Profile) -> PathBuf {
    target().join("image").join(profile.name())
}

/// Builds the images into their default folder.
///
/// # Errors
/// The images cannot be built or written.
pub fn build(profile: Profile) -> Result<Images, Failure> {
    build_into(profile, &folder(profile))
}

fn build_into(profile: Profile, folder: &Path) -> Result<Images, Failure> {
    setup::target()?;
    let built = make(&root(), &target(), profile)?;
    fs::create_dir_all(folder).map_err(|error| {
        let place = folder.display();
        Failure::Unusable(format!("{place}: cannot be made: {error}\n  next: give another folder with --out"))
    })?;
    let mut about = about(profile, &built)?;
    for (name, bytes) in built.files() {
        about["files"][name] = json!({ "bytes": bytes.len(), "crc32": hex(crc(bytes)) });
    }
    // Written last: if it agrees with the files beside it, they are of one build.
    let text = format!("{about:#}\n");
    let mut files: Vec<_> = built.files().map(|(name, bytes)| (folder.join(name), bytes)).into();
    files.push((folder.join("image.json"), text.as_bytes()));
    files::replace_all(&files).map_err(Failure::Unusable)?;
    Ok(Images {
        tater: folder.join("tater.elf"),
        monitor: folder.join("monitor.elf"),
        tater_bytes: built.tater.header.len,
        monitor_bytes: built.monitor_bytes,
        about,
    })
}

/// Builds GOD on the stub board.
///
/// # Errors
/// It cannot be built.
pub fn god() -> Result<PathBuf, Failure> {
    compile::god(&root(), &target())
}

struct Built {
    tater: tek::Sealed,
    monitor: Vec<u8>,
    monitor_flat: Vec<u8>,
    monitor_bytes: u32,
    conformance: Vec<u8>,
}

impl Built {
    fn files(&self) -> [(&'static str, &[u8]); 6] {
        [
            ("tater.elf", &self.tater.elf),
            ("tater.bin", &self.tater.bytes),
            ("tater.tek", &self.tater.text),
            ("monitor.elf", &self.monitor),
            ("monitor.bin", &self.monitor_flat),
            ("conformance.bin", &self.conformance),
        ]
    }
}

/// Builds a checkout, with cargo's files in the folder `build`.
fn make(checkout: &Path, build: &Path, profile: Profile) -> Result<Built, Failure> {
    // Cargo's own lock ends with cargo, and both profiles give their application the same name.
    fs::create_dir_all(build).map_err(|error| format!("{}: {error}", build.display()))?;
    let lock = build.join(".image-lock");
    let lock = File::create(&lock).and_then(|file| file.lock().map(|()| file));
    let _lock = lock.map_err(|error| format!("{}: {error}", build.display()))?;
    let linked = compile::compile(checkout, build, profile)?;
    let wrong = |name: &Path, error| format!("{}: {error}", name.display());
    let tater = tek::seal_linked(files::read(&linked.tater)?, version())
        .map_err(|error| wrong(&linked.tater, error))?;
    let monitor = files::read(&linked.monitor)?;
    let monitor_flat = in_monitors_place(&linked.monitor, &monitor)?;
    // More than 32 bits would not be in its place.
    let monitor_bytes = u32::try_from(monitor_flat.len()).unwrap_or(u32::MAX);
    let conformance = in_monitors_place(&linked.conformance, &files::read(&linked.conformance)?)?;
    Ok(Built { tater, monitor, monitor_flat, monitor_bytes, conformance })
}

/// The bytes of a program that stands where the monitor does.
fn in_monitors_place(path: &Path, elf: &[u8]) -> Result<Vec<u8>, Failure> {
    let wrong = |error| format!("{}: {error}", path.display());
    let (start, flat) = tek::flat(elf).map_err(wrong)?;
    let len = flat.len() as u64;
    if start != u64::from(MONITOR.start) || !MONITOR.holds(start, len) {
        let Area { start: wanted, len: room } = MONITOR;
        let found = format!("found {len} bytes from {start:#010x} on");
        let error = format!("{found}, expected at most {room} from {wanted:#010x} on");
        return Err(Failure::Judged(wrong(error)));
    }
    Ok(flat)
}

fn version() -> u16 {
    // VERS has a single value, of 16 bits.
    u16::try_from(Property::VERS.row().max).unwrap_or(u16::MAX)
}

/// Contents of image.json except the files.
fn about(profile: Profile, built: &Built) -> Result<Value, Failure> {
    let Header { len, crc: image_crc, version } = built.tater.header;
    let git = |line: &str| output(program(line)).map(|text| text.trim().to_owned());
    // A source archive has no commit, nor has a checkout before its first: neither is an error.
    let commit = is_checkout().then(|| git("git rev-parse --verify --quiet HEAD").ok()).flatten();
    let dirty = match &commit {
        Some(_) => Some(!git("git status --porcelain")?.is_empty()),
        None => None,
    };
    Ok(json!({
        "version": version,
        "commit": commit,
        "dirty": dirty,
        "profile": profile.name(),
        "log": compile::log(profile),
        "rustc": output(program("rustc --version"))?.trim(),
        "target": setup::THUMB,
        "application": {
            "address": hex(APPLICATION.start), "bytes": len, "room": APPLICATION.len, "crc32": hex(image_crc),
        },
        "monitor": {
            "address": hex(MONITOR.start), "bytes": built.monitor_bytes, "room": MONITOR.len,
            "crc32": hex(crc(&built.monitor_flat)),
        },
        "files": {},
    }))
}

/// Whether the project is its own git checkout, not a folder in another.
fn is_checkout() -> bool {
    root().join(".git").exists()
}

fn crc(bytes: &[u8]) -> u32 {
    let mut crc = Crc32::default();
    crc.update(bytes);
    crc.finish()
}

fn hex(word: u32) -> String {
    format!("{word:#010x}")
}
