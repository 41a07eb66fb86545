//! `cargo xtask flash` with a probe-rs that only writes down what it is asked for, and a cargo that has built already.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The smallest thing that is linked: 64 bytes from `address` on, with the vectors of an application.
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

/// A folder with the programs, and what they wrote.
struct Bench(PathBuf);

impl Bench {
    fn new(test: &str) -> Self {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("flash-{test}"));
        if folder.exists() {
            fs::remove_dir_all(&folder).expect("our own folder can be removed");
        }
        fs::create_dir_all(folder.join("bin")).expect("the target folder can be written");
        let bench = Self(folder);
        bench.put("tater", &elf(0x0800_4000));
        bench.put("monitor", &elf(0x0800_0000));
        bench.put("flash", &[0xFF; 8192]);
        // It builds by copying. What it runs is run, in the folder of these tests.
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

    /// A probe-rs that writes down its arguments, and a board behind it with a storage that is read and written.
    fn probe(&self) {
        let here = self.0.display();
        self.program(
            "probe-rs",
            &format!(
                "[ \"$1\" = --version ] && exit 0\n\
                 echo \"$*\" >> '{here}/calls'\n\
                 [ \"$1\" = read ] && while [ $# -gt 0 ]; do [ \"$1\" = --output ] && cp '{here}/flash' \"$2\"; shift; done\n\
                 case \"$*\" in *--base-address*) for last; do :; done; cp \"$last\" '{here}/flash';; esac\n\
                 exit 0"
            ),
        );
    }

    /// The exit code and what it said.
    fn flash(&self, arguments: &[&str]) -> (Option<i32>, String) {
        let path = format!("{}:{}", self.0.join("bin").display(), std::env::var("PATH").expect("a PATH"));
        let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
        command.arg("flash").args(arguments).env("PATH", path).env("CARGO_TARGET_DIR", self.0.join("target"));
        let output = command.output().expect("xtask starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }

    /// What the probe was asked for, folders left out.
    fn calls(&self) -> Vec<String> {
        let text = String::from_utf8(self.get("calls")).expect("it is text");
        let folder = format!("{}/", self.0.display());
        text.replace(&folder, "").lines().map(String::from).collect()
    }
}

#[test]
fn without_probe_rs_it_says_how_to_install_it_and_builds_nothing() {
    let bench = Bench::new("absent");
    // As where there is none: whatever else the machine has.
    bench.program("probe-rs", "exit 127");
    let (code, said) = bench.flash(&[]);
    assert_eq!(code, Some(2), "{said}");
    assert!(said.contains("cargo install probe-rs-tools"), "{said}");
    assert!(!bench.0.join("target").exists());
}

#[test]
fn the_monitor_comes_first_then_the_application_then_a_reset() {
    let bench = Bench::new("order");
    bench.probe();
    let (code, said) = bench.flash(&["--probe", "0483:3748", "--profile", "release"]);
    assert_eq!(code, Some(0), "{said}");
    let chip = "--chip STM32F103CB --probe 0483:3748";
    let expected = [
        format!("download {chip} --verify target/image/release/monitor.elf"),
        format!("download {chip} --verify target/image/release/tater.elf"),
        format!("reset {chip}"),
    ];
    assert_eq!(bench.calls(), expected);
    // Sealed: the magic word is in the vector table.
    let tater = bench.get("target/image/release/tater.elf");
    assert_eq!(&tater[84 + 0x1C..84 + 0x20], b"TatR");
}

#[test]
fn a_number_is_added_to_what_the_board_has_stored() {
    let bench = Bench::new("node");
    bench.probe();
    let (code, said) = bench.flash(&["--node", "5"]);
    assert_eq!(code, Some(0), "{said}");
    let chip = "--chip STM32F103CB";
    let expected = [
        format!("read {chip} --format binary --output target/flash/storage.bin b8 0x0801e000 8192"),
        format!("download {chip} --verify target/image/production/monitor.elf"),
        format!("download {chip} --verify target/image/production/tater.elf"),
        format!(
            "download {chip} --verify --binary-format bin --base-address 0x0801e000 target/flash/storage-named.bin"
        ),
        format!("reset {chip}"),
    ];
    assert_eq!(bench.calls(), expected);
    let stored = bench.get("flash");
    assert!(stored.len() == 8192 && stored.iter().any(|&byte| byte != 0xFF));
    // It has that number now: nothing is worn out by it.
    fs::remove_file(bench.0.join("calls")).expect("the probe wrote it");
    let (code, said) = bench.flash(&["--node", "5"]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(bench.calls().len(), 4, "{:?}", bench.calls());
    assert_eq!(bench.get("flash"), stored);
}

#[test]
fn a_storage_that_cannot_be_read_leaves_the_board_as_it_is() {
    let bench = Bench::new("short");
    bench.probe();
    bench.put("flash", &[0xFF; 100]);
    let (code, said) = bench.flash(&["--node", "5"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("found 100 bytes, expected the storage's 8192"), "{said}");
    assert_eq!(bench.calls().len(), 1, "{:?}", bench.calls());
}

#[test]
fn a_probe_that_fails_ends_it() {
    let bench = Bench::new("fails");
    bench.program(
        "probe-rs",
        &format!("echo \"$*\" >> '{}/calls'\n[ \"$1\" = --version ]", bench.0.display()),
    );
    let (code, said) = bench.flash(&[]);
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("probe-rs list"), "{said}");
    assert_eq!(bench.calls().len(), 2, "the version and the first download: {:?}", bench.calls());
}
