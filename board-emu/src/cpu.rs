//! The core: a Cortex-M3 (ARMv7-M, r1p1) as far as firmware uses one. `armagnac` executes instructions; what it lacks or has
//! wrong is supplied here: exceptions and their priorities, the system control space, SysTick, sleep, faults, and some
//! instructions.

mod alu;
pub mod counts;
mod decode;
mod decode_wide;
mod exception;
mod fault;
mod memory;
pub mod nvic;
mod scs;
mod special;
mod systick;
#[cfg(test)]
mod tests;

use std::cell::RefCell;
use std::rc::Rc;

use armagnac::core::{Config, Effect, Processor};
use armagnac::registers::RegisterIndex;

use crate::chip::Chip;
use crate::stop::Problem;
use crate::time::Time;
use counts::Counts;
use decode::{Decoded, Decoder, Op, Place};
use fault::{Fault, Trap};
use nvic::number::SYS_TICK;
use nvic::{Masks, Nvic};
use systick::SysTick;

/// The chip as the core and its owner share it.
pub type Shared = Rc<RefCell<Chip>>;

/// Whether the core waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sleep {
    /// It does not.
    No,
    /// WFI.
    Interrupt,
    /// WFE.
    Event,
}

/// All of the core that `armagnac` does not keep.
#[derive(Clone, Debug)]
struct System {
    nvic: Nvic,
    masks: Masks,
    systick: SysTick,
    faults: fault::Status,
    control: scs::Control,
    /// VTOR.
    vectors: u32,
    sleep: Sleep,
    /// The event register.
    event: bool,
    /// The exclusive monitor.
    exclusive: bool,
    /// A branch in a handler asks for the return from its exception.
    returning: Option<u32>,
    reset_request: bool,
    lowest_sp: u32,
}

impl System {
    fn new(now: Time, cycle: Time) -> Self {
        Self {
            nvic: Nvic::default(),
            masks: Masks::default(),
            systick: SysTick::new(now, cycle),
            faults: fault::Status::default(),
            control: scs::Control::default(),
            vectors: 0,
            sleep: Sleep::No,
            event: false,
            exclusive: false,
            returning: None,
            reset_request: false,
            lowest_sp: u32::MAX,
        }
    }
}

/// The core.
pub struct Cpu {
    chip: Shared,
    /// What it has executed, by exception.
    pub counts: Counts,
    /// A step ends with an exception's entry, so that a breakpoint at a handler's beginning is seen.
    pub pauses_at_entry: bool,
    /// Registers, and the instructions that are right. It stays in thread mode, which keeps it from taking part in exceptions;
    /// none of its instructions that touch memory is used.
    engine: Processor,
    decoder: Decoder,
    sys: System,
}

fn engine() -> Processor {
    Processor::new(Config::v7m())
}

impl Cpu {
    /// A core that is held in reset.
    #[must_use]
    pub fn new(chip: Shared) -> Self {
        let sys = System::new(0, 1);
        Self {
            chip,
            counts: Counts::default(),
            pauses_at_entry: false,
            engine: engine(),
            decoder: Decoder::new(),
            sys,
        }
    }

    /// A core in the same state, at another chip.
    #[must_use]
    pub fn duplicate(&self, chip: Shared) -> Self {
        let mut engine = engine();
        engine.registers = self.engine.registers;
        let (counts, decoder, sys) = (self.counts.clone(), self.decoder.clone(), self.sys.clone());
        Self { chip, counts, pauses_at_entry: self.pauses_at_entry, engine, decoder, sys }
    }

    /// Out of reset: stack pointer and program counter from the vector table at 0, all else as ARMv7-M B1.5.5 says.
    ///
    /// # Errors
    /// A first instruction that cannot be fetched.
    pub fn reset(&mut self) -> Result<(), Problem> {
        let (now, cycle) = {
            let chip = self.chip.borrow();
            (chip.now, chip.rcc.core_cycle())
        };
        let lowest = self.sys.lowest_sp;
        self.sys = System::new(now, cycle);
        self.sys.lowest_sp = lowest;
        self.counts.reset();
        self.engine.registers = armagnac::registers::CoreRegisters::new();
        let no_vector = |_| Problem::Lockup { what: "the vector of reset cannot be read".to_owned() };
        let sp = self.load_word(0).map_err(no_vector)?;
        let pc = self.load_word(4).map_err(no_vector)?;
        let registers = &mut self.engine.registers;
        (registers.msp, registers.lr, registers.pc) = (sp & !3, u32::MAX, pc & !1);
        registers.psr.set_t(pc & 1 == 1);
        Ok(())
    }

    /// One instruction, after an exception's entry if one is due; moves the chip's time on by what both took.
    ///
    /// Not to be called while [`Self::is_asleep`].
    ///
    /// # Errors
    /// What ends the run.
    pub fn step(&mut self) -> Result<(), Problem> {
        if self.sys.nvic.changed {
            let before = self.engine.registers.pc;
            self.take_due()?;
            if self.pauses_at_entry && self.engine.registers.pc != before {
                return Ok(());
            }
        }
        let (pc, psr) = (self.engine.registers.pc, self.engine.registers.psr);
        match self.instruction() {
            Ok(()) => {
                if let Some(code) = self.sys.returning.take() {
                    self.leave(code)?;
                }
            }
            Err(Trap::Stop(problem)) => return Err(problem),
            Err(Trap::SupervisorCall) => self.supervisor_call()?,
            Err(Trap::Fault(fault)) => {
                // As if it had not begun.
                (self.engine.registers.pc, self.engine.registers.psr) = (pc, psr);
                self.fault(fault)?;
            }
        }
        self.sys.lowest_sp = self.sys.lowest_sp.min(self.engine.registers.msp);
        Ok(())
    }

    /// Fetches and executes.
    fn instruction(&mut self) -> Result<(), Trap> {
        let pc = self.engine.registers.pc;
        let code = self.fetch(pc)?;
        let it = self.engine.registers.psr.it_state();
        let place = match it.0 & 15 {
            0 => Place::Outside,
            8 => Place::Last,
            _ => Place::Inside,
        };
        let decoded = self.decoder.decode(pc, code, place).ok_or(Trap::Fault(Fault::Undefined))?;
        let registers = &mut self.engine.registers;
        registers.pc = pc.wrapping_add(4);
        let mut passes = true;
        if place != Place::Outside {
            passes = it.current_condition().is_none_or(|condition| registers.psr.test(condition));
            let mut next = it;
            next.advance();
            registers.psr.set_it_state(next);
        }
        if let Some(condition) = decoded.condition {
            passes = registers.psr.test(condition);
        }
        let next = pc.wrapping_add(if decoded.code >> 16 == 0 { 2 } else { 4 });
        let branched = passes && self.execute(&decoded, next)?;
        if !branched {
            self.engine.registers.pc = next;
        }
        Ok(())
    }

    /// Executes; whether the program counter is already where it is to be.
    fn execute(&mut self, decoded: &Decoded, next: u32) -> Result<bool, Trap> {
        // What branches changes it; PC reads as the instruction's address and 4.
        let before = self.engine.registers.pc;
        match &decoded.op {
            Op::Engine(instruction) => {
                let effect = instruction.execute(&mut self.engine).map_err(|error| {
                    Trap::Stop(Problem::Instruction { code: decoded.code, what: format!("{error:?}") })
                })?;
                // The two lowest bits of a stack pointer are 0 (ARMv7-M B1.4.1).
                *self.engine.registers.sp_mut() &= !3;
                return Ok(effect == Effect::Branch);
            }
            Op::Transfer(transfer) => self.transfer(*transfer)?,
            Op::Pair(pair) => self.pair(*pair)?,
            Op::Multiple(multiple) => self.multiple(*multiple)?,
            Op::Exclusive(exclusive) => self.exclusive(*exclusive)?,
            Op::Data(data) => self.data(*data),
            Op::Move(shift) => self.shift(*shift),
            Op::Divide(divide) => self.divide(*divide)?,
            Op::Table { base, index, size } => {
                self.table(*base, *index, *size)?;
                return Ok(true);
            }
            Op::Exchange { target, link } => {
                let target = self.get(*target);
                if *link {
                    self.engine.registers.lr = next | 1;
                    self.branch_exchange(target);
                } else {
                    self.exchange(target);
                }
                return Ok(true);
            }
            Op::ToPc { source, add } => {
                let source = self.get(*source);
                self.branch(if *add { before.wrapping_add(source) } else { source });
                return Ok(true);
            }
            Op::Special(special) => {
                // An exception that it asks for returns to what follows it.
                self.engine.registers.pc = next;
                self.special(*special)?;
                return Ok(true);
            }
        }
        Ok(decoded.loads_pc())
    }

    /// `BranchWritePC()`.
    fn branch(&mut self, target: u32) {
        self.engine.registers.pc = target & !1;
    }

    fn branch_exchange(&mut self, target: u32) {
        self.engine.registers.psr.set_t(target & 1 == 1);
        self.branch(target);
    }

    /// `BXWritePC()`: in a handler it may be the return from an exception.
    fn exchange(&mut self, target: u32) {
        if target >> 28 == 15 && self.in_handler() {
            self.sys.returning = Some(target);
        }
        self.branch_exchange(target);
    }

    /// The bits of the instruction at an address, the first half-word above the second. A busy flash keeps the core waiting
    /// (RM0008 3.3.3: until the operation is done).
    fn fetch(&mut self, pc: u32) -> Result<u32, Trap> {
        if !self.engine.registers.psr.t() {
            return Err(Trap::Fault(Fault::State));
        }
        let mut chip = self.chip.borrow_mut();
        let chip = &mut *chip;
        let half = |bytes: &[u8], at: u32| {
            bytes
                .get(at as usize..)
                .and_then(<[u8]>::first_chunk)
                .map(|half| u32::from(u16::from_le_bytes(*half)))
        };
        let (bytes, at) = match pc {
            0x0000_0000..0x0002_0000 | 0x0800_0000..0x0802_0000 => {
                chip.now = chip.now.max(chip.flash.busy_until);
                (&chip.flash.bytes, pc & 0x1_FFFF)
            }
            0x2000_0000..0x2000_5000 => (&chip.ram, pc & 0xFFFF),
            0x4000_0000..0x6000_0000 | 0xA000_0000.. => return Err(Trap::Fault(Fault::ExecuteNever)),
            _ => return Err(Trap::Fault(Fault::Fetch)),
        };
        let fetched = || {
            let first = half(bytes, at)?;
            if decode::is_wide(first) { Some(first << 16 | half(bytes, at + 2)?) } else { Some(first) }
        };
        let code = fetched().ok_or(Trap::Fault(Fault::Fetch))?;
        // 1.5 cycles an instruction.
        chip.now += chip.rcc.core_cycle() * 3 / 2;
        self.counts.instruction();
        Ok(code)
    }

    /// Time of instructions that are not fetched.
    fn spend(&mut self, instructions: u64) {
        let mut chip = self.chip.borrow_mut();
        let cycle = chip.rcc.core_cycle();
        chip.now += instructions * cycle * 3 / 2;
    }

    /// Tells the core of the interrupt lines (a bit each) and of the NMI, as they are now. To be called whenever the chip was
    /// [`Chip::touched`].
    pub fn set_lines(&mut self, interrupts: u64, nmi: bool) {
        let before = self.sys.nvic.pending;
        self.sys.nvic.set_lines(interrupts, nmi);
        self.sys.event |= self.sys.pending_is_event() && self.sys.nvic.pending & !before != 0;
        self.wake_if_due();
    }

    /// Wakes if something is pending that would preempt what runs, PRIMASK aside (ARMv7-M B1.5.19), or for an event.
    fn wake_if_due(&mut self) {
        let masks = Masks { primask: false, ..self.sys.masks };
        let wakes = self.sys.sleep != Sleep::No && self.sys.nvic.due(masks).is_some()
            || self.sys.sleep == Sleep::Event && std::mem::take(&mut self.sys.event);
        if wakes {
            self.sys.sleep = Sleep::No;
        }
    }

    /// Whether it waits for an interrupt, and none that would wake it is pending.
    #[must_use]
    pub fn is_asleep(&self) -> bool {
        self.sys.sleep != Sleep::No
    }

    /// When SysTick next interrupts.
    #[must_use]
    pub fn next_event(&self) -> Time {
        self.sys.systick.next_event()
    }

    /// Lets the time that the chip shows pass for SysTick.
    pub fn advance(&mut self) {
        let (now, cycle) = {
            let chip = self.chip.borrow();
            (chip.now, chip.rcc.core_cycle())
        };
        if self.sys.systick.advance(now, cycle) {
            self.sys.nvic.pend(1 << SYS_TICK);
            self.wake_if_due();
        }
    }

    /// Whether the program has asked for a reset (AIRCR.SYSRESETREQ) since this was last asked.
    pub fn take_reset_request(&mut self) -> bool {
        std::mem::take(&mut self.sys.reset_request)
    }

    /// The lowest that the main stack pointer has been after an instruction, since [`Self::reset_lowest_sp`].
    #[must_use]
    pub const fn lowest_sp(&self) -> u32 {
        self.sys.lowest_sp
    }

    /// Forgets it.
    pub const fn reset_lowest_sp(&mut self) {
        self.sys.lowest_sp = u32::MAX;
    }

    /// Address of the instruction that is next.
    #[must_use]
    pub fn pc(&self) -> u32 {
        self.engine.registers.pc
    }

    /// A register: 0 to 12, 13 the stack pointer in use, 14 the link register, 15 the program counter, 16 xPSR.
    #[must_use]
    pub fn register(&self, index: usize) -> u32 {
        match index {
            0..=15 => self.get(decode::reg(index as u32)),
            _ => self.engine.registers.psr.get(),
        }
    }

    /// Sets a register, for a debugger.
    pub fn set_register(&mut self, index: usize, value: u32) {
        match index {
            0..=15 => self.set(decode::reg(index as u32), value),
            _ => self.engine.registers.psr.set(value),
        }
    }

    fn get(&self, index: RegisterIndex) -> u32 {
        self.engine.registers[index]
    }

    fn set(&mut self, index: RegisterIndex, value: u32) {
        let value = if index.is_sp() { value & !3 } else { value };
        self.engine.registers.set(index, value);
    }

    fn in_handler(&self) -> bool {
        self.engine.registers.psr.exception_number() != 0
    }

    fn is_privileged(&self) -> bool {
        self.in_handler() || !self.engine.registers.control.privileged_bit()
    }
}
