//! A byte stream to a host with a reading and a writing thread, so that simulated time never waits for a host, and with bounded
//! queues both ways. Closing a link discards what has not been written.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use super::event::Event;

/// Size limit of a read and of a link's unprocessed input, bytes.
pub const CHUNK: usize = 1024;

const MAX_CHUNKS: usize = 16;

pub trait Port: Send + Sync + 'static {
    /// Blocks until bytes arrive; 0 at the end.
    fn read(&self, bytes: &mut [u8]) -> io::Result<usize>;

    fn write(&self, bytes: &[u8]) -> io::Result<()>;

    /// Closes the stream: blocked readers and writers return, and unread bytes are lost.
    fn close(&self);
}

impl Port for TcpStream {
    fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        let mut stream = self;
        Read::read(&mut stream, bytes)
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
    /// The reader has delivered a chunk and waits for [`Self::read_next`].
    is_paused: bool,
}

impl Link {
    /// Starts both threads. Received chunks arrive as events, one at a time: see [`Self::read_next`].
    pub fn new(number: u64, peer: String, port: Arc<dyn Port>, events: SyncSender<Event>) -> Self {
        let (out, chunks) = sync_channel::<Vec<u8>>(MAX_CHUNKS);
        let (more, next_chunk) = sync_channel(1);
        let (reader, writer) = (Arc::clone(&port), Arc::clone(&port));
        let gone = events.clone();
        thread::spawn(move || read(&*reader, number, &events, &next_chunk));
        let is_closed = Arc::new(AtomicBool::new(false));
        let closed = Arc::clone(&is_closed);
        thread::spawn(move || {
            while let Ok(chunk) = chunks.recv() {
                let is_gone = writer.write(&chunk).is_err();
                if closed.load(Ordering::SeqCst) {
                    // The chunk may have been written after the close.
                    writer.close();
                    return;
                }
                if is_gone {
                    // The reader may be waiting for its turn and would report this late or never.
                    let _ = gone.send(Event::Gone(number));
                    return;
                }
            }
        });
        Self { number, peer, port, out, more, is_closed, is_paused: false }
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
        match self.out.try_send(std::mem::take(chunk)) {
            Ok(()) => true,
            Err(error) => {
                let (std::sync::mpsc::TrySendError::Full(back)
                | std::sync::mpsc::TrySendError::Disconnected(back)) = error;
                *chunk = back;
                false
            }
        }
    }

    pub fn close(self) {
        self.is_closed.store(true, Ordering::SeqCst);
        self.port.close();
    }
}

fn read(port: &dyn Port, number: u64, events: &SyncSender<Event>, next_chunk: &Receiver<()>) {
    let mut bytes = [0; CHUNK];
    loop {
        let event = match port.read(&mut bytes) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Ok(0) | Err(_) => Event::Gone(number),
            Ok(len) => Event::Bytes(number, bytes[..len].to_vec()),
        };
        let gone = matches!(event, Event::Gone(_));
        if events.send(event).is_err() || gone || next_chunk.recv().is_err() {
            return;
        }
    }
}
