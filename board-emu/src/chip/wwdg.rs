//! The window watchdog (RM0008 20), without its early interrupt.
//!
//! Counts of 4096 · 2^WDGTB cycles of APB1 begin at a write of CR. On the chip the divider runs on, so a count may already be partly
//! over: a reset comes up to one count earlier than here.

#[cfg(test)]
mod tests;

use super::{Peripheral, RegisterResult};
use crate::time::{NEVER, Time};

/// The counter and the window: seven bits.
const COUNT: u32 = 0x7F;
/// Below this the chip is reset.
const LEAST: u32 = 0x40;
/// CR: runs. Only a reset clears it.
const WDGA: u32 = 1 << 7;
/// CFR: early interrupt.
const EWI: u32 = 1 << 9;

/// The watchdog.
#[derive(Clone, Debug)]
pub struct Wwdg {
    /// Expired, or fed too early: the chip must be reset.
    pub expired: bool,
    running: bool,
    count: u32,
    since: Time,
    /// CFR.
    config: u32,
    /// Ticks a cycle of APB1.
    cycle: Time,
}

impl Default for Wwdg {
    fn default() -> Self {
        Self { expired: false, running: false, count: COUNT, since: 0, config: COUNT, cycle: 18 }
    }
}

impl Wwdg {
    /// Sets the ticks a cycle of APB1. It must not change while the watchdog runs.
    pub const fn set_cycle(&mut self, cycle: Time) {
        self.cycle = cycle;
    }

    fn period(&self) -> Time {
        self.cycle * (4096 << (self.config >> 7 & 3))
    }

    fn expiry(&self) -> Time {
        self.since + self.period() * Time::from(self.count - LEAST + 1)
    }

    fn count_at(&self, now: Time) -> u32 {
        let gone = if self.running { (now - self.since) / self.period() } else { 0 };
        self.count.saturating_sub(u32::try_from(gone).unwrap_or(COUNT))
    }
}

impl Peripheral for Wwdg {
    fn read(&mut self, offset: u32, now: Time) -> RegisterResult<u32> {
        match offset {
            0x0 => Ok(self.count_at(now) | if self.running { WDGA } else { 0 }),
            0x4 => Ok(self.config),
            0x8 => Ok(0),
            _ => Err(format!("WWDG has no register at offset {offset:#x}")),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()> {
        match offset {
            0x0 => {
                let count = value & COUNT;
                // Only while it runs: fed above the window, or with a count that is over (RM0008 20.3).
                self.expired |= self.running && self.count_at(now) > self.config & COUNT;
                self.running |= value & WDGA != 0;
                self.expired |= self.running && count < LEAST;
                (self.count, self.since) = (count.max(LEAST), now);
                Ok(())
            }
            0x4 if value & EWI != 0 => Err("WWDG_CFR.EWI: no early interrupt".to_owned()),
            0x4 if self.running => Err("WWDG_CFR is written while it counts".to_owned()),
            0x4 => {
                self.config = value & 0x1FF;
                Ok(())
            }
            0x8 => Ok(()),
            _ => Err(format!("WWDG has no register at offset {offset:#x}")),
        }
    }

    fn next_event(&self) -> Time {
        if self.running && !self.expired { self.expiry() } else { NEVER }
    }

    fn advance(&mut self, now: Time) {
        self.expired |= self.running && self.expiry() <= now;
    }
}
