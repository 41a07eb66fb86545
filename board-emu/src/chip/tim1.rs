//! TIM1: three complementary pairs with dead time, a break input, a trigger (RM0008 14).
//!
//! The counter stops in time at its turns and at the compare values. The next stop that is visible outside is
//! searched ahead, so that others wake nobody.

use super::counter::{Counter, Direction};
use super::timer::only;
use super::{Peripheral, RegisterResult};
use crate::time::{NEVER, Time};

mod outputs;

pub use outputs::{Gate, Gates};

/// SR and DIER: update, break; the compares are bits 1 to 4.
const UIF: u32 = 1;
const BIF: u32 = 1 << 7;
const COMPARES: u32 = 0x1E;
/// BDTR.
const DTG: u32 = 0xFF;
const LOCK: u32 = 3 << 8;
const OSSI: u32 = 1 << 10;
const OSSR: u32 = 1 << 11;
const BKE: u32 = 1 << 12;
const BKP: u32 = 1 << 13;
const AOE: u32 = 1 << 14;
const MOE: u32 = 1 << 15;
/// CR2's idle levels of channels 1 to 3 and their complements.
const IDLE: u32 = 0x3F00;
/// CCER's polarities: channels 1 to 4, and complements of 1 to 3.
const POLARITIES: u32 = 0x2AAA;
/// Stops searched at a time.
const AHEAD: usize = 64;

#[derive(Clone, Copy, Debug, Default)]
struct Compare {
    /// OCxM.
    mode: u32,
    /// OCxPE: a new value takes effect at the next update.
    buffered: bool,
    /// CCRx as read, and in effect.
    written: u32,
    value: u32,
    /// Level of the reference in the mode "frozen".
    level: bool,
}

/// The bridge's timer.
#[derive(Clone, Debug, Default)]
pub struct Tim1 {
    /// Outputs may have changed; cleared by the reader.
    pub gates_changed: bool,
    counter: Counter,
    cr1: u32,
    cr2: u32,
    dier: u32,
    sr: u32,
    ccer: u32,
    bdtr: u32,
    /// BDTR has been written: LOCK is fixed (RM0008 14.4.18).
    frozen: bool,
    channels: [Compare; 4],
    /// RCR, and turns left before an update.
    repetition: u32,
    left: u32,
    /// Level of the break input, and the clock security system.
    break_pin: bool,
    clock_failed: bool,
    trgo: bool,
    trigger: Option<Time>,
    /// Time of the next visible event.
    due: Option<Time>,
}

impl Tim1 {
    /// Ticks per clock of the timer from `now` on.
    pub fn set_cycle(&mut self, cycle: Time, now: Time) {
        if cycle != self.counter.cycle() {
            self.catch_up(now);
            self.counter.set_cycle(cycle, now);
            self.plan();
        }
    }

    /// Sets the level of the break input, and whether the clock security system reports a failure.
    pub fn set_break(&mut self, level: bool, clock_failed: bool, now: Time) {
        if (level, clock_failed) != (self.break_pin, self.clock_failed) {
            self.catch_up(now);
            (self.break_pin, self.clock_failed) = (level, clock_failed);
            self.obey_break();
            self.plan();
        }
    }

    /// Takes the time of TRGO's last rise.
    pub fn take_trigger(&mut self) -> Option<Time> {
        self.trigger.take()
    }

    /// Whether the break requests an interrupt.
    #[must_use]
    pub fn interrupt_break(&self) -> bool {
        self.sr & self.dier & BIF != 0
    }

    /// Whether the update requests an interrupt.
    #[must_use]
    pub fn interrupt_update(&self) -> bool {
        self.sr & self.dier & UIF != 0
    }

    /// Whether a compare requests an interrupt.
    #[must_use]
    pub fn interrupt_compare(&self) -> bool {
        self.sr & self.dier & COMPARES != 0
    }

    /// MOE: main output enable.
    #[must_use]
    pub const fn is_on(&self) -> bool {
        self.bdtr & MOE != 0
    }

    /// Whether a break is active: its source is active, and it is enabled (RM0008 14.3.12).
    fn breaking(&self) -> bool {
        let pin = self.break_pin == (self.bdtr & BKP != 0);
        self.bdtr & BKE != 0 && (pin || self.clock_failed)
    }

    /// A break acts without clock or code.
    fn obey_break(&mut self) {
        if self.breaking() {
            self.cut();
        }
    }

    fn cut(&mut self) {
        self.gates_changed |= self.is_on();
        self.bdtr &= !MOE;
        self.sr |= BIF;
    }

    fn catch_up(&mut self, now: Time) {
        loop {
            let at = self.next_stop();
            if at > now {
                break;
            }
            self.stop(at);
        }
        self.counter.advance(now);
    }

    fn next_stop(&self) -> Time {
        self.counter.next_stop(&self.channels.map(|channel| channel.value))
    }

    fn stop(&mut self, at: Time) {
        let going_down = self.counter.down;
        let turned = self.counter.advance(at);
        let over = turned && (!going_down || self.counter.direction == Direction::Down);
        let flagged = match self.cr1 >> 5 & 3 {
            0 => true,
            1 => going_down,
            2 => !going_down,
            _ => true,
        };
        for (index, channel) in self.channels.iter().enumerate() {
            // A compare value beyond the counter's range is flagged at the turn (RM0008 14.4.5).
            if flagged && channel.value == self.counter.count || over && channel.value > self.counter.top {
                self.sr |= 2 << index;
            }
        }
        if turned {
            if self.left == 0 {
                self.update(true, at);
            } else {
                self.left -= 1;
            }
        }
        self.follow(at);
    }

    fn update(&mut self, flag: bool, at: Time) {
        if self.cr1 & 1 << 1 != 0 {
            return;
        }
        self.counter.update();
        self.left = self.repetition;
        for channel in &mut self.channels {
            self.gates_changed |= channel.value != channel.written;
            channel.value = channel.written;
        }
        if flag {
            self.sr |= UIF;
        }
        if self.cr2 >> 4 & 7 == 2 {
            self.trigger = Some(at);
        }
        if self.bdtr & AOE != 0 && !self.breaking() && !self.is_on() {
            self.bdtr |= MOE;
            self.gates_changed = true;
        }
    }

    /// TRGO follows the reference selected by MMS (RM0008 14.4.2).
    fn follow(&mut self, at: Time) {
        let level = match self.cr2 >> 4 & 7 {
            1 => self.counter.running,
            select @ 4..8 => self.reference(select as usize - 4),
            _ => false,
        };
        if level && !self.trgo {
            self.trigger = Some(at);
        }
        self.trgo = level;
    }

    /// OCxREF (RM0008 14.4.7).
    fn reference(&self, channel: usize) -> bool {
        let Compare { mode, value, level, .. } = self.channels[channel];
        let Counter { count, down, direction, .. } = self.counter;
        // Compare value 0 is never active, except counting down.
        let below =
            if down { count <= value && (value > 0 || direction == Direction::Down) } else { count < value };
        match mode {
            4 => false,
            5 => true,
            6 => below,
            7 => !below,
            _ => level,
        }
    }

    fn plan(&mut self) {
        let mut ahead = Self { trigger: None, gates_changed: false, ..self.clone() };
        let before = ahead.sr & ahead.dier;
        for _ in 0..AHEAD {
            let at = ahead.next_stop();
            self.due = Some(at);
            if at == NEVER {
                return;
            }
            ahead.stop(at);
            if ahead.trigger.is_some() || ahead.gates_changed || ahead.sr & ahead.dier != before {
                return;
            }
        }
    }

    fn write_cr1(&mut self, value: u32, now: Time) -> RegisterResult<()> {
        // CKD, ARPE, CMS, DIR, URS, UDIS, CEN; one-pulse mode is not modeled.
        only("CR1", value, 0x3F7)?;
        if value >> 8 & 3 == 3 {
            return Err("CKD 3, which is reserved".to_owned());
        }
        let centered = |cr1: u32| cr1 >> 5 & 3 != 0;
        if self.counter.running && centered(value) != centered(self.cr1) {
            return Err("CMS changed while it counts (RM0008 14.4.1)".to_owned());
        }
        self.cr1 = value;
        self.counter.buffered = value & 1 << 7 != 0;
        self.counter.direction = match (centered(value), value & 1 << 4 != 0) {
            (true, _) => Direction::Centre,
            (false, true) => Direction::Down,
            (false, false) => Direction::Up,
        };
        // DIR is read-only in centered mode.
        if !centered(value) {
            self.counter.down = value & 1 << 4 != 0;
        }
        self.counter.run(value & 1 != 0, now);
        Ok(())
    }

    fn write_cr2(&mut self, value: u32) -> RegisterResult<()> {
        only("CR2", value, IDLE | 7 << 4)?;
        if value >> 4 & 7 == 3 {
            return Err("MMS 3, the compare pulse of channel 1".to_owned());
        }
        let locked = if self.lock() >= 1 { IDLE } else { 0 };
        self.cr2 = value & !locked | self.cr2 & locked;
        Ok(())
    }

    const fn lock(&self) -> u32 {
        self.bdtr >> 8 & 3
    }

    /// CCMR1 (channels 0 and 1) or CCMR2.
    fn write_modes(&mut self, first: usize, value: u32) -> RegisterResult<()> {
        for index in [0, 1] {
            let bits = value >> (8 * index) & 0xFF;
            if bits & 3 != 0 {
                return Err("a capture of TIM1".to_owned());
            }
            if bits & (1 << 2 | 1 << 7) != 0 {
                return Err("OCxFE or OCxCE".to_owned());
            }
            if matches!(bits >> 4 & 7, 1..=3) {
                return Err("an output that changes at a match (OCxM 1 to 3)".to_owned());
            }
        }
        // Level 3: OCxM and OCxPE are locked.
        if self.lock() < 3 {
            for index in [0, 1] {
                let bits = value >> (8 * index) & 0xFF;
                let level = self.reference(first + index);
                let channel = &mut self.channels[first + index];
                (channel.mode, channel.buffered, channel.level) = (bits >> 4 & 7, bits & 1 << 3 != 0, level);
            }
        }
        Ok(())
    }

    fn read_modes(&self, first: usize) -> u32 {
        let bits = |channel: Compare| channel.mode << 4 | u32::from(channel.buffered) << 3;
        bits(self.channels[first]) | bits(self.channels[first + 1]) << 8
    }

    fn write_bdtr(&mut self, value: u32) -> RegisterResult<()> {
        let locked = match self.lock() {
            0 => 0,
            1 => DTG | BKE | BKP | AOE,
            _ => DTG | BKE | BKP | AOE | OSSR | OSSI,
        } | if self.frozen { LOCK } else { 0 };
        self.frozen = true;
        self.bdtr = value & 0xFFFF & !locked | self.bdtr & locked;
        // MOE cannot be set while a break is active (RM0008 14.3.12).
        self.obey_break();
        Ok(())
    }

    fn write_register(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()> {
        match offset {
            0x00 => self.write_cr1(value, now)?,
            0x04 => self.write_cr2(value)?,
            0x08 if value == 0 => {}
            0x08 => return Err("TIM1 as a slave".to_owned()),
            0x0C => self.dier = only("DIER", value, UIF | COMPARES | BIF)?,
            0x10 => {
                self.sr &= value;
                // BIF cannot be cleared while a break is active.
                self.obey_break();
            }
            0x14 => {
                only("EGR", value, 1 | 1 << 7)?;
                if value & 1 != 0 {
                    self.update(self.cr1 & 1 << 2 == 0, now);
                    self.counter.restart(now);
                    // MMS 0: UG is the trigger.
                    if self.cr2 >> 4 & 7 == 0 {
                        self.trigger = Some(now);
                    }
                }
                if value & 1 << 7 != 0 {
                    self.cut();
                }
            }
            0x18 => self.write_modes(0, value)?,
            0x1C => self.write_modes(2, value)?,
            0x20 => {
                only("CCER", value, 0x3FFF)?;
                let locked = if self.lock() >= 2 { POLARITIES } else { 0 };
                self.ccer = value & !locked | self.ccer & locked;
            }
            0x24 => self.counter.set_count(value & 0xFFFF),
            0x28 => self.counter.prescaler = value & 0xFFFF,
            0x2C => self.counter.set_reload(value & 0xFFFF),
            0x30 => self.repetition = value & 0xFF,
            0x34..=0x40 => {
                let channel = &mut self.channels[(offset as usize - 0x34) / 4];
                channel.written = value & 0xFFFF;
                if !channel.buffered {
                    channel.value = channel.written;
                }
            }
            0x44 => self.write_bdtr(value)?,
            _ => return Err(format!("no register {offset:#x} of TIM1, or DMA's")),
        }
        Ok(())
    }
}

impl Peripheral for Tim1 {
    fn read(&mut self, offset: u32, now: Time) -> RegisterResult<u32> {
        self.catch_up(now);
        Ok(match offset {
            0x00 => self.cr1 & !(1 << 4) | u32::from(self.counter.down) << 4,
            0x04 => self.cr2,
            0x08 | 0x14 => 0,
            0x0C => self.dier,
            0x10 => self.sr,
            0x18 => self.read_modes(0),
            0x1C => self.read_modes(2),
            0x20 => self.ccer,
            0x24 => self.counter.count,
            0x28 => self.counter.prescaler,
            0x2C => self.counter.reload,
            0x30 => self.repetition,
            0x34..=0x40 => self.channels[(offset as usize - 0x34) / 4].written,
            0x44 => self.bdtr,
            _ => return Err(format!("no register {offset:#x} of TIM1, or DMA's")),
        })
    }

    fn write(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()> {
        self.catch_up(now);
        let before = self.gates();
        self.write_register(offset, value, now)?;
        self.follow(now);
        let after = self.gates();
        self.gates_changed |= (before.high, before.low) != (after.high, after.low);
        self.plan();
        Ok(())
    }

    fn next_event(&self) -> Time {
        self.due.unwrap_or(NEVER)
    }

    fn advance(&mut self, now: Time) {
        self.catch_up(now);
        self.plan();
    }
}

#[cfg(test)]
mod tests;
