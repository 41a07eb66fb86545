//! The core: a Cortex-M3 (ARMv7-M, r1p1) as far as the firmware uses one. `armagnac` executes instructions.
//! Supplied here is what it lacks, does wrong or does slowly: exceptions and priorities, system control
//! space, SysTick, sleep, faults, and many instructions.

mod alu;
mod control;
pub mod counts;
mod decode;
mod decode_narrow;
mod decode_wide;
mod exception;
mod fault;
mod frequent;
mod memory;
pub mod nvic;
mod op;
mod registers;
mod scs;
mod special;
mod state;
mod systick;
#[cfg(test)]
mod tests;

pub use state::Cpu;

use armagnac::core::{Effect, ItState};

use crate::stop::Problem;
use crate::time::Time;
use decode::By;
use fault::{Fault, Trap};
use op::{Op, Place};
use registers::{Reg, Registers};
use state::{Sleep, System};

/// The IT state's bits of xPSR (ARMv7-M B1.4.2).
const IT: u32 = 0x0600_FC00;

impl Cpu {
    /// Leaves reset: stack pointer and program counter from the vector table at 0, all else by ARMv7-M
    /// B1.5.5.
    ///
    /// # Errors
    /// The vector table cannot be read.
    pub fn reset(&mut self) -> Result<(), Problem> {
        let (now, cycle) = {
            let chip = &self.chip;
            (chip.now, chip.rcc.core_cycle())
        };
        let lowest = self.sys.lowest_sp;
        self.sys = System::new(now, cycle);
        self.sys.lowest_sp = lowest;
        self.counts.reset();
        self.registers = Registers::new();
        let no_vector = |_| Problem::Lockup { what: "the vector of reset cannot be read".to_owned() };
        let sp = self.load_word(0).map_err(no_vector)?;
        let pc = self.load_word(4).map_err(no_vector)?;
        self.registers.set(Reg::SP, sp);
        self.registers.set(Reg::LR, u32::MAX);
        self.branch_exchange(pc);
        Ok(())
    }

    /// Steps at least once, until [`Self::is_interrupted`].
    ///
    /// # Errors
    /// The problem that ends the run.
    pub fn run(&mut self, until: Time) -> Result<(), Problem> {
        loop {
            self.one()?;
            if self.is_interrupted(until) {
                return Ok(());
            }
        }
    }

    /// Whether the chip needs service before the next instruction: time is up, the core sleeps, or a
    /// peripheral or the flash was accessed.
    #[must_use]
    pub fn is_interrupted(&self, until: Time) -> bool {
        self.chip.touched || self.chip.now >= until || self.is_asleep()
    }

    /// Executes one instruction, after an exception entry if one is due, and advances the chip's time.
    ///
    /// Must not be called while [`Self::is_asleep`].
    ///
    /// # Errors
    /// The problem that ends the run.
    pub fn step(&mut self) -> Result<(), Problem> {
        self.one()
    }

    #[inline(always)]
    fn one(&mut self) -> Result<(), Problem> {
        if self.sys.nvic.changed {
            let before = self.registers.pc();
            self.take_due()?;
            if self.pauses_at_entry && self.registers.pc() != before {
                return Ok(());
            }
        }
        let (pc, psr) = (self.registers.pc(), self.registers.psr);
        match self.instruction() {
            Ok(()) => {
                if let Some(code) = self.sys.returning.take() {
                    self.leave(code)?;
                }
            }
            Err(Trap::Stop(problem)) => return Err(problem),
            Err(Trap::SupervisorCall) => self.supervisor_call()?,
            Err(Trap::Fault(fault)) => {
                // A faulting instruction has no effect.
                self.registers.set_pc(pc);
                self.registers.psr = psr;
                self.fault(fault)?;
            }
        }
        self.sys.lowest_sp = self.sys.lowest_sp.min(self.registers.msp());
        Ok(())
    }

    fn instruction(&mut self) -> Result<(), Trap> {
        let pc = self.registers.pc();
        let code = self.fetch(pc)?;
        let psr = &mut self.registers.psr;
        let it = if psr.get() & IT == 0 { ItState(0) } else { psr.it_state() };
        let place = match it.0 & 15 {
            0 => Place::Outside,
            8 => Place::Last,
            _ => Place::Inside,
        };
        let decoded = self.decoder.decode(pc, code, place).ok_or(Trap::Fault(Fault::Undefined))?;
        let mut passes = true;
        if place != Place::Outside {
            passes = it.current_condition().is_none_or(|condition| psr.test(condition));
            let mut next = it;
            next.advance();
            psr.set_it_state(next);
        }
        if let Some(condition) = decoded.condition {
            passes = psr.test(condition);
        }
        let next = pc.wrapping_add(if code >> 16 == 0 { 2 } else { 4 });
        if !passes {
            self.registers.set_pc(next);
            return Ok(());
        }
        // An instruction reads PC as its address plus 4.
        self.registers.set_pc(pc.wrapping_add(4));
        let branched = match &decoded.by {
            By::Us(op) => {
                let op = *op;
                self.execute(op, next)?
            }
            By::Engine(instruction) => {
                self.registers.copy_to(&mut self.engine.registers);
                let effect = instruction
                    .execute(&mut self.engine)
                    .map_err(|error| Trap::Stop(Problem::Instruction { code, what: format!("{error:?}") }))?;
                self.registers.copy_from(&self.engine.registers);
                effect == Effect::Branch
            }
        };
        if !branched {
            self.registers.set_pc(next);
        }
        Ok(())
    }

    /// Returns whether the operation has written PC.
    fn execute(&mut self, op: Op, next: u32) -> Result<bool, Trap> {
        match op {
            Op::Transfer(transfer) => {
                self.transfer(transfer)?;
                return Ok(transfer.load && transfer.rt.is_pc());
            }
            Op::Multiple(multiple) => {
                self.multiple(multiple)?;
                return Ok(multiple.load && multiple.list >> 15 == 1);
            }
            Op::Pair(pair) => self.pair(pair)?,
            Op::Exclusive(exclusive) => self.exclusive(exclusive)?,
            Op::Data(data) => self.data(data),
            Op::Move(shift) => self.shift(shift),
            Op::Divide(divide) => self.divide(divide)?,
            Op::MoveTop(rd, top) => self.set(rd, u32::from(top) << 16 | self.get(rd) & 0xFFFF),
            Op::Extend(extend) => self.extend(extend),
            Op::IfThen(state) => {
                self.registers.psr.set_it_state(ItState(state));
            }
            Op::Special(special) => {
                // An exception that it requests returns to the next instruction.
                self.registers.set_pc(next);
                self.special(special)?;
                return Ok(true);
            }
            _ => return self.jump(op, next),
        }
        Ok(false)
    }

    /// Returns whether the branch was taken.
    fn jump(&mut self, op: Op, next: u32) -> Result<bool, Trap> {
        let pc = self.registers.pc();
        match op {
            Op::Branch { offset, link } => {
                if link {
                    self.set(Reg::LR, next | 1);
                }
                self.branch(pc.wrapping_add(offset));
            }
            Op::CompareBranch { rn, zero, offset } => {
                if (self.get(rn) == 0) != zero {
                    return Ok(false);
                }
                self.branch(pc.wrapping_add(offset));
            }
            Op::Exchange { target, link } => {
                let target = self.get(target);
                if link {
                    self.set(Reg::LR, next | 1);
                    self.branch_exchange(target);
                } else {
                    self.exchange(target);
                }
            }
            Op::ToPc { source, add } => {
                let source = self.get(source);
                self.branch(if add { pc.wrapping_add(source) } else { source });
            }
            Op::Table { base, index, size } => self.table(base, index, size)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Reads the bits of an instruction, the first half-word in the upper half of a wide one. A busy flash
    /// stalls the core until its operation is done (RM0008 3.3.3).
    fn fetch(&mut self, pc: u32) -> Result<u32, Trap> {
        if !self.registers.psr.t() {
            return Err(Trap::Fault(Fault::State));
        }
        let chip = &mut self.chip;
        let (bytes, at) = match pc {
            0x0000_0000..0x0002_0000 | 0x0800_0000..0x0802_0000 => {
                chip.now = chip.now.max(chip.flash.busy_until);
                (&chip.flash.bytes, pc & 0x1_FFFF)
            }
            0x2000_0000..0x2000_5000 => (&chip.ram, pc & 0xFFFF),
            0x4000_0000..0x6000_0000 | 0xA000_0000.. => return Err(Trap::Fault(Fault::ExecuteNever)),
            _ => return Err(Trap::Fault(Fault::Fetch)),
        };
        let bytes = bytes.get(at as usize..).unwrap_or_default();
        let half = |bytes: &[u8; 2]| u32::from(u16::from_le_bytes(*bytes));
        let code = match (bytes.first_chunk::<4>(), bytes.first_chunk::<2>()) {
            (Some(&[a, b, c, d]), _) => {
                let first = half(&[a, b]);
                if decode::is_wide(first) { first << 16 | half(&[c, d]) } else { first }
            }
            // The last half-word of the memory.
            (None, Some(last)) if !decode::is_wide(half(last)) => half(last),
            _ => return Err(Trap::Fault(Fault::Fetch)),
        };
        // The model's cost: 1.5 cycles an instruction.
        chip.now += chip.rcc.core_cycle() * 3 / 2;
        self.counts.instruction();
        Ok(code)
    }

    /// Sets the interrupt lines (a bit each) and the NMI. Must be called whenever the chip was
    /// `Chip::touched`.
    pub fn set_lines(&mut self, interrupts: u64, nmi: bool) {
        let before = self.sys.nvic.pending;
        self.sys.nvic.set_lines(interrupts, nmi);
        self.sys.event |= self.sys.control.pending_is_event() && self.sys.nvic.pending & !before != 0;
        self.wake_if_due();
    }

    /// Whether the core waits for an interrupt or event.
    #[must_use]
    pub fn is_asleep(&self) -> bool {
        self.sys.sleep != Sleep::No
    }

    /// Time of the next SysTick interrupt.
    #[must_use]
    pub fn next_event(&self) -> Time {
        self.sys.systick.next_event()
    }

    /// Returns and clears the program's request for a reset (AIRCR.SYSRESETREQ).
    pub fn take_reset_request(&mut self) -> bool {
        std::mem::take(&mut self.sys.reset_request)
    }

    /// Lowest main stack pointer after an instruction since [`Self::reset_lowest_sp`].
    #[must_use]
    pub const fn lowest_sp(&self) -> u32 {
        self.sys.lowest_sp
    }

    /// Restarts that measurement.
    pub const fn reset_lowest_sp(&mut self) {
        self.sys.lowest_sp = u32::MAX;
    }

    /// Address of the next instruction.
    #[must_use]
    pub fn pc(&self) -> u32 {
        self.registers.pc()
    }

    /// A register: 0 to 12, 13 the stack pointer in use, 14 the link register, 15 the program counter, 16 xPSR.
    #[must_use]
    pub fn register(&self, index: usize) -> u32 {
        match index {
            0..=15 => self.get(Reg::new(index as u32)),
            _ => self.registers.psr.get(),
        }
    }

    /// Sets a register, for a debugger.
    pub fn set_register(&mut self, index: usize, value: u32) {
        match index {
            0..=15 => self.set(Reg::new(index as u32), value),
            _ => self.registers.psr.set(value),
        }
    }
}
