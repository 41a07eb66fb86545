//! SysTick (PM0056 4.5): counts 24 bits down, at the core's clock or an eighth of it.
//!
//! Its state is computed from the time of the last access.

use crate::time::{NEVER, Time};

const ENABLE: u32 = 1;
const TICKINT: u32 = 1 << 1;
const CLKSOURCE: u32 = 1 << 2;
const COUNTFLAG: u32 = 1 << 16;

/// CALIB: 1 ms at 9 MHz (PM0056 4.5.4).
const CALIBRATION: u32 = 9000;

#[derive(Clone, Debug)]
pub struct SysTick {
    control: u32,
    reload: u32,
    /// Count at `since`.
    value: u32,
    since: Time,
    /// Ticks per cycle of the core.
    cycle: Time,
    counted: bool,
}

impl SysTick {
    #[must_use]
    pub const fn new(now: Time, cycle: Time) -> Self {
        Self { control: 0, reload: 0, value: 0, since: now, cycle, counted: false }
    }

    const fn unit(&self) -> Time {
        if self.control & CLKSOURCE == 0 { 8 * self.cycle } else { self.cycle }
    }

    /// `None` if reload and value are 0.
    fn to_zero(&self) -> Option<Time> {
        match (self.value, self.reload) {
            (0, 0) => None,
            (0, reload) => Some(Time::from(reload) + 1),
            (value, _) => Some(Time::from(value)),
        }
    }

    /// Advances to `now`; from then on a cycle has `cycle` ticks. Returns whether it reached 0 with its
    /// interrupt enabled.
    pub fn advance(&mut self, now: Time, cycle: Time) -> bool {
        let zero = self.count(now);
        self.cycle = cycle;
        self.counted |= zero;
        zero && self.control & TICKINT != 0
    }

    fn count(&mut self, now: Time) -> bool {
        if self.control & ENABLE == 0 {
            self.since = now;
            return false;
        }
        let unit = self.unit();
        let counts = now.saturating_sub(self.since) / unit;
        self.since += counts * unit;
        let Some(first) = self.to_zero() else { return false };
        if counts < first {
            self.value = if counts == 0 { self.value } else { (first - counts) as u32 };
            return false;
        }
        let period = Time::from(self.reload) + 1;
        let past = (counts - first) % period;
        self.value = if past == 0 { 0 } else { (period - past) as u32 };
        true
    }

    #[must_use]
    pub fn next_event(&self) -> Time {
        if self.control & (ENABLE | TICKINT) != ENABLE | TICKINT {
            return NEVER;
        }
        self.to_zero().map_or(NEVER, |counts| self.since + counts * self.unit())
    }

    /// CSR, RVR, CVR or CALIB by number; must be advanced to the present.
    pub fn read(&mut self, register: u32) -> u32 {
        match register {
            0 => self.control | if std::mem::take(&mut self.counted) { COUNTFLAG } else { 0 },
            1 => self.reload,
            2 => self.value,
            _ => CALIBRATION,
        }
    }

    pub fn write(&mut self, register: u32, value: u32, now: Time) {
        match register {
            0 => {
                self.control = value & (ENABLE | TICKINT | CLKSOURCE);
                self.since = now;
            }
            1 => self.reload = value & 0x00FF_FFFF,
            2 => (self.value, self.counted, self.since) = (0, false, now),
            _ => {}
        }
    }
}
