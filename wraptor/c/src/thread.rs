//! Threads for `CreateThread` of the compatibility header.

use std::ffi::c_void;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};

use wraptor::Deadline;

use crate::border::{border, store};
use crate::error::{Problem, wraptor_error};

/// What a thread runs.
// SAFETY: who passes one promises that it may be called like this.
pub type wraptor_thread_function = Option<unsafe extern "C" fn(argument: *mut c_void) -> u32>;

/// Threads, each with what tells its end.
static THREADS: Mutex<Vec<(JoinHandle<()>, Receiver<()>)>> = Mutex::new(Vec::new());

/// Threads that have had a number.
static STARTED: AtomicU32 = AtomicU32::new(0);

/// An argument that only the thread's function looks at.
struct Argument(*mut c_void);

// SAFETY: this library only passes it on; whoever starts the thread promises that the function may use it there.
unsafe impl Send for Argument {}

/// Starts a thread that runs `function` with `argument`, such as the compatibility header's Listener, and stores its number in `id`, if that is
/// not NULL. `wraptor_ws_down` waits for its end.
///
/// # Safety
/// `function` is NULL or may be called in another thread with `argument`; `id` is NULL or may be written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn wraptor_start_thread(
    function: wraptor_thread_function,
    argument: *mut c_void,
    id: *mut u32,
) -> wraptor_error {
    border(|| {
        let function = function.ok_or_else(|| Problem::null("function"))?;
        let argument = Argument(argument);
        // Dropping the handle of a thread that has ended frees its stack.
        THREADS.lock().unwrap_or_else(PoisonError::into_inner).retain(|(thread, _)| !thread.is_finished());
        let (end, ended) = sync_channel::<()>(0);
        let run = move || {
            // The whole of `argument`, so that it is sent as such.
            let argument = argument;
            // SAFETY: the caller's promise.
            let _ = unsafe { function(argument.0) };
            drop(end);
        };
        let thread = Builder::new().name("wraptor-listener".to_owned()).spawn(run).map_err(|error| {
            let text = format!(
                "thread: the system refuses: {error}\n  next: end other programs, or raise the limit"
            );
            Problem::new(wraptor_error::WRAPTOR_UNEXPECTED, text)
        })?;
        let mut threads = THREADS.lock().unwrap_or_else(PoisonError::into_inner);
        threads.push((thread, ended));
        drop(threads);
        if !id.is_null() {
            let number = STARTED.fetch_add(1, Ordering::Relaxed).wrapping_add(1);
            // SAFETY: the caller's promise.
            unsafe { store("id", id, number) }?;
        }
        Ok(())
    })
}

/// Waits for the end of all threads but this one.
pub(crate) fn join_all(deadline: &Deadline) -> Result<(), Problem> {
    let threads = std::mem::take(&mut *THREADS.lock().unwrap_or_else(PoisonError::into_inner));
    for (thread, ended) in threads {
        if thread.thread().id() == std::thread::current().id() {
            continue;
        }
        if matches!(ended.recv_timeout(deadline.remaining()), Err(RecvTimeoutError::Timeout)) {
            let text = "threads: one has not ended\n  next: end its function when the connection is closed";
            return Err(Problem::new(wraptor_error::WRAPTOR_TIMED_OUT, text));
        }
        // A panic in it has been reported.
        let _ = thread.join();
    }
    Ok(())
}
