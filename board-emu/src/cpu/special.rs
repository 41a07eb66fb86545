//! Special registers, sleep, and instructions that ask for exceptions (ARMv7-M B1.4, B5.2).

use super::fault::{Fault, Trap};
use super::nvic::PRIORITY_BITS;
use super::op::Special;
use super::state::{Cpu, Sleep};

const APSR: u32 = 0xF800_0000;
const IPSR: u32 = 0x1FF;

impl Cpu {
    pub(super) fn special(&mut self, special: Special) -> Result<(), Trap> {
        match special {
            Special::Nothing => {}
            Special::WaitForInterrupt => {
                self.sys.sleep = Sleep::Interrupt;
                self.wake_if_due();
            }
            Special::WaitForEvent => {
                if !std::mem::take(&mut self.sys.event) {
                    self.sys.sleep = Sleep::Event;
                }
            }
            Special::SendEvent => self.sys.event = true,
            Special::ClearExclusive => self.sys.exclusive = false,
            Special::ChangeState { disable, primask, faultmask } => {
                if self.is_privileged() {
                    if primask {
                        self.sys.masks.primask = disable;
                    }
                    if faultmask {
                        self.set_faultmask(disable);
                    }
                    self.sys.nvic.changed = true;
                }
            }
            Special::Read { special, rd } => {
                let value = self.read_special(special);
                self.set(rd, value);
            }
            Special::Write { special, source, mask } => self.write_special(special, self.get(source), mask),
            Special::SupervisorCall => return Err(Trap::SupervisorCall),
            Special::Breakpoint => return Err(Trap::Fault(Fault::Breakpoint)),
            Special::Coprocessor => return Err(Trap::Fault(Fault::Coprocessor)),
        }
        Ok(())
    }

    /// FAULTMASK can only be set from a priority below -1 (B5.2.1).
    fn set_faultmask(&mut self, on: bool) {
        if !on || self.sys.nvic.execution_priority(self.sys.masks) > -1 {
            self.sys.masks.faultmask = on;
        }
    }

    /// Value of MRS. EPSR reads as 0; unprivileged, so does everything but APSR and CONTROL.
    pub(super) fn read_special(&self, special: u32) -> u32 {
        let registers = &self.registers;
        let privileged = self.is_privileged();
        match special {
            0..=7 => {
                let flags = if special & 4 == 0 { registers.psr.get() & APSR } else { 0 };
                let exception = if special & 1 == 1 && privileged { registers.psr.get() & IPSR } else { 0 };
                flags | exception
            }
            20 => registers.control().read(),
            _ if !privileged => 0,
            8 => registers.msp(),
            9 => registers.psp(),
            16 => u32::from(self.sys.masks.primask),
            17 | 18 => u32::from(self.sys.masks.basepri),
            19 => u32::from(self.sys.masks.faultmask),
            _ => 0,
        }
    }

    fn write_special(&mut self, special: u32, value: u32, mask: u32) {
        if special <= 3 {
            if mask & 2 != 0 {
                let psr = &mut self.registers.psr;
                psr.set(psr.get() & !APSR | value & APSR);
            }
            return;
        }
        if !self.is_privileged() {
            return;
        }
        let handler = self.in_handler();
        let registers = &mut self.registers;
        let masks = &mut self.sys.masks;
        match special {
            8 | 9 => registers.set_stack(special == 9, value),
            16 => masks.primask = value & 1 == 1,
            17 => masks.basepri = value as u8 & PRIORITY_BITS,
            18 => {
                let new = value as u8 & PRIORITY_BITS;
                if new != 0 && (new < masks.basepri || masks.basepri == 0) {
                    masks.basepri = new;
                }
            }
            19 => self.set_faultmask(value & 1 == 1),
            20 => {
                registers.set_unprivileged(value & 1 == 1);
                // Handler mode uses the main stack.
                if !handler {
                    registers.select_psp(value & 2 == 2);
                }
            }
            _ => {}
        }
        self.sys.nvic.changed = true;
    }
}
