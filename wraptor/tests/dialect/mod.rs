//! SLCAN adapters with the manners of public reports, between a host and a simulated bus.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

/// How an adapter differs from LAWICEL's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dialect {
    /// As the manual of CAN232 says.
    Lawicel,
    /// Acknowledges nothing; V answers a hash and an address.
    Canable,
    /// Acknowledges nothing; V answers facts, and errors are reported in lines.
    Canable25,
    /// CANable 2.5 with its feedback on: `#` and `#` with a code.
    Feedback,
    /// Acknowledges nothing, and knows no V.
    Mute,
    /// Each line that it sends ends in CR LF.
    CrLf,
    /// Its commands end in LF.
    LfEnds,
    /// Starts anew when the port opens, drops so many commands, and then greets.
    Boots(usize),
    /// A frame is acknowledged by CR alone.
    WithoutZ,
    /// By `Z`.
    CapitalZ,
    /// By `z` without a CR.
    Joined,
    /// Received frames have a time stamp.
    Stamped,
    /// BEL in place of every so manieth frame.
    Refuses(usize),
    /// The same without acknowledgments.
    RefusesAlone(usize),
    /// Has left the bus after so many frames, until it is closed and opened: BEL.
    BusOff(usize),
    /// The same without a sign.
    SilentBusOff(usize),
    /// A digit too many in every so manieth received frame of six bytes.
    Damages(usize),
}

/// An adapter that is served until the test ends.
pub struct Served {
    pub address: String,
    /// Frames that the host has sent, each time counted.
    pub sent: Arc<AtomicUsize>,
    /// Requests of a download that ask again for what was asked for before.
    pub repeated: Arc<AtomicUsize>,
    sockets: Arc<Mutex<Vec<TcpStream>>>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for Served {
    fn drop(&mut self) {
        for socket in self.sockets.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
            let _ = socket.shutdown(Shutdown::Both);
        }
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

struct Shared {
    is_open: AtomicBool,
    sent: Arc<AtomicUsize>,
    repeated: Arc<AtomicUsize>,
}

/// Serves one host, with the bus at an SLCAN address behind it.
pub fn serve(bus: &str, dialect: Dialect) -> Served {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address").to_string();
    let mut bus = TcpStream::connect(bus).expect("the bus listens");
    bus.set_nodelay(true).expect("a socket");
    bus.write_all(b"\rC\rS8\rO\r").expect("it reads");
    let sockets = Arc::new(Mutex::new(vec![bus.try_clone().expect("a socket")]));
    let (sent, repeated) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
    let shared =
        Shared { is_open: AtomicBool::new(false), sent: Arc::clone(&sent), repeated: Arc::clone(&repeated) };
    let kept = Arc::clone(&sockets);
    let thread = thread::spawn(move || {
        let Ok((host, _)) = listener.accept() else { return };
        host.set_nodelay(true).expect("a socket");
        kept.lock().expect("unpoisoned").push(host.try_clone().expect("a socket"));
        let shared = &shared;
        thread::scope(|scope| {
            let (from, to) = (bus.try_clone().expect("a socket"), host.try_clone().expect("a socket"));
            scope.spawn(move || from_bus(from, to, dialect, shared));
            from_host(&host, &bus, dialect, shared);
            let _ = bus.shutdown(Shutdown::Both);
            let _ = host.shutdown(Shutdown::Both);
        });
    });
    Served { address, sent, repeated, sockets, thread: Some(thread) }
}

fn lines(mut from: impl Read, end: u8, skipped: &[u8], mut each: impl FnMut(&str) -> bool) {
    let (mut bytes, mut line) = ([0; 4096], Vec::new());
    while let Ok(len @ 1..) = from.read(&mut bytes) {
        for &byte in &bytes[..len] {
            match byte {
                _ if byte == end => {
                    let text = String::from_utf8_lossy(&line).into_owned();
                    line.clear();
                    if !each(&text) {
                        return;
                    }
                }
                _ if skipped.contains(&byte) => {}
                _ => line.push(byte),
            }
        }
    }
}

fn from_bus(from: TcpStream, mut to: TcpStream, dialect: Dialect, shared: &Shared) {
    let (mut frames, mut asked) = (0, String::new());
    lines(from, b'\r', b"\n", |line| {
        // Its acknowledgments are not ours.
        let Some(at) = line.find('t').filter(|_| shared.is_open.load(Ordering::SeqCst)) else { return true };
        let mut line = line[at..].to_owned();
        // A request of a download: five bytes to node 0.
        if line.len() == 15 && line.starts_with("t0") && line.as_bytes()[4] == b'5' {
            let again = usize::from(line == asked);
            shared.repeated.fetch_add(again, Ordering::SeqCst);
            asked.clone_from(&line);
        }
        frames += 1;
        let end = match dialect {
            Dialect::CrLf => "\r\n",
            Dialect::LfEnds => "\n",
            _ => "\r",
        };
        match dialect {
            Dialect::Stamped => line.push_str(&format!("{:04X}", frames % 60_000)),
            Dialect::Damages(nth) if line.len() == 13 && frames % nth == 2 => line.insert(9, '2'),
            Dialect::Canable25 if frames % 5 == 0 => line.insert_str(0, "E00000000\r"),
            _ => {}
        }
        to.write_all(format!("{line}{end}").as_bytes()).is_ok()
    });
}

fn from_host(host: &TcpStream, mut bus: &TcpStream, dialect: Dialect, shared: &Shared) {
    let (mut commands, mut since_open) = (0, 0);
    let mut to = host;
    let end = if dialect == Dialect::LfEnds { b'\n' } else { b'\r' };
    // One that starts anew takes an LF for the beginning of a command.
    let skipped: &[u8] = if matches!(dialect, Dialect::Boots(_)) { b"" } else { b"\r\n" };
    lines(host, end, skipped, |line| {
        commands += 1;
        if let Dialect::Boots(deaf) = dialect
            && commands <= deaf
        {
            let banner: &[u8] = if commands == deaf { b"CAN init ok\r\n" } else { b"" };
            return to.write_all(banner).is_ok();
        }
        let is_frame = line.starts_with('t');
        let is_open = shared.is_open.load(Ordering::SeqCst);
        let is_taken = match line {
            "O" | "C" => {
                shared.is_open.store(line == "O", Ordering::SeqCst);
                since_open = 0;
                is_open != (line == "O")
            }
            _ if is_frame => {
                since_open += 1;
                let number = shared.sent.fetch_add(1, Ordering::SeqCst) + 1;
                let is_on_bus = match dialect {
                    Dialect::Refuses(nth) | Dialect::RefusesAlone(nth) => !number.is_multiple_of(nth),
                    Dialect::BusOff(most) | Dialect::SilentBusOff(most) => since_open <= most,
                    _ => true,
                };
                let is_taken = is_open && is_on_bus;
                if is_taken && bus.write_all(format!("{line}\r").as_bytes()).is_err() {
                    return false;
                }
                is_taken
            }
            "" | "S8" => true,
            "V" => !matches!(dialect, Dialect::Mute),
            // Some acknowledge whatever they are told.
            _ => matches!(dialect, Dialect::Boots(_)),
        };
        to.write_all(answer(dialect, line, is_taken).as_bytes()).is_ok()
    });
}

fn answer(dialect: Dialect, line: &str, is_taken: bool) -> &'static str {
    let is_frame = line.starts_with('t');
    match (dialect, line) {
        (Dialect::Canable, "V") => "b158aa7 github.com/example/canable-fw.git\r",
        (Dialect::Canable25 | Dialect::Feedback, "V") => {
            "+Board: Multiboard\tMCU: STM32G431\tSlcan: 100\tClock: 160\r"
        }
        (Dialect::Feedback, _) => {
            if is_taken {
                "#\r"
            } else {
                "#1\r"
            }
        }
        (Dialect::Canable | Dialect::Canable25 | Dialect::Mute | Dialect::SilentBusOff(_), _) => "",
        (Dialect::RefusesAlone(_), _) if is_taken && line != "V" => "",
        _ if !is_taken => "\x07",
        (Dialect::CrLf, "V") => "V1013\r\n",
        (Dialect::LfEnds, "V") => "V1013\n",
        (_, "V") => "V1013\r",
        (Dialect::CrLf, _) => {
            if is_frame {
                "z\r\n"
            } else {
                "\r\n"
            }
        }
        (Dialect::LfEnds, _) => {
            if is_frame {
                "z\n"
            } else {
                "\n"
            }
        }
        (Dialect::WithoutZ, _) => "\r",
        (Dialect::CapitalZ, _) if is_frame => "Z\r",
        (Dialect::Joined, _) if is_frame => "z",
        _ if is_frame => "z\r",
        _ => "\r",
    }
}
