//! The converter: injected conversions on a trigger, and a continuous regular one (RM0008 11).
//!
//! A conversion begins at its trigger: the latency of up to three ADC cycles (DS5319 5.3.18) is not modeled.

use super::timer::only;
use super::{Peripheral, RegisterResult};
use crate::time::{NEVER, Time, US};

/// SR: end of a group, end of the injected group, start of either.
const EOC: u32 = 1 << 1;
const JEOC: u32 = 1 << 2;
const JSTRT: u32 = 1 << 3;
const STRT: u32 = 1 << 4;
/// CR1: their interrupts.
const EOCIE: u32 = 1 << 5;
const JEOCIE: u32 = 1 << 7;
/// CR1: scan mode.
const SCAN: u32 = 1 << 8;
/// CR2.
const ADON: u32 = 1;
const CONT: u32 = 1 << 1;
const CAL: u32 = 1 << 2;
const RSTCAL: u32 = 1 << 3;
const JEXTSEL: u32 = 7 << 12;
const JEXTTRIG: u32 = 1 << 15;
const EXTSEL: u32 = 7 << 17;
const EXTTRIG: u32 = 1 << 20;
const JSWSTART: u32 = 1 << 21;
const SWSTART: u32 = 1 << 22;
const TSVREFE: u32 = 1 << 23;
/// Cycles of RSTCAL. The manual states no number.
const RESET_CYCLES: Time = 2;
/// Cycles of a calibration (DS5319 5.3.18).
const CALIBRATION_CYCLES: Time = 83;
/// Time from ADON to the first conversion (DS5319 5.3.18, tSTAB).
const WAKE_UP: Time = US;
/// Ticks per cycle at 14 MHz, rounded up.
const FASTEST: Time = crate::time::HZ.div_ceil(14_000_000);
/// Sampling time in half cycles, by code of SMPR (RM0008 11.12.4).
const SAMPLING: [Time; 8] = [3, 15, 27, 57, 83, 111, 143, 479];
/// Conversion time after the sampling, in half cycles (RM0008 11.6).
const CONVERSION: Time = 25;

#[derive(Clone, Copy, Debug)]
struct Running {
    since: Time,
    /// The input at the end of the sampling.
    held: Option<u16>,
}

impl Running {
    const fn at(since: Time) -> Self {
        Self { since, held: None }
    }
}

/// ADC1.
#[derive(Clone, Debug)]
pub struct Adc {
    /// Inputs, 12 bits, by channel.
    inputs: [u16; 18],
    cycle: Time,
    sr: u32,
    cr1: u32,
    cr2: u32,
    smpr: [u32; 2],
    sqr3: u32,
    jsqr: u32,
    jdr: [u16; 4],
    dr: u16,
    on_since: Time,
    /// End of RSTCAL and CAL.
    resets_until: Time,
    calibrates_until: Time,
    regular: Option<Running>,
    /// The injected conversion in progress, 0..=3.
    injected: Option<(usize, Running)>,
}

impl Default for Adc {
    fn default() -> Self {
        Self {
            inputs: [0; 18],
            cycle: 12,
            sr: 0,
            cr1: 0,
            cr2: 0,
            smpr: [0; 2],
            sqr3: 0,
            jsqr: 0,
            jdr: [0; 4],
            dr: 0,
            on_since: 0,
            resets_until: 0,
            calibrates_until: 0,
            regular: None,
            injected: None,
        }
    }
}

impl Adc {
    /// Resets the registers; the inputs stay.
    pub fn reset(&mut self) {
        *self = Self { inputs: self.inputs, cycle: self.cycle, ..Self::default() };
    }

    /// Sets the inputs from `now` on; earlier samples saw the old ones.
    pub fn set_inputs(&mut self, inputs: [u16; 18], now: Time) {
        self.catch_up(now);
        self.inputs = inputs;
    }

    /// Sets the ticks per cycle of its clock, also for a conversion in progress.
    pub fn set_cycle(&mut self, cycle: Time, now: Time) {
        if cycle != self.cycle {
            self.catch_up(now);
            self.cycle = cycle;
        }
    }

    /// Raises the external trigger of the injected group. A trigger during the group is lost.
    pub fn trigger(&mut self, now: Time) {
        self.catch_up(now);
        if self.cr2 & ADON != 0 && self.cr2 & JEXTTRIG != 0 && self.injected.is_none() {
            self.begin_injected(now);
        }
    }

    fn begin_injected(&mut self, now: Time) {
        self.sr |= JSTRT;
        self.injected = Some((0, Running::at(now)));
    }

    /// Whether it requests an interrupt.
    #[must_use]
    pub fn interrupt(&self) -> bool {
        self.sr & EOC != 0 && self.cr1 & EOCIE != 0 || self.sr & JEOC != 0 && self.cr1 & JEOCIE != 0
    }

    /// Conversions of the injected group: JL + 1.
    fn injected_count(&self) -> usize {
        (self.jsqr >> 20 & 3) as usize + 1
    }

    /// The channel of an injected conversion: the group ends with JSQ4 (RM0008 11.12.12).
    fn injected_channel(&self, index: usize) -> usize {
        let slot = 4 - self.injected_count() + index;
        (self.jsqr >> (5 * slot) & 0x1F) as usize
    }

    fn regular_channel(&self) -> usize {
        (self.sqr3 & 0x1F) as usize
    }

    fn sampling(&self, channel: usize) -> Time {
        let code =
            if channel < 10 { self.smpr[1] >> (3 * channel) } else { self.smpr[0] >> (3 * (channel - 10)) };
        SAMPLING[(code & 7) as usize] * self.cycle / 2
    }

    /// Ticks of a channel's sampling and conversion.
    fn length(&self, channel: usize) -> Time {
        self.sampling(channel) + CONVERSION * self.cycle / 2
    }

    fn catch_up(&mut self, now: Time) {
        while let Some((index, running)) = self.injected {
            let (running, done) = self.run(running, self.injected_channel(index), now);
            let Some((end, value)) = done else {
                self.injected = Some((index, running));
                return;
            };
            self.jdr[index] = value;
            let next = index + 1;
            self.injected = (next < self.injected_count()).then_some((next, Running::at(end)));
            if self.injected.is_none() {
                self.sr |= JEOC;
                // An interrupted regular conversion restarts (RM0008 11.3.9).
                if let Some(regular) = &mut self.regular {
                    *regular = Running::at(end);
                }
            }
        }
        let channel = self.regular_channel();
        while let Some(running) = self.regular {
            let (running, done) = self.run(running, channel, now);
            self.regular = Some(running);
            let Some((end, value)) = done else { return };
            self.dr = value;
            self.sr |= EOC;
            self.regular = None;
            if self.cr2 & CONT != 0 {
                // Conversions that began and ended since the last call saw the present inputs: a change of
                // them catches up first.
                let length = self.length(channel);
                let whole = (now - end) / length;
                if whole > 0 {
                    self.dr = self.inputs[channel] & 0xFFF;
                }
                self.regular = Some(Running::at(end + whole * length));
            }
        }
    }

    /// A conversion up to `now`; returns end and value once it is over.
    fn run(&self, mut running: Running, channel: usize, now: Time) -> (Running, Option<(Time, u16)>) {
        if running.held.is_none() && running.since + self.sampling(channel) <= now {
            running.held = Some(self.inputs[channel] & 0xFFF);
        }
        let end = running.since + self.length(channel);
        let done = if end <= now { running.held.map(|value| (end, value)) } else { None };
        (running, done)
    }

    fn read_cr2(&self, now: Time) -> u32 {
        let busy = |until: Time, bit: u32| if until > now { bit } else { 0 };
        self.cr2 | busy(self.resets_until, RSTCAL) | busy(self.calibrates_until, CAL)
    }

    fn write_cr2(&mut self, value: u32, now: Time) -> RegisterResult<()> {
        const KEPT: u32 = ADON | CONT | JEXTSEL | JEXTTRIG | EXTSEL | EXTTRIG | TSVREFE;
        only("CR2", value, KEPT | CAL | RSTCAL | JSWSTART | SWSTART)?;
        if value & JEXTTRIG != 0 && value & JEXTSEL != 0 && value & JEXTSEL != JEXTSEL {
            return Err("a trigger of injected conversions that is not TIM1's TRGO".to_owned());
        }
        if value & EXTTRIG != 0 && value & EXTSEL != EXTSEL {
            return Err("a trigger of regular conversions that is not SWSTART".to_owned());
        }
        let (old, was_on) = (self.read_cr2(now), self.cr2 & ADON != 0);
        self.cr2 = value & KEPT;
        if value & ADON == 0 {
            (self.regular, self.injected) = (None, None);
            return Ok(());
        }
        if !was_on {
            self.on_since = now;
        }
        if value & RSTCAL != 0 {
            self.resets_until = self.resets_until.max(now + RESET_CYCLES * self.cycle);
        }
        if value & CAL != 0 && old & CAL == 0 {
            if !was_on || now < self.on_since + 2 * self.cycle {
                return Err("calibrated less than two of its cycles after ADON (RM0008 11.4)".to_owned());
            }
            self.calibrates_until = now + CALIBRATION_CYCLES * self.cycle;
        }
        // Writing ADON to 1 again, with no other change, starts a regular conversion.
        let again = was_on && value == old;
        if value & SWSTART != 0 && value & EXTTRIG != 0 || again {
            self.startable(now)?;
            self.sr |= STRT;
            self.regular = Some(Running::at(now));
        }
        if value & JSWSTART != 0 && value & JEXTTRIG != 0 && value & JEXTSEL == JEXTSEL {
            self.startable(now)?;
            self.begin_injected(now);
        }
        Ok(())
    }

    fn startable(&self, now: Time) -> RegisterResult<()> {
        if now < self.on_since + WAKE_UP {
            Err("a conversion less than 1 us after ADON (DS5319 5.3.18)".to_owned())
        } else if self.cycle < FASTEST {
            Err("a clock of more than 14 MHz (RM0008 11.1)".to_owned())
        } else if now < self.calibrates_until {
            Err("a conversion during the calibration".to_owned())
        } else {
            Ok(())
        }
    }

    fn write_jsqr(&mut self, value: u32) -> RegisterResult<()> {
        self.jsqr = only("JSQR", value, 0x3F_FFFF)?;
        match (0..self.injected_count()).find(|&index| self.injected_channel(index) > 17) {
            Some(_) => Err("an injected channel above 17".to_owned()),
            None => Ok(()),
        }
    }
}

impl Peripheral for Adc {
    fn read(&mut self, offset: u32, now: Time) -> RegisterResult<u32> {
        self.catch_up(now);
        Ok(match offset {
            0x00 => self.sr,
            0x04 => self.cr1,
            0x08 => self.read_cr2(now),
            0x0C => self.smpr[0],
            0x10 => self.smpr[1],
            // JOFRx and, of one regular conversion, SQR1 and SQR2.
            0x14..=0x20 | 0x2C | 0x30 => 0,
            0x34 => self.sqr3,
            0x38 => self.jsqr,
            0x3C..=0x48 => u32::from(self.jdr[(offset as usize - 0x3C) / 4]),
            0x4C => {
                self.sr &= !EOC;
                u32::from(self.dr)
            }
            _ => return Err(format!("no register {offset:#x} of the ADC, or the analog watchdog's")),
        })
    }

    fn write(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()> {
        self.catch_up(now);
        match offset {
            0x00 => self.sr &= value,
            0x04 => self.cr1 = only("CR1", value, SCAN | EOCIE | JEOCIE)?,
            0x08 => return self.write_cr2(value, now),
            0x0C => self.smpr[0] = only("SMPR1", value, 0xFF_FFFF)?,
            0x10 => self.smpr[1] = only("SMPR2", value, 0x3FFF_FFFF)?,
            0x14..=0x20 if value == 0 => {}
            0x14..=0x20 => return Err("offsets of injected conversions".to_owned()),
            0x2C | 0x30 if value == 0 => {}
            0x2C | 0x30 => return Err("more than one regular conversion".to_owned()),
            0x34 => {
                self.sqr3 = only("SQR3", value, 0x1F)?;
                if self.sqr3 > 17 {
                    return Err("a regular channel above 17".to_owned());
                }
            }
            0x38 => return self.write_jsqr(value),
            0x3C..=0x4C => {}
            _ => return Err(format!("no register {offset:#x} of the ADC, or the analog watchdog's")),
        }
        // The order of set-up is free: an error only once the converter is on.
        if self.cr2 & JEXTTRIG != 0 && self.injected_count() > 1 && self.cr1 & SCAN == 0 {
            return Err("an injected group without SCAN".to_owned());
        }
        Ok(())
    }

    fn next_event(&self) -> Time {
        let injected = self.injected.filter(|_| self.cr1 & JEOCIE != 0 && self.sr & JEOC == 0);
        let regular = self.regular.filter(|_| self.cr1 & EOCIE != 0 && self.sr & EOC == 0);
        let end = |running: Running, channel: usize| running.since + self.length(channel);
        // The regular group waits for the injected one.
        let injected = injected.map(|(index, running)| end(running, self.injected_channel(index)));
        let regular = regular.filter(|_| self.injected.is_none()).map(|r| end(r, self.regular_channel()));
        injected.unwrap_or(NEVER).min(regular.unwrap_or(NEVER))
    }

    fn advance(&mut self, now: Time) {
        self.catch_up(now);
    }
}

#[cfg(test)]
mod tests;
