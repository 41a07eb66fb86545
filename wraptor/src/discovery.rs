//! Hands in the network (the manual's discoverGrasper): a UDP broadcast, which hands answer as serial device servers do (docs/hosts.md).

use std::collections::BTreeMap;
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::time::Duration;

use crate::deadline::Deadline;
use crate::error::{Cause, ConnectError};

/// Port of questions (77FEh).
pub const PORT: u16 = 30718;

/// Where questions go unless told: the network of the default route, and this machine's own, where simulated hands are.
pub const EVERYWHERE: [SocketAddrV4; 2] = [
    SocketAddrV4::new(Ipv4Addr::BROADCAST, PORT),
    SocketAddrV4::new(Ipv4Addr::new(127, 255, 255, 255), PORT),
];

/// Questions: the hardware address, and the setup record.
const QUESTIONS: [[u8; 4]; 2] = [[0, 0, 0, 0xF6], [0, 0, 0, 0xF8]];

/// The questions are asked so often, since UDP may lose them.
const ASKED: u32 = 2;

/// Most hands that [`discover`] returns. More would be noise.
pub const MOST: usize = 256;

/// Longest answer, bytes; one more is read, to see that it is longer.
const LONGEST: usize = 124;

/// A hand that has answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Found {
    /// Where it takes a connection.
    pub address: SocketAddrV4,
    /// Its hardware address. `None`: it has not told, or several hands answer from one address.
    pub hardware: Option<[u8; 6]>,
}

/// Asks where hands are, and listens for the whole time, since any number may answer. Hands come sorted by address, [`MOST`] at most; none
/// is no error. Answers come from the ports that were asked.
///
/// # Errors
/// [`Cause::Unreachable`]: no question could be sent; [`Cause::System`]: the system refuses a socket.
pub fn discover(to: &[SocketAddrV4], listen: Duration) -> Result<Vec<Found>, ConnectError> {
    ask(to, listen).map_err(|cause| ConnectError {
        place: to.iter().map(ToString::to_string).collect::<Vec<_>>().join(" "),
        cause,
    })
}

fn ask(to: &[SocketAddrV4], listen: Duration) -> Result<Vec<Found>, Cause> {
    let system = |error: io::Error| Cause::System(error.to_string());
    let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).map_err(system)?;
    socket.set_broadcast(true).map_err(system)?;
    let mut answers = Answers::default();
    for _ in 0..ASKED {
        let socket = &socket;
        let send = |&to| QUESTIONS.iter().map(move |question| socket.send_to(question, to));
        let sent: Vec<io::Result<usize>> = to.iter().flat_map(send).collect();
        if sent.iter().all(Result::is_err) {
            let why = sent.into_iter().find_map(Result::err).map_or_else(String::new, |why| why.to_string());
            return Err(Cause::Unreachable(why));
        }
        let deadline = Deadline::after(listen / ASKED);
        let mut datagram = [0; LONGEST + 1];
        // A socket takes no wait of 0.
        while !deadline.is_over() {
            socket
                .set_read_timeout(Some(deadline.remaining().max(Duration::from_micros(1))))
                .map_err(system)?;
            // An error is the time, or a host that refuses questions.
            if let Ok((len, SocketAddr::V4(from))) = socket.recv_from(&mut datagram)
                && to.iter().any(|asked| asked.port() == from.port())
            {
                answers.take(from, &datagram[..len]);
            }
        }
    }
    Ok(answers.hands())
}

/// What hands have said, by the address they said it from.
#[derive(Debug, Default)]
struct Answers(BTreeMap<SocketAddrV4, Said>);

#[derive(Debug, Default)]
struct Said {
    hardware: Vec<[u8; 6]>,
    addresses: Vec<SocketAddrV4>,
}

impl Answers {
    /// Takes a datagram; what is no answer changes nothing.
    fn take(&mut self, from: SocketAddrV4, datagram: &[u8]) {
        if self.0.len() >= MOST && !self.0.contains_key(&from) {
            return;
        }
        match *datagram {
            // 20 bytes of firmware and device, then the address.
            [0, 0, 0, 0xF7, .., a, b, c, d, e, f] if datagram.len() == 30 => {
                note(&mut self.0.entry(from).or_default().hardware, [a, b, c, d, e, f]);
            }
            // A record of 120 bytes: IP address at 0, port at 20, low byte first.
            [0, 0, 0, 0xF9, a, b, c, d, ..] if datagram.len() == 124 => {
                let port = u16::from_le_bytes([datagram[24], datagram[25]]);
                // One that listens on all of its addresses answers from the right one.
                let ip =
                    Some(Ipv4Addr::new(a, b, c, d)).filter(|ip| !ip.is_unspecified()).unwrap_or(*from.ip());
                // No hand is at addresses of many, nor on this machine if it answers from elsewhere.
                let is_one = !ip.is_multicast() && ip.octets()[0] < 240;
                let is_there = !ip.is_loopback() || from.ip().is_loopback();
                if port != 0 && is_one && is_there {
                    note(&mut self.0.entry(from).or_default().addresses, SocketAddrV4::new(ip, port));
                }
            }
            _ => {}
        }
    }

    fn hands(self) -> Vec<Found> {
        let found = |said: Said| {
            let hardware = match (&*said.hardware, &*said.addresses) {
                ([hardware], [_]) => Some(*hardware),
                _ => None,
            };
            said.addresses.into_iter().map(move |address| Found { address, hardware })
        };
        let mut hands: Vec<Found> = self.0.into_values().flat_map(found).collect();
        hands.sort_unstable();
        hands.dedup_by_key(|found| found.address);
        hands.truncate(MOST);
        hands
    }
}

fn note<T: PartialEq>(list: &mut Vec<T>, item: T) {
    if list.len() < MOST && !list.contains(&item) {
        list.push(item);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn from(last: u8) -> SocketAddrV4 {
        SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, last), PORT)
    }

    fn record(ip: [u8; 4], port: u16) -> Vec<u8> {
        let mut record = vec![0; 124];
        record[3] = 0xF9;
        record[4..8].copy_from_slice(&ip);
        record[24..26].copy_from_slice(&port.to_le_bytes());
        record
    }

    fn hardware(last: u8) -> Vec<u8> {
        let mut answer = vec![0; 30];
        answer[3] = 0xF7;
        answer[24..].copy_from_slice(&[0, 0x20, 0x4A, 1, 2, last]);
        answer
    }

    #[test]
    fn hand_is_its_record_and_its_hardware_address() {
        let mut answers = Answers::default();
        for _ in 0..2 {
            answers.take(from(7), &hardware(9));
            answers.take(from(7), &record([0; 4], 1001));
            answers.take(from(5), &record([10, 0, 0, 5], 10001));
        }
        let found = |last, port, hardware| Found {
            address: SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, last), port),
            hardware,
        };
        assert_eq!(answers.hands(), [found(5, 10001, None), found(7, 1001, Some([0, 0x20, 0x4A, 1, 2, 9]))]);
    }

    #[test]
    fn hardware_addresses_of_several_hands_at_one_address_are_not_guessed() {
        let mut answers = Answers::default();
        for (last, port) in [(1, 1001), (2, 1002)] {
            answers.take(from(7), &hardware(last));
            answers.take(from(7), &record([10, 0, 0, 7], port));
        }
        let hands = answers.hands();
        assert!(hands.len() == 2 && hands.iter().all(|hand| hand.hardware.is_none()), "{hands:?}");
    }

    #[test]
    fn noise_changes_nothing_and_is_bounded() {
        let mut answers = Answers::default();
        let short = &record([10, 0, 0, 5], 1001)[..123];
        for noise in [&[][..], &[0, 0, 0, 0xF6], &[0, 0, 0, 0xF9], short, &record([10, 0, 0, 5], 0)] {
            answers.take(from(7), noise);
        }
        for ip in [[224, 0, 0, 1], [255; 4], [240, 1, 2, 3], [127, 0, 0, 1]] {
            answers.take(from(7), &record(ip, 1001));
        }
        assert_eq!(answers.hands(), []);
        let mut answers = Answers::default();
        for port in 1..1000 {
            answers.take(from(7), &record([10, 0, 0, 7], port));
            answers.take(SocketAddrV4::new(*from(8).ip(), port), &record([10, 0, 0, 8], port));
        }
        assert_eq!(answers.hands().len(), MOST);
    }
}
