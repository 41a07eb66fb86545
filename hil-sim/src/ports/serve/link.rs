//! A host at the other end of a stream of bytes: a thread that reads and one that writes, so that simulated time never waits for
//! anybody, and an end to what may wait either way. What has not been written when a link is closed is not written any more.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use super::event::Event;

/// Bytes that are read at once, and the most of a link that wait to be used.
pub const CHUNK: usize = 1024;

/// Pieces that may wait to be written.
const PIECES: usize = 16;

/// What a link goes over.
pub trait Port: Send + Sync + 'static {
    /// Waits for bytes; 0 at the end.
    ///
    /// # Errors
    /// It is gone.
    fn read(&self, bytes: &mut [u8]) -> io::Result<usize>;

    /// Waits until all are written.
    ///
    /// # Errors
    /// It is gone.
    fn write(&self, bytes: &[u8]) -> io::Result<()>;

    /// Hangs up: who waits is told so, and what has been written and not read is lost.
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

/// A host that is there.
pub struct Link {
    /// Its number in events.
    pub number: u64,
    /// Who it is.
    pub peer: String,
    port: Arc<dyn Port>,
    out: SyncSender<Vec<u8>>,
    more: SyncSender<()>,
    is_closed: Arc<AtomicBool>,
    /// It has sent a piece, and waits until that is used.
    is_held: bool,
}

impl Link {
    /// Starts to read and to write. What it reads comes as events of its number, a piece at a time: see [`Self::go_on`].
    pub fn new(number: u64, peer: String, port: Arc<dyn Port>, events: SyncSender<Event>) -> Self {
        let (out, pieces) = sync_channel::<Vec<u8>>(PIECES);
        let (more, go_on) = sync_channel(1);
        let (reader, writer) = (Arc::clone(&port), Arc::clone(&port));
        let gone = events.clone();
        thread::spawn(move || read(&*reader, number, &events, &go_on));
        let is_closed = Arc::new(AtomicBool::new(false));
        let closed = Arc::clone(&is_closed);
        thread::spawn(move || {
            while let Ok(piece) = pieces.recv() {
                let is_gone = writer.write(&piece).is_err();
                if closed.load(Ordering::SeqCst) {
                    // It may have been written after that.
                    writer.close();
                    return;
                }
                if is_gone {
                    // Its reader may be waiting for its turn, and tell later, or never.
                    let _ = gone.send(Event::Gone(number));
                    return;
                }
            }
        });
        Self { number, peer, port, out, more, is_closed, is_held: false }
    }

    /// A piece of its has come.
    pub const fn has_come(&mut self) {
        self.is_held = true;
    }

    /// There is room for another piece: it may come.
    pub fn go_on(&mut self) {
        if std::mem::take(&mut self.is_held) {
            // It waits for this one: there is no other.
            let _ = self.more.try_send(());
        }
    }

    /// Sends a piece if there is room; whether there was. All of it, or nothing: then `piece` is as it was.
    pub fn send(&self, piece: &mut Vec<u8>) -> bool {
        if piece.is_empty() {
            return true;
        }
        match self.out.try_send(std::mem::take(piece)) {
            Ok(()) => true,
            Err(error) => {
                let (std::sync::mpsc::TrySendError::Full(back)
                | std::sync::mpsc::TrySendError::Disconnected(back)) = error;
                *piece = back;
                false
            }
        }
    }

    /// Hangs up; its threads end.
    pub fn close(self) {
        self.is_closed.store(true, Ordering::SeqCst);
        self.port.close();
    }
}

fn read(port: &dyn Port, number: u64, events: &SyncSender<Event>, go_on: &Receiver<()>) {
    let mut bytes = [0; CHUNK];
    loop {
        let event = match port.read(&mut bytes) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Ok(0) | Err(_) => Event::Gone(number),
            Ok(len) => Event::Bytes(number, bytes[..len].to_vec()),
        };
        let gone = matches!(event, Event::Gone(_));
        if events.send(event).is_err() || gone || go_on.recv().is_err() {
            return;
        }
    }
}
