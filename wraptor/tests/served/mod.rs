//! A simulated hand or bus in a process of its own, and peers that misbehave.

#![allow(dead_code, reason = "each test binary uses some of it")]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use tater_f103::map::{APPLICATION, MAP, RAM};
use tater_wire::image::seal;
use tater_wire::tek::{Encoder, end as last_line};
use wraptor::{Deadline, Firmware};

/// Limit of a call that must succeed: a busy machine may stop a process for seconds.
pub const HANGS: Duration = Duration::from_secs(60);

pub type Process = Arc<Mutex<Child>>;

pub fn end(process: &Process) {
    let mut process = process.lock().unwrap_or_else(PoisonError::into_inner);
    let _ = process.kill();
    let _ = process.wait();
}

pub struct Served {
    pub process: Process,
    /// Purpose and place of each endpoint.
    doors: Vec<(String, String)>,
}

impl Drop for Served {
    fn drop(&mut self) {
        end(&self.process);
    }
}

impl Served {
    /// Starts `hil-sim` and reads as many lines of endpoints.
    pub fn new(args: &[&str], doors: usize) -> Self {
        let tests = std::env::current_exe().expect("this test has a path");
        let target = tests.ancestors().nth(2).expect("it lies in target/PROFILE/deps");
        let program = target.join("hil-sim");
        assert!(program.exists(), "{}: missing\n  next: cargo build -p hil-sim", program.display());
        let mut command = Command::new(program);
        command.args(args).stderr(Stdio::null()).stdout(Stdio::piped());
        let mut process = command.spawn().expect("the simulator starts");
        let lines = BufReader::new(process.stdout.take().expect("piped")).lines();
        let door = |line: std::io::Result<String>| {
            let line = line.expect("text");
            let (kind, place) = line.split_once(' ').expect("an endpoint and its place");
            (kind.to_owned(), place.to_owned())
        };
        Self { doors: lines.take(doors).map(door).collect(), process: Arc::new(Mutex::new(process)) }
    }

    /// A hand in real time.
    pub fn hand() -> Self {
        Self::new(&["hand", "--listen", "127.0.0.1:0"], 1)
    }

    /// A hand as fast as the machine can.
    pub fn fast_hand() -> Self {
        Self::new(&["hand", "--listen", "127.0.0.1:0", "--speed", "max"], 1)
    }

    pub fn place(&self, kind: &str) -> &str {
        let door = self.doors.iter().find(|door| door.0 == kind);
        &door.unwrap_or_else(|| panic!("{kind} in {:?}", self.doors)).1
    }
}

/// A peer that answers each line ending with CR by what the script has for it, in the form of a hand. Returns its address.
pub fn scripted(script: &'static [(&'static str, &'static str)]) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address").to_string();
    thread::spawn(move || {
        if let Ok((peer, _)) = listener.accept() {
            answer_lines(peer, script);
        }
    });
    address
}

/// Answers a host until it leaves, as [`scripted`].
pub fn answer_lines(mut peer: TcpStream, script: &[(&str, &str)]) {
    let (mut line, mut byte) = (String::new(), [0]);
    while matches!(peer.read(&mut byte), Ok(1)) {
        if byte[0] != b'\r' {
            line.push(char::from(byte[0]));
            continue;
        }
        let answer = script.iter().find(|(asked, _)| *asked == line).map_or("", |(_, answer)| answer);
        let lines: String = answer.split_terminator('|').map(|text| format!("\r\n\r{text}")).collect();
        let _ = peer.write_all(format!("{line}{lines}\r\n\r=> ").as_bytes());
        line.clear();
    }
}

/// A peer that connects like a hand, and answers the line after that with bytes without an end. `at_once`: from the start.
pub fn flooding(bytes: &'static [u8], at_once: bool) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address").to_string();
    thread::spawn(move || {
        let Ok((mut peer, _)) = listener.accept() else { return };
        let mut byte = [0];
        let mut line = Vec::new();
        while !at_once && matches!(peer.read(&mut byte), Ok(1)) {
            match (byte, &*line) {
                ([b'\r'], b"") => _ = peer.write_all(b"\r\n\r=> "),
                ([b'\r'], b"VERS") => _ = peer.write_all(b"VERS\r\n\r601\r\n\r=> "),
                ([b'\r'], _) => break,
                ([byte], _) => {
                    line.push(byte);
                    continue;
                }
            }
            line.clear();
        }
        let flood = bytes.repeat(4096);
        while peer.write_all(&flood).is_ok() {}
    });
    address
}

/// The `.tek` text of a sealed application of some bytes.
pub fn tek(len: usize, version: u32) -> Vec<u8> {
    let mut image = vec![0x5A; len];
    image[..4].copy_from_slice(&RAM.end().to_le_bytes());
    image[4..8].copy_from_slice(&(APPLICATION.start + 0x101).to_le_bytes());
    // The vectors that hold the header are reserved.
    image[0x1C..0x2C].fill(0);
    seal(&mut image, version, &MAP).expect("an application");
    let lines = Encoder::new(APPLICATION.start, &image).expect("it fits");
    let mut text: Vec<u8> = lines.flat_map(|line| line.as_bytes().to_vec()).collect();
    text.extend_from_slice(last_line(APPLICATION.start).as_bytes());
    text
}

/// A file that boards take.
pub fn firmware(len: usize) -> Firmware {
    Firmware::new(tek(len, 601)).expect("sealed")
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cut {
    /// The hand's process ends.
    Kill,
    /// Nothing passes any more, and nobody closes: a cable that is pulled.
    Silence,
}

/// Between a host and a hand: cuts the connection when the host has sent `trigger`.
pub struct Proxy {
    pub address: String,
    threads: Vec<JoinHandle<()>>,
    sockets: Arc<Mutex<Vec<TcpStream>>>,
}

impl Proxy {
    pub fn new(served: &Served, trigger: &'static [u8], cut: Cut) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("its address").to_string();
        let (hand, process) = (served.place("gcl").to_owned(), Arc::clone(&served.process));
        let sockets = Arc::new(Mutex::new(Vec::new()));
        let kept = Arc::clone(&sockets);
        let run = move || {
            let (mut host, _) = listener.accept().expect("a host");
            let mut hand = TcpStream::connect(hand).expect("a hand");
            let clone = |stream: &TcpStream| stream.try_clone().expect("a second handle");
            kept.lock().expect("unpoisoned").extend([clone(&host), clone(&hand)]);
            let is_cut = Arc::new(AtomicBool::new(false));
            let (mut from_hand, mut to_host, cut_off) = (clone(&hand), clone(&host), Arc::clone(&is_cut));
            let back = thread::spawn(move || {
                let mut bytes = [0; 1024];
                while let Ok(len @ 1..) = from_hand.read(&mut bytes) {
                    if !cut_off.load(Ordering::SeqCst) && to_host.write_all(&bytes[..len]).is_err() {
                        return;
                    }
                }
                if !cut_off.load(Ordering::SeqCst) {
                    let _ = to_host.shutdown(Shutdown::Both);
                }
            });
            let (mut seen, mut bytes) = (Vec::new(), [0; 1024]);
            while let Ok(len @ 1..) = host.read(&mut bytes) {
                seen.extend_from_slice(&bytes[..len]);
                if !is_cut.load(Ordering::SeqCst) && seen.windows(trigger.len()).any(|w| w == trigger) {
                    match cut {
                        Cut::Kill => end(&process),
                        Cut::Silence => is_cut.store(true, Ordering::SeqCst),
                    }
                }
                if !is_cut.load(Ordering::SeqCst) && hand.write_all(&bytes[..len]).is_err() {
                    break;
                }
            }
            let _ = hand.shutdown(Shutdown::Both);
            let _ = back.join();
        };
        Self { address, threads: vec![thread::spawn(run)], sockets }
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        for socket in self.sockets.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
            let _ = socket.shutdown(Shutdown::Both);
        }
        self.threads.drain(..).for_each(|thread| _ = thread.join());
    }
}

/// Threads of the library, and sockets of this program. A thread that was joined is listed for a moment more.
#[cfg(target_os = "linux")]
pub fn left() -> (usize, usize) {
    let entries = |path: &str| std::fs::read_dir(path).expect("Linux has it").flatten().collect::<Vec<_>>();
    let is_ours = |name: String| name.starts_with("wraptor-");
    let threads = || {
        let tasks = entries("/proc/self/task");
        tasks
            .iter()
            .filter(|task| std::fs::read_to_string(task.path().join("comm")).is_ok_and(is_ours))
            .count()
    };
    let deadline = Deadline::after(Duration::from_secs(5));
    while threads() > 0 && !deadline.is_over() {
        thread::yield_now();
    }
    let is_socket = |path: std::path::PathBuf| path.to_string_lossy().starts_with("socket:");
    let files = entries("/proc/self/fd");
    let sockets = files.iter().filter(|file| std::fs::read_link(file.path()).is_ok_and(is_socket)).count();
    (threads(), sockets)
}
