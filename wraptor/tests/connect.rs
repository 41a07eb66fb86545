//! Each cause of a failed connection, provoked and named.

mod served;

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;
use std::time::Duration;

use served::{HANGS, Served, scripted};
use wraptor::{BoardState, Boards, Bus, Cause, Connect, ConnectError, Failure, Hand, Node, Property};

/// Limit of a connection that must fail by time.
const SHORT: Duration = Duration::from_millis(300);

const STATS: &str = "1234567 G STAT";

fn cause(result: Result<Hand, ConnectError>) -> Cause {
    let error = result.map(|_| ()).expect_err("it cannot connect");
    let text = error.to_string();
    assert!(text.contains(&error.place) && text.contains("\n  next: "), "{text}");
    error.cause
}

fn nodes(numbers: &[u8]) -> Vec<Node> {
    numbers.iter().map(|&number| Node::new(number).expect("a node")).collect()
}

#[test]
fn port_without_a_listener_is_named() {
    let free = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("its address");
    assert_eq!(cause(Hand::connect(&free.to_string(), HANGS)), Cause::NothingListens);
}

#[test]
fn invalid_address_is_named() {
    for address in ["nonsense", "127.0.0.1:99999", "127.0.0.1", ""] {
        assert!(matches!(cause(Hand::connect(address, HANGS)), Cause::BadAddress(_)), "{address}");
    }
}

/// No machine has a way to this address over TCP: it is the broadcast address of every network.
#[cfg(target_os = "linux")]
#[test]
fn address_without_a_way_is_unreachable() {
    assert!(matches!(cause(Hand::connect("255.255.255.255:1001", HANGS)), Cause::Unreachable(_)));
}

#[test]
fn peer_that_sends_without_an_end_is_no_hand_within_the_limit() {
    for flood in [&[0][..], b"x", b"OK\r\n", b"\r\n\r=> "] {
        let deadline = wraptor::Deadline::after(SHORT + Duration::from_secs(1));
        let cause = cause(Hand::connect(&served::flooding(flood, true), SHORT));
        assert!(
            matches!(cause, Cause::NotAHand(_) | Cause::Silent(_) | Cause::WrongFirmware { .. }),
            "{flood:?}: {cause}"
        );
        assert!(!deadline.is_over(), "{flood:?}: {:?}", deadline.elapsed());
    }
}

/// A full backlog drops further connections, as a machine does that is off.
#[test]
fn machine_that_does_not_answer_is_named_within_its_limit() {
    let peer = TcpListener::bind("127.0.0.1:0").expect("a port");
    socket2::SockRef::from(&peer).listen(0).expect("a shorter backlog");
    let address = peer.local_addr().expect("its address");
    let mut waiting = Vec::new();
    while let Ok(stream) = TcpStream::connect_timeout(&address, SHORT) {
        waiting.push(stream);
        assert!(waiting.len() < 10, "the backlog never fills");
    }
    assert_eq!(cause(Hand::connect(&address.to_string(), SHORT)), Cause::NoAnswer(SHORT));
}

#[test]
fn listener_that_says_nothing_is_silent() {
    let peer = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = peer.local_addr().expect("its address").to_string();
    assert_eq!(cause(Hand::connect(&address, SHORT)), Cause::Silent(SHORT));
}

#[test]
fn peer_that_closes_has_hung_up() {
    let peer = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = peer.local_addr().expect("its address").to_string();
    thread::spawn(move || drop(peer.accept()));
    assert!(matches!(cause(Hand::connect(&address, HANGS)), Cause::HungUp(_)));
}

/// More than a hand ever prints ends the connection at once, less at the limit.
#[test]
fn peer_that_is_no_hand_is_named_with_what_it_sent() {
    for (text, limit) in [("HTTP/1.1 400 Bad Request\r\n", SHORT), (&*"noise ".repeat(1 << 15), HANGS)] {
        let peer = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = peer.local_addr().expect("its address").to_string();
        let sent = text.to_owned();
        thread::spawn(move || {
            let mut stream = peer.accept().expect("a host").0;
            let _ = stream.write_all(sent.as_bytes());
            // Stays until the host has left.
            let _ = std::io::copy(&mut stream, &mut std::io::sink());
        });
        let cause = cause(Hand::connect(&address, limit));
        let Cause::NotAHand(received) = cause else { panic!("{cause:?}") };
        assert_eq!(received, text[..received.len()]);
        assert!(!received.is_empty());
    }
}

/// A device server in Telnet mode passes text, so that the connection would seem to work until a packet or RealTime has a 0xFF.
#[test]
fn device_server_that_negotiates_telnet_is_named() {
    for first in [&b"\xFF\xFB\x01\xFF\xFB\x03\xFF\xFD\x00"[..], b"\r\nPort 1\r\n\xFF\xFD\x2C"] {
        let peer = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = peer.local_addr().expect("its address").to_string();
        let sent = [first, b"\r\n\r=> "].concat();
        thread::spawn(move || {
            for stream in peer.incoming().take(2) {
                let mut stream = stream.expect("a host");
                let _ = stream.write_all(&sent);
                // Stays until the host has left.
                let _ = std::io::copy(&mut stream, &mut std::io::sink());
            }
        });
        assert_eq!(cause(Hand::connect(&address, HANGS)), Cause::Telnet, "{first:?}");
    }
}

#[test]
fn hand_with_another_host_names_it() {
    let served = Served::fast_hand();
    let first = Connect::tcp(served.place("gcl")).boards(Boards::Any).connect(HANGS).expect("connected");
    let cause = cause(Hand::connect(served.place("gcl"), HANGS));
    assert!(matches!(&cause, Cause::InUse(by) if by.starts_with("127.0.0.1:")), "{cause:?}");
    drop(first);
    // The end of the first host is no refusal.
    Hand::connect(served.place("gcl"), HANGS).expect("free again");
}

#[test]
fn sleeping_boards_are_named_and_can_be_woken() {
    let served = Served::fast_hand();
    let connect = Connect::tcp(served.place("gcl"));
    assert_eq!(
        cause(connect.boards(Boards::Ready).connect(HANGS)),
        Cause::Asleep(nodes(&[1, 2, 3, 4, 5, 6, 7]))
    );
    let hand = Hand::connect(served.place("gcl"), HANGS).expect("it wakes");
    assert_eq!(hand.version(), 600);
    drop(hand);
    Connect::tcp(served.place("gcl")).boards(Boards::Ready).connect(HANGS).expect("awake");
}

/// The transcripts of `god/transcripts` have these answers.
#[test]
fn other_firmware_and_missing_boards_are_named() {
    let other = scripted(&[("VERS", "262")]);
    assert_eq!(
        cause(Hand::connect(&other, HANGS)),
        Cause::WrongFirmware { found: "262".to_owned(), expected: 600 }
    );
    let without_4 =
        scripted(&[("VERS", "600"), (STATS, "1 STAT=2|2 STAT=2|3 STAT=2|5 STAT=2|6 STAT=2|7 STAT=2|ERR 1")]);
    assert_eq!(cause(Hand::connect(&without_4, HANGS)), Cause::WithoutPower(nodes(&[4])));
    let doubled = scripted(&[
        ("VERS", "600"),
        (STATS, "1 STAT=2|2 STAT=2|3 STAT=2|4 STAT=2|5 STAT=2|6 STAT=2|7 STAT=2|ERR 1"),
        ("2 G STAT", "2 STAT=2|ERR 1"),
    ]);
    assert_eq!(cause(Hand::connect(&doubled, HANGS)), Cause::TwoBoards(nodes(&[2])));
    // A board with the number of another: its own is silent.
    let moved = scripted(&[
        ("VERS", "600"),
        (STATS, "1 STAT=2|2 STAT=2|4 STAT=2|5 STAT=2|6 STAT=2|7 STAT=2|ERR 1"),
        ("2 G STAT", "2 STAT=2|ERR 1"),
    ]);
    assert_eq!(cause(Hand::connect(&moved, HANGS)), Cause::TwoBoards(nodes(&[2])));
    let none = scripted(&[("VERS", "600"), (STATS, "ERR 1")]);
    assert_eq!(cause(Hand::connect(&none, HANGS)), Cause::BusNotAcknowledged);
    let no_version = scripted(&[("VERS", "ERR 32")]);
    assert!(matches!(cause(Hand::connect(&no_version, HANGS)), Cause::NotAHand(_)));
}

#[cfg(unix)]
#[test]
fn serial_port_is_opened_or_named() {
    let missing = Connect::serial("/dev/no-such-port", 9600).connect(HANGS);
    assert!(matches!(cause(missing), Cause::NoSuchPort(_)));
    let served = Served::new(&["hand", "--pty", "--speed", "max"], 1);
    let mut hand = Connect::serial(served.place("pty"), 9600).connect(HANGS).expect("connected");
    assert_eq!(hand.boards(HANGS).expect("they answer"), [BoardState::Ready; 7]);
}

#[cfg(target_os = "linux")]
#[test]
fn missing_can_interface_is_named() {
    let error = Bus::can("nocan9").map(|_| ()).expect_err("there is none");
    assert!(matches!(error.cause, Cause::NoSuchPort(_)), "{error}");
}

#[test]
fn adapter_that_is_silent_or_in_use_is_named() {
    let peer = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = peer.local_addr().expect("its address").to_string();
    let error = Bus::slcan(&address, SHORT).map(|_| ()).expect_err("it is silent");
    assert_eq!(error.cause, Cause::SilentAdapter(SHORT));
    let served = Served::new(&["bus", "--node", "4", "--slcan", "127.0.0.1:0"], 1);
    let first = Bus::slcan(served.place("slcan"), HANGS).expect("connected");
    let error = Bus::slcan(served.place("slcan"), HANGS).map(|_| ()).expect_err("it has a host");
    assert!(matches!(error.cause, Cause::InUse(_)), "{error}");
    drop(first);
}

#[test]
fn boards_on_the_bus_are_required_and_missing_ones_named() {
    let served = Served::new(&["bus", "--nodes", "1,4", "--slcan", "127.0.0.1:0"], 1);
    let mut bus = Bus::slcan(served.place("slcan"), HANGS).expect("connected");
    // Four questions: a board of a busy simulator may miss some of them.
    let limit = Duration::from_secs(1);
    let mut cause = |numbers: &[u8]| bus.require(&nodes(numbers), limit).map_err(|error| error.cause);
    assert_eq!(cause(&[1, 4]), Err(Cause::Asleep(nodes(&[1, 4]))));
    assert_eq!(cause(&[1, 4, 5]), Err(Cause::WithoutPower(nodes(&[5]))));
    assert_eq!(cause(&[5]), Err(Cause::BusNotAcknowledged));
    bus.wake(&nodes(&[1, 4]), HANGS).expect("awake");
    assert_eq!(bus.require(&nodes(&[1, 4]), HANGS), Ok(()));
}

/// GOD is its bus's host: an adapter beside it only watches.
#[test]
fn watching_adapter_refuses_to_send() {
    let served = Served::new(&["hand", "--listen", "127.0.0.1:0", "--slcan", "127.0.0.1:0"], 2);
    let mut bus = Bus::slcan(served.place("slcan"), HANGS).expect("connected");
    let error = bus.get(nodes(&[4])[0], Property::P, SHORT).expect_err("it only watches");
    assert_eq!(error.failure, Failure::Refused);
    assert!(matches!(bus.require(&nodes(&[4]), SHORT), Err(ConnectError { cause: Cause::InUse(_), .. })));
}

#[test]
fn echo_is_no_adapter() {
    let peer = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = peer.local_addr().expect("its address").to_string();
    thread::spawn(move || {
        let stream = peer.accept().expect("a host").0;
        std::io::copy(&mut &stream, &mut &stream)
    });
    let error = Bus::slcan(&address, HANGS).map(|_| ()).expect_err("it is none");
    assert!(matches!(error.cause, Cause::NotAnAdapter(_)), "{error}");
}

/// An adapter without 1 Mbit/s, as CAN232 answers: BEL.
#[test]
fn adapter_without_the_bit_rate_is_named() {
    let peer = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = peer.local_addr().expect("its address").to_string();
    thread::spawn(move || {
        let stream = peer.accept().expect("a host").0;
        let mut out = stream.try_clone().expect("a second handle");
        for line in BufReader::new(stream).split(b'\r').map_while(Result::ok) {
            let answer: &[u8] = match &*line {
                b"V" => b"V0100\r",
                b"S8" => b"\x07",
                _ => b"\r",
            };
            let _ = out.write_all(answer);
        }
    });
    let error = Bus::slcan(&address, HANGS).map(|_| ()).expect_err("it refuses");
    assert_eq!(error.cause, Cause::Refused("S8 (1 Mbit/s)".to_owned()));
}
