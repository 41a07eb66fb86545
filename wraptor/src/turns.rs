//! A value that several threads use in turn, in the order of their calls and each within its limit.

use std::collections::VecDeque;
use std::ops::{Deref, DerefMut};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};
use std::time::Duration;

use crate::deadline::Deadline;

/// Why a thread has no turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoTurn {
    /// This thread has it already: it is in a callback of its own call, and would wait for itself.
    Own,
    /// Another thread's turn has not ended within the limit.
    Late,
    /// It is closed, or of the process that this one was forked from.
    Closed,
}

#[derive(Debug)]
enum Holder<T> {
    Free(T),
    /// This thread's turn.
    Used(ThreadId),
    /// The same, and the value is dropped after it.
    Closing(ThreadId),
    Closed,
}

#[derive(Debug)]
struct Inside<T> {
    holder: Holder<T>,
    /// Threads that wait, the first one first.
    queue: VecDeque<ThreadId>,
    /// Turns that have begun.
    count: u64,
}

/// A value that threads use in turn.
#[derive(Debug)]
pub struct Turns<T> {
    inside: Mutex<Inside<T>>,
    changed: Condvar,
    /// In a process that was forked from this one, threads that have a turn or wait for it do not exist: there it is closed.
    process: u32,
}

impl<T> Turns<T> {
    /// A value that nobody uses yet.
    pub fn new(value: T) -> Self {
        let inside = Inside { holder: Holder::Free(value), queue: VecDeque::new(), count: 0 };
        Self { inside: Mutex::new(inside), changed: Condvar::new(), process: std::process::id() }
    }

    /// What the lock protects is replaced as a whole: no panic leaves it half done.
    fn locked(&self) -> MutexGuard<'_, Inside<T>> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_inherited(&self) -> bool {
        self.process != std::process::id()
    }

    /// Takes the value for a turn, after the threads that came before.
    ///
    /// # Errors
    /// Why there is no turn.
    pub fn take(&self, deadline: &Deadline) -> Result<Turn<'_, T>, NoTurn> {
        if self.is_inherited() {
            return Err(NoTurn::Closed);
        }
        let me = thread::current().id();
        let mut inside = self.locked();
        inside.queue.push_back(me);
        let must_wait = |inside: &mut Inside<T>| match inside.holder {
            Holder::Free(_) => inside.queue.front() != Some(&me),
            Holder::Used(thread) => thread != me,
            Holder::Closing(_) | Holder::Closed => false,
        };
        let waited = self.changed.wait_timeout_while(inside, deadline.remaining(), must_wait);
        inside = waited.unwrap_or_else(PoisonError::into_inner).0;
        let has_turn = !must_wait(&mut inside);
        inside.queue.retain(|thread| *thread != me);
        // Another thread is the first one now.
        self.changed.notify_all();
        match std::mem::replace(&mut inside.holder, Holder::Used(me)) {
            Holder::Free(value) if has_turn => {
                inside.count += 1;
                Ok(Turn { of: self, value: Some(value) })
            }
            before => {
                inside.holder = before;
                Err(match inside.holder {
                    Holder::Used(thread) if thread == me => NoTurn::Own,
                    Holder::Used(_) | Holder::Free(_) => NoTurn::Late,
                    Holder::Closing(_) | Holder::Closed => NoTurn::Closed,
                })
            }
        }
    }

    /// Drops the value. A turn of another thread is waited for, and drops it. `end_turn` gets that turn's number, to make it end
    /// early.
    ///
    /// # Errors
    /// [`NoTurn::Late`]: that turn goes on, and drops the value at its end; [`NoTurn::Own`]: nothing is closed; [`NoTurn::Closed`] already.
    pub fn close(&self, deadline: &Deadline, end_turn: impl FnOnce(u64)) -> Result<(), NoTurn> {
        if self.is_inherited() {
            return Err(NoTurn::Closed);
        }
        let mut inside = self.locked();
        match std::mem::replace(&mut inside.holder, Holder::Closed) {
            Holder::Free(value) => {
                drop(inside);
                self.changed.notify_all();
                drop(value);
                return Ok(());
            }
            Holder::Closed => return Err(NoTurn::Closed),
            Holder::Used(thread) if thread == thread::current().id() => {
                inside.holder = Holder::Used(thread);
                return Err(NoTurn::Own);
            }
            Holder::Used(thread) | Holder::Closing(thread) => inside.holder = Holder::Closing(thread),
        }
        end_turn(inside.count);
        self.changed.notify_all();
        let is_open = |inside: &mut Inside<T>| !matches!(inside.holder, Holder::Closed);
        let waited = self.changed.wait_timeout_while(inside, deadline.remaining(), is_open);
        if waited.unwrap_or_else(PoisonError::into_inner).1.timed_out() { Err(NoTurn::Late) } else { Ok(()) }
    }

    /// The number of the turn that a thread has, from 1 on; `None` if none has one.
    pub fn number(&self) -> Option<u64> {
        let inside = self.locked();
        matches!(inside.holder, Holder::Used(_) | Holder::Closing(_)).then_some(inside.count)
    }

    /// Waits for so long, or until it is closed.
    pub fn rest(&self, limit: Duration) {
        let is_open = |inside: &mut Inside<T>| !matches!(inside.holder, Holder::Closing(_) | Holder::Closed);
        drop(self.changed.wait_timeout_while(self.locked(), limit, is_open));
    }
}

/// A thread's turn, which ends with this. After a panic the value is dropped.
#[derive(Debug)]
pub struct Turn<'a, T> {
    of: &'a Turns<T>,
    /// Taken by `drop` alone.
    value: Option<T>,
}

impl<T> Deref for Turn<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.value.as_ref().expect("only drop takes it")
    }
}

impl<T> DerefMut for Turn<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        self.value.as_mut().expect("only drop takes it")
    }
}

impl<T> Drop for Turn<'_, T> {
    fn drop(&mut self) {
        let mut inside = self.of.locked();
        let is_kept = matches!(inside.holder, Holder::Used(_)) && !thread::panicking();
        if is_kept && let Some(value) = self.value.take() {
            inside.holder = Holder::Free(value);
        } else {
            // Not under the lock: dropping a connection joins its reader.
            drop(inside);
            self.value = None;
            inside = self.of.locked();
            inside.holder = Holder::Closed;
        }
        drop(inside);
        self.of.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    fn within(limit: Duration) -> Deadline {
        Deadline::after(limit)
    }

    #[test]
    fn threads_take_turns_in_the_order_of_their_calls() {
        let turns = Turns::new(Vec::new());
        let first = turns.take(&within(LONG)).expect("free");
        thread::scope(|scope| {
            for number in 0..4 {
                let turns = &turns;
                scope.spawn(move || turns.take(&within(LONG)).expect("its turn").push(number));
                while turns.locked().queue.len() <= number {
                    thread::yield_now();
                }
            }
            drop(first);
        });
        assert_eq!(*turns.take(&within(LONG)).expect("free"), [0, 1, 2, 3]);
    }

    #[test]
    fn wait_ends_with_its_limit_and_leaves_no_place_in_the_queue() {
        let turns = Turns::new(());
        let turn = turns.take(&within(LONG)).expect("free");
        assert_eq!(turns.take(&within(LONG)).map(drop), Err(NoTurn::Own));
        let late = || turns.take(&within(Duration::from_millis(1))).map(drop);
        assert_eq!(thread::scope(|scope| scope.spawn(late).join().expect("it ends")), Err(NoTurn::Late));
        assert_eq!((turns.number(), turns.close(&within(LONG), |_| {})), (Some(1), Err(NoTurn::Own)));
        drop(turn);
        assert!(turns.number().is_none() && turns.locked().queue.is_empty());
        assert_eq!(turns.take(&within(Duration::ZERO)).map(drop), Ok(()));
    }

    #[test]
    fn value_is_dropped_by_the_close_or_by_the_turn_that_it_meets() {
        let (turns, count) = (Turns::new(std::sync::Arc::new(())), std::sync::Arc::new(()));
        *turns.take(&within(LONG)).expect("free") = std::sync::Arc::clone(&count);
        let turn = turns.take(&within(LONG)).expect("free");
        let mut told = 0;
        let close = || turns.close(&within(Duration::from_millis(1)), |number| told = number);
        assert_eq!(thread::scope(|scope| scope.spawn(close).join().expect("it ends")), Err(NoTurn::Late));
        assert!(told == 2 && std::sync::Arc::strong_count(&count) == 2);
        assert_eq!(turns.take(&within(LONG)).map(drop), Err(NoTurn::Closed));
        drop(turn);
        assert_eq!(std::sync::Arc::strong_count(&count), 1);
        assert_eq!(turns.close(&within(LONG), |_| {}), Err(NoTurn::Closed));
    }

    #[test]
    fn panic_in_a_turn_closes() {
        let turns = Turns::new(());
        let panics = || {
            let _turn = turns.take(&within(LONG)).expect("free");
            panic!("in its turn");
        };
        assert!(thread::scope(|scope| scope.spawn(panics).join().is_err()));
        assert_eq!(turns.take(&within(LONG)).map(drop), Err(NoTurn::Closed));
    }
}
