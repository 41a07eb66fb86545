//! Selects the pages to write, to erase ahead, and to leave alone.
//!
//! The pages are a ring: each is filled, then the next that is ready. The current one has the newest state.
//! The one before it is kept, in case the current one is ever damaged. All others are erased ahead, as soon
//! as the bridge is off. A page is *ready* once its first half-word is [`READY`], which is programmed after
//! the erase and so proves that the erase was complete; blank half-words alone do not.

use super::word::join;
use crate::chip::{self, Flash, FlashError};
use tater_wire::map::STORAGE_PAGES;

/// Pages of the ring. Sets of them are bits of a byte.
const PAGES: u8 = 8;
const _: () = assert!(STORAGE_PAGES == 8 && PAGES == 8, "a bit a page");

/// Half-words of a page.
pub const fn words<F: Flash>() -> usize {
    F::MAP.of.page_words()
}

/// Start of the records, in half-words: after the mark that the page is ready.
pub const fn first<F: Flash>() -> usize {
    chip::unit::<F>()
}

/// Half-words of the whole units that so many half-words take.
pub const fn units<F: Flash>(words: usize) -> usize {
    words.next_multiple_of(chip::unit::<F>())
}

/// The first half-word of a page after its erase. A cut erase or cut programming does not leave it.
const READY: u16 = 0x5AC3;

/// Beyond every page.
const CLOSED: usize = 1 << 16;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Page(u8);

impl Page {
    fn all_after(last: Option<Self>) -> impl Iterator<Item = Self> {
        let first = last.map_or(0, |page| page.0 + 1);
        (first..first + PAGES).map(|index| Self(index % PAGES))
    }

    const fn bit(self) -> u8 {
        1 << self.0
    }

    // Not inlined: it is needed so often that copies would take 130 bytes of the monitor's flash.
    #[inline(never)]
    pub fn address<F: Flash>(self, at: usize) -> u32 {
        // Inside the page for every caller.
        let at = u16::try_from(at % words::<F>()).unwrap_or(0);
        F::MAP.page(F::MAP.storage, self.0.into()) + 2 * u32::from(at)
    }

    pub fn read<F: Flash>(self, flash: &F, at: usize) -> u16 {
        flash.half_word(self.address::<F>(at))
    }

    fn is_blank<F: Flash>(self, flash: &F, from: usize) -> bool {
        (from..words::<F>()).all(|at| self.read(flash, at) == u16::MAX)
    }
}

#[derive(Debug)]
pub struct Pages {
    current: Option<Page>,
    /// Write position in the current page; [`CLOSED`] if nothing may be added.
    tail: usize,
    previous: Option<Page>,
    ready: u8,
    /// Failed since the start: not erased or written again, so that retries do not wear out a broken flash.
    bad: u8,
    /// Erased, but not yet marked as ready.
    blank: Option<Page>,
}

impl Pages {
    pub const NONE: Self =
        Self { current: None, tail: CLOSED, previous: None, ready: 0, bad: 0, blank: None };

    /// `sequence` returns the sequence number of a page's state, `None` if it has none.
    pub fn survey<F: Flash>(&mut self, flash: &F, sequence: impl Fn(Page) -> Option<u32>) {
        let mut newest = [None, None];
        for page in Page::all_after(None) {
            let found = sequence(page);
            if found > newest[0] {
                newest = [found, newest[0]];
                (self.previous, self.current) = (self.current, Some(page));
            } else if found > newest[1] {
                newest[1] = found;
                self.previous = Some(page);
            } else if found.is_none() && page.read(flash, 0) == READY && page.is_blank(flash, 1) {
                self.ready |= page.bit();
            }
        }
    }

    pub const fn current(&self) -> Option<Page> {
        self.current
    }

    pub const fn previous(&self) -> Option<Page> {
        self.previous
    }

    /// Writing continues here if the rest is blank; otherwise a power cut left the rest, and nothing may follow it.
    pub fn ends_at<F: Flash>(&mut self, flash: &F, at: usize) {
        let blank = self.current.is_some_and(|page| page.is_blank(flash, at));
        self.tail = if blank { at } else { CLOSED };
    }

    /// Whether a page was begun after the state that could be read, whose last record is `sequence`; or the current page ends in something
    /// that cannot be read: such a page is closed although its last half-word is blank. `has_state`: whether a page has a complete record.
    pub fn has_void<F: Flash>(&self, flash: &F, sequence: u32, has_state: impl Fn(Page) -> bool) -> bool {
        let next = Page::all_after(self.current).next().filter(|_| self.current.is_some());
        let closed = |page: Page| {
            self.tail >= words::<F>() && page.read(flash, words::<F>() - first::<F>()) == u16::MAX
        };
        let newer = |page: Page| {
            let word = |at| page.read(flash, at);
            // One more wraps the number of a blank page to 0, which is not newer than anything.
            let begun = join(word(first::<F>() + 2), word(first::<F>() + 3)).wrapping_add(1);
            // The number itself may be wrong. The next page is older and whole, ready, or begun.
            let follows = next == Some(page) && self.ready & page.bit() == 0;
            let is_newer = begun > sequence.wrapping_add(1) || follows && !has_state(page);
            // Without any state there is nothing to be erased either.
            next.is_none() && !page.is_blank(flash, first::<F>()) || word(0) == READY && is_newer
        };
        self.current.is_some_and(closed) || (0..PAGES).map(Page).any(newer)
    }

    pub fn room<F: Flash>(&self, len: usize) -> Option<(Page, usize)> {
        let page = self.current?;
        (self.tail + len <= words::<F>()).then_some((page, self.tail))
    }

    pub const fn add(&mut self, len: usize) {
        self.tail += len;
    }

    pub const fn has_ready(&self) -> bool {
        self.ready != 0
    }

    pub fn take_ready(&mut self) -> Option<Page> {
        let page = Page::all_after(self.current).find(|page| self.ready & page.bit() != 0)?;
        self.ready &= !page.bit();
        Some(page)
    }

    /// The page taken has a complete record, which ends at `tail`: it becomes the current page.
    pub const fn turn(&mut self, page: Page, tail: usize) {
        self.previous = self.current;
        self.current = Some(page);
        self.tail = tail;
    }

    pub const fn close(&mut self) {
        self.tail = CLOSED;
    }

    pub fn fail(&mut self, page: Page) {
        self.bad |= page.bit();
        if self.current == Some(page) {
            self.close();
        }
    }

    /// Next page to erase: one without state that is neither ready nor failed.
    pub fn stale(&self) -> Option<Page> {
        let free = |page: &Page| {
            (self.ready | self.bad) & page.bit() == 0
                && ![self.current, self.previous, self.blank].contains(&Some(*page))
        };
        Page::all_after(self.current).find(free)
    }

    /// The page to erase when none is ready: if everything else has failed, the one before the current one.
    pub fn last_resort(&self) -> Option<Page> {
        self.stale().or_else(|| self.previous.filter(|page| self.bad & page.bit() == 0))
    }

    /// Erases a page: one flash operation. [`Self::mark`] follows.
    pub fn erase<F: Flash>(&mut self, flash: &mut F, page: Page) -> Result<(), FlashError> {
        self.previous = self.previous.filter(|previous| *previous != page);
        flash.erase(page.address::<F>(0)).inspect_err(|_| self.fail(page))?;
        self.blank = Some(page);
        Ok(())
    }

    /// Marks an erased page as ready, one flash operation; `false` if there is none.
    pub fn mark<F: Flash>(&mut self, flash: &mut F) -> Result<bool, FlashError> {
        let Some(page) = self.blank.take() else { return Ok(false) };
        chip::put(flash, page.address::<F>(0), READY).inspect_err(|_| self.fail(page))?;
        self.ready |= page.bit();
        Ok(true)
    }
}
