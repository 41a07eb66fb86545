//! GOD's ports: bytes to and from the host, frames to and from the bus, the time; and what its future waits for.
//!
//! The owner pushes received bytes and frames, polls the future once ([`poll`]) and pops what GOD sends. Every queue is bounded, and so is
//! every wait for the bus: a send gives up after [`SEND_US`]. Output to a host that does not read waits until ^C or a hang-up.

use core::cell::Cell;
use core::convert::Infallible;
use core::future::{Future, poll_fn};
use core::pin::Pin;
use core::task::{Context, Poll, Waker};

use heapless::Deque;
use heapless::String;
use tater_wire::{Destination, Frame, Node};

use crate::events::{EventKind, EventLog};
use crate::framing::{self, Framing, Kind};
use crate::shared::Shared;
use crate::words::{Word, append};

/// ^C: aborts the running command.
pub const ABORT: u8 = framing::ABORT;

/// Received bytes that can wait while a command runs: a pasted line or two. Later ones are lost, as on any serial line.
const RX: usize = 256;

/// Bytes that can wait for the host.
const TX: usize = 1024;

/// Frames that can wait in either direction: the answers of seven boards to three questions, and reports.
const FRAMES: usize = 32;

/// Longest text that is written at once.
pub const TEXT: usize = 128;

/// Time without room for a frame after which the bus counts as down, µs. A full queue drains within 5 ms on an otherwise idle bus; 40 ms leave
/// room for a board that sends without pause.
pub const SEND_US: u64 = 40_000;

/// No deadline.
pub const NEVER: u64 = u64::MAX;

/// The bus takes no frames: no other station acknowledges, or the bus is shorted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BusDown;

/// Input of the host, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rx {
    /// A byte of a line; in RealTime any byte.
    Text(u8),
    /// The first byte of a packet.
    Head(u8),
    /// Another byte of it.
    Data(u8),
    /// In place of the rest of a packet.
    Broken,
}

#[derive(Clone, Copy, Debug)]
struct Queued {
    frame: Frame,
    since_us: u64,
}

/// Whether GOD waits for a line of the host.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Prompting {
    /// It runs a command.
    #[default]
    No,
    /// It waits for a line, and will report the ends of motions meanwhile.
    WithReportsDue,
    /// It waits for a line and has nothing left to send.
    Idle,
}

/// The ports.
#[derive(Debug, Default)]
pub struct Io {
    now_us: Cell<u64>,
    /// The earliest deadline that something waits for.
    next_us: Cell<u64>,
    rx: Shared<Deque<Rx, RX>>,
    framing: Cell<Framing>,
    /// Bytes came since the last poll.
    received: Cell<bool>,
    /// Time of the poll after the last byte.
    received_us: Cell<u64>,
    tx: Shared<Deque<u8, TX>>,
    rx_frames: Shared<Deque<Frame, FRAMES>>,
    tx_frames: Shared<Deque<Queued, FRAMES>>,
    cancel: Cell<bool>,
    /// The bus took no frames, and nothing came in since.
    is_bus_down: Cell<bool>,
    /// ^C arrived and is not handled yet.
    aborted: Cell<bool>,
    /// The host disconnected, and what it set is not reset yet.
    hung_up: Cell<bool>,
    /// In RealTime every byte is data, including ^C.
    raw: Cell<bool>,
    /// What GOD waits for, if it waits for a line.
    prompting: Cell<Prompting>,
    last_rx: Cell<Option<u8>>,
    /// CR or LF, if that was the last byte of the text.
    line_end: Cell<Option<u8>>,
    baud: Cell<u16>,
    /// Temperature of this board, 0.1 °C.
    temperature: Cell<i16>,
    /// Longest time that the owner's way to the bus adds to an answer, µs.
    link_us: Cell<u64>,
    lost_bytes: Cell<u32>,
    lost_frames: Cell<u32>,
    events: EventLog,
}

// --- the owner's side -----------------------------------------------------------------------------------

/// Runs GOD at `now_us` until it waits. Returns the time of the next poll if nothing arrives before; [`NEVER`] without a deadline.
pub fn poll<F: Future + ?Sized>(god: Pin<&mut F>, io: &Io, now_us: u64) -> u64 {
    io.now_us.set(now_us);
    io.next_us.set(NEVER);
    io.prompting.set(Prompting::No);
    io.end_broken_packet();
    // GOD never ends, so there is no result to look at.
    let _ = god.poll(&mut Context::from_waker(Waker::noop()));
    io.drop_stale_frames();
    io.next_us.get()
}

impl Io {
    /// Takes a byte from the host.
    pub fn push_rx(&self, byte: u8) {
        self.last_rx.set(Some(byte));
        self.received.set(true);
        if self.raw.get() { self.queue_rx(Rx::Text(byte)) } else { self.accept(byte) }
    }

    fn accept(&self, byte: u8) {
        let mut framing = self.framing.get();
        let kind = framing.accept(byte);
        self.framing.set(framing);
        match kind {
            // Type-ahead is void.
            Kind::Text if byte == ABORT => self.interrupt(),
            Kind::Text => self.queue_rx(Rx::Text(byte)),
            Kind::Head => self.queue_rx(Rx::Head(byte)),
            Kind::Data => self.queue_rx(Rx::Data(byte)),
            Kind::Discarded => {}
            Kind::Stop => self.stop_discarding(),
        }
    }

    /// ^C among bytes that are discarded: they go on, and so does their end.
    fn stop_discarding(&self) {
        self.rx.with(Deque::clear);
        self.abort();
    }

    fn queue_rx(&self, rx: Rx) {
        if self.rx.with(|waiting| waiting.push_back(rx).is_err()) {
            self.lost_bytes.set(self.lost_bytes.get().saturating_add(1));
            if let Rx::Head(_) | Rx::Data(_) = rx {
                let mut framing = self.framing.get();
                framing.discard();
                self.framing.set(framing);
                if framing.has_abort() {
                    self.stop_discarding();
                }
            }
        }
    }

    /// The serial line's break condition, or a Telnet client's Interrupt Process or Break: ^C that no byte before it can hide, neither a
    /// packet's nor RealTime's.
    pub fn push_break(&self) {
        self.received.set(true);
        self.interrupt();
    }

    /// ^C, ahead of all bytes that wait: those are void.
    pub fn interrupt(&self) {
        self.rx.with(Deque::clear);
        self.framing.set(Framing::default());
        self.abort();
    }

    /// Number of further bytes of the host that fit. Those that are discarded always do.
    #[must_use]
    pub fn rx_room(&self) -> usize {
        let is_discarding = !self.raw.get() && self.framing.get().is_discarding();
        if is_discarding { RX } else { RX.saturating_sub(self.rx.with(|waiting| waiting.len())) }
    }

    /// Takes a frame from the bus. One that is not for a host only shows that the bus is up: another host's download must not take the
    /// room of answers.
    pub fn push_frame(&self, frame: &Frame) {
        if self.is_bus_down.replace(false) {
            self.record(EventKind::BusUp);
        }
        let is_for_host = match frame.id().to {
            Destination::Node(node) => node == Node::HOST,
            Destination::Group(group) => !group.is_for_boards(),
        };
        if is_for_host && self.rx_frames.with(|frames| frames.push_back(*frame).is_err()) {
            self.lost_frames.set(self.lost_frames.get().saturating_add(1));
        }
    }

    /// Returns the next byte for the host.
    pub fn pop_tx(&self) -> Option<u8> {
        self.tx.with(Deque::pop_front)
    }

    /// Returns the next frame for the bus.
    pub fn pop_frame(&self) -> Option<Frame> {
        self.tx_frames.with(Deque::pop_front).map(|queued| queued.frame)
    }

    /// Returns `true` once after GOD dropped its queued frames. The owner then withdraws those that it took and the bus has not sent yet
    /// (bxCAN: ABRQ of each mailbox), so that no stale order leaves when the bus comes back. Call it before [`Io::pop_frame`].
    pub fn take_cancel(&self) -> bool {
        self.cancel.replace(false)
    }

    /// Sets the temperature of GOD's board, 0.1 °C.
    pub fn set_temperature(&self, temperature: i16) {
        self.temperature.set(temperature);
    }

    /// Sets how long the owner's way to the bus may delay an answer, µs: 0 for a CAN controller, more for an adapter on a network or a machine that
    /// runs other programs. Boards get so much more time before they count as silent.
    pub fn set_link_us(&self, us: u64) {
        self.link_us.set(us);
    }

    /// The host disconnected, and a new one may come: drops what is unread in both directions and aborts the running command.
    pub fn hang_up(&self) {
        self.tx.with(Deque::clear);
        self.hung_up.set(true);
        self.interrupt();
    }

    /// Whether this byte would be ^C now, for which there is always room: not in RealTime, nor in a packet.
    #[must_use]
    pub fn is_abort(&self, byte: u8) -> bool {
        byte == ABORT && !self.raw.get() && !self.framing.get().is_open()
    }

    /// Whether every byte is data now, including ^C.
    #[must_use]
    pub const fn is_raw(&self) -> bool {
        self.raw.get()
    }

    /// Whether GOD has read everything that arrived, and everything that it sent has been taken.
    #[must_use]
    pub fn is_drained(&self) -> bool {
        !self.has_input() && self.tx.with(|text| text.is_empty())
    }

    /// Whether GOD waits for a line, having answered all that it has read.
    #[must_use]
    pub fn waits_for_line(&self) -> bool {
        self.prompting.get() != Prompting::No
    }

    /// Whether GOD will report ends of motions to the host that waits for them (walk-through's grammar).
    #[must_use]
    pub fn has_reports_due(&self) -> bool {
        self.prompting.get() == Prompting::WithReportsDue
    }

    /// Baud rate of the serial line to the host / 100 (parameter BAUD). An owner with a line follows it.
    #[must_use]
    pub const fn baud(&self) -> u16 {
        self.baud.get()
    }

    /// Number of the host's bytes that found no room.
    #[must_use]
    pub const fn lost_bytes(&self) -> u32 {
        self.lost_bytes.get()
    }

    /// Number of frames for a host that found no room.
    #[must_use]
    pub const fn lost_frames(&self) -> u32 {
        self.lost_frames.get()
    }

    /// The event log.
    #[must_use]
    pub const fn events(&self) -> &EventLog {
        &self.events
    }
}

// --- GOD's side -----------------------------------------------------------------------------------------

impl Io {
    /// The present time, µs.
    #[must_use]
    pub const fn now_us(&self) -> u64 {
        self.now_us.get()
    }

    pub(crate) const fn after_us(&self, us: u64) -> u64 {
        self.now_us.get().saturating_add(us)
    }

    /// Longest time that the owner's way to the bus adds to an answer, µs.
    pub(crate) const fn link_us(&self) -> u64 {
        self.link_us.get()
    }

    /// Temperature of GOD's board, 0.1 °C.
    #[must_use]
    pub const fn temperature(&self) -> i16 {
        self.temperature.get()
    }

    pub(crate) fn record(&self, kind: EventKind) {
        self.events.record(self.now_us(), kind);
    }

    /// Waits until `ready` returns something, or until `deadline_us`.
    pub(crate) async fn wait_until<T>(
        &self,
        deadline_us: u64,
        mut ready: impl FnMut() -> Option<T>,
    ) -> Option<T> {
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

    pub(crate) async fn sleep_until(&self, deadline_us: u64) {
        self.wait_until::<()>(deadline_us, || None).await;
    }

    /// Reads the next byte of the host; `None` at the deadline.
    pub(crate) async fn read(&self, deadline_us: u64) -> Option<u8> {
        self.wait_until(deadline_us, || self.try_read()).await
    }

    pub(crate) fn try_read(&self) -> Option<u8> {
        loop {
            match self.try_read_rx()? {
                Rx::Text(byte) | Rx::Head(byte) | Rx::Data(byte) => return Some(byte),
                Rx::Broken => {}
            }
        }
    }

    pub(crate) fn try_read_rx(&self) -> Option<Rx> {
        self.rx.with(Deque::pop_front)
    }

    /// Ends a packet whose rest has not come for [`framing::SILENCE_US`]. While GOD has no room, its owner cannot pass on what has come.
    /// A 0x03 in it was ^C. Among bytes that are discarded it has been obeyed already, and its prompt is their answer.
    fn end_broken_packet(&self) {
        let received = self.received.take() || self.rx_room() == 0;
        if received {
            self.received_us.set(self.now_us());
        }
        let framing = self.framing.get();
        if !framing.is_open() || self.raw.get() {
            return;
        }
        let due_us = self.received_us.get().saturating_add(framing::SILENCE_US);
        if self.now_us() < due_us {
            self.next_us.set(self.next_us.get().min(due_us));
        } else if framing.has_abort() && !framing.is_discarding() {
            self.interrupt();
        } else {
            self.framing.set(Framing::default());
            if !framing.has_abort() {
                self.queue_rx(Rx::Broken);
            }
        }
    }

    /// Whether a byte or ^C from the host is pending.
    pub(crate) fn has_input(&self) -> bool {
        self.is_aborted() || !self.rx.with(|waiting| waiting.is_empty())
    }

    /// GOD waits for a line: the end of a condition of [`Io::wait_until`] that found nothing.
    pub(crate) fn wait_for_line<T>(&self, has_reports_due: bool) -> Option<T> {
        self.prompting.set(if has_reports_due { Prompting::WithReportsDue } else { Prompting::Idle });
        None
    }

    pub(crate) const fn last_rx(&self) -> Option<u8> {
        self.last_rx.get()
    }

    /// Tracks line ends: call it for each byte of text, with CR or LF, or `None` for any other byte. Returns whether this one is the second
    /// half of CR LF or LF CR, which ends no other line.
    pub(crate) fn is_second_line_end(&self, end: Option<u8>) -> bool {
        let before = self.line_end.replace(end);
        let is_second = end.is_some() && before.is_some() && before != end;
        if is_second {
            self.line_end.set(None);
        }
        is_second
    }

    pub(crate) async fn receive(&self, deadline_us: u64) -> Option<Frame> {
        self.wait_until(deadline_us, || self.try_receive()).await
    }

    pub(crate) fn try_receive(&self) -> Option<Frame> {
        self.rx_frames.with(Deque::pop_front)
    }

    /// Queues a frame for the bus, as soon as there is room.
    ///
    /// While the bus is down the frame is queued as well, and is sent if the bus comes back within [`SEND_US`].
    ///
    /// # Errors
    /// The bus took no frame for [`SEND_US`]: the queue is dropped. Or that happened before, and nothing came in since.
    pub(crate) async fn send(&self, frame: Frame) -> Result<(), BusDown> {
        let queued = self.wait_until(self.after_us(SEND_US), || {
            if self.is_stuck() { Some(false) } else { self.try_queue(frame).then_some(true) }
        });
        if queued.await != Some(true) {
            self.bus_failed();
            self.try_queue(frame);
        }
        if self.is_bus_down.get() { Err(BusDown) } else { Ok(()) }
    }

    pub(crate) const fn is_bus_down(&self) -> bool {
        self.is_bus_down.get()
    }

    /// Drops all frames that are not on the bus yet: they are stale, or void after ^C.
    pub(crate) fn drop_frames(&self) {
        self.tx_frames.with(Deque::clear);
        self.cancel.set(true);
    }

    /// Drops the queue once its oldest frame has waited for [`SEND_US`]. Without it the last orders before a prompt would wait for the
    /// next command, and leave whenever the bus comes back.
    fn drop_stale_frames(&self) {
        if self.is_stuck() {
            self.bus_failed();
        } else if let Some(since_us) = self.oldest_us() {
            self.next_us.set(self.next_us.get().min(since_us.saturating_add(SEND_US)));
        }
    }

    fn bus_failed(&self) {
        if !self.is_bus_down.replace(true) {
            self.record(EventKind::BusDown);
        }
        self.drop_frames();
    }

    fn oldest_us(&self) -> Option<u64> {
        self.tx_frames.with(|frames| frames.front().map(|queued| queued.since_us))
    }

    fn is_stuck(&self) -> bool {
        self.oldest_us().is_some_and(|since_us| self.now_us() >= since_us.saturating_add(SEND_US))
    }

    fn try_queue(&self, frame: Frame) -> bool {
        let queued = Queued { frame, since_us: self.now_us() };
        self.tx_frames.with(|frames| frames.push_back(queued).is_ok())
    }

    /// Writes bytes to the host once there is room for all of them; more than [`TEXT`] piece by piece. ^C and a hang-up discard the rest.
    pub(crate) async fn write(&self, bytes: &[u8]) {
        for piece in bytes.chunks(TEXT) {
            self.wait_until(NEVER, || {
                if self.is_aborted() {
                    self.discard_full_output();
                }
                self.try_write(piece).then_some(())
            })
            .await;
        }
    }

    /// Writes up to [`TEXT`] bytes if there is room for all of them.
    pub(crate) fn try_write(&self, bytes: &[u8]) -> bool {
        self.tx.with(|tx| {
            let fits = TX.saturating_sub(tx.len()) >= bytes.len();
            if fits {
                bytes.iter().for_each(|&byte| _ = tx.push_back(byte));
            }
            fits
        })
    }

    /// Drops what the host does not read, if there is no room for another text.
    pub(crate) fn discard_full_output(&self) {
        self.tx.with(|tx| {
            if TX.saturating_sub(tx.len()) < TEXT {
                tx.clear();
            }
        });
    }

    /// Writes a text of up to [`TEXT`] bytes; a longer one is cut off there.
    pub(crate) async fn print(&self, words: &[Word<'_>]) {
        let mut text = String::<TEXT>::new();
        append(&mut text, words);
        self.write(text.as_bytes()).await;
    }

    /// Whether the host has disconnected since the last call.
    pub(crate) fn take_hang_up(&self) -> bool {
        self.hung_up.replace(false)
    }

    pub(crate) fn take_abort(&self) -> bool {
        self.aborted.replace(false)
    }

    pub(crate) const fn is_aborted(&self) -> bool {
        self.aborted.get()
    }

    /// Aborts the running command, as ^C does.
    pub(crate) fn abort(&self) {
        self.record(EventKind::Aborted);
        self.aborted.set(true);
    }

    pub(crate) fn set_baud(&self, baud: u16) {
        self.baud.set(baud);
    }

    /// Ends raw mode: bytes that arrived as data and are unread are lines and packets now, and a ^C among them voids those before it.
    pub(crate) fn leave_raw(&self) {
        if !self.raw.replace(false) {
            return;
        }
        self.framing.set(Framing::default());
        let unread = self.rx.with(core::mem::take);
        for rx in &unread {
            if let Rx::Text(byte) | Rx::Head(byte) | Rx::Data(byte) = *rx {
                self.accept(byte);
            }
        }
    }

    /// Every byte is data from now on. A ^C in a packet that is not complete is obeyed now: no silence ends it any more.
    pub(crate) fn enter_raw(&self) {
        self.raw.set(true);
        let framing = self.framing.replace(Framing::default());
        if framing.has_abort() && !framing.is_discarding() {
            self.interrupt();
        }
    }
}

// The futures below are pinned by the caller: one that is given by value and pinned here would be stored twice, as the argument and as what is polled.

/// Runs `work` to its end, or until ^C: then the work goes no further, and this returns `None`.
pub(crate) async fn unless_aborted<T>(io: &Io, mut work: Pin<&mut impl Future<Output = T>>) -> Option<T> {
    poll_fn(|context| {
        if io.is_aborted() {
            return Poll::Ready(None);
        }
        let work = work.as_mut().poll(context).map(Some);
        // The work may abort itself.
        if work.is_pending() && io.is_aborted() { Poll::Ready(None) } else { work }
    })
    .await
}

pub(crate) async fn join<A, B>(
    mut one: Pin<&mut impl Future<Output = A>>,
    mut other: Pin<&mut impl Future<Output = B>>,
) -> (A, B) {
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

/// Runs `work` to its end, and `background` as long as that takes: polled after the work, which may just have given it something to do.
pub(crate) async fn with_background<T>(
    mut background: Pin<&mut impl Future<Output = Infallible>>,
    mut work: Pin<&mut impl Future<Output = T>>,
) -> T {
    poll_fn(|context| {
        let work = work.as_mut().poll(context);
        if work.is_pending() {
            let _: Poll<Infallible> = background.as_mut().poll(context);
        }
        work
    })
    .await
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::words::words;
    use core::pin::pin;
    use tater_wire::{Destination, Message, Node, Property};

    /// Polls `work` each millisecond. Returns its result and the time that took, or `None` after ten seconds.
    fn run<T>(io: &Io, work: impl Future<Output = T>) -> Option<(T, u64)> {
        let mut work = pin!(work);
        let start_us = io.now_us();
        (start_us..start_us + 10_000_000).step_by(1000).find_map(|now_us| {
            io.now_us.set(now_us);
            match work.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
                Poll::Ready(result) => Some((result, now_us - start_us)),
                Poll::Pending => None,
            }
        })
    }

    fn frame() -> Frame {
        Message::get(Destination::Node(Node::new(1).expect("a node")), Property::P).frame()
    }

    #[test]
    fn send_to_a_dead_bus_times_out_and_drops_the_queue() {
        let io = Io::default();
        for _ in 0..FRAMES {
            assert_eq!(run(&io, io.send(frame())), Some((Ok(()), 0)));
        }
        assert_eq!(run(&io, io.send(frame())), Some((Err(BusDown), SEND_US)));
        assert!(io.take_cancel(), "the owner withdraws what it took");
        assert_eq!(core::iter::from_fn(|| io.pop_frame()).count(), 1, "the last one probes the bus");
        // From then on nothing waits, until a frame comes in.
        assert_eq!(run(&io, io.send(frame())), Some((Err(BusDown), 0)));
        io.push_frame(&frame());
        assert_eq!(run(&io, io.send(frame())), Some((Ok(()), 0)));
    }

    #[test]
    fn frames_for_boards_take_no_room_from_answers() {
        let io = Io::default();
        let answer = Message::reply(Node::new(1).expect("a node"), Property::P, 7).expect("it fits").frame();
        for _ in 0..FRAMES {
            io.push_frame(&frame());
            io.push_frame(&answer);
        }
        assert_eq!((io.lost_frames(), io.lost_bytes()), (0, 0));
        io.push_frame(&answer);
        assert_eq!(io.lost_frames(), 1);
        assert_eq!(io.try_receive(), Some(answer));
    }

    #[test]
    fn send_after_a_stuck_frame_reports_bus_down_at_once() {
        let io = Io::default();
        assert_eq!(run(&io, io.send(frame())), Some((Ok(()), 0)));
        io.now_us.set(SEND_US);
        assert_eq!(run(&io, io.send(frame())), Some((Err(BusDown), 0)));
    }

    #[test]
    fn frames_left_on_a_dead_bus_are_dropped_without_another_send() {
        let io = Io::default();
        let mut god = pin!(async {
            let sent = io.send(frame()).await;
            io.wait_until::<()>(NEVER, || None).await;
            sent
        });
        assert_eq!(poll(god.as_mut(), &io, 7), SEND_US + 7, "it asks to be polled then");
        poll(god.as_mut(), &io, SEND_US + 6);
        assert!(!io.take_cancel());
        assert_eq!(poll(god.as_mut(), &io, SEND_US + 7), NEVER);
        assert!(io.take_cancel() && io.is_bus_down());
        assert_eq!(io.pop_frame(), None);
    }

    #[test]
    fn write_to_a_host_that_never_reads_ends_by_abort_and_by_hang_up() {
        let io = Io::default();
        for _ in 0..TX / TEXT {
            assert!(run(&io, io.write(&[b'x'; TEXT])).is_some());
        }
        assert_eq!(run(&io, io.write(b"y")), None, "it waits for the host");
        io.push_rx(ABORT);
        assert_eq!(run(&io, io.write(b"y")), Some(((), 0)));
        assert_eq!(io.pop_tx(), Some(b'y'), "what nobody read is gone");
        assert!(io.take_abort());
        for _ in 0..TX / TEXT {
            assert!(run(&io, io.write(&[b'x'; TEXT])).is_some());
        }
        io.hang_up();
        assert_eq!(run(&io, io.write(b"z")), Some(((), 0)));
        assert_eq!(io.pop_tx(), Some(b'z'));
    }

    fn text(io: &Io) -> std::string::String {
        core::iter::from_fn(|| io.pop_tx()).map(char::from).collect()
    }

    #[test]
    fn byte_3_is_abort_outside_of_packets_and_raw_mode() {
        let io = Io::default();
        assert!(io.is_abort(ABORT) && !io.is_abort(b'C'));
        io.push_rx(b'C');
        assert!(io.is_abort(ABORT), "within a line");
        io.push_rx(b'\r');
        io.push_rx(0);
        assert!(!io.is_abort(ABORT) && !io.is_abort(b'C'), "in a packet");
        io.interrupt();
        io.enter_raw();
        assert!(io.is_raw() && !io.is_abort(ABORT) && !io.is_abort(b'C'));
        io.leave_raw();
        assert!(!io.is_raw() && io.is_abort(ABORT));
    }

    #[test]
    fn io_is_drained_when_all_is_read_in_both_directions() {
        let io = Io::default();
        assert!(io.is_drained());
        io.push_rx(b'C');
        assert!(!io.is_drained(), "not read by GOD");
        assert_eq!(run(&io, io.read(NEVER)), Some((Some(b'C'), 0)));
        assert!(io.is_drained());
        assert!(run(&io, io.write(b"y")).is_some());
        assert!(!io.is_drained(), "not read by the host");
        assert_eq!(text(&io), "y");
        assert!(io.is_drained());
        io.abort();
        assert!(!io.is_drained(), "^C is not handled");
    }

    #[test]
    fn bytes_without_room_are_lost_and_counted() {
        let io = Io::default();
        for count in 0..RX {
            assert_eq!((io.rx_room(), io.lost_bytes()), (RX - count, 0));
            io.push_rx(b'x');
        }
        io.push_rx(b'y');
        io.push_rx(b'y');
        assert_eq!((io.rx_room(), io.lost_bytes(), io.lost_frames()), (0, 2, 0));
    }

    #[test]
    fn lost_byte_of_a_packet_discards_the_rest_but_a_lost_byte_of_text_does_not() {
        for (bytes, is_discarding) in
            [(&b"x"[..], false), (b"\r", false), (b"\r\x00", true), (b"\r\x00\x01", true)]
        {
            let io = Io::default();
            (1..RX).for_each(|_| io.push_rx(b'x'));
            bytes.iter().for_each(|&byte| io.push_rx(byte));
            io.push_rx(b'\x01');
            assert_eq!(io.framing.get().is_discarding(), is_discarding, "{bytes:?}");
        }
    }

    #[test]
    fn full_queue_keeps_a_packet_open() {
        let io = Io::default();
        (2..RX).for_each(|_| io.push_rx(b'x'));
        io.push_rx(b'\r');
        io.push_rx(0);
        assert_eq!(io.rx_room(), 0);
        let mut god = pin!(io.wait_until::<()>(NEVER, || None));
        for at_us in [0, 1000, 100_000] {
            assert_eq!(
                poll(god.as_mut(), &io, at_us),
                at_us + framing::SILENCE_US,
                "its owner holds the rest"
            );
        }
        while io.try_read_rx() != Some(Rx::Head(0)) {}
        assert_eq!(poll(god.as_mut(), &io, 100_001), 100_000 + framing::SILENCE_US);
        assert_eq!(poll(god.as_mut(), &io, 119_999), 120_000);
        assert!(io.framing.get().is_open());
        assert_eq!(poll(god.as_mut(), &io, 120_000), NEVER);
        assert_eq!((io.framing.get().is_open(), io.try_read_rx()), (false, Some(Rx::Broken)));
    }

    #[test]
    fn texts_are_written_whole_and_in_order() {
        let io = Io::default();
        let long: std::vec::Vec<u8> = (0..3 * TEXT + 5).map(|i| b'a' + (i % 26) as u8).collect();
        assert!(run(&io, io.write(&long)).is_some());
        assert_eq!(text(&io).as_bytes(), long);
        let room = |left: usize| {
            let io = Io::default();
            assert!((0..TX - left).all(|_| io.try_write(b"x")));
            io
        };
        assert!(room(2).try_write(b"yz"));
        let io = room(1);
        assert!(!io.try_write(b"yz"));
        assert_eq!(text(&io).len(), TX - 1, "nothing of it");
        for (left, kept) in [(TEXT, TX - TEXT), (TEXT - 1, 0)] {
            let io = room(left);
            io.discard_full_output();
            assert_eq!(text(&io).len(), kept, "room for {left}");
        }
        let io = Io::default();
        assert!(run(&io, io.print(words!["x".repeat(TEXT).as_str(), "cut off"])).is_some());
        assert_eq!(text(&io).len(), TEXT);
    }

    #[test]
    fn wait_ends_at_its_deadline_and_poll_returns_the_earliest() {
        let io = Io::default();
        io.now_us.set(500);
        assert_eq!(io.after_us(300), 800);
        assert_eq!(run(&io, io.wait_until::<()>(7500, || None)), Some((None, 7000)));
        assert_eq!(run(&io, io.wait_until(0, || Some(5))), Some((Some(5), 0)), "ready wins");
        let io = Io::default();
        let [one, two, three] = [30, 20, 40].map(|at_us| io.sleep_until(at_us));
        let (one, two, three) = (pin!(one), pin!(two), pin!(three));
        let others = pin!(join(two, three));
        let mut god = pin!(join(one, others));
        for (now_us, next_us) in [(10, 20), (20, 30), (29, 30), (30, 40), (39, 40), (40, NEVER)] {
            assert_eq!(poll(god.as_mut(), &io, now_us), next_us, "{now_us}");
            if now_us == 40 {
                return;
            }
        }
    }

    #[test]
    fn poll_says_what_god_waits_for() {
        let io = Io::default();
        for (has_reports_due, expected) in [(false, (true, false)), (true, (true, true))] {
            let mut god = pin!(io.wait_until::<()>(NEVER, || io.wait_for_line(has_reports_due)));
            poll(god.as_mut(), &io, 0);
            assert_eq!((io.waits_for_line(), io.has_reports_due()), expected);
        }
        poll(pin!(io.sleep_until(5)), &io, 0);
        assert!(!io.waits_for_line() && !io.has_reports_due(), "it runs a command");
    }

    #[test]
    fn second_half_of_a_line_end_is_none() {
        let io = Io::default();
        let ends: std::vec::Vec<bool> = [b'\r', b'\n', b'\r', b'\r', b'\n', b'\n', b'\r', b'x', b'\n']
            .map(|byte| io.is_second_line_end(Some(byte).filter(|&byte| byte != b'x')))
            .into();
        assert_eq!(ends, [false, true, false, false, true, false, true, false, false]);
    }

    #[test]
    fn hang_up_drops_output_and_is_taken_once() {
        let io = Io::default();
        assert!(!io.take_hang_up());
        assert!(run(&io, io.write(b"y")).is_some());
        io.push_rx(b'C');
        io.hang_up();
        assert_eq!((text(&io).as_str(), io.rx_room()), ("", RX));
        assert!(io.take_hang_up() && !io.take_hang_up());
        assert!(io.take_abort() && !io.take_abort());
    }

    #[test]
    fn raw_bytes_that_are_unread_become_lines_and_packets() {
        let io = Io::default();
        io.enter_raw();
        b"A\x03\r\x00\x01".iter().for_each(|&byte| io.push_rx(byte));
        io.leave_raw();
        assert!(io.take_abort(), "^C voids what precedes it");
        let read: std::vec::Vec<Rx> = core::iter::from_fn(|| io.try_read_rx()).collect();
        assert_eq!(read, [Rx::Text(b'\r'), Rx::Head(0), Rx::Data(1)]);
        io.interrupt();
        io.take_abort();
        io.push_rx(b'A');
        io.leave_raw();
        assert_eq!(io.rx_room(), RX - 1, "it was not raw");
    }

    /// What arrives with the queue filled but for two, and whether it is ^C at once, and 20 ms later; what the reader finds then.
    #[test]
    fn control_c_in_a_broken_packet_is_obeyed_although_the_queue_is_full() {
        for (bytes, at_once, later, broken) in [
            (&b"\x00\x01\x09\x03"[..], true, false, false),
            (b"\x00\x01\x09\x03\x00\x41", true, false, false),
            (b"\x00\x01\x09\x00", false, false, true),
            (b"\x00\x03", false, true, false),
            // The length has no room, so the rest is discarded.
            (b"\x00\x03\x04", true, false, false),
            (b"\x00\x01\x04\x00", false, false, true),
            (b"\x00\x01\x04\x03", true, false, false),
            // The host has read the prompt of ^C, and has typed a line.
            (b"\x00\x01\x09\x03FSAVE\r", true, false, true),
        ] {
            let io = Io::default();
            (0..RX - 2).for_each(|_| io.push_rx(b'\r'));
            bytes.iter().for_each(|&byte| io.push_rx(byte));
            let mut god = core::pin::pin!(io.sleep_until(NEVER));
            poll(god.as_mut(), &io, 1_000);
            assert_eq!(io.take_abort(), at_once, "{bytes:?}");
            io.rx.with(Deque::clear);
            poll(god.as_mut(), &io, 1_000);
            for now_us in [1_001, 1_001 + framing::SILENCE_US] {
                poll(god.as_mut(), &io, now_us);
            }
            assert_eq!(io.take_abort(), later, "{bytes:?} later");
            assert_eq!(io.try_read_rx() == Some(Rx::Broken), broken, "{bytes:?}");
            assert!(!io.framing.get().is_open(), "{bytes:?}");
        }
    }

    #[test]
    fn control_c_among_endless_bytes_is_obeyed_and_their_end_is_quiet() {
        let io = Io::default();
        let mut god = pin!(io.sleep_until(NEVER));
        b"\x00\x01\x09".iter().for_each(|&byte| io.push_rx(byte));
        for now_us in (0..100_000).step_by(1_000) {
            io.push_rx(if now_us == 50_000 { ABORT } else { 0 });
            poll(god.as_mut(), &io, now_us);
            assert_eq!(io.take_abort(), now_us == 50_000);
        }
        poll(god.as_mut(), &io, 200_000);
        assert_eq!((io.framing.get().is_open(), io.try_read_rx()), (false, None));
    }

    #[test]
    fn break_aborts_in_a_line_in_a_packet_and_in_raw_mode() {
        for (bytes, is_raw) in
            [(&b""[..], false), (b"C", false), (b"\r\x00\x01\x04", false), (b"C\x05", true)]
        {
            let io = Io::default();
            if is_raw {
                io.enter_raw();
            }
            bytes.iter().for_each(|&byte| io.push_rx(byte));
            io.push_break();
            assert!(io.take_abort(), "{bytes:?}");
            assert_eq!((io.rx_room(), io.framing.get().is_open()), (RX, false), "{bytes:?}");
        }
    }

    #[test]
    fn raw_mode_obeys_a_control_c_in_a_broken_packet() {
        for (bytes, is_abort) in [
            (&b"\x00\x01\x09\x03"[..], true),
            (b"\x00\x01\x09\x03A", true),
            (b"\x00\x03", true),
            (b"\x00\x01\x09", false),
            (b"\x00\x03\x01\x05", false),
        ] {
            let io = Io::default();
            bytes.iter().for_each(|&byte| io.push_rx(byte));
            io.enter_raw();
            assert_eq!(io.take_abort(), is_abort, "{bytes:?}");
        }
    }

    #[test]
    fn abort_drops_work_even_by_itself_unless_it_is_done() {
        let io = Io::default();
        assert_eq!(run(&io, unless_aborted(&io, pin!(async { 5 }))), Some((Some(5), 0)));
        let aborting = async {
            io.abort();
            5
        };
        assert_eq!(run(&io, unless_aborted(&io, pin!(aborting))), Some((Some(5), 0)), "done");
        assert_eq!(run(&io, unless_aborted(&io, pin!(async { 5 }))), Some((None, 0)), "aborted before");
        io.take_abort();
        let waiting = async {
            io.abort();
            io.sleep_until(NEVER).await;
        };
        assert_eq!(run(&io, unless_aborted(&io, pin!(waiting))), Some((None, 0)));
    }

    #[test]
    fn background_runs_as_long_as_the_work() {
        let (io, count) = (Io::default(), Cell::new(0));
        let background = async {
            loop {
                count.set(count.get() + 1);
                io.sleep_until(io.after_us(2000)).await;
            }
        };
        assert_eq!(run(&io, with_background(pin!(background), pin!(io.sleep_until(5000)))), Some(((), 5000)));
        assert_eq!(count.get(), 3, "at 0, 2 and 4 ms");
        assert_eq!(run(&io, join(pin!(async { 1 }), pin!(io.sleep_until(9000)))), Some(((1, ()), 4000)));
        assert_eq!(run(&io, join(pin!(io.sleep_until(19_000)), pin!(async { 2 }))), Some((((), 2), 10_000)));
    }
}
