//! Error codes, and the last error of each thread.

use std::cell::RefCell;
use std::ffi::{CString, c_char, c_int};

use wraptor::{CallError, ConnectError, Failure};

/// What a function returns.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum wraptor_error {
    /// Done.
    WRAPTOR_OK = 0,
    /// A pointer is NULL that must not be; nothing was sent.
    WRAPTOR_NULL = 1,
    /// No connection has this number: it was never made, or is closed.
    WRAPTOR_BAD_HANDLE = 2,
    /// An argument is wrong, such as an unknown node or a value out of range, or a callback uses its own connection; nothing was sent.
    WRAPTOR_INVALID = 3,
    /// Not done within the limit. A motion or a line of the language was told to abort; a get or a wait stops no motor.
    WRAPTOR_TIMED_OUT = 4,
    /// The connection is lost.
    WRAPTOR_LOST = 5,
    /// Ended by `wraptor_cancel`, by `wraptor_close_connection`, or by ^C.
    WRAPTOR_CANCELLED = 6,
    /// The hand answered ERR; `wraptor_error_status` has its number.
    WRAPTOR_STATUS = 7,
    /// Motor boards do not answer.
    WRAPTOR_NO_ANSWER = 8,
    /// A motion ended early.
    WRAPTOR_NOT_REACHED = 9,
    /// No connection was made.
    WRAPTOR_NOT_CONNECTED = 10,
    /// A file cannot be read, or is no firmware.
    WRAPTOR_FILE = 11,
    /// What was received is not of the protocol, or a board does not do what it was told.
    WRAPTOR_UNEXPECTED = 12,
    /// A download ended without the new application.
    WRAPTOR_DOWNLOAD = 13,
    /// A defect of this library. The connection is closed.
    WRAPTOR_INTERNAL = 14,
}

/// Why a call failed, with its text.
pub(crate) struct Problem {
    pub code: wraptor_error,
    /// The number after ERR; 0 for other errors.
    pub status: u16,
    pub text: String,
}

impl Problem {
    pub fn new(code: wraptor_error, text: impl Into<String>) -> Self {
        Self { code, status: 0, text: text.into() }
    }

    pub fn null(argument: &str) -> Self {
        Self::new(
            wraptor_error::WRAPTOR_NULL,
            format!("{argument}: NULL\n  next: give it a value; nothing was sent"),
        )
    }

    pub fn invalid(what: &str) -> Self {
        let text = format!("{what}\n  next: correct the argument; nothing was sent");
        Self::new(wraptor_error::WRAPTOR_INVALID, text)
    }
}

impl From<CallError> for Problem {
    fn from(error: CallError) -> Self {
        let code = match &error.failure {
            Failure::Invalid(_) => wraptor_error::WRAPTOR_INVALID,
            Failure::TimedOut(_) => wraptor_error::WRAPTOR_TIMED_OUT,
            Failure::Lost(_) => wraptor_error::WRAPTOR_LOST,
            Failure::Cancelled => wraptor_error::WRAPTOR_CANCELLED,
            Failure::Status(_) => wraptor_error::WRAPTOR_STATUS,
            Failure::Silent(_) | Failure::Asleep(_) => wraptor_error::WRAPTOR_NO_ANSWER,
            Failure::NotReached { .. } => wraptor_error::WRAPTOR_NOT_REACHED,
            Failure::Download { .. } => wraptor_error::WRAPTOR_DOWNLOAD,
            _ => wraptor_error::WRAPTOR_UNEXPECTED,
        };
        let status = match error.failure {
            Failure::Status(status) => status.code(),
            _ => 0,
        };
        Self { code, status, text: error.to_string() }
    }
}

impl From<ConnectError> for Problem {
    fn from(error: ConnectError) -> Self {
        Self::new(wraptor_error::WRAPTOR_NOT_CONNECTED, error.to_string())
    }
}

thread_local! {
    static LAST: RefCell<(CString, u16)> = RefCell::default();
}

/// Keeps the outcome of a call for this thread.
pub(crate) fn keep(outcome: Result<(), Problem>) -> wraptor_error {
    let Problem { code, status, text } =
        outcome.err().unwrap_or_else(|| Problem::new(wraptor_error::WRAPTOR_OK, ""));
    // What a hand sends may contain a zero.
    let text = CString::new(text.replace('\0', "?")).unwrap_or_default();
    LAST.with_borrow_mut(|last| *last = (text, status));
    code
}

/// Cause and next step of the last call of this thread, in English; empty if it succeeded. Valid until this thread's next call.
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_error_text() -> *const c_char {
    LAST.with_borrow(|last| last.0.as_ptr())
}

/// The number after ERR that the hand answered to the last call of this thread; 0 if there was none.
// SAFETY: no other symbol has this name.
#[unsafe(no_mangle)]
pub extern "C" fn wraptor_error_status() -> c_int {
    LAST.with_borrow(|last| last.1.into())
}
