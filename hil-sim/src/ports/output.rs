//! What the program gives: text on standard output and standard error, and whole files.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use crate::experiment::input::BadInput;

/// Prints to standard output; that nobody reads on is no error of ours.
///
/// # Errors
/// Anything else, a full disk above all.
pub fn print(text: &str) -> Result<(), BadInput> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(BadInput {
            place: "standard output".to_owned(),
            problem: "cannot be written".to_owned(),
            found: e.to_string(),
            expected: "room for the result".to_owned(),
            next: "free space, or send the output elsewhere".to_owned(),
        }),
        _ => Ok(()),
    }
}

/// A line on standard error; there is nowhere to tell that it cannot be told.
pub fn tell(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// Writes a file under another name first, so that a reader finds the old or the new one and never a half. A
/// symbolic link stays one; what is no regular file (a pipe, a device) is written to as it is.
///
/// # Errors
/// Of the file system; nothing is left behind then.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let (target, permissions) = match fs::metadata(path) {
        // Under /dev a regular file is a shell's redirection (/dev/stdout): whoever opened it keeps it.
        Ok(meta) if meta.is_file() && !path.starts_with("/dev") => {
            (fs::canonicalize(path)?, Some(meta.permissions()))
        }
        Err(e) if e.kind() == ErrorKind::NotFound && !path.is_symlink() => (path.to_owned(), None),
        Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
        _ => return fs::write(path, bytes),
    };
    let part = part_of(&target)?;
    // Never onto a file of somebody else's: it is then not ours to remove, either.
    let file = File::create_new(&part)?;
    let moved = write_new(file, bytes, permissions).and_then(|()| fs::rename(&part, &target));
    if moved.is_err() {
        let _ = fs::remove_file(&part);
    }
    moved
}

/// `.NAME.PID.part` beside the file.
fn part_of(target: &Path) -> io::Result<PathBuf> {
    let name = target
        .file_name()
        .ok_or_else(|| io::Error::new(ErrorKind::InvalidInput, "the path does not end in a file's name"))?;
    Ok(target.with_file_name(format!(".{}.{}.part", name.to_string_lossy(), std::process::id())))
}

fn write_new(mut file: File, bytes: &[u8], permissions: Option<fs::Permissions>) -> io::Result<()> {
    if let Some(permissions) = permissions {
        file.set_permissions(permissions)?;
    }
    file.write_all(bytes)
}
