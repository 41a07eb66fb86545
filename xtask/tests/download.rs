//! `cargo xtask download` as a person meets it where it cannot succeed. That it succeeds is shown by `cargo xtask
//! host-tools`, and the protocol by the system tests.

use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::thread;

/// A file of this test's own.
fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join(name)
}

/// Exit code and standard error.
fn xtask(args: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_xtask")).args(args).output().expect("the binary starts");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// A `.tek` file of a small image, sealed or not.
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

/// An adapter that says this as soon as it hears something, and hears on until it is left.
fn adapter(says: &'static [u8]) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("bound").to_string();
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().expect("a client");
        let mut bytes = [0; 256];
        let mut first = true;
        while stream.read(&mut bytes).is_ok_and(|len| len > 0) {
            if std::mem::take(&mut first) {
                stream.write_all(says).expect("told");
            }
            if says.is_empty() {
                return;
            }
        }
    });
    address
}

#[test]
fn what_cannot_be_downloaded_is_named_with_a_next_step() {
    let (sealed, unsealed) = (tek("sealed", true), tek("unsealed", false));
    let damaged = path("damaged.tek").to_string_lossy().into_owned();
    std::fs::write(&damaged, b"%098xyz\r\n").expect("a file for the test");
    let free = TcpListener::bind("127.0.0.1:0").expect("a port").local_addr().expect("bound").to_string();
    let deaf = adapter(b"");
    let busy = adapter(b"error: two hosts\r\x07");
    let refusing = adapter(b"\r\r\r\rV0100\r\x07");
    // It opens, and nobody is on its bus.
    let lonely = adapter(b"\r\r\r\rV0100\r");
    for (file, address, code, said) in [
        (&unsealed, &free, 1, "encode it again with `cargo xtask tek encode --seal"),
        (&damaged, &free, 1, "damaged.tek:1:"),
        (&path("none.tek").to_string_lossy().into_owned(), &free, 2, "none.tek: cannot be read"),
        (&sealed, &free, 2, "expected an SLCAN adapter"),
        (&sealed, &deaf, 2, "it has hung up"),
        (&sealed, &busy, 2, "error: two hosts"),
        (&sealed, &refusing, 2, "the adapter refuses"),
        (&sealed, &lonely, 1, "no board of node 4 answers"),
    ] {
        let (found, error) = xtask(&["download", "--node", "4", "--slcan", address, file]);
        assert_eq!(found, Some(code), "{file} {address}: {error}");
        assert!(error.contains(said), "{file} {address}: expected {said:?}, found {error}");
    }
}

#[test]
fn an_adapter_and_a_node_are_needed() {
    let file = tek("named", true);
    for (args, said) in [
        (&["--node", "4"][..], "--slcan"),
        (&["--slcan", "127.0.0.1:1"], "--node"),
        (&["--node", "32", "--slcan", "127.0.0.1:1"], "32"),
        (&["--node", "4", "--slcan", "127.0.0.1:1", "--can", "can0"], "--can"),
        (&["--node", "4", "--can", "nocan9"], "--can nocan9"),
    ] {
        let (code, error) = xtask(&[&["download", &file][..], args].concat());
        assert_eq!(code, Some(2), "{args:?}: {error}");
        assert!(error.contains(said), "{args:?}: {error}");
    }
}
