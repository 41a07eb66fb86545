//! The program on a host: it prints the properties, or gives a copy of a board's storage another ID.

use std::io::{self, Read, Write};
pub use std::process::ExitCode;

use tater_fw::storage::{Progress, Store};
use tater_fw::{Flash, FlashError};
use tater_wire::memory::{PAGE, STORAGE};
use tater_wire::property::ROWS;
use tater_wire::{Node, Property};

/// What to type.
const USAGE: &str = "expected nothing, or: name NODE < storage > storage, where NODE is 1 to 7";

/// Half-words and erases that a first start and a record of all properties take at most, several times over.
const STEPS: u32 = 3000;

/// Does what the command line says; 2 if it cannot.
pub fn run() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let done = match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => print(),
        ["name", node] => name(node),
        _ => Err(format!("found {words:?}, {USAGE}")),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn print() -> Result<(), String> {
    let line = |row: &tater_wire::property::PropertySpec| {
        format!("{:>3}  {:<6} {}\n", row.property.id(), row.name, row.meaning)
    };
    write(ROWS.iter().map(line).collect::<String>().as_bytes())
}

/// Standard input's storage with this ID, to standard output.
fn name(node: &str) -> Result<(), String> {
    let number = node.parse().ok().filter(|number| (1..=7).contains(number)).and_then(Node::new);
    let node = number.ok_or_else(|| format!("found node {node:?}, {USAGE}"))?;
    let mut bytes = Vec::new();
    io::stdin().read_to_end(&mut bytes).map_err(|error| format!("standard input: {error}"))?;
    write(&named(bytes, node)?)
}

fn write(bytes: &[u8]) -> Result<(), String> {
    let mut out = io::stdout().lock();
    out.write_all(bytes).and_then(|()| out.flush()).map_err(|error| format!("standard output: {error}"))
}

/// The storage with this ID added as the board itself adds it: all else that is stored stays.
fn named(bytes: Vec<u8>, node: Node) -> Result<Vec<u8>, String> {
    let (found, expected) = (bytes.len(), usize::try_from(STORAGE.len).unwrap_or(usize::MAX));
    if found != expected {
        return Err(format!("standard input: found {found} bytes, expected the storage's {expected}"));
    }
    let mut flash = Copied(bytes);
    let mut store = Store::open(&flash);
    store.set(Property::ID, node.number().into());
    for _ in 0..STEPS {
        match store.step(&mut flash, true) {
            Progress::Done => return Ok(flash.0),
            Progress::More => {}
            other => return Err(format!("the storage does not take it: {other:?}")),
        }
    }
    Err("the storage does not take it: no end of it".into())
}

/// A copy of the storage, with the flash's rules.
struct Copied(Vec<u8>);

impl Copied {
    /// Where some bytes lie.
    fn bytes(&mut self, address: u32, len: u32) -> Result<&mut [u8], FlashError> {
        let at = |address: u32| address.checked_sub(STORAGE.start).and_then(|at| usize::try_from(at).ok());
        let range = at(address).zip(address.checked_add(len).and_then(at));
        range.and_then(|(start, end)| self.0.get_mut(start..end)).ok_or(FlashError::Verify)
    }
}

impl Flash for Copied {
    fn half_word(&self, address: u32) -> u16 {
        let at = address.checked_sub(STORAGE.start).and_then(|at| usize::try_from(at).ok());
        let bytes = at.and_then(|at| self.0.get(at..)).and_then(<[u8]>::first_chunk);
        bytes.map_or(u16::MAX, |bytes| u16::from_le_bytes(*bytes))
    }

    fn program(&mut self, address: u32, value: u16) -> Result<(), FlashError> {
        if self.half_word(address) != u16::MAX && value != 0 {
            return Err(FlashError::NotErased);
        }
        self.bytes(address, 2)?.copy_from_slice(&value.to_le_bytes());
        Ok(())
    }

    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        self.bytes(page, PAGE)?.fill(0xFF);
        Ok(())
    }
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

    #[test]
    fn a_board_is_given_its_number_and_keeps_all_else() {
        let mut flash = Copied(named(erased(), node(3)).expect("an erased storage takes it"));
        let mut store = Store::open(&flash);
        assert_eq!(store.get(Property::ID), Some(3));
        store.set(Property::SN, 4711);
        store.save_position(100, 5);
        let counters = Counters { upsecs: 5000, odometer: 600, ptemp: 421 };
        store.count(counters);
        for _ in 0..STEPS {
            if store.step(&mut flash, true) == Progress::Done {
                break;
            }
        }
        // Often enough that its page is full and another begins.
        let mut bytes = flash.0;
        for number in (1..=7).cycle().take(100) {
            bytes = named(bytes, node(number)).expect("a storage in use takes it");
            let store = Store::open(&Copied(bytes.clone()));
            assert_eq!(store.get(Property::ID), Some(number.into()));
            assert_eq!(store.get(Property::SN), Some(4711));
            assert_eq!(store.trusted_position(), Some((100, 5)));
            assert_eq!(store.counters(), counters);
        }
    }

    #[test]
    fn the_same_number_again_changes_no_byte() {
        let bytes = named(erased(), node(7)).expect("an erased storage takes it");
        assert_ne!(bytes, erased());
        assert_eq!(named(bytes.clone(), node(7)), Ok(bytes));
    }

    #[test]
    fn a_copy_of_another_length_is_refused() {
        for len in [0, 4096, erased().len() - 1, erased().len() + 1] {
            let error = named(vec![0xFF; len], node(1)).expect_err("not the storage");
            assert!(error.contains(&format!("found {len} bytes, expected the storage's 8192")), "{error}");
        }
    }
}
