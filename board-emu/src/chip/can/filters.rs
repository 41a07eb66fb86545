//! Acceptance filters: 14 banks, each 32 or 16 bits wide, masks or lists (RM0008 24.7.4).

use super::super::RegisterResult;
use std::cmp::Reverse;
use tater_wire::Frame;

/// Banks of a medium-density chip.
const BANKS: usize = 14;
const ALL: u32 = (1 << BANKS) - 1;

/// FMR: initialization. The other bits are reserved and keep their reset value.
const FINIT: u32 = 1;
const FMR: u32 = 0x2A1C_0E00;

#[derive(Clone, Debug)]
pub(super) struct Filters {
    initialization: bool,
    /// A bit for each bank: list mode, 32 bits, FIFO 1, active (FM1R, FS1R, FFA1R, FA1R).
    lists: u32,
    wide: u32,
    fifo: u32,
    active: u32,
    banks: [[u32; 2]; BANKS],
}

impl Default for Filters {
    fn default() -> Self {
        Self { initialization: true, lists: 0, wide: 0, fifo: 0, active: 0, banks: [[0; 2]; BANKS] }
    }
}

/// Priority of a match: wide before narrow, lists before masks, then low numbers.
type Rank = (bool, bool, Reverse<usize>);

impl Filters {
    pub(super) fn read(&self, offset: u32) -> RegisterResult<u32> {
        Ok(match offset {
            0x00 => FMR | u32::from(self.initialization),
            0x04 => self.lists,
            0x0C => self.wide,
            0x14 => self.fifo,
            0x1C => self.active,
            0x40..0xB0 => {
                let (bank, register) = place(offset);
                self.banks[bank][register]
            }
            _ => return Err(format!("no register of the filters at offset {:#x}", offset + 0x200)),
        })
    }

    /// Fields that are write-protected outside initialization, or while their bank is active, keep their
    /// value.
    pub(super) fn write(&mut self, offset: u32, value: u32) -> RegisterResult<()> {
        let open = self.initialization;
        match offset {
            0x00 => self.initialization = value & FINIT != 0,
            0x04 if open => self.lists = value & ALL,
            0x0C if open => self.wide = value & ALL,
            0x14 if open => self.fifo = value & ALL,
            0x04 | 0x0C | 0x14 => {}
            0x1C => self.active = value & ALL,
            0x40..0xB0 => {
                let (bank, register) = place(offset);
                if open || self.active >> bank & 1 == 0 {
                    self.banks[bank][register] = value;
                }
            }
            _ => return Err(format!("no register of the filters at offset {:#x}", offset + 0x200)),
        }
        Ok(())
    }

    /// FIFO and filter number.
    pub(super) fn pass(&self, frame: &Frame) -> Option<(usize, u32)> {
        if self.initialization {
            return None;
        }
        // Numbers count separately for each FIFO, inactive banks included.
        let mut numbers = [0; 2];
        let mut best: Option<(Rank, (usize, u32))> = None;
        for bank in 0..BANKS {
            let bit = |bits: u32| bits >> bank & 1 == 1;
            let fifo = usize::from(bit(self.fifo));
            let (lists, wide) = (bit(self.lists), bit(self.wide));
            let hits = if bit(self.active) {
                matches(self.banks[bank], lists, wide, frame.raw_id())
            } else {
                vec![]
            };
            for (i, hit) in hits.into_iter().enumerate() {
                let rank = (wide, lists, Reverse(bank * 4 + i));
                if hit && best.is_none_or(|(other, _)| rank > other) {
                    best = Some((rank, (fifo, numbers[fifo] + i as u32)));
                }
            }
            numbers[fifo] += filters(lists, wide);
        }
        best.map(|(_, found)| found)
    }
}

const fn place(offset: u32) -> (usize, usize) {
    ((offset as usize - 0x40) / 8, offset as usize / 4 % 2)
}

const fn filters(lists: bool, wide: bool) -> u32 {
    match (lists, wide) {
        (false, true) => 1,
        (true, true) | (false, false) => 2,
        (true, false) => 4,
    }
}

/// The filters of a bank that accept a data frame with an 11-bit identifier, which is in the upper bits; the
/// bits of an extended identifier, IDE and RTR are 0 (figure 230).
fn matches([first, second]: [u32; 2], lists: bool, wide: bool, id: u16) -> Vec<bool> {
    let (long, short) = (u32::from(id) << 21, u32::from(id) << 5);
    let halves = |word: u32| [word & 0xFFFF, word >> 16];
    match (lists, wide) {
        // Bit 0 is unused.
        (false, true) => vec![(long ^ first) & second & !1 == 0],
        (true, true) => vec![(long ^ first) & !1 == 0, (long ^ second) & !1 == 0],
        (false, false) => {
            [first, second].map(halves).into_iter().map(|[id, mask]| (short ^ id) & mask == 0).collect()
        }
        (true, false) => [first, second].into_iter().flat_map(halves).map(|id| short == id).collect(),
    }
}
