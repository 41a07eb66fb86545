//! A host's connection to a bus: SLCAN over TCP or a serial port, or a CAN interface. Every wait has a deadline.
//!
//! Bytes and frames come through a channel: a socket's own time limit is rounded up to the kernel's tick, 4 ms or more.

use std::collections::VecDeque;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::time::Duration;

use tater_wire::Frame;

use super::interrupt;
use super::serve::can::CanPort;
use super::serve::event::{EVENTS, Event};
use super::thread;
use crate::experiment::input::BadInput;
use crate::tuning::excite;

/// Real time since the program started.
pub type Clock<'a> = &'a dyn Fn() -> Duration;

/// Timeout for a connection, and of an adapter that opens.
const PATIENCE: Duration = Duration::from_secs(5);

/// Longest valid line: a frame of eight bytes with a time-stamp, or an error text.
const LONGEST: usize = 200;

const BEL: u8 = 7;

/// Why a bus is gone.
pub struct Lost(String);

impl Lost {
    /// The error of the connection at `place`.
    pub fn of(self, place: &str) -> BadInput {
        bad(place, "the bus is lost", &self.0)
    }
}

/// A connection with its clock.
struct Timed<'a> {
    link: Link,
    place: String,
    clock: Clock<'a>,
}

/// The adapter that a command line names.
///
/// # Errors
/// Those of [`Link::slcan`] and [`Link::can`].
pub fn open<'a>(
    slcan: Option<&str>,
    can: Option<&str>,
    clock: Clock<'a>,
) -> Result<Box<dyn excite::Link + 'a>, BadInput> {
    let (link, place) = match (slcan, can) {
        (Some(address), _) => (Link::slcan(address, clock)?, format!("--slcan {address}")),
        (None, Some(interface)) => (Link::can(interface)?, format!("--can {interface}")),
        (None, None) => return Err(bad("the bus", "no adapter is named", "neither --slcan nor --can")),
    };
    Ok(Box::new(Timed { link, place, clock }))
}

impl Timed<'_> {
    fn lost(&self, Lost(why): &Lost) -> String {
        format!(
            "{}: the adapter is lost: {why}\n  next: check its cable and power; a motor that a host drives idles by itself after HOSTMS",
            self.place
        )
    }
}

impl excite::Link for Timed<'_> {
    fn now_us(&self) -> u64 {
        u64::try_from((self.clock)().as_micros()).unwrap_or(u64::MAX)
    }

    fn send(&mut self, frame: &Frame) -> Result<(), String> {
        self.link.send(frame).map_err(|lost| self.lost(&lost))
    }

    fn receive(&mut self, until_us: u64) -> Result<Option<(u64, Frame)>, String> {
        let frame = self.link.receive(Duration::from_micros(until_us), self.clock);
        let frame = frame.map_err(|lost| self.lost(&lost))?;
        Ok(frame.map(|frame| (self.now_us(), frame)))
    }

    fn is_interrupted(&self) -> bool {
        interrupt::interrupted()
    }
}

enum Out {
    Lines(Box<dyn Write>),
    Can(CanPort),
}

/// A connection to a bus.
pub struct Link {
    out: Out,
    events: Receiver<Event>,
    line: Vec<u8>,
    /// Received answers of an adapter; `None`: BEL.
    lines: VecDeque<Option<Vec<u8>>>,
}

impl Link {
    /// Opens an SLCAN adapter at 1 Mbit/s.
    ///
    /// # Errors
    /// No adapter at this address, one in use, or another bit rate.
    pub fn slcan(address: &str, clock: Clock) -> Result<Self, BadInput> {
        let place = format!("--slcan {address}");
        let failed = |error: std::io::Error| bad(&place, "cannot be opened", &error.to_string());
        let (events, received) = sync_channel(EVENTS);
        let out: Box<dyn Write> = if address.starts_with('/') {
            let tty = tty(address).map_err(failed)?;
            watch(tty.try_clone().map_err(failed)?, events).map_err(failed)?;
            Box::new(tty)
        } else {
            let target = address.to_socket_addrs().map_err(failed)?.next();
            let target = target.ok_or_else(|| failed(ErrorKind::AddrNotAvailable.into()))?;
            let stream = TcpStream::connect_timeout(&target, PATIENCE).map_err(failed)?;
            stream.set_nodelay(true).map_err(failed)?;
            stream.set_write_timeout(Some(PATIENCE)).map_err(failed)?;
            watch(stream.try_clone().map_err(failed)?, events).map_err(failed)?;
            Box::new(stream)
        };
        let mut link =
            Self { out: Out::Lines(out), events: received, line: Vec::new(), lines: VecDeque::new() };
        link.open(&place, clock)?;
        Ok(link)
    }

    /// Opens a CAN interface of Linux.
    ///
    /// # Errors
    /// There is no such interface.
    pub fn can(interface: &str) -> Result<Self, BadInput> {
        let (events, received) = sync_channel(EVENTS);
        let port = CanPort::open(interface)?;
        port.watch(events)?;
        Ok(Self { out: Out::Can(port), events: received, line: Vec::new(), lines: VecDeque::new() })
    }

    fn open(&mut self, place: &str, clock: Clock) -> Result<(), BadInput> {
        // Close the channel (BEL if none was open) and drop earlier frames: the version ends these answers.
        for (command, name) in [("\rC\rV\r", "V"), ("S8\r", "S8"), ("O\r", "O")] {
            let is_wanted = |line: &Option<Vec<u8>>| match line {
                Some(line) if name == "V" => line.starts_with(b"V"),
                _ => name != "V",
            };
            self.write(command.as_bytes()).map_err(|lost| lost.of(place))?;
            let deadline = clock() + PATIENCE;
            let answer = loop {
                match self.next_line(deadline, clock).map_err(|lost| lost.of(place))? {
                    Some(line) if is_wanted(&line) => break line,
                    Some(_) => {}
                    None => return Err(bad(place, "no SLCAN adapter answers within 5 s", "silence")),
                }
            };
            if answer.is_none() {
                return Err(bad(
                    place,
                    "the adapter does not open at 1 Mbit/s",
                    &format!("it refuses {name}"),
                ));
            }
        }
        Ok(())
    }

    /// Sends a frame.
    ///
    /// # Errors
    /// The adapter is gone.
    pub fn send(&mut self, frame: &Frame) -> Result<(), Lost> {
        match &mut self.out {
            Out::Can(port) => {
                port.send(frame);
                Ok(())
            }
            Out::Lines(_) => {
                let mut text = format!("t{:03X}{}", frame.raw_id(), frame.data().len());
                frame.data().iter().for_each(|byte| text.push_str(&format!("{byte:02X}")));
                text.push('\r');
                self.write(text.as_bytes())
            }
        }
    }

    fn write(&mut self, text: &[u8]) -> Result<(), Lost> {
        match &mut self.out {
            Out::Lines(out) => out.write_all(text).map_err(|error| Lost(error.to_string())),
            Out::Can(_) => Ok(()),
        }
    }

    /// The next frame; `None` at the deadline. A frame that the adapter refuses is lost: its answer will be missed.
    ///
    /// # Errors
    /// The bus is gone.
    pub fn receive(&mut self, deadline: Duration, clock: Clock) -> Result<Option<Frame>, Lost> {
        loop {
            while let Some(line) = self.lines.pop_front() {
                if let Some(frame) = line.as_deref().and_then(parse) {
                    return Ok(Some(frame));
                }
            }
            match self.event(deadline, clock)? {
                Some(Event::Frame(frame)) => return Ok(Some(frame)),
                Some(Event::Bytes(_, bytes)) => self.push(&bytes)?,
                Some(_) => {}
                None => return Ok(None),
            }
        }
    }

    fn next_line(&mut self, deadline: Duration, clock: Clock) -> Result<Option<Option<Vec<u8>>>, Lost> {
        while self.lines.is_empty() {
            match self.event(deadline, clock)? {
                Some(Event::Bytes(_, bytes)) => self.push(&bytes)?,
                Some(_) => {}
                None => return Ok(None),
            }
        }
        Ok(self.lines.pop_front())
    }

    fn event(&mut self, deadline: Duration, clock: Clock) -> Result<Option<Event>, Lost> {
        match self.events.recv_timeout(deadline.saturating_sub(clock())) {
            Ok(Event::Lost(why)) => Err(Lost(why)),
            Ok(event) => Ok(Some(event)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(Lost("the adapter has hung up".to_owned())),
        }
    }

    fn push(&mut self, bytes: &[u8]) -> Result<(), Lost> {
        for byte in bytes {
            match byte {
                b'\r' => {
                    let line = std::mem::take(&mut self.line);
                    // `hil-sim bus` explains a hang-up in such a line.
                    if let Some(why) = line.strip_prefix(b"error: ") {
                        return Err(Lost(String::from_utf8_lossy(why).into_owned()));
                    }
                    self.lines.push_back(Some(line));
                }
                &BEL => {
                    self.line.clear();
                    self.lines.push_back(None);
                }
                _ if self.line.len() < LONGEST => self.line.push(*byte),
                _ => {}
            }
        }
        Ok(())
    }
}

/// Opens a serial port in raw mode.
fn tty(path: &str) -> std::io::Result<File> {
    let file = OpenOptions::new().read(true).write(true).open(path)?;
    #[cfg(unix)]
    {
        use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
        let mut termios = tcgetattr(&file)?;
        termios.make_raw();
        tcsetattr(&file, OptionalActions::Now, &termios)?;
    }
    Ok(file)
}

/// Reports bytes in a thread that ends with the connection.
fn watch(mut from: impl Read + Send + 'static, events: SyncSender<Event>) -> std::io::Result<()> {
    thread::start(move || {
        let mut bytes = [0; 1024];
        loop {
            let event = match from.read(&mut bytes) {
                Ok(0) => Event::Lost("the adapter has hung up".to_owned()),
                Ok(len) => Event::Bytes(0, bytes[..len].to_vec()),
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(error) => Event::Lost(error.to_string()),
            };
            let is_lost = matches!(event, Event::Lost(_));
            if events.send(event).is_err() || is_lost {
                return;
            }
        }
    })
}

/// Parses `tiiildd...`, with or without a time-stamp; `None` for other lines.
fn parse(line: &[u8]) -> Option<Frame> {
    let text = std::str::from_utf8(line).ok()?;
    // `z` acknowledges a sent frame; some adapters leave out its CR.
    let text = text.strip_prefix('z').unwrap_or(text).strip_prefix('t')?;
    let id = u16::from_str_radix(text.get(..3)?, 16).ok()?;
    let len: usize = text.get(3..4)?.parse().ok()?;
    let digits = text.get(4..4 + 2 * len)?;
    let byte = |at| u8::from_str_radix(digits.get(at..at + 2)?, 16).ok();
    let data: Option<Vec<u8>> = (0..2 * len).step_by(2).map(byte).collect();
    Frame::from_raw(id, &data?)
}

fn bad(place: &str, problem: &str, found: &str) -> BadInput {
    BadInput {
        place: place.to_owned(),
        problem: problem.to_owned(),
        found: found.to_owned(),
        expected: "an SLCAN adapter at 1 Mbit/s, such as `hil-sim bus --node 4 --slcan 127.0.0.1:0`"
            .to_owned(),
        next: "check its address, cable and power, and end other programs that use it".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_standard_data_frames_are_parsed() {
        let frame = Frame::from_raw(0x486, &[0x85, 0, 2, 0]);
        for line in [&b"t486485000200"[..], b"t4864850002001F2A", b"zt486485000200"] {
            assert_eq!(parse(line), frame);
        }
        for line in [&b""[..], b"z", b"V0100", b"t4864850002", b"t8000", b"t48\xC3\xA9", b"T"] {
            assert_eq!(parse(line), None, "{line:?}");
        }
    }
}
