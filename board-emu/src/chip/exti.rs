//! External interrupts (RM0008 10.3).

use super::{Access, Peripheral};
use crate::time::Time;

/// Its registers.
#[derive(Clone, Debug, Default)]
pub struct Exti;

impl Peripheral for Exti {
    fn read(&mut self, _offset: u32, _now: Time) -> Access<u32> {
        Err("nothing of it is".to_owned())
    }

    fn write(&mut self, _offset: u32, _value: u32, _now: Time) -> Access<()> {
        Err("nothing of it is".to_owned())
    }
}
