//! GOD's ports: bytes to and from the host, frames to and from the bus, the time; and what its future waits for.
//!
//! The owner puts in what has come, polls the future once ([`poll`]), and takes out what is to go. Every queue has an end: what GOD
//! has to say waits until there is room, so that a host that never reads costs no memory, and no motor.

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use core::fmt::{self, Write};
use core::future::{Future, poll_fn};
use core::pin::Pin;
use core::task::{Context, Poll, Waker};

use heapless::Deque;
use heapless::String;
use tater_wire::Frame;

/// ^C: ends what goes on.
pub const ABORT: u8 = 3;

/// Bytes of the host that may wait while a command goes on: a pasted line or two. What comes beyond that is lost, as on a serial line.
const INPUT: usize = 256;

/// Bytes for the host that may wait.
const OUTPUT: usize = 1024;

/// Frames that may wait either way: an answer of seven boards to three questions, and reports.
const FRAMES: usize = 32;

/// Longest text that is said at once.
pub const TEXT: usize = 128;

/// No deadline.
pub const NEVER: u64 = u64::MAX;

/// The ports.
#[derive(Debug, Default)]
pub struct Io {
    now_us: Cell<u64>,
    /// The earliest deadline that something waits for.
    next_us: Cell<u64>,
    input: RefCell<Deque<u8, INPUT>>,
    output: RefCell<Deque<u8, OUTPUT>>,
    received: RefCell<Deque<Frame, FRAMES>>,
    frames: RefCell<Deque<Frame, FRAMES>>,
    /// ^C was heard, and nobody has acted on it.
    aborted: Cell<bool>,
    /// In RealTime any byte is data, ^C among them.
    raw: Cell<bool>,
    /// CR or LF, if that was the last byte of the text.
    line_end: Cell<Option<u8>>,
    /// See [`Io::baud`].
    baud: Cell<u16>,
    /// Of this board, 0.1 °C.
    temperature: Cell<i16>,
    /// Bytes or frames that were lost because a queue was full.
    lost: Cell<u32>,
}

// --- the owner's side -----------------------------------------------------------------------------------

/// Lets GOD do all that it can do at `now_us`. Returns when it is to be polled again at the latest, if nothing comes in before: [`NEVER`], if it
/// waits for something to come in.
pub fn poll<F: Future + ?Sized>(god: Pin<&mut F>, io: &Io, now_us: u64) -> u64 {
    io.now_us.set(now_us);
    io.next_us.set(NEVER);
    // It never ends: what it gives back has no value.
    let _ = god.poll(&mut Context::from_waker(Waker::noop()));
    io.next_us.get()
}

impl Io {
    /// A byte from the host.
    pub fn hear(&self, byte: u8) {
        if byte == ABORT && !self.raw.get() {
            // What was typed ahead is no longer meant.
            self.input.borrow_mut().clear();
            self.aborted.set(true);
        } else if self.input.borrow_mut().push_back(byte).is_err() {
            self.lost.set(self.lost.get().saturating_add(1));
        }
    }

    /// How many more bytes of the host there is room for.
    #[must_use]
    pub fn room(&self) -> usize {
        INPUT.saturating_sub(self.input.borrow().len())
    }

    /// A frame from the bus.
    pub fn receive(&self, frame: &Frame) {
        if self.received.borrow_mut().push_back(*frame).is_err() {
            self.lost.set(self.lost.get().saturating_add(1));
        }
    }

    /// The next byte for the host.
    pub fn byte(&self) -> Option<u8> {
        self.output.borrow_mut().pop_front()
    }

    /// The next frame for the bus.
    pub fn frame(&self) -> Option<Frame> {
        self.frames.borrow_mut().pop_front()
    }

    /// The temperature of GOD's board, 0.1 °C.
    pub fn set_temperature(&self, temperature: i16) {
        self.temperature.set(temperature);
    }

    /// The host is gone, and a new one may come: what it has said and not heard is forgotten, and what goes on is aborted.
    pub fn hang_up(&self) {
        self.input.borrow_mut().clear();
        self.output.borrow_mut().clear();
        self.aborted.set(true);
    }

    /// Whether any byte is data now, ^C among them.
    #[must_use]
    pub const fn is_raw(&self) -> bool {
        self.raw.get()
    }

    /// How fast the serial line to the host is to be, Bd / 100 (parameter BAUD). Whoever has a line follows it.
    #[must_use]
    pub const fn baud(&self) -> u16 {
        self.baud.get()
    }

    /// Bytes and frames that found no room.
    #[must_use]
    pub const fn lost(&self) -> u32 {
        self.lost.get()
    }
}

// --- GOD's side -----------------------------------------------------------------------------------------

impl Io {
    /// The present time, us.
    #[must_use]
    pub const fn now_us(&self) -> u64 {
        self.now_us.get()
    }

    /// The temperature of this board, 0.1 °C.
    pub(crate) const fn temperature(&self) -> i16 {
        self.temperature.get()
    }

    /// Waits until `ready` gives something, or until `deadline_us`.
    pub(crate) async fn until<T>(&self, deadline_us: u64, mut ready: impl FnMut() -> Option<T>) -> Option<T> {
        poll_fn(|_| {
            if let Some(found) = ready() {
                return Poll::Ready(Some(found));
            }
            if self.now_us.get() >= deadline_us {
                return Poll::Ready(None);
            }
            self.next_us.set(self.next_us.get().min(deadline_us));
            Poll::Pending
        })
        .await
    }

    /// Waits for a time to come.
    pub(crate) async fn sleep_until(&self, deadline_us: u64) {
        self.until::<()>(deadline_us, || None).await;
    }

    /// The next byte of the host, or `None` at the deadline.
    pub(crate) async fn hears(&self, deadline_us: u64) -> Option<u8> {
        self.until(deadline_us, || self.input.borrow_mut().pop_front()).await
    }

    /// Whether the host has said something that nobody has read.
    pub(crate) fn is_spoken_to(&self) -> bool {
        self.is_aborted() || !self.input.borrow().is_empty()
    }

    /// A byte of the host that is there already.
    pub(crate) fn heard(&self) -> Option<u8> {
        self.input.borrow_mut().pop_front()
    }

    /// Takes note of a byte of the text, CR or LF or another; whether it is the second of both, and the line has ended already.
    pub(crate) fn ends_line(&self, end: Option<u8>) -> bool {
        let before = self.line_end.replace(end);
        let is_second = end.is_some() && before.is_some() && before != end;
        if is_second {
            self.line_end.set(None);
        }
        is_second
    }

    /// The next frame of the bus, or `None` at the deadline.
    pub(crate) async fn receives(&self, deadline_us: u64) -> Option<Frame> {
        self.until(deadline_us, || self.received.borrow_mut().pop_front()).await
    }

    /// A frame of the bus that is there already.
    pub(crate) fn received(&self) -> Option<Frame> {
        self.received.borrow_mut().pop_front()
    }

    /// Puts a frame on the bus, as soon as there is room.
    pub(crate) async fn send(&self, frame: Frame) {
        self.until(NEVER, || self.frames.borrow_mut().push_back(frame).ok()).await;
    }

    /// Says bytes to the host, as soon as there is room for all of them; of more than [`TEXT`] one by one.
    pub(crate) async fn say(&self, bytes: &[u8]) {
        for piece in bytes.chunks(TEXT) {
            self.until(NEVER, || {
                let mut output = self.output.borrow_mut();
                let room = OUTPUT.checked_sub(output.len()).filter(|&room| room >= piece.len());
                room.map(|_| piece.iter().for_each(|&byte| _ = output.push_back(byte)))
            })
            .await;
        }
    }

    /// Says a text of up to [`TEXT`] bytes, which ends there.
    pub(crate) async fn print(&self, text: fmt::Arguments<'_>) {
        let mut said = String::<TEXT>::new();
        // What does not fit is cut off.
        let _ = said.write_fmt(text);
        self.say(said.as_bytes()).await;
    }

    /// Whether ^C has come since this was last asked.
    pub(crate) fn takes_abort(&self) -> bool {
        self.aborted.replace(false)
    }

    /// Whether ^C is there, and stays.
    pub(crate) const fn is_aborted(&self) -> bool {
        self.aborted.get()
    }

    /// What goes on is to end, as by ^C.
    pub(crate) fn abort(&self) {
        self.aborted.set(true);
    }

    /// Tells how fast the serial line is to be, Bd / 100.
    pub(crate) fn set_baud(&self, baud: u16) {
        self.baud.set(baud);
    }

    /// What came while any byte was data, and has not been used as such, is text: a ^C in it makes void what came before it.
    pub(crate) fn reread(&self) {
        let mut input = self.input.borrow_mut();
        if let Some(last) = input.iter().rposition(|&byte| byte == ABORT) {
            (0..=last).for_each(|_| _ = input.pop_front());
            self.aborted.set(true);
        }
    }

    /// Whether every byte is data from now on.
    pub(crate) fn set_raw(&self, raw: bool) {
        self.raw.set(raw);
    }
}

/// Does `work` to its end, or until ^C: then `None`, and the work is dropped where it was.
pub(crate) async fn unless_aborted<T>(io: &Io, work: impl Future<Output = T>) -> Option<T> {
    let mut work = core::pin::pin!(work);
    poll_fn(|context| {
        if io.is_aborted() {
            return Poll::Ready(None);
        }
        work.as_mut().poll(context).map(Some)
    })
    .await
}

/// Does two things at once, to the end of both.
pub(crate) async fn both<A, B>(one: impl Future<Output = A>, other: impl Future<Output = B>) -> (A, B) {
    let (mut one, mut other) = (core::pin::pin!(one), core::pin::pin!(other));
    let (mut first, mut second) = (None, None);
    poll_fn(|context| {
        if first.is_none()
            && let Poll::Ready(done) = one.as_mut().poll(context)
        {
            first = Some(done);
        }
        if second.is_none()
            && let Poll::Ready(done) = other.as_mut().poll(context)
        {
            second = Some(done);
        }
        match (first.take(), second.take()) {
            (Some(one), Some(other)) => Poll::Ready((one, other)),
            (one, other) => {
                (first, second) = (one, other);
                Poll::Pending
            }
        }
    })
    .await
}

/// Does `work` to its end, and `meanwhile` as long as that takes: after it each time, because it may just have given it something to do.
pub(crate) async fn with<T>(meanwhile: impl Future<Output = Infallible>, work: impl Future<Output = T>) -> T {
    let mut meanwhile = core::pin::pin!(meanwhile);
    let mut work = core::pin::pin!(work);
    poll_fn(|context| {
        let work = work.as_mut().poll(context);
        if work.is_pending() {
            let _: Poll<Infallible> = meanwhile.as_mut().poll(context);
        }
        work
    })
    .await
}
