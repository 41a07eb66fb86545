//! Instructions of 32 bits that are executed here (ARMv7-M A5.3).

use super::op::{
    Data, Decoding, Divide, Exclusive, Move, Multiple, Offset, Op, Pair, Second, Shift, Special, Transfer,
};
use super::registers::Reg;
use crate::chip::Size;

pub fn wide(code: u32) -> Decoding {
    match code >> 25 & 15 {
        0b0100 if code >> 22 & 1 == 0 => multiple(code),
        0b0100 => pair_or_exclusive(code),
        0b0101 => shifted_register(code),
        0b1000..=0b1011 if code >> 15 & 1 == 1 => control(code),
        0b1100 => single(code),
        0b1101 if code >> 20 & 0x1F == 0b1_1001 && code >> 4 & 15 == 15 => divide(code, true),
        0b1101 if code >> 20 & 0x1F == 0b1_1011 && code >> 4 & 15 == 15 => divide(code, false),
        0b1101 if code >> 23 & 3 == 0 && code >> 4 & 15 == 0 => shift_by_register(code),
        // The chip has no coprocessor.
        0b0110 | 0b0111 | 0b1110 | 0b1111 => Decoding::Op(Op::Special(Special::Coprocessor)),
        _ => Decoding::Engine,
    }
}

/// Load and store multiple (A5.3.5).
fn multiple(code: u32) -> Decoding {
    let down = match code >> 23 & 3 {
        1 => false,
        2 => true,
        _ => return Decoding::Undefined,
    };
    let (load, wback) = (code >> 20 & 1 == 1, code >> 21 & 1 == 1);
    Decoding::Op(Op::Multiple(Multiple { load, rn: Reg::new(code >> 16), list: code as u16, wback, down }))
}

/// Load and store dual or exclusive, table branch (A5.3.6).
fn pair_or_exclusive(code: u32) -> Decoding {
    let (index, up, wback) = (code >> 24 & 1 == 1, code >> 23 & 1 == 1, code >> 21 & 1 == 1);
    let load = code >> 20 & 1 == 1;
    let (rn, rt, second, rm) =
        (Reg::new(code >> 16), Reg::new(code >> 12), Reg::new(code >> 8), Reg::new(code));
    let offset = (code & 0xFF) * 4;
    if index || wback {
        let offset = if up { offset } else { offset.wrapping_neg() };
        return Decoding::Op(Op::Pair(Pair { load, rt, second, rn, offset, index, wback }));
    }
    if !up {
        return Decoding::Op(Op::Exclusive(Exclusive { load, size: Size::Word, rt, rn, rd: second, offset }));
    }
    let narrow = |size| Decoding::Op(Op::Exclusive(Exclusive { load, size, rt, rn, rd: rm, offset: 0 }));
    match code >> 4 & 15 {
        0 if load => Decoding::Op(Op::Table { base: rn, index: rm, size: Size::Byte }),
        1 if load => Decoding::Op(Op::Table { base: rn, index: rm, size: Size::Half }),
        4 => narrow(Size::Byte),
        5 => narrow(Size::Half),
        _ => Decoding::Undefined,
    }
}

/// Data processing with a shifted register (A5.3.11).
fn shifted_register(code: u32) -> Decoding {
    let (shift, n) = Shift::from_bits(code >> 4, code >> 10 & 0x1C | code >> 6 & 3);
    let (rd, rn) = (code >> 8 & 15, code >> 16 & 15);
    let flags = code >> 20 & 1 == 1;
    match Data::operation(code >> 21, rn) {
        Some(op) => {
            let rd = (!op.only_tests(rd, flags)).then(|| Reg::new(rd));
            Decoding::Op(Op::Data(Data {
                op,
                rd,
                rn: Reg::new(rn),
                second: Second::Shifted(Reg::new(code), shift, n),
                flags,
            }))
        }
        None => Decoding::Undefined,
    }
}

/// Shifts by a register (A5.3.12).
fn shift_by_register(code: u32) -> Decoding {
    if code >> 12 & 15 != 15 {
        return Decoding::Undefined;
    }
    let shift = [Shift::Lsl, Shift::Lsr, Shift::Asr, Shift::Ror][(code >> 21 & 3) as usize];
    let (rd, rm, by) = (Reg::new(code >> 8), Reg::new(code >> 16), Ok(Reg::new(code)));
    Decoding::Op(Op::Move(Move { rd, rm, shift, by, flags: code >> 20 & 1 == 1 }))
}

fn divide(code: u32, signed: bool) -> Decoding {
    Decoding::Op(Op::Divide(Divide {
        rd: Reg::new(code >> 8),
        rn: Reg::new(code >> 16),
        rm: Reg::new(code),
        signed,
    }))
}

/// Load and store of one register, memory hints (A5.3.7 to A5.3.10).
fn single(code: u32) -> Decoding {
    let size = match code >> 21 & 3 {
        0 => Size::Byte,
        1 => Size::Half,
        2 => Size::Word,
        _ => return Decoding::Undefined,
    };
    let (load, signed) = (code >> 20 & 1 == 1, code >> 24 & 1 == 1);
    let (rn, rt) = (code >> 16 & 15, code >> 12 & 15);
    if (signed && (!load || size == Size::Word)) || (!load && rn == 15) {
        return Decoding::Undefined;
    }
    let up = code >> 23 & 1 == 1;
    let signed_by = |up: bool, offset: u32| if up { offset } else { offset.wrapping_neg() };
    let plain = Transfer { signed, ..Transfer::plain(load, size, Reg::new(rt), Reg::new(rn), code & 0xFFF) };
    let transfer = if rn == 15 {
        Transfer { offset: Offset::Immediate(signed_by(up, code & 0xFFF)), ..plain }
    } else if up {
        plain
    } else if code >> 11 & 1 == 1 {
        let (index, up, wback) = (code >> 10 & 1 == 1, code >> 9 & 1 == 1, code >> 8 & 1 == 1);
        if !index && !wback {
            return Decoding::Undefined;
        }
        let offset = Offset::Immediate(signed_by(up, code & 0xFF));
        Transfer { offset, index, wback, unprivileged: index && up && !wback, ..plain }
    } else if code >> 6 & 31 == 0 {
        Transfer { offset: Offset::Register(Reg::new(code), code >> 4 & 3), ..plain }
    } else {
        return Decoding::Undefined;
    };
    if load && rt == 15 && size != Size::Word {
        // PLD, PLI and reserved memory hints.
        return Decoding::Op(Op::Special(Special::Nothing));
    }
    Decoding::Op(Op::Transfer(transfer))
}

/// Control instructions (A5.3.4) except branches, which `armagnac` decodes.
fn control(code: u32) -> Decoding {
    if code >> 12 & 0b101 != 0 {
        return Decoding::Engine;
    }
    Decoding::Op(Op::Special(match code >> 20 & 0x7F {
        0b011_1000 | 0b011_1001 => {
            Special::Write { special: code & 0xFF, source: Reg::new(code >> 16), mask: code >> 10 & 3 }
        }
        0b011_1010 if code >> 8 & 7 == 0 => match code & 0xFF {
            hint @ 0..=15 => Special::hint(hint),
            _ => Special::Nothing,
        },
        0b011_1011 => match code >> 4 & 15 {
            2 => Special::ClearExclusive,
            4..=6 => Special::Nothing,
            _ => return Decoding::Undefined,
        },
        0b011_1110 | 0b011_1111 => Special::Read { special: code & 0xFF, rd: Reg::new(code >> 8) },
        0b111_1111 => return Decoding::Undefined,
        op if op & 0b011_1000 != 0b011_1000 => return Decoding::Engine,
        _ => return Decoding::Undefined,
    }))
}
