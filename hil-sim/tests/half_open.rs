//! Clients that vanish without a FIN, as with a pulled cable: the next one is served seconds later.
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
