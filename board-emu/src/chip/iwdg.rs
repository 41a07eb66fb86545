//! The independent watchdog (RM0008 19).

use super::{Access, Peripheral};
use crate::time::Time;

/// The watchdog, with an oscillator of its own.
#[derive(Clone, Debug, Default)]
pub struct Iwdg {
    /// It has expired: the chip is to be reset.
    pub expired: bool,
}

impl Iwdg {
    /// Stopped, as after a reset.
    pub fn reset(&mut self) {
        *self = Self::default();
    }
}

impl Peripheral for Iwdg {
    fn read(&mut self, _offset: u32, _now: Time) -> Access<u32> {
        Err("nothing of it is".to_owned())
    }

    fn write(&mut self, _offset: u32, _value: u32, _now: Time) -> Access<()> {
        Err("nothing of it is".to_owned())
    }
}
