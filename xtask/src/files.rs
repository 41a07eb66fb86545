//! Files that are replaced completely or not at all, and output for a reader that may close its end.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use crate::Failure;

/// # Errors
/// The file cannot be read.
pub fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    fs::read(path).map_err(|error| unreadable(path, &error))
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

/// Replaces several files, in order, once all temporary files are on disk and no folder is in the way.
///
/// # Errors
/// As [`replace`].
pub fn replace_all(files: &[(PathBuf, &[u8])]) -> Result<(), String> {
    let mut parts = Vec::new();
    for (path, bytes) in files {
        parts.push((path, Part::write(path, bytes).map_err(|error| unwritable(path, &error))?));
    }
    parts.into_iter().try_for_each(|(path, part)| part.rename().map_err(|error| unwritable(path, &error)))
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
}
