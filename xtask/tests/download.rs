//! Failures of `cargo xtask download` as a user sees them. Success is shown by `cargo xtask host-tools`, the
//! protocol by the system tests.

use std::io::{self, BufRead, BufReader, Write};
use std::net::{Shutdown, TcpListener};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

/// Exit code and standard error.
fn xtask(args: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_xtask")).args(args).output().expect("the binary starts");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn tek(name: &str, sealed: bool) -> String {
    let (bytes, file) = (path(&format!("{name}.bin")), path(&format!("{name}.tek")));
    let mut image = vec![0; 512];
    image[..8].copy_from_slice(&[0, 0x50, 0, 0x20, 0x01, 0x41, 0, 8]);
    std::fs::write(&bytes, image).expect("a file for the test");
    let (bytes, file) = (bytes.to_string_lossy().into_owned(), file.to_string_lossy().into_owned());
    let mut args = vec!["tek", "encode", &bytes, "--base", "0x08004000", "-o", &file];
    args.extend(sealed.then_some(["--seal", "600"]).into_iter().flatten());
    assert_eq!(xtask(&args).0, Some(0));
    file
}

/// An adapter with these answers. Without one it hangs up, but keeps reading, so that no output is lost.
fn adapter(mut answer: impl FnMut(&str) -> &'static [u8] + Send + 'static) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("bound").to_string();
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().expect("a client");
        let mut client = BufReader::new(stream.try_clone().expect("a socket"));
        let mut line = Vec::new();
        while client.read_until(b'\r', &mut line).is_ok_and(|len| len > 0) {
            let said = answer(std::str::from_utf8(&line).expect("ASCII").trim_end());
            line.clear();
            if said.is_empty() || stream.write_all(said).is_err() {
                let _ = stream.shutdown(Shutdown::Write);
                let _ = io::copy(&mut client, &mut io::sink());
            }
        }
    });
    address
}

/// A working adapter: closed at first, accepts every frame, on an empty bus.
fn good(command: &str) -> &'static [u8] {
    match command {
        "C" => b"\x07",
        "V" => b"V0100\r",
        _ if command.starts_with('t') => b"z\r",
        _ => b"\r",
    }
}

fn but(odd: &'static str, said: &'static [u8]) -> String {
    adapter(move |command| if command == odd { said } else { good(command) })
}

/// Answers of board 4 to a frame, as an adapter passes them on: STAT 0, and a request for 16 numbered frames.
fn board(command: &str) -> &'static [u8] {
    match command {
        "t004105" => b"z\rt486485000000\r",
        _ if command.starts_with("t004") && command[5..].starts_with("8000AA01") => b"z\rt08050010000000\r",
        _ => good(command),
    }
}

fn is_numbered(command: &str) -> bool {
    command.starts_with("t0048")
}

fn download(file: &str, address: &str) -> (Option<i32>, String) {
    xtask(&["download", "--node", "4", "--slcan", address, file])
}

#[test]
fn unusable_file_is_named_with_a_next_step() {
    let (sealed, unsealed) = (tek("sealed", true), tek("unsealed", false));
    let damaged = path("damaged.tek").to_string_lossy().into_owned();
    std::fs::write(&damaged, b"%098xyz\r\n").expect("a file for the test");
    let free = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("bound").to_string();
    for (file, address, code, said) in [
        (&unsealed, &free, 1, "encode it again with `cargo xtask tek encode --seal"),
        (&damaged, &free, 1, "damaged.tek:1:"),
        (&path("none.tek").to_string_lossy().into_owned(), &free, 2, "none.tek: cannot be read"),
        (&sealed, &free, 2, "nothing listens there"),
        (&sealed, &adapter(good), 1, "no board of node 4 answers"),
    ] {
        let (found, error) = download(file, address);
        assert_eq!(found, Some(code), "{file} {address}: {error}");
        assert!(error.contains(said), "{file} {address}: expected {said:?}, found {error}");
    }
}

#[test]
fn rejected_command_is_reported_with_a_next_step() {
    let file = tek("refused", true);
    let deaf = adapter(|_| b"");
    let full = adapter(|command| if command.starts_with('t') { b"\x07" } else { good(command) });
    for (address, said, next) in [
        (&deaf, "the connection to the adapter ended: ", "check that this is the adapter's port"),
        (
            &but("", b"error: two hosts: disconnect one\r\x07"),
            "two hosts: disconnect one",
            "end the other program",
        ),
        (&but("S8", b"\x07"), "the adapter refuses S8 (1 Mbit/s)", "use one that can do 1 Mbit/s"),
        (&but("O", b"\x07"), "the adapter refuses O", "end other programs"),
        (&full, "the adapter refuses to send", "check that a board is on the bus"),
    ] {
        let (found, error) = download(&file, address);
        assert_eq!(found, Some(2), "{said}: {error}");
        assert!(error.contains(said) && error.contains(next), "{said}: {error}");
        assert_eq!(error.matches("error: ").count(), 1, "{error}");
    }
}

#[test]
fn rejected_frame_counts_as_lost() {
    // The first numbered frame; it hangs up at the next, which ends the test.
    let mut numbered = 0;
    let address = adapter(move |command| {
        numbered += usize::from(is_numbered(command));
        match numbered {
            0 => board(command),
            1 => b"\x07",
            _ => b"",
        }
    });
    let (code, error) = download(&tek("lossy", true), &address);
    assert!(code == Some(2) && error.contains("the connection is lost"), "{error}");
}

#[cfg(unix)]
#[test]
fn file_is_read_once() {
    // A pipe can be read only once. The adapter hangs up at the first numbered frame.
    let address = adapter(|command| if is_numbered(command) { b"" } else { board(command) });
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    command.args(["download", "--node", "4", "--slcan", &address, "/dev/stdin"]);
    let file = std::fs::read(tek("piped", true)).expect("the test's own");
    let mut process =
        command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the binary starts");
    process.stdin.take().expect("piped").write_all(&file).expect("it reads");
    let output = process.wait_with_output().expect("it ends");
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(error.contains("version 600, 512 bytes") && error.contains("the connection is lost"), "{error}");
}

#[test]
fn adapter_and_node_are_required() {
    let file = tek("named", true);
    for (args, said) in [
        (&["--node", "4"][..], "--slcan"),
        (&["--slcan", "127.0.0.1:1"], "--node"),
        (&["--node", "32", "--slcan", "127.0.0.1:1"], "32"),
        (&["--node", "4", "--slcan", "127.0.0.1:1", "--can", "can0"], "--can"),
        (&["--node", "4", "--can", "nocan9"], "nocan9: no such port"),
        (&["--node", "3-1", "--host", "127.0.0.1:1"], "such as 1-3"),
    ] {
        let (code, error) = xtask(&[&["download", &file][..], args].concat());
        assert_eq!(code, Some(2), "{args:?}: {error}");
        assert!(error.contains(said), "{args:?}: {error}");
    }
}
