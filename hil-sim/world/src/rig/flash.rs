//! The microcontroller's flash, with power failures where a test wants them.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

use boot::{Flash, FlashError};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use tater_f103::map::{FLASH, MAP, MONITOR, PAGE, STORAGE};
use tater_wire::map::{Area, Map};

/// Programming a half-word, µs (STM32F103 data sheet: 40 to 70, typically 52.5).
const PROGRAM_US: u64 = 53;

/// Erasing a page, µs (STM32F103 data sheet: 20 to 40 ms).
const ERASE_US: u64 = 40_000;

/// What a program may write: the monitor's pages no program may.
const WRITABLE: Area = Area { start: MONITOR.end(), len: FLASH.len - MONITOR.len };

const PAGE_BYTES: usize = PAGE as usize;

/// A count of reads, which change nothing else.
#[derive(Debug, Default)]
struct Reads(AtomicU64);

impl Clone for Reads {
    fn clone(&self) -> Self {
        Self(AtomicU64::new(self.0.load(Ordering::Relaxed)))
    }
}

/// An STM32F103CB's flash.
#[derive(Clone, Debug)]
pub struct SimFlash {
    bytes: Vec<u8>,
    operations: u64,
    /// The operation interrupted by a power failure, and the seed of what it leaves behind.
    cut: Option<(u64, u64)>,
    dead: bool,
    worn: bool,
    /// Pages, by index, whose operations fail.
    worn_pages: u128,
    /// Bits that read either way since an erase was interrupted, by the index of their half-word; and the reads of such half-words so far.
    marginal: BTreeMap<usize, u16>,
    reads: Reads,
    damaged: bool,
    page_in_use: u32,
    busy_us: u64,
    erases: Vec<u32>,
    bridge_on: bool,
    erased_while_driven: u32,
}

impl Default for SimFlash {
    fn default() -> Self {
        Self {
            bytes: vec![0xFF; FLASH.len as usize],
            operations: 0,
            cut: None,
            dead: false,
            worn: false,
            worn_pages: 0,
            marginal: BTreeMap::new(),
            reads: Reads::default(),
            damaged: false,
            page_in_use: 0,
            busy_us: 0,
            erases: vec![0; MAP.pages(FLASH) as usize],
            bridge_on: false,
            erased_while_driven: 0,
        }
    }
}

impl SimFlash {
    /// Flash operations (half-words programmed, pages erased) so far.
    #[must_use]
    pub const fn operations(&self) -> u64 {
        self.operations
    }

    /// Cuts the power during operation `operation` (from 0) until [`Self::power_up`]; `seed` determines the bits that remain.
    pub const fn cut_at(&mut self, operation: u64, seed: u64) {
        self.cut = Some((operation, seed));
    }

    /// Cancels a planned failure.
    pub const fn cancel_cut(&mut self) {
        self.cut = None;
    }

    /// Whether the power has failed.
    #[must_use]
    pub const fn is_dead(&self) -> bool {
        self.dead
    }

    /// Sets whether the flash is worn out: then every operation fails.
    pub const fn set_worn(&mut self, worn: bool) {
        self.worn = worn;
        self.damaged |= worn;
    }

    /// Sets which pages are worn out: bit n is page n of the flash.
    pub const fn set_worn_pages(&mut self, pages: u128) {
        self.worn_pages = pages;
        self.damaged |= pages != 0;
    }

    /// Flips a bit, as radiation or a leaking cell does; ignored beyond the flash.
    pub fn flip(&mut self, address: u32, bit: u8) {
        let at = address.wrapping_sub(FLASH.start) as usize;
        if let Some(byte) = self.bytes.get_mut(at) {
            *byte ^= 1 << (bit % 8);
        }
        self.damaged = true;
    }

    /// Whether bits have been flipped or weakened, or pages worn out: from then on an operation may fail, because a half-word that
    /// should be erased is not, or because the store no longer tries a page that failed.
    #[must_use]
    pub const fn was_damaged(&self) -> bool {
        self.damaged
    }

    /// Makes bits of a half-word read either way until it is programmed or its page is erased.
    pub fn weaken(&mut self, address: u32, bits: u16) {
        let at = address.wrapping_sub(FLASH.start) as usize / 2;
        if bits != 0 && at < self.bytes.len() / 2 {
            *self.marginal.entry(at).or_default() |= bits;
            self.damaged = true;
        }
    }

    /// Address of the page of the storage that holds the newest record, in which something was written last; 0 before. The first half-word
    /// only marks an erased page as ready, and a half-word of 0 voids something older.
    #[must_use]
    pub const fn page_in_use(&self) -> u32 {
        self.page_in_use
    }

    /// Restores the power and cancels a planned failure.
    pub const fn power_up(&mut self) {
        self.dead = false;
        self.cut = None;
        self.bridge_on = false;
    }

    /// Reports whether the bridge is on; an erase meanwhile counts as a violation.
    pub const fn set_bridge_on(&mut self, on: bool) {
        self.bridge_on = on;
    }

    /// Pages erased while the bridge was on.
    #[must_use]
    pub const fn erased_while_driven(&self) -> u32 {
        self.erased_while_driven
    }

    /// Returns and clears the time for which the flash stalled the processor, µs.
    pub const fn take_busy_us(&mut self) -> u64 {
        let busy = self.busy_us;
        self.busy_us = 0;
        busy
    }

    /// Whether it has stalled the processor since [`Self::take_busy_us`].
    #[must_use]
    pub const fn is_busy(&self) -> bool {
        self.busy_us > 0
    }

    /// How often each page has been erased.
    #[must_use]
    pub fn erases(&self) -> &[u32] {
        &self.erases
    }

    /// The whole contents from address 0x0800_0000.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Writes like an external programmer: no timing, no rules. Bytes beyond the flash are dropped.
    pub fn load(&mut self, address: u32, bytes: &[u8]) {
        let at = address.wrapping_sub(FLASH.start) as usize;
        for (to, from) in self.bytes.iter_mut().skip(at).zip(bytes) {
            *to = *from;
        }
    }

    /// Returns a source of random bits if the power fails during the operation.
    fn begin(&mut self, page: usize, us: u64) -> Result<Option<Pcg64Mcg>, FlashError> {
        if self.dead || self.worn || self.worn_pages >> page & 1 == 1 {
            return Err(FlashError::Failed);
        }
        let cut = self.cut.filter(|&(at, _)| at == self.operations);
        self.operations += 1;
        self.busy_us += us;
        self.dead = cut.is_some();
        Ok(cut.map(|(at, seed)| Pcg64Mcg::new(u128::from(seed) << 64 | u128::from(at))))
    }

    /// Each read of a marginal bit gives a random level, the same in each run.
    #[cold]
    fn read_marginal(&self, at: usize, read: u16) -> u16 {
        let Some(&bits) = self.marginal.get(&at) else { return read };
        let reads = self.reads.0.fetch_add(1, Ordering::Relaxed);
        read ^ (bits & (reads.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 24) as u16)
    }
}

impl Flash for SimFlash {
    const MAP: Map = MAP;

    fn half_word(&self, address: u32) -> u16 {
        let at = address.wrapping_sub(FLASH.start) as usize;
        let read = self
            .bytes
            .get(at..)
            .and_then(<[u8]>::first_chunk)
            .map_or(u16::MAX, |&pair| u16::from_le_bytes(pair));
        if self.marginal.is_empty() { read } else { self.read_marginal(at / 2, read) }
    }

    fn program(&mut self, address: u32, unit: &[u16]) -> Result<(), FlashError> {
        let &[value] = unit else { return Err(FlashError::Address) };
        if !address.is_multiple_of(2) || !WRITABLE.holds(u64::from(address), 2) {
            return Err(FlashError::Address);
        }
        let at = (address - FLASH.start) as usize / 2;
        let present = self.half_word(address);
        if present != u16::MAX && value != 0 {
            return Err(FlashError::NotErased);
        }
        let cut = self.begin(at / (PAGE_BYTES / 2), PROGRAM_US)?;
        let kept = cut.map_or(0, |mut rng| rng.random::<u16>());
        // Some bits were not cleared.
        let written = present & (value | kept);
        self.marginal.remove(&at);
        if STORAGE.holds(address.into(), 2) && !address.is_multiple_of(PAGE) && value != 0 {
            self.page_in_use = address - address % PAGE;
        }
        self.load(address, &written.to_le_bytes());
        if self.dead { Err(FlashError::Failed) } else { Ok(()) }
    }

    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        if !page.is_multiple_of(PAGE) || !WRITABLE.holds(u64::from(page), u64::from(PAGE)) {
            return Err(FlashError::Address);
        }
        self.erased_while_driven += u32::from(self.bridge_on);
        let index = (page - FLASH.start) as usize / PAGE_BYTES;
        let cut = self.begin(index, ERASE_US)?;
        let words = index * PAGE_BYTES / 2..(index + 1) * PAGE_BYTES / 2;
        self.marginal.retain(|at, _| !words.contains(at));
        let bytes = &mut self.bytes[index * PAGE_BYTES..(index + 1) * PAGE_BYTES];
        match cut {
            None => {
                bytes.fill(0xFF);
                self.erases[index] += 1;
            }
            Some(mut rng) => match rng.random_range(0..4) {
                // Hardly begun, complete, some bits set, random bits.
                0 => {}
                1 => bytes.fill(0xFF),
                2 => bytes.iter_mut().for_each(|byte| *byte |= rng.random::<u8>()),
                _ => bytes.iter_mut().for_each(|byte| *byte = rng.random()),
            },
        }
        if self.dead { Err(FlashError::Failed) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT: u32 = MONITOR.end() + 2048;

    #[test]
    fn half_word_is_programmed_once_and_erased_by_the_page() {
        let mut flash = SimFlash::default();
        assert_eq!(flash.program(AT, &[0x1234]), Ok(()));
        assert_eq!(flash.half_word(AT), 0x1234);
        assert_eq!(flash.program(AT, &[0x1230]), Err(FlashError::NotErased));
        assert_eq!(flash.program(AT, &[0]), Ok(()), "0 goes over anything");
        assert_eq!(flash.program(AT + 1, &[0]), Err(FlashError::Address));
        assert_eq!(flash.program(FLASH.end(), &[0]), Err(FlashError::Address));
        assert_eq!(flash.program(MONITOR.start, &[0]), Err(FlashError::Address));
        assert_eq!(flash.erase(AT + 2), Err(FlashError::Address));
        assert_eq!(flash.erase(AT), Ok(()));
        assert_eq!((flash.half_word(AT), flash.erases()[18]), (0xFFFF, 1));
        assert_eq!(flash.take_busy_us(), 2 * PROGRAM_US + ERASE_US);
        assert_eq!(flash.operations(), 3);
    }

    #[test]
    fn power_cut_leaves_bits_set_and_fails_later_operations() {
        let mut seen = std::collections::BTreeSet::new();
        for seed in 0..200 {
            let mut flash = SimFlash::default();
            flash.cut_at(1, seed);
            assert_eq!(flash.program(AT, &[0x5555]), Ok(()));
            assert_eq!(flash.program(AT + 2, &[0x0F0F]), Err(FlashError::Failed));
            assert!(flash.is_dead());
            assert_eq!(flash.program(AT + 4, &[1]), Err(FlashError::Failed));
            assert_eq!((flash.half_word(AT), flash.half_word(AT + 4)), (0x5555, 0xFFFF));
            let left = flash.half_word(AT + 2);
            assert_eq!(left & 0x0F0F, 0x0F0F, "ones stay");
            seen.insert(left);
            flash.power_up();
            assert_eq!(flash.program(AT + 4, &[1]), Ok(()));
        }
        assert!(seen.len() > 50, "{}", seen.len());
    }

    #[test]
    fn page_in_use_is_of_the_storage() {
        let mut flash = SimFlash::default();
        let page = MAP.page(STORAGE, 3);
        for (address, value) in
            [(page + 2, 1), (MAP.page(STORAGE, 4), 1), (MAP.page(STORAGE, 5) + 2, 0), (AT + 2, 1)]
        {
            assert_eq!(flash.program(address, &[value]), Ok(()));
            assert_eq!(flash.page_in_use(), page, "{address:x} {value}");
        }
    }

    #[test]
    fn erase_with_the_bridge_on_is_counted() {
        let mut flash = SimFlash::default();
        flash.set_bridge_on(true);
        assert_eq!(flash.erase(AT), Ok(()));
        assert_eq!(flash.erased_while_driven(), 1);
    }
}
