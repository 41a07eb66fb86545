//! External interrupts of pins (RM0008 10.3). No program of the board uses them.

use super::{Peripheral, RegisterResult};
use crate::time::Time;

/// Lines of pins; those of supply, clock and USB are not modeled.
const LINES: u32 = 0xFFFF;

/// Its registers.
#[derive(Clone, Debug, Default)]
pub struct Exti {
    imr: u32,
    emr: u32,
    rising: u32,
    falling: u32,
    pending: u32,
    /// Last levels, while any line waits for an edge.
    levels: Option<u32>,
}

impl Exti {
    /// Whether any line waits for an edge.
    #[must_use]
    pub const fn listens(&self) -> bool {
        (self.rising | self.falling) != 0
    }

    /// Sets the levels of the lines, a bit each.
    pub fn set_inputs(&mut self, levels: u32) {
        let before = self.levels.replace(levels).unwrap_or(levels);
        let (up, down) = (levels & !before, before & !levels);
        self.pending |= up & self.rising | down & self.falling;
    }

    /// No line waits for an edge: forget the levels.
    pub const fn forget(&mut self) {
        self.levels = None;
    }

    /// Lines that request an interrupt.
    #[must_use]
    pub const fn interrupts(&self) -> u32 {
        self.pending & self.imr
    }
}

impl Peripheral for Exti {
    fn read(&mut self, offset: u32, _now: Time) -> RegisterResult<u32> {
        match offset {
            0x00 => Ok(self.imr),
            0x04 => Ok(self.emr),
            0x08 => Ok(self.rising),
            0x0C => Ok(self.falling),
            0x10 => Ok(0),
            0x14 => Ok(self.pending),
            _ => Err("EXTI has no such register".to_owned()),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _now: Time) -> RegisterResult<()> {
        if value & !LINES != 0 {
            return Err("a line beyond 15".to_owned());
        }
        match offset {
            0x00 => self.imr = value,
            // An event wakes a core in WFE.
            0x04 if value == 0 => self.emr = 0,
            0x04 => return Err("events".to_owned()),
            0x08 => self.rising = value,
            0x0C => self.falling = value,
            0x10 => self.pending |= value,
            0x14 => self.pending &= !value,
            _ => return Err("EXTI has no such register".to_owned()),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edge_is_pending_until_cleared() {
        let mut exti = Exti::default();
        exti.write(0x00, 0b11, 0).unwrap();
        exti.write(0x08, 0b101, 0).unwrap();
        exti.write(0x0C, 0b10, 0).unwrap();
        assert!(exti.listens());
        exti.set_inputs(0b10);
        assert_eq!(exti.interrupts(), 0, "what was there before is no edge");
        exti.forget();
        exti.set_inputs(0);
        exti.set_inputs(0b10);
        assert_eq!(exti.interrupts(), 0, "line 1 rose but is masked");
        exti.set_inputs(0b101);
        assert_eq!(exti.interrupts(), 0b11, "line 2 is masked");
        exti.write(0x14, 0b01, 0).unwrap();
        assert_eq!(exti.read(0x14, 0), Ok(0b110));
        assert!(exti.write(0x00, 1 << 16, 0).is_err());
    }
}
