//! Boards on a simulated bus, served by a process of their own until the test ends.

#![allow(dead_code, reason = "each test binary uses some of it")]

use std::io::{BufRead, BufReader, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};

pub struct Served {
    pub process: Child,
    /// Host and port of its SLCAN.
    pub address: String,
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Boards of these nodes, such as `1-7`.
pub fn serve(nodes: &str) -> Served {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    command.args(["bus", "--nodes", nodes, "--slcan", "127.0.0.1:0"]);
    start(command.stderr(Stdio::null()))
}

pub fn start(command: &mut Command) -> Served {
    let mut process = command.stdout(Stdio::piped()).spawn().expect("the binary starts");
    let mut line = String::new();
    let out = process.stdout.take().expect("piped");
    BufReader::new(out).read_line(&mut line).expect("the first line");
    let address = line.trim().strip_prefix("slcan ").expect("says where it listens").to_owned();
    Served { process, address }
}

/// An adapter between clients, one after the other, and a bus: a digit too many in every ninth received frame of six bytes. Returns its address.
pub fn damaging(bus: &str) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("bound").to_string();
    let bus = bus.to_owned();
    std::thread::spawn(move || {
        for client in listener.incoming().map_while(Result::ok) {
            let Ok(bus) = TcpStream::connect(&bus) else { return };
            let (from, mut to) = (bus.try_clone().expect("a socket"), client.try_clone().expect("a socket"));
            let back = std::thread::spawn(move || {
                let (mut from, mut line, mut frames) = (BufReader::new(from), Vec::new(), 0);
                while from.read_until(b'\r', &mut line).is_ok_and(|len| len > 0) {
                    frames += usize::from(line.starts_with(b"t"));
                    if line.starts_with(b"t") && line.len() == 14 && frames % 9 == 2 {
                        line.insert(9, b'2');
                    }
                    if to.write_all(&line).is_err() {
                        return;
                    }
                    line.clear();
                }
                let _ = to.shutdown(Shutdown::Both);
            });
            let _ = std::io::copy(&mut &client, &mut &bus);
            let _ = bus.shutdown(Shutdown::Both);
            let _ = back.join();
        }
    });
    address
}
