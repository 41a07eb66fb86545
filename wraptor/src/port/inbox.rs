//! Bytes for an interpreter in this program, which another thread writes.

use std::collections::VecDeque;
use std::io::{self, ErrorKind};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::event::Waker;
use crate::deadline::Deadline;

/// Most bytes that wait, as much as a socket takes of a peer that does not read.
const MOST: usize = 1 << 16;

#[derive(Default)]
struct Waiting {
    bytes: VecDeque<u8>,
    /// The host has closed the connection.
    is_closed: bool,
    /// The interpreter has ended.
    is_gone: bool,
}

pub(crate) struct Inbox {
    waiting: Mutex<Waiting>,
    /// Bytes were taken.
    taken: Condvar,
    waker: Waker,
}

impl Inbox {
    pub fn new(waker: Waker) -> Self {
        Self { waiting: Mutex::default(), taken: Condvar::new(), waker }
    }

    /// Every change under the lock is one step: no panic leaves it half done.
    fn locked(&self) -> MutexGuard<'_, Waiting> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds bytes.
    ///
    /// # Errors
    /// The interpreter has ended, or takes nothing until the deadline.
    pub fn write(&self, bytes: &[u8], deadline: &Deadline) -> io::Result<()> {
        let is_full = |waiting: &mut Waiting| {
            !waiting.is_gone && waiting.bytes.len() + bytes.len() > MOST && !waiting.bytes.is_empty()
        };
        let waited = self.taken.wait_timeout_while(self.locked(), deadline.remaining(), is_full);
        let (mut waiting, timeout) = waited.unwrap_or_else(PoisonError::into_inner);
        match (waiting.is_gone, timeout.timed_out()) {
            (true, _) => Err(ErrorKind::BrokenPipe.into()),
            (false, true) => Err(ErrorKind::TimedOut.into()),
            (false, false) => {
                waiting.bytes.extend(bytes);
                drop(waiting);
                self.waker.wake();
                Ok(())
            }
        }
    }

    /// Tells the interpreter that the host has closed the connection.
    pub fn close(&self) {
        self.locked().is_closed = true;
        self.waker.wake();
    }

    /// Hands the bytes that wait to `take`. Returns whether it has left some.
    pub fn take(&self, take: impl FnOnce(&mut VecDeque<u8>)) -> bool {
        let mut waiting = self.locked();
        take(&mut waiting.bytes);
        let is_left = !waiting.bytes.is_empty();
        drop(waiting);
        self.taken.notify_all();
        is_left
    }

    /// Whether the host has closed the connection.
    pub fn is_closed(&self) -> bool {
        self.locked().is_closed
    }

    /// Nobody takes bytes any more.
    pub fn end(&self) {
        self.locked().is_gone = true;
        self.taken.notify_all();
    }
}
