//! The independent watchdog (RM0008 19).

#[cfg(test)]
mod tests;

use super::{Peripheral, RegisterResult};
use crate::time::{HZ, NEVER, Time};

/// Keys of KR: unlock PR and RLR; reload; start (RM0008 19.4.1).
const UNLOCK: u32 = 0x5555;
const RELOAD: u32 = 0xAAAA;
const START: u32 = 0xCCCC;

/// First count, and reset value of RLR.
const TOP: u32 = 0xFFF;

/// Oscillator cycles until PR and RLR take effect: 5 at most (RM0008 19.4.4).
const UPDATE: u64 = 5;

/// Nominal frequency of its oscillator, and its range (DS5319 table 25).
const NOMINAL_HZ: u32 = 40_000;

/// A register that takes effect in the other clock domain some time after its write.
#[derive(Clone, Copy, Debug)]
struct Late {
    present: u32,
    next: u32,
    /// When the written value takes effect; [`NEVER`] if it has, or while the oscillator is off.
    at: Time,
}

impl Late {
    const fn new(value: u32) -> Self {
        Self { present: value, next: value, at: NEVER }
    }

    const fn is_waiting(&self) -> bool {
        self.present != self.next || self.at != NEVER
    }
}

/// The watchdog with its oscillator.
#[derive(Clone, Debug)]
pub struct Iwdg {
    /// Expired: the chip must be reset.
    pub expired: bool,
    hz: u32,
    /// Running: only a reset stops it.
    running: bool,
    unlocked: bool,
    prescaler: Late,
    reload: Late,
    count: u32,
    since: Time,
}

impl Default for Iwdg {
    fn default() -> Self {
        Self {
            expired: false,
            hz: NOMINAL_HZ,
            running: false,
            unlocked: false,
            prescaler: Late::new(0),
            reload: Late::new(TOP),
            count: TOP,
            since: 0,
        }
    }
}

impl Iwdg {
    /// Reset state: stopped. The oscillator's frequency stays.
    pub fn reset(&mut self) {
        *self = Self { hz: self.hz, ..Self::default() };
    }

    /// Sets the actual frequency of its oscillator: 30 to 60 kHz (DS5319 table 25). Before it runs.
    pub const fn set_oscillator(&mut self, hz: u32) {
        self.hz = hz;
    }

    fn cycles(&self, count: u64) -> Time {
        count * HZ / u64::from(self.hz)
    }

    /// Cycles per count: 4 to 256 (RM0008 19.4.2).
    fn divider(&self) -> u64 {
        4 << self.prescaler.present.min(6)
    }

    /// Time of expiry: the count 0 lasts a count as well (RM0008 19.3, table 96).
    fn expiry(&self) -> Time {
        self.since + self.cycles((u64::from(self.count) + 1) * self.divider())
    }

    fn settle(&mut self, now: Time) {
        if self.reload.at <= now {
            self.reload = Late::new(self.reload.next);
        }
        if self.prescaler.at <= now {
            let at = self.prescaler.at;
            let gone = (at - self.since) * u64::from(self.hz) / HZ / self.divider();
            self.count -= u32::try_from(gone).unwrap_or(TOP).min(self.count);
            self.since = at;
            self.prescaler = Late::new(self.prescaler.next);
        }
    }

    fn update_at(&self, now: Time) -> Time {
        if self.running { now + self.cycles(UPDATE) } else { NEVER }
    }

    fn start(&mut self, now: Time) {
        if self.running {
            return;
        }
        self.running = true;
        self.since = now;
        let at = self.update_at(now);
        for register in [&mut self.prescaler, &mut self.reload] {
            if register.is_waiting() {
                register.at = at;
            }
        }
    }

    fn write_late(&mut self, name: &str, value: u32, now: Time) -> RegisterResult<()> {
        let at = self.update_at(now);
        let unlocked = self.unlocked;
        let register = if name == "PR" { &mut self.prescaler } else { &mut self.reload };
        if !unlocked {
            return Ok(());
        }
        if register.is_waiting() {
            return Err(format!(
                "IWDG_{name} is written before it has taken over what was written last (RM0008 19.4)"
            ));
        }
        // An unchanged value takes as long.
        (register.next, register.at) = (value, at);
        Ok(())
    }
}

impl Peripheral for Iwdg {
    fn read(&mut self, offset: u32, now: Time) -> RegisterResult<u32> {
        self.settle(now);
        match offset {
            0x0 => Ok(0),
            0x4 if !self.prescaler.is_waiting() => Ok(self.prescaler.present),
            0x8 if !self.reload.is_waiting() => Ok(self.reload.present),
            0x4 | 0x8 => {
                Err("IWDG_PR or RLR is read before it has taken over what was written (RM0008 19.4)"
                    .to_owned())
            }
            0xC => Ok(u32::from(self.prescaler.is_waiting()) | u32::from(self.reload.is_waiting()) << 1),
            _ => Err(format!("IWDG has no register at offset {offset:#x}")),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()> {
        self.settle(now);
        match offset {
            0x0 => {
                // Any other key locks PR and RLR again (RM0008 19.3.2).
                self.unlocked = value & 0xFFFF == UNLOCK;
                match value & 0xFFFF {
                    START => self.start(now),
                    RELOAD => (self.count, self.since) = (self.reload.present, now),
                    _ => {}
                }
                Ok(())
            }
            0x4 => self.write_late("PR", value & 7, now),
            0x8 => self.write_late("RLR", value & TOP, now),
            _ => {
                Err(format!("IWDG_SR is read only, and there is no register at offset {offset:#x} above it"))
            }
        }
    }

    fn next_event(&self) -> Time {
        if self.running && !self.expired { self.prescaler.at.min(self.expiry()) } else { NEVER }
    }

    fn advance(&mut self, now: Time) {
        self.settle(now);
        self.expired |= self.running && self.expiry() <= now;
    }
}
