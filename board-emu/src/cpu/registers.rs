//! Core registers (ARMv7-M B1.4), as an array for access by number.

use armagnac::registers::{ControlRegister, CoreRegisters, ProgramStatusRegister};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reg(u8);

impl Reg {
    pub const SP: Self = Self(13);
    pub const LR: Self = Self(14);
    pub const PC: Self = Self(15);

    /// By the lowest four bits of `index`.
    pub const fn new(index: u32) -> Self {
        Self((index & 15) as u8)
    }

    pub const fn is_pc(self) -> bool {
        self.0 == Self::PC.0
    }
}

#[derive(Clone, Debug)]
pub struct Registers {
    /// R0 to R15, with the stack pointer in use.
    all: [u32; 16],
    other_sp: u32,
    pub psr: ProgramStatusRegister,
    control: ControlRegister,
}

impl Registers {
    /// Reset state, except for the values of the vector table.
    pub fn new() -> Self {
        let (psr, control) = (ProgramStatusRegister::new(), ControlRegister::new());
        Self { all: [0; 16], other_sp: 0, psr, control }
    }

    #[inline]
    pub const fn get(&self, reg: Reg) -> u32 {
        self.all[(reg.0 & 15) as usize]
    }

    /// The two lowest bits of a stack pointer are 0 (ARMv7-M B1.4.1).
    #[inline]
    pub fn set(&mut self, reg: Reg, value: u32) {
        self.all[usize::from(reg.0 & 15)] = if reg == Reg::SP { value & !3 } else { value };
    }

    #[inline]
    pub const fn pc(&self) -> u32 {
        self.get(Reg::PC)
    }

    #[inline]
    pub fn set_pc(&mut self, value: u32) {
        self.set(Reg::PC, value);
    }

    pub const fn control(&self) -> &ControlRegister {
        &self.control
    }

    /// CONTROL.nPRIV.
    pub fn set_unprivileged(&mut self, on: bool) {
        self.control.set_privileged_bit(on);
    }

    /// Selects the process stack pointer (CONTROL.SPSEL).
    pub fn select_psp(&mut self, on: bool) {
        if self.control.spsel() != on {
            self.control.set_spsel(on);
            std::mem::swap(&mut self.all[13], &mut self.other_sp);
        }
    }

    #[inline]
    pub fn msp(&self) -> u32 {
        if self.control.spsel() { self.other_sp } else { self.get(Reg::SP) }
    }

    pub fn psp(&self) -> u32 {
        if self.control.spsel() { self.get(Reg::SP) } else { self.other_sp }
    }

    /// Sets the process stack pointer (`process`) or the main one.
    pub fn set_stack(&mut self, process: bool, value: u32) {
        if self.control.spsel() == process {
            self.set(Reg::SP, value);
        } else {
            self.other_sp = value & !3;
        }
    }

    /// Copies the registers to the engine, which has one stack pointer.
    pub fn copy_to(&self, to: &mut CoreRegisters) {
        let [r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11, r12, msp, lr, pc] = self.all;
        let psr = self.psr;
        *to =
            CoreRegisters { r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11, r12, msp, lr, pc, psr, ..*to };
    }

    pub fn copy_from(&mut self, from: &CoreRegisters) {
        let CoreRegisters { r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11, r12, msp, lr, pc, psr, .. } =
            *from;
        self.all = [r0, r1, r2, r3, r4, r5, r6, r7, r8, r9, r10, r11, r12, msp & !3, lr, pc];
        self.psr = psr;
    }
}
