//! Faults and their bits in the status registers (ARMv7-M B1.5.14).
//!
//! All faults are precise. On the chip a rejected store may be reported late (IMPRECISERR), without its
//! address.

use super::nvic::number::{BUS_FAULT, HARD_FAULT, MEM_MANAGE, USAGE_FAULT};
use crate::stop::Problem;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    Undefined,
    /// Not in Thumb state.
    State,
    /// Invalid exception return.
    Return,
    Coprocessor,
    Unaligned,
    DivideByZero,
    /// Bus error of a load or store at this address.
    Bus(u32),
    Fetch,
    ExecuteNever,
    Stacking,
    Unstacking,
    /// BKPT without debugger.
    Breakpoint,
}

/// Why an instruction did not complete normally.
#[derive(Clone, Debug)]
pub enum Trap {
    Fault(Fault),
    /// SVC has completed and requests its exception.
    SupervisorCall,
    /// The run ends.
    Stop(Problem),
}

/// Fault status registers (PM0056 4.4.10 to 4.4.15).
#[derive(Clone, Copy, Debug, Default)]
pub struct FaultStatus {
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

/// HFSR.DEBUGEVT.
const DEBUG_EVENT: u32 = 1 << 31;
/// CFSR.PRECISERR and BFARVALID.
const PRECISE: u32 = 1 << 9 | 1 << 15;

impl FaultStatus {
    /// Records a fault; returns its own exception.
    pub fn record(&mut self, fault: Fault) -> u32 {
        let (exception, bits) = match fault {
            Fault::ExecuteNever => (MEM_MANAGE, 1),
            Fault::Fetch => (BUS_FAULT, 1 << 8),
            Fault::Bus(address) => {
                self.bus_address = address;
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
                self.debug |= 1 << 1;
                self.hard |= DEBUG_EVENT;
                (HARD_FAULT, 0)
            }
        };
        self.configurable |= bits;
        exception
    }
}
