//! Files and standard output, with errors that say what to do next.

use std::fs::File;
use std::io::{self, Read};
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

/// Replaces a file atomically, by [`programs::files::replace`].
///
/// # Errors
/// A file-system error; nothing is left behind.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<(), String> {
    programs::files::replace(path, bytes).map_err(|error| unwritable(path, &error))
}

/// Replaces files that belong together, of which the last describes the others, by [`programs::files::replace_together`].
///
/// # Errors
/// As [`replace`].
pub fn replace_all(files: &[(PathBuf, &[u8])]) -> Result<(), String> {
    let files: Vec<(&Path, &[u8])> = files.iter().map(|(path, bytes)| (path.as_path(), *bytes)).collect();
    programs::files::replace_together(&files).map_err(|(path, error)| unwritable(&path, &error))
}

fn unwritable(path: &Path, error: &io::Error) -> String {
    let place = path.display();
    format!(
        "{place}: cannot be written: {error}\n  next: check that its folder is there, may be written and has room"
    )
}

/// Prints to standard output; a closed pipe is no error.
///
/// # Errors
/// Standard output cannot be written.
pub fn print(text: &str) -> Result<(), String> {
    programs::output::print(text).map_err(|error| {
        format!("standard output cannot be written: {error}\n  next: free space, or send it elsewhere")
    })
}
