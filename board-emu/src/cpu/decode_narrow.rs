//! Instructions of 16 bits that are executed here (ARMv7-M A5.2).

use super::op::{Decoding, Move, Multiple, Offset, Op, Place, Shift, Special, Transfer};
use super::registers::Reg;
use crate::chip::Size;

pub fn narrow(code: u32, place: Place) -> Decoding {
    let (low, middle) = (Reg::new(code & 7), Reg::new(code >> 3 & 7));
    let flags = place == Place::Outside;
    let imm5 = code >> 6 & 31;
    Decoding::Op(match code >> 10 {
        0b00_0000..=0b00_0101 => {
            let (shift, n) = Shift::from_bits(code >> 11, imm5);
            Op::Move(Move { rd: low, rm: middle, shift, by: Err(n), flags })
        }
        0b01_0000 => {
            let shift = match code >> 6 & 15 {
                2 => Shift::Lsl,
                3 => Shift::Lsr,
                4 => Shift::Asr,
                7 => Shift::Ror,
                _ => return Decoding::Engine,
            };
            Op::Move(Move { rd: low, rm: low, shift, by: Ok(middle), flags })
        }
        0b01_0001 => return high_registers(code),
        0b01_0010 | 0b01_0011 => Op::Transfer(Transfer::plain(
            true,
            Size::Word,
            Reg::new(code >> 8 & 7),
            Reg::new(15),
            (code & 0xFF) * 4,
        )),
        0b01_0100..=0b01_0111 => {
            let (load, size, signed) = match code >> 9 & 7 {
                0 => (false, Size::Word, false),
                1 => (false, Size::Half, false),
                2 => (false, Size::Byte, false),
                3 => (true, Size::Byte, true),
                4 => (true, Size::Word, false),
                5 => (true, Size::Half, false),
                6 => (true, Size::Byte, false),
                _ => (true, Size::Half, true),
            };
            let offset = Offset::Register(Reg::new(code >> 6 & 7), 0);
            Op::Transfer(Transfer { signed, offset, ..Transfer::plain(load, size, low, middle, 0) })
        }
        0b01_1000..=0b10_0011 => {
            let size = match code >> 12 {
                6 => Size::Word,
                7 => Size::Byte,
                _ => Size::Half,
            };
            Op::Transfer(Transfer::plain(code >> 11 & 1 == 1, size, low, middle, imm5 * size.bytes()))
        }
        0b10_0100..=0b10_0111 => {
            let (load, rt) = (code >> 11 & 1 == 1, Reg::new(code >> 8 & 7));
            Op::Transfer(Transfer::plain(load, Size::Word, rt, Reg::new(13), (code & 0xFF) * 4))
        }
        0b10_1100..=0b10_1111 => return miscellaneous(code),
        0b11_0000..=0b11_0011 => {
            let (rn, list, load) = (code >> 8 & 7, code & 0xFF, code >> 11 & 1 == 1);
            let wback = !load || list >> rn & 1 == 0;
            Op::Multiple(Multiple { load, rn: Reg::new(rn), list: list as u16, wback, down: false })
        }
        0b11_0100..=0b11_0111 if code >> 8 & 15 == 14 => return Decoding::Undefined,
        0b11_0100..=0b11_0111 if code >> 8 & 15 == 15 => Op::Special(Special::SupervisorCall),
        _ => return Decoding::Engine,
    })
}

/// Special data instructions and exchange (ARMv7-M A5.2.3).
fn high_registers(code: u32) -> Decoding {
    let (rd, rm) = (code & 7 | code >> 4 & 8, Reg::new(code >> 3));
    match (code >> 8 & 3, rd) {
        (0, 15) => Decoding::Op(Op::ToPc { source: rm, add: true }),
        (2, 15) => Decoding::Op(Op::ToPc { source: rm, add: false }),
        (3, _) => Decoding::Op(Op::Exchange { target: rm, link: code >> 7 & 1 == 1 }),
        _ => Decoding::Engine,
    }
}

/// Miscellaneous instructions of 16 bits (ARMv7-M A5.2.5).
fn miscellaneous(code: u32) -> Decoding {
    let sp = Reg::new(13);
    Decoding::Op(match code >> 8 & 15 {
        4 | 5 => {
            let list = (code & 0xFF | (code >> 8 & 1) << 14) as u16;
            Op::Multiple(Multiple { load: false, rn: sp, list, wback: true, down: true })
        }
        12 | 13 => {
            let list = (code & 0xFF | (code >> 8 & 1) << 15) as u16;
            Op::Multiple(Multiple { load: true, rn: sp, list, wback: true, down: false })
        }
        6 if code >> 5 & 7 == 3 => Op::Special(Special::ChangeState {
            disable: code >> 4 & 1 == 1,
            primask: code >> 1 & 1 == 1,
            faultmask: code & 1 == 1,
        }),
        14 => Op::Special(Special::Breakpoint),
        15 if code & 15 == 0 => Op::Special(Special::hint(code >> 4 & 15)),
        _ => return Decoding::Engine,
    })
}
