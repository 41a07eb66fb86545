//! Files written whole or not at all, and text for a reader that may stop reading.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use crate::Failure;

/// Reads a file.
///
/// # Errors
/// It cannot be read.
pub fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    fs::read(path).map_err(|error| unreadable(path, &error))
}

/// What to say of a file that cannot be read.
pub fn unreadable(path: &Path, error: &io::Error) -> Failure {
    let place = path.display();
    Failure::Unusable(format!(
        "{place}: cannot be read: {error}\n  next: check that it is a file that you may read"
    ))
}

/// Writes a file under another name beside it and renames it, so that its reader finds the old one or the new one. What
/// is there and no regular file (`/dev/stdout`, a pipe) is written to as it is.
///
/// # Errors
/// Of the file system; nothing is left behind then.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let is_file = fs::metadata(path).map_or(!path.is_symlink(), |meta| meta.is_file());
    let written =
        if is_file && !path.starts_with("/dev") { rename_over(path, bytes) } else { fs::write(path, bytes) };
    written.map_err(|error| {
        let place = path.display();
        format!("{place}: cannot be written: {error}\n  next: check that its folder is there, may be written and has room")
    })
}

fn rename_over(path: &Path, bytes: &[u8]) -> io::Result<()> {
    // A symbolic link stays one.
    let target = if path.is_symlink() { fs::canonicalize(path)? } else { path.to_owned() };
    let name = target.file_name().ok_or(ErrorKind::InvalidInput)?.to_string_lossy().into_owned();
    let part = target.with_file_name(format!(".{name}.{}.part", std::process::id()));
    // Never onto a file of somebody else's: it is then not ours to remove, either.
    let mut file = File::create_new(&part)?;
    let moved = file.write_all(bytes).and_then(|()| fs::rename(&part, &target));
    if moved.is_err() {
        let _ = fs::remove_file(&part);
    }
    moved
}

/// Text on standard output; that nobody reads on is no error of ours.
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
