//! Boards on a simulated bus, served by a process of their own until the test ends.

use std::io::{BufRead, BufReader};
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
