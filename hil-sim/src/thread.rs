//! Threads that may be refused: the system limits their number and their memory (`ulimit -u`, `ulimit -v`, a container).

use std::io;
use std::thread::Builder;

/// Starts a thread; [`std::thread::spawn`] would panic where the system refuses it.
///
/// # Errors
/// The system's reason.
pub fn start(work: impl FnOnce() + Send + 'static) -> io::Result<()> {
    Builder::new().spawn(work).map(drop).map_err(|error| {
        io::Error::new(error.kind(), format!("a thread cannot be started: {error} (see ulimit -u and -v)"))
    })
}
