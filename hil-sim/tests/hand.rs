//! `hil-sim hand` as its hosts meet it: TCP, a pseudo-terminal, SLCAN.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// Only ends a test that would otherwise hang.
const HANGS: Duration = Duration::from_secs(60);

/// A served hand; ends with the test.
struct Served {
    process: Child,
    /// What it listens on, in its own words.
    doors: Vec<(String, String)>,
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Served {
    fn new(args: &[&str], doors: usize) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
        command.arg("hand").args(args).stdout(Stdio::piped()).stderr(Stdio::null());
        let mut process = command.spawn().expect("the binary starts");
        let lines = BufReader::new(process.stdout.take().expect("piped")).lines();
        let door = |line: std::io::Result<String>| {
            let line = line.expect("text");
            let (kind, place) = line.split_once(' ').expect("a door and its place");
            (kind.to_owned(), place.to_owned())
        };
        let doors = lines.take(doors).map(door).collect();
        Self { process, doors }
    }

    fn place(&self, kind: &str) -> &str {
        let door = self.doors.iter().find(|door| door.0 == kind);
        &door.unwrap_or_else(|| panic!("{kind} in {:?}", self.doors)).1
    }

    fn connect(&self, kind: &str) -> TcpStream {
        let stream = TcpStream::connect(self.place(kind)).expect("connected");
        stream.set_read_timeout(Some(HANGS)).expect("a time-out");
        stream
    }

    /// Connects until it is the host: the hand hears in its own time that the last one has left.
    fn host(&self) -> TcpStream {
        loop {
            let mut stream = self.connect("gcl");
            stream.write_all(b"\r").expect("written");
            if read_to(&mut stream, "=> ").is_ok() {
                return stream;
            }
        }
    }
}

/// Reads until what has come ends so; `Err` if the other side closes before.
fn read_to(from: &mut impl Read, end: &str) -> Result<String, String> {
    let mut text = String::new();
    let mut byte = [0];
    while !text.ends_with(end) {
        match from.read(&mut byte) {
            Ok(1) => text.push(char::from(byte[0])),
            Ok(_) => return Err(text),
            // A client that is refused while it writes may be reset.
            Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => return Err(text),
            Err(error) => panic!("{error} after {text:?}"),
        }
    }
    Ok(text)
}

/// Types a line; what came up to the prompt.
fn ask(host: &mut (impl Read + Write), line: &str) -> String {
    host.write_all(format!("{line}\r").as_bytes()).expect("written");
    read_to(host, "=> ").expect("a prompt")
}

const TCP: [&str; 2] = ["--listen", "127.0.0.1:0"];

/// An empty folder of this test's own.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

#[test]
fn a_host_types_and_one_that_leaves_in_mid_line_leaves_nothing_behind() {
    let served = Served::new(&TCP, 1);
    let mut host = served.host();
    assert_eq!(ask(&mut host, "frOb"), "frOb\r\n\rERR 32\r\n\r=> ");
    host.write_all(b"half a line").expect("written");
    read_to(&mut host, "half a line").expect("the echo");
    drop(host);
    let mut next = served.host();
    assert_eq!(ask(&mut next, ""), "\r\n\r=> ");
    assert_eq!(ask(&mut next, "frob"), "frob\r\n\rERR 32\r\n\r=> ");
}

#[test]
fn a_second_host_is_told_who_is_there_and_closed() {
    let served = Served::new(&TCP, 1);
    let mut host = served.host();
    let mut second = served.connect("gcl");
    let mut text = String::new();
    second.read_to_string(&mut text).expect("closed in order");
    let first = host.local_addr().expect("connected");
    assert!(text.starts_with(&format!("\r\n\rbusy: {first} speaks with the hand")), "{text:?}");
    assert_eq!(ask(&mut host, "frob"), "frob\r\n\rERR 32\r\n\r=> ");
}

/// GOD's answers fill all that may wait for the host, and then the hand takes no more from it: what it writes finds no room
/// either. It is the kernel that has it, not the hand.
#[test]
fn a_host_that_never_reads_is_not_served_beyond_what_may_wait_and_stops_nobody() {
    let served = Served::new(&[&TCP[..], &["--slcan", "127.0.0.1:0"]].concat(), 2);
    let mut deaf = served.host();
    deaf.set_write_timeout(Some(Duration::from_secs(1))).expect("a time-out");
    // More than two sockets hold; 24 bytes of answer to each 5.
    let mut written = 0;
    while written < 100_000_000 && deaf.write_all(&b"frob\r".repeat(10_000)).is_ok() {
        written += 50_000;
    }
    assert!(written < 100_000_000, "it takes all that it is given");
    let mut tool = served.connect("slcan");
    tool.write_all(b"V\r").expect("written");
    assert_eq!(read_to(&mut tool, "\r").expect("an answer"), "V0100\r", "time goes on");
    drop(deaf);
    let mut next = served.host();
    assert_eq!(ask(&mut next, "frob"), "frob\r\n\rERR 32\r\n\r=> ");
}

#[test]
fn a_tool_watches_the_bus_and_sends_nothing() {
    let served = Served::new(&[&TCP[..], &["--slcan", "127.0.0.1:0"]].concat(), 2);
    let mut tool = served.connect("slcan");
    tool.write_all(b"C\rS8\rO\rt0040\r").expect("written");
    assert_eq!(read_to(&mut tool, "\r\x07").expect("answers"), "\x07\r\r\x07");
}

#[cfg(unix)]
#[test]
fn a_pseudo_terminal_is_a_serial_port_and_shares_the_hand_in_turn() {
    let served = Served::new(&[&TCP[..], &["--pty"]].concat(), 2);
    let open = || File::options().read(true).write(true).open(served.place("pty")).expect("a terminal");
    for _ in 0..2 {
        let mut port = open();
        // Raw: nothing echoed or changed on the way but by GOD.
        assert_eq!(ask(&mut port, "frOb\x7f"), "frOb\x08 \x08\r\n\rERR 32\r\n\r=> ");
        let mut text = String::new();
        served.connect("gcl").read_to_string(&mut text).expect("closed in order");
        assert!(text.contains("busy: /dev/"), "{text:?}");
        drop(port);
        let mut host = served.host();
        assert_eq!(ask(&mut host, "frob"), "frob\r\n\rERR 32\r\n\r=> ");
        let mut port = open();
        port.write_all(b"\r").expect("written");
        let text = read_to(&mut port, "time\r\n\r").expect("an answer");
        assert!(text.contains("busy: 127.0.0.1:"), "{text:?}");
        drop((port, host));
        // The next round's terminal has to be the host.
        drop(served.host());
        let mut port = open();
        while !ask_or_busy(&mut port).ends_with("=> ") {}
    }
}

/// A line to a terminal; its prompt, or that the hand is busy.
#[cfg(unix)]
fn ask_or_busy(port: &mut File) -> String {
    port.write_all(b"\r").expect("written");
    let mut text = String::new();
    let mut byte = [0];
    while !text.ends_with("=> ") && !text.ends_with("time\r\n\r") {
        port.read_exact(&mut byte).expect("an answer");
        text.push(char::from(byte[0]));
    }
    text
}

#[test]
fn a_state_that_is_none_is_refused_and_left_as_it_is() {
    let folder = folder("bad-state");
    let path = folder.join("hand.state");
    let args = |path: &Path| -> Vec<String> {
        ["--listen", "127.0.0.1:0", "--state", &path.to_string_lossy()].map(str::to_owned).to_vec()
    };
    for content in [&b""[..], b"something else", b"hil-sim hand, state 1\n\xFF\xFF\xFF\xFF"] {
        fs::write(&path, content).expect("written");
        let output = Command::new(env!("CARGO_BIN_EXE_hil-sim")).arg("hand").args(args(&path)).output();
        let output = output.expect("it starts");
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.contains("hand.state") && error.contains("left as it is"), "{error}");
        assert_eq!(fs::read(&path).expect("there"), content);
    }
    fs::remove_file(&path).expect("there");
    let served = Served::new(&args(&path).iter().map(String::as_str).collect::<Vec<_>>(), 1);
    assert!(path.exists(), "it is made at the start");
    let second = Command::new(env!("CARGO_BIN_EXE_hil-sim")).arg("hand").args(args(&path)).output();
    let second = second.expect("it starts");
    let error = String::from_utf8_lossy(&second.stderr).into_owned();
    assert_eq!(second.status.code(), Some(2), "{error}");
    assert!(error.contains("in use"), "{error}");
    drop(served);
}
