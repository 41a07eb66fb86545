//! A chip with its core, in time.

use std::rc::Rc;

use crate::chip::{Chip, Reset};
use crate::cpu::Cpu;
use crate::image::Names;
use crate::stop::{Problem, Stop};
use crate::time::{NEVER, Time, US};

/// A chip and its core.
pub struct Machine {
    /// The core, which has the chip.
    pub cpu: Cpu,
    /// What is where in the programs.
    pub names: Rc<Names>,
    /// Whether the supply is up.
    powered: bool,
    /// When what happens by itself is to be looked at again, unless the program touches something before.
    next: Time,
    /// How often it was reset, by cause.
    pub resets: Vec<(Reset, Time)>,
}

/// Why [`Machine::run`] came back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pause {
    /// Time is up.
    Until,
    /// The bridge's timer was told something: the gates may have changed.
    Gates,
    /// It was reset: pins are as reset leaves them.
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

    /// The chip, to look at.
    #[must_use]
    pub const fn chip(&self) -> &Chip {
        &self.cpu.chip
    }

    /// The chip: its pins, its inputs.
    pub const fn chip_mut(&mut self) -> &mut Chip {
        self.next = 0;
        &mut self.cpu.chip
    }

    /// The present.
    #[must_use]
    pub fn now(&self) -> Time {
        self.cpu.chip.now
    }

    /// Whether the supply is up.
    #[must_use]
    pub const fn is_powered(&self) -> bool {
        self.powered
    }

    /// The supply fails: the chip is in reset until it comes back. What RAM holds then is chance's.
    pub fn power_off(&mut self) {
        self.powered = false;
        self.cpu.chip.reset(Reset::Power);
    }

    /// Resets it; with [`Reset::Power`] after the supply has come up.
    ///
    /// # Errors
    /// There is nothing to execute.
    pub fn reset(&mut self, cause: Reset) -> Result<(), Stop> {
        self.powered = true;
        self.resets.push((cause, self.now()));
        self.cpu.chip.reset(cause);
        self.cpu.reset().map_err(|problem| self.stop(problem))
    }

    /// Puts a place to a problem.
    #[must_use]
    pub fn stop(&self, problem: Problem) -> Stop {
        let pc = self.cpu.pc();
        let function = self.names.function(pc).map(str::to_owned);
        Stop { problem, pc, function, at_us: self.now() / US }
    }

    /// When something next happens that the program does not do: a peripheral's event or SysTick's.
    #[must_use]
    pub fn next_event(&self) -> Time {
        if self.is_due() { self.cpu.chip.next_event().min(self.cpu.next_event()) } else { self.next }
    }

    /// Executes until `until`, or a little past it for the last instruction. While the core sleeps, time jumps from event to event.
    ///
    /// # Errors
    /// What ends the run.
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

    /// Executes until something else is due: an event, what follows from an access to a peripheral, sleep, a breakpoint.
    fn execute(&mut self, until: Time, breakpoints: &[u32]) -> Result<(), Stop> {
        loop {
            let stepped = if breakpoints.is_empty() { self.cpu.run(until) } else { self.cpu.step() };
            stepped.map_err(|problem| self.stop(problem))?;
            if self.cpu.is_interrupted(until) || breakpoints.contains(&self.cpu.pc()) {
                return Ok(());
            }
        }
    }

    /// Whether no instruction is executed now: the core sleeps, waits for its flash, or has no power.
    #[must_use]
    pub fn is_waiting(&self) -> bool {
        !self.powered || self.waits_until().is_some()
    }

    /// The core sleeps (which only an event ends), or waits for its flash.
    fn waits_until(&self) -> Option<Time> {
        if self.cpu.is_asleep() {
            return Some(NEVER);
        }
        let chip = &self.cpu.chip;
        (chip.flash.busy_until > chip.now).then_some(chip.flash.busy_until)
    }

    /// When something next happens that may wake the core: not what timer 1 and the converter do among themselves.
    #[must_use]
    pub fn next_wake(&self) -> Time {
        self.cpu.chip.next_wake().min(self.cpu.next_event())
    }

    /// The same machine in the same state, with a chip of its own.
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

    /// All events that are due, and when the next one is.
    fn settle(&mut self) {
        let chip = &mut self.cpu.chip;
        let now = chip.now;
        let mut next = chip.next_event();
        while next <= now {
            // In their order; the present stays.
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
            self.cpu.chip.iwdg.expired.then_some(Reset::Watchdog)
        }
    }
}
