//! Operations: an instruction after decoding, as far as `armagnac` does not execute it.

use super::registers::Reg;
use crate::chip::Size;

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

/// What the bits of an instruction are to this emulator.
pub enum Decoding {
    /// An operation executed here.
    Op(Op),
    /// No Cortex-M3 knows it.
    Undefined,
    /// One that `armagnac` decodes.
    Engine,
}

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

/// What is added to a base.
#[derive(Clone, Copy, Debug)]
pub enum Offset {
    /// A number, which may be negative.
    Immediate(u32),
    /// A register, shifted left.
    Register(Reg, u32),
}

/// Load or store of one register.
#[derive(Clone, Copy, Debug)]
pub struct Transfer {
    /// Whether it loads.
    pub load: bool,
    /// Of what is transferred.
    pub size: Size,
    /// Whether what is loaded is extended by its sign.
    pub signed: bool,
    /// Loaded or stored.
    pub rt: Reg,
    /// Base; PC is aligned first.
    pub rn: Reg,
    /// Added to the base.
    pub offset: Offset,
    /// Whether the offset counts for this access.
    pub index: bool,
    /// Whether the base becomes base and offset.
    pub wback: bool,
    /// LDRT and the like: with the rights of unprivileged code.
    pub unprivileged: bool,
}

impl Transfer {
    /// With a positive offset, without write-back.
    pub const fn plain(load: bool, size: Size, rt: Reg, rn: Reg, offset: u32) -> Self {
        let offset = Offset::Immediate(offset);
        Self { load, size, signed: false, rt, rn, offset, index: true, wback: false, unprivileged: false }
    }
}

/// LDRD, STRD.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// Whether it loads.
    pub load: bool,
    /// At the address.
    pub rt: Reg,
    /// At the word after.
    pub second: Reg,
    /// Base; PC is aligned first.
    pub rn: Reg,
    /// Added to the base.
    pub offset: u32,
    /// Whether the offset counts for this access.
    pub index: bool,
    /// Whether the base becomes base and offset.
    pub wback: bool,
}

/// LDM, STM, PUSH, POP.
#[derive(Clone, Copy, Debug)]
pub struct Multiple {
    /// Whether it loads.
    pub load: bool,
    /// Base.
    pub rn: Reg,
    /// A bit a register.
    pub list: u16,
    /// Whether the base is changed.
    pub wback: bool,
    /// Whether the words are beneath the base.
    pub down: bool,
}

/// LDREX, STREX and their narrow forms.
#[derive(Clone, Copy, Debug)]
pub struct Exclusive {
    /// Whether it loads.
    pub load: bool,
    /// Of what is transferred.
    pub size: Size,
    /// Loaded or stored.
    pub rt: Reg,
    /// Base.
    pub rn: Reg,
    /// Of a store: 0 if it happened, 1 if not.
    pub rd: Reg,
    /// Added to the base.
    pub offset: u32,
}

/// Special registers, sleep, and instructions that ask for exceptions (ARMv7-M B1.4, B5.2).
#[derive(Clone, Copy, Debug)]
pub enum Special {
    /// NOP, barriers, hints that mean nothing here.
    Nothing,
    /// WFI.
    WaitForInterrupt,
    /// WFE.
    WaitForEvent,
    /// SEV.
    SendEvent,
    /// CLREX.
    ClearExclusive,
    /// CPS.
    ChangeState {
        /// CPSID.
        disable: bool,
        /// Flag i.
        primask: bool,
        /// Flag f.
        faultmask: bool,
    },
    /// MRS.
    Read {
        /// SYSm.
        special: u32,
        /// Where to.
        rd: Reg,
    },
    /// MSR.
    Write {
        /// SYSm.
        special: u32,
        /// Where from.
        source: Reg,
        /// Of APSR: bit 1 for the flags.
        mask: u32,
    },
    /// SVC.
    SupervisorCall,
    /// BKPT.
    Breakpoint,
    /// Any instruction of a coprocessor.
    Coprocessor,
}

impl Special {
    /// A hint by its number.
    pub const fn hint(number: u32) -> Self {
        match number {
            2 => Self::WaitForEvent,
            3 => Self::WaitForInterrupt,
            4 => Self::SendEvent,
            _ => Self::Nothing,
        }
    }
}
