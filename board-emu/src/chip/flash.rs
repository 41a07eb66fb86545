//! 128 KiB of flash in pages of 1 KiB: programming by half-words, page erase, busy times (RM0008 3, PM0075).

use super::{Access, Peripheral};
use super::{Refusal, Size};
use crate::time::Time;
use tater_wire::memory::FLASH;

/// The flash and its registers.
#[derive(Clone, Debug)]
pub struct Flash {
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// Until when an operation keeps it busy: fetches and reads wait.
    pub busy_until: Time,
    /// Goes up with every change of its bytes: what was decoded from them is stale.
    pub version: u32,
}

impl Default for Flash {
    fn default() -> Self {
        Self { bytes: vec![0xFF; FLASH.len as usize], busy_until: 0, version: 0 }
    }
}

impl Flash {
    /// The registers as after a reset: locked.
    pub fn reset(&mut self, now: Time) {
        let _ = now;
    }

    /// Reads at an offset; only within the flash.
    ///
    /// # Errors
    /// None yet.
    pub fn read(&mut self, offset: u32, size: Size) -> Result<u32, Refusal> {
        let at = offset as usize;
        let byte = |i: usize| u32::from(self.bytes.get(at + i).copied().unwrap_or(0xFF)) << (8 * i);
        Ok((0..size.bytes() as usize).map(byte).sum())
    }

    /// A write to an address of the flash: programs, if the registers allow it.
    ///
    /// # Errors
    /// A width other than 16 bits is a bus error.
    pub fn program(&mut self, offset: u32, size: Size, value: u32, now: Time) -> Result<(), Refusal> {
        let _ = (offset, size, value, now);
        Err(Refusal::NotModelled("programming".to_owned()))
    }
}

impl Peripheral for Flash {
    fn read(&mut self, _offset: u32, _now: Time) -> Access<u32> {
        Err("nothing of it is".to_owned())
    }

    fn write(&mut self, _offset: u32, _value: u32, _now: Time) -> Access<()> {
        Err("nothing of it is".to_owned())
    }
}
