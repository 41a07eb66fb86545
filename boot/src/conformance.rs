//! Whether a port's hardware keeps the promises of [`Chip`] and [`Flash`] (`docs/porting.md`), on a computer or on the board itself.
//!
//! Each function stops at the first promise that is broken. They overwrite staging, application and storage, and program each page some ten
//! times. What a power cut leaves is played where a test can cut the power ([`Cut`]).

mod power;
#[cfg(test)]
mod tests;

pub use power::{Cut, survives_power_cuts};

use crate::chip::{Chip, Flash, FlashError, MOST_UNIT, put, unit, void};
use crate::monitor::{Monitor, Next};
use crate::storage::{Counters, Progress, Store};
use heapless::Vec;
use servo_core::units::Micros;
use tater_wire::download::{Downloader, Next as Host};
use tater_wire::image::{HEADER_BYTES, HEADER_END, seal};
use tater_wire::map::{Area, Map};
use tater_wire::tek::{Encoder, end};
use tater_wire::{FaultCode, Frame, Group, Node, Property};

/// A promise that is not kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Broken {
    /// What was promised.
    pub promise: &'static str,
    /// Where: an address, or 0.
    pub at: u32,
    /// What was found there: a half-word, a number.
    pub found: u32,
}

impl core::fmt::Display for Broken {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} (at {:#010x}: {:#x})", self.promise, self.at, self.found)
    }
}

impl core::error::Error for Broken {}

type Kept = Result<(), Broken>;

/// Whether a promise holds.
///
/// # Errors
/// It does not.
pub fn holds(is_so: bool, promise: &'static str, at: u32, found: impl Into<u32>) -> Kept {
    if is_so { Ok(()) } else { Err(Broken { promise, at, found: found.into() }) }
}

/// Everything of a chip: its flash, the journal in it, a download through the monitor, and what identifies a board.
///
/// # Errors
/// The first promise that is broken.
pub fn chip<C: Chip>(mut chip: C) -> Result<C, Broken> {
    flash(&mut chip)?;
    journal(&mut chip)?;
    let number = chip.serial_number();
    holds(number <= 0x7FFF, "the serial number is 0 to 32767", 0, number)?;
    holds(chip.serial_number() == number, "the serial number is always the same", 0, number)?;
    let node = chip.straps();
    holds(chip.straps() == node, "the straps read the same while they are", 0, node.number())?;
    chip.set_filters(node, [None; 3]);
    if let Some(frame) = Frame::from_raw(0, &[Property::STAT.id()]) {
        holds(chip.transmit(&frame), "an idle bus takes a frame", 0, 0_u8)?;
    }
    download(&mut chip)?;
    Ok(chip)
}

const fn map<C: Chip>() -> Map {
    <C::Flash as Flash>::MAP
}

/// The promises of a flash.
///
/// # Errors
/// The first that is broken.
pub fn flash<C: Chip>(chip: &mut C) -> Kept {
    const { assert!(map::<C>().is_whole(), "areas of whole pages that fill the flash") };
    let Map { of, staging, storage, .. } = map::<C>();
    for area in [staging, storage] {
        for page in [area.start, area.end() - of.page] {
            erase(chip, page)?;
            for address in [page + of.page - of.unit, page] {
                once(chip.flash(), address)?;
            }
        }
    }
    neighbors(chip, staging)?;
    refusals(chip.flash())
}

fn erase<C: Chip>(chip: &mut C, page: u32) -> Kept {
    chip.feed_watchdog();
    let done = chip.flash().erase(page);
    holds(done == Ok(()), "a page can be erased", page, 0_u8)?;
    is(chip.flash(), Area { start: page, len: map::<C>().of.page }, u16::MAX, "an erased page is all ones")
}

/// Whether an area holds nothing but a half-word.
fn is<F: Flash>(flash: &F, area: Area, word: u16, promise: &'static str) -> Kept {
    (area.start..area.end()).step_by(2).try_for_each(|at| {
        let found = flash.half_word(at);
        holds(found == word, promise, at, found)
    })
}

/// Programs a unit once, which works; again, which does not; and to 0, which does.
fn once<F: Flash>(flash: &mut F, address: u32) -> Kept {
    const FIRST: [u16; MOST_UNIT] = [0x0001, 0x8000, 0xA55A, 0xFFFF, 0x0000, 0x5AA5, 0x1234, 0xFFFE];
    let words = FIRST.get(..unit::<F>()).unwrap_or_default();
    let read = |flash: &F, promise| {
        (address..).step_by(2).zip(words).try_for_each(|(at, &word)| {
            let found = flash.half_word(at);
            holds(found == word, promise, at, found)
        })
    };
    let done = flash.program(address, words);
    holds(done == Ok(()), "an erased unit can be programmed", address, flash.half_word(address))?;
    read(flash, "a unit holds what was programmed, its first half-word at its first address")?;
    let again = put(flash, address, 0x0002);
    let promise = "a unit is programmed once: NotErased";
    holds(again == Err(FlashError::NotErased), promise, address, flash.half_word(address))?;
    read(flash, "a refused unit stays as it is")?;
    holds(void(flash, address) == Ok(()), "0 can be programmed over anything", address, 0_u8)?;
    is(flash, Area { start: address, len: F::MAP.of.unit }, 0, "a unit that was programmed to 0 reads 0")?;
    holds(void(flash, address) == Ok(()), "0 can be programmed over 0", address, 0_u8)
}

/// A page that is erased, and a unit that is programmed, leave their neighbors alone.
fn neighbors<C: Chip>(chip: &mut C, area: Area) -> Kept {
    let Map { of, .. } = map::<C>();
    let pages = [0, 1, 2].map(|index| map::<C>().page(area, index));
    pages.iter().try_for_each(|&page| erase(chip, page))?;
    let [before, page, after] = pages;
    let [last, first] = [page - of.unit, after];
    for address in [last, first] {
        holds(
            put(chip.flash(), address, 0xC3C3) == Ok(()),
            "an erased unit can be programmed",
            address,
            0_u8,
        )?;
    }
    holds(put(chip.flash(), page, 0) == Ok(()), "an erased unit can be programmed", page, 0_u8)?;
    erase(chip, page)?;
    for address in [last, first] {
        let found = chip.flash().half_word(address);
        holds(found == 0xC3C3, "an erased page leaves its neighbors alone", address, found)?;
    }
    let rest = Area { start: before, len: of.page - of.unit };
    is(chip.flash(), rest, u16::MAX, "a programmed unit leaves its page alone")
}

/// What is no unit, no page, or not in the flash.
fn refusals<F: Flash>(flash: &mut F) -> Kept {
    let Map { of, staging, monitor, .. } = F::MAP;
    let unit = of.unit;
    for address in [staging.start + 1, staging.start + unit / 2, of.flash.end(), of.flash.start - unit] {
        let found = put(flash, address, 0);
        holds(
            found == Err(FlashError::Address),
            "only a unit of the flash is programmed: Address",
            address,
            0_u8,
        )?;
    }
    for page in [staging.start + unit, of.flash.end(), of.flash.start.wrapping_sub(of.page)] {
        let found = flash.erase(page);
        holds(found == Err(FlashError::Address), "only a page of the flash is erased: Address", page, 0_u8)?;
    }
    let (long, short) = ([0; 2 * MOST_UNIT], [0_u16; 0]);
    for words in [&long[..], &short[..]] {
        let found = flash.program(staging.start, words);
        holds(found == Err(FlashError::Address), "a unit has its length: Address", staging.start, 0_u8)?;
    }
    // A program may write only behind its own code, whichever runs this.
    let first = flash.half_word(monitor.start);
    let [program, erase] = [put(flash, monitor.start, 0), flash.erase(monitor.start)];
    for done in [program, erase] {
        holds(
            done == Err(FlashError::Address),
            "the monitor's pages are refused: Address",
            monitor.start,
            0_u8,
        )?;
    }
    let found = flash.half_word(monitor.start);
    holds(found == first, "the monitor's pages are refused: Address", monitor.start, found)?;
    for address in [of.flash.end(), of.flash.start - 2, staging.start + 1] {
        let found = flash.half_word(address);
        holds(found == u16::MAX, "what is no half-word of the flash reads all ones", address, found)?;
    }
    Ok(())
}

/// Most steps of a store until everything is stored: a complete record, pages to erase, and their marks.
const STEPS: u32 = 2_000;

fn settle<C: Chip>(store: &mut Store, chip: &mut C) -> Kept {
    for _ in 0..STEPS {
        chip.feed_watchdog();
        match store.step(chip.flash(), true) {
            Progress::Done => return Ok(()),
            Progress::More | Progress::Waiting => {}
            Progress::Failed(_) => break,
        }
    }
    Err(Broken { promise: "the journal stores what is due", at: map::<C>().storage.start, found: 0 })
}

/// The journal over the port's flash: twice around its pages.
///
/// # Errors
/// The first promise that is broken.
pub fn journal<C: Chip>(chip: &mut C) -> Kept {
    let storage = map::<C>().storage;
    for index in 0..map::<C>().pages(storage) {
        erase(chip, map::<C>().page(storage, index))?;
    }
    let mut store = Store::open(chip.flash());
    let turns = 2 * storage.len / 16;
    for turn in 0..turns {
        store.set(Property::MV, 1000 + i64::from(turn % 500));
        store.save_position(turn.cast_signed(), 2);
        store.count(Counters { upsecs: turn, odometer: turn / 2, ptemp: 250 });
        store.save_counters();
        store.set_hot(turn % 3 == 0);
        settle(&mut store, chip)?;
        if turn % 64 == 63 {
            let distrusts = turn % 128 == 63;
            if distrusts {
                let done = store.distrust(chip.flash());
                holds(done == Ok(()), "a mark can be programmed to 0", storage.start, 0_u8)?;
            }
            store = Store::open(chip.flash());
            let read = store.get(Property::MV);
            let promise = "the journal gives back what was stored";
            holds(read == Some(1000 + i64::from(turn % 500)), promise, storage.start, turn)?;
            let counters = Counters { upsecs: turn, odometer: turn / 2, ptemp: 250 };
            holds(store.counters() == counters, promise, storage.start, store.counters().upsecs)?;
            let position = (!distrusts).then_some((turn.cast_signed(), 2));
            holds(store.trusted_position() == position, promise, storage.start, turn)?;
            holds(!store.is_damaged(chip.flash()), "the journal is whole", storage.start, turn)?;
        }
    }
    Ok(())
}

/// A chip whose frames a host in the same program gets.
struct Tapped<'a, C> {
    chip: &'a mut C,
    sent: Vec<Frame, 16>,
}

impl<C: Chip> Chip for Tapped<'_, C> {
    type Flash = C::Flash;

    fn transmit(&mut self, frame: &Frame) -> bool {
        self.sent.push(*frame).is_ok()
    }

    fn set_filters(&mut self, node: Node, groups: [Option<Group>; 3]) {
        self.chip.set_filters(node, groups);
    }

    fn flash(&mut self) -> &mut C::Flash {
        self.chip.flash()
    }

    fn feed_watchdog(&mut self) {
        self.chip.feed_watchdog();
    }

    fn reset(&mut self) {}

    fn reset_cause(&self) -> Option<FaultCode> {
        None
    }

    fn straps(&self) -> Node {
        // A board without straps has a number all the same.
        match self.chip.straps() {
            Node::HOST => Node::new(1).unwrap_or(Node::HOST),
            node => node,
        }
    }

    fn serial_number(&self) -> u16 {
        self.chip.serial_number()
    }
}

/// Bytes of the image that is downloaded: no whole unit of more than 4 bytes at its end.
const IMAGE: usize = 300;
/// Lines of 32 bytes, and the last one.
const FILE: usize = 80 * (IMAGE / 32 + 3);

/// A download through the monitor, over the port's flash: the application's area holds the image, byte for byte.
///
/// # Errors
/// The first promise that is broken.
fn download<C: Chip>(chip: &mut C) -> Kept {
    let Map { of, application, .. } = map::<C>();
    let mut image = [0; IMAGE];
    image.iter_mut().zip((0..=250).cycle()).for_each(|(byte, value)| *byte = value);
    let words = [of.ram.end(), application.start + HEADER_END + 1].map(u32::to_le_bytes);
    image.iter_mut().zip(words.as_flattened()).for_each(|(byte, &value)| *byte = value);
    image.iter_mut().take(HEADER_BYTES).skip(0x1C).for_each(|byte| *byte = u8::MAX);
    let broken = |promise| Broken { promise, at: application.start, found: 0 };
    seal(&mut image, 1, &map::<C>()).map_err(|_| broken("an image fits the map"))?;
    let mut file: Vec<u8, FILE> = Vec::new();
    let lines = Encoder::new(application.start, &image).into_iter().flatten();
    for line in lines.chain([end(application.start)]) {
        file.extend_from_slice(line.as_bytes()).map_err(|_| broken("a file fits its buffer"))?;
    }
    holds(played(Tapped { chip, sent: Vec::new() }, &file), "a download ends", application.start, 0_u8)?;
    for (at, pair) in (application.start..).step_by(2).zip(image.as_chunks().0) {
        let found = chip.flash().half_word(at);
        holds(found == u16::from_le_bytes(*pair), "the application is what was downloaded", at, found)?;
    }
    Ok(())
}

/// Whether a download ends well.
fn played<C: Chip>(chip: Tapped<'_, C>, file: &[u8]) -> bool {
    let mut monitor = Monitor::new(chip);
    let mut host = Downloader::new(monitor.node(), file, 0);
    let mut now = 0_u64;
    // A step each 53 us of a minute.
    for _ in 0..1_200_000 {
        now += 53;
        // The clock of a board wraps.
        let micros = Micros(u32::try_from(now & u64::from(u32::MAX)).unwrap_or(0));
        if monitor.step(micros) == Next::Start {
            return true;
        }
        for frame in core::mem::take(&mut monitor.board_mut().sent) {
            host.receive(&frame, now);
        }
        match host.next(now) {
            Host::Send(frame) => monitor.receive(&frame, micros),
            Host::Wait(_) => {}
            Host::Done | Host::Failed(_) => return false,
        }
    }
    false
}
