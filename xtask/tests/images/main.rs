//! `cargo xtask image` and `flash` with a fake cargo that has built already: tests what they do with linked
//! programs.
#![cfg(unix)]

mod flash;
mod image;

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The smallest linked program: 64 bytes from `address`, with the vectors of an application.
fn elf(address: u32) -> Vec<u8> {
    let halves = |numbers: &[u16]| numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    let words = |numbers: &[u32]| numbers.iter().flat_map(|n| n.to_le_bytes()).collect::<Vec<u8>>();
    let mut file = b"\x7fELF\x01\x01\x01".to_vec();
    file.resize(16, 0);
    file.extend(halves(&[2, 40]));
    file.extend(words(&[1, address + 0x31, 52, 0, 0]));
    file.extend(halves(&[52, 32, 1, 40, 0, 0]));
    file.extend(words(&[1, 84, address, address, 64, 64, 4, 4]));
    file.extend(words(&[0x2000_2000, address + 0x31]));
    file.resize(84 + 64, 0);
    file
}

struct Bench(PathBuf);

impl Bench {
    fn new(test: &str) -> Self {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("images-{test}"));
        if folder.exists() {
            fs::remove_dir_all(&folder).expect("our own folder can be removed");
        }
        fs::create_dir_all(folder.join("bin")).expect("the target folder can be written");
        let bench = Self(folder);
        bench.put("tater", &elf(0x0800_4000));
        bench.put("monitor", &elf(0x0800_0000));
        bench.put("conformance", &elf(0x0800_0000));
        bench.put("flash", &[0xFF; 8192]);
        // The fake cargo copies files instead of building; `cargo run` commands do run, in the tests' folder.
        let (here, real) = (bench.0.display(), env!("CARGO"));
        let target =
            Path::new(env!("CARGO_TARGET_TMPDIR")).parent().expect("below the target folder").display();
        bench.program(
            "cargo",
            &format!(
                "[ $1 = run ] && CARGO_TARGET_DIR='{target}' exec '{real}' \"$@\"\n\
                 while [ $# -gt 0 ]; do\n\
                 [ \"$1\" = --bin ] && bin=$2; [ \"$1\" = --target-dir ] && to=$2/thumbv7m-none-eabi/firmware\n\
                 shift; done\n\
                 mkdir -p \"$to\" && cp '{here}/'$bin \"$to/\""
            ),
        );
        bench
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        fs::write(self.0.join(name), bytes).expect("the target folder can be written");
    }

    fn get(&self, name: &str) -> Vec<u8> {
        fs::read(self.0.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn program(&self, name: &str, script: &str) {
        let path = self.0.join("bin").join(name);
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).expect("the target folder can be written");
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).expect("it is ours");
    }

    /// The tool, with the fake programs first in PATH.
    fn chore(&self, arguments: &[&str]) -> Command {
        let path = format!("{}:{}", self.0.join("bin").display(), std::env::var("PATH").expect("a PATH"));
        let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
        command.args(arguments).env("PATH", path).env("CARGO_TARGET_DIR", self.0.join("target"));
        command
    }
}
