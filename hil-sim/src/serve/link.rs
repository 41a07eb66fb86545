//! A byte stream to a host with a reading and a writing thread, so that simulated time never waits for a host, and with bounded
//! queues both ways. Closing a link discards what has not been written.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::event::Event;
use crate::thread;

/// Size limit of a read and of a link's unprocessed input, bytes.
pub const CHUNK: usize = 1024;

const MAX_CHUNKS: usize = 16;

pub trait Port: Send + Sync + 'static {
    /// Blocks until bytes arrive; 0 at the end.
    fn read(&self, bytes: &mut [u8]) -> io::Result<usize>;

    /// Whether the other side has closed, although bytes of it may still be unread. `false` where the system does not tell.
    fn has_closed(&self) -> bool;

    /// Blocks after the end of the input until nothing can be written either. Returns whether that can be told without writing.
    fn wait_for_loss(&self) -> bool;

    fn write(&self, bytes: &[u8]) -> io::Result<()>;

    /// Closes the stream: blocked readers and writers return, and unread bytes are lost.
    fn close(&self);
}

impl Port for TcpStream {
    fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        let mut stream = self;
        Read::read(&mut stream, bytes)
    }

    #[cfg(target_os = "linux")]
    fn has_closed(&self) -> bool {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let now = Timespec { tv_sec: 0, tv_nsec: 0 };
        // RDHUP is the other side's FIN; HUP and ERR, which are reported in any case, a reset.
        poll(&mut [PollFd::new(self, PollFlags::RDHUP)], Some(&now)).is_ok_and(|events| events > 0)
    }

    #[cfg(not(target_os = "linux"))]
    fn has_closed(&self) -> bool {
        false
    }

    #[cfg(unix)]
    fn wait_for_loss(&self) -> bool {
        use rustix::event::{PollFd, PollFlags, poll};
        // Without requested events, poll reports a reset and our own shutdown, and no end of the input.
        let mut sockets = [PollFd::new(self, PollFlags::empty())];
        while poll(&mut sockets, None) == Err(rustix::io::Errno::INTR) {}
        true
    }

    #[cfg(not(unix))]
    fn wait_for_loss(&self) -> bool {
        false
    }

    fn write(&self, bytes: &[u8]) -> io::Result<()> {
        let mut stream = self;
        stream.write_all(bytes)
    }

    fn close(&self) {
        let _ = self.shutdown(Shutdown::Both);
    }
}

pub struct Link {
    pub number: u64,
    pub peer: String,
    port: Arc<dyn Port>,
    out: SyncSender<Vec<u8>>,
    more: SyncSender<()>,
    is_closed: Arc<AtomicBool>,
    /// Chunks that are not written yet.
    unwritten: Arc<AtomicUsize>,
    /// The reader has delivered a chunk and waits for [`Self::read_next`].
    is_paused: bool,
}

impl Link {
    /// Starts both threads. Received chunks arrive as events, one at a time: see [`Self::read_next`].
    ///
    /// # Errors
    /// A thread cannot be started; the other one ends.
    pub fn new(
        number: u64,
        peer: String,
        port: Arc<dyn Port>,
        events: SyncSender<Event>,
    ) -> io::Result<Self> {
        let (out, chunks) = sync_channel::<Vec<u8>>(MAX_CHUNKS);
        let (more, next_chunk) = sync_channel(1);
        let (is_closed, unwritten) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicUsize::new(0)));
        let writer = Writer {
            number,
            port: Arc::clone(&port),
            is_closed: Arc::clone(&is_closed),
            unwritten: Arc::clone(&unwritten),
            events: events.clone(),
        };
        // Before the reader, which would take bytes from the next link of a terminal if this thread did not start.
        thread::start(move || writer.run(&chunks))?;
        let reader = Arc::clone(&port);
        thread::start(move || read(&*reader, number, &events, &next_chunk))?;
        Ok(Self { number, peer, port, out, more, is_closed, unwritten, is_paused: false })
    }

    pub const fn chunk_received(&mut self) {
        self.is_paused = true;
    }

    /// Lets the reader deliver the next chunk.
    pub fn read_next(&mut self) {
        if std::mem::take(&mut self.is_paused) {
            // The channel is empty: the reader waits for exactly one token.
            let _ = self.more.try_send(());
        }
    }

    /// Queues a chunk for writing. Returns whether there was room; otherwise `chunk` is unchanged.
    pub fn send(&self, chunk: &mut Vec<u8>) -> bool {
        if chunk.is_empty() {
            return true;
        }
        self.unwritten.fetch_add(1, Ordering::SeqCst);
        match self.out.try_send(std::mem::take(chunk)) {
            Ok(()) => true,
            Err(error) => {
                self.unwritten.fetch_sub(1, Ordering::SeqCst);
                let (std::sync::mpsc::TrySendError::Full(back)
                | std::sync::mpsc::TrySendError::Disconnected(back)) = error;
                *chunk = back;
                false
            }
        }
    }

    /// Whether the client has closed its side. Its bytes, and the event that reports the end, may still be on the way.
    pub fn has_closed(&self) -> bool {
        self.port.has_closed()
    }

    /// Whether everything that was queued has been written.
    pub fn is_flushed(&self) -> bool {
        self.unwritten.load(Ordering::SeqCst) == 0
    }

    pub fn close(self) {
        self.is_closed.store(true, Ordering::SeqCst);
        self.port.close();
    }
}

struct Writer {
    number: u64,
    port: Arc<dyn Port>,
    is_closed: Arc<AtomicBool>,
    unwritten: Arc<AtomicUsize>,
    events: SyncSender<Event>,
}

impl Writer {
    fn run(self, chunks: &Receiver<Vec<u8>>) {
        while let Ok(chunk) = chunks.recv() {
            let is_gone = self.port.write(&chunk).is_err();
            self.unwritten.fetch_sub(1, Ordering::SeqCst);
            if self.is_closed.load(Ordering::SeqCst) {
                // The chunk may have been written after the close.
                self.port.close();
                return;
            }
            if is_gone {
                // The reader may be waiting for its turn and would report this late or never.
                let _ = self.events.send(Event::Gone(self.number));
                return;
            }
        }
    }
}

fn read(port: &dyn Port, number: u64, events: &SyncSender<Event>, next_chunk: &Receiver<()>) {
    let mut bytes = [0; CHUNK];
    loop {
        let event = match port.read(&mut bytes) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Ok(0) => Event::InputEnded(number),
            Err(_) => Event::Gone(number),
            Ok(len) => Event::Bytes(number, bytes[..len].to_vec()),
        };
        let (gone, ended) = (matches!(event, Event::Gone(_)), matches!(event, Event::InputEnded(_)));
        if events.send(event).is_err() || gone {
            return;
        }
        if ended {
            if port.wait_for_loss() {
                let _ = events.send(Event::Gone(number));
            }
            return;
        }
        if next_chunk.recv().is_err() {
            return;
        }
    }
}
