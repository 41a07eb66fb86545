//! Ports: pin modes, outputs, inputs (RM0008 9).

use super::{Peripheral, RegisterResult};
use crate::time::Time;

/// Pin mode (RM0008 9.1, table 20).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Analog; reads 0 as a digital input.
    Analog,
    /// Floating.
    Floating,
    /// Pulled up or down by about 40 kilo-ohm, by its bit of ODR.
    Pulled,
    /// Push-pull by its bit of ODR.
    PushPull,
    /// Open drain by its bit of ODR.
    OpenDrain,
    /// Push-pull by a peripheral.
    AlternatePushPull,
    /// Open drain by a peripheral.
    AlternateOpenDrain,
}

#[derive(Clone, Copy, Debug)]
struct Port {
    /// CRL and CRH: four bits a pin.
    modes: u64,
    odr: u32,
}

impl Port {
    const RESET: Self = Self { modes: 0x4444_4444_4444_4444, odr: 0 };

    fn mode(&self, pin: usize) -> Option<Mode> {
        let bits = self.modes >> (4 * pin) & 0xF;
        Some(match (bits >> 2, bits & 3) {
            (0, 0) => Mode::Analog,
            (1, 0) => Mode::Floating,
            (2, 0) => Mode::Pulled,
            (3, 0) => return None,
            (0, _) => Mode::PushPull,
            (1, _) => Mode::OpenDrain,
            (2, _) => Mode::AlternatePushPull,
            _ => Mode::AlternateOpenDrain,
        })
    }

    fn odr(&self, pin: usize) -> bool {
        self.odr >> pin & 1 != 0
    }
}

/// Ports A to E, at 1 KiB each.
#[derive(Clone, Debug)]
pub struct Gpio {
    /// Outside level of each pin; `None` is open.
    pub driven: [[Option<bool>; 16]; 5],
    ports: [Port; 5],
}

impl Default for Gpio {
    fn default() -> Self {
        Self { driven: [[None; 16]; 5], ports: [Port::RESET; 5] }
    }
}

impl Gpio {
    /// Reset state: all pins are floating inputs.
    pub fn reset(&mut self) {
        self.ports = [Port::RESET; 5];
    }

    /// Mode of a pin (port A is 0).
    #[must_use]
    pub fn mode(&self, port: usize, pin: usize) -> Mode {
        // A write of the reserved code is rejected.
        self.ports[port].mode(pin).unwrap_or(Mode::Floating)
    }

    /// Level that the port drives a pin to: `None` if it is no output, or an open one.
    #[must_use]
    pub fn output(&self, port: usize, pin: usize) -> Option<bool> {
        let odr = self.ports[port].odr(pin);
        match self.mode(port, pin) {
            Mode::PushPull => Some(odr),
            Mode::OpenDrain => (!odr).then_some(false),
            _ => None,
        }
    }

    /// Level at a pin (port A is 0): the driver's, or its pull's. Reads high if nothing drives it, or a
    /// peripheral does, whose level this model does not know.
    #[must_use]
    pub fn level(&self, port: usize, pin: usize) -> bool {
        let open = match self.mode(port, pin) {
            Mode::Analog => return false,
            Mode::Pulled => self.ports[port].odr(pin),
            _ => true,
        };
        self.output(port, pin).or(self.driven[port][pin]).unwrap_or(open)
    }

    /// Whether port and outside drive a pin to opposite levels.
    #[must_use]
    pub fn conflict(&self) -> Option<String> {
        for (port, name) in ['A', 'B', 'C', 'D', 'E'].into_iter().enumerate() {
            for pin in 0..16 {
                if let (Some(ours), Some(theirs)) = (self.output(port, pin), self.driven[port][pin])
                    && ours != theirs
                {
                    let ours = u8::from(ours);
                    return Some(format!(
                        "P{name}{pin} is driven to {ours}, and to the opposite from outside"
                    ));
                }
            }
        }
        None
    }

    fn idr(&self, port: usize) -> u32 {
        (0..16).map(|pin| u32::from(self.level(port, pin)) << pin).sum()
    }
}

impl Peripheral for Gpio {
    fn read(&mut self, offset: u32, _now: Time) -> RegisterResult<u32> {
        let index = (offset >> 10) as usize;
        let port = &self.ports[index];
        match offset & 0x3FF {
            0x00 => Ok(port.modes as u32),
            0x04 => Ok((port.modes >> 32) as u32),
            0x08 => Ok(self.idr(index)),
            0x0C => Ok(port.odr),
            // BSRR and BRR are write-only, and nothing was locked.
            0x10 | 0x14 | 0x18 => Ok(0),
            _ => Err("a port has no such register".to_owned()),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _now: Time) -> RegisterResult<()> {
        let port = &mut self.ports[(offset >> 10) as usize];
        match offset & 0x3FF {
            0x00 => port.modes = port.modes & !0xFFFF_FFFF | u64::from(value),
            0x04 => port.modes = port.modes & 0xFFFF_FFFF | u64::from(value) << 32,
            // IDR is read-only.
            0x08 => {}
            0x0C => port.odr = value & 0xFFFF,
            // BS wins over BR (RM0008 9.2.5).
            0x10 => port.odr = port.odr & !(value >> 16) | value & 0xFFFF,
            0x14 => port.odr &= !value,
            0x18 if value == 0 => {}
            0x18 => return Err("locking of a port's modes".to_owned()),
            _ => return Err("a port has no such register".to_owned()),
        }
        if let Some(pin) = (0..16).find(|&pin| port.mode(pin).is_none()) {
            return Err(format!("pin {pin} is set to the reserved mode CNF 3 MODE 0"));
        }
        self.conflict().map_or(Ok(()), Err)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const B: u32 = 0x400;

    #[test]
    fn level_follows_pull_output_and_outside() {
        let mut gpio = Gpio::default();
        assert_eq!(gpio.read(B, 0), Ok(0x4444_4444));
        // PB6 pulled, PB5 push-pull 2 MHz, PB4 open drain, PB3 analog.
        gpio.write(B, 0x4826_0444, 0).unwrap();
        assert_eq!(gpio.mode(1, 6), Mode::Pulled);
        assert_eq!(
            (gpio.mode(1, 5), gpio.mode(1, 4), gpio.mode(1, 3)),
            (Mode::PushPull, Mode::OpenDrain, Mode::Analog)
        );
        assert_eq!([6, 5, 4, 3].map(|pin| gpio.level(1, pin)), [false; 4]);
        gpio.write(B + 0x10, 1 << 6 | 1 << 5 | 1 << 4, 0).unwrap();
        assert_eq!([6, 5, 4, 3].map(|pin| gpio.level(1, pin)), [true, true, true, false]);
        assert_eq!([6, 5, 4].map(|pin| gpio.output(1, pin)), [None, Some(true), None]);
        gpio.driven[1][6] = Some(false);
        gpio.driven[1][4] = Some(false);
        assert_eq!(gpio.read(B + 8, 0), Ok(0xFFFF & !(1 << 6 | 1 << 4 | 1 << 3)));
    }

    #[test]
    fn set_wins_over_reset() {
        let mut gpio = Gpio::default();
        gpio.write(0x0C, 0b1010, 0).unwrap();
        gpio.write(0x10, 0b1110 << 16 | 0b0100, 0).unwrap();
        assert_eq!(gpio.read(0x0C, 0), Ok(0b0100));
        gpio.write(0x14, 0b0100, 0).unwrap();
        assert_eq!(gpio.read(0x0C, 0), Ok(0));
    }

    #[test]
    fn opposing_drivers_are_an_error() {
        let mut gpio = Gpio::default();
        gpio.driven[0][8] = Some(true);
        let text = gpio.write(4, 0x4444_4441, 0).unwrap_err();
        assert!(text.starts_with("PA8 is driven to 0"), "{text}");
        gpio.write(0x10, 1 << 8, 0).unwrap();
    }

    #[test]
    fn unmodeled_bits_are_errors() {
        let mut gpio = Gpio::default();
        assert!(gpio.write(0x18, 0x1_0000, 0).is_err());
        assert!(gpio.write(0, 0xC, 0).unwrap_err().contains("pin 0"));
        assert!(gpio.read(0x1C, 0).is_err());
    }
}
