//! A connection with its reader thread: TCP, a serial port, a CAN interface, or an interpreter in this program.
//!
//! The thread waits in the kernel and passes on what arrives; it ends with its [`Port`], which joins it. Bytes come through a channel, because a
//! socket's own time limit is rounded up to the kernel's tick, 4 ms or more.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpStream, ToSocketAddrs};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Weak};
use std::thread::{self, JoinHandle};
use std::time::Duration;

#[cfg(target_os = "linux")]
use tater_wire::Frame;

use crate::deadline::Deadline;
use crate::error::{Cause, whole_ms};

mod event;
mod inbox;
mod tcp;
#[cfg(unix)]
mod waiting;

pub(crate) use event::{Event, Waker};
pub(crate) use inbox::Inbox;
pub use tcp::configure_tcp;
pub(crate) use tcp::negotiates_telnet;

/// Chunks that wait for the caller; then the reader waits, and the other side with it.
const CHUNKS: usize = 256;

/// Size of a chunk, bytes.
const CHUNK: usize = 4096;

/// Names of the threads.
const READER: &str = "wraptor-reader";
const INTERPRETER: &str = "wraptor-god";

/// The sending side.
pub(crate) enum Out {
    Tcp(TcpStream),
    #[cfg(unix)]
    Tty(std::fs::File),
    #[cfg(target_os = "linux")]
    Can(socketcan::CanSocket),
    Inside(Inbox),
}

impl Out {
    /// Writes all bytes.
    ///
    /// # Errors
    /// The other side is gone, or takes nothing until the deadline.
    pub fn write(&self, bytes: &[u8], deadline: &Deadline) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => {
                let mut rest = bytes;
                while !rest.is_empty() {
                    // Zero would mean no limit.
                    stream.set_write_timeout(Some(deadline.remaining().max(Duration::from_millis(1))))?;
                    match (&mut &*stream).write(rest) {
                        Ok(0) => return Err(ErrorKind::WriteZero.into()),
                        Ok(len) if len < rest.len() && deadline.is_over() => {
                            return Err(ErrorKind::TimedOut.into());
                        }
                        Ok(len) => rest = rest.get(len..).unwrap_or_default(),
                        Err(error) if error.kind() == ErrorKind::Interrupted && !deadline.is_over() => {}
                        Err(error)
                            if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) =>
                        {
                            return Err(ErrorKind::TimedOut.into());
                        }
                        Err(error) => return Err(error),
                    }
                }
                Ok(())
            }
            #[cfg(unix)]
            Self::Tty(tty) => waiting::write(tty, bytes, deadline),
            #[cfg(target_os = "linux")]
            Self::Can(_) => Err(ErrorKind::Unsupported.into()),
            Self::Inside(inbox) => inbox.write(bytes, deadline),
        }
    }
}

/// Tells the end of a reader, also by a panic.
struct End(SyncSender<Event>);

impl Drop for End {
    fn drop(&mut self) {
        // Nobody waits for it if the port is dropped.
        let _ = self.0.send(Event::Gone("the reader has ended".to_owned()));
    }
}

/// A connection. Dropping it closes it and joins its reader.
pub(crate) struct Port {
    out: Arc<Out>,
    waker: SyncSender<Event>,
    events: Option<Receiver<Event>>,
    reader: Option<JoinHandle<()>>,
    /// Its end ends a reader that TCP's shutdown does not.
    alive: Option<io::PipeWriter>,
    /// Why it is gone.
    gone: Option<String>,
    /// A process that was forked from this one has no reader, and leaves the connection to this one.
    process: u32,
}

const INHERITED: &str = "it belongs to the process that this one was forked from";

impl Port {
    /// Connects over TCP.
    ///
    /// # Errors
    /// The cause.
    pub fn tcp(address: &str, deadline: &Deadline) -> Result<Self, Cause> {
        let target = resolve(address, deadline)?;
        let limit = deadline.remaining().max(Duration::from_millis(1));
        let stream = TcpStream::connect_timeout(&target, limit).map_err(|error| match error.kind() {
            ErrorKind::ConnectionRefused => Cause::NothingListens,
            ErrorKind::TimedOut => Cause::NoAnswer(deadline.limit()),
            ErrorKind::InvalidInput => Cause::BadAddress(error.to_string()),
            _ if lacks_resources(&error) => Cause::System(error.to_string()),
            _ => Cause::Unreachable(error.to_string()),
        })?;
        let system = |error: io::Error| Cause::System(error.to_string());
        configure_tcp(&stream).map_err(system)?;
        reset_at_close(&stream, true).map_err(system)?;
        let out = Arc::new(Out::Tcp(stream));
        let from = Arc::clone(&out);
        let next = move || match &*from {
            Out::Tcp(stream) => bytes(stream).map(Some),
            _ => Ok(None),
        };
        let read = move |events: &_| pass_on(events, next);
        Self::start(out, None, READER, read).map_err(|error| Cause::System(error.to_string()))
    }

    /// Opens a serial port in raw mode at so many baud.
    ///
    /// # Errors
    /// The cause.
    #[cfg(unix)]
    pub fn tty(path: &str, baud: u32) -> Result<Self, Cause> {
        let tty = waiting::open_tty(path, baud).map_err(|error| of_port(&error))?;
        Self::start_waiting(Out::Tty(tty)).map_err(|error| Cause::System(error.to_string()))
    }

    /// Fails: nobody has written this for a system that is no Unix.
    #[cfg(not(unix))]
    pub fn tty(_: &str, _: u32) -> Result<Self, Cause> {
        Err(Cause::System(
            "serial ports are opened on Linux and macOS alone; TCP and SLCAN over TCP work here".to_owned(),
        ))
    }

    /// Opens a CAN interface of Linux.
    ///
    /// # Errors
    /// The cause.
    #[cfg(target_os = "linux")]
    pub fn can(interface: &str) -> Result<Self, Cause> {
        use socketcan::Socket as _;
        let socket = socketcan::CanSocket::open(interface).map_err(|error| of_port(&error))?;
        socket.set_nonblocking(true).map_err(|error| Cause::System(error.to_string()))?;
        Self::start_waiting(Out::Can(socket)).map_err(|error| Cause::System(error.to_string()))
    }

    #[cfg(unix)]
    fn start_waiting(out: Out) -> io::Result<Self> {
        let (dropped, alive) = io::pipe()?;
        let out = Arc::new(out);
        let from = Arc::clone(&out);
        Self::start(out, Some(alive), READER, move |events| pass_on(events, || next(&from, &dropped)))
    }

    /// Runs an interpreter in a thread of its own: it takes the bytes that are written here, sends events, and ends when its [`Inbox`] is closed.
    /// `waker` ends its wait.
    ///
    /// # Errors
    /// The system refuses a thread.
    pub fn inside(
        waker: Waker,
        run: impl FnOnce(&Inbox, &SyncSender<Event>) + Send + 'static,
    ) -> Result<Self, Cause> {
        let out = Arc::new(Out::Inside(Inbox::new(waker)));
        let from = Arc::clone(&out);
        let read = move |events: &_| {
            if let Out::Inside(inbox) = &*from {
                run(inbox, events);
                inbox.end();
            }
        };
        Self::start(out, None, INTERPRETER, read).map_err(|error| Cause::System(error.to_string()))
    }

    fn start(
        out: Arc<Out>,
        alive: Option<io::PipeWriter>,
        name: &str,
        read: impl FnOnce(&SyncSender<Event>) + Send + 'static,
    ) -> io::Result<Self> {
        let (sender, events) = sync_channel(CHUNKS);
        let waker = sender.clone();
        let run = move || {
            let end = End(sender);
            read(&end.0);
        };
        let reader = thread::Builder::new().name(name.to_owned()).spawn(run)?;
        Ok(Self {
            out,
            waker,
            events: Some(events),
            reader: Some(reader),
            alive,
            gone: None,
            process: std::process::id(),
        })
    }

    /// What ends a wait of [`Self::receive`] from another thread.
    pub fn waker(&self) -> Waker {
        Waker::new(self.waker.clone())
    }

    /// The sending side, for a canceller that does not keep the port open.
    pub fn out(&self) -> Weak<Out> {
        Arc::downgrade(&self.out)
    }

    /// Writes all bytes.
    ///
    /// # Errors
    /// The other side is gone, or takes nothing until the deadline.
    pub fn write(&self, bytes: &[u8], deadline: &Deadline) -> io::Result<()> {
        if self.is_inherited() { Err(io::Error::other(INHERITED)) } else { self.out.write(bytes, deadline) }
    }

    fn is_inherited(&self) -> bool {
        self.process != std::process::id()
    }

    /// Sends a frame on a CAN interface.
    ///
    /// # Errors
    /// It is none, or its queue has no room until the deadline.
    #[cfg(target_os = "linux")]
    pub fn send(&self, frame: &Frame, deadline: &Deadline) -> io::Result<()> {
        match &*self.out {
            Out::Can(socket) => waiting::send(socket, frame, deadline),
            Out::Tcp(_) | Out::Tty(_) | Out::Inside(_) => Err(ErrorKind::Unsupported.into()),
        }
    }

    /// What arrives next; `None` at the deadline, or before it after [`Waker::wake`].
    ///
    /// # Errors
    /// The other side is gone: why.
    pub fn receive(&mut self, deadline: &Deadline) -> Result<Option<Event>, String> {
        if let Some(why) = &self.gone {
            return Err(why.clone());
        }
        if self.is_inherited() {
            return Err(INHERITED.to_owned());
        }
        let Some(events) = &self.events else { return Ok(None) };
        let why = match events.recv_timeout(deadline.remaining()) {
            Ok(Event::Gone(why)) => why,
            Ok(Event::Woken) => return Ok(None),
            Ok(event) => return Ok(Some(event)),
            Err(RecvTimeoutError::Timeout) => return Ok(None),
            Err(RecvTimeoutError::Disconnected) => "the reader has ended".to_owned(),
        };
        self.gone = Some(why.clone());
        Err(why)
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        if self.is_inherited() {
            // There is no thread to join here.
            std::mem::forget(self.reader.take());
            return;
        }
        // A reader that waits for room in the channel ends with the receiver.
        self.events = None;
        match &*self.out {
            Out::Tcp(stream) => {
                // What was written last still arrives. An error: it is closed already, and the reader has ended.
                let _ = reset_at_close(stream, false);
                let _ = stream.shutdown(Shutdown::Both);
            }
            Out::Inside(inbox) => inbox.close(),
            #[cfg(unix)]
            Out::Tty(_) => {}
            #[cfg(target_os = "linux")]
            Out::Can(_) => {}
        }
        self.alive = None;
        if let Some(reader) = self.reader.take() {
            let _ = reader.join();
        }
    }
}

/// Whether the close is a reset. Until the orderly end of a [`Port`] it is, for the kernel closes the connection of a program that dies: a hand
/// takes its FIN for a host that has sent everything and finishes what it does, and a reset for a host that is gone (decision 0031).
#[cfg_attr(
    not(unix),
    expect(unused_variables, clippy::unnecessary_wraps, reason = "elsewhere it stays as it is")
)]
fn reset_at_close(stream: &TcpStream, resets: bool) -> io::Result<()> {
    #[cfg(unix)]
    rustix::net::sockopt::set_socket_linger(stream, resets.then_some(Duration::ZERO))?;
    Ok(())
}

/// An address as `HOST:PORT`. A name is looked up in a thread of its own, which the resolver's own time limits end.
fn resolve(address: &str, deadline: &Deadline) -> Result<SocketAddr, Cause> {
    if let Ok(address) = address.parse() {
        return Ok(address);
    }
    let (sender, found) = sync_channel(1);
    let name = address.to_owned();
    let look_up = move || {
        let found = name.to_socket_addrs().map(|mut addresses| addresses.next());
        // Nobody waits for it after the deadline.
        let _ = sender.send(found);
    };
    thread::Builder::new().spawn(look_up).map_err(|error| Cause::System(error.to_string()))?;
    match found.recv_timeout(deadline.remaining()) {
        Ok(Ok(Some(address))) => Ok(address),
        Ok(Ok(None)) => Err(Cause::BadAddress("the name has no address".to_owned())),
        Ok(Err(error)) => Err(Cause::BadAddress(error.to_string())),
        Err(_) => {
            Err(Cause::BadAddress(format!("the name was not found within {:?}", whole_ms(deadline.limit()))))
        }
    }
}

/// Whether this program or machine has too many files open.
#[cfg(unix)]
fn lacks_resources(error: &io::Error) -> bool {
    matches!(
        rustix::io::Errno::from_io_error(error),
        Some(rustix::io::Errno::MFILE | rustix::io::Errno::NFILE | rustix::io::Errno::NOBUFS)
    )
}

#[cfg(not(unix))]
fn lacks_resources(_: &io::Error) -> bool {
    false
}

#[cfg(unix)]
fn of_port(error: &io::Error) -> Cause {
    let why = error.to_string();
    match error.kind() {
        ErrorKind::PermissionDenied => Cause::NotPermitted(why),
        ErrorKind::ResourceBusy => Cause::InUse(why),
        _ if lacks_resources(error) => Cause::System(why),
        _ => Cause::NoSuchPort(why),
    }
}

const CLOSED: &str = "the other side closed it";

/// Passes on events until there are no more, or nobody wants them.
fn pass_on(events: &SyncSender<Event>, mut next: impl FnMut() -> io::Result<Option<Event>>) {
    loop {
        match next() {
            Ok(Some(event)) => {
                if events.send(event).is_err() {
                    return;
                }
            }
            Ok(None) => return,
            Err(error) if matches!(error.kind(), ErrorKind::Interrupted | ErrorKind::WouldBlock) => {}
            Err(error) => {
                let _ = events.send(Event::Gone(error.to_string()));
                return;
            }
        }
    }
}

/// The next event of a file that is waited for together with `dropped`; `None` after the end of that.
#[cfg(unix)]
fn next(from: &Out, dropped: &io::PipeReader) -> io::Result<Option<Event>> {
    use std::os::fd::AsFd;
    let file = match from {
        Out::Tcp(stream) => stream.as_fd(),
        Out::Tty(tty) => tty.as_fd(),
        #[cfg(target_os = "linux")]
        Out::Can(socket) => socket.as_fd(),
        Out::Inside(_) => return Err(ErrorKind::Unsupported.into()),
    };
    if !waiting::is_readable(file, dropped)? {
        return Ok(None);
    }
    match from {
        Out::Tcp(stream) => bytes(stream).map(Some),
        Out::Tty(tty) => bytes(tty).map(Some),
        #[cfg(target_os = "linux")]
        Out::Can(socket) => match waiting::frame(socket)? {
            Some(frame) => Ok(Some(Event::Frame(frame))),
            None => Err(ErrorKind::Interrupted.into()),
        },
        Out::Inside(_) => Err(ErrorKind::Unsupported.into()),
    }
}

fn bytes(mut from: impl Read) -> io::Result<Event> {
    let mut bytes = [0; CHUNK];
    match from.read(&mut bytes)? {
        0 => Err(io::Error::other(CLOSED)),
        len => Ok(Event::Bytes(bytes.iter().take(len).copied().collect())),
    }
}
