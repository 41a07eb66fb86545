//! Output: text on standard output, and where a command may write its files.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use programs::files::{Part, replace_together};
use programs::output;
use traces::input::BadInput;

/// The commit that results name, of a release build; see `build.rs`.
pub const COMMIT: &str = env!("HIL_SIM_COMMIT");

/// The file that says what the sweep of a folder is.
pub const SWEEP: &str = "sweep.json";

/// Prints to standard output; a closed pipe is not an error.
///
/// # Errors
/// Standard output cannot be written.
pub fn print(text: &str) -> Result<(), BadInput> {
    output::print(text).map_err(|error| {
        BadInput::new("standard output", "cannot be written")
            .found(error.to_string())
            .expected("room for the result")
            .next("free space, or send the output elsewhere")
    })
}

/// Whether two paths lead to one file: by links, by another name of the same file, or because standard output is redirected to it.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    #[cfg(unix)]
    let file = |path: &Path| {
        use std::os::unix::fs::MetadataExt;
        fs::metadata(path).map(|meta| (meta.dev(), meta.ino()))
    };
    #[cfg(not(unix))]
    let file = |path: &Path| fs::canonicalize(path);
    matches!((file(a), file(b)), (Ok(a), Ok(b)) if a == b)
}

/// Whether a file can be made there: found out before the long work whose result it is to take.
///
/// # Errors
/// A folder that is missing or cannot be written, or a folder of this name.
pub fn check_file(path: &Path) -> Result<(), BadInput> {
    let checked = match path {
        path if path.is_dir() => Err(ErrorKind::IsADirectory.into()),
        path if path.starts_with("/dev") => Ok(()),
        path => Part::begin(path).map(drop),
    };
    checked.map_err(|error| unwritable(path, path, &error, "a file in an existing folder"))
}

/// The same of a folder, which may not exist yet.
///
/// # Errors
/// A folder that cannot be made or written, or that has the results of a sweep.
pub fn check_folder(dir: &Path) -> Result<(), BadInput> {
    if dir.join(SWEEP).exists() {
        return Err(BadInput::new(format!("--out {}", dir.display()), "has the results of a sweep")
            .found(SWEEP)
            .expected("a folder of its own")
            .next("choose another folder"));
    }
    let checked = std::path::absolute(dir).and_then(|dir| {
        let existing = dir.ancestors().find(|path| path.exists()).unwrap_or(&dir);
        if !existing.is_dir() {
            return Err(ErrorKind::NotADirectory.into());
        }
        Part::begin(&existing.join("hil-sim")).map(drop)
    });
    checked.map_err(|error| unwritable(dir, dir, &error, "a writable folder"))
}

fn unwritable(out: &Path, path: &Path, error: &io::Error, expected: &str) -> BadInput {
    BadInput::new(format!("--out {}", out.display()), format!("{} cannot be written", path.display()))
        .found(error.to_string())
        .expected(expected)
        .next("choose another path, or free space")
}

/// Makes a folder if there is none, and replaces these files of it together, by [`replace_together`].
///
/// # Errors
/// Those of [`check_folder`], or a file that cannot be written.
pub fn write_folder(dir: &Path, files: &[(&str, &[u8])]) -> Result<(), BadInput> {
    check_folder(dir)?;
    let paths: Vec<PathBuf> = files.iter().map(|(name, _)| dir.join(name)).collect();
    let files: Vec<(&Path, &[u8])> =
        paths.iter().zip(files).map(|(path, (_, bytes))| (path.as_path(), *bytes)).collect();
    let made = fs::create_dir_all(dir).map_err(|error| (dir.to_owned(), error));
    made.and_then(|()| replace_together(&files))
        .map_err(|(path, error)| unwritable(dir, &path, &error, "a writable folder"))
}

/// A word as a shell takes it.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "/._-+=,:@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}
