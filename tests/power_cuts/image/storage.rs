//! Cuts in what the application stores: first preparation, SAVE of one and of all, DEF, an ordered reset.

use board_emu::image::Programs;
use boot::storage::LOSS;
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_f103::map::{FLASH, STORAGE};
use tater_wire::Property;

use super::super::storage::State;
use super::{Story, flash_of, initial, is_cut, monitor, start, state_of, wait_for, wake};
use crate::emulated::bench::{Bench, production};

/// The programs, and a storage with random contents, which its first preparation erases.
fn unprepared(programs: &Programs) -> Vec<u8> {
    let mut bytes = initial(programs);
    let mut rng = Pcg64Mcg::new(3);
    bytes[(STORAGE.start - FLASH.start) as usize..].iter_mut().for_each(|byte| *byte = rng.random());
    bytes
}

const LOOKED_AT: [Property; 4] = [Property::MT, Property::X1, Property::X2, Property::X6];

/// One operation in so many is cut,
const EACH: usize = 2;

/// and the last ones of an act more often.
const LAST: usize = 4;

/// Waits for 400 ms without an operation; before an erase the rotor must have stood for 200 ms.
fn quiet(bench: &mut Bench) {
    loop {
        let before = operations(bench);
        bench.wait_ms(400);
        if operations(bench) == before || is_cut(bench) {
            return;
        }
    }
}

fn operations(bench: &Bench) -> usize {
    bench.board().machine().chip().flash.log().len()
}

fn save(bench: &mut Bench, values: &[(Property, i64)], id: i64) {
    for &(property, value) in values {
        bench.set(property, value);
    }
    bench.set(Property::SAVE, id);
}

const ACTS: [fn(&mut Bench); 9] = [
    |bench| {
        bench.wait_ms(4);
        bench.set(Property::STAT, 2);
    },
    |bench| save(bench, &[(Property::MT, 700)], Property::MT.id().into()),
    |bench| save(bench, &[(Property::MT, 800), (Property::X1, 11), (Property::X6, -6)], -1),
    |bench| {
        bench.set(Property::MT, 900);
        bench.set(Property::LOAD, Property::MT.id().into());
    },
    |bench| bench.set(Property::DEF, Property::X1.id().into()),
    |bench| save(bench, &[(Property::X1, 1), (Property::X2, 2)], Property::X2.id().into()),
    |bench| {
        bench.set(Property::M, 100);
        bench.wait_ms(900);
        bench.set(Property::STAT, 0);
        bench.wait_ms(500);
    },
    |bench| {
        bench.set(Property::STAT, 2);
        bench.wait_ms(100);
        save(bench, &[(Property::MT, 650), (Property::X1, 21), (Property::X2, 22), (Property::X6, 23)], -1);
    },
    |bench| bench.set(Property::DEF, -1),
];

fn act(bench: &mut Bench) {
    for act in ACTS {
        act(bench);
        quiet(bench);
        if is_cut(bench) {
            return;
        }
    }
}

fn run(bench: &mut Bench) -> Vec<usize> {
    let done = |act: &fn(&mut Bench)| {
        act(bench);
        quiet(bench);
        operations(bench)
    };
    ACTS.iter().map(done).collect()
}

/// A cut leaves all values of one state, the position trusted only if it was, and counters within their allowed loss.
fn is_between(found: &State, old: &State, new: &State) -> bool {
    let (counters, least, most) = (found.counters, old.counters, new.counters);
    [old, new].iter().any(|state| found.values == state.values)
        && [old.trusted, new.trusted, None].contains(&found.trusted)
        && (least.upsecs.saturating_sub(LOSS.upsecs)..=most.upsecs).contains(&counters.upsecs)
        && (least.odometer.saturating_sub(LOSS.odometer)..=most.odometer).contains(&counters.odometer)
        && (least.ptemp.min(0)..=most.ptemp).contains(&counters.ptemp)
}

fn recover(programs: &Programs, bytes: &[u8], found: &State, defaults: &[Option<i64>]) {
    let mut bench = start(programs, bytes);
    monitor(&mut bench);
    wake(&mut bench);
    for (property, &default) in LOOKED_AT.into_iter().zip(defaults) {
        let expected = found.values.get(&property).copied().or(default);
        assert_eq!(bench.get(property), expected, "{property:?}");
    }
    let again = 1 + found.values.get(&Property::X1).copied().unwrap_or(0);
    save(&mut bench, &[(Property::X1, again)], Property::X1.id().into());
    wait_for(&mut bench, Property::X1, again, 500);
    let end = bench.bus.now_us() + 2_000_000;
    while state_of(&flash_of(&bench)).values.get(&Property::X1) != Some(&again) {
        assert!(bench.bus.now_us() < end, "it does not store again");
        bench.wait_ms(10);
    }
    let mut expected = found.values.clone();
    expected.insert(Property::X1, again);
    assert_eq!(state_of(&flash_of(&bench)).values, expected, "and nothing else is lost");
}

#[test]
fn cut_storage_of_the_image_is_old_or_new() {
    let Some(programs) = production() else { return };
    let mut bench = start(&programs, &unprepared(&programs));
    monitor(&mut bench);
    wake(&mut bench);
    let defaults = LOOKED_AT.map(|property| bench.get(property));
    assert!(defaults.iter().all(Option::is_some), "{defaults:?}");

    let mut bench = start(&programs, &unprepared(&programs));
    let done = run(&mut bench);
    assert!(bench.board().problem().is_none(), "{:?}", bench.board().problem());
    let story = Story::of(unprepared(&programs), &bench);
    let states: Vec<State> = [0].iter().chain(&done).map(|&at| state_of(&story.before(at))).collect();
    let value = |state: &State, property| state.values.get(&property).copied();
    let mt = states.iter().map(|state| value(state, Property::MT));
    let expected =
        [None, None, Some(700), Some(800), Some(800), Some(800), Some(800), Some(800), Some(650), None];
    assert!(mt.eq(expected), "{states:#?}");
    for operation in [1, done[0] + 2, done[1] + 5, done[4] + 1] {
        story.really_cut(&programs, operation, 5, act);
    }
    let last = done.iter().flat_map(|&at| (at.saturating_sub(2)..at).flat_map(|at| [at; LAST]));
    let cuts: Vec<usize> = (0..story.log.len()).step_by(EACH).chain(last).collect();
    for (seed, &operation) in cuts.iter().enumerate() {
        let before = done.partition_point(|&at| at <= operation);
        let flash = story.cut(operation, seed as u64);
        let found = state_of(&flash);
        let (old, new) = (&states[before], &states[before + 1]);
        assert!(
            is_between(&found, old, new),
            "operation {operation}: {found:#?}\nis neither {old:#?}\nnor {new:#?}"
        );
        recover(&programs, flash.bytes(), &found, &defaults);
    }
    println!(
        "figure: power cuts of the image, storage: {} in {} flash operations",
        cuts.len(),
        story.log.len()
    );
    // With those of the download at least 200.
    assert!(cuts.len() >= 100, "{}", cuts.len());
}
