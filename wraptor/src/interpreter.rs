//! GOD in this program, for a hand that is reached by CAN: the same code that a hand's GOD runs, between this library's session and an adapter.
//!
//! So everything that a hand does over TCP and serial ports it does by CAN: its language, packets, RealTime. What needs the board GOD is missing:
//! its temperature is 0 °C, and its own parameters, macros and sequences last as long as the connection. A save of changed ones is ERR 512.
//!
//! The interpreter is this program's: a program that is killed leaves the boards to HOSTMS, and a move to its end.

use std::pin::pin;
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::Duration;

use god::memory::Stored;
use god::{Io, Memory, io};
use tater_wire::Frame;

use crate::adapter::Adapter;
use crate::deadline::Deadline;
use crate::error::{Cause, Failure};
use crate::port::{Event, Inbox, Port};

/// Longest delay of an answer by the adapter and by other programs of this machine, µs. Pauses of a loaded machine reach 100 ms and more
/// (docs/wraptor.md, RealTime).
const LINK_US: u64 = 250_000;

/// Longest wait for an adapter to take a frame, as GOD waits for its bus.
const SEND: Duration = Duration::from_micros(io::SEND_US);

/// Time to the next attempt with a frame that the adapter does not take, or with text that the host does not read.
const AGAIN: Duration = Duration::from_millis(20);

/// Time of a command to end after the close of its connection. Later it is aborted.
const FINISH: Duration = Duration::from_secs(1);

/// Time of GOD to stop motors after ^C: 0.5 s at most (`god::shell`).
const STOP: Duration = Duration::from_millis(600);

/// Frames that are received before GOD reads them; it has room for twice as many.
const AT_ONCE: usize = 16;

/// Starts the interpreter; it ends with the port.
///
/// # Errors
/// The system refuses a thread.
pub(crate) fn start(adapter: Adapter) -> Result<Port, Cause> {
    Port::inside(adapter.waker(), move |inbox, events| {
        let outcome = run(adapter, inbox, events);
        if let Err(failure) = outcome {
            let why = match failure {
                Failure::Lost(why) => why,
                failure => failure.to_string(),
            };
            // A host that has closed the connection does not ask.
            let _ = events.send(Event::Gone(format!("the adapter is gone: {why}")));
        }
    })
}

/// What is left to do.
enum Stage {
    Serving,
    /// The host has closed the connection: what it has sent is finished until then.
    Finishing(Deadline),
    /// That took too long: motors are stopped until then.
    Stopping(Deadline),
}

/// Runs GOD until the host closes the connection, or the adapter is lost.
fn run(mut adapter: Adapter, inbox: &Inbox, events: &SyncSender<Event>) -> Result<(), Failure> {
    let (io, memory) = (Io::default(), Memory::default());
    io.set_link_us(LINK_US);
    memory.report_writes();
    let mut god = pin!(god::run(&io, &memory));
    let clock = Deadline::after(Duration::MAX);
    let now_us = || u64::try_from(clock.elapsed().as_micros()).unwrap_or(u64::MAX);
    let (mut stage, mut unsent, mut unread) = (Stage::Serving, None, Vec::new());
    loop {
        let has_more = feed(inbox, &io);
        let next_us = io::poll(god.as_mut(), &io, now_us());
        if memory.wants_write() {
            memory.written(is_kept(&memory.stored()));
            continue;
        }
        if io.take_cancel() {
            unsent = None;
        }
        let has_sent = send(&mut adapter, &io, &mut unsent)?;
        if print(events, &io, &mut unread) || has_sent {
            // There is room now for what GOD waits to send.
            continue;
        }
        let is_done = io.waits_for_line() && unsent.is_none() && !has_more;
        stage = match stage {
            Stage::Serving if inbox.is_closed() => Stage::Finishing(Deadline::after(FINISH)),
            Stage::Finishing(_) | Stage::Stopping(_) if is_done => return Ok(()),
            Stage::Finishing(limit) if limit.is_over() => {
                io.hang_up();
                Stage::Stopping(Deadline::after(STOP))
            }
            Stage::Stopping(limit) if limit.is_over() => return Ok(()),
            stage => stage,
        };
        let until = Duration::from_micros(next_us.saturating_sub(now_us()));
        let wait = match &stage {
            Stage::Serving => until,
            Stage::Finishing(limit) | Stage::Stopping(limit) => until.min(limit.remaining()),
        };
        let is_held = unsent.is_some() || !unread.is_empty();
        receive(&mut adapter, &io, &Deadline::after(if is_held { wait.min(AGAIN) } else { wait }))?;
    }
}

/// Passes on what GOD prints, as far as the host reads. Returns whether GOD had printed something.
fn print(events: &SyncSender<Event>, io: &Io, unread: &mut Vec<u8>) -> bool {
    if !unread.is_empty() {
        // Else it is sent, or the host has closed the connection.
        if let Err(TrySendError::Full(Event::Bytes(bytes))) =
            events.try_send(Event::Bytes(std::mem::take(unread)))
        {
            *unread = bytes;
        }
    }
    if !unread.is_empty() {
        return false;
    }
    unread.extend(std::iter::from_fn(|| io.pop_tx()));
    !unread.is_empty()
}

/// Gives GOD the bytes that it has room for. Returns whether some are left.
fn feed(inbox: &Inbox, io: &Io) -> bool {
    inbox.take(|bytes| {
        while let Some(byte) = bytes.front().copied() {
            if io.rx_room() == 0 && !io.is_abort(byte) {
                // Behind more than GOD reads ahead, ^C would wait for the command that it is to abort.
                if bytes.back() == Some(&god::io::ABORT) && !io.is_raw() {
                    bytes.clear();
                    io.interrupt();
                }
                return;
            }
            bytes.pop_front();
            io.push_rx(byte);
        }
    })
}

/// Sends the frames of GOD that the adapter takes. Returns whether it has taken some.
fn send(adapter: &mut Adapter, io: &Io, unsent: &mut Option<Frame>) -> Result<bool, Failure> {
    let mut has_sent = false;
    while let Some(frame) = unsent.take().or_else(|| io.pop_frame()) {
        match adapter.send(&frame, &Deadline::after(SEND)) {
            Ok(()) => has_sent = true,
            Err(Failure::TimedOut(_)) => {
                *unsent = Some(frame);
                break;
            }
            Err(failure) => return Err(failure),
        }
    }
    Ok(has_sent)
}

/// Receives until the deadline or the first frame, and then what has arrived: GOD reads all of it before it sees that time has passed.
fn receive(adapter: &mut Adapter, io: &Io, deadline: &Deadline) -> Result<(), Failure> {
    let mut deadline = *deadline;
    for _ in 0..AT_ONCE {
        let Some(frame) = adapter.receive(&deadline)? else { return Ok(()) };
        io.push_frame(&frame);
        deadline = Deadline::after(Duration::ZERO);
    }
    Ok(())
}

/// Whether everything that commands save is as GOD begins with, and so is kept without a memory. Statistics are not saved by commands.
fn is_kept(stored: &Stored) -> bool {
    let Stored { parameters, macros, sequences, .. } = Stored::default();
    (parameters, macros, sequences) == (stored.parameters, stored.macros, stored.sequences.clone())
}
