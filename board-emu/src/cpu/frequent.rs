//! Frequent instructions that `armagnac` executes correctly but slowly: data processing with immediates and
//! low registers, branches, IT. `armagnac` has decoded them before, so that undefined ones are rejected, and
//! provides their conditions.

use super::op::{Data, Extend, Op, Operation, Place, Second, Shift};
use super::registers::Reg;

pub fn frequent(code: u32, place: Place) -> Option<Op> {
    if code >> 16 == 0 { narrow(code, place == Place::Outside) } else { wide(code) }
}

fn data(op: Operation, rd: Option<Reg>, rn: Reg, second: Second, flags: bool) -> Option<Op> {
    Some(Op::Data(Data { op, rd, rn, second, flags }))
}

const fn register(rm: u32) -> Second {
    Second::Shifted(Reg::new(rm), Shift::Lsl, 0)
}

const fn number(value: u32) -> Second {
    Second::Number(value, None)
}

/// The lowest bits of an instruction as a signed offset in half-words.
const fn halves(code: u32, bits: u32) -> u32 {
    ((code << (32 - bits)) as i32 >> (31 - bits)) as u32
}

/// Instructions of 16 bits (ARMv7-M A5.2); `flags` applies to those that set flags outside IT blocks.
fn narrow(code: u32, flags: bool) -> Option<Op> {
    use Operation::{Add, Mov, Sub};
    let (low, middle) = (Reg::new(code & 7), Reg::new(code >> 3 & 7));
    let (high, imm8) = (Reg::new(code >> 8 & 7), number(code & 0xFF));
    let sp = Reg::SP;
    match code >> 9 {
        0b000_1100 => data(Add, Some(low), middle, register(code >> 6 & 7), flags),
        0b000_1101 => data(Sub, Some(low), middle, register(code >> 6 & 7), flags),
        0b000_1110 => data(Add, Some(low), middle, number(code >> 6 & 7), flags),
        0b000_1111 => data(Sub, Some(low), middle, number(code >> 6 & 7), flags),
        0b001_0000..=0b001_0011 => data(Mov, Some(high), high, imm8, flags),
        0b001_0100..=0b001_0111 => data(Sub, None, high, imm8, true),
        0b001_1000..=0b001_1011 => data(Add, Some(high), high, imm8, flags),
        0b001_1100..=0b001_1111 => data(Sub, Some(high), high, imm8, flags),
        0b010_0000 | 0b010_0001 => low_registers(code, flags),
        0b010_0010 | 0b010_0011 => high_registers(code),
        0b101_0100..=0b101_0111 => data(Add, Some(high), sp, number((code & 0xFF) * 4), false),
        0b101_1000 if code >> 8 & 1 == 0 => {
            let op = if code >> 7 & 1 == 0 { Add } else { Sub };
            data(op, Some(sp), sp, number((code & 0x7F) * 4), false)
        }
        0b101_1001 if code >> 8 & 1 == 0 => {
            let (byte, unsigned) = (code >> 6 & 1 == 1, code >> 7 & 1 == 1);
            Some(Op::Extend(Extend { rd: low, rm: middle, byte, unsigned }))
        }
        0b101_1000..=0b101_1111 if code >> 8 & 1 == 1 && code >> 10 & 1 == 0 => {
            let offset = code >> 3 & 0x40 | code >> 2 & 0x3E;
            Some(Op::CompareBranch { rn: low, zero: code >> 11 & 1 == 0, offset })
        }
        0b101_1111 if code >> 8 & 1 == 1 && code & 15 != 0 => Some(Op::IfThen(code as u8)),
        0b110_1000..=0b110_1110 => Some(Op::Branch { offset: halves(code, 8), link: false }),
        0b111_0000..=0b111_0011 => Some(Op::Branch { offset: halves(code, 11), link: false }),
        _ => None,
    }
}

/// Data processing (A5.2.2), except shifts and MUL.
fn low_registers(code: u32, flags: bool) -> Option<Op> {
    use Operation::{Adc, Add, And, Bic, Eor, Mvn, Orr, Rsb, Sbc, Sub};
    let (rd, rm) = (Reg::new(code & 7), Reg::new(code >> 3 & 7));
    let second = register(code >> 3 & 7);
    match code >> 6 & 15 {
        0 => data(And, Some(rd), rd, second, flags),
        1 => data(Eor, Some(rd), rd, second, flags),
        5 => data(Adc, Some(rd), rd, second, flags),
        6 => data(Sbc, Some(rd), rd, second, flags),
        8 => data(And, None, rd, second, true),
        9 => data(Rsb, Some(rd), rm, number(0), flags),
        10 => data(Sub, None, rd, second, true),
        11 => data(Add, None, rd, second, true),
        12 => data(Orr, Some(rd), rd, second, flags),
        14 => data(Bic, Some(rd), rd, second, flags),
        15 => data(Mvn, Some(rd), rd, second, flags),
        _ => None,
    }
}

/// Special data instructions (A5.2.3).
fn high_registers(code: u32) -> Option<Op> {
    let (rd, second) = (Reg::new(code & 7 | code >> 4 & 8), register(code >> 3 & 15));
    match code >> 8 & 3 {
        0 => data(Operation::Add, Some(rd), rd, second, false),
        1 => data(Operation::Sub, None, rd, second, true),
        2 => data(Operation::Mov, Some(rd), rd, second, false),
        _ => None,
    }
}

/// Instructions of 32 bits (ARMv7-M A5.3): immediates and branches.
fn wide(code: u32) -> Option<Op> {
    let (rd, rn) = (code >> 8 & 15, code >> 16 & 15);
    let imm12 = code >> 15 & 0x800 | code >> 4 & 0x700 | code & 0xFF;
    match (code >> 27, code >> 15 & 1, code >> 20 & 0x3F) {
        (0b11110, 0, 0..0x20) => {
            let (op, flags) = (Data::operation(code >> 21, rn)?, code >> 20 & 1 == 1);
            let rd = (!op.only_tests(rd, flags)).then(|| Reg::new(rd));
            data(op, rd, Reg::new(rn), expanded(imm12), flags)
        }
        (0b11110, 0, 0b10_0100) => {
            data(Operation::Mov, Some(Reg::new(rd)), Reg::new(rd), number(rn << 12 | imm12), false)
        }
        (0b11110, 0, 0b10_1100) => Some(Op::MoveTop(Reg::new(rd), (rn << 12 | imm12) as u16)),
        (0b11110, 1, _) => branch(code),
        _ => None,
    }
}

/// `ThumbExpandImm_C()` (A5.3.2).
const fn expanded(imm12: u32) -> Second {
    let byte = imm12 & 0xFF;
    match imm12 >> 8 {
        0 => number(byte),
        1 => number(byte * 0x0001_0001),
        2 => number(byte * 0x0100_0100),
        3 => number(byte * 0x0101_0101),
        _ => {
            let value = (0x80 | byte).rotate_right(imm12 >> 7);
            Second::Number(value, Some(value >> 31 == 1))
        }
    }
}

/// B and BL (A5.3.4).
const fn branch(code: u32) -> Option<Op> {
    let (s, j1, j2) = (code >> 26 & 1, code >> 13 & 1, code >> 11 & 1);
    let sign = 0u32.wrapping_sub(s);
    let offset = match (code >> 14 & 1, code >> 12 & 1) {
        (0, 0) => sign << 20 | j2 << 19 | j1 << 18 | (code >> 16 & 0x3F) << 12 | (code & 0x7FF) << 1,
        (_, 1) => {
            let (i1, i2) = (!(j1 ^ s) & 1, !(j2 ^ s) & 1);
            sign << 24 | i1 << 23 | i2 << 22 | (code >> 16 & 0x3FF) << 12 | (code & 0x7FF) << 1
        }
        _ => return None,
    };
    Some(Op::Branch { offset, link: code >> 14 & 1 == 1 })
}
