//! Output: text on standard output and standard error, and files replaced atomically.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

use crate::experiment::input::BadInput;

/// Prints to standard output; a closed pipe is not an error.
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

/// Prints a line to standard error; a failure there cannot be reported.
pub fn warn(line: &str) {
    let _ = writeln!(io::stderr(), "{line}");
}

/// Replaces a file atomically: writes a temporary file beside it and renames it. Keeps symbolic links; writes to pipes and
/// devices directly.
///
/// # Errors
/// Those of the file system; no temporary file is left behind.
pub fn replace_file(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let (target, permissions) = match fs::metadata(path) {
        // A regular file under /dev is a shell's redirection (/dev/stdout), which its owner keeps open.
        Ok(meta) if meta.is_file() && !path.starts_with("/dev") => {
            (fs::canonicalize(path)?, Some(meta.permissions()))
        }
        Err(e) if e.kind() == ErrorKind::NotFound && !path.is_symlink() => (path.to_owned(), None),
        Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
        _ => return fs::write(path, bytes),
    };
    let part = part_of(&target)?;
    // `create_new`: never overwrite, nor remove below, somebody else's file.
    let file = File::create_new(&part)?;
    let moved = write_new(file, bytes, permissions).and_then(|()| fs::rename(&part, &target));
    if moved.is_err() {
        let _ = fs::remove_file(&part);
    }
    moved
}

fn part_of(target: &Path) -> io::Result<PathBuf> {
    let name = target
        .file_name()
        .ok_or_else(|| io::Error::new(ErrorKind::InvalidInput, "the path does not end in a file name"))?;
    Ok(target.with_file_name(format!(".{}.{}.part", name.to_string_lossy(), std::process::id())))
}

fn write_new(mut file: File, bytes: &[u8], permissions: Option<fs::Permissions>) -> io::Result<()> {
    if let Some(permissions) = permissions {
        file.set_permissions(permissions)?;
    }
    file.write_all(bytes)
}
