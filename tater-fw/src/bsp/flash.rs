//! Flash driver: half-words and pages, read back (PM0075, the flash programming manual, 2.3.3 and 2.3.4).
//!
//! The code that waits here is itself fetched from the flash, so it stands still until the operation is done: 70 us a
//! half-word and 40 ms a page at most (DS5319 5.3.9).

use stm32f1xx_hal::pac::FLASH;
use tater_wire::memory::{FLASH as AREA, PAGE};

use super::address::pointer;
use crate::board::{Flash, FlashError};

/// What unlocks CR, one after the other.
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// Reads of SR after which an operation has failed: they would take longer than any, if it did not hold them up.
const PATIENCE: u32 = 1 << 20;

/// The flash, of which a program may write what lies behind its own code.
pub struct Metal {
    flash: FLASH,
    /// The first address that may be written.
    first: u32,
}

impl Metal {
    /// The flash, locked, to be written from `first` on.
    pub fn new(first: u32) -> Self {
        // SAFETY: the HAL has taken the peripheral for the wait states, and does nothing else with it.
        let flash = unsafe { FLASH::steal() };
        Self { flash, first }
    }

    fn may_write(&self, address: u32, len: u32) -> bool {
        AREA.holds(address.into(), len.into()) && address >= self.first
    }

    /// Waits for an operation that was started, and puts CR back.
    fn finish(&mut self) -> Result<(), FlashError> {
        let done = (0..PATIENCE).any(|_| self.flash.sr().read().bsy().bit_is_clear());
        let status = self.flash.sr().read();
        self.flash.sr().write(|w| w.eop().set_bit().pgerr().set_bit().wrprterr().set_bit());
        self.flash.cr().write(|w| w.lock().set_bit());
        let failed = !done || status.wrprterr().bit_is_set();
        if failed {
            return Err(FlashError::Failed);
        }
        if status.pgerr().bit_is_set() { Err(FlashError::NotErased) } else { Ok(()) }
    }

    /// Opens CR. What is written there next must clear LOCK, which a register's reset value has set.
    fn unlock(&mut self) {
        for key in KEYS {
            // SAFETY: the keys are what KEYR takes.
            self.flash.keyr().write(|w| unsafe { w.bits(key) });
        }
    }
}

impl Flash for Metal {
    fn half_word(&self, address: u32) -> u16 {
        if !AREA.holds(address.into(), 2) || !address.is_multiple_of(2) {
            return u16::MAX;
        }
        // SAFETY: an even address inside the flash, which any program may read; volatile, because it is written below.
        unsafe { core::ptr::read_volatile(pointer(address)) }
    }

    fn program(&mut self, address: u32, value: u16) -> Result<(), FlashError> {
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

    fn erase(&mut self, page: u32) -> Result<(), FlashError> {
        if !self.may_write(page, PAGE) || !page.is_multiple_of(PAGE) {
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
        let erased = (page..page + PAGE).step_by(2).all(|address| self.half_word(address) == u16::MAX);
        if erased { Ok(()) } else { Err(FlashError::Verify) }
    }
}
