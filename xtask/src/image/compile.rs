//! Builds the two programs so that the same commit gives the same bytes in any folder, for any user.
//!
//! Fixed: dependencies (lock file), compiler (rust-toolchain.toml), flags and profiles (this file and Cargo.toml;
//! those of the environment are ignored with a message), folders (replaced in debug information and panic
//! locations). Not fixed: `[profile]` tables in a user's cargo configuration, and vendored dependencies.

use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::Command;

use super::Profile;
use crate::Failure;
use crate::program::{output, program, run};
use crate::setup::THUMB;
use programs::output::warn;

pub struct Linked {
    pub tater: PathBuf,
    pub monitor: PathBuf,
    pub conformance: PathBuf,
}

/// Environment variables of cargo that would change an image.
const LEFT_OUT: [&str; 5] = [
    "RUSTFLAGS",
    "CARGO_ENCODED_RUSTFLAGS",
    "CARGO_BUILD_RUSTFLAGS",
    "CARGO_TARGET_THUMBV7M_NONE_EABI_RUSTFLAGS",
    "CARGO_INCREMENTAL",
];

/// Log levels of an application with log strings: DEFMT_LOG of the environment, or `info`.
pub fn log(profile: Profile) -> Option<String> {
    match profile {
        Profile::Production => None,
        Profile::Release => Some(std::env::var("DEFMT_LOG").unwrap_or_else(|_| "info".into())),
    }
}

/// Builds monitor, conformance test and application of a checkout in the folder `build`.
///
/// # Errors
/// The build failed; cargo has printed why.
pub fn compile(checkout: &Path, build: &Path, profile: Profile) -> Result<Linked, Failure> {
    let left_out = left_out();
    if !left_out.is_empty() {
        let names = left_out.join(", ");
        warn(&format!("not used, so that the same commit gives the same image anywhere: {names}"));
    }
    for name in ["monitor", "conformance", "tater"] {
        let levels = if name == "tater" { log(profile) } else { None };
        cargo(checkout, build, "tater-f103", name, levels).map_err(|_| {
            format!("{name} cannot be built\n  repeat with: cargo xtask image --profile {}", profile.name())
        })?;
    }
    let folder = build.join(THUMB);
    let [tater, monitor, conformance] =
        ["tater", "monitor", "conformance"].map(|name| folder.join("firmware").join(name));
    Ok(Linked { tater, monitor, conformance })
}

/// Builds a program, with logs of these levels or without.
fn cargo(
    checkout: &Path,
    build: &Path,
    package: &str,
    name: &str,
    levels: Option<String>,
) -> Result<(), Failure> {
    let mut cargo = program(&format!(
        "cargo build --locked --package {package} --bin {name} --profile firmware --target {THUMB}"
    ));
    cargo.current_dir(checkout).arg("--target-dir").arg(build);
    cargo.env_remove("DEFMT_LOG");
    if let Some(levels) = levels {
        cargo.args(["--features", "log"]).env("DEFMT_LOG", levels);
    }
    if !io::stderr().is_terminal() {
        cargo.arg("--quiet");
    }
    left_out().iter().for_each(|name| {
        cargo.env_remove(name);
    });
    // Not by RUSTFLAGS: a path may contain a blank.
    cargo.env("CARGO_ENCODED_RUSTFLAGS", flags(checkout, build)?.join("\u{1f}"));
    Ok(run(cargo)?)
}

/// Builds GOD on the stub board, which has no image: for its figures.
///
/// # Errors
/// As [`compile`].
pub fn god(checkout: &Path, build: &Path) -> Result<PathBuf, Failure> {
    cargo(checkout, build, "stub", "stub-god", None)?;
    Ok(build.join(THUMB).join("firmware/stub-god"))
}

fn left_out() -> Vec<String> {
    let names = std::env::vars_os().filter_map(|(name, value)| Some((name.into_string().ok()?, value)));
    let changes = |name: &str| LEFT_OUT.contains(&name) || name.starts_with("CARGO_PROFILE_");
    let set = names.filter(|(name, value)| changes(name) && !value.is_empty());
    set.map(|(name, _)| name).collect()
}

/// Paths as the compiler may print them, with replacements; later ones take precedence.
fn flags(checkout: &Path, build: &Path) -> Result<Vec<String>, String> {
    let rustc = |arguments: &str| {
        let mut command: Command = program(&format!("rustc {arguments}"));
        command.current_dir(checkout);
        output(command)
    };
    let about = rustc("--version --verbose")?;
    let hash = about.lines().find_map(|line| line.strip_prefix("commit-hash: ")).unwrap_or("unknown");
    // Path of core's sources if they are installed; otherwise the compiler prints the replacement itself.
    let core = Path::new(rustc("--print sysroot")?.trim()).join("lib/rustlib/src/rust");
    let mut names = vec![(core, format!("/rustc/{hash}"))];
    names.extend(registries().into_iter().map(|folder| (folder, "/cargo".into())));
    names.push((checkout.to_owned(), "/tater".into()));
    names.push((build.to_owned(), "/tater/target".into()));
    let mut flags = Vec::new();
    for (folder, name) in names {
        // The compiler may print a path or its canonical form.
        let real = folder.canonicalize().unwrap_or_else(|_| folder.clone());
        for folder in [&folder, &real] {
            flags.push(format!("--remap-path-prefix={}={name}", folder.display()));
        }
    }
    Ok(flags)
}

/// The folders of cargo's registries, whose names depend on the source of the crates.
fn registries() -> Vec<PathBuf> {
    let home = std::env::var_os("CARGO_HOME").map(PathBuf::from);
    let home = home.or_else(|| Some(std::env::home_dir()?.join(".cargo")));
    let Some(entries) = home.and_then(|home| std::fs::read_dir(home.join("registry/src")).ok()) else {
        return Vec::new();
    };
    let mut folders: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    folders.sort();
    folders
}
