//! Threads for `CreateThread` of the compatibility header.

use std::ffi::c_void;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread::{Builder, JoinHandle};

use crate::border::{border, store};
use crate::error::{Problem, wraptor_error};
use crate::slot::Deadline;

/// What a thread runs.
pub type wraptor_thread_function = Option<unsafe extern "C" fn(argument: *mut c_void) -> u32>;

/// Threads, each with what tells its end.
static THREADS: Mutex<Vec<(JoinHandle<()>, Receiver<()>)>> = Mutex::new(Vec::new());

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
        if !id.is_null() {
            // SAFETY: the caller's promise.
            unsafe { store("id", id, u32::try_from(threads.len()).unwrap_or(u32::MAX)) }?;
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
