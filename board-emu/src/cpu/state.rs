//! State of the core, and operations that all instructions share.

use armagnac::core::{Config, Processor};

use super::control::Control;
use super::counts::Counts;
use super::decode::Decoder;
use super::fault::FaultStatus;
use super::nvic::number::SYS_TICK;
use super::nvic::{Masks, Nvic};
use super::registers::{Reg, Registers};
use super::systick::SysTick;
use crate::chip::Chip;
use crate::time::Time;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sleep {
    No,
    /// WFI.
    Interrupt,
    /// WFE.
    Event,
}

/// State of the core that `armagnac` does not hold.
#[derive(Clone, Debug)]
pub(super) struct System {
    pub(super) nvic: Nvic,
    pub(super) masks: Masks,
    pub(super) systick: SysTick,
    pub(super) faults: FaultStatus,
    pub(super) control: Control,
    /// VTOR.
    pub(super) vectors: u32,
    pub(super) sleep: Sleep,
    /// Event register.
    pub(super) event: bool,
    /// Exclusive monitor.
    pub(super) exclusive: bool,
    /// EXC_RETURN of a branch in a handler.
    pub(super) returning: Option<u32>,
    pub(super) reset_request: bool,
    pub(super) lowest_sp: u32,
}

impl System {
    pub(super) fn new(now: Time, cycle: Time) -> Self {
        Self {
            nvic: Nvic::default(),
            masks: Masks::default(),
            systick: SysTick::new(now, cycle),
            faults: FaultStatus::default(),
            control: Control::default(),
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
    /// The chip around the core.
    pub chip: Chip,
    /// Instruction counts.
    pub counts: Counts,
    /// A step ends after an exception entry, so that a breakpoint at the start of a handler is seen.
    pub pauses_at_entry: bool,
    pub(super) registers: Registers,
    /// Executes the correct instructions of `armagnac` on a copy of the registers. It stays in thread mode,
    /// so that it never takes an exception, and executes no instruction that accesses memory.
    pub(super) engine: Processor,
    pub(super) decoder: Decoder,
    pub(super) sys: System,
}

impl Cpu {
    /// A core in reset.
    #[must_use]
    pub fn new(chip: Chip) -> Self {
        let sys = System::new(0, 1);
        Self {
            chip,
            counts: Counts::default(),
            pauses_at_entry: false,
            registers: Registers::new(),
            engine: Processor::new(Config::v7m()),
            decoder: Decoder::new(),
            sys,
        }
    }

    /// A copy of core and chip.
    #[must_use]
    pub fn duplicate(&self) -> Self {
        Self {
            chip: self.chip.clone(),
            counts: self.counts.clone(),
            pauses_at_entry: self.pauses_at_entry,
            registers: self.registers.clone(),
            engine: Processor::new(Config::v7m()),
            decoder: self.decoder.clone(),
            sys: self.sys.clone(),
        }
    }

    /// `BranchWritePC()`.
    pub(super) fn branch(&mut self, target: u32) {
        self.registers.set_pc(target & !1);
    }

    pub(super) fn branch_exchange(&mut self, target: u32) {
        self.registers.psr.set_t(target & 1 == 1);
        self.branch(target);
    }

    /// `BXWritePC()`: in a handler possibly an exception return.
    pub(super) fn exchange(&mut self, target: u32) {
        if target >> 28 == 15 && self.in_handler() {
            self.sys.returning = Some(target);
        }
        self.branch_exchange(target);
    }

    /// Spends the time of instructions that are not fetched.
    pub(super) fn spend(&mut self, instructions: u64) {
        let chip = &mut self.chip;
        let cycle = chip.rcc.core_cycle();
        chip.now += instructions * cycle * 3 / 2;
    }

    /// Wakes for an event, or for a pending exception that would preempt, ignoring PRIMASK (ARMv7-M B1.5.19).
    pub(super) fn wake_if_due(&mut self) {
        let masks = Masks { primask: false, ..self.sys.masks };
        let wakes = self.sys.sleep != Sleep::No && self.sys.nvic.due(masks).is_some()
            || self.sys.sleep == Sleep::Event && std::mem::take(&mut self.sys.event);
        if wakes {
            self.sys.sleep = Sleep::No;
        }
    }

    /// Advances SysTick to the chip's time.
    pub fn advance(&mut self) {
        let (now, cycle) = {
            let chip = &self.chip;
            (chip.now, chip.rcc.core_cycle())
        };
        if self.sys.systick.advance(now, cycle) {
            self.sys.nvic.pend(1 << SYS_TICK);
            self.wake_if_due();
        }
    }

    pub(super) fn get(&self, reg: Reg) -> u32 {
        self.registers.get(reg)
    }

    pub(super) fn set(&mut self, reg: Reg, value: u32) {
        self.registers.set(reg, value);
    }

    pub(super) fn in_handler(&self) -> bool {
        self.registers.psr.exception_number() != 0
    }

    pub(super) fn is_privileged(&self) -> bool {
        self.in_handler() || !self.registers.control().privileged_bit()
    }
}
