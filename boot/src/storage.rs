//! Non-volatile state: the stored copies of properties, the counters, whether the position may be trusted, and whether the
//! winding may be hot.
//!
//! All of it is in one journal over the eight pages of the map's [`storage`](tater_wire::map::Map::storage) (decision 0018). A page begins
//! with a complete record of all values (`record.rs`); records of changes, and single half-words by which the counters grew
//! (`word.rs`), follow. When a page is full, the next ready one gets a complete record; pages with older state are erased while
//! the bridge is off (`pages.rs`). [`Store::open`] takes the complete record with the highest sequence number and what follows
//! it in its page, up to the first incomplete item. Nothing is ever written after an incomplete item.
//!
//! # Guarantees for a power cut at any instant
//!
//! * Properties: a record counts once its CRC-32 is in. What was set before a [`Store::step`] began a record is there
//!   together or not at all, and what was stored before stays until then.
//! * Counters never go backwards. At most [`LOSS`] is lost if [`Store::count`] is called ten times a second, `step` at
//!   least once a millisecond, and the bridge has not been on for longer than the pages last (below).
//! * Trust in the position ends once [`Store::distrust`] has returned `Ok`. A cut within it leaves the
//!   position trusted or not, the same at every start.
//! * The hot mark is there once [`Store::is_hot`] is true, and until [`Store::set_hot`] with `false`.
//!
//! # Programs of several versions
//!
//! The monitor is never downloaded, so it reads and writes this layout forever: it must find ID, ROLE and SN, and lose nothing
//! when it stores them. **So the layout is frozen**: version 1 is the only one. A new value gets a property number of its own,
//! and up to 32 bits. A new unit gets a number as well: OD is in revolutions where an entry of CTS says so, and in thousands of
//! counts in journals of earlier programs, which [`Store::convert_odometer`] converts (decision 0018). A program keeps every number that it does not know: a record
//! has room for all 128 of the wire. A new layout would get pages of its own; ID, ROLE and SN stay here.
//!
//! # Assumption
//!
//! A half-word whose programming was interrupted reads the same from then on.
//!
//! # Duration
//!
//! A half-word takes 53 us, and a call of `step` programs one at most. It takes less than 100 us, because hall edges wait for
//! it: the step that builds a record programs nothing, and the CRC is computed while the record is written. A record of one
//! property has 8 half-words, 0.42 ms; of all 62 that are stored up to 138, 7.3 ms; a complete one up to 150, 8.0 ms. An erase
//! takes 20 to 40 ms; it comes after a SAVE, not before, and only with the bridge off.
//!
//! # Endurance
//!
//! A page is good for 10,000 erases (STM32F103 data sheet), the ring for 80,000 pages; all wear alike. Behind the
//! longest complete record a page has room for 360 half-words.
//!
//! * **5,000 FSAVEs are guaranteed**, of every property, each changed and saved by a command of its own: 62 x 8 = 496
//!   half-words, a page and three eighths, 870 erases a page. Saved by one command it is a quarter.
//! * 9.9 years without a pause: UPSECS is 5.4 million half-words, one each 58 s, 1,880 erases a page. OD is stored along with
//!   it, and each 450 revolutions in between. Moving all the time as fast as a finger can (500 counts/s) is 21 million more,
//!   9,240 erases a page together. PTEMP only rises: 1,250 half-words in its life.
//! * A SAVE stores the counters as well: up to three half-words, so an FSAVE of every property one by one has 682, and 5,000 of
//!   them are 1,190 erases a page.
//! * The hot mark is two half-words each time that the winding gets hot and cools down, at least 5.5 s: at most 31,000 a day, which the
//!   ring endures for 2.5 years without a pause.
//! * With the bridge on without a pause nothing is erased. Six pages are ready then. Five last at least 29 h, or 6 h
//!   of moving all the time, or three FSAVEs one by one. On the last, counters go in coarser steps (16 min,
//!   1023 revolutions, 1 °C), for another four days, or 3.5 h of moving. Then it is [`Progress::Waiting`] until the
//!   bridge is off, and what has not been stored by then goes with the power.

mod numbers;
mod pages;
mod record;
mod values;
mod word;

use crate::chip::{self, Flash, FlashError, MOST_UNIT};
use heapless::Vec;
use numbers::Numbers;
use pages::{Page, Pages, first, units, words};
use record::{Found, Head, MOST_WORDS, TAIL, halves};
use tater_wire::Property;
use tater_wire::image::Crc32;
use tater_wire::property::{Access, Rules, Stored};
use values::Values;
use word::{MOST, Word};

/// The stored properties that DEF of all forgets.
const OPEN: Numbers = {
    let (mut open, mut rest) = (Numbers::NONE, Property::ALL);
    while let [property, others @ ..] = rest {
        let rules = property.rules();
        if matches!(rules.stored, Stored::Yes) && !matches!(rules.access, Access::Locked) {
            open = open.with(property.id());
        }
        rest = others;
    }
    open
};

/// Counters that are stored without a SAVE.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// UPSECS: seconds with power on.
    pub upsecs: u32,
    /// OD: motor revolutions travelled.
    pub odometer: u32,
    /// PTEMP: highest board temperature, 0.1 °C.
    pub ptemp: i16,
}

/// A counter is written when it is ahead of the flash by this much. This and what comes in 0.2 s, which are the next
/// call of [`Store::count`] and a complete record and an erase before it is its turn, stay within [`LOSS`]. OD is also written
/// with each UPSECS, so that a hand that moves little and loses its power each day keeps it.
const STEP: Counters = Counters { upsecs: 58, odometer: 450, ptemp: 1 };

/// The same on the last ready page. A half-word holds no more revolutions.
const SPARING: Counters = Counters { upsecs: 960, odometer: 1023, ptemp: 10 };
const _: () = assert!(MOST == 1023);

/// What a power cut takes of the counters at most: 60 s, 9,000 counts (499 revolutions, and the rest of one), 1.0 °C; of a motor that
/// has rested for 60 s none. In 0.2 s a motor makes at most 816 counts (V), and a board's temperature rises by less than 0.9 °C.
pub const LOSS: Counters = Counters { upsecs: 60, odometer: 499, ptemp: 10 };

/// Hall counts of a revolution.
const TURN: i32 = 18;

/// The result of one step of storing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Everything is stored.
    Done,
    /// There is more to do: call again.
    More,
    /// There is more to do, but a page must be erased first, and the bridge is on.
    Waiting,
    /// The flash failed. What was stored is still there; the next step tries another page. When each page has failed once,
    /// nothing more is tried until the next start.
    Failed(FlashError),
}

/// Any growth: for a SAVE.
const LEAST: Counters = Counters { upsecs: 1, odometer: 1, ptemp: 1 };

const P: u8 = Property::P.id();
/// The hot mark in a complete record: the number of a property that is never stored, so that a program that does not know the mark
/// keeps it.
const HOT: u8 = Property::THERM.id();
const UPSECS: u8 = Property::UPSECS.id();
const OD: u8 = Property::OD.id();
/// Says that OD is in units of that many hall counts.
const UNIT: u8 = Property::CTS.id();
const PTEMP: u8 = Property::PTEMP.id();

/// A record that is being written. Its half-words before the CRC are in `Store::words`.
#[derive(Debug)]
pub struct Writing {
    /// Half-words written, and the length with the CRC.
    done: usize,
    len: usize,
    crc: Crc32,
    head: Head,
    page: Page,
    at: usize,
    changed: Numbers,
    counters: Counters,
    hot: bool,
    /// Nothing has moved since it was begun.
    pub live: bool,
}

impl Writing {
    /// The half-word after it and its mark.
    fn end<F: Flash>(&self) -> usize {
        self.at + units::<F>(self.len) + units::<F>(usize::from(self.head.trusted.is_some()))
    }

    /// Its half-word at a place: the next before the CRC, or one of the CRC.
    fn word(&mut self, next: Option<u16>, at: usize) -> u16 {
        let Some(word) = next else {
            let [low, high] = halves(self.crc.finish());
            return if at < self.len - 1 { low } else { high };
        };
        self.crc.update(&word.to_le_bytes());
        word
    }

    /// The address of its mark, if it has one that says trusted.
    pub fn mark<F: Flash>(&self) -> Option<u32> {
        (self.live && self.head.trusted.is_some())
            .then(|| self.page.address::<F>(self.at + units::<F>(self.len)))
    }
}

/// The stored copies in RAM, and where the flash is.
#[derive(Debug)]
pub struct Store {
    /// Stored values, including numbers of other versions.
    values: Values,
    /// Properties and counters that differ from the flash.
    changed: Numbers,
    counters: Counters,
    stored_counters: Counters,
    /// OD is in revolutions, not in thousands of counts.
    turns: bool,
    /// The counters are stored by their least growth, once.
    counters_due: bool,
    /// The wanted hot mark, and the one in the flash; `None` if that may read either way: it is being removed, or could not be
    /// written.
    hot: bool,
    stored_hot: Option<bool>,
    /// The hall code at P, if that may be trusted.
    trusted: Option<u8>,
    /// Address of the mark in the flash that grants this trust, or might be read so.
    live: Option<u32>,
    /// Address of a mark that a later record overrides. It is programmed to 0, in case that record is ever damaged.
    obsolete: Option<u32>,
    pages: Pages,
    sequence: u32,
    writing: Option<Writing>,
    words: Vec<u16, MOST_WORDS>,
}

impl Store {
    /// Reads the newest whole state, if any; writes nothing. Reads each page twice at most, whatever is in it.
    #[must_use]
    pub fn open<F: Flash>(flash: &F) -> Self {
        let mut store = Self {
            values: Values::new(),
            changed: Numbers::NONE,
            counters: Counters::default(),
            stored_counters: Counters::default(),
            turns: true,
            counters_due: false,
            hot: false,
            stored_hot: Some(false),
            trusted: None,
            live: None,
            obsolete: None,
            pages: Pages::NONE,
            sequence: 0,
            writing: None,
            words: Vec::new(),
        };
        store.read(flash);
        store
    }

    /// [`Self::open`], for an empty one. Inlined it is 200 bytes more of the monitor's flash.
    #[inline(never)]
    fn read<F: Flash>(&mut self, flash: &F) {
        let complete = |page| Found::read(flash, page, first::<F>()).filter(|record| record.head.complete);
        self.pages.survey(flash, |page| complete(page).map(|record| record.head.sequence));
        if let Some(page) = self.pages.previous() {
            // Only for its mark, which a power cut may have left: the next page's complete record holds everything else.
            self.replay(flash, page);
        }
        if let Some(page) = self.pages.current() {
            let end = self.replay(flash, page);
            self.pages.ends_at(flash, end);
        }
        self.stored_counters = self.counters;
        self.stored_hot = Some(self.hot);
    }

    /// Converts OD of an earlier program's journal, and queues it together with its unit. The application calls this first; the monitor, which
    /// has no room for it, keeps value and unit as they are.
    pub fn convert_odometer(&mut self) {
        if self.turns {
            return;
        }
        self.turns = true;
        let thousands = self.counters.odometer;
        // 1000/18 = 500/9.
        let turns = (thousands / 9).saturating_mul(500).saturating_add(thousands % 9 * 500 / 9);
        self.reset_counters(Counters { odometer: turns, ..self.counters });
        self.changed.insert(UNIT);
    }

    /// Whether something that was stored is void: a page or its last record that cannot be read. A power cut leaves this as well, if it came in
    /// the middle of a record.
    #[must_use]
    pub fn is_damaged<F: Flash>(&self, flash: &F) -> bool {
        let complete =
            |page| Found::read(flash, page, first::<F>()).is_some_and(|record| record.head.complete);
        self.pages.has_void(flash, self.sequence, complete)
    }

    /// The stored value of a property; `None` if none has been stored, or one beyond this version's range.
    #[must_use]
    pub fn get(&self, property: Property) -> Option<i64> {
        self.get_by(property.find_rules()).map(i64::from)
    }

    /// [`Self::get`] for a program without room for the whole table.
    #[must_use]
    pub fn get_by(&self, rules: &Rules) -> Option<i32> {
        self.values.get(rules.property.id()).filter(|&value| rules.admits_word(value))
    }

    /// Queues a value to be stored by [`Self::step`]; ignores a property that SAVE does not store, or a value beyond its range.
    /// A P stored this way is not trusted.
    pub fn set(&mut self, property: Property, value: i64) {
        if let Ok(value) = i32::try_from(value) {
            self.set_by(property.find_rules(), value);
        }
    }

    /// [`Self::set`] for a program without room for the whole table.
    pub fn set_by(&mut self, rules: &Rules, value: i32) {
        if rules.stored == Stored::Yes && rules.admits_word(value) {
            self.change(rules.property, Some(value), None);
        }
    }

    /// Forgets a stored value.
    pub fn forget(&mut self, property: Property) {
        self.change(property, None, None);
    }

    /// Forgets the stored values of all properties but those that are locked, and the trust in the position.
    pub fn forget_open(&mut self) {
        let forgotten = self.values.forget(OPEN);
        self.changed.extend(forgotten);
        self.trusted = None;
    }

    /// Stores the position with its hall code, trusted until [`Self::distrust`]; ignores a position beyond the range of P.
    pub fn save_position(&mut self, position: i32, halls: u8) {
        if Property::P.rules().admits(position.into()) {
            self.change(Property::P, Some(position), Some(halls & 7));
        }
    }

    fn change(&mut self, property: Property, value: Option<i32>, trusted: Option<u8>) {
        let id = property.id();
        let same_trust = property != Property::P || self.trusted == trusted;
        if self.values.get(id) == value && same_trust {
            return;
        }
        self.put(id, value);
        self.changed.insert(id);
        if property == Property::P {
            self.trusted = trusted;
        }
    }

    fn put(&mut self, id: u8, value: Option<i32>) {
        match value {
            Some(value) => self.values.insert(id, value),
            None => self.values.remove(id),
        }
    }

    /// The stored position if nothing has moved since: the position and the hall code at it.
    #[must_use]
    pub fn trusted_position(&self) -> Option<(i32, u8)> {
        let position = self.get(Property::P).and_then(|position| i32::try_from(position).ok())?;
        self.trusted.map(|code| (position, code))
    }

    /// Consumes the trust at once: before the first drive, or at the first count. Costs up to three half-words the first time,
    /// and nothing from then on.
    ///
    /// # Errors
    /// The flash failed, and the position would be trusted after a reset. Do not drive; call again after the next steps, which
    /// store the position without trust elsewhere.
    pub fn distrust<F: Flash>(&mut self, flash: &mut F) -> Result<(), FlashError> {
        self.trusted = None;
        if let Some(mark) = self.obsolete.take() {
            // A later record overrides it, so this may fail.
            let _ = chip::void(flash, mark);
        }
        if let Some(writing) = &mut self.writing
            && let Some(mark) = writing.mark::<F>()
        {
            match chip::void(flash, mark) {
                Ok(()) => writing.live = false,
                // The mark would still be valid: the record must not be completed.
                Err(_) => self.abandon::<F>(),
            }
        }
        if let Some(mark) = self.live {
            chip::void(flash, mark).inspect_err(|_| self.changed.insert(Property::P.id()))?;
            self.live = None;
        }
        Ok(())
    }

    /// The counters.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Raises the counters to these values; lower values are ignored. Must be called ten times a second.
    pub fn count(&mut self, counters: Counters) {
        let now = &mut self.counters;
        now.upsecs = now.upsecs.max(counters.upsecs);
        now.odometer = now.odometer.max(counters.odometer);
        now.ptemp = now.ptemp.max(counters.ptemp);
    }

    /// Sets the counters, also to lower values: a SET after LOCK's sequence.
    pub fn reset_counters(&mut self, counters: Counters) {
        self.counters = counters;
        COUNTERS.into_iter().for_each(|id| self.changed.insert(id));
    }

    /// Queues the counters to be stored, whatever they have grown by: up to three half-words.
    pub const fn save_counters(&mut self) {
        self.counters_due = true;
    }

    /// Queues the hot mark, one half-word; or its removal.
    pub fn set_hot(&mut self, hot: bool) {
        self.hot = hot;
        if !hot && self.stored_hot == Some(true) {
            self.stored_hot = None;
        }
    }

    /// Whether the flash has the hot mark, and keeps it over a loss of power.
    #[must_use]
    pub fn is_hot(&self) -> bool {
        self.hot && self.stored_hot == Some(true)
    }

    /// Performs one flash operation, if one is due: programs a half-word, or erases a page if `may_erase` (bridge off).
    pub fn step<F: Flash>(&mut self, flash: &mut F, may_erase: bool) -> Progress {
        self.advance(flash, may_erase, may_erase).unwrap_or_else(Progress::Failed)
    }

    /// [`Self::step`] with the bridge off, for the monitor: it erases no page ahead, so that the application finds what cannot be read, and
    /// reports it ([`Self::is_damaged`]).
    pub fn step_in_monitor<F: Flash>(&mut self, flash: &mut F) -> Progress {
        self.advance(flash, true, false).unwrap_or_else(Progress::Failed)
    }

    /// Replays a page; returns where its contents end.
    fn replay<F: Flash>(&mut self, flash: &F, page: Page) -> usize {
        let mut at = first::<F>();
        // Every item is at least a half-word long.
        while at < words::<F>() {
            let Some(word) = Word::decode(page.read(flash, at)) else { break };
            if let Word::Record(_) = word {
                let next = self.sequence.wrapping_add(1);
                let follows = |found: &Found| at == first::<F>() || found.head.sequence == next;
                let Some(found) = Found::read(flash, page, at).filter(follows) else { break };
                self.take(flash, &found);
                at = found.end::<F>();
            } else {
                self.counters = grown(self.counters, word);
                self.hot = word.hot_mark().unwrap_or(self.hot);
                at += first::<F>();
            }
        }
        at
    }

    fn take<F: Flash>(&mut self, flash: &F, found: &Found) {
        self.sequence = found.head.sequence;
        if found.head.complete {
            self.values.clear();
            self.counters = Counters::default();
            self.turns = false;
            self.hot = false;
        }
        let mut has_position = found.head.complete;
        for (id, value) in found.entries(flash) {
            let count = value.unwrap_or(0);
            match id {
                UPSECS => self.counters.upsecs = count.cast_unsigned(),
                OD => self.counters.odometer = count.cast_unsigned(),
                PTEMP => self.counters.ptemp = i16::try_from(count).unwrap_or(0),
                UNIT => self.turns = count == TURN,
                HOT => self.hot = count != 0,
                _ => self.put(id, value),
            }
            has_position |= id == P;
        }
        if has_position {
            let mark = found.mark::<F>().map_or(0, |mark| flash.half_word(mark));
            // A partly programmed mark is distrusted and must still be completed.
            self.trusted = found.head.trusted.filter(|_| mark == u16::MAX);
            // A power cut came before it was programmed to 0.
            self.obsolete = self.live.take().or(self.obsolete);
            self.live = found.mark::<F>().filter(|_| mark != 0);
        }
    }

    fn advance<F: Flash>(
        &mut self,
        flash: &mut F,
        may_erase: bool,
        ahead: bool,
    ) -> Result<Progress, FlashError> {
        if self.writing.is_some() {
            self.proceed(flash)?;
        } else if let Some(mark) = self.obsolete.take() {
            chip::void(flash, mark)?;
        } else if self.pages.mark(flash)? {
        } else if let Some(word) = self.mark_due() {
            let Some((page, at)) = self.pages.room::<F>(first::<F>()) else {
                return self.begin(flash, may_erase);
            };
            self.stored_hot = None;
            chip::put(flash, page.address::<F>(at), word.encode()).inspect_err(|_| self.pages.fail(page))?;
            self.pages.add(first::<F>());
            self.stored_hot = Some(self.hot);
        } else if !self.changed.is_empty() {
            return self.begin(flash, may_erase);
        } else if let Some(word) = self.due() {
            let Some((page, at)) = self.pages.room::<F>(first::<F>()) else {
                return self.begin(flash, may_erase);
            };
            chip::put(flash, page.address::<F>(at), word.encode()).inspect_err(|_| self.pages.fail(page))?;
            self.pages.add(first::<F>());
            self.stored_counters = grown(self.stored_counters, word);
        } else if self.counters_due {
            self.counters_due = false;
        } else if ahead && let Some(page) = self.pages.stale() {
            self.pages.erase(flash, page)?;
        } else {
            return Ok(Progress::Done);
        }
        Ok(Progress::More)
    }

    fn mark_due(&self) -> Option<Word> {
        let word = if self.hot { Word::HOT } else { Word::COOL };
        (self.stored_hot != Some(self.hot)).then_some(word)
    }

    fn due(&self) -> Option<Word> {
        let (now, stored) = (self.counters, self.stored_counters);
        let step = match (self.counters_due, self.pages.has_ready()) {
            (true, _) => LEAST,
            (false, true) => STEP,
            (false, false) => SPARING,
        };
        let rise = i32::from(now.ptemp) - i32::from(stored.ptemp);
        let enough = |ahead: u32, step: u32| {
            (ahead >= step).then(|| u16::try_from(ahead).map_or(MOST, |ahead| ahead.min(MOST)))
        };
        let time = enough(now.upsecs.saturating_sub(stored.upsecs), step.upsecs);
        let travel = if time.is_some() { LEAST.odometer } else { step.odometer };
        enough(now.odometer.saturating_sub(stored.odometer), travel)
            .map(Word::Travel)
            .or_else(|| time.map(Word::Time))
            .or_else(|| {
                enough(u32::try_from(rise).unwrap_or(0), step.ptemp.unsigned_abs().into()).map(Word::Heat)
            })
    }

    /// Builds a record for the next steps to write: of the changes, if the page has room, else of everything, in the next page.
    fn begin<F: Flash>(&mut self, flash: &mut F, may_erase: bool) -> Result<Progress, FlashError> {
        let complete = self.pages.room::<F>(first::<F>()).is_none();
        let head = self.record(complete);
        let len = units::<F>(self.words.len() + TAIL) + units::<F>(usize::from(head.trusted.is_some()));
        let (page, at) = if let Some(place) = self.pages.room::<F>(len) {
            place
        } else if !complete {
            // The next step builds a complete one: hall edges wait for a step.
            self.pages.close();
            return Ok(Progress::More);
        } else if let Some(page) = self.pages.take_ready() {
            (page, first::<F>())
        } else {
            let Some(page) = self.pages.last_resort() else { return Err(FlashError::Failed) };
            if !may_erase {
                return Ok(Progress::Waiting);
            }
            return self.pages.erase(flash, page).map(|()| Progress::More);
        };
        let (changed, counters, hot) = (core::mem::take(&mut self.changed), self.counters, self.hot);
        let (len, crc) = (self.words.len() + TAIL, Crc32::default());
        self.writing =
            Some(Writing { done: 0, len, crc, head, page, at, changed, counters, hot, live: true });
        Ok(Progress::More)
    }

    fn record(&mut self, complete: bool) -> Head {
        let trusted = self.trusted.filter(|_| complete || self.changed.contains(P));
        let head = Head { sequence: self.sequence.wrapping_add(1), complete, trusted };
        let entry = |id| {
            let value = match id {
                UPSECS => Some(self.counters.upsecs.cast_signed()),
                OD => Some(self.counters.odometer.cast_signed()),
                PTEMP => Some(i32::from(self.counters.ptemp)),
                UNIT => Some(TURN),
                HOT => Some(1),
                _ => self.values.get(id),
            };
            (id, value)
        };
        let mut numbers = self.changed;
        if complete {
            numbers = self.values.numbers();
            COUNTERS.into_iter().for_each(|id| numbers.insert(id));
            if self.turns {
                numbers.insert(UNIT);
            }
            if self.hot {
                numbers.insert(HOT);
            }
        }
        record::encode(&mut self.words, &head, &mut numbers.iter().map(entry));
        head
    }

    /// Programs the next unit; with the last one the record counts as stored.
    fn proceed<F: Flash>(&mut self, flash: &mut F) -> Result<(), FlashError> {
        let Some(writing) = &mut self.writing else { return Ok(()) };
        let mut unit = [u16::MAX; MOST_UNIT];
        let unit = unit.get_mut(..chip::unit::<F>()).unwrap_or_default();
        for (at, place) in (writing.done..writing.len).zip(&mut *unit) {
            *place = writing.word(self.words.get(at).copied(), at);
        }
        let address = writing.page.address::<F>(writing.at + writing.done);
        if let Err(error) = flash.program(address, unit) {
            self.abandon::<F>();
            return Err(error);
        }
        writing.done += unit.len();
        if writing.done < writing.len {
            return Ok(());
        }
        let (head, end) = (writing.head, writing.end::<F>());
        if head.complete {
            self.stored_hot = Some(writing.hot);
            self.pages.turn(writing.page, end);
        } else {
            self.pages.add(end - writing.at);
        }
        self.sequence = head.sequence;
        if head.complete || writing.changed.contains(UPSECS) {
            self.stored_counters = writing.counters;
        }
        if head.complete || writing.changed.contains(P) {
            self.obsolete = self.live.take();
            self.live = writing.mark::<F>();
        }
        self.writing = None;
        Ok(())
    }

    /// Abandons the record that is being written, and its page; the next record repeats it elsewhere. In case it is readable,
    /// its mark is queued to become 0, its sequence number is used up, and nothing more goes into the current page.
    fn abandon<F: Flash>(&mut self) {
        if let Some(writing) = &self.writing {
            self.obsolete = writing.mark::<F>();
            self.changed.extend(writing.changed);
            self.sequence = writing.head.sequence;
            self.pages.fail(writing.page);
            self.pages.close();
            self.writing = None;
        }
    }
}

const COUNTERS: [u8; 3] = [Property::UPSECS.id(), Property::OD.id(), Property::PTEMP.id()];

fn grown(mut counters: Counters, word: Word) -> Counters {
    match word {
        Word::Time(amount) => counters.upsecs = counters.upsecs.saturating_add(amount.into()),
        Word::Travel(amount) => counters.odometer = counters.odometer.saturating_add(amount.into()),
        Word::Heat(amount) => counters.ptemp = counters.ptemp.saturating_add_unsigned(amount),
        Word::Record(_) => {}
    }
    counters
}

#[cfg(test)]
mod tests;
