//! TIM1's outputs over a PWM period (RM0008 14.3.7, 14.3.11, table 83).

use super::{Direction, MOE, OSSI, OSSR, Tim1};
use crate::time::Time;

/// State of an output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gate {
    /// Not driven.
    Open,
    /// Constant level.
    Held(bool),
    /// Pulse in each period.
    Pwm {
        /// Rise, in clocks of the timer from the counter's start.
        rise: Time,
        /// Length of the high level in clocks: more than 0, less than the period.
        high: Time,
    },
}

/// The six outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gates {
    /// PWM period in clocks of the timer.
    pub period: Time,
    /// Dead time in clocks of the timer, where both outputs of a channel are enabled.
    pub dead: Time,
    /// CH1 to CH3.
    pub high: [Gate; 3],
    /// CH1N to CH3N.
    pub low: [Gate; 3],
    /// Compare values in effect.
    pub compare: [u32; 3],
    /// The compare value of 100 %.
    pub full: u32,
}

/// Active part of a period: start and length in clocks.
#[derive(Clone, Copy, Debug)]
struct Active {
    from: Time,
    clocks: Time,
}

impl Active {
    fn gate(self, period: Time, inverted: bool) -> Gate {
        match (self.clocks, inverted) {
            (0, _) => Gate::Held(inverted),
            (clocks, _) if clocks >= period => Gate::Held(!inverted),
            (clocks, false) => Gate::Pwm { rise: self.from % period, high: clocks },
            (clocks, true) => Gate::Pwm { rise: (self.from + clocks) % period, high: period - clocks },
        }
    }

    fn complement(self, period: Time) -> Self {
        Self { from: self.from + self.clocks, clocks: period - self.clocks }
    }

    /// Delayed start, same end; a signal that is always active has no start.
    fn late(self, dead: Time, period: Time) -> Self {
        let dead = if self.clocks < period { dead } else { 0 };
        Self { from: self.from + dead, clocks: self.clocks.saturating_sub(dead) }
    }
}

impl Tim1 {
    /// Dead time, in clocks of the timer: DTG's four ranges, in units of DTS (RM0008 14.4.18).
    #[must_use]
    pub fn dead_time(&self) -> Time {
        let dtg = Time::from(self.bdtr & 0xFF);
        let units = match dtg >> 5 {
            0..4 => dtg,
            4 | 5 => (64 + (dtg & 0x3F)) * 2,
            6 => (32 + (dtg & 0x1F)) * 8,
            _ => (32 + (dtg & 0x1F)) * 16,
        };
        units << (self.cr1 >> 8 & 3)
    }

    /// PWM period in clocks of the timer.
    fn period(&self) -> Time {
        let top = Time::from(self.counter.top);
        let counts = if self.counter.direction == Direction::Centre { 2 * top } else { top + 1 };
        counts.max(1) * self.counter.clocks()
    }

    /// Active part of a channel's reference. With a stopped counter it is always or never active.
    fn active(&self, index: usize) -> Active {
        let period = self.period();
        let channel = self.channels[index];
        if !self.counter.running || channel.mode < 6 {
            return Active { from: 0, clocks: if self.reference(index) { period } else { 0 } };
        }
        let (clocks, value) = (self.counter.clocks(), Time::from(channel.value));
        let below = match self.counter.direction {
            Direction::Centre => {
                let half = (value * clocks).min(period / 2);
                Active { from: period - half, clocks: 2 * half }
            }
            Direction::Up => Active { from: 0, clocks: (value * clocks).min(period) },
            Direction::Down => {
                let on = ((value + 1) * clocks).min(period);
                Active { from: period - on, clocks: on }
            }
        };
        if channel.mode == 6 { below } else { below.complement(period) }
    }

    fn pair(&self, index: usize) -> (Gate, Gate) {
        let bits = self.ccer >> (4 * index);
        let (enabled, inverted) = (bits & 1 != 0, bits & 2 != 0);
        let (enabled_n, inverted_n) = (bits & 4 != 0, bits & 8 != 0);
        let idle = (self.cr2 >> (8 + 2 * index) & 1 != 0, self.cr2 >> (9 + 2 * index) & 1 != 0);
        if self.bdtr & MOE == 0 {
            if self.bdtr & OSSI == 0 {
                return (Gate::Open, Gate::Open);
            }
            // Idle levels that would activate both are ignored (RM0008 14.3.11).
            let both = idle.0 != inverted && idle.1 != inverted_n;
            let (a, b) = if both { (inverted, inverted_n) } else { idle };
            return (Gate::Held(a), Gate::Held(b));
        }
        let (period, active) = (self.period(), self.active(index));
        let off = |inverted: bool| if self.bdtr & OSSR == 0 { Gate::Open } else { Gate::Held(inverted) };
        match (enabled, enabled_n) {
            (false, false) => (Gate::Open, Gate::Open),
            (true, false) => (active.gate(period, inverted), off(inverted_n)),
            // Without its partner, the complement is the reference itself.
            (false, true) => (off(inverted), active.gate(period, inverted_n)),
            (true, true) => {
                let dead = self.dead_time();
                (
                    active.late(dead, period).gate(period, inverted),
                    active.complement(period).late(dead, period).gate(period, inverted_n),
                )
            }
        }
    }

    /// The outputs until the next write or event.
    #[must_use]
    pub fn gates(&self) -> Gates {
        let pairs = [0, 1, 2].map(|index| self.pair(index));
        Gates {
            period: self.period(),
            dead: self.dead_time(),
            high: pairs.map(|pair| pair.0),
            low: pairs.map(|pair| pair.1),
            compare: [0, 1, 2].map(|index| self.channels[index].value),
            full: self.counter.top,
        }
    }
}
