//! Copies of the project's files below the target folder, in which defects are planted and built.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::list::{Defect, Edit};
use super::switch::{Refused, Switched};
use crate::files;
use crate::program::{output_of_both, program, root};

/// The crates whose unit tests may find a defect of the firmware.
pub const TESTED: [&str; 5] = ["servo-core", "tater-wire", "boot", "tater-fw", "god"];

/// The unit tests of a crate.
pub struct Tests {
    pub package: String,
    pub program: PathBuf,
    /// Where cargo would run them.
    pub folder: PathBuf,
}

pub struct Tree {
    folder: PathBuf,
    /// Its own: to cargo, crates of two workspaces with the same names and paths are one crate, and fresh if the other workspace's was built later.
    build: PathBuf,
}

impl Tree {
    /// Copies the tracked files, as they are now but for `changed`, to a folder below `defects`. Those that are equal there keep their time, so
    /// that cargo builds only what has changed.
    ///
    /// # Errors
    /// Git's, or the file system's.
    pub fn copy(defects: &Path, name: &str, changed: &BTreeMap<String, String>) -> Result<Self, String> {
        let tree = Self { folder: defects.join(name), build: defects.join(format!("build-{name}")) };
        let listed = crate::program::output(program("git ls-files -z"))?;
        for file in listed.split('\0').filter(|file| !file.is_empty()) {
            if let Some(text) = changed.get(file) {
                tree.write(file, text.as_bytes())?;
                continue;
            }
            // A file that was deleted but not committed is tracked still.
            if root().join(file).exists() {
                let bytes = std::fs::read(root().join(file)).map_err(|error| format!("{file}: {error}"))?;
                tree.write(file, &bytes)?;
            }
        }
        Ok(tree)
    }

    fn write(&self, file: &str, bytes: &[u8]) -> Result<(), String> {
        let to = self.folder.join(file);
        if std::fs::read(&to).is_ok_and(|present| present == bytes) {
            return Ok(());
        }
        let write = || {
            std::fs::create_dir_all(to.parent().unwrap_or(&self.folder))?;
            std::fs::write(&to, bytes)
        };
        write()
            .map_err(|error| format!("{}: {error}\n  next: free space, or delete the folder", to.display()))
    }

    /// Builds the simulator, with the checks of a debug build, which find overflows, and keeps it as `copy`.
    ///
    /// # Errors
    /// It does not compile: with the compiler's words.
    pub fn simulator(&self, copy: &Path) -> Result<(), String> {
        self.cargo("build --package hil-sim --bin hil-sim")?;
        // The next tree of this name has the same place. A new file: the last one may be running.
        let bytes = self.build.join("debug/hil-sim");
        let _ = std::fs::remove_file(copy);
        std::fs::copy(bytes, copy).map(|_| ()).map_err(|error| format!("{}: {error}", copy.display()))
    }

    /// Builds the unit tests of these crates.
    ///
    /// # Errors
    /// As [`Tree::simulator`].
    pub fn tests(&self, crates: &[&str]) -> Result<Vec<Tests>, String> {
        let packages: String = crates.iter().map(|name| format!(" --package {name}")).collect();
        let line = format!("test --no-run --lib{packages}");
        self.cargo(&line)?;
        // Its errors would be JSON.
        let text = self.cargo(&format!("{line} --message-format json"))?;
        let rows = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
        let tests = |row: Value| {
            let package = row["target"]["name"].as_str()?.replace('_', "-");
            let folder = self.folder.join(&package);
            Some(Tests { package, program: PathBuf::from(row["executable"].as_str()?), folder })
        };
        Ok(rows.filter_map(tests).collect())
    }

    /// # Errors
    /// It does not compile: with the compiler's words.
    pub fn check(&self, package: &str) -> Result<(), String> {
        self.cargo(&format!("check --lib --package {package}")).map(|_| ())
    }

    fn cargo(&self, line: &str) -> Result<String, String> {
        let mut cargo = program(&format!("cargo {line} --quiet --locked --color never"));
        if !line.contains("--message-format") {
            cargo.args(["--message-format", "short"]);
        }
        cargo.current_dir(&self.folder).env("CARGO_TARGET_DIR", &self.build);
        cargo.env("CARGO_PROFILE_DEV_DEBUG", "false");
        output_of_both(cargo)
    }
}

/// The texts of the files that edits change.
///
/// # Errors
/// A `from` does not occur exactly once, or a file cannot be read.
pub fn edited(edits: &[Edit]) -> Result<BTreeMap<String, String>, String> {
    let mut texts = BTreeMap::new();
    for Edit { file, from, to } in edits {
        let text = match texts.remove(file) {
            Some(text) => text,
            None => text(file)?,
        };
        let count = text.matches(from.as_str()).count();
        if count != 1 {
            return Err(format!("{file}: found {count} times, expected once: {from}"));
        }
        texts.insert(file.clone(), text.replace(from, to));
    }
    Ok(texts)
}

/// The text of a file of the project.
///
/// # Errors
/// It cannot be read.
pub fn text(file: &str) -> Result<String, String> {
    Ok(String::from_utf8_lossy(&files::read(&root().join(file))?).into_owned())
}

/// Plans and builds the tree with switches; those that the compiler refuses become `alone`.
///
/// # Errors
/// The file system's, or what the compiler says of anything else.
pub fn switched<T>(
    all: &[Defect],
    folder: &Path,
    build: impl Fn(&Tree) -> Result<T, String>,
) -> Result<(T, Switched), String> {
    let all: Vec<&Defect> = all.iter().filter(|defect| defect.is_planted()).collect();
    let mut refused = Refused::default();
    loop {
        let plan = Switched::plan(&all, &refused, text)?;
        match build(&Tree::copy(folder, "tree-switched", &plan.files)?) {
            Ok(built) => return Ok((built, plan)),
            Err(error) if !refused.add(plan.blamed(&error, text)) => return Err(error),
            Err(_) => {}
        }
    }
}
