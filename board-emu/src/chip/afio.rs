//! Remapping of pins (RM0008 9.4).

use super::{Access, Peripheral};
use crate::time::Time;

/// Its registers.
#[derive(Clone, Debug, Default)]
pub struct Afio;

impl Peripheral for Afio {
    fn read(&mut self, _offset: u32, _now: Time) -> Access<u32> {
        Err("nothing of it is".to_owned())
    }

    fn write(&mut self, _offset: u32, _value: u32, _now: Time) -> Access<()> {
        Err("nothing of it is".to_owned())
    }
}
