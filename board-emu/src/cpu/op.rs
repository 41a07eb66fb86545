//! Operations: decoded instructions that are executed here.

use super::registers::Reg;
use crate::chip::Size;

/// An instruction that is executed here, because `armagnac` lacks it, executes it wrongly, or is slow at a
/// frequent one.
#[derive(Clone, Copy)]
pub enum Op {
    Transfer(Transfer),
    Pair(Pair),
    Multiple(Multiple),
    Exclusive(Exclusive),
    /// TBB, TBH.
    Table {
        base: Reg,
        index: Reg,
        size: Size,
    },
    /// BX, BLX.
    Exchange {
        target: Reg,
        link: bool,
    },
    /// MOV to PC (`add` is false), ADD to PC: branches without exchange (ARMv7-M A2.3.1).
    ToPc {
        source: Reg,
        add: bool,
    },
    Data(Data),
    Move(Move),
    Divide(Divide),
    /// MOVT.
    MoveTop(Reg, u16),
    Extend(Extend),
    /// B, BL.
    Branch {
        /// Relative to PC as read.
        offset: u32,
        link: bool,
    },
    /// CBZ, CBNZ.
    CompareBranch {
        rn: Reg,
        zero: bool,
        offset: u32,
    },
    /// IT, with the new state.
    IfThen(u8),
    Special(Special),
}

/// Place of an instruction relative to IT blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    Outside,
    /// Inside one, not last.
    Inside,
    Last,
}

pub enum Decoding {
    Op(Op),
    Undefined,
    /// One that `armagnac` decodes.
    Engine,
}

/// Shift types (ARMv7-M A7.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shift {
    Lsl,
    Lsr,
    Asr,
    Ror,
    /// Rotate right by one through carry.
    Rrx,
}

impl Shift {
    /// `DecodeImmShift()`: type and count.
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Also TST.
    And,
    Bic,
    Orr,
    Mov,
    Orn,
    Mvn,
    /// Also TEQ.
    Eor,
    /// Also CMN.
    Add,
    Adc,
    Sbc,
    /// Also CMP.
    Sub,
    Rsb,
}

impl Operation {
    /// Whether only flags are written: TST, TEQ, CMN, CMP.
    pub const fn only_tests(self, rd: u32, flags: bool) -> bool {
        flags && rd == 15 && matches!(self, Self::And | Self::Eor | Self::Add | Self::Sub)
    }
}

#[derive(Clone, Copy, Debug)]
pub enum Second {
    Shifted(Reg, Shift, u32),
    /// A constant, with the carry that it sets, if any.
    Number(u32, Option<bool>),
}

/// Data processing (ARMv7-M A5.2.1, A5.2.2, A5.3.1, A5.3.11).
#[derive(Clone, Copy, Debug)]
pub struct Data {
    pub op: Operation,
    /// Destination; `None` for a test.
    pub rd: Option<Reg>,
    pub rn: Reg,
    pub second: Second,
    pub flags: bool,
}

impl Data {
    /// `None` if undefined.
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

/// A shift instruction.
#[derive(Clone, Copy, Debug)]
pub struct Move {
    pub rd: Reg,
    pub rm: Reg,
    pub shift: Shift,
    /// By the lowest byte of a register, or by a constant.
    pub by: Result<Reg, u32>,
    pub flags: bool,
}

/// SDIV, UDIV.
#[derive(Clone, Copy, Debug)]
pub struct Divide {
    pub rd: Reg,
    /// Dividend.
    pub rn: Reg,
    /// Divisor.
    pub rm: Reg,
    pub signed: bool,
}

/// SXTH, SXTB, UXTH, UXTB, without rotation.
#[derive(Clone, Copy, Debug)]
pub struct Extend {
    pub rd: Reg,
    pub rm: Reg,
    /// Byte, otherwise half-word.
    pub byte: bool,
    pub unsigned: bool,
}

#[derive(Clone, Copy, Debug)]
pub enum Offset {
    /// Constant, in two's complement.
    Immediate(u32),
    /// A register, shifted left.
    Register(Reg, u32),
}

/// Load or store of one register.
#[derive(Clone, Copy, Debug)]
pub struct Transfer {
    pub load: bool,
    pub size: Size,
    pub signed: bool,
    pub rt: Reg,
    /// Base; PC is aligned first.
    pub rn: Reg,
    pub offset: Offset,
    /// The access uses base plus offset.
    pub index: bool,
    /// Write-back of base plus offset.
    pub wback: bool,
    /// LDRT and the like: unprivileged access.
    pub unprivileged: bool,
}

impl Transfer {
    /// A positive constant offset, no write-back.
    pub const fn plain(load: bool, size: Size, rt: Reg, rn: Reg, offset: u32) -> Self {
        let offset = Offset::Immediate(offset);
        Self { load, size, signed: false, rt, rn, offset, index: true, wback: false, unprivileged: false }
    }
}

/// LDRD, STRD.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    pub load: bool,
    pub rt: Reg,
    /// Data register at the next word.
    pub second: Reg,
    /// Base; PC is aligned first.
    pub rn: Reg,
    pub offset: u32,
    pub index: bool,
    pub wback: bool,
}

/// LDM, STM, PUSH, POP.
#[derive(Clone, Copy, Debug)]
pub struct Multiple {
    pub load: bool,
    pub rn: Reg,
    pub list: u16,
    pub wback: bool,
    /// The words are below the base.
    pub down: bool,
}

/// LDREX, STREX and their narrow forms.
#[derive(Clone, Copy, Debug)]
pub struct Exclusive {
    pub load: bool,
    pub size: Size,
    pub rt: Reg,
    pub rn: Reg,
    /// Result of a store: 0 success, 1 failure.
    pub rd: Reg,
    pub offset: u32,
}

/// Special registers, sleep, and instructions that request exceptions (ARMv7-M B1.4, B5.2).
#[derive(Clone, Copy, Debug)]
pub enum Special {
    /// NOP, barriers, and hints without effect.
    Nothing,
    WaitForInterrupt,
    WaitForEvent,
    SendEvent,
    ClearExclusive,
    /// CPS.
    ChangeState {
        disable: bool,
        primask: bool,
        faultmask: bool,
    },
    /// MRS.
    Read {
        /// SYSm.
        special: u32,
        rd: Reg,
    },
    /// MSR.
    Write {
        special: u32,
        source: Reg,
        /// Mask; bit 1 writes the flags.
        mask: u32,
    },
    SupervisorCall,
    Breakpoint,
    Coprocessor,
}

impl Special {
    pub const fn hint(number: u32) -> Self {
        match number {
            2 => Self::WaitForEvent,
            3 => Self::WaitForInterrupt,
            4 => Self::SendEvent,
            _ => Self::Nothing,
        }
    }
}
