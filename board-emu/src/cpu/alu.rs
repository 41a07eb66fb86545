//! Shifts, data processing and division. `armagnac` 0.3 panics for ASR #32, for ROR by 32 and for division by
//! 0, and overflows for MIN / -1.

use super::fault::{Fault, Trap};
use super::op::{Data, Divide, Extend, Move, Operation, Second};
use super::state::Cpu;

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

    /// Division by 0 gives 0, or a fault with CCR.DIV_0_TRP.
    pub(super) fn divide(&mut self, divide: Divide) -> Result<(), Trap> {
        let Divide { rd, rn, rm, signed } = divide;
        let (x, y) = (self.get(rn), self.get(rm));
        if y == 0 && self.sys.control.traps_division() {
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
