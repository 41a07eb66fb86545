//! `hil-sim bus` with a CAN tool over SLCAN and TCP.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::served::{Served, serve, start};

/// Simultaneous clients, more than a server with [`FILES`] can have.
#[cfg(unix)]
const CROWD: usize = 20;

/// Files that a server may open: its own three, the listener, two for the host, and two to spare.
#[cfg(unix)]
const FILES: usize = 8;

/// More questions than a board needs to wake; each takes a round trip.
const QUESTIONS: usize = 200_000;

const HANGS: Duration = Duration::from_secs(30);

fn connect(served: &Served) -> TcpStream {
    let stream = TcpStream::connect(&served.address).expect("connected");
    stream.set_read_timeout(Some(HANGS)).expect("a time-out");
    stream
}

fn read_to(stream: &mut TcpStream, end: &str) -> String {
    let mut text = String::new();
    let mut byte = [0];
    while !text.ends_with(end) {
        let len = stream.read(&mut byte).unwrap_or_else(|error| panic!("{error} after {text:?}"));
        assert_eq!(len, 1, "hung up after {text:?}");
        text.push(char::from(byte[0]));
    }
    text
}

/// Repeats GET STAT of node 4 until it answers; it needs a moment after power-up.
fn ask(stream: &mut TcpStream) {
    loop {
        stream.write_all(b"t004105\rV\r").expect("written");
        read_to(stream, "V0100\r");
        // Any round trip gives the board time to answer.
        stream.write_all(b"V\r").expect("written");
        if read_to(stream, "V0100\r").contains("t486485000") {
            return;
        }
    }
}

#[test]
fn tool_gets_answers_and_garbage_does_no_harm() {
    let served = serve("4");
    let mut stream = connect(&served);
    stream.write_all(b"C\rS8\rO\r").expect("written");
    assert_eq!(read_to(&mut stream, "\x07\r\r"), "\x07\r\r");
    ask(&mut stream);
    stream.write_all(&[0xFF; 100_000]).expect("written");
    stream.write_all(b"\rt0040").expect("written");
    assert!(read_to(&mut stream, "\x07").ends_with('\x07'));
    stream.write_all(b"\r").expect("written");
    read_to(&mut stream, "z\r");
    ask(&mut stream);
}

#[test]
fn second_host_is_refused_until_the_first_has_left() {
    let served = serve("4");
    let mut first = connect(&served);
    first.write_all(b"O\r").expect("written");
    read_to(&mut first, "\r");
    let mut second = connect(&served);
    second.write_all(b"C\rS8\r\rO\r").expect("written");
    let mut text = String::new();
    second.read_to_string(&mut text).expect("closed in order");
    assert!(text.starts_with("error: two hosts") && text.contains("node 0"), "{text}");
    let address = first.local_addr().expect("connected").to_string();
    assert!(text.contains(&address), "says who is there: {text}");
    ask(&mut first);
    drop(first);
    // The server notices it with a delay.
    let mut third = loop {
        let mut next = connect(&served);
        next.write_all(b"O\r").expect("written");
        let mut byte = [0];
        if next.read(&mut byte).is_ok_and(|len| len == 1) && byte[0] == b'\r' {
            break next;
        }
    };
    ask(&mut third);
}

/// The end of one connection and the start of the next reach the server by two threads. Bytes that were sent before the end are still read.
#[cfg(target_os = "linux")]
#[test]
fn immediate_reconnect_is_never_refused() {
    const RECONNECTS: usize = 200;
    let served = serve("4");
    ask(&mut { opened(&served) });
    for round in 0..RECONNECTS {
        let mut stream = opened(&served);
        match round % 3 {
            0 => {}
            // What was sent last counts: nothing of it is read when the connection ends.
            1 => stream.write_all(&b"t0040\rV\r".repeat(500)).expect("written"),
            _ => ask(&mut stream),
        }
    }
    // SET STAT 2, just before the end, has been carried out: the board wakes.
    let mut stream = opened(&served);
    stream.write_all(b"t004485000200\r").expect("written");
    drop(stream);
    let mut stream = opened(&served);
    until(&mut stream, b"t004105\rV\r", "t486485000200\r").expect("the board is awake");
}

/// Connects and opens the channel at once.
fn opened(served: &Served) -> TcpStream {
    let mut stream = connect(served);
    stream.write_all(b"O\r").expect("written");
    let mut byte = [0];
    stream.read_exact(&mut byte).expect("an answer");
    if byte != *b"\r" {
        let mut text = String::new();
        let _ = stream.read_to_string(&mut text);
        panic!("the channel is not open: {}{text}", byte[0].escape_ascii());
    }
    stream
}

#[test]
fn unusable_arguments_name_a_next_step_and_exit_with_2() {
    let served = serve("4");
    for (args, said) in [
        (&["--node", "8", "--slcan", "127.0.0.1:0"][..], "--node 8"),
        (&["--nodes", "5-1", "--slcan", "127.0.0.1:0"], "1-7 or 11,12,13,14"),
        (&["--node", "4"], "--slcan 127.0.0.1:0"),
        (&["--node", "4", "--slcan", "127.0.0.1:0", "--can", "vcan0"], "node 0"),
        (&["--node", "4", "--slcan", &served.address], &served.address),
        (&["--node", "4", "--slcan", "nowhere"], "--slcan nowhere"),
        (&["--node", "4", "--can", "nocan9"], "ip link add dev nocan9 type vcan"),
        (&["--slcan", "127.0.0.1:0"], "add --node 4 or --nodes 1-7\n"),
        (&[], "add --node 4 or --nodes 1-7, and --slcan 127.0.0.1:0 or --can vcan0\n"),
    ] {
        let output =
            Command::new(env!("CARGO_BIN_EXE_hil-sim")).arg("bus").args(args).output().expect("it starts");
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{args:?}: {error}");
        assert!(error.contains(said), "{args:?}: {error}");
    }
}

/// Without free descriptors, accept fails immediately and repeatedly until a client leaves.
#[cfg(unix)]
#[test]
fn exhausted_descriptors_are_reported_once_and_recover() {
    let line = format!("ulimit -n {FILES}; exec \"$0\" bus --node 4 --slcan 127.0.0.1:0");
    let mut shell = Command::new("sh");
    shell.args(["-c", &line, env!("CARGO_BIN_EXE_hil-sim")]);
    let mut served = start(shell.stderr(Stdio::piped()));
    let mut said = BufReader::new(served.process.stderr.take().expect("piped")).lines();
    let mut next = || said.next().expect("it runs").expect("text");
    let mut host = connect(&served);
    assert!(next().ends_with("is the host"));
    let crowd: Vec<TcpStream> = (0..CROWD).map(|_| connect(&served)).collect();
    let warning = loop {
        let line = next();
        if !line.starts_with("two hosts") {
            break line;
        }
    };
    assert!(warning.starts_with("warning: a client cannot be accepted"), "{warning}");
    drop(crowd);
    // Accepted after the crowd.
    let mut late = connect(&served);
    let mut text = String::new();
    late.read_to_string(&mut text).expect("closed in order");
    assert!(text.starts_with("error: two hosts"), "{text}");
    host.write_all(b"O\r").expect("written");
    ask(&mut host);
    drop(served);
    let more: Vec<String> = said.map_while(Result::ok).filter(|line| line.starts_with("warning")).collect();
    assert_eq!(more, [""; 0], "told once");
}

/// A bus whose plants can be asked, and the address for that.
fn serve_truth(nodes: &str, units: &str) -> (Served, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hil-sim"));
    command.args([
        "bus",
        "--nodes",
        nodes,
        "--slcan",
        "127.0.0.1:0",
        "--truth",
        "127.0.0.1:0",
        "--host-units",
        units,
    ]);
    let mut process =
        command.stderr(Stdio::null()).stdout(Stdio::piped()).spawn().expect("the binary starts");
    let mut lines = BufReader::new(process.stdout.take().expect("piped")).lines();
    let mut next = |word: &str| {
        let line = lines.next().expect("a line").expect("text");
        line.strip_prefix(word).unwrap_or_else(|| panic!("{word}: {line}")).trim().to_owned()
    };
    let (address, truth) = (next("slcan "), next("truth "));
    (Served { process, address }, truth)
}

fn ask_truth(stream: &mut TcpStream) -> serde_json::Value {
    stream.write_all(b"\n").expect("written");
    serde_json::from_str(&read_to(stream, "\n")).expect("one object a line")
}

fn asker(address: &str) -> TcpStream {
    let stream = TcpStream::connect(address).expect("connected");
    stream.set_read_timeout(Some(HANGS)).expect("a time-out");
    stream
}

/// Repeats a request, which ends in V, until the answer has come.
fn until(host: &mut TcpStream, request: &[u8], answer: &str) -> Option<usize> {
    (0..QUESTIONS).find(|_| {
        host.write_all(request).expect("written");
        read_to(host, "V0100\r").contains(answer)
    })
}

/// The angle of a finger's joint between two hall counts: 18 a revolution, 49 revolutions.
const COUNT_RAD: f64 = std::f64::consts::TAU / (18.0 * 49.0);

/// A host that asks for 1 rad of a finger's joint in the units of a BH8-280, and a test that sees where the joint goes.
#[test]
fn truth_shows_the_radian_that_a_host_of_the_bh8_280_asks_for() {
    let (served, truth) = serve_truth("11,14", "280");
    let mut truth = asker(&truth);
    let mut host = opened(&served);
    // SET STAT 2 until it is 2; HI until MODE is 4, then 0.
    until(&mut host, b"t00B485000200\rt00B105\rV\r", "t566485000200").expect("awake");
    until(&mut host, b"t00B49D000D00\rt00B108\rV\r", "t566488000400").expect("HI");
    until(&mut host, b"t00B108\rV\r", "t566488000000").expect("HI has ended");
    // HI presses the stop, whose gear gives way by a count or two: its zero is that far from the drawing's.
    let zero_rad = ask_truth(&mut truth)["motors"][0]["position_rad"].as_f64().expect("a number");
    assert!(zero_rad.abs() <= 3.0 * COUNT_RAD, "{zero_rad}");
    // E 81,487, MODE 5, until MODE is 5, then 0: an answer of HI's last question may still be under way.
    host.write_all(b"t00B6B4004F3E0100\rt00B488000500\rV\r").expect("written");
    read_to(&mut host, "V0100\r");
    until(&mut host, b"t00B108\rV\r", "t566488000500").expect("moves");
    until(&mut host, b"t00B108\rV\r", "t566488000000").expect("arrived");
    let answer = ask_truth(&mut truth);
    let motors = answer["motors"].as_array().expect("a list");
    assert_eq!(motors.len(), 2, "{answer}");
    assert_eq!((&motors[0]["node"], &motors[0]["motor"]), (&11.into(), &"link".into()), "{answer}");
    assert_eq!((&motors[1]["node"], &motors[1]["motor"]), (&14.into(), &"spread".into()), "{answer}");
    let number =
        |motor: usize, key: &str| motors[motor][key].as_f64().unwrap_or_else(|| panic!("{key}: {answer}"));
    // Half a count that the goal is rounded by, and half a count at each end, within which the rotor may stand.
    let moved_rad = number(0, "position_rad") - zero_rad;
    assert!((moved_rad - 1.0).abs() <= 1.5 * COUNT_RAD, "{moved_rad}: {answer}");
    assert!((number(0, "position_counts") / 140.374 - number(0, "position_rad")).abs() < 1e-4, "{answer}");
    for key in
        ["velocity_counts_per_s", "velocity_rad_per_s", "torque_n_m", "joint_torque_n_m", "contact_n_m"]
    {
        assert!(number(0, key).abs() < 1e-3, "{key} at rest: {answer}");
    }
    assert_eq!(
        (&motors[0]["contact"], &motors[1]["brake_engaged"]),
        (&false.into(), &true.into()),
        "{answer}"
    );
    assert!(answer["t_us"].as_u64().is_some_and(|us| us > 0), "{answer}");
    // The other motor stands at its start.
    assert!(number(1, "position_counts").abs() < 1.0, "{answer}");
}

/// V closes a finger into its stop: on the way the truth has a velocity, and at the stop a torque and a contact.
#[test]
fn truth_shows_motion_and_contact() {
    let (served, truth) = serve_truth("11", "0");
    let mut truth = asker(&truth);
    let mut host = opened(&served);
    until(&mut host, b"t00B485000200\rt00B105\rV\r", "t566485000200").expect("awake");
    // MT 200, MODE 4, V 300.
    host.write_all(b"t00B4AB00C800\rt00B488000400\rt00B4AC002C01\r").expect("written");
    let mut moved = false;
    let pressed = (0..QUESTIONS).find_map(|_| {
        // Each question is a frame of the host that HOSTMS waits for.
        host.write_all(b"t00B108\rV\r").expect("written");
        read_to(&mut host, "V0100\r");
        let motor = ask_truth(&mut truth)["motors"][0].clone();
        let number = |key: &str| motor[key].as_f64().expect("a number");
        moved |= number("velocity_counts_per_s") > 200.0 && number("velocity_rad_per_s") > 1.0;
        (motor["contact"] == true && number("velocity_counts_per_s").abs() < 1.0).then_some(motor)
    });
    let motor = pressed.expect("a contact");
    assert!(moved, "{motor}");
    // MT 200 of 1575 units a N·m; the stop pushes back.
    assert!(motor["torque_n_m"].as_f64().is_some_and(|n_m| n_m > 0.1), "{motor}");
    assert!(motor["contact_n_m"].as_f64().is_some_and(|n_m| n_m < -0.01), "{motor}");
}

#[test]
fn truth_answers_every_line_once_and_nothing_else() {
    let (_served, truth) = serve_truth("4", "0");
    let mut stream = asker(&truth);
    // Line ends of every kind, words, and bytes without sense: five lines.
    stream.write_all(b"\n\r\nwhat?\r\xFF\x00\x03\n{}\n").expect("written");
    for _ in 0..5 {
        let line: serde_json::Value = serde_json::from_str(&read_to(&mut stream, "\n")).expect("JSON");
        assert_eq!(line["motors"].as_array().map(Vec::len), Some(1), "{line}");
    }
    // What comes before the end of the input is answered; then the connection ends.
    stream.write_all(b"half\n\n").expect("written");
    stream.shutdown(std::net::Shutdown::Write).expect("connected");
    let mut rest = String::new();
    stream.read_to_string(&mut rest).expect("closed in order");
    assert_eq!(rest.lines().count(), 2, "{rest}");
}

/// A client that asks and never reads keeps neither the host nor another client waiting.
#[test]
fn truth_client_that_never_reads_blocks_nobody() {
    let (served, truth) = serve_truth("1-7", "0");
    let mut flood = asker(&truth);
    flood.set_nonblocking(true).expect("a socket");
    let lines = [b'\n'; 1 << 16];
    // Until the sockets are full.
    while flood.write(&lines).is_ok() {}
    let mut other = asker(&truth);
    assert_eq!(ask_truth(&mut other)["motors"].as_array().map(Vec::len), Some(7));
    let mut host = connect(&served);
    host.write_all(b"O\r").expect("written");
    read_to(&mut host, "\r");
    ask(&mut host);
    // Four may ask; the flood is one of them.
    let more: Vec<TcpStream> = (0..2).map(|_| asker(&truth)).collect();
    let mut refused = asker(&truth);
    let mut text = String::new();
    refused.read_to_string(&mut text).expect("closed in order");
    assert!(text.starts_with("{\"error\":"), "{text}");
    drop((flood, more));
    assert_eq!(ask_truth(&mut other)["motors"].as_array().map(Vec::len), Some(7));
}

#[test]
fn host_units_takes_0_and_280() {
    for units in ["1", "262", "281", "-1", "x"] {
        let option = format!("--host-units={units}");
        let output = Command::new(env!("CARGO_BIN_EXE_hil-sim"))
            .args(["bus", "--node", "4", "--slcan", "127.0.0.1:0", &option])
            .output()
            .expect("the binary runs");
        assert_eq!(output.status.code(), Some(2), "{units}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("host-units"), "{units}");
    }
}
