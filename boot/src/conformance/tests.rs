//! The promises over models of flashes of each unit; and that a flash which breaks one is found.

use super::*;
use std::vec;
use std::vec::Vec as Bytes;
use tater_wire::map::Memories;

/// What is wrong with a flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wrong {
    Nothing,
    /// A second program changes the unit.
    Overwrites,
    /// 0 is refused like anything else.
    KeepsZeros,
    /// Half-words of a unit in the wrong order.
    Swaps,
    /// An erase takes the page after it along.
    ErasesTwo,
    /// Addresses inside a unit are rounded down.
    Rounds,
    /// The monitor's own pages can be written.
    Open,
    /// Beyond the flash reads 0.
    ReadsZero,
    /// Any length is taken.
    Lengths,
    /// An erase does nothing.
    Worn,
}

/// A flash of UNIT bytes a unit and PAGE bytes a page, with error correction or without.
#[derive(Clone, Debug)]
struct Model<const UNIT: u32, const PAGE: u32> {
    words: Bytes<u16>,
    wrong: Wrong,
    corrects: bool,
    cut: Option<(u32, u32)>,
    dead: bool,
}

const RAM: Area = Area { start: 0x2000_0000, len: 20 * 1024 };

impl<const UNIT: u32, const PAGE: u32> Model<UNIT, PAGE> {
    const FLASH: Area = Area { start: 0x0800_0000, len: 16 * 1024 + 2 * 8 * PAGE + 8 * PAGE };

    fn new(wrong: Wrong) -> Self {
        let words = vec![u16::MAX; Self::FLASH.len as usize / 2];
        Self { words, wrong, corrects: false, cut: None, dead: false }
    }

    fn corrected() -> Self {
        Self { corrects: true, ..Self::new(Wrong::Nothing) }
    }

    fn index(address: u32) -> usize {
        (address - Self::FLASH.start) as usize / 2
    }

    /// Random bits, if the power fails now.
    fn begin(&mut self) -> Result<Option<u32>, FlashError> {
        if self.dead {
            return Err(FlashError::Failed);
        }
        let Some((left, seed)) = &mut self.cut else { return Ok(None) };
        *left = left.wrapping_sub(1);
        self.dead = *left == u32::MAX;
        Ok(self.dead.then_some(seed.wrapping_mul(0x9E37_79B9) | 1))
    }
}

fn next(random: &mut u32) -> u32 {
    *random ^= *random << 13;
    *random ^= *random >> 17;
    *random ^= *random << 5;
    *random
}

impl<const UNIT: u32, const PAGE: u32> Flash for Model<UNIT, PAGE> {
    const MAP: Map =
        Map::new(Memories { flash: Self::FLASH, page: PAGE, unit: UNIT, ram: RAM }, 16 * 1024, 8 * 1024);

    fn half_word(&self, address: u32) -> u16 {
        let inside = address.is_multiple_of(2) && Self::FLASH.holds(address.into(), 2);
        let outside = if self.wrong == Wrong::ReadsZero { 0 } else { u16::MAX };
        if inside { self.words[Self::index(address)] } else { outside }
    }

    fn program(&mut self, address: u32, unit: &[u16]) -> Result<(), FlashError> {
        let address = if self.wrong == Wrong::Rounds { address - address % UNIT } else { address };
        let own = self.wrong != Wrong::Open && address < Self::MAP.application.start;
        let length = unit.len() == UNIT as usize / 2 || self.wrong == Wrong::Lengths;
        if !address.is_multiple_of(UNIT) || own || !Self::FLASH.holds(address.into(), UNIT.into()) || !length
        {
            return Err(FlashError::Address);
        }
        let at = Self::index(address);
        let there = &self.words[at..at + UNIT as usize / 2];
        let zeros = unit.iter().all(|&word| word == 0) && self.wrong != Wrong::KeepsZeros;
        if there.iter().any(|&word| word != u16::MAX) && !zeros {
            if self.wrong == Wrong::Overwrites {
                self.words[at] &= unit[0];
            }
            return Err(FlashError::NotErased);
        }
        let mut cut = self.begin()?;
        let lost = cut.as_mut().map(|random| self.corrects && next(random).is_multiple_of(3));
        for (i, &word) in unit.iter().enumerate() {
            let kept = cut.as_mut().map_or(0, |random| next(random) as u16);
            let place = if self.wrong == Wrong::Swaps { at + unit.len() - 1 - i } else { at + i };
            self.words[place] = if lost == Some(true) { 0 } else { self.words[place] & (word | kept) };
        }
        if self.dead { Err(FlashError::Failed) } else { Ok(()) }
    }

    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        let own = self.wrong != Wrong::Open && page < Self::MAP.application.start;
        if !page.is_multiple_of(PAGE) || own || !Self::FLASH.holds(page.into(), PAGE.into()) {
            return Err(FlashError::Address);
        }
        let cut = self.begin()?;
        let at = Self::index(page);
        let pages = if self.wrong == Wrong::ErasesTwo { 2 } else { 1 };
        let end = (at + pages * PAGE as usize / 2).min(self.words.len());
        if self.wrong == Wrong::Worn {
            return Ok(());
        }
        let Some(mut random) = cut else {
            self.words[at..end].fill(u16::MAX);
            return Ok(());
        };
        self.words[at..end].iter_mut().for_each(|word| *word |= next(&mut random) as u16);
        Err(FlashError::Failed)
    }
}

impl<const UNIT: u32, const PAGE: u32> Cut for Model<UNIT, PAGE> {
    fn cut_after(&mut self, operations: u32, seed: u32) {
        self.cut = Some((operations, seed));
    }

    fn restore(&mut self) -> bool {
        self.cut = None;
        core::mem::take(&mut self.dead)
    }
}

struct Board<F>(F);

impl<F: Flash> Chip for Board<F> {
    type Flash = F;

    fn transmit(&mut self, _: &Frame) -> bool {
        true
    }

    fn set_filters(&mut self, _: Node, _: [Option<Group>; 3]) {}

    fn flash(&mut self) -> &mut F {
        &mut self.0
    }

    fn feed_watchdog(&mut self) {}

    fn reset(&mut self) {}

    fn reset_cause(&self) -> Option<FaultCode> {
        None
    }

    fn straps(&self) -> Node {
        Node::HOST
    }

    fn serial_number(&self) -> u16 {
        4711
    }
}

#[test]
fn boards_of_each_unit_and_page_conform() {
    fn conforms<const UNIT: u32, const PAGE: u32>() {
        let done = chip(Board(Model::<UNIT, PAGE>::new(Wrong::Nothing)));
        assert_eq!(done.err(), None, "units of {UNIT}, pages of {PAGE}");
    }
    conforms::<2, 1024>();
    conforms::<4, 1024>();
    conforms::<8, 2048>();
    conforms::<16, 2048>();
    conforms::<8, 4096>();
}

#[test]
fn each_broken_promise_is_found() {
    let broken = |wrong| flash(&mut Board(Model::<8, 2048>::new(wrong))).err().map(|broken| broken.promise);
    for (wrong, promise) in [
        (Wrong::Nothing, None),
        (Wrong::Overwrites, Some("a refused unit stays as it is")),
        (Wrong::KeepsZeros, Some("0 can be programmed over anything")),
        (Wrong::Swaps, Some("a unit holds what was programmed, its first half-word at its first address")),
        (Wrong::ErasesTwo, Some("an erased page leaves its neighbors alone")),
        (Wrong::Rounds, Some("only a unit of the flash is programmed: Address")),
        (Wrong::Open, Some("the monitor's pages are refused: Address")),
        (Wrong::ReadsZero, Some("what is no half-word of the flash reads all ones")),
        (Wrong::Lengths, Some("a unit has its length: Address")),
        (Wrong::Worn, Some("an erased page is all ones")),
    ] {
        assert_eq!(broken(wrong), promise, "{wrong:?}");
    }
}

#[test]
fn journal_survives_power_cuts_with_each_unit() {
    let cuts = [
        survives_power_cuts(&Model::<2, 1024>::new(Wrong::Nothing), 1),
        survives_power_cuts(&Model::<4, 1024>::new(Wrong::Nothing), 1),
        survives_power_cuts(&Model::<8, 2048>::new(Wrong::Nothing), 1),
        survives_power_cuts(&Model::<8, 2048>::corrected(), 2),
        survives_power_cuts(&Model::<16, 2048>::corrected(), 1),
    ];
    for cuts in cuts {
        assert!(cuts.is_ok_and(|cuts| cuts > 400), "{cuts:?}");
    }
}
