//! ^C, SIGTERM and SIGHUP: the first one during a call cancels it, any other ends the program. Its connection is then reset, and the hand aborts.

use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a program that ^C ended: 128 and the number of SIGINT, as shells have it.
pub const CODE: u8 = 130;

static CALLING: AtomicBool = AtomicBool::new(false);
static PRESSED: AtomicBool = AtomicBool::new(false);

/// Handles ^C from now on. Where the system refuses, ^C ends the program as without it.
pub fn handle() {
    let handler = || {
        if !CALLING.load(Ordering::SeqCst) || PRESSED.swap(true, Ordering::SeqCst) {
            std::process::exit(CODE.into());
        }
    };
    let _ = ctrlc::set_handler(handler);
}

/// Whether ^C was pressed during the present call.
pub fn pressed() -> bool {
    PRESSED.load(Ordering::SeqCst)
}

/// Runs a call that ends when [`pressed`] is true.
pub fn during<T>(call: impl FnOnce() -> T) -> T {
    PRESSED.store(false, Ordering::SeqCst);
    CALLING.store(true, Ordering::SeqCst);
    let outcome = call();
    CALLING.store(false, Ordering::SeqCst);
    outcome
}
