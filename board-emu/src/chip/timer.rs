//! TIM2, TIM3, TIM4: counter, capture of the XOR of three lines, reset by a trigger (RM0008 15).

use super::counter::Counter;
use super::{Peripheral, RegisterResult};
use crate::time::{NEVER, Time};

/// SR and DIER: update, capture 1, trigger.
const UIF: u32 = 1;
const CC1IF: u32 = 1 << 1;
const TIF: u32 = 1 << 6;
/// SR: overcapture.
const CC1OF: u32 = 1 << 9;

/// A general-purpose timer.
#[derive(Clone, Debug, Default)]
pub struct Timer {
    counter: Counter,
    cr1: u32,
    cr2: u32,
    smcr: u32,
    dier: u32,
    sr: u32,
    ccmr1: u32,
    ccer: u32,
    /// CCR1: the last capture.
    captured: u32,
    /// Channels 1 to 3.
    inputs: [bool; 3],
    filter: Filter,
}

/// Digital input filter: its output follows after N equal samples (RM0008 15.4.7, IC1F).
#[derive(Clone, Copy, Debug, Default)]
struct Filter {
    input: bool,
    output: bool,
    /// Time of the sample that switches the output.
    due: Option<Time>,
    /// Time at which the input returned, not seen by a sample yet.
    back: Option<Time>,
}

impl Filter {
    /// Sets the input's level from `at` on; a sample is taken every `gap` ticks, and `count` equal ones
    /// switch the output.
    fn set(&mut self, level: bool, at: Time, (gap, count): (Time, Time)) {
        if level == self.input {
            return;
        }
        self.input = level;
        // A sample at this very time sees the old level.
        let next = |at: Time| (at / gap + 1) * gap;
        if level == self.output {
            self.back = Some(at);
        } else {
            // If no sample saw it return, the run of equal samples continues.
            if self.due.is_none() || self.back.is_some_and(|back| next(back) <= at) {
                self.due = Some(next(at) + (count - 1) * gap);
            }
            self.back = None;
        }
    }

    /// Whether the last due sample switches the output.
    fn sampled(&mut self) -> bool {
        self.due = None;
        let follows = self.back.take().is_none();
        if follows {
            self.output = !self.output;
        }
        follows
    }
}

impl Timer {
    /// Ticks per clock of the timer from `now` on.
    pub fn set_cycle(&mut self, cycle: Time, now: Time) {
        if cycle != self.counter.cycle() {
            self.catch_up(now);
            self.counter.set_cycle(cycle, now);
        }
    }

    /// Sets the levels of channels 1 to 3.
    pub fn set_inputs(&mut self, levels: [bool; 3], now: Time) {
        if levels != self.inputs {
            self.catch_up(now);
            self.inputs = levels;
            self.route(now);
        }
    }

    /// Whether it requests an interrupt.
    #[must_use]
    pub fn interrupt(&self) -> bool {
        self.sr & self.dier != 0
    }

    /// Input of channel 1's filter: TI1S selects the XOR of all three.
    fn route(&mut self, now: Time) {
        let [a, b, c] = self.inputs;
        let level = if self.cr2 & 1 << 7 != 0 { a ^ b ^ c } else { a };
        self.filter.set(level, now, self.sampling());
        self.catch_up(now);
    }

    /// Sampling of the filter: ticks between samples, and equal samples for an edge.
    fn sampling(&self) -> (Time, Time) {
        let clock = self.counter.cycle();
        let dts = clock << (self.cr1 >> 8 & 3);
        match self.ccmr1 >> 4 & 0xF {
            0 => (dts, 1),
            1 => (clock, 2),
            2 => (clock, 4),
            3 => (clock, 8),
            code @ 4..10 => (dts << (code / 2 - 1), if code % 2 == 0 { 6 } else { 8 }),
            code => {
                let (every, samples) = if code < 13 { (16, code - 10) } else { (32, code - 13) };
                (dts * every, [5, 6, 8][samples as usize])
            }
        }
    }

    fn catch_up(&mut self, now: Time) {
        loop {
            let turn = self.counter.next_stop(&[]);
            let edge = self.filter.due.unwrap_or(NEVER);
            if turn.min(edge) > now {
                break;
            }
            if turn <= edge {
                self.counter.advance(turn);
                self.turned();
            } else {
                self.counter.advance(edge);
                if self.filter.sampled() {
                    self.triggered(edge);
                }
            }
        }
        self.counter.advance(now);
    }

    fn turned(&mut self) {
        if self.cr1 & 1 << 1 == 0 {
            self.counter.update();
            self.sr |= UIF;
        }
    }

    /// An edge of channel 1's filtered input, which may be the trigger (TS: TI1F_ED).
    fn triggered(&mut self, at: Time) {
        if self.smcr >> 4 & 7 != 4 {
            return;
        }
        if self.ccmr1 & 3 == 3 && self.ccer & 1 != 0 {
            self.sr |= if self.sr & CC1IF != 0 { CC1OF } else { CC1IF };
            self.captured = self.counter.count;
        }
        if self.smcr & 7 == 4 {
            self.sr |= TIF;
            self.restart(at);
        }
    }

    /// UG, or the slave controller's reset. With URS only an overflow sets the update flag; UDIS suppresses
    /// all updates.
    fn restart(&mut self, at: Time) {
        if self.cr1 & 1 << 1 == 0 {
            self.counter.update();
            if self.cr1 & 1 << 2 == 0 {
                self.sr |= UIF;
            }
        }
        self.counter.restart(at);
    }
}

/// Accepts the modeled bits of a register, or returns an error for others.
pub(super) fn only(name: &str, value: u32, modeled: u32) -> RegisterResult<u32> {
    let more = value & !modeled;
    if more == 0 { Ok(value) } else { Err(format!("bits {more:#x} of {name}")) }
}

impl Peripheral for Timer {
    fn read(&mut self, offset: u32, now: Time) -> RegisterResult<u32> {
        self.catch_up(now);
        Ok(match offset {
            0x00 => self.cr1,
            0x04 => self.cr2,
            0x08 => self.smcr,
            0x0C => self.dier,
            0x10 => self.sr,
            0x14 => 0,
            0x18 => self.ccmr1,
            0x20 => self.ccer,
            0x24 => self.counter.count,
            0x28 => self.counter.prescaler,
            0x2C => self.counter.reload,
            0x34 => {
                // Reading CCR1 clears the capture flag (RM0008 15.4.5).
                self.sr &= !CC1IF;
                self.captured
            }
            0x1C | 0x38..=0x40 => return Err("channels 2 to 4".to_owned()),
            _ => return Err(format!("no register {offset:#x} of TIM2 to TIM4")),
        })
    }

    fn write(&mut self, offset: u32, value: u32, now: Time) -> RegisterResult<()> {
        self.catch_up(now);
        let value = value & 0xFFFF;
        match offset {
            0x00 => {
                // CKD, ARPE, URS, UDIS, CEN: counts up continuously.
                self.cr1 = only("CR1", value, 0x387)?;
                if value >> 8 & 3 == 3 {
                    return Err("CKD 3, which is reserved".to_owned());
                }
                self.counter.buffered = value & 1 << 7 != 0;
                self.counter.run(value & 1 != 0, now);
            }
            0x04 => {
                self.cr2 = only("CR2", value, 1 << 7)?;
                self.route(now);
            }
            0x08 => match value {
                0 | 0x44 | 0x40 => self.smcr = value,
                _ => return Err("SMCR other than a reset by TI1F_ED".to_owned()),
            },
            0x0C => self.dier = only("DIER", value, UIF | CC1IF | TIF)?,
            0x10 => self.sr &= value,
            0x14 => {
                if only("EGR", value, 1)? != 0 {
                    self.restart(now);
                }
            }
            0x18 => {
                let capture = value & 3;
                if value != 0 && (value & !0xF3 != 0 || capture != 3) {
                    return Err("channels that are not captures of channel 1 by the trigger".to_owned());
                }
                // CC1S is writable only while the channel is off (RM0008 15.4.7).
                if self.ccer & 1 != 0 && capture != self.ccmr1 & 3 {
                    return Err("CC1S written with CC1E on".to_owned());
                }
                self.ccmr1 = value;
            }
            0x20 => {
                self.ccer = only("CCER", value, 1)?;
                if value != 0 && self.ccmr1 & 3 != 3 {
                    return Err("an output of TIM2 to TIM4".to_owned());
                }
            }
            0x24 => self.counter.set_count(value),
            0x28 => self.counter.prescaler = value,
            0x2C => self.counter.set_reload(value),
            // CCR1 of a capture is read-only.
            0x34 if self.ccmr1 & 3 != 0 => {}
            0x1C | 0x34..=0x40 => return Err("compares of TIM2 to TIM4".to_owned()),
            _ => return Err(format!("no register {offset:#x} of TIM2 to TIM4")),
        }
        Ok(())
    }

    fn next_event(&self) -> Time {
        let edge = self.filter.due.unwrap_or(NEVER);
        let update = self.dier & UIF != 0 && self.sr & UIF == 0;
        if update { self.counter.next_stop(&[]).min(edge) } else { edge }
    }

    fn advance(&mut self, now: Time) {
        self.catch_up(now);
    }
}

#[cfg(test)]
mod tests;
