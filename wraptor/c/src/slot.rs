//! Connections by number. One call at a time uses a hand; others wait for their turn, within their limits.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicIsize, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use wraptor::turns::Turn;
use wraptor::{Deadline, Hand, NoTurn, Turns};

use crate::error::{Problem, wraptor_error};

/// A connection. Numbers are not used again, and are larger than any file descriptor: read, write and close of POSIX refuse them.
pub type wraptor_hand = isize;

pub(crate) struct Slot {
    number: wraptor_hand,
    hand: Turns<Box<Hand>>,
    /// The number of the turn that is to end.
    cancelled: AtomicU64,
}

static SLOTS: Mutex<BTreeMap<wraptor_hand, Arc<Slot>>> = Mutex::new(BTreeMap::new());
/// Linux has at most 2^30 descriptors, and a process 2^20 unless it is told otherwise.
const FIRST: wraptor_hand = 1 << 30;

static NEXT: AtomicIsize = AtomicIsize::new(FIRST);

/// How often all connections have been closed: a connect that began before is closed, too.
static CLOSED_ALL: AtomicUsize = AtomicUsize::new(0);

/// Every change is one step: no panic leaves it half done.
fn slots() -> MutexGuard<'static, BTreeMap<wraptor_hand, Arc<Slot>>> {
    SLOTS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Numbers a connection, which `connect` makes.
pub(crate) fn insert(connect: impl FnOnce() -> Result<Hand, Problem>) -> Result<wraptor_hand, Problem> {
    let begun = CLOSED_ALL.load(Ordering::SeqCst);
    let hand = Box::new(connect()?);
    let mut slots = slots();
    if CLOSED_ALL.load(Ordering::SeqCst) != begun {
        drop(slots);
        let text = "connect: wraptor_ws_down was called meanwhile\n  next: connect again";
        return Err(Problem::new(wraptor_error::WRAPTOR_CANCELLED, text));
    }
    let number = NEXT.fetch_add(1, Ordering::Relaxed);
    let slot = Slot { number, hand: Turns::new(hand), cancelled: AtomicU64::new(0) };
    slots.insert(number, Arc::new(slot));
    Ok(number)
}

fn bad_handle(number: wraptor_hand) -> Problem {
    let text = format!(
        "connection {number}: none has this number\n  next: use what a connect function stored, before wraptor_close_connection"
    );
    Problem::new(wraptor_error::WRAPTOR_BAD_HANDLE, text)
}

fn no_turn(number: wraptor_hand, why: NoTurn, next: &str) -> Problem {
    let (code, text) = match why {
        NoTurn::Closed => return bad_handle(number),
        NoTurn::Late => (wraptor_error::WRAPTOR_TIMED_OUT, format!("a call of another thread has not ended\n  next: {next}")),
        NoTurn::Own => (
            wraptor_error::WRAPTOR_INVALID,
            "this thread's own call uses it\n  next: return from the callback first; its return value ends the call".to_owned(),
        ),
    };
    Problem::new(code, format!("connection {number}: {text}"))
}

pub(crate) fn find(number: wraptor_hand) -> Result<Arc<Slot>, Problem> {
    slots().get(&number).cloned().ok_or_else(|| bad_handle(number))
}

/// Numbers of all connections.
pub(crate) fn numbers() -> Vec<wraptor_hand> {
    slots().keys().copied().collect()
}

/// Closes all connections, also those that are being made.
pub(crate) fn close_all(deadline: &Deadline) -> Result<(), Problem> {
    let slots = slots();
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
    let outcome = slot.hand.close(deadline, |turn| slot.cancelled.store(turn, Ordering::SeqCst));
    if !matches!(outcome, Err(NoTurn::Late | NoTurn::Own)) {
        slots().remove(&number);
    }
    outcome.map_err(|why| no_turn(number, why, "none; the connection closes with that call"))
}

impl Slot {
    /// Ends the call that runs.
    pub fn cancel(&self) {
        if let Some(turn) = self.hand.number() {
            self.cancelled.store(turn, Ordering::SeqCst);
        }
    }

    /// Whether the call that runs is to end.
    pub fn is_cancelled(&self) -> bool {
        self.hand.number() == Some(self.cancelled.load(Ordering::SeqCst))
    }

    /// Takes the hand for a call, after the calls of other threads that came before.
    pub fn take(&self, deadline: &Deadline) -> Result<Turn<'_, Box<Hand>>, Problem> {
        self.hand.take(deadline).map_err(|why| {
            if why == NoTurn::Closed {
                slots().remove(&self.number);
            }
            no_turn(self.number, why, "wait for it, or wraptor_cancel")
        })
    }

    /// Waits for so long, or until it is closed.
    pub fn rest(&self, limit: Duration) {
        self.hand.rest(limit);
    }
}
