//! Exception entry and return (ARMv7-M B1.5.6 to B1.5.8), and the exception that takes a fault (B1.5.14).
//!
//! Simplified timing: entry and return take 12 cycles each, where the chip tail-chains in 6. An exception
//! that arrives during the entry of another preempts it after its first instruction; on the chip it takes its
//! place.

use super::counts::ENTRY;
use super::fault::{Fault, Trap};
use super::nvic::bit;
use super::nvic::number::{HARD_FAULT, NMI, SV_CALL};
use super::registers::Reg;
use super::state::{Cpu, Sleep};
use crate::stop::Problem;

const FRAME: u32 = 0x20;

/// Registers in a frame, before xPSR.
const STACKED: [Reg; 7] =
    [Reg::new(0), Reg::new(1), Reg::new(2), Reg::new(3), Reg::new(12), Reg::LR, Reg::PC];

/// xPSR in a frame: the stack was aligned.
const ALIGNED: u32 = 1 << 9;

/// HFSR.VECTTBL.
const VECTOR: u32 = 1 << 1;
/// HFSR.FORCED.
const FORCED: u32 = 1 << 30;

impl Cpu {
    pub(super) fn take_due(&mut self) -> Result<(), Problem> {
        match self.sys.nvic.due(self.sys.masks) {
            Some(exception) => self.enter(exception),
            None => {
                self.sys.nvic.changed = false;
                Ok(())
            }
        }
    }

    /// `ExceptionEntry()`.
    pub(super) fn enter(&mut self, exception: u32) -> Result<(), Problem> {
        let return_code = match (self.in_handler(), self.registers.control().spsel()) {
            (true, _) => 0xFFFF_FFF1,
            (false, false) => 0xFFFF_FFF9,
            (false, true) => 0xFFFF_FFFD,
        };
        match self.push_frame() {
            Ok(()) => {}
            Err(Trap::Stop(problem)) => return Err(problem),
            // The frame is lost. The derived fault may be taken instead; during the entry of HardFault it is
            // only recorded.
            Err(_) => {
                self.derived(Fault::Stacking);
                let derived = self.sys.nvic.most_urgent().unwrap_or(exception);
                if exception > HARD_FAULT && self.is_more_urgent(derived, exception) {
                    if self.sys.nvic.enabled >> exception & 1 == 1 {
                        self.sys.nvic.pend(bit(exception));
                    }
                    return self.take(derived, return_code);
                }
                if exception <= HARD_FAULT {
                    self.sys.nvic.unpend(bit(HARD_FAULT));
                }
            }
        }
        self.take(exception, return_code)
    }

    fn is_more_urgent(&self, one: u32, other: u32) -> bool {
        let nvic = &self.sys.nvic;
        nvic.group(nvic.priority(one)) < nvic.group(nvic.priority(other))
    }

    /// `PushStack()`.
    fn push_frame(&mut self) -> Result<(), Trap> {
        let align = self.sys.control.aligns_stack();
        let registers = &self.registers;
        let old = registers.get(Reg::SP);
        let top = if align { old & !7 } else { old };
        let sp = top.wrapping_sub(FRAME);
        let psr = registers.psr.get() & !ALIGNED | if top == old { 0 } else { ALIGNED };
        let kept = STACKED.map(|reg| registers.get(reg));
        self.registers.set(Reg::SP, sp);
        for (i, word) in (0..).zip(kept.into_iter().chain([psr])) {
            self.store_word(sp.wrapping_add(4 * i), word)?;
        }
        Ok(())
    }

    /// `ExceptionTaken()`.
    fn take(&mut self, exception: u32, return_code: u32) -> Result<(), Problem> {
        self.sys.nvic.activate(exception);
        let registers = &mut self.registers;
        registers.set(Reg::LR, return_code);
        registers.psr.set_exception_number(exception as u16).set_ici_it(0);
        registers.select_psp(false);
        self.sys.sleep = Sleep::No;
        self.sys.event = true;
        self.sys.exclusive = false;
        self.spend(ENTRY);
        let now = self.chip.now;
        self.counts.enter(exception, now);
        match self.load_word(self.sys.vectors.wrapping_add(4 * exception)) {
            Ok(vector) => {
                self.registers.psr.set_t(vector & 1 == 1);
                self.registers.set_pc(vector & !1);
                Ok(())
            }
            Err(Trap::Stop(problem)) => Err(problem),
            Err(_) => self.no_vector(exception),
        }
    }

    /// `ExceptionReturn()`: a branch of a handler to 0xFxxxxxxx.
    pub(super) fn leave(&mut self, return_code: u32) -> Result<(), Problem> {
        let exception = u32::from(self.registers.psr.exception_number());
        let nested = (self.sys.nvic.active & !bit(exception)) != 0;
        let was_active = self.sys.nvic.active & bit(exception) != 0;
        let fits = match return_code & 15 {
            1 => nested,
            9 | 13 => !nested || self.sys.control.leaves_nested(),
            _ => false,
        };
        self.counts.leave(exception);
        self.spend(ENTRY);
        self.sys.nvic.deactivate(exception);
        if exception != NMI {
            self.sys.masks.faultmask = false;
        }
        self.sys.event = true;
        self.sys.exclusive = false;
        if return_code >> 4 != 0x0FFF_FFFF || !fits || !was_active {
            // The fault is taken in place of the return; the frame stays (B1.5.8).
            let taken = self.taker(Fault::Return)?;
            return self.take(taken, 0xF000_0000 | return_code);
        }
        // Tail-chaining: the next exception uses the same frame.
        if let Some(next) = self.sys.nvic.due(self.sys.masks) {
            return self.take(next, return_code);
        }
        self.restore(return_code)
    }

    fn restore(&mut self, return_code: u32) -> Result<(), Problem> {
        let process = return_code & 15 == 13;
        let sp = if process { self.registers.psp() } else { self.registers.msp() };
        let mut frame = [0; 8];
        for (i, word) in (0..).zip(&mut frame) {
            match self.load_word(sp.wrapping_add(4 * i)) {
                Ok(value) => *word = value,
                Err(Trap::Stop(problem)) => return Err(problem),
                Err(_) => {
                    self.derived(Fault::Unstacking);
                    let Some(next) = self.sys.nvic.due(self.sys.masks) else {
                        return Err(Problem::Lockup {
                            what: "an exception's frame cannot be read".to_owned(),
                        });
                    };
                    return self.take(next, return_code);
                }
            }
        }
        let [kept @ .., psr] = frame;
        let align = self.sys.control.aligns_stack() && psr & ALIGNED != 0;
        let registers = &mut self.registers;
        STACKED.into_iter().zip(kept).for_each(|(reg, value)| registers.set(reg, value));
        registers.set_pc(registers.pc() & !1);
        registers.psr.set(psr & 0xFF00_FDFF);
        registers.select_psp(process);
        registers.set(Reg::SP, sp.wrapping_add(FRAME) | if align { 4 } else { 0 });
        let to_handler = return_code & 15 == 1;
        if to_handler != (psr & 0x1FF != 0) {
            // The fault is taken at the return address (B1.5.8), in the mode of IPSR.
            return self.fault(Fault::Return);
        }
        if !to_handler && self.sys.control.sleeps_on_exit() {
            self.sys.sleep = Sleep::Interrupt;
            self.wake_if_due();
        }
        Ok(())
    }

    /// The exception that takes a synchronous one now: itself, or HardFault.
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

    /// Records a fault and returns the exception that takes it now.
    fn taker(&mut self, fault: Fault) -> Result<u32, Problem> {
        let exception = self.sys.faults.record(fault);
        let lockup =
            || Problem::Lockup { what: format!("{fault:?} within a HardFault, an NMI or FAULTMASK") };
        self.escalated(exception).ok_or_else(lockup)
    }

    /// Takes a fault of an instruction, which is also the return address.
    pub(super) fn fault(&mut self, fault: Fault) -> Result<(), Problem> {
        let taken = self.taker(fault)?;
        self.enter(taken)
    }

    pub(super) fn supervisor_call(&mut self) -> Result<(), Problem> {
        let lockup = || Problem::Lockup { what: "SVC within a HardFault, an NMI or FAULTMASK".to_owned() };
        let taken = self.escalated(SV_CALL).ok_or_else(lockup)?;
        self.enter(taken)
    }

    /// Pends a fault of an exception's entry or return; it may be more urgent than that exception.
    fn derived(&mut self, fault: Fault) {
        let exception = self.sys.faults.record(fault);
        let nvic = &self.sys.nvic;
        let taken = if nvic.enabled >> exception & 1 == 1 { exception } else { HARD_FAULT };
        if taken != exception {
            self.sys.faults.hard |= FORCED;
        }
        self.sys.nvic.pend(1 << taken);
    }

    fn no_vector(&mut self, exception: u32) -> Result<(), Problem> {
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
