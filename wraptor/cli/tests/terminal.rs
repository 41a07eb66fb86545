//! The terminal program against simulated hands: the walk-through, scripts and their exit codes, and its end in the middle of a motion.

#[path = "../../tests/served/mod.rs"]
mod served;

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use served::{HANGS, Served};

fn wraptor() -> Command {
    Command::new(env!("CARGO_BIN_EXE_wraptor"))
}

/// Runs entries. Returns exit code, standard output and standard error.
fn enter(args: &[&str], entries: &str) -> (Option<i32>, String, String) {
    let mut command = wraptor();
    command.args(args).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut process = command.spawn().expect("it starts");
    // It may exit before it reads.
    let _ = process.stdin.take().expect("piped").write_all(entries.as_bytes());
    let Output { status, stdout, stderr } = process.wait_with_output().expect("it ends");
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("text");
    (status.code(), text(stdout), text(stderr))
}

fn folder(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

/// Steps of the walk-through (manual 3; there is no step 9), entries as printed there, and the positions after them, hall counts. Tips follow
/// their links: 27 and 88 for 100 and 331; 331 is CT's default.
const STEPS: &[(u8, &[&str], [i32; 7])] = &[
    (7, &["WAKE"], [0; 7]),
    (8, &["123 G TEMP"], [0; 7]),
    (10, &["M", "123", "100"], [100, 100, 100, 0, 27, 27, 27]),
    (11, &["4 S E 82", "4 S M 5"], [100, 100, 100, 82, 27, 27, 27]),
    (12, &["C", "1"], [331, 100, 100, 82, 88, 27, 27]),
    (13, &["O", "1"], [0, 100, 100, 82, 0, 27, 27]),
    (14, &["4 S E 164", "4 S M 5"], [0, 100, 100, 164, 0, 27, 27]),
    (15, &["C", "123"], [331, 331, 331, 164, 88, 88, 88]),
    (16, &["123 G TEMP"], [331, 331, 331, 164, 88, 88, 88]),
    (17, &["SAVE"], [331, 331, 331, 164, 88, 88, 88]),
];

/// How far a motor may stand from its goal, hall counts: the play of its gear, and that of its halls.
const NEAR: i32 = 3;

/// The walk-through with the positions after each step.
fn walk(address: &str) {
    let ask = "1234567 G P";
    let steps = STEPS.iter().flat_map(|(_, entries, _)| entries.iter().chain([&ask]));
    let entries: String = steps.map(|entry| format!("{entry}\n")).collect();
    // Step 6 launches the manual's program.
    let (code, screen, error) = enter(&["--walk", "--connect", address], &entries);
    assert_eq!((code, &*error), (Some(0), ""), "{screen}");
    // After each question the seven lines `1 P=0`, unless a report is between them.
    let answers: Vec<&str> = screen.split("=> 1234567 G P\n").skip(1).collect();
    assert_eq!(answers.len(), STEPS.len(), "{screen}");
    for ((step, _, places), answer) in STEPS.iter().zip(answers) {
        for (node, place) in (1..).zip(places) {
            let line = format!("{node} P=");
            let found = answer.lines().find_map(|found| found.strip_prefix(&line)?.parse::<i32>().ok());
            let found = found.unwrap_or_else(|| panic!("step {step}: {line} in {answer}"));
            assert!((found - place).abs() <= NEAR, "step {step}: {line}{found}, expected {place}");
        }
    }
}

/// Steps 7 to 17, then the power off and on (18).
#[test]
fn walk_through_runs_as_printed() {
    let state = folder("walk").join("hand.state");
    let state = state.to_str().expect("text");
    let hand = || Served::new(&["hand", "--listen", "127.0.0.1:0", "--speed", "max", "--state", state], 1);
    let served = hand();
    let (code, screen, error) = enter(&["--connect", served.place("gcl")], "WAKE\nHI\nSAVE\n");
    assert_eq!((code, &*error), (Some(0), ""), "{screen}");
    drop(served);
    let served = hand();
    walk(served.place("gcl"));
    drop(served);
    // Trusted positions: it moves without HI.
    let served = hand();
    let (code, screen, error) = enter(&["--connect", served.place("gcl")], "WAKE\nX1234567FGET S\nHOME\n");
    assert_eq!((code, &*error), (Some(0), ""), "{screen}");
    assert!(screen.contains("=> X1234567FGET S\n0 0 0 0 0 0 0\n"), "{screen}");
}

/// Without HI it moves, and does not trust the positions that it saves.
#[test]
fn walk_through_without_homing_leaves_positions_untrusted() {
    let state = folder("unhomed").join("hand.state");
    let state = state.to_str().expect("text");
    let hand = || Served::new(&["hand", "--listen", "127.0.0.1:0", "--speed", "max", "--state", state], 1);
    let served = hand();
    walk(served.place("gcl"));
    drop(served);
    let served = hand();
    let (code, screen, error) = enter(&["--connect", served.place("gcl")], "WAKE\nX1234567FGET S\nHOME\n");
    assert!(code == Some(1) && error.contains("HOME: ERR 4"), "{screen}{error}");
    assert!(screen.contains("=> X1234567FGET S\n4 4 4 4 4 4 4\n"), "{screen}");
}

/// Bare C, O and M are the hand's own (manual 5) unless the walk-through asks for them, and a board that sleeps is told from one that is gone.
#[test]
fn commands_of_section_5_are_typed_alone() {
    let served = Served::fast_hand();
    let address = served.place("gcl");
    let (code, screen, error) = enter(&["--connect", address], "123 G TEMP\n");
    assert!(code == Some(1) && error.contains("boards 1234567 are asleep\n  next: WAKE"), "{screen}{error}");
    let entries = "WAKE\nHI\nC\nFGET P\nO\nM\nM 0\nwalk\nO\n1\nwalk off\nO\n";
    let (code, screen, error) = enter(&["--connect", address], entries);
    assert_eq!((code, &*error), (Some(0), ""), "{screen}");
    let closed =
        screen.split_once("=> FGET P\n").and_then(|(_, rest)| rest.lines().next()).expect("an answer");
    let counts: Vec<i32> = closed.split_whitespace().map(|count| count.parse().expect("a number")).collect();
    // CT is 18200, the spread's stop 9130.
    assert!(
        counts.len() == 4 && counts[..3].iter().all(|count| *count > 17_000) && counts[3] > 8000,
        "{closed}"
    );
    assert_eq!(screen.matches("Motors: ").count(), 1, "{screen}");
}

/// RealTime by hand in a script, and the three ways to a hand.
#[test]
fn loop_runs_by_hand_and_can_needs_no_god() {
    let served = Served::fast_hand();
    let entries = "WAKE\nHI\nloop 12 40 for 0.5\nX4LOOP 8 for 0.2\nVERS\n";
    let (code, screen, error) = enter(&["--connect", served.place("gcl")], entries);
    assert_eq!((code, &*error), (Some(0), ""), "{screen}");
    for words in [">1 [", ">2 [", ">4 [", "40 counts/s", "8 counts/s", "position", "strain", "=> VERS\n600\n"]
    {
        assert!(screen.contains(words), "{words}: {screen}");
    }
    let (code, _, error) = enter(&["--connect", served.place("gcl")], "loop 12 1 2 3 for 1\n");
    assert!(
        code == Some(2) && error.contains("found 3 velocities, expected one, or one for each of 2"),
        "{error}"
    );
    let boards = Served::new(&["bus", "--nodes", "1-7", "--slcan", "127.0.0.1:0"], 1);
    let place = boards.place("slcan");
    let (code, screen, error) = enter(&["--can", place], "WAKE\n4 G STAT\n4 S MODE 0\nPGET TEMP\n");
    assert_eq!((code, &*error), (Some(0), ""), "{screen}");
    assert!(screen.contains("=> 4 G STAT\n4 STAT=2\n"), "{screen}");
}

#[test]
fn script_ends_at_its_first_trouble_and_says_where() {
    let served = Served::fast_hand();
    let address = served.place("gcl");
    for (entries, code, words) in [
        ("WAKE\n# a comment\n\nVERS\nquit\nFROB\n", 0, &["=> VERS\n600\n"][..]),
        ("FROB\nVERS\n", 1, &["FROB: ERR 32", "next: "]),
        ("1C\n", 1, &["1C: ERR 4", "call init"]),
        ("walk\nM\n12x\n100\n", 2, &["standard input:3: motors: found \"12x\"", "such as 123", "next: "]),
        ("walk\nM\n123\nfar\n", 2, &["standard input:4: position: found \"far\"", "next: "]),
        ("walk\nM\n123\n", 2, &["standard input:4: found the end", "Position"]),
        ("123\n", 2, &["found \"123\"", "walk"]),
        ("1LOOP\n", 2, &["standard input:1: loop: in a script expected velocities"]),
        ("LOOP\n", 2, &["expected motors, such as loop 1234"]),
        ("\u{e9}\n", 2, &["printable ASCII"]),
        ("help frob\n", 2, &["help: found \"frob\""]),
        ("4 S MT 5000\n", 1, &["ERR 128", "MT: found \"5000\", expected 0 to 990", "next: "]),
        ("1FSET MCV 1\n", 1, &["ERR 128", "MCV: found \"1\", expected 16 to 4080"]),
        ("WAKE\n4\tG\tSTATUS\n4 G MT\n", 0, &["4 STAT=2 (STATUS)\n", "4 MT=750\n"]),
        (
            "help WAKE\nhelp save\nhelp ap\n",
            0,
            &["WAKE: wakes the boards", "SAVE: stops the motors", "position"],
        ),
        ("help FSET\nhelp kp\n", 0, &["FSET <name> <value>", "KP: position gain (property"]),
        ("watch 14 STAT\n", 0, &["node            1       4\nSTAT            2       2"]),
        ("watch 14 STAT for 0\n", 0, &["STAT"]),
        (
            "WAKE\n0 S REPLY 1\n4 G VERS\n0 S REPLY 0\n4 G VERS\n",
            0,
            &["4 VERS=600 (packet)\n", "4 VERS=600\n"],
        ),
        // They begin no move: a reset ends in the monitor, and mode 4 goes on.
        ("WAKE\n1 S CMD 2\nWAKE\n4 S MODE 4\n4 G MODE\n4 S MODE 0\n", 0, &["=> 4 G MODE\n4 MODE=4\n"]),
        ("watch 8 P\n", 2, &["watch: found \"8\"", "1 to 7"]),
        ("download nowhere.tek 1\n", 2, &["nowhere.tek: cannot be read"]),
        ("disconnect\nVERS\n", 2, &["standard input:2: found no connection", "connect HOST:PORT"]),
        ("connect 127.0.0.1:1\n", 2, &["nothing listens there"]),
    ] {
        let (found, screen, error) = enter(&["--connect", address], entries);
        assert_eq!(found, Some(code), "{entries:?}: {screen}{error}");
        let all = screen + &error;
        assert!(words.iter().all(|word| all.contains(word)), "{entries:?}: {all}");
        assert_eq!(error.matches("error: ").count(), usize::from(code != 0), "{all}");
    }
    let script = folder("script").join("walk.gcl");
    std::fs::write(&script, "VERS\nFROB\n").expect("a script");
    let (code, screen, error) =
        enter(&["--connect", address, "--script", script.to_str().expect("text")], "never read\n");
    assert!(code == Some(1) && screen.contains("600") && error.contains("FROB: ERR 32"), "{screen}{error}");
    let other = TcpStream::connect(address).expect("the hand is free");
    let (code, screen, error) = enter(&["--connect", address], "VERS\n");
    assert_eq!((code, &*screen), (Some(2), ""), "{error}");
    assert!(error.contains("in use: 127.0.0.1:"), "{error}");
    drop(other);
}

#[test]
fn peer_or_script_that_is_none_is_named() {
    let silent = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = silent.local_addr().expect("its address").to_string();
    let (code, _, error) = enter(&["--connect", &address], "VERS\n");
    assert!(code == Some(2) && error.contains(&address) && error.contains("next: "), "{error}");
    let text = folder("no-script").join("binary");
    std::fs::write(&text, [0xFF, 0xFE, b'\n']).expect("a file");
    let served = Served::fast_hand();
    let args = ["--connect", served.place("gcl"), "--script", text.to_str().expect("text")];
    let (code, _, error) = enter(&args, "");
    assert!(code == Some(2) && error.contains("binary:1: expected lines of text"), "{error}");
}

#[test]
fn hands_are_listed_and_json_is_one_object() {
    let served = Served::new(&["hand", "--listen", "127.0.0.1:0", "--discovery", "127.0.0.1:0"], 2);
    let (hand, door) = (served.place("gcl"), served.place("discovery"));
    let (code, screen, _) = enter(&["discover", "--to", door], "");
    assert!(code == Some(0) && screen.starts_with(&format!("{hand}  02:57:")), "{screen}");
    let (code, screen, _) = enter(&["discover", "--to", door, "--json"], "");
    let json: serde_json::Value = serde_json::from_str(&screen).expect("JSON");
    assert_eq!((code, json["hands"][0]["address"].as_str()), (Some(0), Some(hand)), "{screen}");
    let (code, screen, error) = enter(&["discover", "--to", "far"], "");
    assert!(code == Some(2) && screen.is_empty() && error.contains("such as 192.168.1.255"), "{error}");
}

fn read_to(peer: &mut TcpStream, end: &[u8]) -> std::io::Result<Vec<u8>> {
    let (mut seen, mut byte) = (Vec::new(), [0]);
    while !seen.ends_with(end) {
        if peer.read(&mut byte)? == 0 {
            break;
        }
        seen.extend(byte);
    }
    Ok(seen)
}

/// The hand is played by the test: the program is ended in the middle of a command. ^C and SIGTERM abort it and wait for its prompt; SIGKILL
/// resets the connection, which aborts it as well (decision 0031).
#[cfg(unix)]
#[test]
fn end_in_the_middle_of_a_command_aborts_it() {
    use std::os::unix::process::ExitStatusExt;
    for signal in ["TERM", "INT", "KILL"] {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("its address").to_string();
        let mut command = wraptor();
        command
            .args(["--connect", &address])
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let mut program = command.spawn().expect("it starts");
        program.stdin.as_mut().expect("piped").write_all(b"HI\n").expect("written");
        let (mut hand, _) = listener.accept().expect("it connects");
        hand.set_read_timeout(Some(HANGS)).expect("a time-out");
        for (line, answer) in [("", ""), ("VERS", "600"), ("1234567 G STAT", "")] {
            let seen = read_to(&mut hand, b"\r").expect("a line");
            assert_eq!(String::from_utf8(seen).expect("text"), format!("{line}\r"));
            let answer = if answer.is_empty() { String::new() } else { format!("\r\n\r{answer}") };
            hand.write_all(format!("{line}{answer}\r\n\r=> ").as_bytes()).expect("written");
        }
        assert_eq!(read_to(&mut hand, b"HI\r").expect("a line"), b"HI\r");
        let id = program.id().to_string();
        let killed = Command::new("kill").args(["-s", signal, &id]).status().expect("kill");
        assert!(killed.success());
        if signal == "KILL" {
            let error = read_to(&mut hand, b"never").expect_err("a reset");
            assert_eq!(error.kind(), std::io::ErrorKind::ConnectionReset);
            assert_eq!(program.wait().expect("it ends").signal(), Some(9));
            continue;
        }
        assert_eq!(read_to(&mut hand, b"\x03").expect("^C"), b"\x03", "{signal}");
        hand.write_all(b"HI\r\n\rERR 16384\r\n\r=> ").expect("written");
        assert_eq!(program.wait().expect("it ends").code(), Some(130), "{signal}");
    }
}

/// The program as a user who may do little, with `script` before it. The tests may run as root, which may do anything.
#[cfg(target_os = "linux")]
fn as_another_user(script: &str, args: &[&str]) -> (Option<i32>, String) {
    use std::os::unix::fs::PermissionsExt;
    use std::os::unix::process::CommandExt;
    const NOBODY: u32 = 65_534;
    // A folder that every user reaches.
    let folder = std::env::temp_dir().join(format!("wraptor-{}-{}", std::process::id(), args.len()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let program = folder.join("wraptor");
    std::fs::copy(env!("CARGO_BIN_EXE_wraptor"), &program).expect("a copy");
    let port = folder.join("port");
    std::fs::write(&port, "").expect("a file");
    for (path, mode) in [(&folder, 0o755), (&program, 0o755), (&port, 0)] {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("our own");
    }
    let mut command = Command::new("sh");
    command.args(["-c", script]).arg(&program).args(args).current_dir(&folder).stdin(Stdio::null());
    let is_root =
        std::fs::metadata("/proc/self").is_ok_and(|own| std::os::unix::fs::MetadataExt::uid(&own) == 0);
    if is_root {
        command.uid(NOBODY);
    }
    let output = command.output().expect("a shell");
    let _ = std::fs::remove_dir_all(&folder);
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[cfg(target_os = "linux")]
#[test]
fn port_of_others_and_a_machine_without_threads_are_named() {
    let (code, error) = as_another_user("exec \"$0\" \"$@\"", &["--serial", "port"]);
    assert!(
        code == Some(2) && error.contains("port: not permitted: ") && error.contains("dialout"),
        "{error}"
    );
    let served = Served::fast_hand();
    let (code, error) = as_another_user(
        "exec prlimit --nproc=0 \"$0\" \"$@\"",
        &["--connect", served.place("gcl"), "--limit", "9"],
    );
    assert!(code == Some(2) && error.contains("the system refuses: ") && error.contains("next: "), "{error}");
}

/// The program at a terminal: its process, the keyboard, and what it shows.
#[cfg(target_os = "linux")]
fn at_a_terminal(
    address: &str,
    home: &std::path::Path,
) -> (std::process::Child, std::fs::File, std::sync::mpsc::Receiver<Vec<u8>>) {
    use std::fs::{File, OpenOptions};

    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).expect("a terminal");
    grantpt(&master).and_then(|()| unlockpt(&master)).expect("a terminal");
    let name = ptsname(&master, Vec::new()).expect("its name").into_string().expect("text");
    let open = || OpenOptions::new().read(true).write(true).open(&name).expect("the terminal");
    let mut command = wraptor();
    command.args(["--connect", address]).env("XDG_STATE_HOME", home).env("TERM", "xterm");
    let program = command.stdin(open()).stdout(open()).stderr(open()).spawn().expect("it starts");
    let master = File::from(master);
    let (lines, screen) = std::sync::mpsc::channel();
    let mut from = master.try_clone().expect("a second handle");
    std::thread::spawn(move || {
        let mut bytes = [0; 1024];
        while let Ok(len @ 1..) = from.read(&mut bytes) {
            let _ = lines.send(bytes[..len].to_vec());
        }
    });
    (program, master, screen)
}

/// A person at a terminal: completion, history, ^C, RealTime by keys, an error that does not end the session.
#[cfg(target_os = "linux")]
#[test]
fn terminal_completes_remembers_and_goes_on_after_errors() {
    let served = Served::fast_hand();
    let home = folder("home");
    let (mut program, mut master, screen) = at_a_terminal(served.place("gcl"), &home);
    let mut seen = String::new();
    let mut until = |words: &str| {
        while !seen.contains(words) {
            let bytes = screen.recv_timeout(HANGS).unwrap_or_else(|_| panic!("{words:?} in {seen}"));
            seen.push_str(&String::from_utf8_lossy(&bytes));
        }
        seen = seen.split_once(words).expect("found").1.to_owned();
    };
    let mut enter = |keys: &[u8]| master.write_all(keys).expect("typed");
    until("asleep (WAKE)");
    until("=> ");
    enter(b"VER\t\r");
    until("600");
    enter(b"FROB\r");
    until("ERR 32");
    until("=> ");
    enter(b"half a line\x03");
    until("=> ");
    // The entry before the last: the last is FROB.
    enter(b"\x1b[A\x1b[A\r");
    until("600");
    // A connection that fails leaves the one before.
    enter(b"connect 127.0.0.1:1\r");
    until("nothing listens there");
    enter(b"VERS\r");
    until("600");
    for entry in [&b"WAKE\r"[..], b"SHI\r"] {
        enter(entry);
        // The editor leaves the terminal for the call, and takes it again.
        until("\x1b[?2004l");
        until("\x1b[?2004h");
    }
    enter(b"loop 4\r");
    until("keys: ");
    until(">4 [");
    enter(b"+");
    until("   16 counts/s");
    enter(b"\x1b[B");
    until("    0 counts/s");
    enter(b"q");
    until("=> ");
    enter(b"watch 1 STAT\r");
    until("STAT");
    until("\x1b[2A");
    let id = program.id().to_string();
    assert!(Command::new("kill").args(["-s", "INT", &id]).status().expect("kill").success());
    until("=> ");
    enter(b"quit\r");
    // The connection that failed was the worst.
    assert_eq!(program.wait().expect("it ends").code(), Some(2));
    let history = std::fs::read_to_string(home.join("wraptor/history")).expect("kept");
    assert!(history.contains("VERS") && history.contains("FROB"), "{history}");
}
