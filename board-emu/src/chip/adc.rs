//! The converter: injected conversions on a trigger, a regular one over and over (RM0008 11).

use super::{Access, Peripheral};
use crate::time::Time;

/// ADC1.
#[derive(Clone, Debug, Default)]
pub struct Adc {
    /// What is at the inputs, 12 bits, by channel: whoever has the pins keeps it up to date.
    pub inputs: [u16; 18],
}

impl Adc {
    /// As after a reset; the inputs stay.
    pub fn reset(&mut self) {
        *self = Self { inputs: self.inputs };
    }

    /// The external trigger of the injected group rises.
    pub fn trigger(&mut self, now: Time) {
        let _ = now;
    }

    /// Whether it interrupts.
    #[must_use]
    pub fn interrupt(&self) -> bool {
        false
    }
}

impl Peripheral for Adc {
    fn read(&mut self, _offset: u32, _now: Time) -> Access<u32> {
        Err("nothing of it is".to_owned())
    }

    fn write(&mut self, _offset: u32, _value: u32, _now: Time) -> Access<()> {
        Err("nothing of it is".to_owned())
    }
}
