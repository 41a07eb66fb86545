//! The file with what a hand keeps without power: read at the start, rewritten after changes.
//!
//! Updates are atomic: the new state is written to `FILE.part`, synced and renamed. `FILE.lock` keeps other programs out while
//! this one runs.

use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use hil_world::hand::Hand;
use hil_world::hand::state::State;
use traces::input::BadInput;

/// Size limit, bytes: seven flashes of 128 KiB and GOD need less.
const MAX_BYTES: u64 = 1 << 20;

/// A state is written after this simulated time without changes, us: boards store one after another, 40 ms per erase.
const QUIET_US: u64 = 200_000;

const MAX_DELAY_US: u64 = 2_000_000;

/// A write that failed is repeated after this simulated time, us, unless a command saves before.
const RETRY_US: u64 = 1_000_000;

pub struct StateFile {
    path: PathBuf,
    /// Holds the lock while open.
    _lock: File,
    /// The revision in the file.
    written: u64,
    /// The newest revision, its time, and the time of the first change not written, us.
    unsaved: Option<(u64, u64, u64)>,
    /// The time of the last write, if it failed, us.
    failed_us: Option<u64>,
}

/// Why a state is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// A command waits for it.
    Now,
    /// The host is about to read a prompt.
    Prompt,
    /// It has changed: once changes pause.
    Pause,
}

impl StateFile {
    /// Locks and reads a state file; `None` if it does not exist.
    ///
    /// # Errors
    /// The file is in use, unreadable or not a state; it is not changed.
    pub fn open(path: &Path) -> Result<(Self, Option<State>), BadInput> {
        // A symbolic link stays: its target is replaced.
        let path = &fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        // Before the lock, which would be a new file in /dev. Opening a pipe waits for its other end.
        if fs::metadata(path).is_ok_and(|meta| !meta.is_file()) {
            let found = "a folder, a device or a pipe".to_owned();
            return Err(bad(
                path,
                "this is not a file",
                found,
                "a file, or the name of a new one",
                "name another",
            ));
        }
        let lock = lock(path)?;
        let state_file = Self { path: path.clone(), _lock: lock, written: 0, unsaved: None, failed_us: None };
        let mut bytes = Vec::new();
        match File::open(path).and_then(|file| file.take(MAX_BYTES + 1).read_to_end(&mut bytes)) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok((state_file, None)),
            Err(error) => {
                let next = "check the path, or name a new file";
                return Err(bad(path, "cannot be read", error.to_string(), "a state file", next));
            }
            Ok(_) => {}
        }
        let state = State::from_bytes(&bytes).map_err(|error| {
            let problem = format!("not a state of a hand, from byte {} on; left as it is", error.at);
            let next = "restore a copy, or name a new file";
            bad(path, &problem, error.found, &error.expected, next)
        })?;
        Ok((state_file, Some(state)))
    }

    /// # Errors
    /// The file cannot be written; the old one is unchanged.
    pub fn write(&mut self, hand: &mut Hand) -> Result<(), BadInput> {
        let revision = hand.revision();
        // If writing fails, the state counts as changed now.
        self.unsaved = Some((revision, hand.now_us(), hand.now_us()));
        self.failed_us = Some(hand.now_us());
        self.replace(&hand.state().to_bytes()).map_err(|error| {
            let next = "free space, or choose a writable folder";
            bad(&self.path, "cannot be written", error.to_string(), "a file that can be replaced", next)
        })?;
        (self.written, self.unsaved, self.failed_us) = (revision, None, None);
        Ok(())
    }

    /// Writes the state if it changed and it is time. Returns whether the file is up to date.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn save_changes(&mut self, hand: &mut Hand, when: When) -> Result<bool, BadInput> {
        let (revision, now_us) = (hand.revision(), hand.now_us());
        if revision == self.written {
            return Ok(true);
        }
        let (newest, since_us, first_us) = self.unsaved.unwrap_or((revision, now_us, now_us));
        let since_us = if newest == revision { since_us } else { now_us };
        self.unsaved = Some((revision, since_us, first_us));
        let has_paused = now_us - since_us >= QUIET_US || now_us - first_us >= MAX_DELAY_US;
        let may_retry = self.failed_us.is_none_or(|failed_us| now_us - failed_us >= RETRY_US);
        let is_due = match when {
            When::Now => true,
            When::Prompt => may_retry,
            When::Pause => has_paused && may_retry,
        };
        if is_due {
            self.write(hand)?;
        }
        Ok(is_due)
    }

    /// Not by [`programs::files`]: the lock makes a fixed name safe, under which a kill leaves one file at most, and the state is synced.
    fn replace(&self, bytes: &[u8]) -> io::Result<()> {
        let part = with_suffix(&self.path, "part");
        let written =
            File::create(&part).and_then(|mut file| file.write_all(bytes).and_then(|()| file.sync_all()));
        if let Err(error) = written.and_then(|()| fs::rename(&part, &self.path)) {
            // What has been written of it fills the disk.
            let _ = fs::remove_file(&part);
            return Err(error);
        }
        // The rename is durable once the folder is synced.
        match self.path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            Some(folder) => File::open(folder)?.sync_all(),
            None => File::open(".")?.sync_all(),
        }
    }
}

fn lock(path: &Path) -> Result<File, BadInput> {
    let name = with_suffix(path, "lock");
    let next = "choose a writable folder";
    let file = File::options().create(true).append(true).open(&name).map_err(|error| {
        bad(path, &format!("{} cannot be created", name.display()), error.to_string(), "a file", next)
    })?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            let next = "stop the other hand, or use another file";
            Err(bad(path, "in use", "another hand that uses this file".to_owned(), "one hand", next))
        }
        Err(TryLockError::Error(error)) => {
            Err(bad(path, "cannot be locked", error.to_string(), "a file system with locks", next))
        }
    }
}

fn with_suffix(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".{ending}"));
    name.into()
}

fn bad(path: &Path, problem: &str, found: String, expected: &str, next: &str) -> BadInput {
    BadInput::new(format!("--state {}", path.display()), problem).found(found).expected(expected).next(next)
}
