//! The file in which a hand keeps what it keeps without power: read at the start, written whole whenever there is something new.
//!
//! Whoever reads it finds all of an old state or all of a new one, whenever the program or the machine was stopped: a new one is
//! written beside it (`FILE.part`), put on the disk, and renamed. `FILE.lock` keeps a second program out while the first runs.

use std::fs::{self, File, TryLockError};
use std::io::{self, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use crate::experiment::input::BadInput;
use crate::world::hand::Hand;
use crate::world::hand::state::State;

/// Most bytes that are read: seven whole flashes of 128 KiB and GOD are less.
const MOST: u64 = 1 << 20;

/// Simulated time without news after which a state is written, us: boards store one after another, with pauses of an erase, 40 ms.
const SETTLED_US: u64 = 200_000;

/// Simulated time from the first news to when it is written at the latest, us.
const LATEST_US: u64 = 2_000_000;

/// A state file that is this program's.
pub struct Keeper {
    path: PathBuf,
    /// Locked as long as it is open.
    _lock: File,
    /// The revision that is in the file.
    written: u64,
    /// The newest revision, since when it is, and since when there has been one that is not in the file, us.
    news: Option<(u64, u64, u64)>,
}

impl Keeper {
    /// Takes a state file, and reads what is in it; `None` if there is none yet.
    ///
    /// # Errors
    /// Somebody else has it, it cannot be read, or it is no state; it stays as it is.
    pub fn open(path: &Path) -> Result<(Self, Option<State>), BadInput> {
        // A link stays one: the file that it names is replaced.
        let path = &fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let lock = lock(path)?;
        let keeper = Self { path: path.clone(), _lock: lock, written: 0, news: None };
        let mut bytes = Vec::new();
        match File::open(path).and_then(|file| file.take(MOST + 1).read_to_end(&mut bytes)) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok((keeper, None)),
            Err(error) => {
                let next = "check the path, or name a file that does not exist yet";
                return Err(bad(path, "cannot be read", error.to_string(), "a state file", next));
            }
            Ok(_) => {}
        }
        let state = State::from_bytes(&bytes).map_err(|error| {
            let problem = format!("no state of a hand, from byte {} on; it is left as it is", error.at);
            let next = "restore a copy, or name a file that does not exist yet: it is made";
            bad(path, &problem, error.found, &error.expected, next)
        })?;
        Ok((keeper, Some(state)))
    }

    /// Writes what a hand keeps.
    ///
    /// # Errors
    /// The file cannot be written; the old one is still there.
    pub fn write(&mut self, hand: &mut Hand) -> Result<(), BadInput> {
        let revision = hand.revision();
        // If it fails, it is news from now on.
        self.news = Some((revision, hand.now_us(), hand.now_us()));
        self.replace(&hand.state().to_bytes()).map_err(|error| {
            let next = "free space, or choose a folder that can be written to";
            bad(&self.path, "cannot be written", error.to_string(), "a file that can be replaced", next)
        })?;
        (self.written, self.news) = (revision, None);
        Ok(())
    }

    /// Writes it if there is something new: at once if `now`, and else when nothing more has come for a while.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn follow(&mut self, hand: &mut Hand, now: bool) -> Result<(), BadInput> {
        let (revision, now_us) = (hand.revision(), hand.now_us());
        if revision == self.written {
            return Ok(());
        }
        let (newest, since_us, first_us) = self.news.unwrap_or((revision, now_us, now_us));
        let since_us = if newest == revision { since_us } else { now_us };
        self.news = Some((revision, since_us, first_us));
        if now || now_us - since_us >= SETTLED_US || now_us - first_us >= LATEST_US {
            self.write(hand)?;
        }
        Ok(())
    }

    fn replace(&self, bytes: &[u8]) -> io::Result<()> {
        let part = beside(&self.path, "part");
        let mut file = File::create(&part)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&part, &self.path)?;
        // The new name is on the disk when the folder is.
        match self.path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            Some(folder) => File::open(folder)?.sync_all(),
            None => File::open(".")?.sync_all(),
        }
    }
}

fn lock(path: &Path) -> Result<File, BadInput> {
    let name = beside(path, "lock");
    let next = "choose a folder that can be written to";
    let file = File::options().create(true).append(true).open(&name).map_err(|error| {
        bad(path, &format!("{} cannot be made", name.display()), error.to_string(), "a file", next)
    })?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            let next = "stop the other one, or give this one a state of its own";
            Err(bad(path, "in use", "another hand that keeps its state there".to_owned(), "one hand", next))
        }
        Err(TryLockError::Error(error)) => {
            Err(bad(path, "cannot be locked", error.to_string(), "a file system with locks", next))
        }
    }
}

fn beside(path: &Path, ending: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(format!(".{ending}"));
    name.into()
}

fn bad(path: &Path, problem: &str, found: String, expected: &str, next: &str) -> BadInput {
    BadInput {
        place: format!("--state {}", path.display()),
        problem: problem.to_owned(),
        found,
        expected: expected.to_owned(),
        next: next.to_owned(),
    }
}
