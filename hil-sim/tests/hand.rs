//! `hil-sim hand` with its hosts: TCP, a pseudo-terminal, SLCAN.

// It reads /proc.
#[cfg(target_os = "linux")]
mod soak;

#[cfg(target_os = "linux")]
use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{Shutdown, SocketAddrV4, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use rand::RngExt;
use rand_pcg::Pcg64Mcg;

const HANGS: Duration = Duration::from_secs(60);

/// Deadline for tests on a terminal, which has no timeout.
const ENDS: Duration = Duration::from_secs(300);

struct Served {
    process: Arc<Mutex<Child>>,
    /// Dropping it stops the watchdog thread.
    _alive: Sender<()>,
    /// Purpose and address of each endpoint.
    doors: Vec<(String, String)>,
}

impl Drop for Served {
    fn drop(&mut self) {
        end(&self.process);
    }
}

fn end(process: &Mutex<Child>) {
    let mut process = process.lock().unwrap_or_else(PoisonError::into_inner);
    let _ = process.kill();
    let _ = process.wait();
}

impl Served {
    fn new(args: &[&str], doors: usize) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
        Self::start(command.arg("hand").args(args).stderr(Stdio::null()), doors)
    }

    fn start(command: &mut Command, doors: usize) -> Self {
        Self::start_for(command, doors, ENDS)
    }

    fn start_for(command: &mut Command, doors: usize, ends: Duration) -> Self {
        let mut process = command.stdout(Stdio::piped()).spawn().expect("the binary starts");
        let lines = BufReader::new(process.stdout.take().expect("piped")).lines();
        let door = |line: std::io::Result<String>| {
            let line = line.expect("text");
            let (kind, place) = line.split_once(' ').expect("a door and its place");
            (kind.to_owned(), place.to_owned())
        };
        let process = Arc::new(Mutex::new(process));
        let (_alive, over) = channel::<()>();
        let watched = Arc::clone(&process);
        thread::spawn(move || {
            if over.recv_timeout(ends) == Err(RecvTimeoutError::Timeout) {
                end(&watched);
            }
        });
        let doors = lines.take(doors).map(door).collect();
        Self { process, _alive, doors }
    }

    #[cfg(target_os = "linux")]
    fn id(&self) -> u32 {
        self.process.lock().unwrap_or_else(PoisonError::into_inner).id()
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

    /// Connects until it is the host: the hand notices with a delay that the last host has left.
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

/// `Err` if the other side closes first.
fn read_to(from: &mut impl Read, end: &str) -> Result<String, String> {
    let mut text = String::new();
    let mut byte = [0];
    while !text.ends_with(end) {
        match from.read(&mut byte) {
            Ok(1) => text.push(char::from(byte[0])),
            Ok(_) => return Err(text),
            // A client that is refused while it writes may be reset.
            Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => return Err(text),
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => panic!("{error} after {text:?}"),
        }
    }
    Ok(text)
}

fn ask(host: &mut (impl Read + Write), line: &str) -> String {
    host.write_all(format!("{line}\r").as_bytes()).expect("written");
    read_to(host, "=> ").expect("a prompt")
}

const TCP: [&str; 2] = ["--listen", "127.0.0.1:0"];

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

#[test]
fn host_that_leaves_in_mid_line_leaves_nothing_behind() {
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

/// More than the 256 bytes that GOD queues, and less than what is read ahead.
const AHEAD: usize = 10_000;

#[test]
fn type_ahead_does_not_mask_control_c_or_disconnect() {
    let served = Served::new(&TCP, 1);
    let mut host = served.host();
    for line in ["1FSET MCV 30", "X1HI"] {
        assert_eq!(ask(&mut host, line), format!("{line}\r\n\r=> "));
    }
    let move_on = format!("X1M 15000\r{}", "x".repeat(AHEAD));
    let position = |host: &mut TcpStream| -> i32 {
        let said = ask(host, "X1FGET P");
        said.split_whitespace()
            .nth(2)
            .and_then(|word| word.parse().ok())
            .unwrap_or_else(|| panic!("{said:?}"))
    };
    host.write_all(move_on.as_bytes()).expect("written");
    read_to(&mut host, "X1M 15000").expect("it is begun");
    host.write_all(b"\x03").expect("written");
    assert_eq!(read_to(&mut host, "=> ").expect("a prompt"), "\r\n\rERR 16384\r\n\r=> ");
    assert!(position(&mut host) < 10_000);
    ask(&mut host, "X1HOME");
    host.write_all(move_on.as_bytes()).expect("written");
    // The rest of the echo arrives unread: the client's system resets the connection. Without that it would be an end of input.
    read_to(&mut host, "X1M 1500").expect("it is begun");
    drop(host);
    let mut next = served.host();
    assert_eq!(ask(&mut next, "frob"), "frob\r\n\rERR 32\r\n\r=> ");
    assert!(position(&mut next) < 10_000);
}

/// The text that a host reads up to the hand's end of the connection, after it has sent `lines` and closed its own side.
fn half_closed(mut host: TcpStream, lines: &str) -> String {
    host.write_all(lines.as_bytes()).expect("written");
    host.shutdown(Shutdown::Write).expect("connected");
    let mut text = String::new();
    host.read_to_string(&mut text).unwrap_or_else(|error| panic!("{error} after {text:?}"));
    text
}

/// As `printf 'HI\r...' | nc -N` does.
#[test]
fn half_closed_host_gets_all_answers() {
    let served = Served::new(&[&TCP[..], &["--speed", "max"]].concat(), 1);
    let text = half_closed(served.connect("gcl"), "HI\rX1FGET P\rfrob\rhalf a line");
    assert!(
        text.ends_with("HI\r\n\r=> X1FGET P\r\n\r0\r\n\r=> frob\r\n\rERR 32\r\n\r=> half a line"),
        "{text:?}"
    );
    // Nothing of it is left for the next host, whose input the hand echoes and answers; an empty input ends at once.
    assert_eq!(ask(&mut served.host(), "frob"), "frob\r\n\rERR 32\r\n\r=> ");
    half_closed(served.host(), "");
    // The report that ends a motion of the walk-through's grammar comes after its prompt.
    let text = half_closed(served.host(), "1 S E 100\r1 S M 5\r");
    assert!(text.ends_with("1 S M 5\r\n\r=> \r\n\r1 MODE=3\r\n\r=> "), "{text:?}");
    // MODE 3 never ends; a host that waits for that does not keep others out for ever.
    let text = half_closed(served.host(), "1 S M 3\r");
    assert!(text.ends_with("1 S M 3\r\n\r=> "), "{text:?}");
    assert_eq!(ask(&mut served.host(), "frob"), "frob\r\n\rERR 32\r\n\r=> ");
}

/// The answer to a block is read; the motors stop, and the hand is free for the next host.
#[test]
fn end_of_input_ends_realtime() {
    let served = Served::new(&[&TCP[..], &["--speed", "max"]].concat(), 1);
    let mut host = served.host();
    ask(&mut host, "HI");
    host.write_all(b"1LOOP\r").expect("written");
    read_to(&mut host, "*").expect("RealTime has begun");
    let text = half_closed(host, "a");
    assert_eq!(text, "*\r\n\rERR 16384\r\n\r=> ");
    // Sent ahead as well.
    let text = half_closed(served.host(), "1LOOP\ra");
    assert!(text.ends_with("1LOOP**\r\n\rERR 16384\r\n\r=> "), "{text:?}");
    assert_eq!(ask(&mut served.host(), "frob"), "frob\r\n\rERR 32\r\n\r=> ");
}

/// The end of one connection and the start of the next reach the hand by two threads.
#[cfg(target_os = "linux")]
#[test]
fn immediate_reconnect_is_never_refused() {
    let served = Served::new(&TCP, 1);
    for round in 0..200 {
        let mut host = served.connect("gcl");
        let line = if round % 2 == 0 { "frob" } else { "" };
        host.write_all(format!("{line}\r").as_bytes()).expect("written");
        let text = read_to(&mut host, "=> ").unwrap_or_else(|text| panic!("{round}: {text:?}"));
        assert!(!text.contains("busy"), "{round}: {text:?}");
        if round % 3 == 0 {
            host.write_all(b"half a line").expect("written");
        }
    }
}

/// The half-closed host is still the host: the next one waits for its turn, and others are refused.
#[test]
fn half_closed_host_gets_its_answers_while_another_waits() {
    let served = Served::new(&TCP, 1);
    let mut first = served.host();
    first.write_all(b"WAIT 500\rfrob\r").expect("written");
    first.shutdown(Shutdown::Write).expect("connected");
    let mut second = served.connect("gcl");
    let mut text = String::new();
    served.connect("gcl").read_to_string(&mut text).expect("closed in order");
    assert!(
        text.contains("busy: ") && text.contains(&first.local_addr().expect("connected").to_string()),
        "{text:?}"
    );
    text.clear();
    first.read_to_string(&mut text).expect("closed in order");
    assert!(text.ends_with("WAIT 500\r\n\r=> frob\r\n\rERR 32\r\n\r=> "), "{text:?}");
    assert_eq!(ask(&mut second, "frob"), "frob\r\n\rERR 32\r\n\r=> ");
}

/// A command of 46 days. Otherwise nobody could type ^C.
#[test]
fn half_closed_host_does_not_lock_out_another() {
    let served = Served::new(&TCP, 1);
    for ahead in [0, 70_000] {
        let mut first = served.host();
        // The hand does not read all of a long type-ahead, nor the end of the input behind it.
        first.write_all(format!("WAIT 4000000000\r{}", "x".repeat(ahead)).as_bytes()).expect("written");
        first.shutdown(Shutdown::Write).expect("connected");
        let mut second = served.host();
        assert_eq!(ask(&mut second, "frob"), "frob\r\n\rERR 32\r\n\r=> ");
        let text = read_to(&mut first, "never").expect_err("it is closed");
        assert_eq!(text, "WAIT 4000000000");
    }
}

/// The abort takes some frames on the bus, and its ERR some time on the line.
#[test]
fn lost_hosts_command_answers_nothing_to_the_next() {
    let served = Served::new(&[&TCP[..], &["--pace-baud"]].concat(), 1);
    let mut host = served.host();
    host.write_all(b"X1HI\r").expect("written");
    // Perhaps after the banner, which the first host of a slow line reads.
    read_to(&mut host, "X1HI\r\n\r=> ").expect("a prompt");
    drop(host);
    for _ in 0..5 {
        let mut host = served.host();
        host.write_all(b"X1LOOP\r").expect("written");
        read_to(&mut host, "LOOP").expect("the echo");
        // The * is unread: the connection is reset.
        while host.peek(&mut [0; 8]).expect("an answer") == 0 {}
        drop(host);
        assert_eq!(ask(&mut served.host(), "frob"), "frob\r\n\rERR 32\r\n\r=> ");
    }
}

/// A host that resets the connection after its end of input is lost, and what it had running ends.
#[test]
fn reset_after_the_end_of_input_is_a_lost_host() {
    let served = Served::new(&TCP, 1);
    let mut host = served.host();
    host.write_all(b"frob\rWAIT 4000000000\r").expect("written");
    host.shutdown(Shutdown::Write).expect("connected");
    read_to(&mut host, "fro").expect("the echo");
    // The rest of the answer is unread.
    while host.peek(&mut [0; 8]).expect("an answer") == 0 {}
    drop(host);
    // Otherwise the hand would be busy for 46 days.
    assert_eq!(ask(&mut served.host(), "frob"), "frob\r\n\rERR 32\r\n\r=> ");
}

/// Stack of each thread: so large that the limit on memory below admits a given number of them. A limit on processes
/// (`prlimit --nproc`) has the same effect, but not for root, who runs the tests in some containers.
#[cfg(target_os = "linux")]
const STACK_KIB: usize = 1 << 20;

/// A hand of which the system allows so many threads besides the first.
#[cfg(target_os = "linux")]
fn with_threads(count: usize, args: &[&str]) -> Command {
    let limit = count * STACK_KIB + STACK_KIB / 2;
    let line = format!("ulimit -v {limit}; exec \"$0\" hand \"$@\"");
    let mut command = Command::new("sh");
    command.env("RUST_MIN_STACK", (STACK_KIB * 1024).to_string());
    command.args(["-c", &line, env!("CARGO_BIN_EXE_hil-sim")]).args(args);
    command
}

#[cfg(target_os = "linux")]
#[test]
fn refused_thread_is_reported_and_the_hand_goes_on() {
    let tcp = [&TCP[..], &["--no-discovery"]].concat();
    let pty = [&tcp[..], &["--pty"]].concat();
    for (args, threads, option) in [(&tcp, 0, "--listen"), (&pty, 1, "--pty"), (&pty, 2, "--pty")] {
        let output = with_threads(threads, args).output().expect("it starts");
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{threads}: {error}");
        let words = [option, "a thread cannot be started", "expected: ", "next: "];
        assert!(words.iter().all(|word| error.contains(word)), "{threads}: {error}");
    }
    // One listens; a host needs two more.
    for threads in [1, 2] {
        let served = Served::start(with_threads(threads, &tcp).stderr(Stdio::null()), 1);
        for _ in 0..3 {
            let text = read_to(&mut served.connect("gcl"), "never").expect_err("it is refused");
            assert!(text.starts_with("\r\n\rbusy: a thread cannot be started"), "{text:?}");
        }
    }
    let served = Served::start(with_threads(3, &tcp).stderr(Stdio::null()), 1);
    for _ in 0..3 {
        assert_eq!(ask(&mut served.host(), "frob"), "frob\r\n\rERR 32\r\n\r=> ");
    }
}

/// Whether a hand's first line on standard error is the warning.
fn warns_of_listener(args: &[&str]) -> bool {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    let mut process =
        command.args(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let mut said = String::new();
    let mut out = BufReader::new(process.stdout.take().expect("piped"));
    out.read_line(&mut said).expect("text");
    process.kill().expect("it runs");
    let output = process.wait_with_output().expect("it ends");
    String::from_utf8_lossy(&output.stderr).contains("is beyond loopback")
}

#[test]
fn listener_beyond_loopback_is_announced() {
    for (address, beyond) in [("127.0.0.1:0", false), ("localhost:0", false), ("0.0.0.0:0", true)] {
        for args in [&["hand", "--listen", address][..], &["bus", "--node", "4", "--slcan", address]] {
            assert_eq!(warns_of_listener(args), beyond, "{args:?}");
        }
    }
}

#[test]
fn second_host_is_refused_with_the_address_of_the_first() {
    let served = Served::new(&TCP, 1);
    let mut host = served.host();
    let mut second = served.connect("gcl");
    let mut text = String::new();
    second.read_to_string(&mut text).expect("closed in order");
    let first = host.local_addr().expect("connected");
    assert!(text.starts_with(&format!("\r\n\rbusy: {first} speaks with the hand")), "{text:?}");
    assert_eq!(ask(&mut host, "frob"), "frob\r\n\rERR 32\r\n\r=> ");
}

/// Clients that a hand with a host refuses, and how many of them stay open.
#[cfg(target_os = "linux")]
const REFUSED: usize = 3_300;
#[cfg(target_os = "linux")]
const STAY_OPEN: usize = 400;

/// Files of refused clients: 64 that are refused, 16 events, and one each that waits for the host's place, that the server handles, and that the
/// listener has accepted.
#[cfg(target_os = "linux")]
const REFUSED_FILES: usize = 64 + 16 + 3;

#[cfg(target_os = "linux")]
#[test]
fn refused_clients_cost_no_thread_and_few_files() {
    let served = Served::new(&TCP, 1);
    let mut host = served.host();
    let count =
        |folder: &str| fs::read_dir(format!("/proc/{}/{folder}", served.id())).expect("it runs").count();
    let (threads, files) = (count("task"), count("fd"));
    let (mut most_threads, mut most_files) = (0, 0);
    let mut open = VecDeque::new();
    for number in 0..REFUSED {
        open.push_back(served.connect("gcl"));
        if open.len() > STAY_OPEN {
            open.pop_front();
        }
        if number % 50 == 0 {
            most_threads = most_threads.max(count("task"));
            most_files = most_files.max(count("fd"));
        }
        if number % 300 == 0 {
            assert_eq!(ask(&mut host, "frob"), "frob\r\n\rERR 32\r\n\r=> ", "client {number}");
            let mut second = served.connect("gcl");
            // It may be refused and closed already.
            let _ = second.write_all(b"\r");
            let text = read_to(&mut second, "never").expect_err("it is refused");
            assert!(text.starts_with("\r\n\rbusy: "), "client {number}: {text:?}");
        }
    }
    assert_eq!(most_threads, threads);
    assert!(most_files <= files + REFUSED_FILES, "{most_files} files, {files} before");
}

/// Unread bytes wait in the kernel, not in the hand.
#[test]
fn host_that_never_reads_fills_its_queue_and_blocks_nobody() {
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
fn slcan_monitor_receives_and_cannot_send() {
    let served = Served::new(&[&TCP[..], &["--slcan", "127.0.0.1:0"]].concat(), 2);
    let mut tool = served.connect("slcan");
    tool.write_all(b"C\rS8\rO\rt0040\r").expect("written");
    assert_eq!(read_to(&mut tool, "\r\x07").expect("answers"), "\x07\r\r\x07");
    // GOD polls STAT of node 4 while it wakes, and node 4 answers that it is awake.
    let mut host = served.host();
    ask(&mut host, "SFGET P");
    read_to(&mut tool, "t004105\r").expect("what GOD sends");
    read_to(&mut tool, "t486485000200\r").expect("what the board says");
}

#[cfg(unix)]
#[test]
fn pseudo_terminal_is_a_raw_serial_port_for_one_host_at_a_time() {
    let served = Served::new(&[&TCP[..], &["--pty"]].concat(), 2);
    let open = || File::options().read(true).write(true).open(served.place("pty")).expect("a terminal");
    for _ in 0..2 {
        let mut port = open();
        // Raw mode: only GOD echoes.
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
        // The next round's terminal must become the host.
        drop(served.host());
        let mut port = open();
        while !ask_or_busy(&mut port).ends_with("=> ") {}
    }
}

/// A terminal buffers a few KiB, and the hand some more.
#[cfg(unix)]
#[test]
fn unread_output_of_a_terminal_host_is_discarded() {
    let served = Served::new(&["--pty"], 1);
    let open = || File::options().read(true).write(true).open(served.place("pty")).expect("a terminal");
    for _ in 0..3 {
        let mut deaf = open();
        while !ask_or_busy(&mut deaf).ends_with("=> ") {}
        deaf.write_all(&b"frob\r".repeat(2_000)).expect("written");
        read_to(&mut deaf, "ERR 32").expect("it has begun");
        drop(deaf);
        let mut next = open();
        // ^C, as clients do: it discards what was typed before.
        next.write_all(b"\x03").expect("written");
        let text = read_to(&mut next, "=> ").expect("a prompt");
        assert!(text.len() < 50, "{text:?}");
        assert_eq!(ask(&mut next, "frob"), "frob\r\n\rERR 32\r\n\r=> ");
    }
}

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
fn invalid_state_file_is_refused_and_unchanged() {
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

/// Opening a pipe would wait for ever, and a lock beside a device is a file in /dev.
#[cfg(unix)]
#[test]
fn state_that_is_no_file_is_refused_and_not_locked() {
    let folder = folder("no-state-file");
    let pipe = folder.join("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().expect("mkfifo").success());
    fs::create_dir(folder.join("folder")).expect("ours");
    for path in [&pipe, &folder.join("folder")] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
        let output = command.args(["hand", "--listen", "127.0.0.1:0", "--state"]).arg(path).output();
        let output = output.expect("it starts");
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && error.contains("this is not a file"), "{error}");
    }
    assert_eq!(fs::read_dir(&folder).expect("ours").count(), 2, "no lock is left");
}

/// Nothing can be written while a folder has the name of the temporary file: this fails for root too, who may write in a folder that is
/// read-only, and for no other file of the test.
#[test]
fn save_that_cannot_be_written_is_err_512_until_it_can() {
    let folder = folder("no-room");
    let path = folder.join("hand.state");
    let args =
        ["--listen", "127.0.0.1:0", "--speed", "max", "--state", &path.to_string_lossy()].map(str::to_owned);
    let start = || Served::new(&args.each_ref().map(String::as_str), 1);
    let served = start();
    let mut host = served.host();
    let before = fs::read(&path).expect("it was written at the start");
    fs::create_dir(folder.join("hand.state.part")).expect("its name is free");
    for line in ["PSET LFDPD 1 LFT 0", "FSET DP 1000", "HI"] {
        // What saves nothing is no error.
        assert_eq!(ask(&mut host, line), format!("{line}\r\n\r=> "));
    }
    for line in ["FSAVE", "PSAVE", "MACSET 3", "REC 2", "REC", "SAVE"] {
        assert_eq!(ask(&mut host, line), format!("{line}\r\n\rERR 512\r\n\r=> "));
    }
    assert!(fs::read(&path).expect("it stays") == before);
    fs::remove_dir(folder.join("hand.state.part")).expect("it stays, since it is not the hand's");
    assert_eq!(ask(&mut host, "PSAVE"), "PSAVE\r\n\r=> ");
    drop(served);
    assert_eq!(ask(&mut start().host(), "PGET LFDPD LFT"), "PGET LFDPD LFT\r\n\r1 0\r\n\r=> ");
}

/// `/dev/full` takes the place of the temporary file.
#[cfg(target_os = "linux")]
#[test]
fn write_on_a_full_disk_leaves_no_part() {
    let folder = folder("full-disk");
    let path = folder.join("hand.state");
    let served = Served::new(&["--listen", "127.0.0.1:0", "--state", &path.to_string_lossy()], 1);
    let mut host = served.host();
    let fill = || {
        std::os::unix::fs::symlink("/dev/full", folder.join("hand.state.part")).expect("its name is free");
    };
    // The end of a recording says whether it is stored, as its lines do.
    for line in ["PSAVE", "REC 2", "PGET SN", "REC"] {
        fill();
        let said = ask(&mut host, line);
        assert!(said.ends_with("ERR 512\r\n\r=> "), "{line}: {said:?}");
    }
    let entries = fs::read_dir(&folder).expect("a folder");
    let mut names: Vec<_> = entries.map(|entry| entry.expect("an entry").file_name()).collect();
    names.sort();
    assert_eq!(names, ["hand.state", "hand.state.lock"]);
    assert_eq!(ask(&mut host, "PSAVE"), "PSAVE\r\n\r=> ");
}

const KILLS: u32 = 100;

/// Values saved between a start and a kill.
const SAVES: u32 = 3;

/// A multiple of a hall count's 55, plus a remainder: GOD shows the remainder only while the board's value is
/// unchanged.
fn value(number: u32) -> String {
    (55 * number + 7).to_string()
}

/// The `number` of the [`value`] that all seven motors have.
fn saved(host: &mut TcpStream) -> u32 {
    let said = ask(host, "X1234567FGET DP");
    let answer = said.lines().nth(1).unwrap_or_default().trim();
    let values: Vec<&str> = answer.split_whitespace().collect();
    assert!(values.len() == 7 && values.iter().all(|value| *value == values[0]), "neither: {said:?}");
    let counts: u32 = values[0].parse().expect("a number");
    assert_eq!(counts % 55, 7, "neither: {said:?}");
    counts / 55
}

/// A hand killed at any moment keeps every save whose prompt its host has read.
#[test]
fn killed_hand_keeps_old_or_new_state() {
    let path = folder("killed").join("hand.state").to_string_lossy().into_owned();
    let start = || Served::new(&["--listen", "127.0.0.1:0", "--speed", "max", "--state", &path], 1);
    let save = |number: u32| format!("FSET DP {}\rFSAVE\r", value(number));
    let mut last = 1;
    {
        let served = start();
        let mut host = served.host();
        host.write_all(save(last).as_bytes()).expect("written");
        (0..2).for_each(|_| assert!(read_to(&mut host, "=> ").is_ok()));
    }
    let mut rng = Pcg64Mcg::new(0x9111);
    let mut seen = std::collections::BTreeSet::new();
    for kill in 0..KILLS {
        let served = start();
        let mut host = served.host();
        assert_eq!(saved(&mut host), last, "kill {kill}");
        let lines: Vec<String> = (1..=SAVES).map(|more| save(last + more)).collect();
        let heard = lines.iter().map(|lines| lines.len() + 2 * "\n\r\r=> ".len()).sum::<usize>();
        host.write_all(lines.concat().as_bytes()).expect("written");
        let mut bytes = vec![0; rng.random_range(0..=heard - 2 * (2 * SAVES as usize))];
        host.read_exact(&mut bytes).expect("answers");
        // The kill falls within a later command.
        (0..rng.random_range(0..2000)).for_each(|_| thread::yield_now());
        drop(served);
        let prompts = String::from_utf8_lossy(&bytes).matches("=> ").count() as u32;
        let served = start();
        let found = saved(&mut served.host());
        let may = last + prompts / 2..=last + SAVES;
        assert!(may.contains(&found), "kill {kill}: {found} is not in {may:?}");
        seen.insert(found - last);
        last = found;
    }
    assert!(seen.len() > 2, "kills were at the same moment: {seen:?}");
}

/// What a host at a socket of its own gets in answer to a datagram, which it repeats: one that comes behind others may be lost.
fn asked(socket: &UdpSocket, to: &str, question: &[u8]) -> Vec<u8> {
    let mut answer = [0; 256];
    socket.set_read_timeout(Some(Duration::from_secs(1))).expect("a time-out");
    for _ in 0..HANGS.as_secs() {
        socket.send_to(question, to).expect("sent");
        if let Ok((len, _)) = socket.recv_from(&mut answer) {
            return answer[..len].to_vec();
        }
    }
    panic!("no answer")
}

fn udp() -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a port");
    socket.set_read_timeout(Some(HANGS)).expect("a time-out");
    socket
}

/// Garbage, commands that would configure or reset a device server, and a flood change nothing; answers stay bounded.
#[test]
fn hand_is_discovered_and_obeys_no_datagram() {
    let served = Served::new(&[&TCP[..], &["--discovery", "127.0.0.1:0"]].concat(), 2);
    let (place, socket) = (served.place("discovery"), udp());
    let port: u16 = served.place("gcl").rsplit_once(':').expect("a port").1.parse().expect("a number");
    let record = asked(&socket, place, &[0, 0, 0, 0xF8]);
    assert_eq!((record.len(), &record[..8]), (124, &[0, 0, 0, 0xF9, 127, 0, 0, 1][..]));
    assert_eq!(u16::from_le_bytes([record[24], record[25]]), port);
    let mut rng = Pcg64Mcg::new(30718);
    for length in 0..300 {
        let mut datagram: Vec<u8> = (0..length).map(|_| rng.random()).collect();
        if length >= 4 {
            datagram[..4].copy_from_slice(&[
                0,
                0,
                0,
                *[0x03, 0xFA, 0xFB, 0xFC, 0xFD].get(length % 5).unwrap_or(&3),
            ]);
        }
        socket.send_to(&datagram, place).expect("sent");
    }
    // None of them was answered: the next answer is that of the next question.
    let firmware = asked(&socket, place, &[0, 0, 0, 0xF6]);
    assert_eq!((firmware.len(), &firmware[..4]), (30, &[0, 0, 0, 0xF7][..]));
    let mut host = served.host();
    assert!(ask(&mut host, "VERS").contains("600"));
    // Eight answers a second to one host, and the hand works on.
    (0..2000).for_each(|_| _ = socket.send_to(&[0, 0, 0, 0xF6], place));
    let answers = (0..2000).take_while(|_| socket.recv_from(&mut [0; 64]).is_ok()).count();
    assert!((1..40).contains(&answers), "{answers}");
    assert!(ask(&mut host, "VERS").contains("600"));
}

/// Ports that flood at once.
const FLOODING: usize = 64;

/// Searches during a flood, and the time of each.
const SEARCHES: usize = 10;
const SEARCH: Duration = Duration::from_millis(500);

#[test]
fn flood_from_64_ports_hides_the_hand_from_no_search() {
    let served = Served::new(&[&TCP[..], &["--discovery", "127.0.0.1:0"]].concat(), 2);
    let asked: SocketAddrV4 = served.place("discovery").parse().expect("an address");
    let gcl: SocketAddrV4 = served.place("gcl").parse().expect("an address");
    let (flooding, over) = channel::<()>();
    let flood = thread::spawn(move || {
        let sockets = [(); FLOODING].map(|()| udp());
        let mut sent = 0_u64;
        // 190,000 datagrams a second at most: as many as the machine can send would take the hand's processor away.
        while over.recv_timeout(Duration::from_millis(1)) == Err(RecvTimeoutError::Timeout) {
            for datagram in [&[0, 0, 0, 0xF8][..], &[0, 0, 0, 0xF6], &[0xFF; 100]] {
                sockets.iter().for_each(|socket| sent += u64::from(socket.send_to(datagram, asked).is_ok()));
            }
        }
        sent
    });
    let is_found = |_: &usize| {
        let hands = wraptor::discover(&[asked], SEARCH).expect("it asks");
        hands.iter().any(|hand| hand.address == gcl)
    };
    let found = (0..SEARCHES).filter(is_found).count();
    drop(flooding);
    let sent = flood.join().expect("it ends");
    // UDP may lose a question, and a busy machine the processor.
    assert!(found >= SEARCHES - 1, "{found} of {SEARCHES} searches, {sent} datagrams of a flood");
}

/// A program that starts a hand waits for its address, and would take this one for ready.
#[test]
fn hand_that_cannot_be_discovered_as_wanted_prints_no_address() {
    let taken = udp();
    let place = taken.local_addr().expect("an address").to_string();
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    let output = command.arg("hand").args(TCP).args(["--discovery", &place]).output().expect("it starts");
    assert_eq!((output.status.code(), &*output.stdout), (Some(2), &b""[..]));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--discovery"));
}

/// A broadcast on this machine reaches all its hands. Another program may have the port; then there is nothing to see here.
#[cfg(target_os = "linux")]
#[test]
fn broadcast_finds_every_hand() {
    let served = [(); 2].map(|()| Served::new(&TCP, 1));
    let socket = udp();
    socket.set_broadcast(true).expect("broadcasts");
    let ports: Vec<u16> = served
        .iter()
        .map(|hand| hand.place("gcl").rsplit_once(':').expect("a port").1.parse().expect("a number"))
        .collect();
    let mut found = Vec::new();
    // Other tests have hands as well.
    while !ports.iter().all(|port| found.contains(port)) {
        if found.is_empty() {
            socket.send_to(&[0, 0, 0, 0xF8], "127.255.255.255:30718").expect("sent");
        }
        let mut answer = [0; 256];
        let (len, _) = socket.recv_from(&mut answer).expect("an answer");
        assert_eq!(len, 124);
        found.push(u16::from_le_bytes([answer[24], answer[25]]));
    }
}
