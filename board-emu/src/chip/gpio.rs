//! The ports: modes of pins, outputs, inputs (RM0008 9).

use super::{Access, Peripheral};
use crate::time::Time;

/// Ports A to E, at 1 KiB each.
#[derive(Clone, Debug, Default)]
pub struct Gpio {
    /// What the world does to each pin: a level, or nothing (open).
    pub driven: [[Option<bool>; 16]; 5],
}

impl Gpio {
    /// As after a reset: all pins floating inputs.
    pub fn reset(&mut self) {}

    /// The level at a pin (port A is 0): what drives it, or its pull.
    #[must_use]
    pub fn level(&self, port: usize, pin: usize) -> bool {
        self.driven[port][pin].unwrap_or(true)
    }
}

impl Peripheral for Gpio {
    fn read(&mut self, _offset: u32, _now: Time) -> Access<u32> {
        Err("nothing of it is".to_owned())
    }

    fn write(&mut self, _offset: u32, _value: u32, _now: Time) -> Access<()> {
        Err("nothing of it is".to_owned())
    }
}
