//! TIM2, TIM3, TIM4: counter, capture of the exclusive or of three lines, reset by a trigger (RM0008 15).

use super::{Access, Peripheral};
use crate::time::Time;

/// A general-purpose timer.
#[derive(Clone, Debug, Default)]
pub struct Timer;

impl Timer {
    /// The levels of channels 1 to 3.
    pub fn set_inputs(&mut self, levels: [bool; 3], now: Time) {
        let _ = (levels, now);
    }

    /// Whether it interrupts.
    #[must_use]
    pub fn interrupt(&self) -> bool {
        false
    }
}

impl Peripheral for Timer {
    fn read(&mut self, _offset: u32, _now: Time) -> Access<u32> {
        Err("nothing of it is".to_owned())
    }

    fn write(&mut self, _offset: u32, _value: u32, _now: Time) -> Access<()> {
        Err("nothing of it is".to_owned())
    }
}
