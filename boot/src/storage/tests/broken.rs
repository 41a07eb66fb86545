//! Flash that fails to program or erase.

use super::*;
use crate::tests::PAGE_WORDS;

fn finish_failing(store: &mut Store, flash: &mut Ram) -> usize {
    let mut failed = 0;
    for _ in 0..3000 {
        match store.step(flash, true) {
            Progress::More => {}
            Progress::Failed(_) => failed += 1,
            Progress::Done => return failed,
            Progress::Waiting => panic!("the bridge is off"),
        }
    }
    panic!("no end of it");
}

#[test]
fn failed_page_is_replaced_by_the_next() {
    for at in 0..PAGE_WORDS as u32 {
        let (mut store, mut flash) = fresh();
        store.set(Property::X0, 1);
        store.save_position(5, 1);
        finish(&mut store, &mut flash);
        // The first page's half-words behind that record, and those of the next page.
        let address = STORAGE.start + PAGE / 2 + 2 * at;
        flash.broken.insert(address);
        let mut failed = 0;
        for value in 2..130 {
            store.set(Property::X0, value);
            failed += finish_failing(&mut store, &mut flash);
            let open = Store::open(&flash);
            assert_eq!(
                (open.get(Property::X0), open.trusted_position()),
                (Some(value), Some((5, 1))),
                "{at}"
            );
        }
        // Marks of trust and of prepared pages are not repeated here.
        assert!(failed <= 1, "half-word {at}: failed {failed} times");
    }
}

#[test]
fn abandoned_record_is_never_the_newest() {
    for at in 0..PAGE_WORDS as u32 {
        let (mut store, mut flash) = fresh();
        store.set(Property::X0, 1);
        finish(&mut store, &mut flash);
        // As above; but the half-word that verified wrong was right, so the record may be complete.
        flash.late = Some(STORAGE.start + PAGE / 2 + 2 * at);
        let mut failed = 0;
        for value in 2..100 {
            // Records of several lengths and single half-words: some fit where the abandoned one did not.
            store.set(Property::X0, value);
            if value % 3 == 0 {
                for property in [Property::X1, Property::X2, Property::X3] {
                    store.set(property, value);
                }
            }
            failed += finish_failing(&mut store, &mut flash);
            let counters = Counters { upsecs: 58 * value as u32, ..Counters::default() };
            store.count(counters);
            failed += finish_failing(&mut store, &mut flash);
            let open = Store::open(&flash);
            let found = [Property::X0, Property::X1].map(|property| open.get(property));
            let third = value / 3 * 3;
            assert_eq!(found, [Some(value), (third > 0).then_some(third)], "{at}");
            assert_eq!(open.counters(), counters, "{at}");
        }
        assert!(failed <= 1, "half-word {at}: failed {failed} times");
    }
}

#[test]
fn broken_flash_is_not_worn_out_by_retries() {
    let (mut store, mut flash) = fresh();
    store.set(Property::X0, 1);
    finish(&mut store, &mut flash);
    let good = flash.clone();
    flash.broken.extend((STORAGE.start..STORAGE.end()).step_by(2));
    store.set(Property::X0, 2);
    let (programmed, erased) = (flash.programmed, flash.erased);
    for _ in 0..10_000 {
        store.step(&mut flash, false);
        store.step(&mut flash, true);
    }
    for may_erase in [false, true] {
        assert!(matches!(store.step(&mut flash, may_erase), Progress::Failed(_)));
    }
    assert!(flash.programmed - programmed <= 8 && flash.erased - erased <= 8, "once a page");
    assert_eq!(Store::open(&flash).get(Property::X0), Some(1), "what was stored is still there");
    flash.broken = good.broken;
    let mut store = Store::open(&flash);
    store.set(Property::X0, 3);
    finish(&mut store, &mut flash);
    assert_eq!(Store::open(&flash).get(Property::X0), Some(3));
}

#[test]
fn pages_that_cannot_be_erased_are_left_out() {
    // All but two: the last resort is the page before the current one.
    let broken = [0, 1, 2, 4, 5, 7].map(|page| MAP.page(STORAGE, page)).into();
    let mut flash = Ram { broken, ..Ram::default() };
    let mut store = Store::open(&flash);
    let failed = finish_failing(&mut store, &mut flash);
    assert_eq!((failed, flash.erased), (6, 8));
    for value in 0..1000 {
        store.set(Property::X0, value);
        assert_eq!(finish_failing(&mut store, &mut flash), 0);
        assert_eq!(Store::open(&flash).get(Property::X0), Some(value));
    }
}

#[test]
fn unerasable_mark_is_followed_by_a_record_without_trust() {
    let (mut store, mut flash) = fresh();
    store.save_position(5, 1);
    finish(&mut store, &mut flash);
    flash.broken.insert(store.live.unwrap());
    assert_eq!(store.distrust(&mut flash), Err(FlashError::Verify));
    assert_eq!(store.trusted_position(), None);
    assert_eq!(finish_failing(&mut store, &mut flash), 1, "the dead mark is tried once more");
    assert_eq!(store.distrust(&mut flash), Ok(()));
    let open = Store::open(&flash);
    assert_eq!((open.trusted_position(), open.get(Property::P)), (None, Some(5)));
}

#[test]
fn record_with_an_unerasable_mark_is_abandoned() {
    let (mut store, mut flash) = fresh();
    store.set(Property::X0, 1);
    finish(&mut store, &mut flash);
    store.save_position(5, 1);
    store.step(&mut flash, true);
    let mark = store.writing.as_ref().unwrap().mark::<Ram>().unwrap();
    flash.broken.insert(mark);
    assert_eq!(store.distrust(&mut flash), Ok(()));
    finish_failing(&mut store, &mut flash);
    let open = Store::open(&flash);
    assert_eq!(
        (open.trusted_position(), open.get(Property::P), open.get(Property::X0)),
        (None, Some(5), Some(1))
    );
}
