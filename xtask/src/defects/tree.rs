//! A copy of the project's files below the target folder, in which a defect is planted and built.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::list::Edit;
use crate::program::{output, output_of_both, program, root};

pub struct Tree {
    folder: PathBuf,
    build: PathBuf,
}

impl Tree {
    /// Copies the tracked files, as they are now, to `folder`. Those that are equal there keep their time, so that cargo builds
    /// only what has changed.
    ///
    /// # Errors
    /// Git's, or the file system's.
    pub fn copy(folder: &Path) -> Result<Self, String> {
        let tree = Self { folder: folder.join("tree"), build: folder.join("build") };
        let listed = output(program("git ls-files -z"))?;
        let files: Vec<&str> = listed.split('\0').filter(|file| !file.is_empty()).collect();
        for file in &files {
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

    /// Calls `then` with the edits made, and undoes them.
    ///
    /// # Errors
    /// A `from` does not occur exactly once; the error of `then`.
    pub fn with<T>(&self, edits: &[Edit], then: impl FnOnce() -> Result<T, String>) -> Result<T, String> {
        let mut texts = BTreeMap::new();
        for Edit { file, from, to } in edits {
            let text = match texts.remove(file) {
                Some(text) => text,
                None => {
                    let path = root().join(file);
                    std::fs::read_to_string(path).map_err(|error| format!("{file}: {error}"))?
                }
            };
            let count = text.matches(from.as_str()).count();
            if count != 1 {
                return Err(format!("{file}: found {count} times, expected once: {from}"));
            }
            texts.insert(file, text.replace(from, to));
        }
        texts.iter().try_for_each(|(file, text)| self.write(file, text.as_bytes()))?;
        let result = then();
        for file in texts.keys() {
            let text = std::fs::read(root().join(file)).map_err(|error| format!("{file}: {error}"))?;
            self.write(file, &text)?;
        }
        result
    }

    /// Builds the simulator: with the checks of a debug build, which find overflows.
    ///
    /// # Errors
    /// It does not compile: with the compiler's words.
    pub fn build(&self) -> Result<(), String> {
        let mut cargo = program("cargo build --quiet --locked --package hil-sim --bin hil-sim");
        cargo.current_dir(&self.folder).env("CARGO_TARGET_DIR", &self.build);
        cargo.env("CARGO_PROFILE_DEV_DEBUG", "false");
        output_of_both(cargo).map(|_| ())
    }

    pub fn simulator(&self) -> PathBuf {
        self.build.join("debug/hil-sim")
    }
}
