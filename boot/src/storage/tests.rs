mod broken;
mod model;

use super::record::{self, Head};
use super::word::Word;
use super::*;
use crate::chip::Flash;
use crate::tests::{MAP, PAGE, PAGE_WORDS, STORAGE};
use std::collections::BTreeSet;
use std::vec::Vec;
use tater_wire::map::Map;
use tater_wire::property::ROWS;

/// Where the records of a page begin.
const FIRST: usize = first::<Ram>();

/// The storage pages with the F103's rules, and with half-words and pages that fail on request.
#[derive(Clone)]
struct Ram {
    words: Vec<u16>,
    programmed: usize,
    erased: usize,
    /// Addresses where a program fails, or, for the first of a page, an erase.
    broken: BTreeSet<u32>,
    /// An address that reads wrong once, right after its program, and correctly afterwards.
    late: Option<u32>,
}

impl Default for Ram {
    fn default() -> Self {
        let words = std::vec![u16::MAX; STORAGE.len as usize / 2];
        Self { words, programmed: 0, erased: 0, broken: BTreeSet::new(), late: None }
    }
}

impl Ram {
    fn index(address: u32) -> usize {
        (address.checked_sub(STORAGE.start).expect("writes only the storage") / 2) as usize
    }
}

impl Flash for Ram {
    const MAP: Map = MAP;

    fn half_word(&self, address: u32) -> u16 {
        self.words[Self::index(address)]
    }

    fn program(&mut self, address: u32, unit: &[u16]) -> Result<(), FlashError> {
        let &[value] = unit else { return Err(FlashError::Address) };
        self.programmed += 1;
        let word = &mut self.words[Self::index(address)];
        if *word != u16::MAX && value != 0 {
            return Err(FlashError::NotErased);
        }
        if self.broken.contains(&address) {
            return Err(FlashError::Verify);
        }
        *word = value;
        if value != 0 && self.late.take_if(|late| *late == address).is_some() {
            return Err(FlashError::Verify);
        }
        Ok(())
    }

    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        assert!(page.is_multiple_of(PAGE));
        self.erased += 1;
        if self.broken.contains(&page) {
            return Err(FlashError::Verify);
        }
        let at = Self::index(page);
        self.words[at..at + PAGE_WORDS].fill(u16::MAX);
        Ok(())
    }
}

/// Steps until nothing more is to do or can be done; returns the number of steps that did something.
fn finish(store: &mut Store, flash: &mut Ram) -> usize {
    for steps in 0..3000 {
        match store.step(flash, true) {
            Progress::More => {}
            Progress::Done => return steps,
            other => panic!("{other:?}"),
        }
    }
    panic!("no end of it");
}

fn fresh() -> (Store, Ram) {
    let mut flash = Ram::default();
    let mut store = Store::open(&flash);
    finish(&mut store, &mut flash);
    (store, flash)
}

fn encode(head: &Head, entries: &mut dyn Iterator<Item = (u8, Option<i32>)>) -> Vec<u16> {
    let mut words = heapless::Vec::new();
    record::encode(&mut words, head, entries);
    with_crc(words.to_vec())
}

fn with_crc(mut words: Vec<u16>) -> Vec<u16> {
    let mut digest = tater_wire::image::Crc32::default();
    words.iter().for_each(|word| digest.update(&word.to_le_bytes()));
    words.extend(record::halves(digest.finish()));
    words
}

fn stored() -> Vec<Property> {
    ROWS.iter().filter(|row| row.stored == Stored::Yes).map(|row| row.property).collect()
}

#[test]
fn all_stored_properties_fit() {
    // 62: the number in the module's documentation, on which its arithmetic is based.
    assert_eq!(stored().len(), 62);
    for property in stored() {
        let row = property.row();
        assert!(i32::try_from(row.min).is_ok() && i32::try_from(row.max).is_ok(), "{property:?}");
    }
    let always: Vec<u8> =
        ROWS.iter().filter(|row| row.stored == Stored::Always).map(|row| row.property.id()).collect();
    assert!(always.iter().all(|id| COUNTERS.contains(id)) && always.len() == COUNTERS.len());
    // Of the 20 KiB of RAM; less on the microcontroller, where usize is 4 bytes.
    assert!(size_of::<Store>() <= 1472, "{}", size_of::<Store>());
}

#[test]
fn set_and_forgotten_values_read_back() {
    let (mut store, mut flash) = fresh();
    assert_eq!((store.get(Property::MT), store.counters()), (None, Counters::default()));
    store.set(Property::MT, 500);
    store.set(Property::TSTOP, 65_535);
    store.set(Property::IVEL, -200);
    finish(&mut store, &mut flash);
    let mut store = Store::open(&flash);
    let read = |store: &Store| [Property::MT, Property::TSTOP, Property::IVEL].map(|p| store.get(p));
    assert_eq!(read(&store), [Some(500), Some(65_535), Some(-200)]);
    store.forget(Property::TSTOP);
    assert_eq!(read(&store), [Some(500), None, Some(-200)]);
    finish(&mut store, &mut flash);
    assert_eq!(read(&Store::open(&flash)), [Some(500), None, Some(-200)]);
}

#[test]
fn unstored_or_out_of_range_values_are_refused() {
    let (mut store, mut flash) = fresh();
    store.set(Property::TEMP, 300);
    store.set(Property::UPSECS, 300);
    store.set(Property::MT, 991);
    store.set(Property::MT, i64::MAX);
    store.save_position(32_768, 1);
    assert_eq!(
        (store.get(Property::TEMP), store.get(Property::MT), store.trusted_position()),
        (None, None, None)
    );
    assert_eq!(finish(&mut store, &mut flash), 0);
}

#[test]
fn save_takes_the_stated_half_words() {
    let (mut store, mut flash) = fresh();
    let save = |value: fn(&Property) -> i64, store: &mut Store, flash: &mut Ram| {
        let before = flash.programmed;
        stored().iter().for_each(|property| store.set(*property, value(property)));
        finish(store, flash);
        flash.programmed - before
    };
    // The first record is a complete one: head 4, counters and the unit of OD 4 x 2, properties 2 each, and ACCEL, TSTOP, HOSTMS, MR, MWJ, MWR, MKA and MKE
    // 1 more, CRC 2.
    assert_eq!(save(|p| p.row().max, &mut store, &mut flash), 4 + 4 * 2 + 62 * 2 + 8 + 2);
    assert_eq!(save(|p| p.row().max, &mut store, &mut flash), 0, "nothing has changed");
    // HOSTUNITS has two values.
    let other = |p: &Property| if *p == Property::HOSTUNITS { 0 } else { p.row().max - 1 };
    assert_eq!(save(other, &mut store, &mut flash), 4 + 62 * 2 + 8 + 2);
    store.set(Property::X0, 5);
    assert_eq!(finish(&mut store, &mut flash), 1 + 8, "made, and written");
    // The longest complete one: counters that need 32 bits.
    store.reset_counters(Counters { upsecs: 1 << 31, odometer: 1 << 20, ptemp: 900 });
    finish(&mut store, &mut flash);
    store.record(true);
    assert_eq!(store.words.len() + record::TAIL, 4 + 3 + 3 + 2 + 2 + 62 * 2 + 8 + 2);
    assert_eq!(Store::open(&flash).counters(), store.counters());
}

#[test]
fn sets_before_a_record_are_stored_together() {
    let (mut store, mut flash) = fresh();
    store.set(Property::X0, 1);
    finish(&mut store, &mut flash);
    store.set(Property::X0, 2);
    store.set(Property::X1, 2);
    let both = |flash: &Ram| [Property::X0, Property::X1].map(|p| Store::open(flash).get(p));
    let mut seen = std::vec![both(&flash)];
    for _ in 0..11 {
        store.step(&mut flash, false);
        seen.push(both(&flash));
        store.set(Property::X1, 3);
    }
    // A record of two is 10 half-words; it counts with the last.
    assert_eq!(seen[..11], [[Some(1), None]; 11]);
    assert_eq!(seen[11], [Some(2), Some(2)]);
}

#[test]
fn forget_all_keeps_locked_properties() {
    let (mut store, mut flash) = fresh();
    stored().iter().for_each(|property| store.set(*property, property.row().max));
    store.save_position(5, 1);
    finish(&mut store, &mut flash);
    store.forget_open();
    assert_eq!(store.trusted_position(), None);
    finish(&mut store, &mut flash);
    for store in [store, Store::open(&flash)] {
        let left: Vec<Property> = stored().into_iter().filter(|p| store.get(*p).is_some()).collect();
        assert_eq!(left, [Property::ROLE, Property::SN, Property::ID, Property::WIRING, Property::KIND]);
    }
}

#[test]
fn erase_waits_while_the_bridge_is_on() {
    let mut flash = Ram::default();
    let mut store = Store::open(&flash);
    assert_eq!(store.step(&mut flash, false), Progress::Done, "nothing to store");
    store.set(Property::X0, 1);
    assert_eq!(store.step(&mut flash, false), Progress::Waiting);
    assert_eq!((flash.programmed, flash.erased), (0, 0));
    finish(&mut store, &mut flash);
    let erased = flash.erased;
    let mut records = 0;
    'full: for value in 2..5000 {
        store.set(Property::X0, value);
        for _ in 0..100 {
            match store.step(&mut flash, false) {
                Progress::More => {}
                Progress::Done => break,
                _ => break 'full,
            }
        }
        records += 1;
    }
    // Eight pages: each half-words for a mark, a complete record of 16, and (512 - 17) / 8 = 61 others. One
    // existed already.
    assert_eq!(records, 8 * 62 - 1);
    assert_eq!(flash.erased, erased);
    let last = store.get(Property::X0);
    assert_eq!(
        Store::open(&flash).get(Property::X0),
        last.map(|value| value - 1),
        "the one that waits is not in"
    );
    finish(&mut store, &mut flash);
    assert_eq!(Store::open(&flash).get(Property::X0), last);
}

#[test]
fn numbers_of_another_version_are_kept_or_skipped() {
    let head = Head { sequence: 7, complete: true, trusted: None };
    let entries = [
        (6, Some(-5)),
        (Property::MT.id(), Some(70_000)),
        (127, Some(1 << 20)),
        (Property::X0.id(), Some(3)),
    ];
    let mut words = encode(&head, &mut entries.into_iter());
    // A value of five half-words, before the CRC.
    words.truncate(words.len() - 2);
    words.extend([7 | 5 << 8, 1, 2, 3, 4, 5]);
    words[0] = Word::Record(words.len() as u16 + 2).encode();
    let words = with_crc(words);
    let mut flash = Ram::default();
    flash.words[FIRST..FIRST + words.len()].copy_from_slice(&words);

    let mut store = Store::open(&flash);
    assert_eq!(store.get(Property::X0), Some(3));
    assert_eq!(store.get(Property::MT), None, "beyond this version's range");
    for value in 0..200 {
        store.set(Property::X0, value);
        finish(&mut store, &mut flash);
    }
    let store = Store::open(&flash);
    assert!(store.pages.current() != Store::open(&Ram::default()).pages.current());
    let kept = |id| store.values.get(id);
    assert_eq!([6, 7, 127, Property::MT.id()].map(kept), [Some(-5), None, Some(1 << 20), Some(70_000)]);
}

#[test]
fn every_number_that_this_program_does_not_know_is_kept() {
    let head = Head { sequence: 7, complete: true, trusted: None };
    let own = |id: &u8| Property::is_stored(*id) || COUNTERS.contains(id) || [HOT, UNIT].contains(id);
    let others: Vec<u8> = (0..128).filter(|id| !own(id)).collect();
    let words = encode(&head, &mut others.iter().map(|id| (*id, Some(1 << 20))));
    let mut flash = Ram::default();
    flash.words[FIRST..FIRST + words.len()].copy_from_slice(&words);
    let mut store = Store::open(&flash);
    stored().iter().for_each(|property| store.set(*property, property.row().max));
    // The next record is a complete one.
    store.pages.close();
    finish(&mut store, &mut flash);
    let store = Store::open(&flash);
    assert!(stored().iter().all(|property| store.get(*property) == Some(property.row().max)));
    assert!(others.iter().all(|id| store.values.get(*id) == Some(1 << 20)));
}

#[test]
fn page_is_continued_after_a_restart() {
    let (mut store, mut flash) = fresh();
    store.set(Property::X0, 1);
    finish(&mut store, &mut flash);
    for round in 2..20 {
        let mut store = Store::open(&flash);
        let before = flash.programmed;
        store.set(Property::X0, round);
        finish(&mut store, &mut flash);
        // A complete record, in another page, has the counters as well.
        assert_eq!(flash.programmed - before, 8, "round {round}");
    }
    assert_eq!(Store::open(&flash).get(Property::X0), Some(19));
}

/// Computed by hand from the tables in `record.rs` and `word.rs`, and the CRC by another program: boards have it in their flash.
#[test]
fn layout_is_frozen() {
    let head = Head { sequence: 0x1_2345, complete: true, trusted: Some(5) };
    let entries = [(10, Some(-2)), (20, Some(0x1_2345)), (30, None)];
    let begin = [0x8C0C, 0x101D, 0x2345, 1];
    let entries_and_crc = [0x010A, 0xFFFE, 0x0214, 0x2345, 1, 0x001E, 0xC52B, 0x8AE6];
    assert_eq!(encode(&head, &mut entries.into_iter()), [begin.as_slice(), &entries_and_crc].concat());
    let words = [Word::Time(58), Word::Travel(6), Word::Heat(1), Word::HOT, Word::COOL];
    assert_eq!(words.map(Word::encode), [0x803A, 0x9406, 0xA801, 0xB800, 0xB400]);
}

#[test]
fn record_may_end_with_its_page() {
    let (mut store, mut flash) = fresh();
    store.set(Property::X0, 1);
    finish(&mut store, &mut flash);
    let (page, at) = store.pages.room::<Ram>(8).unwrap();
    // Words that change nothing, up to the length of a record of one property.
    let start = Ram::index(page.address::<Ram>(0));
    flash.words[start + at..start + PAGE_WORDS - 8].fill(Word::COOL.encode());
    let mut store = Store::open(&flash);
    let before = flash.programmed;
    store.set(Property::X0, 2);
    finish(&mut store, &mut flash);
    assert_eq!((flash.programmed - before, store.pages.current()), (8, Some(page)));
    let store = Store::open(&flash);
    assert_eq!((store.get(Property::X0), store.is_damaged(&flash)), (Some(2), false));
}

#[test]
fn trusted_record_needs_room_for_its_mark_as_well() {
    for (room, same_page) in [(9, true), (8, false)] {
        let (mut store, mut flash) = fresh();
        store.set(Property::P, 1);
        finish(&mut store, &mut flash);
        let (page, at) = store.pages.room::<Ram>(1).unwrap();
        let start = Ram::index(page.address::<Ram>(0));
        flash.words[start + at..start + PAGE_WORDS - room].fill(Word::COOL.encode());
        let mut store = Store::open(&flash);
        // Head, number and value of P, CRC, mark.
        store.save_position(-40, 5);
        finish(&mut store, &mut flash);
        assert_eq!(store.pages.current() == Some(page), same_page, "room for {room}");
        assert_eq!(Store::open(&flash).trusted_position(), Some((-40, 5)));
    }
}

/// ERROR 8 at a start: something that was stored cannot be read.
#[test]
fn records_and_pages_that_cannot_be_read_are_damage() {
    let is_damaged = |flash: &Ram| Store::open(flash).is_damaged(flash);
    assert!(!is_damaged(&Ram::default()), "a new chip");
    let (mut store, mut flash) = fresh();
    let mut round = 0;
    while store.pages.previous().is_none() {
        round += 1;
        store.set(Property::X0, round);
        finish(&mut store, &mut flash);
    }
    assert!(!is_damaged(&flash));
    let (page, at) = store.pages.room::<Ram>(1).unwrap();
    let start = Ram::index(page.address::<Ram>(0));
    store.set(Property::X0, round + 1);
    finish(&mut store, &mut flash);
    assert!(!is_damaged(&flash));

    let mut last = flash.clone();
    last.words[start + at + 5] = 0;
    assert!(is_damaged(&last), "the last record of the page");

    let mut newest = flash;
    newest.words[start + FIRST + 4] = 0;
    assert_eq!(Store::open(&newest).get(Property::X0), Some(round - 1), "the page before");
    assert!(is_damaged(&newest), "a page that was begun later");
    newest.words[start + FIRST + 2] = 0;
    assert!(is_damaged(&newest), "its number is wrong as well");
    newest.words[start] = 0;
    assert!(!is_damaged(&newest), "a page that is being erased");
}

#[test]
fn first_page_without_its_number_is_damage() {
    let (mut store, mut flash) = fresh();
    store.set(Property::X0, 1);
    finish(&mut store, &mut flash);
    let start = Ram::index(store.pages.current().unwrap().address::<Ram>(0));
    flash.words[start + FIRST + 2] = 0;
    for first in [0x5AC3, 0] {
        flash.words[start] = first;
        let store = Store::open(&flash);
        assert_eq!((store.get(Property::X0), store.is_damaged(&flash)), (None, true));
    }
}

#[test]
fn entry_that_exceeds_its_record_is_left_out() {
    let head = Head { sequence: 7, complete: true, trusted: None };
    let mut words = encode(&head, &mut core::iter::once((Property::X0.id(), Some(5))));
    // The entry's value would be half of the CRC.
    words.truncate(5);
    words[0] = Word::Record(7).encode();
    let words = with_crc(words);
    let mut flash = Ram::default();
    flash.words[0] = 0x5AC3;
    flash.words[FIRST..FIRST + words.len()].copy_from_slice(&words);
    assert_eq!(Store::open(&flash).get(Property::X0), None);
}

#[test]
fn counters_are_stored_sparingly_while_no_page_is_ready() {
    let (mut store, mut flash) = fresh();
    let mut round = 0;
    while store.pages.has_ready() {
        round += 1;
        store.set(Property::X0, round);
        while store.step(&mut flash, false) == Progress::More {}
    }
    let before = flash.programmed;
    let grown = Counters { upsecs: STEP.upsecs, ..store.counters() };
    store.count(grown);
    assert_eq!((store.step(&mut flash, false), flash.programmed), (Progress::Done, before));
    store.count(Counters { upsecs: SPARING.upsecs, ..grown });
    while store.step(&mut flash, false) == Progress::More {}
    assert_eq!(flash.programmed, before + 1);
}

#[test]
fn forgotten_values_are_not_counted() {
    let mut values = Values::new();
    (1..5).for_each(|number| values.insert(number, 0));
    let mut numbers = Numbers::default();
    (3..9).for_each(|number| numbers.insert(number));
    values.forget(numbers);
    assert_eq!(values.numbers().iter().count(), 2);
}

#[test]
fn record_of_a_length_that_none_has_is_skipped() {
    for len in (0..6).chain([511, 512, 1023]) {
        let (mut store, mut flash) = fresh();
        store.set(Property::X0, 1);
        finish(&mut store, &mut flash);
        let (page, at) = store.pages.room::<Ram>(1).unwrap();
        flash.words[Ram::index(page.address::<Ram>(at))] = Word::Record(len).encode();
        assert_eq!(Store::open(&flash).get(Property::X0), Some(1), "{len}");
    }
}

#[test]
fn page_before_the_current_one_survives_until_it_is_needed() {
    let (mut store, mut flash) = fresh();
    // Over the whole ring, so that pages have been erased ahead.
    for round in 0..1000 {
        store.set(Property::X0, round);
        finish(&mut store, &mut flash);
    }
    assert!(flash.erased > 8, "{}", flash.erased);
    let page = store.pages.current().unwrap();
    let first = (0..1000).find(|_| {
        let round = store.get(Property::X0).unwrap() + 1;
        store.set(Property::X0, round);
        finish(&mut store, &mut flash);
        store.pages.current() != Some(page)
    });
    assert!(first.is_some(), "a new page");
    let last = store.get(Property::X0).unwrap();
    // The current page is damaged: what is lost is what it has.
    let at = Ram::index(store.pages.current().unwrap().address::<Ram>(0));
    flash.words[at..at + PAGE_WORDS].fill(0);
    assert_eq!(Store::open(&flash).get(Property::X0), Some(last - 1));
}

#[test]
fn foreign_contents_are_ignored() {
    for words in [std::vec![0; 4096], std::vec![u16::MAX; 4096], std::vec![0x5AC3; 4096]] {
        let mut flash = Ram { words, ..Ram::default() };
        let mut store = Store::open(&flash);
        assert_eq!((store.counters(), store.trusted_position()), (Counters::default(), None));
        assert!(stored().iter().all(|property| store.get(*property).is_none()));
        store.set(Property::MT, 1);
        finish(&mut store, &mut flash);
        assert_eq!(Store::open(&flash).get(Property::MT), Some(1));
    }
    let head = Head { sequence: 7, complete: true, trusted: None };
    let mut words = encode(&head, &mut core::iter::once((Property::MT.id(), Some(5))));
    words[1] ^= 3 << 12;
    words.truncate(words.len() - 2);
    let words = with_crc(words);
    let mut flash = Ram::default();
    flash.words[FIRST..FIRST + words.len()].copy_from_slice(&words);
    assert_eq!(Store::open(&flash).get(Property::MT), None);
    flash.words[FIRST + 1] ^= 3 << 12;
    assert_eq!(Store::open(&flash).get(Property::MT), None, "the CRC covers the version");
}

#[test]
fn trust_lasts_until_it_is_consumed() {
    let (mut store, mut flash) = fresh();
    let trusted = |flash: &Ram| Store::open(flash).trusted_position();
    store.distrust(&mut flash).unwrap();
    assert_eq!(flash.programmed, 8, "eight pages prepared, and nothing to distrust");
    store.save_position(-40, 5);
    assert_eq!(trusted(&flash), None);
    finish(&mut store, &mut flash);
    assert_eq!((trusted(&flash), Store::open(&flash).get(Property::P)), (Some((-40, 5)), Some(-40)));
    for value in 0..100 {
        store.set(Property::X0, value);
        finish(&mut store, &mut flash);
        assert_eq!(trusted(&flash), Some((-40, 5)));
    }
    let mut store = Store::open(&flash);
    let before = flash.programmed;
    store.distrust(&mut flash).unwrap();
    store.distrust(&mut flash).unwrap();
    assert_eq!((flash.programmed - before, trusted(&flash)), (1, None));
    assert_eq!(Store::open(&flash).get(Property::P), Some(-40), "still stored");
    for value in 0..100 {
        store.set(Property::X1, value);
        finish(&mut store, &mut flash);
        assert_eq!(trusted(&flash), None, "dead marks stay dead");
    }
    store.save_position(-40, 5);
    finish(&mut store, &mut flash);
    assert_eq!(trusted(&flash), Some((-40, 5)), "the same place, stored anew");
    store.set(Property::P, -40);
    assert_eq!(store.trusted_position(), None);
    finish(&mut store, &mut flash);
    assert_eq!(trusted(&flash), None, "SAVE of P alone says nothing about trust");
}

#[test]
fn trust_in_a_record_being_written_is_consumed_too() {
    // The second record with a position is complete, or one of a property.
    for turns in [false, true] {
        for steps in 0..40 {
            let (mut store, mut flash) = fresh();
            store.save_position(7, 3);
            finish(&mut store, &mut flash);
            if turns {
                store.pages.add(510 - store.pages.room::<Ram>(1).unwrap().1);
            }
            store.save_position(8, 2);
            for _ in 0..steps {
                store.step(&mut flash, true);
            }
            store.distrust(&mut flash).unwrap();
            assert_eq!(Store::open(&flash).trusted_position(), None);
            finish(&mut store, &mut flash);
            let store = Store::open(&flash);
            assert_eq!((store.trusted_position(), store.get(Property::P)), (None, Some(8)));
            // No older mark may be believed either.
            let marks = (0..8_u32).filter_map(|page| {
                let mut wiped = flash.clone();
                wiped.erase(MAP.page(STORAGE, page)).unwrap();
                Store::open(&wiped).trusted_position()
            });
            assert_eq!(marks.count(), 0, "{turns} {steps}");
        }
    }
}

#[test]
fn position_of_another_version_beyond_the_range_is_not_trusted() {
    let head = Head { sequence: 7, complete: true, trusted: Some(1) };
    let words = encode(&head, &mut core::iter::once((Property::P.id(), Some(40_000_000))));
    let mut flash = Ram::default();
    flash.words[FIRST..FIRST + words.len()].copy_from_slice(&words);
    let store = Store::open(&flash);
    assert_eq!((store.get(Property::P), store.trusted_position()), (None, None));
}

#[test]
fn mark_left_by_a_power_cut_is_voided_at_the_start() {
    for turns in [false, true] {
        let (mut store, mut flash) = fresh();
        store.save_position(5, 1);
        finish(&mut store, &mut flash);
        let old = store.live.unwrap();
        if turns {
            store.pages.add(510 - store.pages.room::<Ram>(1).unwrap().1);
        }
        store.save_position(6, 2);
        let written = (0..3000).any(|_| {
            store.step(&mut flash, true);
            store.obsolete.is_some()
        });
        assert!(written);
        // The power fails here: the new record is complete, the old mark is not yet void.
        let new = store.live.unwrap();
        let mut started = Store::open(&flash);
        assert_eq!(started.trusted_position(), Some((6, 2)));
        let mut other = flash.clone();
        let mut driven = Store::open(&other);
        finish(&mut started, &mut flash);
        assert_eq!([old, new].map(|mark| flash.half_word(mark)), [0, u16::MAX], "{turns}");
        driven.distrust(&mut other).unwrap();
        assert_eq!([old, new].map(|mark| other.half_word(mark)), [0, 0], "{turns}");
        // The record that voided it is damaged later: the CRC's last half-word is before the mark.
        other.words[Ram::index(new) - 1] ^= 1;
        assert_eq!(Store::open(&other).trusted_position(), None, "{turns}");
    }
}

#[test]
fn half_programmed_mark_is_distrusted_and_completed() {
    let (mut store, mut flash) = fresh();
    store.save_position(7, 3);
    finish(&mut store, &mut flash);
    let mark = Ram::index(store.live.unwrap());
    flash.words[mark] = 0xFFFE;
    let mut store = Store::open(&flash);
    assert_eq!(store.trusted_position(), None);
    store.distrust(&mut flash).unwrap();
    assert_eq!(flash.words[mark], 0);
}

#[test]
fn counters_are_stored_when_due_and_decrease_only_when_set() {
    let (mut store, mut flash) = fresh();
    store.count(Counters { upsecs: 57, odometer: 449, ptemp: 0 });
    assert_eq!(finish(&mut store, &mut flash), 0);
    let all = Counters { upsecs: 58, odometer: 449, ptemp: 250 };
    store.count(all);
    store.count(Counters { upsecs: 3, odometer: 1, ptemp: -70 });
    assert_eq!(store.counters(), all);
    finish(&mut store, &mut flash);
    assert_eq!(Store::open(&flash).counters(), all, "the first record has them all");
    // 5,000 s more take 5 half-words of up to 1,023 s, 2,000 revolutions 2.
    store.count(Counters { upsecs: 5058, odometer: 2449, ptemp: 253 });
    assert_eq!(finish(&mut store, &mut flash), 5 + 2 + 1);
    assert_eq!(Store::open(&flash).counters(), store.counters());
    let back = Counters { upsecs: 10, odometer: 0, ptemp: -55 };
    store.reset_counters(back);
    store.count(Counters { upsecs: 11, ..back });
    finish(&mut store, &mut flash);
    assert_eq!(Store::open(&flash).counters(), Counters { upsecs: 11, ..back });
}

#[test]
fn record_out_of_sequence_ends_the_journal() {
    for (sequence, read) in [(8, true), (7, false), (9, false)] {
        let first = Head { sequence: 7, complete: true, trusted: None };
        let next = Head { sequence, complete: false, trusted: None };
        let value = |value| core::iter::once((Property::MT.id(), Some(value)));
        let words = [encode(&first, &mut value(5)), encode(&next, &mut value(6))].concat();
        let mut flash = Ram::default();
        flash.words[FIRST..FIRST + words.len()].copy_from_slice(&words);
        assert_eq!(Store::open(&flash).get(Property::MT), Some(if read { 6 } else { 5 }), "{sequence}");
    }
}

#[test]
fn hot_mark_survives_a_cut_between_any_two_operations() {
    let (mut store, mut flash) = fresh();
    store.set_hot(true);
    assert!(!store.is_hot(), "not in the flash yet");
    let before = flash.programmed;
    finish(&mut store, &mut flash);
    // The first is a page's complete record, which has it too.
    assert!(store.is_hot() && flash.programmed > before);
    // Over more than the ring, one change at a time.
    for round in 0..1500 {
        store.set(Property::X5, round);
        let stored = (0..3000).any(|_| {
            let progress = store.step(&mut flash, true);
            assert!(Store::open(&flash).is_hot(), "round {round}");
            progress != Progress::More
        });
        assert!(stored, "round {round}");
    }
    assert!(flash.erased > 16, "{}", flash.erased);
    store.set_hot(false);
    assert!(!store.is_hot(), "from here on the flash may lose it");
    let before = flash.programmed;
    finish(&mut store, &mut flash);
    assert_eq!(flash.programmed, before + 1, "one half-word");
    assert!(!Store::open(&flash).is_hot());
    for _ in 0..2 {
        store.set_hot(false);
        finish(&mut store, &mut flash);
        assert_eq!(flash.programmed, before + 1, "it says so already");
    }
    for _ in 0..2 {
        store.set_hot(true);
        finish(&mut store, &mut flash);
        assert_eq!(flash.programmed, before + 2);
    }
    store.set_hot(true);
    assert!(store.is_hot(), "still in the flash");
    let open = Store::open(&flash);
    assert!(open.is_hot() && open.counters() == store.counters(), "it counts nothing");
}

#[test]
fn hot_mark_that_cannot_be_written_is_not_there() {
    let (mut store, mut flash) = fresh();
    flash.broken = (STORAGE.start..STORAGE.end()).step_by(2).collect();
    store.set_hot(true);
    for _ in 0..100 {
        let _ = store.step(&mut flash, true);
        assert!(!store.is_hot());
    }
}

#[test]
fn hot_mark_waits_for_a_page_while_the_bridge_is_on() {
    let (mut store, mut flash) = fresh();
    let mut waits = |round| {
        store.set(Property::X5, round);
        let last = (0..200).map(|_| store.step(&mut flash, false)).find(|&step| step != Progress::More);
        last == Some(Progress::Waiting)
    };
    // A page has room for 64 records of one property.
    assert!((0..8 * 64).any(&mut waits), "no page is ready");
    store.set_hot(true);
    assert_eq!((store.step(&mut flash, false), store.is_hot()), (Progress::Waiting, false));
    finish(&mut store, &mut flash);
    assert!(store.is_hot() && Store::open(&flash).is_hot());
}

#[test]
fn save_counters_stores_any_growth_in_a_half_word_each() {
    let (mut store, mut flash) = fresh();
    store.set(Property::X5, 1);
    finish(&mut store, &mut flash);
    let before = flash.programmed;
    store.count(Counters { upsecs: 1, odometer: 1, ptemp: 1 });
    finish(&mut store, &mut flash);
    assert_eq!(flash.programmed, before + 1, "PTEMP; the others are not due");
    store.save_counters();
    finish(&mut store, &mut flash);
    assert_eq!((flash.programmed, Store::open(&flash).counters()), (before + 3, store.counters()));
}

#[test]
fn odometer_is_stored_along_with_the_time_or_each_450_revolutions() {
    let (mut store, mut flash) = fresh();
    store.set(Property::X5, 1);
    finish(&mut store, &mut flash);
    let mut stored = |upsecs, odometer| {
        store.count(Counters { upsecs, odometer, ptemp: 0 });
        let before = flash.programmed;
        finish(&mut store, &mut flash);
        (flash.programmed - before, Store::open(&flash).counters().odometer)
    };
    assert_eq!(stored(57, 3), (0, 0));
    assert_eq!(stored(58, 3), (2, 3));
    assert_eq!(stored(58 + 57, 452), (0, 3));
    assert_eq!(stored(58 + 57, 453), (1, 453));
    assert_eq!(stored(2 * 58, 453), (1, 453), "nothing has moved");
}

/// A journal of an earlier program: OD in thousands of counts, as growths and in the complete record.
fn old_journal(thousands: u32, growths: &[u16]) -> Ram {
    let head = Head { sequence: 7, complete: true, trusted: None };
    let entries = [(UPSECS, 100), (OD, thousands.cast_signed()), (PTEMP, 250), (Property::X5.id(), 42)];
    let mut words = encode(&head, &mut entries.into_iter().map(|(id, value)| (id, Some(value))));
    words.extend(growths.iter().map(|&growth| Word::Travel(growth).encode()));
    let mut flash = Ram::default();
    flash.words[FIRST..FIRST + words.len()].copy_from_slice(&words);
    flash
}

#[test]
fn odometer_of_an_earlier_program_becomes_revolutions_once() {
    for (thousands, growths, turns) in [
        (0, &[][..], 0),
        (18, &[], 1000),
        (600, &[6, 3], 609_000 / 18),
        // More than 32 bits of revolutions.
        (u32::MAX, &[], u32::MAX),
    ] {
        let mut flash = old_journal(thousands, growths);
        let open = |flash: &Ram| {
            let mut store = Store::open(flash);
            store.convert_odometer();
            store
        };
        let mut store = open(&flash);
        assert_eq!(store.counters().odometer, turns);
        assert_eq!(open(&flash).counters().odometer, turns, "the same again until it is stored");
        // It turns on before that is in the flash.
        let grown = turns.saturating_add(500);
        store.count(Counters { odometer: grown, ..store.counters() });
        let mut seen = Vec::new();
        while store.step(&mut flash, false) == Progress::More {
            seen.push(open(&flash).counters().odometer);
            assert!(seen.len() < 100);
        }
        assert!(seen.iter().all(|&odometer| odometer == turns || odometer == grown), "{seen:?}");
        let store = open(&flash);
        assert_eq!(
            (store.counters(), store.get(Property::X5)),
            (Counters { upsecs: 100, odometer: grown, ptemp: 250 }, Some(42))
        );
        assert!(store.changed.is_empty(), "nothing is left to convert");
    }
}

/// The monitor keeps value and unit of a journal that no application has converted.
#[test]
fn unit_of_the_odometer_survives_page_changes() {
    for (converts, odometer) in [(true, 1000), (false, 18)] {
        let mut flash = old_journal(18, &[]);
        let mut store = Store::open(&flash);
        if converts {
            store.convert_odometer();
        }
        finish(&mut store, &mut flash);
        for round in 0..200 {
            store.set(Property::X5, round);
            finish(&mut store, &mut flash);
            let mut read = Store::open(&flash);
            assert_eq!(read.counters().odometer, odometer, "{round}");
            read.convert_odometer();
            assert_eq!(read.counters().odometer, 1000, "{round}");
        }
        assert!(flash.erased > 0);
    }
}
