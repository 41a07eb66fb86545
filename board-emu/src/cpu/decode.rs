//! From bits to instructions: those that are supplied here, then those of `armagnac` (ARMv7-M A5).

use std::rc::Rc;

use armagnac::core::{ArmVersion, Condition, ItState};
use armagnac::decoder::{BasicInstructionDecoder, InstructionDecode};
use armagnac::instructions::{Instruction, InstructionSize};

use super::alu::{Data, Divide, Extend, Move, Shift};
use super::frequent::frequent;
use super::memory::{Exclusive, Multiple, Offset, Pair, Transfer};
use super::registers::Reg;
use super::special::Special;
use crate::chip::Size;

/// Who does what an instruction does.
#[derive(Clone)]
pub enum By {
    /// `armagnac`.
    Engine(Rc<dyn Instruction>),
    /// We.
    Us(Op),
}

/// What an instruction does that is supplied here: `armagnac` lacks it, has it wrong, or is slow at what every program is full of.
#[derive(Clone, Copy)]
pub enum Op {
    /// Load or store of one register.
    Transfer(Transfer),
    /// LDRD, STRD.
    Pair(Pair),
    /// LDM, STM, PUSH, POP.
    Multiple(Multiple),
    /// LDREX, STREX and their narrow forms.
    Exclusive(Exclusive),
    /// TBB, TBH.
    Table {
        /// Of the table.
        base: Reg,
        /// Into it.
        index: Reg,
        /// Of an entry.
        size: Size,
    },
    /// BX, BLX.
    Exchange {
        /// Where to.
        target: Reg,
        /// Whether it calls.
        link: bool,
    },
    /// MOV to PC (`add` is false), ADD to PC: branches without exchange (ARMv7-M A2.3.1).
    ToPc {
        /// Source.
        source: Reg,
        /// Whether the source is added to PC.
        add: bool,
    },
    /// Data processing.
    Data(Data),
    /// A shift by itself.
    Move(Move),
    /// SDIV, UDIV.
    Divide(Divide),
    /// MOVT.
    MoveTop(Reg, u16),
    /// SXTH, SXTB, UXTH, UXTB.
    Extend(Extend),
    /// B, BL.
    Branch {
        /// From what PC reads as.
        offset: u32,
        /// Whether it calls.
        link: bool,
    },
    /// CBZ, CBNZ.
    CompareBranch {
        /// What is compared with 0.
        rn: Reg,
        /// Whether it branches for 0, or for all else.
        zero: bool,
        /// From what PC reads as.
        offset: u32,
    },
    /// IT, with the state that it sets.
    IfThen(u8),
    /// What has to do with special registers, sleep and exceptions.
    Special(Special),
}

/// An instruction as it is kept.
#[derive(Clone)]
pub struct Decoded {
    /// Its bits; a narrow one in the lower 16.
    pub code: u32,
    /// Where in an IT block it was decoded for.
    pub place: Place,
    /// Its own condition, beside that of an IT block.
    pub condition: Option<Condition>,
    /// What it does.
    pub by: By,
}

/// Where in an IT block an instruction is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// In none.
    Outside,
    /// In one, not the last.
    Inside,
    /// The last of one.
    Last,
}

/// Whether the first half-word is that of a wide instruction (ARMv7-M A5.1).
pub const fn is_wide(first: u32) -> bool {
    first >> 11 & 0x1F >= 0b11101
}

pub(super) const fn reg(index: u32) -> Reg {
    Reg::new(index)
}

/// Half-words of the flash.
const SLOTS: usize = tater_wire::memory::FLASH.len as usize / 2;

/// Decodes, and keeps what it has decoded from the flash.
#[derive(Clone)]
pub struct Decoder {
    engine: Rc<BasicInstructionDecoder>,
    /// By half-word of the flash.
    kept: Vec<Option<Decoded>>,
}

impl Decoder {
    /// Knows nothing yet.
    pub fn new() -> Self {
        let engine = Rc::new(BasicInstructionDecoder::new(ArmVersion::V7M));
        Self { engine, kept: vec![None; SLOTS] }
    }

    /// The instruction with these bits, at an address; `None` if it is undefined.
    pub fn decode(&mut self, address: u32, code: u32, place: Place) -> Option<&Decoded> {
        // The flash's two places are one: the upper bits do not matter, because the code is compared.
        let slot = (address >> 1) as usize % SLOTS;
        let is_it = |kept: &Decoded| kept.code == code && kept.place == place;
        if !self.kept.get(slot)?.as_ref().is_some_and(is_it) {
            let decoded = self.fresh(code, place)?;
            *self.kept.get_mut(slot)? = Some(decoded);
        }
        self.kept.get(slot)?.as_ref()
    }

    fn fresh(&self, code: u32, place: Place) -> Option<Decoded> {
        let own = if code >> 16 == 0 { narrow(code, place) } else { super::decode_wide::wide(code) };
        match own {
            Own::Is(op) => Some(Decoded { code, place, condition: None, by: By::Us(op) }),
            Own::Undefined => None,
            Own::Other => {
                let it = ItState(match place {
                    Place::Outside => 0,
                    Place::Inside => 0b0000_0100,
                    Place::Last => 0b0000_1000,
                });
                let size = if code >> 16 == 0 { InstructionSize::Ins16 } else { InstructionSize::Ins32 };
                let instruction = self.engine.try_decode(code, size, it).ok()?;
                let condition = instruction.condition();
                // What it refuses is refused.
                let by = frequent(code, place).map_or(By::Engine(instruction), By::Us);
                Some(Decoded { code, place, condition, by })
            }
        }
    }
}

/// Whether an instruction is supplied here.
pub enum Own {
    /// It is.
    Is(Op),
    /// No Cortex-M3 knows it.
    Undefined,
    /// It is not.
    Other,
}

/// Instructions of 16 bits (ARMv7-M A5.2).
fn narrow(code: u32, place: Place) -> Own {
    let (low, middle) = (reg(code & 7), reg(code >> 3 & 7));
    let flags = place == Place::Outside;
    let imm5 = code >> 6 & 31;
    Own::Is(match code >> 10 {
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
                _ => return Own::Other,
            };
            Op::Move(Move { rd: low, rm: low, shift, by: Ok(middle), flags })
        }
        0b01_0001 => return high_registers(code),
        0b01_0010 | 0b01_0011 => {
            Op::Transfer(Transfer::plain(true, Size::Word, reg(code >> 8 & 7), reg(15), (code & 0xFF) * 4))
        }
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
            let offset = Offset::Register(reg(code >> 6 & 7), 0);
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
            let (load, rt) = (code >> 11 & 1 == 1, reg(code >> 8 & 7));
            Op::Transfer(Transfer::plain(load, Size::Word, rt, reg(13), (code & 0xFF) * 4))
        }
        0b10_1100..=0b10_1111 => return miscellaneous(code),
        0b11_0000..=0b11_0011 => {
            let (rn, list, load) = (code >> 8 & 7, code & 0xFF, code >> 11 & 1 == 1);
            let wback = !load || list >> rn & 1 == 0;
            Op::Multiple(Multiple { load, rn: reg(rn), list: list as u16, wback, down: false })
        }
        0b11_0100..=0b11_0111 if code >> 8 & 15 == 14 => return Own::Undefined,
        0b11_0100..=0b11_0111 if code >> 8 & 15 == 15 => Op::Special(Special::SupervisorCall),
        _ => return Own::Other,
    })
}

/// Special data instructions and exchange (ARMv7-M A5.2.3).
fn high_registers(code: u32) -> Own {
    let (rd, rm) = (code & 7 | code >> 4 & 8, reg(code >> 3));
    match (code >> 8 & 3, rd) {
        (0, 15) => Own::Is(Op::ToPc { source: rm, add: true }),
        (2, 15) => Own::Is(Op::ToPc { source: rm, add: false }),
        (3, _) => Own::Is(Op::Exchange { target: rm, link: code >> 7 & 1 == 1 }),
        _ => Own::Other,
    }
}

/// Miscellaneous instructions of 16 bits (ARMv7-M A5.2.5).
fn miscellaneous(code: u32) -> Own {
    let sp = reg(13);
    Own::Is(match code >> 8 & 15 {
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
        _ => return Own::Other,
    })
}
