//! TIM1: three complementary pairs with dead time, a break input, a trigger (RM0008 14).

use super::{Access, Peripheral};
use crate::time::Time;

/// The bridge's timer.
#[derive(Clone, Debug, Default)]
pub struct Tim1 {
    /// Something changed that the gates may follow from; whoever has them clears it.
    pub gates_changed: bool,
}

impl Tim1 {
    /// The break input's level, and whether the clock security system says that the crystal has failed.
    pub fn set_break(&mut self, level: bool, clock_failed: bool, now: Time) {
        let _ = (level, clock_failed, now);
    }

    /// Whether TRGO has risen since this was last asked.
    pub fn take_trigger(&mut self) -> bool {
        false
    }

    /// Whether the break interrupts.
    #[must_use]
    pub fn interrupt_break(&self) -> bool {
        false
    }

    /// Whether the update interrupts.
    #[must_use]
    pub fn interrupt_update(&self) -> bool {
        false
    }

    /// Whether a compare interrupts.
    #[must_use]
    pub fn interrupt_compare(&self) -> bool {
        false
    }
}

impl Peripheral for Tim1 {
    fn read(&mut self, _offset: u32, _now: Time) -> Access<u32> {
        Err("nothing of it is".to_owned())
    }

    fn write(&mut self, _offset: u32, _value: u32, _now: Time) -> Access<()> {
        Err("nothing of it is".to_owned())
    }
}
