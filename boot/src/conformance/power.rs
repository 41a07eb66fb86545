//! What a power cut may leave, played at each operation of a port's flash on a computer.

use super::{Broken, Kept, STEPS, holds};
use crate::chip::Flash;
use crate::storage::{Counters, Progress, Store};
use tater_wire::Property;

/// A flash whose power a test can cut.
pub trait Cut: Flash + Clone {
    /// The power fails in the middle of the operation after so many more. What is left of it follows from the seed: of a unit some
    /// of its zeros, or 0 where the chip's error correction gives it up; of a page anything.
    fn cut_after(&mut self, operations: u32, seed: u32);

    /// The power is back. Returns whether it had failed.
    fn restore(&mut self) -> bool;
}

const BEFORE: Counters = Counters { upsecs: 1_000, odometer: 2_000, ptemp: 300 };
const AFTER: Counters = Counters { upsecs: 1_100, odometer: 2_900, ptemp: 320 };

/// MV of the state that is being stored when the power fails, and of the one after.
const CUT: i64 = 2000;
const AGAIN: i64 = 3000;

/// How a store ended.
#[derive(Clone, Copy)]
struct End {
    failed: bool,
    /// [`Store::distrust`] returned `Ok`.
    distrusted: bool,
}

/// The journal over any cut of a store that holds one state and takes another, from a page that has room and from one that has none.
/// Returns the cuts played.
///
/// # Errors
/// The first promise that is broken.
pub fn survives_power_cuts<F: Cut>(blank: &F, seeds: u32) -> Result<u32, Broken> {
    let mut cuts = 0;
    // A page is full after some forty of these states, whatever its units.
    for states in 1..60 {
        let mut flash = blank.clone();
        let mut store = Store::open(&flash);
        for state in 0..states {
            store.set(Property::MV, 1000 + state);
            store.save_position(30_000, 2);
            store.count(BEFORE);
            store.save_counters();
            settle(&mut store, &mut flash)?;
        }
        let before = Some(999 + states);
        // Two cuts in one flash: the second comes while what the first left is repaired.
        for seed in 0..seeds {
            for at in 0..STEPS {
                let mut flash = flash.clone();
                let end = cut_once(&mut flash, at, seed)?;
                if !end.failed {
                    break;
                }
                cuts += 1;
                recovered(&mut flash, before, end, seed ^ at)?;
                let end = cut_once(&mut flash, at / 2, !seed)?;
                recovered(&mut flash, Some(AGAIN), end, at)?;
            }
        }
    }
    Ok(cuts)
}

fn settle<F: Flash>(store: &mut Store, flash: &mut F) -> Kept {
    let done = (0..STEPS).any(|_| store.step(flash, true) == Progress::Done);
    holds(done, "the journal stores what is due", F::MAP.storage.start, 0_u8)
}

/// Stores another state, consumes the trust, and stores a position anew, with a cut.
fn cut_once<F: Cut>(flash: &mut F, at: u32, seed: u32) -> Result<End, Broken> {
    let mut store = Store::open(flash);
    flash.cut_after(at, seed);
    store.set(Property::MV, CUT);
    store.set_hot(true);
    store.count(AFTER);
    store.save_counters();
    let stores = |store: &mut Store, flash: &mut F| {
        (0..STEPS).any(|_| !matches!(store.step(flash, true), Progress::More | Progress::Waiting))
    };
    let ended = stores(&mut store, flash);
    let distrusted = store.distrust(flash).is_ok();
    store.save_position(-5, 4);
    let ended = ended && stores(&mut store, flash);
    let failed = flash.restore();
    holds(ended, "storing ends", F::MAP.storage.start, at)?;
    if !failed {
        let again = Store::open(flash).trusted_position();
        holds(again == Some((-5, 4)), "a position that was stored is trusted", F::MAP.storage.start, at)?;
    }
    Ok(End { failed, distrusted })
}

/// A start after a cut: one state or the other, the same at each start; and from there on everything is stored again.
fn recovered<F: Cut>(flash: &mut F, before: Option<i64>, end: End, seed: u32) -> Result<(), Broken> {
    let storage = F::MAP.storage.start;
    let mut store = Store::open(flash);
    let again = Store::open(flash);
    let found = store.get(Property::MV);
    let promise = "a cut leaves what was stored before, or what was to be stored";
    holds(found == before || found == Some(CUT), promise, storage, seed)?;
    let counters = store.counters();
    let between = |low: u32, now: u32, high: u32| low <= now && now <= high;
    let counted = between(BEFORE.upsecs, counters.upsecs, AFTER.upsecs)
        && between(BEFORE.odometer, counters.odometer, AFTER.odometer)
        && (BEFORE.ptemp..=AFTER.ptemp).contains(&counters.ptemp);
    holds(counted, "counters never go backwards", storage, counters.upsecs)?;
    let position = store.trusted_position();
    let known = [None, Some((30_000, 2)), Some((-5, 4))].contains(&position);
    holds(known, "a trusted position is one that was stored", storage, seed)?;
    let gone = !end.distrusted || position != Some((30_000, 2));
    holds(gone, "a position that is no longer trusted stays so", storage, seed)?;
    let same = found == again.get(Property::MV) && position == again.trusted_position();
    holds(same && counters == again.counters(), "each start reads the same", storage, seed)?;
    store.set(Property::MV, AGAIN);
    store.save_position(30_000, 2);
    settle(&mut store, flash)?;
    let again = Store::open(flash);
    let stored = again.get(Property::MV) == Some(AGAIN) && again.trusted_position() == Some((30_000, 2));
    holds(stored, "the journal stores again after a cut", storage, seed)
}
