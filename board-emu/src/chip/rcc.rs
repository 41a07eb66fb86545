//! Clocks and the cause of the last reset (RM0008 7).

use super::Reset;
use super::{Access, Peripheral};
use crate::time::Time;

/// Clocks and reset.
#[derive(Clone, Debug, Default)]
pub struct Rcc;

impl Rcc {
    /// All as after a reset; the flags say which.
    pub fn reset(&mut self, cause: Reset) {
        let _ = cause;
    }

    /// Whether the clock of the peripheral at an address is on.
    #[must_use]
    pub fn is_clocked(&self, address: u32) -> bool {
        let _ = address;
        true
    }

    /// Ticks ([`crate::time`]) a cycle of the core: 2 at 72 MHz, 18 at 8 MHz.
    #[must_use]
    pub fn core_cycle(&self) -> Time {
        18
    }

    /// Whether the clock security system has seen the crystal fail, which it says by NMI until told that it is seen.
    #[must_use]
    pub fn clock_failed(&self) -> bool {
        false
    }

    /// The crystal dies (or comes back).
    pub fn set_crystal(&mut self, alive: bool, now: Time) {
        let _ = (alive, now);
    }
}

impl Peripheral for Rcc {
    fn read(&mut self, _offset: u32, _now: Time) -> Access<u32> {
        Err("nothing of it is".to_owned())
    }

    fn write(&mut self, _offset: u32, _value: u32, _now: Time) -> Access<()> {
        Err("nothing of it is".to_owned())
    }
}
