//! A soak: clients of every kind come and go for hours, and the hand's memory, threads and files stay as they were.
//!
//! The hours are simulated: the hand runs at `--speed max` and counts them itself (UPSECS). Its clients run in real time and come
//! as fast as they are served, so that more of them meet an hour than in reality; at least [`PER_HOUR`].

use std::io::Write;
use std::net::Shutdown;
use std::process::{Command, Stdio};
use std::time::Duration;

use super::{ENDS, Served, ask, ask_or_busy, folder, half_closed, read_to};

/// Simulated hours of the sample in the tests; `cargo xtask soak` asks for more.
const SAMPLE_HOURS: f64 = 0.15;

/// Clients in an hour at least: one a minute.
const PER_HOUR: f64 = 60.0;

/// A hand that simulates an hour slower than this hangs.
const HOUR: Duration = Duration::from_secs(600);

/// Share of the rounds that warm up: buffers grow to their bound, the allocator to its pattern.
const WARM: f64 = 0.4;

/// Allowed growth of resident memory, KiB: more than twice of what the allocator's arenas have grown by in the sample of the tests, where not all
/// buffers are warm. In ten hours 17,000 clients lie between the medians: 64 bytes that each of them leaks are found.
const GROWTH_KIB: f64 = 1024.0;

/// Round trips in which the threads and files of clients that have left must be gone. The hand looks at refused clients every
/// 10 ms.
const SETTLES: usize = 10_000;

/// What the system says of the hand's process while one idle host is connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Sample {
    rss_kib: u64,
    threads: usize,
    files: usize,
}

impl Sample {
    fn of(id: u32) -> Self {
        let status = std::fs::read_to_string(format!("/proc/{id}/status")).expect("it runs");
        let rss = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("a line");
        let entries =
            |folder: &str| std::fs::read_dir(format!("/proc/{id}/{folder}")).expect("it runs").count();
        Self {
            rss_kib: rss.trim().trim_end_matches(" kB").parse().expect("a number"),
            threads: entries("task"),
            files: entries("fd"),
        }
    }
}

/// Checks samples of rounds against the one before them; returns the growth of memory, KiB.
fn judge(first: &Sample, samples: &[Sample]) -> Result<f64, String> {
    let warm = (samples.len() as f64 * WARM) as usize;
    let late = &samples[warm..];
    let is_same = |now: &Sample| (now.threads, now.files) == (first.threads, first.files);
    if let Some(at) = samples.iter().position(|now| !is_same(now)) {
        return Err(format!("round {at}: {:?}, but {first:?} at the start", samples[at]));
    }
    // Medians of the first and the last fifth: a single sample may fall into a burst.
    let fifth = (late.len() / 5).max(1);
    let median = |part: &[Sample]| {
        let mut rss: Vec<u64> = part.iter().map(|sample| sample.rss_kib).collect();
        rss.sort_unstable();
        rss[rss.len() / 2] as f64
    };
    let grown_kib = median(&late[late.len() - fifth..]) - median(&late[..fifth]);
    if grown_kib > GROWTH_KIB {
        return Err(format!("memory grew by {grown_kib} KiB, allowed are {GROWTH_KIB}"));
    }
    Ok(grown_kib)
}

/// A client; the number is that of its round.
type Client = (&'static str, fn(&Served, usize));

const CLIENTS: [Client; 14] = [
    ("asks and leaves", |served, _| {
        let mut host = served.host();
        for line in ["frob", "FGET P", "FLISTV", "PLISTV", "? HI"] {
            ask(&mut host, line);
        }
    }),
    ("leaves in mid-line", |served, _| {
        served.host().write_all(b"half a line").expect("written");
    }),
    ("closes its side", |served, _| {
        let text = half_closed(served.host(), "X1FGET P\rfrob\rhalf a line");
        assert!(text.ends_with("half a line"), "{text:?}");
    }),
    ("closes its side and is followed by another", |served, _| {
        let mut first = served.host();
        first.write_all(b"WAIT 4000000000\r").expect("written");
        first.shutdown(Shutdown::Write).expect("connected");
        ask(&mut served.host(), "frob");
    }),
    ("resets the connection", |served, _| {
        let mut host = served.host();
        host.write_all(b"FLISTV\r").expect("written");
        while host.peek(&mut [0; 8]).expect("an answer") == 0 {}
    }),
    ("never speaks, and another is refused", |served, _| {
        // The prompt shows that it is the host.
        let idle = served.host();
        let text = read_to(&mut served.connect("gcl"), "never").expect_err("it is refused");
        assert!(text.contains("busy: "), "{text:?}");
        drop(idle);
    }),
    ("never reads", |served, _| {
        let mut deaf = served.host();
        deaf.set_nonblocking(true).expect("a socket");
        while deaf.write(&b"FLISTV\r".repeat(1_000)).is_ok() {}
    }),
    ("moves, and aborts", |served, _| {
        let mut host = served.host();
        ask(&mut host, "HI");
        ask(&mut host, "GC");
        host.write_all(b"O\r").expect("written");
        read_to(&mut host, "O").expect("the echo");
        host.write_all(b"\x03").expect("written");
        read_to(&mut host, "=> ").expect("a prompt");
    }),
    ("saves", |served, round| {
        let mut host = served.host();
        for line in [&format!("1FSET DP {}", 55 * (round % 300)), "FSAVE", "PSAVE"] {
            let said = ask(&mut host, line);
            assert!(!said.contains("ERR"), "{said:?}");
        }
    }),
    ("controls in RealTime", |served, _| {
        let mut host = served.host();
        host.write_all(b"X1234567LOOP\r").expect("written");
        read_to(&mut host, "*").expect("it has begun");
        for round in 0_u8..20 {
            let velocity = if round < 10 { 20 } else { 236 };
            host.write_all(&[&b"c"[..], &[velocity, 32].repeat(7)].concat()).expect("written");
            read_to(&mut host, "*").expect("an answer");
        }
        host.write_all(b"\x03").expect("written");
        read_to(&mut host, "=> ").expect("a prompt");
    }),
    ("leaves RealTime in mid-block", |served, _| {
        let mut host = served.host();
        host.write_all(b"X1234567LOOP\rC\x14\x20\x14").expect("written");
        read_to(&mut host, "*").expect("it has begun");
    }),
    ("walks through in packets", |served, _| {
        let mut host = served.host();
        for line in ["WAKE", "0 S REPLY 1", "4 S E 20", "4 S M 5"] {
            ask(&mut host, line);
        }
    }),
    ("watches the bus", |served, _| {
        // The fifth is refused.
        let mut tools: Vec<_> = (0..5).map(|_| served.connect("slcan")).collect();
        for (at, tool) in tools.iter_mut().enumerate() {
            let _ = tool.write_all(b"S8\rZ1\rO\r");
            let text = read_to(tool, "\r");
            assert!(at == 4 || text == Ok("\r".to_owned()), "{at}: {text:?}");
        }
        ask(&mut served.host(), "FGET P");
        read_to(&mut tools[0], "t00").expect("what GOD sends");
        // One says so, the others just go, with frames unread.
        tools[0].write_all(b"C\r").expect("written");
    }),
    ("uses the terminal", |served, _| {
        let path = served.place("pty");
        let mut port = std::fs::File::options().read(true).write(true).open(path).expect("a terminal");
        while !ask_or_busy(&mut port).ends_with("=> ") {}
        ask(&mut port, "FGET P");
    }),
];

/// The hand's own count of the seconds that it has been on.
fn upsecs(served: &Served) -> (f64, Sample) {
    let mut host = served.host();
    let said = ask(&mut host, "PGET UPSECS");
    let seconds = said.split_whitespace().nth(2).and_then(|word| word.parse().ok());
    (seconds.unwrap_or_else(|| panic!("{said:?}")), Sample::of(served.id()))
}

/// A sample with the threads and files of `first`, as soon as those of clients that have left are gone; else the last one.
fn settled(served: &Served, first: Option<&Sample>) -> Sample {
    let mut host = served.host();
    let mut sample = Sample::of(served.id());
    for _ in 0..SETTLES {
        if first.is_some_and(|first| (first.threads, first.files) == (sample.threads, sample.files)) {
            break;
        }
        ask(&mut host, "");
        sample = Sample::of(served.id());
    }
    sample
}

#[test]
fn clients_that_come_and_go_for_hours_leave_nothing_behind() {
    let effort = std::env::var("EFFORT").ok();
    let effort: f64 = effort.map_or(1.0, |effort| effort.parse().expect("EFFORT: a number, such as 10"));
    let hours = SAMPLE_HOURS * effort;
    let state = folder("soak").join("hand.state").to_string_lossy().into_owned();
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    command.args(["hand", "--listen", "127.0.0.1:0", "--pty", "--slcan", "127.0.0.1:0"]);
    command.args(["--speed", "max", "--state", &state]).stderr(Stdio::null());
    let served = Served::start_for(&mut command, 3, ENDS + HOUR.mul_f64(hours));
    let first = settled(&served, None);
    let (begin_s, _) = upsecs(&served);
    let (mut samples, mut passed_h, mut shown_h) = (Vec::new(), 0.0, 0.0);
    while passed_h < hours || ((samples.len() * CLIENTS.len()) as f64) < PER_HOUR * hours {
        for (_, client) in CLIENTS {
            client(&served, samples.len());
        }
        let sample = settled(&served, Some(&first));
        samples.push(sample);
        let (now_s, _) = upsecs(&served);
        passed_h = (now_s - begin_s) / 3600.0;
        if passed_h >= shown_h {
            println!("soak: {passed_h:.2} h, {} clients, {sample:?}", samples.len() * CLIENTS.len());
            shown_h += hours / 10.0;
        }
    }
    let grown_kib = judge(&first, &samples).unwrap_or_else(|found| panic!("{found}"));
    let Sample { rss_kib, threads, files } = samples[samples.len() - 1];
    println!(
        "figure: soak: {passed_h:.2} simulated hours, {} clients of {} kinds: {rss_kib} KiB, {grown_kib:+} since the warm-up; \
         {threads} threads and {files} files, as at the start",
        samples.len() * CLIENTS.len(),
        CLIENTS.len()
    );
}

#[test]
fn leaks_are_found() {
    let flat = Sample { rss_kib: 10_000, threads: 6, files: 12 };
    let with = |change: fn(u64, &mut Sample)| {
        let mut samples = vec![flat; 2_500];
        for (round, sample) in (0..).zip(&mut samples) {
            change(round, sample);
        }
        judge(&flat, &samples)
    };
    assert_eq!(with(|_, _| {}), Ok(0.0));
    // Warm-up, and a burst.
    assert_eq!(with(|round, sample| sample.rss_kib += if round < 500 { round } else { 500 }), Ok(0.0));
    assert_eq!(with(|round, sample| sample.rss_kib += 4_000 * u64::from(round == 2_490)), Ok(0.0));
    // 64 bytes of each client; a thread; a socket.
    let leak = with(|round, sample| sample.rss_kib += round * 14 * 64 / 1024).expect_err("a leak");
    assert!(leak.contains("memory grew"), "{leak}");
    for change in [
        |round: u64, sample: &mut Sample| sample.threads += usize::from(round >= 1_500),
        |round: u64, sample: &mut Sample| sample.files += usize::from(round >= 1_500),
    ] {
        let leak = with(change).expect_err("a leak");
        assert!(leak.starts_with("round 1500:"), "{leak}");
    }
}
