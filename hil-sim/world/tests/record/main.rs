//! What happens in the world, bit by bit: `record.txt` holds for each scene what a reader compares, and a CRC-32 of every value at that time.
//! The same calls give the same bits on every platform, so any difference is a change of the world. `BLESS_WORLD=1` writes the file.
//!
//! Whether the physics is right is judged by the other tests; here nothing may change unseen, faults and rare paths included.

mod boards;
mod hands;
mod motors;

use std::fmt::{Debug, Display, Write};
use std::path::Path;

use flate2::Crc;

/// The lines of one scene.
struct Record {
    text: String,
}

impl Record {
    fn new(scene: &str) -> Self {
        Self { text: format!("[{scene}]\n") }
    }

    /// Adds a line: `shown` to read, and the CRC-32 of `all`, whose numbers print exactly.
    fn note(&mut self, shown: impl Display, all: &impl Debug) {
        let mut crc = Crc::new();
        crc.update(format!("{all:?}").as_bytes());
        writeln!(self.text, "{shown} {:08x}", crc.sum()).expect("a string takes all");
    }
}

#[test]
fn nothing_changes_unseen() {
    let scenes: Vec<fn() -> Vec<Record>> = vec![motors::scenes, boards::scenes, hands::scenes];
    let threads: Vec<_> = scenes.into_iter().map(std::thread::spawn).collect();
    let records = threads.into_iter().flat_map(|thread| thread.join().expect("no scene panics"));
    let found: String = records.map(|record| record.text).collect();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/record/record.txt");
    if std::env::var_os("BLESS_WORLD").is_some() {
        std::fs::write(&path, &found).expect("the file can be written");
    }
    let expected = include_str!("record.txt");
    let mut scene = "";
    for (number, (is, was)) in found.lines().zip(expected.lines()).enumerate() {
        scene = if is.starts_with('[') { is } else { scene };
        assert_eq!(
            is,
            was,
            "line {} of record.txt, scene {scene}: BLESS_WORLD=1 if that is meant",
            number + 1
        );
    }
    assert_eq!(found.lines().count(), expected.lines().count(), "lines of record.txt");
}
