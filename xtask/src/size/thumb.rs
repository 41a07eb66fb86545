//! The effect of a Cortex-M3 instruction on control flow, stack pointer and PRIMASK, and nothing else.
//! Encodings: ARMv7-M Architecture Reference Manual (DDI 0403E), chapter A5 and section A7.7.
//!
//! Why board-emu's decoder is not used: decision 0041.

const SP: u16 = 13;
const LR: u16 = 14;
pub const PC: u16 = 15;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flow {
    Next,
    Call(u32),
    CallRegister,
    Jump(u32),
    /// Conditional: this target or the next instruction.
    Branch(u32),
    /// BX: a tail call.
    LastCallRegister,
    /// MOV to PC: to one of the jumps that follow.
    JumpAmong,
    JumpRegister,
    /// By a table of bytes or half-words, which follows if its register is PC.
    Table {
        wide: bool,
        register: u16,
    },
    Return,
    /// Permanently undefined: a fault.
    Trap,
    /// SVC.
    Exception,
    /// Undefined on this processor.
    Unknown,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stack {
    /// Bytes pushed; negative if popped.
    Grows(i32),
    /// Set to a value unknown to static analysis.
    Set,
}

/// Effect on PRIMASK, which masks interrupts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mask {
    Same,
    Set,
    /// Cleared, or possibly cleared.
    Clear,
}

/// Half of a constant for a register: MOVW or MOVT.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Half {
    pub register: u16,
    pub upper: bool,
    pub value: u16,
}

/// An address for a register: ADR.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    pub register: u16,
    pub value: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Instruction {
    /// Length in bytes.
    pub len: u32,
    pub flow: Flow,
    pub stack: Stack,
    pub mask: Mask,
    /// Number of conditional instructions that follow (IT).
    pub conditional: u32,
    pub half: Option<Half>,
    pub address: Option<Address>,
    pub nop: bool,
}

impl Instruction {
    const fn new(len: u32) -> Self {
        Self {
            len,
            flow: Flow::Next,
            stack: Stack::Grows(0),
            mask: Mask::Same,
            conditional: 0,
            half: None,
            address: None,
            nop: false,
        }
    }

    const fn flow(self, flow: Flow) -> Self {
        Self { flow, ..self }
    }

    const fn grows(self, bytes: u32) -> Self {
        Self { stack: Stack::Grows(bytes.cast_signed()), ..self }
    }

    const fn shrinks(self, bytes: u32) -> Self {
        Self { stack: Stack::Grows(-bytes.cast_signed()), ..self }
    }

    const fn sets_stack(self) -> Self {
        Self { stack: Stack::Set, ..self }
    }

    /// `register` gets an unknown value.
    const fn writes(self, register: u16) -> Self {
        match register {
            SP => self.sets_stack(),
            PC => self.flow(Flow::JumpRegister),
            _ => self,
        }
    }
}

/// Decodes the instruction at an address; `None` if the bytes end inside it.
pub fn decode(at: u32, bytes: &[u8]) -> Option<Instruction> {
    let half = |index: usize| Some(u16::from_le_bytes(bytes.get(index..index + 2)?.try_into().ok()?));
    let first = half(0)?;
    if first >> 11 > 0b11100 { Some(wide(at, first, half(2)?)) } else { Some(narrow(at, first)) }
}

/// Bits `low..low + count` of a half-word.
const fn bits(half: u16, low: u32, count: u32) -> u16 {
    half >> low & ((1 << count) - 1)
}

/// The address at `offset`, of `count` bits with sign, from PC, which is 4 ahead.
const fn target(at: u32, offset: u32, count: u32) -> u32 {
    let offset = (offset << (32 - count)).cast_signed() >> (32 - count);
    at.wrapping_add(4).wrapping_add_signed(offset)
}

/// What ADR adds to.
const fn aligned(at: u32) -> u32 {
    at.wrapping_add(4) & !3
}

/// 16 bits (A5.2).
fn narrow(at: u32, half: u16) -> Instruction {
    let plain = Instruction::new(2);
    match half {
        0x4400..=0x44FF | 0x4600..=0x46FF => {
            let (from, to) = (bits(half, 3, 4), bits(half, 0, 3) | bits(half, 7, 1) << 3);
            match (half >= 0x4600, from, to) {
                (true, LR, PC) => plain.flow(Flow::Return),
                (true, _, PC) => plain.flow(Flow::JumpAmong),
                _ => plain.writes(to),
            }
        }
        0x4700..=0x477F if bits(half, 3, 4) == LR => plain.flow(Flow::Return),
        0x4700..=0x477F => plain.flow(Flow::LastCallRegister),
        0x4780..=0x47FF => plain.flow(Flow::CallRegister),
        0xA000..=0xA7FF => {
            let value = aligned(at).wrapping_add(4 * u32::from(bits(half, 0, 8)));
            Instruction { address: Some(Address { register: bits(half, 8, 3), value }), ..plain }
        }
        0xB000..=0xB07F => plain.shrinks(4 * u32::from(bits(half, 0, 7))),
        0xB080..=0xB0FF => plain.grows(4 * u32::from(bits(half, 0, 7))),
        0xB400..=0xB5FF => plain.grows(4 * bits(half, 0, 9).count_ones()),
        0xBC00..=0xBDFF => {
            let pop = plain.shrinks(4 * bits(half, 0, 9).count_ones());
            if bits(half, 8, 1) == 1 { pop.flow(Flow::Return) } else { pop }
        }
        // CPS, of PRIMASK.
        0xB660..=0xB67F if bits(half, 1, 1) == 1 => {
            Instruction { mask: if bits(half, 4, 1) == 1 { Mask::Set } else { Mask::Clear }, ..plain }
        }
        0xBF00 => Instruction { nop: true, ..plain },
        // IT: the lowest 1 ends the list of conditions.
        0xBF00..=0xBFFF if bits(half, 0, 4) != 0 => {
            Instruction { conditional: 4 - half.trailing_zeros(), ..plain }
        }
        0xB100..=0xBBFF if half & 0xF500 == 0xB100 => {
            let offset = bits(half, 9, 1) << 6 | bits(half, 3, 5) << 1;
            plain.flow(Flow::Branch(at + 4 + u32::from(offset)))
        }
        0xD000..=0xDDFF => plain.flow(Flow::Branch(target(at, u32::from(bits(half, 0, 8)) << 1, 9))),
        0xDE00..=0xDEFF => plain.flow(Flow::Trap),
        0xDF00..=0xDFFF => plain.flow(Flow::Exception),
        0xE000..=0xE7FF => plain.flow(Flow::Jump(target(at, u32::from(bits(half, 0, 11)) << 1, 12))),
        _ => plain,
    }
}

/// 32 bits (A5.3).
fn wide(at: u32, first: u16, second: u16) -> Instruction {
    let plain = Instruction::new(4);
    let (rn, rd) = (bits(first, 0, 4), bits(second, 8, 4));
    match first >> 9 {
        0b111_0100 if bits(first, 6, 1) == 0 => multiple(first, second),
        0b111_0100 => dual(first, second),
        0b111_0101 if rd == SP => plain.sets_stack(),
        _ if bits(first, 11, 5) == 0b11110 && bits(second, 15, 1) == 1 => branch(at, first, second),
        _ if bits(first, 11, 5) == 0b11110 => immediate(at, first, second),
        0b111_1100 => single(first, second),
        // Data processing by registers.
        0b111_1101 if rd == SP && rn != PC => plain.sets_stack(),
        _ => plain,
    }
}

/// Branches and miscellaneous control (A5.3.4).
fn branch(at: u32, first: u16, second: u16) -> Instruction {
    let plain = Instruction::new(4);
    let sign = bits(first, 10, 1);
    let (j1, j2) = (bits(second, 13, 1), bits(second, 11, 1));
    let low = u32::from(bits(second, 0, 11)) << 1;
    let far = || {
        let (i1, i2) = (u32::from(j1 == sign), u32::from(j2 == sign));
        let offset = u32::from(sign) << 24 | i1 << 23 | i2 << 22 | u32::from(bits(first, 0, 10)) << 12 | low;
        target(at, offset, 25)
    };
    match (bits(second, 14, 1), bits(second, 12, 1)) {
        (1, 1) => plain.flow(Flow::Call(far())),
        (0, 1) => plain.flow(Flow::Jump(far())),
        // BLX with immediate would leave Thumb state: undefined here.
        (1, 0) => plain.flow(Flow::Unknown),
        _ if bits(first, 6, 4) < 14 => {
            let high = u32::from(sign << 2 | j2 << 1 | j1) << 18;
            plain.flow(Flow::Branch(target(at, high | u32::from(bits(first, 0, 6)) << 12 | low, 21)))
        }
        // MSR: MSP, PSP, CONTROL (which selects between them), PRIMASK.
        _ if first >> 5 == 0xF380 >> 5 => match bits(second, 0, 8) {
            8 | 9 | 20 => plain.sets_stack(),
            16 => Instruction { mask: Mask::Clear, ..plain },
            _ => plain,
        },
        _ if first >> 4 == 0xF7F0 >> 4 => plain.flow(Flow::Trap),
        _ => plain,
    }
}

/// Data processing with an immediate (A5.3.1, A5.3.3).
fn immediate(at: u32, first: u16, second: u16) -> Instruction {
    let plain = Instruction::new(4);
    let (rn, rd) = (bits(first, 0, 4), bits(second, 8, 4));
    let imm12 = bits(first, 10, 1) << 11 | bits(second, 12, 3) << 8 | bits(second, 0, 8);
    let is_plain = bits(first, 9, 1) == 1;
    let op = bits(first, 4, 5);
    if is_plain && (op == 0b00100 || op == 0b01100) {
        let half = Half { register: rd, upper: op == 0b01100, value: rn << 12 | imm12 };
        return Instruction { half: Some(half), ..plain };
    }
    if is_plain && rn == PC && (op == 0b00000 || op == 0b01010) {
        let offset = u32::from(imm12);
        let value = if op == 0 { aligned(at).wrapping_add(offset) } else { aligned(at).wrapping_sub(offset) };
        return Instruction { address: Some(Address { register: rd, value }), ..plain };
    }
    match (is_plain, op >> 1) {
        _ if rd != SP => plain,
        (true, 0b0000) if rn == SP => plain.shrinks(imm12.into()),
        (true, 0b0101) if rn == SP => plain.grows(imm12.into()),
        (false, 0b1000) if rn == SP => plain.shrinks(expand(imm12)),
        (false, 0b1101) if rn == SP => plain.grows(expand(imm12)),
        _ => plain.sets_stack(),
    }
}

/// Expands an immediate of 12 bits (A5.3.2).
fn expand(imm12: u16) -> u32 {
    let byte = u32::from(bits(imm12, 0, 8));
    match bits(imm12, 8, 4) {
        0 => byte,
        1 => byte << 16 | byte,
        2 => (byte << 16 | byte) << 8,
        3 => byte * 0x0101_0101,
        _ => (byte | 0x80).rotate_right(bits(imm12, 7, 5).into()),
    }
}

/// Load and store multiple (A5.3.5).
fn multiple(first: u16, second: u16) -> Instruction {
    let plain = Instruction::new(4);
    let (loads, rn) = (bits(first, 4, 1) == 1, bits(first, 0, 4));
    let bytes = 4 * second.count_ones();
    let moved = match (bits(first, 5, 1) == 1 && rn == SP, bits(first, 7, 2), loads) {
        (false, ..) => plain,
        (true, 0b10, false) => plain.grows(bytes),
        (true, 0b01, true) => plain.shrinks(bytes),
        _ => plain.sets_stack(),
    };
    match (loads && bits(second, 15, 1) == 1, rn) {
        (true, SP) => moved.flow(Flow::Return),
        (true, _) => moved.flow(Flow::JumpRegister),
        _ => moved,
    }
}

/// Load and store dual, and table branches (A5.3.6).
fn dual(first: u16, second: u16) -> Instruction {
    let plain = Instruction::new(4);
    if first >> 4 == 0xE8D0 >> 4 && second >> 5 == 0xF000 >> 5 {
        return plain.flow(Flow::Table { wide: bits(second, 4, 1) == 1, register: bits(first, 0, 4) });
    }
    if bits(first, 5, 1) == 0 || bits(first, 0, 4) != SP {
        return plain;
    }
    let bytes = 4 * u32::from(bits(second, 0, 8));
    if bits(first, 7, 1) == 1 { plain.shrinks(bytes) } else { plain.grows(bytes) }
}

/// Load and store of one register (A5.3.7 to A5.3.10).
fn single(first: u16, second: u16) -> Instruction {
    let plain = Instruction::new(4);
    let (rn, rt) = (bits(first, 0, 4), bits(second, 12, 4));
    // Offset of eight bits with write-back.
    let back = bits(first, 7, 1) == 0 && bits(second, 11, 1) == 1 && bits(second, 8, 1) == 1 && rn == SP;
    let bytes = u32::from(bits(second, 0, 8));
    let moved = match (back, bits(second, 9, 1)) {
        (false, _) => plain,
        (true, 0) => plain.grows(bytes),
        (true, _) => plain.shrinks(bytes),
    };
    // A byte or half-word load into PC is a hint.
    let loads_word = bits(first, 4, 1) == 1 && bits(first, 5, 2) == 2;
    match (loads_word, rt) {
        (true, PC) if back => moved.flow(Flow::Return),
        (true, _) => moved.writes(rt),
        _ => moved,
    }
}

#[cfg(test)]
mod tests;
