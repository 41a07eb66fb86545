//! Decodes instructions: first those that are executed here, then those of `armagnac` (ARMv7-M A5).

use std::rc::Rc;

use armagnac::core::{ArmVersion, Condition, ItState};
use armagnac::decoder::{BasicInstructionDecoder, InstructionDecode};
use armagnac::instructions::{Instruction, InstructionSize};

use super::decode_narrow::narrow;
use super::decode_wide::wide;
use super::frequent::frequent;
use super::op::{Decoding, Op, Place};

/// Who executes an instruction: `armagnac` or this emulator.
#[derive(Clone)]
pub enum By {
    Engine(Rc<dyn Instruction>),
    Us(Op),
}

#[derive(Clone)]
pub struct Decoded {
    /// Its bits; a narrow one in the lower 16.
    pub code: u32,
    pub place: Place,
    /// Its own condition, which may differ from that of an IT block.
    pub condition: Option<Condition>,
    pub by: By,
}

/// Whether a first half-word begins a wide instruction (ARMv7-M A5.1).
pub const fn is_wide(first: u32) -> bool {
    first >> 11 & 0x1F >= 0b11101
}

const SLOTS: usize = tater_f103::map::FLASH.len as usize / 2;

/// Decoder with a cache of the flash's instructions.
#[derive(Clone)]
pub struct Decoder {
    engine: Rc<BasicInstructionDecoder>,
    /// By half-word of the flash.
    kept: Vec<Option<Decoded>>,
}

impl Decoder {
    pub fn new() -> Self {
        let engine = Rc::new(BasicInstructionDecoder::new(ArmVersion::V7M));
        Self { engine, kept: vec![None; SLOTS] }
    }

    /// `None` if the instruction is undefined.
    pub fn decode(&mut self, address: u32, code: u32, place: Place) -> Option<&Decoded> {
        // The flash appears at two addresses with equal lower bits; the compared code rules out mistakes.
        let slot = (address >> 1) as usize % SLOTS;
        let is_it = |kept: &Decoded| kept.code == code && kept.place == place;
        if !self.kept.get(slot)?.as_ref().is_some_and(is_it) {
            let decoded = self.fresh(code, place)?;
            *self.kept.get_mut(slot)? = Some(decoded);
        }
        self.kept.get(slot)?.as_ref()
    }

    fn fresh(&self, code: u32, place: Place) -> Option<Decoded> {
        let own = if code >> 16 == 0 { narrow(code, place) } else { wide(code) };
        match own {
            Decoding::Op(op) => Some(Decoded { code, place, condition: None, by: By::Us(op) }),
            Decoding::Undefined => None,
            Decoding::Engine => {
                let it = ItState(match place {
                    Place::Outside => 0,
                    Place::Inside => 0b0000_0100,
                    Place::Last => 0b0000_1000,
                });
                let size = if code >> 16 == 0 { InstructionSize::Ins16 } else { InstructionSize::Ins32 };
                let instruction = self.engine.try_decode(code, size, it).ok()?;
                let condition = instruction.condition();
                // `armagnac` has rejected undefined instructions.
                let by = frequent(code, place).map_or(By::Engine(instruction), By::Us);
                Some(Decoded { code, place, condition, by })
            }
        }
    }
}
