//! The STM32F103CB around its core: memory, peripherals, and the wires between them (RM0008).
//!
//! One peripheral a file. Registers that the programs do not touch are not modeled; an access to one ends the
//! run.

pub mod adc;
pub mod afio;
pub mod can;
pub mod counter;
pub mod exti;
pub mod flash;
pub mod gpio;
pub mod iwdg;
mod peripheral;
pub mod rcc;
mod resets;
pub mod tim1;
pub mod timer;
pub mod uid;
pub mod wwdg;

pub use peripheral::{AccessError, Peripheral, RegisterResult, Reset, Size};

use tater_f103::map::RAM;

use crate::time::{NEVER, Time};

/// Memory, peripherals and wires.
#[derive(Clone, Debug)]
pub struct Chip {
    /// Present time.
    pub now: Time,
    /// Flash with its registers and busy times.
    pub flash: flash::Flash,
    /// 20 KiB.
    pub ram: Vec<u8>,
    /// Clocks and reset.
    pub rcc: rcc::Rcc,
    /// Ports A to E.
    pub gpio: gpio::Gpio,
    /// Remapping.
    pub afio: afio::Afio,
    /// External interrupts.
    pub exti: exti::Exti,
    /// The bridge's timer.
    pub tim1: tim1::Tim1,
    /// Free-running clock.
    pub tim2: timer::Timer,
    /// Control tick.
    pub tim3: timer::Timer,
    /// Hall timer.
    pub tim4: timer::Timer,
    /// The converter.
    pub adc: adc::Adc,
    /// The CAN controller.
    pub can: can::Can,
    /// The independent watchdog.
    pub iwdg: iwdg::Iwdg,
    /// The window watchdog.
    pub wwdg: wwdg::Wwdg,
    /// Unique device ID.
    pub uid: uid::Uid,
    /// Set by every access to a peripheral and every event: [`Self::next_event`] may have changed.
    pub touched: bool,
}

/// TIM1's break and dead-time register (RM0008 14.4.18).
const BDTR: u32 = 0x4001_2C44;

/// Interrupts by position in the vector table (RM0008 table 63).
pub mod irq {
    /// Line 0 of the external interrupts; lines 1 to 4 follow.
    pub const EXTI0: u32 = 6;
    /// Injected or regular conversions are done.
    pub const ADC1_2: u32 = 18;
    /// A mailbox is empty.
    pub const CAN_TX: u32 = 19;
    /// FIFO 0 has a frame.
    pub const CAN_RX0: u32 = 20;
    /// FIFO 1 has a frame.
    pub const CAN_RX1: u32 = 21;
    /// Status change, errors.
    pub const CAN_SCE: u32 = 22;
    /// Lines 5 to 9 of the external interrupts.
    pub const EXTI9_5: u32 = 23;
    /// Break of TIM1.
    pub const TIM1_BRK: u32 = 24;
    /// Update of TIM1.
    pub const TIM1_UP: u32 = 25;
    /// Capture and compare of TIM1.
    pub const TIM1_CC: u32 = 27;
    /// TIM2.
    pub const TIM2: u32 = 28;
    /// TIM3.
    pub const TIM3: u32 = 29;
    /// TIM4.
    pub const TIM4: u32 = 30;
    /// Lines 10 to 15 of the external interrupts.
    pub const EXTI15_10: u32 = 40;
}

impl Chip {
    /// A chip without power: flash erased, random RAM (`seed`), and this unique ID.
    #[must_use]
    pub fn new(seed: u64, uid: [u32; 3]) -> Self {
        Self {
            now: 0,
            flash: flash::Flash::default(),
            ram: chance(seed),
            rcc: rcc::Rcc::default(),
            gpio: gpio::Gpio::default(),
            afio: afio::Afio::default(),
            exti: exti::Exti::default(),
            tim1: tim1::Tim1::default(),
            tim2: timer::Timer::default(),
            tim3: timer::Timer::default(),
            tim4: timer::Timer::default(),
            adc: adc::Adc::default(),
            can: can::Can::default(),
            iwdg: iwdg::Iwdg::default(),
            wwdg: wwdg::Wwdg::default(),
            uid: uid::Uid(uid),
            touched: true,
        }
    }

    /// Resets all registers; flash and RAM stay. A watchdog that caused it is stopped.
    pub fn reset(&mut self, cause: Reset) {
        self.flash.reset(self.now);
        self.rcc.reset(cause);
        self.gpio.reset();
        self.afio = afio::Afio::default();
        self.exti = exti::Exti::default();
        self.tim1 = tim1::Tim1::default();
        self.tim2 = timer::Timer::default();
        self.tim3 = timer::Timer::default();
        self.tim4 = timer::Timer::default();
        self.adc.reset();
        self.can.reset();
        self.iwdg.reset();
        self.wwdg = wwdg::Wwdg::default();
        self.tim1.gates_changed = true;
        self.touched = true;
        self.wire();
    }

    /// Randomizes the RAM, as after a power loss.
    pub fn forget(&mut self, seed: u64) {
        self.ram = chance(seed);
    }

    /// Drives a pin from outside (port A is 0), or releases it.
    pub fn set_pin(&mut self, (port, pin): (usize, usize), level: Option<bool>) {
        if self.gpio.driven[port][pin] != level {
            self.gpio.driven[port][pin] = level;
            self.touched = true;
            self.wire();
        }
    }

    /// Reports a change of the hall lines at `at`, which is not later than the present.
    pub fn hall_lines(&mut self, at: Time) {
        let halls = [(1, 6), (1, 7), (1, 8)].map(|(port, pin)| self.gpio.level(port, pin));
        self.tim4.set_inputs(halls, at);
        self.touched = true;
    }

    /// Time of the next event that may interrupt.
    #[must_use]
    pub fn next_wake(&self) -> Time {
        let all: [&dyn Peripheral; 8] =
            [&self.flash, &self.rcc, &self.tim2, &self.tim3, &self.tim4, &self.can, &self.iwdg, &self.wwdg];
        all.into_iter().map(Peripheral::next_event).min().unwrap_or(NEVER)
    }

    /// Reads memory or a register.
    ///
    /// # Errors
    /// [`AccessError`].
    pub fn read(&mut self, address: u32, size: Size) -> Result<u32, AccessError> {
        match address {
            0x0000_0000..0x0002_0000 => self.flash.read(address, size),
            0x0800_0000..0x0802_0000 => self.flash.read(address - 0x0800_0000, size),
            0x1FFF_F7E8..0x1FFF_F7F4 if size == Size::Word => self.uid.read(address - 0x1FFF_F7E8),
            0x1FFF_F7E0 if size == Size::Half => Ok(128), // flash size in KiB (RM0008 30.1.1)
            0x2000_0000..0x2000_5000 => Ok(self.read_ram(address - 0x2000_0000, size)),
            0x2200_0000..0x220A_0000 | 0x4200_0000..0x4400_0000 if size == Size::Word => {
                let (word, bit) = alias(address);
                Ok(self.read(word, Size::Word)? >> bit & 1)
            }
            0x4000_0000..0x4002_4000 => {
                let word = self.register(address & !3, None)?;
                Ok(word >> (8 * (address & 3)) & mask(size))
            }
            _ => Err(AccessError::Bus),
        }
    }

    /// Writes memory or a register.
    ///
    /// # Errors
    /// [`AccessError`].
    pub fn write(&mut self, address: u32, size: Size, value: u32) -> Result<(), AccessError> {
        match address {
            0x0800_0000..0x0802_0000 => {
                self.touched = true;
                if !self.rcc.is_hsi_on() {
                    let what = "the flash is programmed by the RC oscillator, which is off (PM0075 2.3)";
                    return Err(AccessError::NotModeled(what.to_owned()));
                }
                self.flash.program(address - 0x0800_0000, size, value, self.now)
            }
            0x2000_0000..0x2000_5000 => {
                self.write_ram(address - 0x2000_0000, size, value);
                Ok(())
            }
            0x2200_0000..0x220A_0000 | 0x4200_0000..0x4400_0000 if size == Size::Word => {
                let (word, bit) = alias(address);
                let old = self.read(word, Size::Word)?;
                self.write(word, Size::Word, old & !(1 << bit) | (value & 1) << bit)
            }
            0x4000_0000..0x4002_4000 if size == Size::Word => {
                self.register(address, Some(value))?;
                Ok(())
            }
            // The bridge to the APB repeats a narrow write over the whole word (RM0008 3.1).
            0x4000_0000..0x4001_8000 => {
                let copies = if size == Size::Half { 0x1_0001 } else { 0x0101_0101 };
                self.register(address & !3, Some((value & mask(size)) * copies))?;
                Ok(())
            }
            0x4001_8000..0x4002_4000 => {
                Err(AccessError::NotModeled("a write narrower than a word to a register".to_owned()))
            }
            _ => Err(AccessError::Bus),
        }
    }

    fn read_ram(&self, offset: u32, size: Size) -> u32 {
        let at = offset as usize;
        let byte = |i: usize| u32::from(self.ram.get(at + i).copied().unwrap_or(0)) << (8 * i);
        (0..size.bytes() as usize).map(byte).sum()
    }

    fn write_ram(&mut self, offset: u32, size: Size, value: u32) {
        let at = offset as usize;
        for (i, byte) in value.to_le_bytes().into_iter().take(size.bytes() as usize).enumerate() {
            if let Some(place) = self.ram.get_mut(at + i) {
                *place = byte;
            }
        }
    }

    /// Reads a register (`value` is `None`) or writes one.
    fn register(&mut self, address: u32, value: Option<u32>) -> Result<u32, AccessError> {
        if !self.rcc.is_clocked(address) {
            // A fault handler may clear MOE of a timer that was never clocked: its outputs are off already.
            if (address, value) == (BDTR, Some(0)) {
                return Ok(0);
            }
            return Err(AccessError::NotModeled("the peripheral's clock is off".to_owned()));
        }
        let now = self.now;
        // Blocks of 1 KiB (RM0008 table 3).
        let block: &mut dyn Peripheral = match address & !0x3FF {
            0x4000_0000 => &mut self.tim2,
            0x4000_0400 => &mut self.tim3,
            0x4000_0800 => &mut self.tim4,
            0x4000_2C00 => &mut self.wwdg,
            0x4000_3000 => &mut self.iwdg,
            0x4000_6400 => &mut self.can,
            0x4001_0000 => &mut self.afio,
            0x4001_0400 => &mut self.exti,
            0x4001_0800..0x4001_1C00 => &mut self.gpio,
            0x4001_2400 => &mut self.adc,
            0x4001_2C00 => &mut self.tim1,
            0x4002_1000 => &mut self.rcc,
            0x4002_2000 => &mut self.flash,
            _ => return Err(AccessError::NotModeled("no such peripheral".to_owned())),
        };
        // One model serves all ports.
        let base = if (0x4001_0800..0x4001_1C00).contains(&address) { 0x4001_0800 } else { address & !0x3FF };
        let done = match value {
            None => block.read(address - base, now),
            Some(value) => block.write(address - base, value, now).map(|()| 0),
        };
        let word = done.map_err(AccessError::NotModeled)?;
        self.touched = true;
        // A port write may change gates and brake.
        self.tim1.gates_changed |= base == 0x4001_0800 && value.is_some();
        let (present, needed) = (self.flash.wait_states(), self.rcc.wait_states());
        if value.is_some() && present < needed {
            let what =
                format!("{present} wait states of the flash, {needed} needed at this clock (PM0075 3.1)");
            return Err(AccessError::NotModeled(what));
        }
        self.wire();
        Ok(word)
    }

    /// Propagates signals between peripherals and from pins.
    fn wire(&mut self) {
        let now = self.now;
        self.reset_peripherals();
        for timer in [&mut self.tim2, &mut self.tim3, &mut self.tim4] {
            timer.set_cycle(self.rcc.timer_cycle(), now);
        }
        self.tim1.set_cycle(self.rcc.timer1_cycle(), now);
        self.adc.set_cycle(self.rcc.adc_cycle(), now);
        self.can.set_cycle(self.rcc.can_cycle());
        self.wwdg.set_cycle(self.rcc.can_cycle());
        let halls = [(1, 6), (1, 7), (1, 8)].map(|(port, pin)| self.gpio.level(port, pin));
        self.tim4.set_inputs(halls, now);
        // A failed crystal trips the break as well (RM0008 7.2.7).
        self.tim1.set_break(self.gpio.level(1, 12), self.rcc.clock_failed(), now);
        if let Some(at) = self.tim1.take_trigger() {
            self.adc.trigger(at);
        }
        if self.exti.listens() {
            let level = |line: usize| u32::from(self.gpio.level(self.afio.port(line), line)) << line;
            self.exti.set_inputs((0..16).map(level).sum());
        } else {
            self.exti.forget();
        }
    }

    /// Propagates a change of outside levels at once, as the break input needs.
    pub fn pins_changed(&mut self) {
        self.touched = true;
        self.wire();
    }

    /// Sets the converter's inputs from now on: 12 bits, by channel.
    pub fn set_analog(&mut self, inputs: [u16; 18]) {
        self.adc.set_inputs(inputs, self.now);
    }

    /// Time of the next event.
    #[must_use]
    pub fn next_event(&self) -> Time {
        let all: [&dyn Peripheral; 10] = [
            &self.flash,
            &self.rcc,
            &self.tim1,
            &self.tim2,
            &self.tim3,
            &self.tim4,
            &self.adc,
            &self.can,
            &self.iwdg,
            &self.wwdg,
        ];
        all.into_iter().map(Peripheral::next_event).min().unwrap_or(NEVER)
    }

    /// Advances time to `now`, which is not past [`Self::next_event`].
    pub fn advance(&mut self, now: Time) {
        self.now = now;
        let all: [&mut dyn Peripheral; 10] = [
            &mut self.flash,
            &mut self.rcc,
            &mut self.tim1,
            &mut self.tim2,
            &mut self.tim3,
            &mut self.tim4,
            &mut self.adc,
            &mut self.can,
            &mut self.iwdg,
            &mut self.wwdg,
        ];
        for peripheral in all {
            if peripheral.next_event() <= now {
                peripheral.advance(now);
                self.touched = true;
            }
        }
        self.wire();
    }

    /// Requested interrupts: one bit for each position of [`irq`].
    #[must_use]
    pub fn interrupts(&self) -> u64 {
        let line = |number: u32, on: bool| u64::from(on) << number;
        let exti = self.exti.interrupts();
        line(irq::ADC1_2, self.adc.interrupt())
            | line(irq::CAN_TX, self.can.interrupt_tx())
            | line(irq::CAN_RX0, self.can.interrupt_rx(0))
            | line(irq::CAN_RX1, self.can.interrupt_rx(1))
            | line(irq::CAN_SCE, self.can.interrupt_status())
            | line(irq::TIM1_BRK, self.tim1.interrupt_break())
            | line(irq::TIM1_UP, self.tim1.interrupt_update())
            | line(irq::TIM1_CC, self.tim1.interrupt_compare())
            | line(irq::TIM2, self.tim2.interrupt())
            | line(irq::TIM3, self.tim3.interrupt())
            | line(irq::TIM4, self.tim4.interrupt())
            | u64::from(exti & 0x1F) << irq::EXTI0
            | line(irq::EXTI9_5, exti & 0x3E0 != 0)
            | line(irq::EXTI15_10, exti & 0xFC00 != 0)
    }
}

/// Random contents of the RAM after a power loss: no program may rely on them.
fn chance(seed: u64) -> Vec<u8> {
    let mut state = seed | 1;
    let mut byte = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    };
    (0..RAM.len).map(|_| byte()).collect()
}

const fn mask(size: Size) -> u32 {
    match size {
        Size::Byte => 0xFF,
        Size::Half => 0xFFFF,
        Size::Word => u32::MAX,
    }
}

/// The word and the bit behind an address of a bit-band alias (PM0056 2.2.5).
const fn alias(address: u32) -> (u32, u32) {
    let offset = address & 0x01FF_FFFF;
    let byte = (address & 0xF000_0000) + (offset >> 5);
    (byte & !3, (offset >> 2 & 7) + 8 * (byte & 3))
}

#[cfg(test)]
mod tests;
