//! A case (registers, memory and a few instructions), and random numbers.

/// Bytes of flash for a case's instructions.
pub const SLOT: u32 = 32;
/// Memory window of loads and stores, which use its middle half.
pub const WINDOW: u32 = 0x2000_1000;
pub const WINDOW_LEN: usize = 256;

/// SplitMix64.
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

    /// Any register except SP and PC.
    pub fn register(&mut self) -> u32 {
        *self.choose(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 14])
    }

    pub fn choose<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len() as u32) as usize]
    }

    /// A random word, with many corner cases.
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

    pub fn set_word(&mut self, address: u32, value: u32) {
        let at = (address - WINDOW) as usize;
        self.window[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }
}

/// A branch target: odd, because only Thumb state exists, and never an EXC_RETURN value (ARMv7-M B1.5.8).
pub fn target(random: &mut Random) -> u32 {
    random.word() & 0x7FFF_FFFF | 1
}
