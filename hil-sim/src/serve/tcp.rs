//! Clients over TCP.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::mpsc::SyncSender;
use std::thread::park_timeout;
use std::time::Duration;

use crate::slcan::Slcan;
use hil_world::bus::Stamped;
use tater_wire::Frame;
use traces::input::BadInput;

use super::event::{Event, NewClient, Protocol, bad};
use super::link::Link;
use crate::thread;
use programs::output::warn;
use wraptor::{Deadline, configure_tcp};

/// Most refused clients whose connections are open; the oldest makes room.
const REFUSALS: usize = 64;

/// Time for a refused client to read the reason and close: round trips of a slow network.
const REFUSAL_TIMEOUT: Duration = Duration::from_secs(1);

/// Interval between two looks at the refused clients.
const REFUSAL_INTERVAL: Duration = Duration::from_millis(10);

/// Input of a refused client discarded in a look, bytes.
const REFUSAL_INPUT: usize = 1 << 12;

/// Delay before accepting again after an error: without free file descriptors, accept fails at once until one is closed.
const ACCEPT_RETRY: Duration = Duration::from_millis(100);

/// An SLCAN client is disconnected when it leaves more than this unread, bytes: a second of a full bus.
const UNREAD: usize = 1 << 18;

/// Listens at an option's address; clients arrive as events. Returns the actual address.
///
/// # Errors
/// The address is invalid or in use.
pub fn listen(
    option: &str,
    address: &str,
    protocol: Protocol,
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
    let address = listener.local_addr().map_err(failed)?;
    if !address.ip().is_loopback() {
        warn(&format!(
            "warning: {option} {address} is beyond loopback: any machine that reaches this one can connect, without a password"
        ));
    }
    // Ends with the program, or when the receiver is gone.
    thread::start(move || accept_all(&listener, protocol, &events))
        .map_err(|error| no_thread(option, &error))?;
    Ok(address.to_string())
}

fn accept_all(listener: &TcpListener, protocol: Protocol, events: &SyncSender<Event>) {
    let mut warned = false;
    for stream in listener.incoming() {
        match stream {
            Ok(stream) => {
                if events.send(Event::Client(client(stream, protocol))).is_err() {
                    return;
                }
            }
            Err(error) => {
                if !std::mem::replace(&mut warned, true) {
                    warn(&format!("warning: a client cannot be accepted: {error}; trying again"));
                }
                park_timeout(ACCEPT_RETRY);
            }
        }
    }
}

fn client(stream: TcpStream, protocol: Protocol) -> NewClient {
    let peer = stream.peer_addr().map_or_else(|_| "a client".to_owned(), |peer| peer.to_string());
    NewClient { stream, peer, protocol }
}

/// Refused clients whose connections are still open. Closing one with unread input would discard the reason before the client reads
/// it. The server's own thread serves them: a thread for each would let any program that connects exhaust the machine's.
#[derive(Default)]
pub struct Refusals {
    /// Oldest first, each until its deadline.
    clients: VecDeque<(TcpStream, Deadline)>,
    /// Until the next look.
    pause: Option<Deadline>,
}

impl Refusals {
    /// Sends the reason; [`Self::serve`] closes the connection. SLCAN clients skip such a line.
    pub fn refuse(&mut self, mut client: NewClient, why: &str) {
        let text = match client.protocol {
            Protocol::Gcl => format!("\r\n\rbusy: {why}\r\n\r"),
            Protocol::Slcan => format!("error: {why}\r\x07"),
            Protocol::Truth => format!("{{\"error\":\"{why}\"}}\n"),
        };
        // A socket that blocks would block the server.
        if client.stream.set_nonblocking(true).is_err() {
            return;
        }
        // A new connection has room for it.
        let _ = client.stream.write_all(text.as_bytes());
        let _ = client.stream.shutdown(Shutdown::Write);
        if self.clients.len() >= REFUSALS {
            self.clients.pop_front();
        }
        self.clients.push_back((client.stream, Deadline::after(REFUSAL_TIMEOUT)));
    }

    /// Discards input, and closes the connections of clients that have closed theirs or had their time.
    pub fn serve(&mut self) {
        if self.clients.is_empty() || self.pause.is_some_and(|pause| !pause.is_over()) {
            return;
        }
        self.pause = Some(Deadline::after(REFUSAL_INTERVAL));
        self.clients.retain_mut(|(stream, deadline)| !deadline.is_over() && discard(stream));
    }
}

/// Discards what a client has sent. Returns whether its connection is open.
fn discard(stream: &mut TcpStream) -> bool {
    match stream.read(&mut [0; REFUSAL_INPUT]) {
        Ok(len) => len > 0,
        Err(error) => matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted),
    }
}

/// The client's bytes arrive as events with its number. `None` if the client has disconnected, or is refused because no thread
/// can be started for it.
pub fn accept(
    client: NewClient,
    number: u64,
    events: SyncSender<Event>,
    refusals: &mut Refusals,
) -> Option<Link> {
    let NewClient { stream, peer, protocol } = client;
    // An error means that the client has disconnected.
    configure_tcp(&stream).ok()?;
    let refused = stream.try_clone();
    match Link::new(number, peer.clone(), Arc::new(stream), events) {
        Ok(link) => Some(link),
        Err(error) => {
            warn(&format!("{peer} refused: {error}"));
            if let Ok(stream) = refused {
                refusals.refuse(NewClient { stream, peer, protocol }, &error.to_string());
            }
            None
        }
    }
}

/// The error of an option whose thread cannot be started.
pub fn no_thread(option: &str, error: &io::Error) -> BadInput {
    bad(
        option.to_owned(),
        &error.to_string(),
        "a thread for each endpoint, and two for each client",
        "end other programs, or raise the limit",
    )
}

pub struct Client {
    pub link: Link,
    codec: Slcan,
    out: Vec<u8>,
}

impl Client {
    pub const fn new(link: Link, codec: Slcan) -> Self {
        Self { link, codec, out: Vec::new() }
    }

    pub fn push(&mut self, byte: u8) -> Option<Frame> {
        self.codec.push(byte, &mut self.out)
    }

    pub fn frame(&mut self, stamped: &Stamped) {
        self.codec.frame(stamped, &mut self.out);
    }

    /// Sends what is queued. Returns `false` if the client has stopped reading.
    pub fn flush(&mut self) -> bool {
        self.link.send(&mut self.out) || self.out.len() <= UNREAD
    }
}
