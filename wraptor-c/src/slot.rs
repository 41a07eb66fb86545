//! Connections by number, and whose turn it is. One call at a time uses a hand; others wait for it, within their limits.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicIsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use wraptor::Hand;

use crate::error::{Problem, wraptor_error};

/// A connection. Numbers are not used again.
pub type wraptor_hand = isize;

/// The end of a call.
#[derive(Clone, Copy)]
pub(crate) struct Deadline {
    start: Instant,
    limit: Duration,
}

impl Deadline {
    pub fn after(limit: Duration) -> Self {
        Self { start: Instant::now(), limit }
    }

    pub fn remaining(&self) -> Duration {
        self.limit.saturating_sub(self.start.elapsed())
    }
}

enum State {
    Idle(Box<Hand>),
    Busy,
    /// Closed while a call ran: that call drops the hand.
    Closing,
    Closed,
}

pub(crate) struct Slot {
    state: Mutex<State>,
    changed: Condvar,
    is_cancelled: AtomicBool,
}

static SLOTS: Mutex<BTreeMap<wraptor_hand, Arc<Slot>>> = Mutex::new(BTreeMap::new());
static NEXT: AtomicIsize = AtomicIsize::new(1);

/// What a lock protects here is replaced as a whole: no panic leaves it half done.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(crate) fn insert(hand: Hand) -> wraptor_hand {
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let slot = Slot {
        state: Mutex::new(State::Idle(Box::new(hand))),
        changed: Condvar::new(),
        is_cancelled: AtomicBool::new(false),
    };
    locked(&SLOTS).insert(number, Arc::new(slot));
    number
}

fn bad_handle(number: wraptor_hand) -> Problem {
    let text = format!(
        "connection {number}: none has this number\n  next: use what wraptor_tcp_connect stored, before wraptor_close_connection"
    );
    Problem::new(wraptor_error::WRAPTOR_BAD_HANDLE, text)
}

pub(crate) fn find(number: wraptor_hand) -> Result<Arc<Slot>, Problem> {
    locked(&SLOTS).get(&number).cloned().ok_or_else(|| bad_handle(number))
}

/// Numbers of all connections.
pub(crate) fn numbers() -> Vec<wraptor_hand> {
    locked(&SLOTS).keys().copied().collect()
}

/// Closes a connection. A call that runs is cancelled and waited for.
pub(crate) fn close(number: wraptor_hand, deadline: &Deadline) -> Result<(), Problem> {
    let slot = locked(&SLOTS).remove(&number).ok_or_else(|| bad_handle(number))?;
    let mut state = locked(&slot.state);
    match std::mem::replace(&mut *state, State::Closed) {
        State::Busy => *state = State::Closing,
        idle => {
            drop(state);
            slot.changed.notify_all();
            drop(idle);
            return Ok(());
        }
    }
    slot.is_cancelled.store(true, Ordering::SeqCst);
    slot.changed.notify_all();
    let is_open = |state: &mut State| !matches!(state, State::Closed);
    let waited = slot.changed.wait_timeout_while(state, deadline.remaining(), is_open);
    match waited.unwrap_or_else(PoisonError::into_inner).1.timed_out() {
        false => Ok(()),
        true => Err(Problem::new(
            wraptor_error::WRAPTOR_TIMED_OUT,
            format!(
                "connection {number}: a call of another thread has not ended\n  next: none; the connection closes with that call"
            ),
        )),
    }
}

impl Slot {
    /// Ends the call that runs.
    pub fn cancel(&self) {
        if matches!(*locked(&self.state), State::Busy) {
            self.is_cancelled.store(true, Ordering::SeqCst);
        }
    }

    pub fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::SeqCst)
    }

    /// Takes the hand for a call, after the calls of other threads.
    pub fn take(self: &Arc<Self>, number: wraptor_hand, deadline: &Deadline) -> Result<Taken, Problem> {
        let is_busy = |state: &mut State| matches!(state, State::Busy);
        let waited = self.changed.wait_timeout_while(locked(&self.state), deadline.remaining(), is_busy);
        let mut state = waited.unwrap_or_else(PoisonError::into_inner).0;
        match std::mem::replace(&mut *state, State::Busy) {
            State::Idle(hand) => {
                self.is_cancelled.store(false, Ordering::SeqCst);
                Ok(Taken { slot: Arc::clone(self), hand: Some(hand) })
            }
            State::Busy => Err(Problem::new(
                wraptor_error::WRAPTOR_TIMED_OUT,
                format!(
                    "connection {number}: a call of another thread has not ended\n  next: wait for it, or wraptor_cancel"
                ),
            )),
            closed => {
                *state = closed;
                Err(bad_handle(number))
            }
        }
    }

    /// Waits until something has changed, or for so long.
    pub fn rest(&self, limit: Duration) {
        let state = locked(&self.state);
        if !matches!(*state, State::Closing | State::Closed) {
            drop(self.changed.wait_timeout(state, limit));
        }
    }
}

/// A hand that a call uses. Dropping it ends the call's turn; after a panic it closes the connection.
pub(crate) struct Taken {
    slot: Arc<Slot>,
    hand: Option<Box<Hand>>,
}

impl Taken {
    pub fn hand(&mut self) -> &mut Hand {
        // Only `drop` takes it.
        self.hand.as_mut().expect("a call has its hand")
    }
}

impl Drop for Taken {
    fn drop(&mut self) {
        let mut state = locked(&self.slot.state);
        let is_kept = matches!(*state, State::Busy) && !std::thread::panicking();
        if is_kept && let Some(hand) = self.hand.take() {
            *state = State::Idle(hand);
        } else {
            // Not under the lock: its reader is joined.
            drop(state);
            self.hand = None;
            *locked(&self.slot.state) = State::Closed;
        }
        self.slot.changed.notify_all();
    }
}
