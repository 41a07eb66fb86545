//! Which page is written, which is erased ahead, which is left alone.
//!
//! The pages are a ring: each is filled, then the next that is ready. The current one has the newest state, the one
//! before it stays as it is, in case the current one is ever damaged; all others are erased ahead, as soon as the
//! bridge is off. A page is *ready* once its first half-word is [`READY`], which is programmed after the erase and
//! so says that the erase was not cut short, which blank half-words alone do not say.

use crate::board::{Flash, FlashError};
pub use tater_wire::memory::PAGE_WORDS;
use tater_wire::memory::STORAGE;

/// Pages of the ring. Sets of them are bits of a byte.
const PAGES: u8 = 8;
const _: () = assert!(STORAGE.pages() == 8 && PAGES == 8, "a bit a page");

/// Where records begin: after the mark that the page is ready.
pub const FIRST: usize = 1;

/// The first half-word of a page that is erased, or was before it was written. Cut short, it is not this.
const READY: u16 = 0x5AC3;

/// A page of the ring.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Page(u8);

impl Page {
    /// All of them, each once, the one after `last` first.
    fn all_after(last: Option<Self>) -> impl Iterator<Item = Self> {
        let first = last.map_or(0, |page| page.0 + 1);
        (first..first + PAGES).map(|index| Self(index % PAGES))
    }

    const fn bit(self) -> u8 {
        1 << self.0
    }

    /// The address of a half-word of it.
    // Short, but so often needed that copies of it make 130 bytes of the monitor's flash.
    #[inline(never)]
    pub fn address(self, at: usize) -> u32 {
        // Below PAGE_WORDS = 512, whatever it comes from.
        let at = u16::try_from(at % PAGE_WORDS).unwrap_or(0);
        STORAGE.page(self.0.into()) + 2 * u32::from(at)
    }

    /// A half-word of it.
    pub fn read<F: Flash>(self, flash: &F, at: usize) -> u16 {
        flash.half_word(self.address(at))
    }

    fn is_blank<F: Flash>(self, flash: &F, from: usize) -> bool {
        (from..PAGE_WORDS).all(|at| self.read(flash, at) == u16::MAX)
    }
}

/// The ring.
#[derive(Debug)]
pub struct Pages {
    /// Has the newest state.
    current: Option<Page>,
    /// Where the current one goes on; its end if nothing may be added.
    tail: usize,
    /// Had it before.
    previous: Option<Page>,
    /// Ready to be written.
    ready: u8,
    /// Failed since the start: neither erased nor written again, so that a broken flash is not worn out by trying.
    bad: u8,
    /// Erased, but not yet marked so.
    blank: Option<Page>,
}

impl Pages {
    /// Before the [survey](Self::survey).
    pub const NONE: Self =
        Self { current: None, tail: PAGE_WORDS, previous: None, ready: 0, bad: 0, blank: None };

    /// Looks at all of them. `sequence` says how new a page's state is, `None` if it has none.
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
            } else if found.is_none() && page.read(flash, 0) == READY && page.is_blank(flash, FIRST) {
                self.ready |= page.bit();
            }
        }
    }

    /// The page with the newest state.
    pub const fn current(&self) -> Option<Page> {
        self.current
    }

    /// The page that had it before.
    pub const fn previous(&self) -> Option<Page> {
        self.previous
    }

    /// What has been read of the current page ends here. It goes on here if the rest is blank; if not, that is what a
    /// cut has left, and nothing must follow it.
    pub fn ends_at<F: Flash>(&mut self, flash: &F, at: usize) {
        let blank = self.current.is_some_and(|page| page.is_blank(flash, at));
        self.tail = if blank { at } else { PAGE_WORDS };
    }

    /// Where the current page has room for so many half-words.
    pub fn room(&self, len: usize) -> Option<(Page, usize)> {
        let page = self.current?;
        (self.tail + len <= PAGE_WORDS).then_some((page, self.tail))
    }

    /// So many half-words have been added to the current page.
    pub const fn add(&mut self, len: usize) {
        self.tail += len;
    }

    /// Whether there is a page to go on in when the current one is full.
    pub const fn has_ready(&self) -> bool {
        self.ready != 0
    }

    /// Takes the next ready page, to write a complete record into it.
    pub fn take_ready(&mut self) -> Option<Page> {
        let page = Page::all_after(self.current).find(|page| self.ready & page.bit() != 0)?;
        self.ready &= !page.bit();
        Some(page)
    }

    /// A page that was taken has a complete record, which ends here: it is the current one.
    pub const fn turn(&mut self, page: Page, tail: usize) {
        self.previous = self.current;
        self.current = Some(page);
        self.tail = tail;
    }

    /// Nothing more goes into the current page.
    pub const fn close(&mut self) {
        self.tail = PAGE_WORDS;
    }

    /// A page did not take what was written.
    pub fn fail(&mut self, page: Page) {
        self.bad |= page.bit();
        if self.current == Some(page) {
            self.close();
        }
    }

    /// The next page to erase: not one that has state, is ready, or has failed.
    pub fn stale(&self) -> Option<Page> {
        let free = |page: &Page| {
            (self.ready | self.bad) & page.bit() == 0
                && ![self.current, self.previous, self.blank].contains(&Some(*page))
        };
        Page::all_after(self.current).find(free)
    }

    /// The page to erase when something must be written and none is ready: if all else has failed, the one before the
    /// current one.
    pub fn last_resort(&self) -> Option<Page> {
        self.stale().or_else(|| self.previous.filter(|page| self.bad & page.bit() == 0))
    }

    /// Erases a page: one flash operation. [`Self::mark`] is the next.
    pub fn erase<F: Flash>(&mut self, flash: &mut F, page: Page) -> Result<(), FlashError> {
        self.previous = self.previous.filter(|previous| *previous != page);
        flash.erase(page.address(0)).inspect_err(|_| self.fail(page))?;
        self.blank = Some(page);
        Ok(())
    }

    /// Marks a page that has been erased as ready, one flash operation; `false` if there is none.
    pub fn mark<F: Flash>(&mut self, flash: &mut F) -> Result<bool, FlashError> {
        let Some(page) = self.blank.take() else { return Ok(false) };
        flash.program(page.address(0), READY).inspect_err(|_| self.fail(page))?;
        self.ready |= page.bit();
        Ok(true)
    }
}
