//! Gives a copy of a board's storage another ID: `storage-id NODE < storage > storage`. `cargo xtask flash --node` runs it.
//!
//! The firmware's own journal stores the ID in a simulated flash, so that all other records stay.

use std::io::{self, Read, Write};
use std::process::ExitCode;

use hil_sim::rig::flash::SimFlash;
use tater_fw::storage::{Progress, Store};
use tater_wire::memory::{FLASH, STORAGE};
use tater_wire::{Node, Property};

const USAGE: &str = "usage: storage-id NODE < storage > storage, where NODE is 1 to 7";

/// Limit of flash operations for one record: a first start erases 8 pages, and a record has at most 102 half-words.
const MAX_STEPS: u32 = 3000;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn run() -> Result<(), String> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let node = match &arguments[..] {
        [node] => node.parse().ok().filter(|number| (1..=7).contains(number)).and_then(Node::new),
        _ => None,
    };
    let node = node.ok_or_else(|| format!("found arguments {arguments:?}\n  {USAGE}"))?;
    let mut bytes = Vec::new();
    io::stdin().read_to_end(&mut bytes).map_err(|error| format!("standard input: {error}"))?;
    let bytes = with_id(&bytes, node)?;
    let mut out = io::stdout().lock();
    out.write_all(&bytes).and_then(|()| out.flush()).map_err(|error| format!("standard output: {error}"))
}

fn with_id(bytes: &[u8], node: Node) -> Result<Vec<u8>, String> {
    let (start, len) = ((STORAGE.start - FLASH.start) as usize, STORAGE.len as usize);
    if bytes.len() != len {
        return Err(format!("standard input: found {} bytes, expected the storage's {len}", bytes.len()));
    }
    let mut flash = SimFlash::default();
    flash.load(STORAGE.start, bytes);
    let mut store = Store::open(&flash);
    store.set(Property::ID, node.number().into());
    for _ in 0..MAX_STEPS {
        match store.step(&mut flash, true) {
            Progress::Done => return Ok(flash.bytes()[start..start + len].to_vec()),
            Progress::More => {}
            progress => return Err(format!("the storage cannot be written: {progress:?}")),
        }
    }
    Err(format!("the storage is not written after {MAX_STEPS} flash operations"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tater_fw::storage::Counters;

    fn erased() -> Vec<u8> {
        vec![0xFF; STORAGE.len as usize]
    }

    fn node(number: u8) -> Node {
        Node::new(number).expect("a node")
    }

    fn loaded(bytes: &[u8]) -> SimFlash {
        let mut flash = SimFlash::default();
        flash.load(STORAGE.start, bytes);
        flash
    }

    #[test]
    fn new_id_keeps_everything_else_that_is_stored() {
        let mut flash = loaded(&with_id(&erased(), node(3)).expect("an erased storage"));
        let mut store = Store::open(&flash);
        assert_eq!(store.get(Property::ID), Some(3));
        store.set(Property::SN, 4711);
        store.save_position(100, 5);
        let counters = Counters { upsecs: 5000, odometer: 600, ptemp: 421 };
        store.count(counters);
        assert!((0..MAX_STEPS).any(|_| store.step(&mut flash, true) == Progress::Done));
        let mut bytes = flash.bytes()[(STORAGE.start - FLASH.start) as usize..].to_vec();
        // Often enough to fill a page and begin another.
        for number in (1..=7).cycle().take(100) {
            bytes = with_id(&bytes, node(number)).expect("a storage in use");
            let store = Store::open(&loaded(&bytes));
            assert_eq!(store.get(Property::ID), Some(number.into()));
            assert_eq!(store.get(Property::SN), Some(4711));
            assert_eq!(store.trusted_position(), Some((100, 5)));
            assert_eq!(store.counters(), counters);
        }
    }

    #[test]
    fn same_id_changes_no_byte() {
        let bytes = with_id(&erased(), node(7)).expect("an erased storage");
        assert_ne!(bytes, erased());
        assert_eq!(with_id(&bytes, node(7)), Ok(bytes));
    }

    #[test]
    fn storage_of_another_length_is_refused() {
        for len in [0, 4096, erased().len() - 1, erased().len() + 1] {
            let error = with_id(&vec![0xFF; len], node(1)).expect_err("not the storage");
            assert!(error.contains(&format!("found {len} bytes, expected the storage's 8192")), "{error}");
        }
    }
}
