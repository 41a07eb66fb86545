//! `cargo xtask tek` as a user calls it: files, messages, exit codes.

mod damaged;
mod elf;
mod foreign;
mod objcopy;
mod whole;

use std::fs;
use std::path::PathBuf;
use std::process::Command;

const BASE: &str = "0x08004000";

struct Scratch(PathBuf);

impl Scratch {
    fn new(test: &str) -> Self {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("tek-{test}"));
        if folder.exists() {
            fs::remove_dir_all(&folder).expect("our own folder can be removed");
        }
        fs::create_dir_all(&folder).expect("the target folder can be written");
        Self(folder)
    }

    fn path(&self, name: &str) -> String {
        self.0.join(name).to_str().expect("the path is UTF-8").to_owned()
    }

    fn put(&self, name: &str, bytes: &[u8]) -> String {
        fs::write(self.0.join(name), bytes).expect("the target folder can be written");
        self.path(name)
    }

    fn get(&self, name: &str) -> Vec<u8> {
        fs::read(self.0.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    fn encoded(&self, name: &str, bytes: &[u8], arguments: &[&str]) -> Vec<u8> {
        let (input, output) = (self.put("in.bin", bytes), self.path(name));
        let said = tek(&[&["encode", &input, "--base", BASE, "-o", &output], arguments].concat());
        assert_eq!(said.code, Some(0), "{}", said.err);
        self.get(name)
    }

    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).expect("our own folder can be read");
        let names = entries.map(|entry| entry.expect("our own folder can be read").file_name());
        let mut names: Vec<String> = names.map(|name| name.to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

struct Said {
    code: Option<i32>,
    out: String,
    err: String,
}

fn tek(arguments: &[&str]) -> Said {
    let mut command = Command::new(env!("CARGO_BIN_EXE_xtask"));
    let output = command.arg("tek").args(arguments).output().expect("xtask starts");
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).expect("it says UTF-8");
    Said { code: output.status.code(), out: text(&output.stdout), err: text(&output.stderr) }
}

/// `LLTCC...`: a record of this type with these characters after the checksum.
fn record(kind: char, rest: &str) -> String {
    let len = rest.len() + 5;
    let sum: u32 = format!("{len:02X}{kind}{rest}")
        .bytes()
        .map(|c| u32::from(tater_wire::tek::value(c).expect("a character of a record")))
        .sum();
    format!("{len:02X}{kind}{:02X}{rest}", sum % 256)
}

/// The smallest sealable application with `len` bytes: stack pointer, reset vector, zeros in the reserved
/// vectors, then distinct bytes.
fn application(len: usize) -> Vec<u8> {
    let mut image = vec![0; len];
    image[..4].copy_from_slice(&0x2000_5000_u32.to_le_bytes());
    image[4..8].copy_from_slice(&0x0800_4031_u32.to_le_bytes());
    for (i, byte) in image.iter_mut().enumerate().skip(0x2C) {
        *byte = (i % 251) as u8;
    }
    image
}

/// Images with what is special to GNU's blocks of 32 bytes: one that ends inside a block, starts inside a block, has
/// blocks of zeros at the start, in between and at the end, is all zeros, crosses its chunks of 8 KiB.
fn images() -> Vec<(u32, Vec<u8>)> {
    let noise = |len: u32| (0..len).map(|i| (i.wrapping_mul(0x9E37_79B9) >> 24) as u8).collect::<Vec<u8>>();
    let mut holes = noise(1000);
    for zeros in [0..100, 300..500, 901..1000] {
        holes[zeros].fill(0);
    }
    vec![
        (0x0800_4000, noise(1)),
        (0x0800_4000, noise(39)),
        (0x0800_4011, noise(77)),
        (0x0800_4000, holes),
        (0x0800_4000, vec![0; 4096]),
        (0x0800_4000, vec![0xFF; 4096]),
        (0x0800_5FF1, noise(40_000)),
        (0, noise(64)),
        (0xFFFF_FF00, noise(200)),
    ]
}
