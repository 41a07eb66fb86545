//! Resets of single peripherals (RM0008 7.3.4, 7.3.5).

use super::{Chip, Peripheral};
use super::{afio, tim1, timer, wwdg};

/// Reset state of a port (RM0008 9.2): all pins floating inputs, all outputs low.
const PORT: [(u32, u32); 3] = [(0x00, 0x4444_4444), (0x04, 0x4444_4444), (0x0C, 0)];

impl Chip {
    pub(super) fn reset_peripherals(&mut self) {
        while let Some(base) = self.rcc.take_peripheral_reset() {
            self.reset_peripheral(base);
        }
    }

    fn reset_peripheral(&mut self, base: u32) {
        match base {
            0x4000_0000 => self.tim2 = timer::Timer::default(),
            0x4000_0400 => self.tim3 = timer::Timer::default(),
            0x4000_0800 => self.tim4 = timer::Timer::default(),
            0x4000_2C00 => self.wwdg = wwdg::Wwdg::default(),
            0x4000_6400 => self.can.reset(),
            // The EXTI has no reset bit.
            0x4001_0000 => self.afio = afio::Afio::default(),
            0x4001_0800..0x4001_1C00 => {
                for (offset, value) in PORT {
                    // A register that the ports do not model is unchanged.
                    let _ = self.gpio.write(base - 0x4001_0800 + offset, value, self.now);
                }
            }
            0x4001_2400 => self.adc.reset(),
            0x4001_2C00 => {
                self.tim1 = tim1::Tim1::default();
                self.tim1.gates_changed = true;
            }
            // Not modeled, hence in reset state already.
            _ => {}
        }
    }
}
