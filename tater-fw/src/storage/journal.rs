//! What the journal says is taken up, what has changed is added to it.

use super::numbers::Numbers;
use super::pages::{FIRST, PAGE_WORDS, Page};
use super::record::{self, Found, Head, TAIL, halves};
use super::word::{MOST, Word};
use super::{COUNTERS, Counters, Progress, SPARING, STEP, Store};
use crate::board::{Flash, FlashError};
use tater_wire::Property;
use tater_wire::image::Crc32;

const P: u8 = Property::P.id();
const UPSECS: u8 = Property::UPSECS.id();
const OD: u8 = Property::OD.id();
const PTEMP: u8 = Property::PTEMP.id();

/// A record on its way into the flash. What is in it up to its CRC is in [`Store::words`].
#[derive(Debug)]
pub struct Writing {
    /// Half-words of it that are in, and its length, with the CRC.
    done: usize,
    len: usize,
    /// Of those that are in.
    crc: Crc32,
    head: Head,
    page: Page,
    at: usize,
    /// The properties in it.
    changed: Numbers,
    counters: Counters,
    /// Nothing has moved since it was begun.
    pub live: bool,
}

impl Writing {
    /// The half-word after it, and after its mark.
    fn end(&self) -> usize {
        self.at + self.len + usize::from(self.head.trusted.is_some())
    }

    /// The address of its mark, if it has one that says trusted.
    pub fn mark(&self) -> Option<u32> {
        (self.live && self.head.trusted.is_some()).then(|| self.page.address(self.at + self.len))
    }
}

impl Store {
    /// Takes what stands in a page; where it ends.
    pub(super) fn replay<F: Flash>(&mut self, flash: &F, page: Page) -> usize {
        let mut at = FIRST;
        // Everything is at least a half-word long.
        while at < PAGE_WORDS {
            let Some(word) = Word::decode(page.read(flash, at)) else { break };
            if let Word::Record(_) = word {
                let next = self.sequence.wrapping_add(1);
                let follows = |found: &Found| at == FIRST || found.head.sequence == next;
                let Some(found) = Found::read(flash, page, at).filter(follows) else { break };
                self.take(flash, &found);
                at = found.end();
            } else {
                self.counters = grown(self.counters, word);
                at += 1;
            }
        }
        at
    }

    /// Takes a record.
    fn take<F: Flash>(&mut self, flash: &F, found: &Found) {
        self.sequence = found.head.sequence;
        if found.head.complete {
            self.values.clear();
            self.counters = Counters::default();
        }
        let mut has_position = found.head.complete;
        for (id, value) in found.entries(flash) {
            let count = value.unwrap_or(0);
            match id {
                UPSECS => self.counters.upsecs = count.cast_unsigned(),
                OD => self.counters.odometer = count.cast_unsigned(),
                PTEMP => self.counters.ptemp = i16::try_from(count).unwrap_or(0),
                _ => self.put(id, value),
            }
            has_position |= id == P;
        }
        if has_position {
            let mark = found.mark().map_or(0, |mark| flash.half_word(mark));
            // Partly programmed is distrusted, and the rest of it is still to be done.
            self.trusted = found.head.trusted.filter(|_| mark == u16::MAX);
            // A cut has come before it was made 0.
            self.obsolete = self.live.take().or(self.obsolete);
            self.live = found.mark().filter(|_| mark != 0);
        }
    }

    /// At most one flash operation.
    pub(super) fn advance<F: Flash>(
        &mut self,
        flash: &mut F,
        may_erase: bool,
    ) -> Result<Progress, FlashError> {
        if self.writing.is_some() {
            self.proceed(flash)?;
        } else if let Some(mark) = self.obsolete.take() {
            flash.program(mark, 0)?;
        } else if self.pages.mark(flash)? {
        } else if !self.changed.is_empty() {
            return self.begin(flash, may_erase);
        } else if let Some(word) = self.due() {
            let Some((page, at)) = self.pages.room(1) else { return self.begin(flash, may_erase) };
            flash.program(page.address(at), word.encode()).inspect_err(|_| self.pages.fail(page))?;
            self.pages.add(1);
            self.kept = grown(self.kept, word);
        } else if may_erase && let Some(page) = self.pages.stale() {
            self.pages.erase(flash, page)?;
        } else {
            return Ok(Progress::Done);
        }
        Ok(Progress::More)
    }

    /// What the counters have grown by, if it is enough to be told.
    fn due(&self) -> Option<Word> {
        let (now, kept) = (self.counters, self.kept);
        let step = if self.pages.has_ready() { STEP } else { SPARING };
        let rise = i32::from(now.ptemp) - i32::from(kept.ptemp);
        let enough = |ahead: u32, step: u32| {
            (ahead >= step).then(|| u16::try_from(ahead).map_or(MOST, |ahead| ahead.min(MOST)))
        };
        enough(now.upsecs.saturating_sub(kept.upsecs), step.upsecs)
            .map(Word::Time)
            .or_else(|| enough(now.odometer.saturating_sub(kept.odometer), step.odometer).map(Word::Travel))
            .or_else(|| {
                enough(u32::try_from(rise).unwrap_or(0), step.ptemp.unsigned_abs().into()).map(Word::Heat)
            })
    }

    /// Makes a record, which the next steps write: of what has changed behind the others if there is room, else of everything
    /// in the next page.
    fn begin<F: Flash>(&mut self, flash: &mut F, may_erase: bool) -> Result<Progress, FlashError> {
        let complete = self.pages.room(1).is_none();
        let head = self.record(complete);
        let len = self.words.len() + TAIL + usize::from(head.trusted.is_some());
        let (page, at) = if let Some(place) = self.pages.room(len) {
            place
        } else if !complete {
            // The next step makes a complete one: hall edges wait for a step.
            self.pages.close();
            return Ok(Progress::More);
        } else if let Some(page) = self.pages.take_ready() {
            (page, FIRST)
        } else {
            let Some(page) = self.pages.last_resort() else { return Err(FlashError::Failed) };
            if !may_erase {
                return Ok(Progress::Waiting);
            }
            return self.pages.erase(flash, page).map(|()| Progress::More);
        };
        let (changed, counters) = (core::mem::take(&mut self.changed), self.counters);
        let (len, crc) = (self.words.len() + TAIL, Crc32::default());
        self.writing = Some(Writing { done: 0, len, crc, head, page, at, changed, counters, live: true });
        Ok(Progress::More)
    }

    /// Makes the next record: of all there is, or of what has changed.
    pub(super) fn record(&mut self, complete: bool) -> Head {
        let trusted = self.trusted.filter(|_| complete || self.changed.contains(P));
        let head = Head { sequence: self.sequence.wrapping_add(1), complete, trusted };
        let entry = |id| {
            let value = match id {
                UPSECS => Some(self.counters.upsecs.cast_signed()),
                OD => Some(self.counters.odometer.cast_signed()),
                PTEMP => Some(i32::from(self.counters.ptemp)),
                _ => self.values.get(id),
            };
            (id, value)
        };
        let mut numbers = self.changed;
        if complete {
            numbers = self.values.numbers();
            COUNTERS.into_iter().for_each(|id| numbers.insert(id));
        }
        record::encode(&mut self.words, &head, &mut numbers.iter().map(entry));
        head
    }

    /// Programs a record's next half-word, and counts it as stored with the last one.
    fn proceed<F: Flash>(&mut self, flash: &mut F) -> Result<(), FlashError> {
        let Some(writing) = &mut self.writing else { return Ok(()) };
        let [low, high] = halves(writing.crc.finish());
        let word = match self.words.get(writing.done) {
            Some(&word) => {
                writing.crc.update(&word.to_le_bytes());
                word
            }
            None if writing.done < writing.len - 1 => low,
            None => high,
        };
        let address = writing.page.address(writing.at + writing.done);
        if let Err(error) = flash.program(address, word) {
            self.abandon();
            return Err(error);
        }
        writing.done += 1;
        if writing.done < writing.len {
            return Ok(());
        }
        let (head, end) = (writing.head, writing.end());
        if head.complete {
            self.pages.turn(writing.page, end);
        } else {
            self.pages.add(end - writing.at);
        }
        self.sequence = head.sequence;
        if head.complete || writing.changed.contains(UPSECS) {
            self.kept = writing.counters;
        }
        if head.complete || writing.changed.contains(P) {
            self.obsolete = self.live.take();
            self.live = writing.mark();
        }
        self.writing = None;
        Ok(())
    }

    /// Gives up the record on its way, and its page: what is in it comes with the next, elsewhere. Should it be
    /// readable after all, its mark must not be believed, and what follows must be newer: so its number is used up, and
    /// nothing more goes into the page that was current.
    pub(super) fn abandon(&mut self) {
        if let Some(writing) = &self.writing {
            self.obsolete = writing.mark();
            self.changed.extend(writing.changed);
            self.sequence = writing.head.sequence;
            self.pages.fail(writing.page);
            self.pages.close();
            self.writing = None;
        }
    }
}

/// The counters after one of them grew.
fn grown(mut counters: Counters, word: Word) -> Counters {
    match word {
        Word::Time(amount) => counters.upsecs = counters.upsecs.saturating_add(amount.into()),
        Word::Travel(amount) => counters.odometer = counters.odometer.saturating_add(amount.into()),
        Word::Heat(amount) => counters.ptemp = counters.ptemp.saturating_add_unsigned(amount),
        Word::Record(_) => {}
    }
    counters
}
