//! Any content of the storage pages: opened without a panic, and written again.
#![no_main]

use hil_world::rig::flash::SimFlash;
use libfuzzer_sys::fuzz_target;
use boot::storage::{Progress, Store};
use tater_wire::Property;
use tater_f103::map::STORAGE;

fuzz_target!(|input: (u16, i16, &[u8])| {
    let (at, value, bytes) = input;
    let mut flash = SimFlash::default();
    flash.load(STORAGE.start + u32::from(at) % STORAGE.len / 2 * 2, &bytes[..bytes.len().min(1024)]);
    let mut store = Store::open(&flash);
    let counters = store.counters();
    store.set(Property::X0, value.into());
    for _ in 0..5_000 {
        match store.step(&mut flash, true) {
            Progress::Done => break,
            Progress::More => {}
            other => panic!("{other:?}"),
        }
    }
    let again = Store::open(&flash);
    assert_eq!(again.get(Property::X0), Some(value.into()));
    assert_eq!(again.counters(), counters);
});
