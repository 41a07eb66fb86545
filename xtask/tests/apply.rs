//! `cargo xtask apply` says at once what it does, and shows the build.
#![cfg(unix)]

use std::io::{BufRead, BufReader};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A folder with a `cargo` that builds only when it is told to, through a pipe, and whose programs end with code 1.
fn cargo() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("apply-cargo");
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    let pipe = folder.join("go");
    assert!(Command::new("mkfifo").arg(&pipe).status().expect("mkfifo starts").success());
    let script = format!(
        "#!/bin/sh\necho \"$@\" >&2\nif [ \"$1\" = build ]; then read go < '{}'; echo '   Compiling hil-sim' >&2; exit 0; fi\nexit 1\n",
        pipe.display()
    );
    let path = folder.join("cargo");
    std::fs::write(&path, script).expect("a file for the test");
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).expect("ours");
    folder
}

#[test]
fn first_line_comes_before_the_build_and_the_build_is_shown() {
    let folder = cargo();
    let path = format!("{}:{}", folder.display(), std::env::var("PATH").unwrap_or_default());
    let mut xtask = Command::new(env!("CARGO_BIN_EXE_xtask"))
        .args(["apply", "tuned.json", "--slcan", "127.0.0.1:1"])
        .env("PATH", path)
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    let mut lines = BufReader::new(xtask.stderr.take().expect("piped")).lines().map_while(Result::ok);
    let first = lines.next().expect("a line");
    assert!(first.contains("hil-sim is built") && first.contains("cargo build --release"), "{first}");
    let build = lines.next().expect("the build's");
    assert!(build.starts_with("build --release --package hil-sim"), "{build}");
    // Only now it builds.
    std::fs::write(folder.join("go"), "go\n").expect("it waits for this");
    let rest: Vec<String> = lines.collect();
    assert_eq!(rest.first().map(String::as_str), Some("   Compiling hil-sim"));
    assert!(rest.iter().any(|line| line.ends_with("apply tuned.json --slcan 127.0.0.1:1")), "{rest:?}");
    assert_eq!(xtask.wait().expect("it ends").code(), Some(1));
}
