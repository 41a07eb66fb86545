//! Cases: registers, memory and a few instructions, and chance.

use crate::{alu, memory};

/// Bytes of flash for a case's instructions.
pub const SLOT: u32 = 32;
/// Where loads and stores go: the middle half of it.
pub const WINDOW: u32 = 0x2000_1000;
/// Its bytes.
pub const WINDOW_LEN: usize = 256;

/// The flags and Q; xPSR is these and Thumb state.
const FLAGS: u32 = 0xF800_0000;
const THUMB: u32 = 1 << 24;

/// Numbers by chance (SplitMix64).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub fn word(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ z >> 31) >> 32) as u32
    }

    pub fn below(&mut self, n: u32) -> u32 {
        self.word() % n
    }

    pub fn bits(&mut self, n: u32) -> u32 {
        self.below(1 << n)
    }

    pub fn coin(&mut self) -> bool {
        self.bits(1) == 1
    }

    /// A register but SP and PC.
    pub fn register(&mut self) -> u32 {
        *self.choose(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14])
    }

    pub fn choose<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len() as u32) as usize]
    }

    /// A value: any, or one of those where instructions change their minds.
    pub fn value(&mut self) -> u32 {
        match self.below(8) {
            0 => *self.choose(&[0, 1, 2, u32::MAX, 1 << 31, i32::MAX as u32, 0x7FFF, 0x8000, 0xFF, 0xFFFF]),
            1 => self.below(70),
            2 => 1 << self.below(32),
            3 => self.below(70).wrapping_neg(),
            _ => self.word(),
        }
    }
}

/// What is executed.
pub struct Case {
    pub registers: [u32; 17],
    pub window: Vec<u8>,
    pub code: Vec<u16>,
}

impl Case {
    pub fn address(&self) -> u32 {
        self.registers[15]
    }

    pub fn narrow(&mut self, code: u32) {
        self.code.push(code as u16);
    }

    pub fn wide(&mut self, code: u32) {
        self.code.extend([(code >> 16) as u16, code as u16]);
    }

    /// A word of the window.
    pub fn set_word(&mut self, address: u32, value: u32) {
        let at = (address - WINDOW) as usize;
        self.window[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }
}

/// A branch's target: odd, because there is only Thumb state, and none of the values that mean a return from an exception
/// (ARMv7-M B1.5.8).
pub fn target(random: &mut Random) -> u32 {
    random.word() & 0x7FFF_FFFF | 1
}

/// One case, to be put at an address.
pub fn make(random: &mut Random, address: u32) -> Case {
    let mut registers = [0; 17];
    registers.fill_with(|| random.value());
    registers[13] &= !3;
    registers[15] = address;
    registers[16] = random.word() & FLAGS | THUMB;
    let window = (0..WINDOW_LEN).map(|_| random.below(256) as u8).collect();
    let mut case = Case { registers, window, code: Vec::new() };
    match random.below(16) {
        0..=5 => (0..=random.below(4)).for_each(|_| alu::any(random, &mut case, false)),
        6..=9 => memory::any(random, &mut case, false),
        10 => branch(random, &mut case),
        11 => memory::exclusives(random, &mut case),
        _ => it_block(random, &mut case),
    }
    case
}

/// IT with one to four instructions. A load or store comes first, so that its registers are still as it wants them; a branch
/// may only be the last (ARMv7-M A4.1.3). No B with a condition of its own, no CBZ, no IT inside (A7.7.12, A7.7.21, A7.7.38).
fn it_block(random: &mut Random, case: &mut Case) {
    let n = 1 + random.below(4);
    let first = random.below(15);
    // With condition AL there is no else (A7.7.38).
    let others = if first == 14 { 0 } else { random.bits(3) };
    let same = first & 1;
    let mask = (0..3).fold(0, |mask, i| {
        let bit = match (i + 1).cmp(&n) {
            std::cmp::Ordering::Less => same ^ (others >> i & 1),
            std::cmp::Ordering::Equal => 1,
            std::cmp::Ordering::Greater => 0,
        };
        mask | bit << (3 - i)
    });
    let mask = if n == 4 { mask | 1 } else { mask };
    case.narrow(0xBF00 | first << 4 | mask);
    for i in 1..=n {
        match random.below(4) {
            0 if i == 1 => memory::any(random, case, n > 1),
            0 if i == n => direct_branch(random, case),
            _ => alu::any(random, case, true),
        }
    }
}

/// B and BL without a condition, MOV to PC, ADD to PC.
fn direct_branch(random: &mut Random, case: &mut Case) {
    match random.below(5) {
        0 => {
            let offset = random.bits(11);
            case.narrow(0xE000 | offset);
        }
        1 => wide_branch(random, case, 0xF000_9000),
        2 => wide_branch(random, case, 0xF000_D000),
        // Not MOV PC, PC or ADD PC, PC: the latter is unpredictable (A7.7.4); nor SP, for it may be anything.
        3 => case.narrow(0x4687 | random.register() << 3),
        _ => case.narrow(0x4487 | random.register() << 3),
    }
}

fn wide_branch(random: &mut Random, case: &mut Case, base: u32) {
    case.wide(base | random.bits(11) << 16 | random.bits(11) | random.bits(1) << 13 | random.bits(1) << 11);
}

fn branch(random: &mut Random, case: &mut Case) {
    match random.below(5) {
        0 => {
            // 14 is undefined, 15 is SVC.
            let condition = random.below(14);
            case.narrow(0xD000 | condition << 8 | random.bits(8));
        }
        1 => {
            let condition = random.below(14);
            let ends = random.bits(1) << 13 | random.bits(1) << 11 | random.bits(1) << 26;
            case.wide(0xF000_8000 | condition << 22 | random.bits(6) << 16 | random.bits(11) | ends);
        }
        2 => case.narrow(0xB100 | random.bits(1) << 11 | random.bits(1) << 9 | random.bits(8)),
        3 => {
            // BX, BLX.
            let register = random.register();
            case.registers[register as usize] = target(random);
            case.narrow(0x4700 | random.bits(1) << 7 | register << 3);
        }
        _ => direct_branch(random, case),
    }
}
