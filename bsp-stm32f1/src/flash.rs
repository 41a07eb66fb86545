//! Flash driver: half-words and pages, read back (PM0075, the flash programming manual, 2.3.3 and 2.3.4).
//!
//! The registers are behind embedded-storage's NOR traits; the board's [`Flash`] is one write or one page of them.
//! It reads directly, because [`ReadNorFlash::read`] needs `&mut self` and the journal iterates over its records.
//!
//! The code that waits here is itself fetched from the flash, so it stands still until the operation is done: at most 70 µs
//! for a half-word and 40 ms for a page (DS5319 5.3.9).

use core::marker::PhantomData;

use boot::{Flash, FlashError};
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use stm32f1xx_hal::pac::FLASH;
use tater_wire::map::Map;

use crate::address::pointer;

/// CR's unlock sequence.
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// Polls of SR before an operation counts as failed: far longer than any operation takes.
const MAX_POLLS: u32 = 1 << 20;

/// A board with its memory map.
pub trait Mapped {
    /// See [`Flash::MAP`].
    const MAP: Map;
}

/// The flash. A program may write only what lies behind its own code.
pub struct Metal<B: Mapped> {
    flash: FLASH,
    first: u32,
    board: PhantomData<B>,
}

impl<B: Mapped> Metal<B> {
    /// The flash, locked; writable from `first` on.
    pub fn new(first: u32) -> Self {
        // SAFETY: the HAL has taken the peripheral for the wait states, and does nothing else with it.
        let flash = unsafe { FLASH::steal() };
        Self { flash, first, board: PhantomData }
    }

    fn may_write(&self, address: u32, len: u32) -> bool {
        B::MAP.of.flash.holds(address.into(), len.into()) && address >= self.first
    }

    /// Waits for the operation to end and locks CR.
    fn finish(&mut self) -> Result<(), FlashError> {
        let done = (0..MAX_POLLS).any(|_| self.flash.sr().read().bsy().bit_is_clear());
        let status = self.flash.sr().read();
        self.flash.sr().write(|w| w.eop().set_bit().pgerr().set_bit().wrprterr().set_bit());
        self.flash.cr().write(|w| w.lock().set_bit());
        let failed = !done || status.wrprterr().bit_is_set();
        if failed {
            return Err(FlashError::Failed);
        }
        if status.pgerr().bit_is_set() { Err(FlashError::NotErased) } else { Ok(()) }
    }

    /// Unlocks CR. The next write to CR must clear LOCK, which is set in the register's reset value.
    fn unlock(&mut self) {
        for key in KEYS {
            // SAFETY: KEYR takes these two keys.
            self.flash.keyr().write(|w| unsafe { w.bits(key) });
        }
    }

    fn program_half_word(&mut self, address: u32, value: u16) -> Result<(), FlashError> {
        if !self.may_write(address, 2) || !address.is_multiple_of(2) {
            return Err(FlashError::Address);
        }
        self.unlock();
        self.flash.cr().write(|w| w.lock().clear_bit().pg().set_bit());
        // SAFETY: an even address inside the flash, behind the code that runs; with PG set the write programs a half-word.
        unsafe { core::ptr::write_volatile(pointer(address), value) };
        self.finish()?;
        if self.half_word(address) == value { Ok(()) } else { Err(FlashError::Verify) }
    }

    fn erase_page(&mut self, page: u32) -> Result<(), FlashError> {
        if !self.may_write(page, B::MAP.of.page) || !page.is_multiple_of(B::MAP.of.page) {
            return Err(FlashError::Address);
        }
        self.unlock();
        self.flash.cr().write(|w| w.lock().clear_bit().per().set_bit());
        // SAFETY: a page behind the code that runs.
        self.flash.ar().write(|w| unsafe { w.bits(page) });
        self.flash.cr().write(|w| w.lock().clear_bit().per().set_bit().strt().set_bit());
        // BSY rises a cycle late (errata): this read does not count.
        let _ = self.flash.sr().read();
        cortex_m::asm::nop();
        self.finish()?;
        let erased =
            (page..page + B::MAP.of.page).step_by(2).all(|address| self.half_word(address) == u16::MAX);
        if erased { Ok(()) } else { Err(FlashError::Verify) }
    }
}

impl<B: Mapped> ErrorType for Metal<B> {
    type Error = FlashError;
}

/// Offsets count from the start of the flash.
impl<B: Mapped> ReadNorFlash for Metal<B> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let address = B::MAP.of.flash.start.wrapping_add(offset);
        if !B::MAP.of.flash.holds(address.into(), u64::try_from(bytes.len()).unwrap_or(u64::MAX)) {
            return Err(FlashError::Address);
        }
        for (address, byte) in (address..).zip(bytes) {
            // SAFETY: inside the flash, which any program may read; volatile, because it is written above.
            *byte = unsafe { core::ptr::read_volatile(pointer(address)) };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        usize::try_from(B::MAP.of.flash.len).unwrap_or(0)
    }
}

/// Programs half-words and erases pages, each read back, up to the first that fails.
impl<B: Mapped> NorFlash for Metal<B> {
    const WRITE_SIZE: usize = 2;
    const ERASE_SIZE: usize = B::MAP.of.page as usize;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let (pairs, rest) = bytes.as_chunks();
        if !rest.is_empty() {
            return Err(FlashError::Address);
        }
        let addresses = (B::MAP.of.flash.start.wrapping_add(offset)..).step_by(Self::WRITE_SIZE);
        let mut half_words = addresses.zip(pairs);
        half_words.try_for_each(|(address, pair)| self.program_half_word(address, u16::from_le_bytes(*pair)))
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let (from, to) = (B::MAP.of.flash.start.wrapping_add(from), B::MAP.of.flash.start.wrapping_add(to));
        (from..to).step_by(Self::ERASE_SIZE).try_for_each(|page| self.erase_page(page))
    }
}

impl<B: Mapped> Flash for Metal<B> {
    const MAP: Map = B::MAP;

    // Inlined into each of its callers it takes 380 bytes more of the monitor.
    #[inline(never)]
    fn half_word(&self, address: u32) -> u16 {
        if !B::MAP.of.flash.holds(address.into(), 2) || !address.is_multiple_of(2) {
            return u16::MAX;
        }
        // SAFETY: an even address inside the flash, which any program may read; volatile, because it is written above.
        unsafe { core::ptr::read_volatile(pointer(address)) }
    }

    fn program(&mut self, address: u32, unit: &[u16]) -> Result<(), FlashError> {
        let &[value] = unit else { return Err(FlashError::Address) };
        self.write(address.wrapping_sub(B::MAP.of.flash.start), &value.to_le_bytes())
    }

    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        let offset = page.wrapping_sub(B::MAP.of.flash.start);
        NorFlash::erase(self, offset, offset.wrapping_add(B::MAP.of.page))
    }
}
