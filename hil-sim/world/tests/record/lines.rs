//! Lines of a record, and its comparison with the file. The crate of experiments records itself with these too.

use std::fmt::{Debug, Display, Write};

use flate2::Crc;

/// The lines of one scene.
pub struct Record {
    text: String,
}

impl Record {
    pub fn new(scene: &str) -> Self {
        Self { text: format!("[{scene}]\n") }
    }

    /// Adds a line: `shown` to read, and the CRC-32 of `all`, whose numbers print exactly.
    pub fn note(&mut self, shown: impl Display, all: &impl Debug) {
        let mut crc = Crc::new();
        crc.update(format!("{all:?}").as_bytes());
        writeln!(self.text, "{shown} {:08x}", crc.sum()).expect("a string takes all");
    }
}

/// A group of scenes.
pub type Scenes = fn() -> Vec<Record>;

/// Plays the scenes, each group in a thread, and compares them with `expected`, the text of `record.txt` in the `folder` of the test.
/// `BLESS_RECORD=1` writes it.
pub fn compare(scenes: Vec<Scenes>, folder: &str, expected: &str) {
    let threads: Vec<_> = scenes.into_iter().map(std::thread::spawn).collect();
    let records = threads.into_iter().flat_map(|thread| thread.join().expect("no scene panics"));
    let found: String = records.map(|record| record.text).collect();
    if std::env::var_os("BLESS_RECORD").is_some() {
        std::fs::write(format!("{folder}/record.txt"), &found).expect("the file can be written");
    }
    let mut scene = "";
    for (number, (is, was)) in (1..).zip(found.lines().zip(expected.lines())) {
        scene = if is.starts_with('[') { is } else { scene };
        assert_eq!(
            is, was,
            "line {number} of {folder}/record.txt, scene {scene}: BLESS_RECORD=1 if that is meant"
        );
    }
    assert_eq!(found.lines().count(), expected.lines().count(), "lines of {folder}/record.txt");
}
