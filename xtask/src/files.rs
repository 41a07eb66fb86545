//! Files that are replaced completely or not at all, and output for a reader that may close its end.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use crate::Failure;

/// Longest file that is read, bytes: a linked program with debug information has a few MiB, and the text of the longest image 42.
pub const MAX_BYTES: u64 = 64 * 1024 * 1024;

/// # Errors
/// The file cannot be read, or is longer than [`MAX_BYTES`], as `/dev/zero` is.
pub fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes))
        .map_err(|error| unreadable(path, &error))?;
    if bytes.len() as u64 > MAX_BYTES { Err(too_long(path)) } else { Ok(bytes) }
}

pub fn too_long(path: &Path) -> Failure {
    Failure::Unusable(format!(
        "{}: found more than {} MiB, expected a program or a .tek file\n  next: check the path: a device has no end",
        path.display(),
        MAX_BYTES / 1024 / 1024
    ))
}

pub fn unreadable(path: &Path, error: &io::Error) -> Failure {
    let place = path.display();
    Failure::Unusable(format!(
        "{place}: cannot be read: {error}\n  next: check that it is a file that you may read"
    ))
}

/// Writes a temporary file beside the target and renames it, so that a reader finds the old or the new
/// contents. A target that is no regular file (`/dev/stdout`, a pipe) is written directly.
///
/// # Errors
/// A file-system error; nothing is left behind.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let is_file = fs::metadata(path).map_or(!path.is_symlink(), |meta| meta.is_file());
    let written = if is_file && !path.starts_with("/dev") {
        Part::write(path, bytes).and_then(Part::rename)
    } else {
        fs::write(path, bytes)
    };
    written.map_err(|error| unwritable(path, &error))
}

/// Replaces files that belong together, of which the last describes the others, once all temporary files are on disk and no folder is in the
/// way. An end at any moment (^C, a kill) leaves no description of other files: without all of them there is none.
///
/// # Errors
/// As [`replace`].
pub fn replace_all(files: &[(PathBuf, &[u8])]) -> Result<(), String> {
    let mut parts = Vec::new();
    for (path, bytes) in files {
        parts.push(Part::write(path, bytes).map_err(|error| unwritable(path, &error))?);
    }
    steps(parts).into_iter().try_for_each(Step::run)
}

enum Step {
    Remove(PathBuf),
    Rename(Part),
}

fn steps(parts: Vec<Part>) -> Vec<Step> {
    let description = parts.last().map(|part| Step::Remove(part.target.clone()));
    description.into_iter().chain(parts.into_iter().map(Step::Rename)).collect()
}

impl Step {
    fn run(self) -> Result<(), String> {
        match self {
            Self::Remove(path) => match fs::remove_file(&path) {
                Err(error) if error.kind() != ErrorKind::NotFound => Err(unwritable(&path, &error)),
                _ => Ok(()),
            },
            Self::Rename(part) => {
                let target = part.target.clone();
                part.rename().map_err(|error| unwritable(&target, &error))
            }
        }
    }
}

fn unwritable(path: &Path, error: &io::Error) -> String {
    let place = path.display();
    format!(
        "{place}: cannot be written: {error}\n  next: check that its folder is there, may be written and has room"
    )
}

/// A temporary file; removed unless it is renamed.
struct Part {
    part: PathBuf,
    target: PathBuf,
}

impl Part {
    fn write(path: &Path, bytes: &[u8]) -> io::Result<Self> {
        if path.is_dir() {
            return Err(ErrorKind::IsADirectory.into());
        }
        let target = if path.is_symlink() { fs::canonicalize(path)? } else { path.to_owned() };
        let name = target.file_name().ok_or(ErrorKind::InvalidInput)?.to_string_lossy().into_owned();
        let part = target.with_file_name(format!(".{name}.{}.part", std::process::id()));
        // Never overwrite a foreign file, nor remove it.
        let mut file = File::create_new(&part)?;
        let written = Self { part, target };
        file.write_all(bytes).map(|()| written)
    }

    fn rename(self) -> io::Result<()> {
        fs::rename(&self.part, &self.target)
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // Already renamed if all went well.
        let _ = fs::remove_file(&self.part);
    }
}

/// Prints to standard output; a closed pipe is no error.
///
/// # Errors
/// Standard output cannot be written.
pub fn print(text: &str) -> Result<(), String> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(format!(
            "standard output cannot be written: {error}\n  next: free space, or send it elsewhere"
        )),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folder_in_the_way_leaves_all_files_unchanged() {
        let folder = std::env::temp_dir().join(format!("tater-xtask-files-{}", std::process::id()));
        fs::create_dir_all(folder.join("b")).expect("the temporary folder can be written");
        let [a, b] = ["a", "b"].map(|name| folder.join(name));
        fs::write(&a, "old").expect("as before");
        let error = replace_all(&[(a.clone(), b"new"), (b.clone(), b"new")]).expect_err("b is a folder");
        assert!(error.starts_with(&b.display().to_string()), "{error}");
        assert_eq!(fs::read(&a).expect("it is there"), b"old");
        assert_eq!(fs::read_dir(&folder).expect("ours").count(), 2, "no part is left behind");
        fs::remove_dir(&b).expect("ours");
        replace_all(&[(a.clone(), b"new"), (b.clone(), b"new")]).expect("nothing is in the way");
        assert_eq!([a, b].map(|path| fs::read(path).expect("written")), [b"new"; 2]);
        assert_eq!(fs::read_dir(&folder).expect("ours").count(), 2);
        fs::remove_dir_all(&folder).expect("ours");
    }

    #[test]
    fn description_is_never_left_with_other_files() {
        let folder = std::env::temp_dir().join(format!("tater-xtask-steps-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("the temporary folder can be written");
        let paths = ["a", "b", "json"].map(|name| folder.join(name));
        for done in 0..=4 {
            paths.iter().for_each(|path| fs::write(path, "old").expect("ours"));
            let parts = paths.iter().map(|path| Part::write(path, b"new").expect("ours")).collect();
            let steps: Vec<Step> = steps(parts);
            assert_eq!(steps.len(), 4);
            steps.into_iter().take(done).for_each(|step| step.run().expect("ours"));
            let found = paths.each_ref().map(|path| fs::read_to_string(path).ok());
            let is_one_build = found.iter().all(|content| *content == found[0]);
            assert!(found[2].is_none() || is_one_build, "after {done} steps: {found:?}");
        }
        fs::remove_dir_all(&folder).expect("ours");
    }
}
