//! The core: a Cortex-M3 (ARMv7-M, r1p1) as far as firmware uses one. `armagnac` executes instructions; what it lacks or has
//! wrong is supplied here: exceptions and their priorities, the system control space, SysTick, sleep, faults, and some
//! instructions.

pub mod counts;

use std::cell::RefCell;
use std::rc::Rc;

use crate::chip::Chip;
use crate::stop::Problem;
use crate::time::{NEVER, Time};
use counts::Counts;

/// The chip as the core and its owner share it.
pub type Shared = Rc<RefCell<Chip>>;

/// The core.
pub struct Cpu {
    chip: Shared,
    /// What it has executed, by exception.
    pub counts: Counts,
}

impl Cpu {
    /// A core that is held in reset.
    #[must_use]
    pub fn new(chip: Shared) -> Self {
        Self { chip, counts: Counts::default() }
    }

    /// Out of reset: stack pointer and program counter from the vector table at 0, all else as ARMv7-M B1.5.5 says.
    ///
    /// # Errors
    /// A first instruction that cannot be fetched.
    pub fn reset(&mut self) -> Result<(), Problem> {
        Err(Problem::Lockup { what: "not there yet".to_owned() })
    }

    /// One instruction, after an exception's entry if one is due; moves the chip's time on by what both took.
    ///
    /// Not to be called while [`Self::is_asleep`].
    ///
    /// # Errors
    /// What ends the run.
    pub fn step(&mut self) -> Result<(), Problem> {
        let _ = &self.chip;
        Err(Problem::Lockup { what: "not there yet".to_owned() })
    }

    /// Tells the core of the interrupt lines (a bit each) and of the NMI, as they are now. To be called whenever the chip was
    /// [`Chip::touched`].
    pub fn set_lines(&mut self, interrupts: u64, nmi: bool) {
        let _ = (interrupts, nmi);
    }

    /// Whether it waits for an interrupt, and none that would wake it is pending.
    #[must_use]
    pub fn is_asleep(&self) -> bool {
        false
    }

    /// When SysTick next interrupts.
    #[must_use]
    pub fn next_event(&self) -> Time {
        NEVER
    }

    /// Lets the time that the chip shows pass for SysTick.
    pub fn advance(&mut self) {}

    /// Whether the program has asked for a reset (AIRCR.SYSRESETREQ) since this was last asked.
    pub fn take_reset_request(&mut self) -> bool {
        false
    }

    /// Address of the instruction that is next.
    #[must_use]
    pub fn pc(&self) -> u32 {
        0
    }

    /// A register: 0 to 12, 13 the stack pointer in use, 14 the link register, 15 the program counter, 16 xPSR.
    #[must_use]
    pub fn register(&self, index: usize) -> u32 {
        let _ = index;
        0
    }

    /// Sets a register, for a debugger.
    pub fn set_register(&mut self, index: usize, value: u32) {
        let _ = (index, value);
    }
}
