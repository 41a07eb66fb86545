//! SLCAN clients over TCP: threads that read, so that the bus never waits for one.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::mpsc::SyncSender;
use std::thread;
use std::time::Duration;

use hil_sim::bus::Stamped;
use hil_sim::scenario::BadInput;
use hil_sim::slcan::Slcan;
use tater_wire::Frame;

use super::{Event, bad};

/// How long a client may leave what it is told unread, once its socket is full, before it is sent away.
const UNREAD: Duration = Duration::from_millis(100);

/// Where clients connect.
///
/// # Errors
/// No address, or one that cannot be had.
pub fn listen(address: &str) -> Result<TcpListener, BadInput> {
    TcpListener::bind(address).map_err(|error| {
        bad(
            format!("--slcan {address}"),
            &error.to_string(),
            "an address of this machine and a free port, such as 127.0.0.1:0",
            "choose another port, or 0 for any",
        )
    })
}

/// A client that has connected.
pub struct Arrival {
    stream: TcpStream,
    /// Its address.
    pub peer: String,
}

impl Arrival {
    pub fn new(stream: TcpStream) -> Self {
        let peer = stream.peer_addr().map_or_else(|_| "a client".to_owned(), |peer| peer.to_string());
        Self { stream, peer }
    }

    /// Tells it why not, and closes. An SLCAN client skips a line that begins so.
    pub fn refuse(mut self, why: &str) {
        let text = format!("error: {why}\r\x07");
        // A thread: closing with unread bytes would take the text away from the client before it has read it.
        thread::spawn(move || {
            let _ = self.stream.set_write_timeout(Some(UNREAD));
            let _ = self.stream.write_all(text.as_bytes());
            let _ = self.stream.shutdown(Shutdown::Write);
            let _ = self.stream.set_read_timeout(Some(UNREAD));
            let _ = io::copy(&mut self.stream.take(1 << 20), &mut io::sink());
        });
    }

    /// Makes it the host. Its bytes come as events of its number.
    ///
    /// # Errors
    /// It has gone already.
    pub fn accept(self, number: u64, events: SyncSender<Event>) -> io::Result<Client> {
        let Self { stream, peer } = self;
        // A frame is small and wanted at once.
        stream.set_nodelay(true)?;
        stream.set_write_timeout(Some(UNREAD))?;
        let reader = stream.try_clone()?;
        thread::spawn(move || read(reader, number, &events));
        Ok(Client { number, peer, stream, codec: Slcan::default(), out: Vec::new() })
    }
}

fn read(mut stream: TcpStream, number: u64, events: &SyncSender<Event>) {
    let mut bytes = [0; 1024];
    loop {
        let event = match stream.read(&mut bytes) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Ok(0) | Err(_) => Event::Gone(number),
            Ok(len) => Event::Bytes(number, bytes[..len].to_vec()),
        };
        let gone = matches!(event, Event::Gone(_));
        if events.send(event).is_err() || gone {
            return;
        }
    }
}

/// The client that is the host.
pub struct Client {
    pub number: u64,
    pub peer: String,
    stream: TcpStream,
    codec: Slcan,
    out: Vec<u8>,
}

impl Client {
    /// A byte from it: the frame that it completes, if any.
    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        self.codec.push(byte, &mut self.out)
    }

    /// A frame for it.
    pub fn frame(&mut self, stamped: &Stamped) {
        self.codec.frame(stamped, &mut self.out);
    }

    /// Sends what there is to tell it.
    ///
    /// # Errors
    /// It does not read.
    pub fn flush(&mut self) -> io::Result<()> {
        let done = if self.out.is_empty() { Ok(()) } else { self.stream.write_all(&self.out) };
        self.out.clear();
        done
    }

    /// Hangs up; its thread ends.
    pub fn close(self) {
        let _ = self.stream.shutdown(Shutdown::Both);
    }
}
