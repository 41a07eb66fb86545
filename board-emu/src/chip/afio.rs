//! Remapping of pins, and the ports of external interrupts (RM0008 9.4).

use super::{Peripheral, RegisterResult};
use crate::time::Time;

/// MAPR's SWJ_CFG: affects only a debug probe and unused pins.
const SWJ_CFG: u32 = 7 << 24;

/// The registers.
#[derive(Clone, Debug, Default)]
pub struct Afio {
    exticr: [u32; 4],
}

impl Afio {
    /// The port (A is 0) of an external interrupt line, 0..=15.
    #[must_use]
    pub fn port(&self, line: usize) -> usize {
        (self.exticr[line / 4] >> (4 * (line % 4)) & 0xF) as usize
    }
}

impl Peripheral for Afio {
    fn read(&mut self, offset: u32, _now: Time) -> RegisterResult<u32> {
        match offset {
            // SWJ_CFG reads as undefined (RM0008 9.4.2); all other bits as 0.
            0x00 | 0x04 | 0x1C => Ok(0),
            0x08..=0x14 => Ok(self.exticr[(offset as usize - 8) / 4]),
            _ => Err("AFIO has no such register".to_owned()),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _now: Time) -> RegisterResult<()> {
        match offset {
            0x04 if value & !SWJ_CFG == 0 => {}
            0x00 | 0x1C if value == 0 => {}
            0x00 => return Err("the event output".to_owned()),
            0x04 | 0x1C => return Err("a peripheral's pins are remapped".to_owned()),
            0x08..=0x14 => {
                if (0..4).any(|line| value >> (4 * line) & 0xF > 4) {
                    return Err("an external interrupt of a port beyond E".to_owned());
                }
                self.exticr[(offset as usize - 8) / 4] = value & 0xFFFF;
            }
            _ => return Err("AFIO has no such register".to_owned()),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remap_is_rejected_and_port_selection_kept() {
        let mut afio = Afio::default();
        afio.write(0x04, 2 << 24, 0).unwrap();
        assert!(afio.write(0x04, 1 << 6, 0).is_err(), "TIM1 remapped");
        assert!(afio.write(0x1C, 1, 0).is_err());
        afio.write(0x0C, 0x0310, 0).unwrap();
        assert_eq!([4, 5, 6, 7, 8].map(|line| afio.port(line)), [0, 1, 3, 0, 0]);
        assert_eq!(afio.read(0x0C, 0), Ok(0x0310));
        assert!(afio.write(0x08, 5, 0).is_err());
    }
}
