//! Files replaced atomically, each alone or together with those that it describes; small files read whole.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, TempPath};

use super::interrupt;

/// Longest file of [`read_text`], bytes.
const MOST_TEXT: u64 = 1 << 20;

/// Reads a text of 1 MiB at most.
///
/// # Errors
/// Those of the file system, a longer file, one that is no text, and what is no file: a pipe or a device may have no end.
pub fn read_text(path: &Path) -> io::Result<String> {
    if !fs::metadata(path)?.is_file() {
        return Err(io::Error::new(ErrorKind::InvalidInput, "a folder, a pipe or a device"));
    }
    let mut text = String::new();
    File::open(path)?.take(MOST_TEXT + 1).read_to_string(&mut text)?;
    if text.len() as u64 > MOST_TEXT {
        return Err(io::Error::new(ErrorKind::FileTooLarge, "more than 1 MiB"));
    }
    Ok(text)
}

/// Replaces a file atomically: writes a temporary file beside it and renames it. Keeps symbolic links; writes to pipes and
/// devices directly.
///
/// # Errors
/// Those of the file system; no temporary file is left behind, by ^C neither.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    Part::write(path, bytes)?.map_or(Ok(()), Part::rename)
}

/// Replaces files that belong together, of which the last describes the others. An end at any moment (^C, a kill) leaves no old
/// description with new files, nor the other way round: without all of them there is no description.
///
/// # Errors
/// The file and the reason. No file is changed unless all of them fit on the disk.
pub fn replace_together(files: &[(&Path, &[u8])]) -> Result<(), (PathBuf, io::Error)> {
    let mut parts = Vec::new();
    for (path, bytes) in files {
        parts.extend(Part::write(path, bytes).map_err(|error| ((*path).to_owned(), error))?);
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
    fn run(self) -> Result<(), (PathBuf, io::Error)> {
        match self {
            Self::Remove(path) => match fs::remove_file(&path) {
                Err(error) if error.kind() != ErrorKind::NotFound => Err((path, error)),
                _ => Ok(()),
            },
            Self::Rename(part) => {
                let target = part.target.clone();
                part.rename().map_err(|error| (target, error))
            }
        }
    }
}

/// A temporary file beside another, which it replaces when it is renamed. Dropped before, it is removed.
pub struct Part {
    part: PathBuf,
    target: PathBuf,
}

impl Part {
    /// An empty one beside a file that may or may not exist, to be written piece by piece.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn begin(target: &Path) -> io::Result<(Self, File)> {
        let name = target
            .file_name()
            .ok_or_else(|| io::Error::new(ErrorKind::InvalidInput, "the path does not end in a file name"))?;
        let prefix = format!(".{}.", name.to_string_lossy());
        let folder = target.parent().unwrap_or(Path::new(""));
        let (file, part) = interrupt::temporary(|| {
            // The mode that the umask leaves: `tempfile_in` would let nobody but the owner read the result.
            Builder::new().prefix(&prefix).suffix(".part").make_in(folder, |part| File::create_new(part))
        })?;
        Ok((Self { part, target: target.to_owned() }, file))
    }

    /// Where its bytes are until then.
    pub fn path(&self) -> &Path {
        &self.part
    }

    /// `None` if the target is no file: the bytes have been written to it.
    fn write(path: &Path, bytes: &[u8]) -> io::Result<Option<Self>> {
        let (target, permissions) = match fs::metadata(path) {
            // A regular file under /dev is a shell's redirection (/dev/stdout), which its owner keeps open.
            // Renaming would replace it all the same.
            Ok(meta) if meta.is_file() && meta.permissions().readonly() => {
                return Err(io::Error::new(
                    ErrorKind::PermissionDenied,
                    "the file is read-only; choose another path",
                ));
            }
            Ok(meta) if meta.is_file() && !path.starts_with("/dev") => {
                (fs::canonicalize(path)?, Some(meta.permissions()))
            }
            Err(e) if e.kind() == ErrorKind::NotFound && !path.is_symlink() => (path.to_owned(), None),
            Err(e) if e.kind() != ErrorKind::NotFound => return Err(e),
            _ => return fs::write(path, bytes).map(|()| None),
        };
        let (part, mut file) = Self::begin(&target)?;
        if let Some(permissions) = permissions {
            file.set_permissions(permissions)?;
        }
        file.write_all(bytes)?;
        Ok(Some(part))
    }

    /// Replaces the file.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn rename(self) -> io::Result<()> {
        interrupt::settle(&self.part, |part| part.persist(&self.target).map_err(|failed| failed.error))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        let _ = interrupt::settle(&self.part, TempPath::close);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_without_an_end_is_not_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let long = folder.path().join("long");
        fs::write(&long, vec![b' '; 1 << 20]).expect("ours");
        assert_eq!(read_text(&long).map(|text| text.len()).ok(), Some(1 << 20));
        fs::write(&long, vec![b' '; (1 << 20) + 1]).expect("ours");
        assert_eq!(read_text(&long).map_err(|error| error.kind()), Err(ErrorKind::FileTooLarge));
        assert_eq!(read_text(folder.path()).map_err(|error| error.kind()), Err(ErrorKind::InvalidInput));
        #[cfg(unix)]
        assert_eq!(
            read_text(Path::new("/dev/zero")).map_err(|error| error.kind()),
            Err(ErrorKind::InvalidInput)
        );
    }

    #[test]
    fn read_only_file_is_kept() {
        let path = std::env::temp_dir().join(format!("programs-read-only-{}", std::process::id()));
        fs::write(&path, "old").expect("the temporary folder can be written");
        let mut permissions = fs::metadata(&path).expect("ours").permissions();
        permissions.set_readonly(true);
        fs::set_permissions(&path, permissions).expect("ours");
        let error = Part::write(&path, b"new").map(|_| ()).expect_err("refused");
        assert_eq!(error.kind(), ErrorKind::PermissionDenied);
        assert_eq!(fs::read_to_string(&path).expect("ours"), "old");
        fs::remove_file(&path).expect("ours");
    }

    #[cfg(unix)]
    #[test]
    fn new_file_has_the_mode_of_any_other_and_an_old_one_keeps_its_own() {
        use std::os::unix::fs::PermissionsExt;
        let folder = std::env::temp_dir().join(format!("programs-mode-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("the temporary folder can be written");
        let mode = |path: &Path| fs::metadata(path).expect("ours").permissions().mode();
        let [new, other] = ["new", "other"].map(|name| folder.join(name));
        fs::write(&other, "").expect("ours");
        replace(&new, b"1").expect("ours");
        assert_eq!(mode(&new), mode(&other));
        fs::set_permissions(&new, fs::Permissions::from_mode(0o640)).expect("ours");
        replace(&new, b"2").expect("ours");
        assert_eq!((mode(&new) & 0o777, fs::read(&new).expect("ours")), (0o640, b"2".to_vec()));
        fs::remove_dir_all(&folder).expect("ours");
    }

    #[test]
    fn folder_in_the_way_leaves_all_files_unchanged() {
        let folder = std::env::temp_dir().join(format!("programs-folder-{}", std::process::id()));
        fs::create_dir_all(folder.join("b")).expect("the temporary folder can be written");
        let [a, b] = ["a", "b"].map(|name| folder.join(name));
        fs::write(&a, "old").expect("as before");
        let (path, _) = replace_together(&[(&a, b"new"), (&b, b"new")]).expect_err("b is a folder");
        assert_eq!(path, b);
        assert_eq!(fs::read(&a).expect("it is there"), b"old");
        assert_eq!(fs::read_dir(&folder).expect("ours").count(), 2, "no part is left behind");
        fs::remove_dir(&b).expect("ours");
        replace_together(&[(&a, b"new"), (&b, b"new")]).expect("nothing is in the way");
        assert_eq!([a, b].map(|path| fs::read(path).expect("written")), [b"new"; 2]);
        assert_eq!(fs::read_dir(&folder).expect("ours").count(), 2);
        fs::remove_dir_all(&folder).expect("ours");
    }

    /// The program may end after any step.
    #[test]
    fn description_is_never_left_with_files_of_another_run() {
        let folder = std::env::temp_dir().join(format!("programs-files-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("the temporary folder can be written");
        let [trace, report] = ["trace", "report"].map(|name| folder.join(name));
        for done in 0..=3 {
            for path in [&trace, &report] {
                fs::write(path, "old").expect("ours");
            }
            let parts =
                [&trace, &report].map(|path| Part::write(path, b"new").expect("ours").expect("a file"));
            let steps = steps(parts.into());
            assert_eq!(steps.len(), 3);
            steps.into_iter().take(done).for_each(|step| step.run().expect("ours"));
            let [trace, report] = [&trace, &report].map(|path| fs::read_to_string(path).ok());
            let found = (trace.as_deref(), report.as_deref());
            let expected = match done {
                0 => (Some("old"), Some("old")),
                1 => (Some("old"), None),
                2 => (Some("new"), None),
                _ => (Some("new"), Some("new")),
            };
            assert_eq!(found, expected, "after {done} steps");
        }
        fs::remove_dir_all(&folder).expect("ours");
    }
}
