//! Shifts, data processing, and division: `armagnac` 0.3 panics for ASR #32, for ROR by 32, for SDIV and UDIV by 0, and
//! overflows for MIN / -1.

use super::Cpu;
use super::fault::{Fault, Trap};
use super::registers::Reg;

/// Kinds of shift (ARMv7-M A7.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shift {
    /// Left.
    Lsl,
    /// Right, zeros come in.
    Lsr,
    /// Right, signs come in.
    Asr,
    /// Right, what goes out comes in.
    Ror,
    /// Right by one, the carry comes in.
    Rrx,
}

impl Shift {
    /// `DecodeImmShift()`: kind and count.
    pub const fn from_bits(kind: u32, count: u32) -> (Self, u32) {
        match (kind & 3, count) {
            (0, n) => (Self::Lsl, n),
            (1, 0) => (Self::Lsr, 32),
            (1, n) => (Self::Lsr, n),
            (2, 0) => (Self::Asr, 32),
            (2, n) => (Self::Asr, n),
            (_, 0) => (Self::Rrx, 1),
            (_, n) => (Self::Ror, n),
        }
    }

    /// `Shift_C()`: result and carry.
    pub const fn apply(self, value: u32, n: u32, carry: bool) -> (u32, bool) {
        if n == 0 {
            return (value, carry);
        }
        let top = value >> 31 == 1;
        match (self, n) {
            (Self::Lsl, 1..=31) => (value << n, value >> (32 - n) & 1 == 1),
            (Self::Lsl, 32) => (0, value & 1 == 1),
            (Self::Lsr, 1..=31) => (value >> n, value >> (n - 1) & 1 == 1),
            (Self::Lsr, 32) => (0, top),
            (Self::Lsl | Self::Lsr, _) => (0, false),
            (Self::Asr, 1..=31) => ((value as i32 >> n) as u32, value >> (n - 1) & 1 == 1),
            (Self::Asr, _) => ((value as i32 >> 31) as u32, top),
            (Self::Ror, _) => {
                let result = value.rotate_right(n % 32);
                (result, result >> 31 == 1)
            }
            (Self::Rrx, _) => (value >> 1 | (carry as u32) << 31, value & 1 == 1),
        }
    }
}

/// Operations of data processing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Also TST.
    And,
    /// Bit clear.
    Bic,
    /// Inclusive or.
    Orr,
    /// The second operand alone.
    Mov,
    /// Or with the complement.
    Orn,
    /// The complement alone.
    Mvn,
    /// Also TEQ.
    Eor,
    /// Also CMN.
    Add,
    /// With carry.
    Adc,
    /// With borrow.
    Sbc,
    /// Also CMP.
    Sub,
    /// The other way round.
    Rsb,
}

impl Operation {
    /// Whether the result goes nowhere: TST, TEQ, CMN, CMP.
    pub const fn only_tests(self, rd: u32, flags: bool) -> bool {
        flags && rd == 15 && matches!(self, Self::And | Self::Eor | Self::Add | Self::Sub)
    }
}

/// The second operand.
#[derive(Clone, Copy, Debug)]
pub enum Second {
    /// A register, shifted by a number.
    Shifted(Reg, Shift, u32),
    /// A number, and the carry that it makes, if it makes one.
    Number(u32, Option<bool>),
}

/// Data processing (ARMv7-M A5.2.1, A5.2.2, A5.3.1, A5.3.11).
#[derive(Clone, Copy, Debug)]
pub struct Data {
    /// What.
    pub op: Operation,
    /// Where the result goes.
    pub rd: Option<Reg>,
    /// First operand.
    pub rn: Reg,
    /// Second operand.
    pub second: Second,
    /// Whether flags are set.
    pub flags: bool,
}

impl Data {
    /// The operation; `None` if undefined.
    pub const fn operation(op: u32, rn: u32) -> Option<Operation> {
        Some(match op & 15 {
            0 => Operation::And,
            1 => Operation::Bic,
            2 if rn == 15 => Operation::Mov,
            2 => Operation::Orr,
            3 if rn == 15 => Operation::Mvn,
            3 => Operation::Orn,
            4 => Operation::Eor,
            8 => Operation::Add,
            10 => Operation::Adc,
            11 => Operation::Sbc,
            13 => Operation::Sub,
            14 => Operation::Rsb,
            _ => return None,
        })
    }
}

/// A shift by itself.
#[derive(Clone, Copy, Debug)]
pub struct Move {
    /// Where the result goes.
    pub rd: Reg,
    /// What is shifted.
    pub rm: Reg,
    /// How.
    pub shift: Shift,
    /// By a register's lowest byte, or by a number.
    pub by: Result<Reg, u32>,
    /// Whether flags are set.
    pub flags: bool,
}

/// SDIV, UDIV.
#[derive(Clone, Copy, Debug)]
pub struct Divide {
    /// Quotient.
    pub rd: Reg,
    /// Dividend.
    pub rn: Reg,
    /// Divisor.
    pub rm: Reg,
    /// SDIV.
    pub signed: bool,
}

/// SXTH, SXTB, UXTH, UXTB, without rotation.
#[derive(Clone, Copy, Debug)]
pub struct Extend {
    /// Where the result goes.
    pub rd: Reg,
    /// What is extended.
    pub rm: Reg,
    /// Its lowest byte, or half-word.
    pub byte: bool,
    /// By zeros.
    pub unsigned: bool,
}

/// `AddWithCarry()`: result, carry and overflow.
const fn add(x: u32, y: u32, carry: bool) -> (u32, bool, Option<bool>) {
    let sum = x as u64 + y as u64 + carry as u64;
    let result = sum as u32;
    (result, sum >> 32 == 1, Some((x ^ result) & (y ^ result) & 1 << 31 != 0))
}

impl Cpu {
    pub(super) fn data(&mut self, data: Data) {
        let Data { op, rd, rn, second, flags } = data;
        let old = self.registers.psr.c();
        let x = self.get(rn);
        let (y, carry) = match second {
            Second::Shifted(rm, shift, n) => shift.apply(self.get(rm), n, old),
            Second::Number(y, carry) => (y, carry.unwrap_or(old)),
        };
        let (result, carry, overflow) = match op {
            Operation::And => (x & y, carry, None),
            Operation::Bic => (x & !y, carry, None),
            Operation::Orr => (x | y, carry, None),
            Operation::Mov => (y, carry, None),
            Operation::Orn => (x | !y, carry, None),
            Operation::Mvn => (!y, carry, None),
            Operation::Eor => (x ^ y, carry, None),
            Operation::Add => add(x, y, false),
            Operation::Adc => add(x, y, old),
            Operation::Sbc => add(x, !y, old),
            Operation::Sub => add(x, !y, true),
            Operation::Rsb => add(!x, y, true),
        };
        if let Some(rd) = rd {
            self.set(rd, result);
        }
        if flags {
            self.flags(result, carry, overflow);
        }
    }

    pub(super) fn shift(&mut self, shift: Move) {
        let Move { rd, rm, shift, by, flags } = shift;
        let n = by.map_or_else(|n| n, |register| self.get(register) & 0xFF);
        let (result, carry) = shift.apply(self.get(rm), n, self.registers.psr.c());
        self.set(rd, result);
        if flags {
            self.flags(result, carry, None);
        }
    }

    pub(super) fn extend(&mut self, extend: Extend) {
        let Extend { rd, rm, byte, unsigned } = extend;
        let value = self.get(rm);
        let result = match (byte, unsigned) {
            (false, false) => i32::from(value as u16 as i16) as u32,
            (false, true) => value & 0xFFFF,
            (true, false) => i32::from(value as u8 as i8) as u32,
            (true, true) => value & 0xFF,
        };
        self.set(rd, result);
    }

    fn flags(&mut self, result: u32, carry: bool, overflow: Option<bool>) {
        let psr = &mut self.registers.psr;
        psr.set_nz(result).set_c(carry);
        if let Some(overflow) = overflow {
            psr.set_v(overflow);
        }
    }

    /// By zero: 0, or a fault if CCR.DIV_0_TRP says so.
    pub(super) fn divide(&mut self, divide: Divide) -> Result<(), Trap> {
        let Divide { rd, rn, rm, signed } = divide;
        let (x, y) = (self.get(rn), self.get(rm));
        if y == 0 && self.sys.traps_division() {
            return Err(Trap::Fault(Fault::DivideByZero));
        }
        let result = match (y, signed) {
            (0, _) => 0,
            (_, true) => (x as i32).wrapping_div(y as i32) as u32,
            (_, false) => x / y,
        };
        self.set(rd, result);
        Ok(())
    }
}
