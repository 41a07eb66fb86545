//! A case (registers, memory and a few instructions) and the random numbers that it is made of.

/// Bytes of flash for a case's instructions.
pub const SLOT: u32 = 32;
/// Where loads and stores go: the middle half of it.
pub const WINDOW: u32 = 0x2000_1000;
/// Its bytes.
pub const WINDOW_LEN: usize = 256;

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
