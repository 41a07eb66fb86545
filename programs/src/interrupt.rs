//! ^C (SIGINT), and SIGTERM and SIGHUP alike, in commands that write files or have results before their end.
//!
//! Elsewhere ^C ends the program as the system does it. From the first call of a function here, ^C removes the temporary files of
//! [`files`](super::files) and ends the program with [`CODE`]. After [`finish_first`], and in [`during`], the first ^C only sets a flag.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, Once, PoisonError};

use tempfile::{NamedTempFile, TempPath};

/// Exit code of a program that ^C ended: 128 and the number of SIGINT, as shells have it.
pub const CODE: u8 = 130;

struct State {
    /// Temporary files; dropping one removes it.
    parts: Vec<TempPath>,
    /// Whether the first ^C only sets the flag.
    finishes: bool,
    interrupted: bool,
}

impl State {
    const NEW: Self = Self { parts: Vec::new(), finishes: false, interrupted: false };

    /// A call begins that the first ^C does not end.
    const fn begin(&mut self) {
        (self.finishes, self.interrupted) = (true, false);
    }

    /// What ^C does. Returns whether the program ends now.
    fn interrupt(&mut self) -> bool {
        if self.finishes && !self.interrupted {
            self.interrupted = true;
            return false;
        }
        self.parts.clear();
        true
    }
}

static STATE: Mutex<State> = Mutex::new(State::NEW);

/// The state, with ^C handled from now on.
fn state() -> MutexGuard<'static, State> {
    static HANDLED: Once = Once::new();
    // Where the handler's thread is refused, ^C works as without it.
    HANDLED.call_once(|| _ = ctrlc::set_handler(on_interrupt));
    STATE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs on a thread of its own.
fn on_interrupt() {
    // Locked to the end: meanwhile no other thread makes or renames a temporary file.
    let mut state = STATE.lock().unwrap_or_else(PoisonError::into_inner);
    if state.interrupt() {
        std::process::exit(CODE.into());
    }
}

/// Lets the first ^C set the flag of [`interrupted`] only; the second ends the program.
pub fn finish_first() {
    state().finishes = true;
}

/// Handles ^C from now on: it ends the program with [`CODE`].
pub fn handle() {
    drop(state());
}

/// Runs a call during which the first ^C only sets the flag of [`interrupted`]. Any other ends the program.
pub fn during<T>(call: impl FnOnce() -> T) -> T {
    state().begin();
    let outcome = call();
    state().finishes = false;
    outcome
}

/// Whether ^C was pressed since [`finish_first`], or during the last call of [`during`].
pub fn interrupted() -> bool {
    STATE.lock().unwrap_or_else(PoisonError::into_inner).interrupted
}

/// Makes a temporary file, which ^C removes until [`settle`]. Returns its path too.
///
/// # Errors
/// Those of `make`.
pub(crate) fn temporary(make: impl FnOnce() -> io::Result<NamedTempFile>) -> io::Result<(File, PathBuf)> {
    let mut state = state();
    let (file, part) = make()?.into_parts();
    let path = part.to_path_buf();
    state.parts.push(part);
    Ok((file, path))
}

/// Renames or removes a temporary file; nothing if that was done before.
///
/// # Errors
/// Those of `settle`.
pub(crate) fn settle(part: &Path, settle: impl FnOnce(TempPath) -> io::Result<()>) -> io::Result<()> {
    let mut state = state();
    match state.parts.iter().position(|other| **other == *part) {
        Some(at) => settle(state.parts.swap_remove(at)),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_interrupt_is_a_flag_if_the_program_finishes_first() {
        let mut state = State { finishes: true, ..State::NEW };
        assert!(!state.interrupt() && state.interrupted);
        assert!(state.interrupt());
        let mut plain = State::NEW;
        assert!(plain.interrupt());
    }

    #[test]
    fn each_call_has_a_flag_of_its_own_and_none_remains_after_it() {
        let mut state = State::NEW;
        for _ in 0..2 {
            state.begin();
            assert!(!state.interrupted);
            assert!(!state.interrupt());
            assert!(state.interrupted);
            state.finishes = false;
            assert!(state.interrupted && state.interrupt(), "between two calls");
        }
    }

    #[test]
    fn interrupt_removes_the_temporary_files() {
        let (_file, part) = NamedTempFile::new().expect("the temporary folder can be written").into_parts();
        let path = part.to_path_buf();
        assert!(path.exists() && State { parts: vec![part], ..State::NEW }.interrupt());
        assert!(!path.exists());
    }
}
