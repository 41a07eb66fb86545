//! Chip and core, advanced in time.

use std::rc::Rc;

use crate::chip::{Chip, Reset};
use crate::cpu::Cpu;
use crate::image::Names;
use crate::stop::{Problem, Stop};
use crate::time::{NEVER, Time, US};

/// A chip with its core.
pub struct Machine {
    /// The core, which owns the chip.
    pub cpu: Cpu,
    /// Functions of the programs.
    pub names: Rc<Names>,
    powered: bool,
    /// Time of the next event, unless the program touches a peripheral before.
    next: Time,
    /// Every reset with its cause and time.
    pub resets: Vec<(Reset, Time)>,
}

/// Why [`Machine::run`] returned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pause {
    /// Time is up.
    Until,
    /// The bridge's timer was written: the gates may have changed.
    Gates,
    /// A reset: pins are in their reset state.
    Reset(Reset),
    /// The core is at a breakpoint.
    Breakpoint,
}

impl Machine {
    /// A chip without power.
    #[must_use]
    pub fn new(chip: Chip, names: Rc<Names>) -> Self {
        Self { cpu: Cpu::new(chip), names, powered: false, next: 0, resets: Vec::new() }
    }

    /// The chip.
    #[must_use]
    pub const fn chip(&self) -> &Chip {
        &self.cpu.chip
    }

    /// The chip, to change its pins or inputs.
    pub const fn chip_mut(&mut self) -> &mut Chip {
        self.next = 0;
        &mut self.cpu.chip
    }

    /// Present time.
    #[must_use]
    pub fn now(&self) -> Time {
        self.cpu.chip.now
    }

    /// Whether the supply is up.
    #[must_use]
    pub const fn is_powered(&self) -> bool {
        self.powered
    }

    /// Removes the supply: the chip is in reset until it returns, and the RAM is undefined.
    pub fn power_off(&mut self) {
        self.powered = false;
        self.cpu.chip.reset(Reset::Power);
    }

    /// Resets the chip; with [`Reset::Power`] after the supply has come up.
    ///
    /// # Errors
    /// The vector table cannot be read.
    pub fn reset(&mut self, cause: Reset) -> Result<(), Stop> {
        self.powered = true;
        self.resets.push((cause, self.now()));
        self.cpu.chip.reset(cause);
        self.cpu.reset().map_err(|problem| self.stop(problem))
    }

    /// Adds place and time to a problem.
    #[must_use]
    pub fn stop(&self, problem: Problem) -> Stop {
        let pc = self.cpu.pc();
        let function = self.names.function(pc).map(str::to_owned);
        Stop { problem, pc, function, at_us: self.now() / US }
    }

    /// Time of the next event of a peripheral or of SysTick.
    #[must_use]
    pub fn next_event(&self) -> Time {
        if self.is_due() { self.cpu.chip.next_event().min(self.cpu.next_event()) } else { self.next }
    }

    /// Executes up to `until`; the last instruction may end later. While the core sleeps, time jumps from
    /// event to event.
    ///
    /// # Errors
    /// The problem that ends the run.
    pub fn run(&mut self, until: Time, breakpoints: &[u32]) -> Result<Pause, Stop> {
        self.cpu.pauses_at_entry = !breakpoints.is_empty();
        if self.is_due() {
            self.settle();
        }
        while self.now() < until {
            if !self.powered {
                self.cpu.chip.now = until;
                break;
            }
            if let Some(wakes) = self.waits_until() {
                let to = self.next.min(until).min(wakes);
                self.cpu.chip.now = to;
            } else {
                self.execute(self.next.min(until), breakpoints)?;
            }
            if self.is_due() {
                self.settle();
                if let Some(cause) = self.reset_due() {
                    self.reset(cause)?;
                    return Ok(Pause::Reset(cause));
                }
                if std::mem::take(&mut self.cpu.chip.tim1.gates_changed) {
                    return Ok(Pause::Gates);
                }
            }
            if !breakpoints.is_empty() && breakpoints.contains(&self.cpu.pc()) {
                return Ok(Pause::Breakpoint);
            }
        }
        Ok(Pause::Until)
    }

    /// Executes up to the next event, access to a peripheral, sleep or breakpoint.
    fn execute(&mut self, until: Time, breakpoints: &[u32]) -> Result<(), Stop> {
        loop {
            let stepped = if breakpoints.is_empty() { self.cpu.run(until) } else { self.cpu.step() };
            stepped.map_err(|problem| self.stop(problem))?;
            if self.cpu.is_interrupted(until) || breakpoints.contains(&self.cpu.pc()) {
                return Ok(());
            }
        }
    }

    /// Whether no instruction is executed now: the core sleeps, stalls on its flash, or has no power.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        !self.powered || self.waits_until().is_some()
    }

    /// End of the wait: never by itself while the core sleeps, or the end of the flash operation.
    fn waits_until(&self) -> Option<Time> {
        if self.cpu.is_asleep() {
            return Some(NEVER);
        }
        let chip = &self.cpu.chip;
        (chip.flash.busy_until > chip.now).then_some(chip.flash.busy_until)
    }

    /// Time of the next event that may wake the core; those between timer 1 and converter cannot.
    #[must_use]
    pub fn next_wake(&self) -> Time {
        self.cpu.chip.next_wake().min(self.cpu.next_event())
    }

    /// A copy in the same state, with its own chip.
    #[must_use]
    pub fn duplicate(&self) -> Self {
        Self {
            cpu: self.cpu.duplicate(),
            names: Rc::clone(&self.names),
            powered: self.powered,
            next: self.next,
            resets: self.resets.clone(),
        }
    }

    const fn is_due(&self) -> bool {
        self.cpu.chip.touched || self.cpu.chip.now >= self.next
    }

    fn settle(&mut self) {
        let chip = &mut self.cpu.chip;
        let now = chip.now;
        let mut next = chip.next_event();
        while next <= now {
            // Events are handled at their own time; the present stays.
            chip.advance(next);
            chip.now = now;
            next = chip.next_event();
        }
        chip.touched = false;
        let (interrupts, nmi) = (chip.interrupts(), chip.rcc.clock_failed());
        self.cpu.advance();
        self.cpu.set_lines(interrupts, nmi);
        self.next = next.min(self.cpu.next_event());
        debug_assert!(self.next > now);
    }

    fn reset_due(&mut self) -> Option<Reset> {
        if self.cpu.take_reset_request() {
            Some(Reset::Software)
        } else {
            let chip = &self.cpu.chip;
            let by_window = chip.wwdg.expired.then_some(Reset::WindowWatchdog);
            chip.iwdg.expired.then_some(Reset::Watchdog).or(by_window)
        }
    }
}
