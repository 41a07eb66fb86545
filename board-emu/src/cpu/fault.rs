//! Faults: what they are called in the status registers, and who takes them (ARMv7-M B1.5.14).
//!
//! All are precise. On the chip a store that the bus refuses may be reported late (IMPRECISERR), without its address.

use super::Cpu;
use super::nvic::number::{BUS_FAULT, HARD_FAULT, MEM_MANAGE, SV_CALL, USAGE_FAULT};
use crate::stop::Problem;

/// Why an instruction cannot be completed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// No such instruction.
    Undefined,
    /// Not in Thumb state.
    State,
    /// An exception return that does not fit.
    Return,
    /// There is no coprocessor.
    Coprocessor,
    /// An address that is not aligned.
    Unaligned,
    /// A division by 0, trapped.
    DivideByZero,
    /// The bus refuses a load or a store of this address.
    Bus(u32),
    /// The bus refuses to give an instruction.
    Fetch,
    /// Nothing may be executed there.
    ExecuteNever,
    /// The bus refuses what an exception's entry stores.
    Stacking,
    /// The bus refuses what an exception's return loads.
    Unstacking,
    /// BKPT without a debugger.
    Breakpoint,
}

/// Why an instruction does not end as usual.
#[derive(Clone, Debug)]
pub enum Trap {
    /// A fault, to be taken by the program.
    Fault(Fault),
    /// SVC: done, and asks for its exception.
    SupervisorCall,
    /// The run ends.
    Stop(Problem),
}

/// Status of faults (PM0056 4.4.10 to 4.4.15).
#[derive(Clone, Copy, Debug, Default)]
pub struct Status {
    /// CFSR.
    pub configurable: u32,
    /// HFSR.
    pub hard: u32,
    /// DFSR.
    pub debug: u32,
    /// MMFAR.
    pub memory_address: u32,
    /// BFAR.
    pub bus_address: u32,
}

/// HFSR.VECTTBL.
const VECTOR: u32 = 1 << 1;
/// HFSR.FORCED.
const FORCED: u32 = 1 << 30;
/// HFSR.DEBUGEVT.
const DEBUG_EVENT: u32 = 1 << 31;
/// CFSR.PRECISERR and BFARVALID.
const PRECISE: u32 = 1 << 9 | 1 << 15;

impl Cpu {
    /// Notes a fault in the status registers; the exception that is its own.
    fn note(&mut self, fault: Fault) -> u32 {
        let status = &mut self.sys.faults;
        let (exception, bits) = match fault {
            Fault::ExecuteNever => (MEM_MANAGE, 1),
            Fault::Fetch => (BUS_FAULT, 1 << 8),
            Fault::Bus(address) => {
                status.bus_address = address;
                (BUS_FAULT, PRECISE)
            }
            Fault::Unstacking => (BUS_FAULT, 1 << 11),
            Fault::Stacking => (BUS_FAULT, 1 << 12),
            Fault::Undefined => (USAGE_FAULT, 1 << 16),
            Fault::State => (USAGE_FAULT, 1 << 17),
            Fault::Return => (USAGE_FAULT, 1 << 18),
            Fault::Coprocessor => (USAGE_FAULT, 1 << 19),
            Fault::Unaligned => (USAGE_FAULT, 1 << 24),
            Fault::DivideByZero => (USAGE_FAULT, 1 << 25),
            Fault::Breakpoint => {
                status.debug |= 1 << 1;
                status.hard |= DEBUG_EVENT;
                (HARD_FAULT, 0)
            }
        };
        status.configurable |= bits;
        exception
    }

    /// The exception that takes a synchronous one that happens now: itself, or the HardFault.
    fn escalated(&mut self, exception: u32) -> Option<u32> {
        let now = self.sys.nvic.execution_priority(self.sys.masks);
        let nvic = &self.sys.nvic;
        let enabled = nvic.enabled >> exception & 1 == 1;
        if enabled && nvic.group(nvic.priority(exception)) < now {
            return Some(exception);
        }
        if now <= -1 {
            return None;
        }
        if exception != HARD_FAULT {
            self.sys.faults.hard |= FORCED;
        }
        Some(HARD_FAULT)
    }

    /// The exception that takes a fault which happens now; the fault is noted.
    pub(super) fn taker(&mut self, fault: Fault) -> Result<u32, Problem> {
        let exception = self.note(fault);
        let lockup =
            || Problem::Lockup { what: format!("{fault:?} within a HardFault, an NMI or FAULTMASK") };
        self.escalated(exception).ok_or_else(lockup)
    }

    /// Takes a fault of an instruction; the return address is that of the instruction.
    pub(super) fn fault(&mut self, fault: Fault) -> Result<(), Problem> {
        let taken = self.taker(fault)?;
        self.enter(taken)
    }

    /// Takes SVC.
    pub(super) fn supervisor_call(&mut self) -> Result<(), Problem> {
        let lockup = || Problem::Lockup { what: "SVC within a HardFault, an NMI or FAULTMASK".to_owned() };
        let taken = self.escalated(SV_CALL).ok_or_else(lockup)?;
        self.enter(taken)
    }

    /// A fault of an exception's entry or return, which is pending beside what is being entered: it may be the more urgent.
    pub(super) fn derived(&mut self, fault: Fault) {
        let exception = self.note(fault);
        let nvic = &self.sys.nvic;
        let taken = if nvic.enabled >> exception & 1 == 1 { exception } else { HARD_FAULT };
        if taken != exception {
            self.sys.faults.hard |= FORCED;
        }
        self.sys.nvic.pend(1 << taken);
    }

    /// An exception has no vector.
    pub(super) fn no_vector(&mut self, exception: u32) -> Result<(), Problem> {
        if exception <= HARD_FAULT {
            return Err(Problem::Lockup {
                what: format!("the vector of exception {exception} cannot be read"),
            });
        }
        self.sys.faults.hard |= VECTOR;
        self.sys.nvic.pend(1 << HARD_FAULT);
        Ok(())
    }
}
