//! Discovery: hosts ask over UDP where hands are, as they ask serial device servers (Lantronix, UDS-10 User Guide, chapter 8; the manual's
//! section 7 names no protocol). Port 30718 (77FEh). A question is four bytes, and so are the commands that would configure or reset a
//! device server; those are never obeyed.
//!
//! | question | answer |
//! |---|---|
//! | 00 00 00 F6 | 00 00 00 F7, 20 bytes of firmware and device, hardware address: 30 bytes |
//! | 00 00 00 F8 | 00 00 00 F9, the setup record of 120 bytes: from 0 the IP address, from 20 the TCP port, low byte first |

use std::collections::HashMap;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::thread::park_timeout;
use std::time::Duration;

use wraptor::Deadline;

use super::event::bad;
use super::tcp::no_thread;
use crate::thread;
use programs::output::warn;
use traces::input::BadInput;

/// Port of questions.
const PORT: u16 = 30718;

/// Where the broadcasts of this machine's own network arrive, and no unicast does.
const LOOPBACK_BROADCAST: Ipv4Addr = Ipv4Addr::new(127, 255, 255, 255);

/// Receive buffer, bytes: it holds what a flood sends during [`PAUSE`], and the question behind it. The kernel may grant less: Linux's default limit
/// is room for some 500 short datagrams.
#[cfg(unix)]
const WAITING: usize = 1 << 20;

/// Most datagrams read before a pause: they bound the share of a processor that a flood costs, and no question is lost in a slower flood. What does
/// not fit into the socket's buffer meanwhile is lost, as UDP may.
const BURST: usize = 1024;
const PAUSE: Duration = Duration::from_millis(1);

/// Most answers to one host in [`SPAN`], twice what a search asks.
const ANSWERS: u8 = 8;
const SPAN: Duration = Duration::from_secs(1);

/// Most hosts, by address and port, that are answered in [`SPAN`]. They bound what forged questions can make the hand send to others: 2048
/// answers of 124 bytes a second.
const HOSTS: usize = 256;

/// Time before reading again after an error, which an answer to a host that has gone can cause.
const RETRY: Duration = Duration::from_millis(100);

/// Bytes of a question; one more is read, to see that it is longer.
const QUESTION: usize = 4;

/// Bytes of a setup record, and its fields.
const RECORD: usize = 120;
const RECORD_IP: usize = 0;
const RECORD_PORT: usize = 20;

/// Bytes of firmware and device before the hardware address.
const FIRMWARE: usize = 20;

/// Hosts that were answered in the present [`SPAN`]. Floods from fewer than [`HOSTS`] ports take nothing from other hosts.
struct Hosts {
    answers: HashMap<SocketAddr, u8>,
    span: Deadline,
}

impl Hosts {
    fn new() -> Self {
        Self { answers: HashMap::with_capacity(HOSTS), span: Deadline::after(SPAN) }
    }

    /// Counts an answer to a host. Returns whether the host gets it.
    fn admit(&mut self, address: SocketAddr) -> bool {
        if self.span.is_over() {
            self.answers.clear();
            self.span = Deadline::after(SPAN);
        }
        if self.answers.len() >= HOSTS && !self.answers.contains_key(&address) {
            return false;
        }
        let answers = self.answers.entry(address).or_default();
        let is_admitted = *answers < ANSWERS;
        *answers += u8::from(is_admitted);
        is_admitted
    }
}

/// The answer to a datagram for a hand that is served at `gcl`, if it is a question.
fn answer(datagram: &[u8], gcl: SocketAddrV4) -> Option<Vec<u8>> {
    let [a, b, c, d] = gcl.ip().octets();
    let [high, low] = gcl.port().to_be_bytes();
    match datagram {
        [0, 0, 0, 0xF6] => {
            // 02: locally administered, which no maker's device has.
            let hardware = [0x02, 0x57, c, d, high, low];
            Some([&[0, 0, 0, 0xF7][..], &[0; FIRMWARE], &hardware].concat())
        }
        [0, 0, 0, 0xF8] => {
            let mut record = [0; RECORD];
            record[RECORD_IP..RECORD_IP + 4].copy_from_slice(&[a, b, c, d]);
            record[RECORD_PORT..RECORD_PORT + 2].copy_from_slice(&[low, high]);
            Some([&[0, 0, 0, 0xF9][..], &record].concat())
        }
        _ => None,
    }
}

/// Answers questions about the hand that is served at `gcl`: at `address`, or without it at the port of questions, to this machine alone if the
/// hand is, and to any network otherwise. Returns the address if one was given; without one a port that is taken costs a warning only.
///
/// # Errors
/// The given address is invalid or in use.
pub fn answer_questions(address: Option<&str>, gcl: &str) -> Result<Option<String>, BadInput> {
    // A hand on IPv6 alone has no such record.
    let Ok(gcl) = gcl.parse::<SocketAddrV4>() else { return Ok(None) };
    let Some(address) = address else {
        let ip = if gcl.ip().is_loopback() { LOOPBACK_BROADCAST } else { Ipv4Addr::UNSPECIFIED };
        let bound = bind_shared(SocketAddrV4::new(ip, PORT)).and_then(|socket| serve(socket, gcl));
        if let Err(error) = bound {
            warn(&format!("warning: {ip}:{PORT}: hosts cannot discover this hand: {error}"));
        }
        return Ok(None);
    };
    let failed = |error: io::Error| {
        bad(
            format!("--discovery {address}"),
            &error.to_string(),
            "an address of this machine and a free port, such as 127.0.0.1:30718",
            "choose another port, or 0 for any",
        )
    };
    let socket = UdpSocket::bind(address).map_err(failed)?;
    let local: SocketAddr = socket.local_addr().map_err(failed)?;
    if !local.ip().is_loopback() {
        warn(&format!(
            "warning: --discovery {local} is beyond loopback: any machine that reaches this one learns of the hand"
        ));
    }
    serve(socket, gcl).map_err(|error| no_thread("--discovery", &error))?;
    Ok(Some(local.to_string()))
}

/// Several hands of a machine share the port: each gets every broadcast.
#[cfg(unix)]
fn bind_shared(address: SocketAddrV4) -> io::Result<UdpSocket> {
    use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, socket_with, sockopt};
    let socket = socket_with(AddressFamily::INET, SocketType::DGRAM, SocketFlags::empty(), None)?;
    // Not in the call: macOS has no such flag there.
    rustix::io::fcntl_setfd(&socket, rustix::io::FdFlags::CLOEXEC)?;
    sockopt::set_socket_reuseaddr(&socket, true)?;
    bind(&socket, &address)?;
    Ok(socket.into())
}

#[cfg(not(unix))]
fn bind_shared(address: SocketAddrV4) -> io::Result<UdpSocket> {
    UdpSocket::bind(address)
}

/// Ends with the program.
fn serve(socket: UdpSocket, gcl: SocketAddrV4) -> io::Result<()> {
    #[cfg(unix)]
    rustix::net::sockopt::set_socket_recv_buffer_size(&socket, WAITING)?;
    let mut answerer = Answerer { socket, gcl, hosts: Hosts::new() };
    thread::start(move || {
        loop {
            park_timeout(if answerer.turn().is_ok() { PAUSE } else { RETRY });
        }
    })
}

struct Answerer {
    socket: UdpSocket,
    gcl: SocketAddrV4,
    hosts: Hosts,
}

impl Answerer {
    /// Waits for a datagram, then empties the socket: a full socket drops the next question.
    fn turn(&mut self) -> io::Result<()> {
        self.socket.set_nonblocking(false)?;
        self.receive()?;
        self.socket.set_nonblocking(true)?;
        // An error: the socket is empty.
        let _ = (1..BURST).try_for_each(|_| self.receive());
        Ok(())
    }

    fn receive(&mut self) -> io::Result<()> {
        let mut datagram = [0; QUESTION + 1];
        let (len, host) = self.socket.recv_from(&mut datagram)?;
        if let Some(answer) = answer(&datagram[..len], self.gcl)
            && self.hosts.admit(host)
        {
            // A host that is gone asks no more.
            let _ = self.socket.send_to(&answer, host);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const GCL: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(10, 0, 2, 7), 11001);

    #[test]
    fn questions_are_answered_with_address_and_port() {
        let firmware = answer(&[0, 0, 0, 0xF6], GCL).expect("a question");
        assert_eq!((firmware.len(), &firmware[..4]), (30, &[0, 0, 0, 0xF7][..]));
        assert_eq!(firmware[24..], [0x02, 0x57, 2, 7, 0x2A, 0xF9]);
        let record = answer(&[0, 0, 0, 0xF8], GCL).expect("a question");
        assert_eq!((record.len(), &record[..8]), (124, &[0, 0, 0, 0xF9, 10, 0, 2, 7][..]));
        assert_eq!(record[24..26], [0xF9, 0x2A]);
    }

    proptest! {
        #[test]
        fn nothing_else_is(datagram in proptest::collection::vec(any::<u8>(), 0..40)) {
            prop_assume!(![&[0, 0, 0, 0xF6][..], &[0, 0, 0, 0xF8]].contains(&&datagram[..]));
            prop_assert_eq!(answer(&datagram, GCL), None);
        }
    }

    #[test]
    fn host_that_floods_is_answered_a_little_and_others_as_ever() {
        let host = |port| SocketAddr::from(([10, 0, 0, 1], port));
        let mut hosts = Hosts::new();
        let answered = (0..1000).filter(|_| hosts.admit(host(1))).count();
        assert_eq!(answered, ANSWERS as usize);
        let others = (2..1000).filter(|&port| hosts.admit(host(port))).count();
        assert_eq!(others, HOSTS - 1);
    }

    /// Reset, and the commands that would change the setup.
    #[test]
    fn commands_are_not_obeyed() {
        for command in [0x03, 0xFA, 0xFB, 0xFC, 0xFD] {
            assert_eq!(answer(&[0, 0, 0, command], GCL), None);
        }
    }
}
