//! Sets properties in a copy of a board's storage: `storage-id ID=4 WIRING?=2 < storage > storage`. `cargo xtask flash` runs it.
//! A value after `?=` is stored only where none is.
//!
//! The firmware's own journal stores them in a simulated flash, so that all other records stay.

use std::io::{self, Read, Write};
use std::process::ExitCode;

use boot::storage::{Progress, Store};
use hil_world::rig::flash::SimFlash;
use tater_f103::map::{FLASH, STORAGE};
use tater_wire::Property;

const USAGE: &str = "usage: storage-id NAME=VALUE ... < storage > storage, where NAME is a stored property, such as ID=4; \
     NAME?=VALUE keeps a stored value";

/// Limit of flash operations for one record: a first start erases 8 pages, and a record has at most 109 half-words.
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
    let values: Option<Vec<_>> = arguments.iter().map(|argument| conditional(argument)).collect();
    let values = values
        .filter(|values| !values.is_empty())
        .ok_or_else(|| format!("found arguments {arguments:?}\n  {USAGE}"))?;
    let mut bytes = Vec::new();
    // One byte more than a storage is enough to refuse a longer input.
    io::stdin()
        .take(u64::from(STORAGE.len) + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| format!("standard input: {error}"))?;
    let values = needed(&bytes, values);
    let bytes = with(&bytes, &values)?;
    let mut out = io::stdout().lock();
    out.write_all(&bytes).and_then(|()| out.flush()).map_err(|error| format!("standard output: {error}"))
}

/// An assignment, and whether it keeps a stored value.
fn conditional(text: &str) -> Option<(bool, (Property, i64))> {
    let keeps = text.contains("?=");
    Some((keeps, assignment(&text.replacen("?=", "=", 1))?))
}

/// Those that change something.
fn needed(bytes: &[u8], values: Vec<(bool, (Property, i64))>) -> Vec<(Property, i64)> {
    let mut flash = SimFlash::default();
    flash.load(STORAGE.start, bytes);
    let store = Store::open(&flash);
    let wanted =
        |&(keeps, (property, _)): &(bool, (Property, i64))| !(keeps && store.get(property).is_some());
    values.into_iter().filter(wanted).map(|(_, value)| value).collect()
}

/// `None` unless the value is in the range of a stored property.
fn assignment(text: &str) -> Option<(Property, i64)> {
    let (name, value) = text.split_once('=')?;
    let (property, value) = (Property::named(name)?, value.parse().ok()?);
    let stored = Property::is_stored(property.id());
    (stored && property.rules().admits(value)).then_some((property, value))
}

fn with(bytes: &[u8], values: &[(Property, i64)]) -> Result<Vec<u8>, String> {
    let (start, len) = ((STORAGE.start - FLASH.start) as usize, STORAGE.len as usize);
    if bytes.len() != len {
        return Err(format!("standard input: found {} bytes, expected the storage's {len}", bytes.len()));
    }
    let mut flash = SimFlash::default();
    flash.load(STORAGE.start, bytes);
    let mut store = Store::open(&flash);
    values.iter().for_each(|&(property, value)| store.set(property, value));
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
    use boot::storage::Counters;

    fn erased() -> Vec<u8> {
        vec![0xFF; STORAGE.len as usize]
    }

    fn id(number: u8) -> [(Property, i64); 1] {
        [(Property::ID, number.into())]
    }

    fn loaded(bytes: &[u8]) -> SimFlash {
        let mut flash = SimFlash::default();
        flash.load(STORAGE.start, bytes);
        flash
    }

    #[test]
    fn new_id_keeps_everything_else_that_is_stored() {
        let mut flash = loaded(&with(&erased(), &id(3)).expect("an erased storage"));
        let mut store = Store::open(&flash);
        assert_eq!(store.get(Property::ID), Some(3));
        store.set(Property::SN, 4711);
        store.save_position(100, 5);
        let counters = Counters { upsecs: 5000, odometer: 600, ptemp: 421 };
        store.count(counters);
        assert!((0..MAX_STEPS).any(|_| store.step(&mut flash, true) == Progress::Done));
        let mut bytes = flash.bytes()[(STORAGE.start - FLASH.start) as usize..].to_vec();
        // Often enough to fill a page and begin another.
        for number in (1..=7).chain(11..=17).cycle().take(100) {
            bytes = with(&bytes, &id(number)).expect("a storage in use");
            let store = Store::open(&loaded(&bytes));
            assert_eq!(store.get(Property::ID), Some(number.into()));
            assert_eq!(store.get(Property::SN), Some(4711));
            assert_eq!(store.trusted_position(), Some((100, 5)));
            assert_eq!(store.counters(), counters);
        }
    }

    #[test]
    fn arguments_are_stored_properties_in_range() {
        assert_eq!(assignment("ID=14"), Some((Property::ID, 14)));
        assert_eq!(assignment("kind=2"), Some((Property::KIND, 2)));
        for text in
            ["", "14", "ID", "ID=", "ID=0", "ID=32", "KIND=4", "VERS=600", "X9=1", "UPSECS=1", "OTEMP=60"]
        {
            assert_eq!(assignment(text), None, "{text}");
        }
        let bytes = with(&erased(), &[(Property::ID, 14), (Property::KIND, 2)]).expect("an erased storage");
        let store = Store::open(&loaded(&bytes));
        assert_eq!((store.get(Property::ID), store.get(Property::KIND)), (Some(14), Some(2)));
    }

    #[test]
    fn value_after_a_question_mark_keeps_what_is_stored() {
        let shipped = vec![conditional("WIRING?=2").expect("in range")];
        assert_eq!(needed(&erased(), shipped.clone()), [(Property::WIRING, 2)]);
        let learned = with(&erased(), &[(Property::WIRING, 7)]).expect("an erased storage");
        assert_eq!(needed(&learned, shipped), []);
        assert_eq!(
            needed(&learned, vec![conditional("WIRING=0").expect("in range")]),
            [(Property::WIRING, 0)]
        );
    }

    #[test]
    fn same_id_changes_no_byte() {
        let bytes = with(&erased(), &id(7)).expect("an erased storage");
        assert_ne!(bytes, erased());
        assert_eq!(with(&bytes, &id(7)), Ok(bytes));
    }

    #[test]
    fn storage_of_another_length_is_refused() {
        for len in [0, 4096, erased().len() - 1, erased().len() + 1] {
            let error = with(&vec![0xFF; len], &id(1)).expect_err("not the storage");
            assert!(error.contains(&format!("found {len} bytes, expected the storage's 8192")), "{error}");
        }
    }
}
