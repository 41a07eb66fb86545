//! Clients over TCP.

use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::thread;
use std::time::Duration;

use crate::experiment::input::BadInput;
use crate::ports::slcan::Slcan;
use crate::world::bus::Stamped;
use tater_wire::Frame;

use super::event::{Arrival, Door, Event, bad};
use super::link::Link;
use crate::ports::output::tell;

/// How long a client that is refused may take to read why, and to close.
const LAST_WORDS: Duration = Duration::from_millis(100);

/// Pieces of what it has said that are taken from it then.
const LAST_READS: usize = 16;

/// From an attempt to accept a client that fails to the next: out of files, it fails at once until one is closed.
const AGAIN: Duration = Duration::from_millis(100);

/// What an SLCAN client may leave unread, bytes, before it is sent away: a second of a full bus.
const UNREAD: usize = 1 << 18;

/// Listens at an option's address; clients come as events. Returns the address that it has.
///
/// # Errors
/// No address, or one that cannot be had.
pub fn listen(
    option: &str,
    address: &str,
    door: Door,
    events: SyncSender<Event>,
) -> Result<String, BadInput> {
    let failed = |error: io::Error| {
        bad(
            format!("{option} {address}"),
            &error.to_string(),
            "an address of this machine and a free port, such as 127.0.0.1:0",
            "choose another port, or 0 for any",
        )
    };
    let listener = TcpListener::bind(address).map_err(failed)?;
    let address = listener.local_addr().map_err(failed)?.to_string();
    // Ends with the program, or when nobody hears it any more.
    thread::spawn(move || accept_all(&listener, door, &events));
    Ok(address)
}

fn accept_all(listener: &TcpListener, door: Door, events: &SyncSender<Event>) {
    let mut told = false;
    for stream in listener.incoming() {
        match stream {
            Ok(stream) => {
                if events.send(Event::Client(arrival(stream, door))).is_err() {
                    return;
                }
            }
            Err(error) => {
                if !std::mem::replace(&mut told, true) {
                    tell(&format!("warning: a client cannot be accepted: {error}; it is tried again"));
                }
                thread::park_timeout(AGAIN);
            }
        }
    }
}

fn arrival(stream: TcpStream, door: Door) -> Arrival {
    let peer = stream.peer_addr().map_or_else(|_| "a client".to_owned(), |peer| peer.to_string());
    Arrival { stream, peer, door }
}

/// Tells it why not, and closes. An SLCAN client skips a line that begins so.
pub fn refuse(mut arrival: Arrival, why: &str) {
    let text = match arrival.door {
        Door::Gcl => format!("\r\n\rbusy: {why}\r\n\r"),
        Door::Slcan => format!("error: {why}\r\x07"),
    };
    // A thread: closing with unread bytes would take the text away from the client before it has read it.
    thread::spawn(move || {
        let _ = arrival.stream.set_write_timeout(Some(LAST_WORDS));
        let _ = arrival.stream.write_all(text.as_bytes());
        let _ = arrival.stream.shutdown(Shutdown::Write);
        let _ = arrival.stream.set_read_timeout(Some(LAST_WORDS));
        // However slowly it goes on: an end.
        let mut unheard = [0; 1 << 12];
        let _ = (0..LAST_READS).find(|_| !arrival.stream.read(&mut unheard).is_ok_and(|len| len > 0));
    });
}

/// Lets it in. Its bytes come as events of its number.
///
/// # Errors
/// It has gone already.
pub fn accept(arrival: Arrival, number: u64, events: SyncSender<Event>) -> io::Result<Link> {
    // What it is told is small and wanted at once.
    arrival.stream.set_nodelay(true)?;
    Ok(Link::new(number, arrival.peer, Arc::new(arrival.stream), events))
}

/// A client that speaks SLCAN.
pub struct Client {
    /// Its bytes.
    pub link: Link,
    codec: Slcan,
    out: Vec<u8>,
}

impl Client {
    /// One that has been let in, as `codec` has it.
    pub const fn new(link: Link, codec: Slcan) -> Self {
        Self { link, codec, out: Vec::new() }
    }

    /// A byte from it: the frame that it completes, if any.
    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        self.codec.push(byte, &mut self.out)
    }

    /// A frame for it.
    pub fn frame(&mut self, stamped: &Stamped) {
        self.codec.frame(stamped, &mut self.out);
    }

    /// Sends what there is to tell it. Returns whether it still reads.
    pub fn flush(&mut self) -> bool {
        self.link.send(&mut self.out) || self.out.len() <= UNREAD
    }
}
