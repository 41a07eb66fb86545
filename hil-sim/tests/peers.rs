//! Clients that vanish without a FIN, as with a pulled cable: the next one is served seconds later. And Telnet clients.
#![cfg(target_os = "linux")]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Connects to a port, reads and writes once, and vanishes: in repair mode (root) a socket closes without a FIN.
const VANISH: &str = "
import socket, sys
peer = socket.create_connection(('127.0.0.1', int(sys.argv[1])))
peer.sendall(sys.argv[2].encode())
peer.recv(100)
try:
    peer.setsockopt(socket.IPPROTO_TCP, 19, 1)
except PermissionError:
    sys.exit(3)
peer.close()
";

/// Attempts to become the host. A refused one takes some 100 ms, so that this is over twice the 5 s of the keep-alive.
const ATTEMPTS: usize = 150;

struct Served {
    process: Child,
    ports: Vec<String>,
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

fn serve(args: &[&str], doors: usize) -> Served {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    command.args(args).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut process = command.spawn().expect("the binary starts");
    let lines = BufReader::new(process.stdout.take().expect("piped")).lines();
    let port = |line: std::io::Result<String>| {
        line.expect("text").rsplit_once(':').expect("an address").1.to_owned()
    };
    let ports = lines.take(doors).map(port).collect();
    Served { process, ports }
}

/// Whether a client could vanish; prints why not.
fn vanish(port: &str, text: &str) -> bool {
    let Ok(status) = Command::new("python3").args(["-c", VANISH, port, text]).status() else {
        println!("skipped: no python3 to close a socket without a FIN");
        return false;
    };
    if status.code() == Some(3) {
        println!("skipped: TCP_REPAIR needs root");
        return false;
    }
    assert!(status.success(), "{status}");
    true
}

/// What a new client gets for `text`, up to `end`, or up to the refusal.
fn ask(port: &str, text: &str, end: &str) -> String {
    let mut stream = TcpStream::connect(format!("127.0.0.1:{port}")).expect("it listens");
    stream.set_read_timeout(Some(Duration::from_secs(60))).expect("a limit");
    // A refused client may be closed already.
    let _ = stream.write_all(text.as_bytes());
    let (mut answer, mut byte) = (Vec::new(), [0]);
    while !answer.ends_with(end.as_bytes()) && stream.read(&mut byte).is_ok_and(|len| len > 0) {
        answer.push(byte[0]);
    }
    String::from_utf8_lossy(&answer).into_owned()
}

fn serves_again(port: &str, text: &str, end: &str) {
    let is_served = || {
        let answer = ask(port, text, end);
        answer.ends_with(end) && !answer.starts_with("error")
    };
    assert!(!is_served(), "it is not known yet that the host has vanished");
    let served = (0..ATTEMPTS).find(|_| is_served());
    assert!(served.is_some(), "{ATTEMPTS} clients were refused after the host had vanished");
}

#[test]
fn hand_serves_the_next_host_after_one_has_vanished() {
    let served = serve(&["hand", "--listen", "127.0.0.1:0", "--no-discovery"], 1);
    if vanish(&served.ports[0], "\r") {
        serves_again(&served.ports[0], "VERS\r", "=> ");
    }
}

#[test]
fn bus_serves_the_next_host_after_one_has_vanished() {
    let served = serve(&["bus", "--node", "4", "--slcan", "127.0.0.1:0"], 1);
    if vanish(&served.ports[0], "V\r") {
        serves_again(&served.ports[0], "N\r", "\r");
    }
}

/// Four tools may watch a hand's bus: four that have vanished keep nobody out.
#[test]
fn watchers_that_have_vanished_give_their_places_back() {
    let served = serve(&["hand", "--listen", "127.0.0.1:0", "--no-discovery", "--slcan", "127.0.0.1:0"], 2);
    if (0..4).all(|_| vanish(&served.ports[1], "V\r")) {
        let answer = |_: &usize| !ask(&served.ports[1], "V\r", "\r").starts_with("error");
        // These are refused at once.
        assert!((0..ATTEMPTS * 100).find(answer).is_some(), "the places of four tools stay taken");
    }
}

fn read_to(stream: &mut TcpStream, end: &[u8]) -> Vec<u8> {
    let (mut answer, mut byte) = (Vec::new(), [0]);
    while !answer.ends_with(end) {
        assert_eq!(stream.read(&mut byte).ok(), Some(1), "{}", String::from_utf8_lossy(&answer));
        answer.push(byte[0]);
    }
    answer
}

#[test]
fn telnet_options_are_refused_and_its_stops_stop() {
    let served = serve(&["hand", "--listen", "127.0.0.1:0", "--no-discovery"], 1);
    let mut stream = TcpStream::connect(format!("127.0.0.1:{}", served.ports[0])).expect("it listens");
    stream.set_read_timeout(Some(Duration::from_secs(20))).expect("a limit");
    let mut say = |bytes: &[u8], end: &[u8]| {
        stream.write_all(bytes).expect("written");
        read_to(&mut stream, end)
    };
    say(b"\r", b"=> ");
    // DO ECHO, WILL NAWS, and its subnegotiation with a 0x03 in it.
    let answer = say(b"\xFF\xFD\x01\xFF\xFB\x1F\xFF\xFA\x1F\0\x03\0\x18\xFF\xF0VERS\r\0", b"=> ");
    let text = String::from_utf8_lossy(&answer).into_owned();
    for refusal in [[255, 252, 1], [255, 254, 31]] {
        assert!(answer.windows(3).any(|bytes| bytes == refusal), "{text}");
    }
    assert!(text.contains("VERS\r\n\r60") && !text.contains("ERR"), "{text}");
    // Interrupt Process alone, with its mark, Break, and Interrupt Process behind a packet that has broken off.
    for stop in [&b"\xFF\xF4"[..], b"\xFF\xF4\xFF\xF2", b"\xFF\xF3", b"\x04\x04\x0B\xFF\xF4"] {
        // Without the stop the prompt is two minutes away.
        say(b"WAIT 60000\rWAIT 60000\r", b"WAIT 60000");
        let text = String::from_utf8_lossy(&say(stop, b"=> ")).into_owned();
        assert!(text.contains("ERR 16384"), "{stop:?}: {text}");
    }
    // In RealTime, where a block would begin.
    say(b"HI\r", b"=> ");
    say(b"1LOOP\r", b"*");
    say(b"\xFF\xF4", b"=> ");
    // Packets keep their 0xFF: no prompt, and GOD still answers.
    let text = String::from_utf8_lossy(&say(b"\x00\x01\x04\xAD\x00\xFF\xF4VERS\r", b"=> ")).into_owned();
    assert!(text.contains("VERS\r\n\r60") && !text.contains("ERR"), "{text}");
}
