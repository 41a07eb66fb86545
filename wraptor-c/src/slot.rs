//! Connections by number, and whose turn it is. One call at a time uses a hand; others wait for it, within their limits.

use std::collections::{BTreeMap, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicIsize, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};
use std::time::Duration;

use wraptor::{Deadline, Hand};

use crate::error::{Problem, wraptor_error};

/// A connection. Numbers are not used again.
pub type wraptor_hand = isize;

enum State {
    Idle(Box<Hand>),
    /// A call of this thread uses it.
    Busy(ThreadId),
    /// Closed while a call ran: that call drops the hand.
    Closing(ThreadId),
    Closed,
}

struct Turns {
    state: State,
    /// Threads that wait for their turn, the first one first.
    queue: VecDeque<ThreadId>,
}

pub(crate) struct Slot {
    number: wraptor_hand,
    turns: Mutex<Turns>,
    changed: Condvar,
    is_cancelled: AtomicBool,
}

static SLOTS: Mutex<BTreeMap<wraptor_hand, Arc<Slot>>> = Mutex::new(BTreeMap::new());
static NEXT: AtomicIsize = AtomicIsize::new(1);

/// What a lock protects here is replaced as a whole: no panic leaves it half done.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// How often all connections have been closed: a connect that began before is closed, too.
static CLOSED_ALL: AtomicUsize = AtomicUsize::new(0);

/// Numbers a connection, which `connect` makes.
pub(crate) fn insert(connect: impl FnOnce() -> Result<Hand, Problem>) -> Result<wraptor_hand, Problem> {
    let begun = CLOSED_ALL.load(Ordering::SeqCst);
    let hand = connect()?;
    let mut slots = locked(&SLOTS);
    if CLOSED_ALL.load(Ordering::SeqCst) != begun {
        drop(slots);
        let text = "connect: wraptor_ws_down was called meanwhile\n  next: connect again";
        return Err(Problem::new(wraptor_error::WRAPTOR_CANCELLED, text));
    }
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let slot = Slot {
        number,
        turns: Mutex::new(Turns { state: State::Idle(Box::new(hand)), queue: VecDeque::new() }),
        changed: Condvar::new(),
        is_cancelled: AtomicBool::new(false),
    };
    slots.insert(number, Arc::new(slot));
    Ok(number)
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

/// Of a callback that calls a function of its own connection: it would wait for itself.
fn own_call(number: wraptor_hand) -> Problem {
    let text = format!(
        "connection {number}: this thread's own call uses it\n  next: return from the callback first; its return value ends the call"
    );
    Problem::new(wraptor_error::WRAPTOR_INVALID, text)
}

fn is_own(thread: ThreadId) -> bool {
    thread == thread::current().id()
}

/// Closes all connections, also those that are being made.
pub(crate) fn close_all(deadline: &Deadline) -> Result<(), Problem> {
    let slots = locked(&SLOTS);
    CLOSED_ALL.fetch_add(1, Ordering::SeqCst);
    let numbers: Vec<wraptor_hand> = slots.keys().copied().collect();
    drop(slots);
    let closed = numbers.into_iter().map(|number| match close(number, deadline) {
        // Another thread has closed it.
        Err(problem) if problem.code == wraptor_error::WRAPTOR_BAD_HANDLE => Ok(()),
        outcome => outcome,
    });
    // All are closed, also after an error.
    let outcomes: Vec<_> = closed.collect();
    outcomes.into_iter().collect()
}

/// Closes a connection. A call that runs is cancelled and waited for.
pub(crate) fn close(number: wraptor_hand, deadline: &Deadline) -> Result<(), Problem> {
    let slot = find(number)?;
    let mut turns = locked(&slot.turns);
    match std::mem::replace(&mut turns.state, State::Closed) {
        State::Idle(hand) => {
            drop(turns);
            slot.forget();
            // Not under a lock: its reader is joined.
            drop(hand);
            return Ok(());
        }
        State::Closed => return Err(bad_handle(number)),
        State::Busy(thread) if is_own(thread) => {
            turns.state = State::Busy(thread);
            return Err(own_call(number));
        }
        State::Busy(thread) | State::Closing(thread) => turns.state = State::Closing(thread),
    }
    slot.is_cancelled.store(true, Ordering::SeqCst);
    slot.changed.notify_all();
    let is_open = |turns: &mut Turns| !matches!(turns.state, State::Closed);
    let waited = slot.changed.wait_timeout_while(turns, deadline.remaining(), is_open);
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
    /// Its number is none any more; who waits for its end is told.
    fn forget(&self) {
        locked(&SLOTS).remove(&self.number);
        self.changed.notify_all();
    }

    /// Ends the call that runs.
    pub fn cancel(&self) {
        if matches!(locked(&self.turns).state, State::Busy(_)) {
            self.is_cancelled.store(true, Ordering::SeqCst);
        }
    }

    pub fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::SeqCst)
    }

    /// Takes the hand for a call, after the calls of other threads that came before.
    pub fn take(self: &Arc<Self>, deadline: &Deadline) -> Result<Taken, Problem> {
        let (number, me) = (self.number, thread::current().id());
        let mut turns = locked(&self.turns);
        turns.queue.push_back(me);
        let must_wait = |turns: &mut Turns| match turns.state {
            State::Idle(_) => turns.queue.front() != Some(&me),
            State::Busy(thread) => thread != me,
            State::Closing(_) | State::Closed => false,
        };
        let waited = self.changed.wait_timeout_while(turns, deadline.remaining(), must_wait);
        turns = waited.unwrap_or_else(PoisonError::into_inner).0;
        let has_turn = !must_wait(&mut turns);
        turns.queue.retain(|thread| *thread != me);
        // There is another first one.
        self.changed.notify_all();
        match std::mem::replace(&mut turns.state, State::Closed) {
            State::Idle(hand) if has_turn => {
                turns.state = State::Busy(me);
                self.is_cancelled.store(false, Ordering::SeqCst);
                Ok(Taken { slot: Arc::clone(self), hand: Some(hand) })
            }
            State::Busy(thread) if thread == me => {
                turns.state = State::Busy(me);
                Err(own_call(number))
            }
            waits @ (State::Idle(_) | State::Busy(_)) => {
                turns.state = waits;
                Err(Problem::new(
                    wraptor_error::WRAPTOR_TIMED_OUT,
                    format!(
                        "connection {number}: a call of another thread has not ended\n  next: wait for it, or wraptor_cancel"
                    ),
                ))
            }
            closed => {
                turns.state = closed;
                Err(bad_handle(number))
            }
        }
    }

    /// Waits for so long, or until it is closed.
    pub fn rest(&self, limit: Duration) {
        let is_open = |turns: &mut Turns| !matches!(turns.state, State::Closing(_) | State::Closed);
        drop(self.changed.wait_timeout_while(locked(&self.turns), limit, is_open));
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
        let mut turns = locked(&self.slot.turns);
        let is_kept = matches!(turns.state, State::Busy(_)) && !thread::panicking();
        if is_kept && let Some(hand) = self.hand.take() {
            turns.state = State::Idle(hand);
            drop(turns);
            self.slot.changed.notify_all();
        } else {
            // Not under the lock: its reader is joined.
            drop(turns);
            self.hand = None;
            locked(&self.slot.turns).state = State::Closed;
            self.slot.forget();
        }
    }
}
