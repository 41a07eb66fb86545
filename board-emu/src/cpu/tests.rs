//! Tests of the core, with programs of a few instructions.

mod exceptions;
mod faults;
mod system;

use super::*;
use crate::chip::{Chip, Size};

const TOP: u32 = 0x2000_2000;
const MAIN: u32 = 0x0800_0200;
/// ISER0, ISPR0, ICPR0, IABR0, IPR0.
const ENABLE: u32 = 0xE000_E100;
const PEND: u32 = 0xE000_E200;
const UNPEND: u32 = 0xE000_E280;
const PRIORITY: u32 = 0xE000_E400;
const SHCSR: u32 = 0xE000_ED24;
const CFSR: u32 = 0xE000_ED28;
const HFSR: u32 = 0xE000_ED2C;
const BFAR: u32 = 0xE000_ED38;

const NOP: u16 = 0xBF00;
/// A branch to itself.
const STAY: u16 = 0xE7FE;
const BX_LR: u16 = 0x4770;
const WFI: u16 = 0xBF30;
const CPSID: u16 = 0xB672;
const CPSIE: u16 = 0xB662;

/// Appends a digit to r5, the trace of handlers: entry and return do not touch r5.
const fn trace(digit: u16) -> [u16; 2] {
    [0x012D, 0x3500 | digit] // LSLS r5, r5, #4; ADDS r5, #digit
}

fn handler(digit: u16) -> Vec<u16> {
    [trace(digit).as_slice(), &[BX_LR]].concat()
}

struct Bench {
    cpu: Cpu,
}

impl Bench {
    /// A core after reset, with a program and handlers by exception number; other exceptions loop forever.
    fn new(main: &[u16], handlers: &[(u32, Vec<u16>)]) -> Self {
        let mut chip = Chip::new(1, [0; 3]);
        let mut put = |address: u32, code: &[u16]| {
            let bytes: Vec<u8> = code.iter().flat_map(|half| half.to_le_bytes()).collect();
            let at = (address & 0x1_FFFF) as usize;
            chip.flash.bytes[at..at + bytes.len()].copy_from_slice(&bytes);
        };
        let mut word = |address: u32, word: u32| put(address, &[word as u16, (word >> 16) as u16]);
        word(0, TOP);
        word(4, MAIN | 1);
        let home = |exception: u32| 0x0800_0400 + 0x40 * exception;
        (2..60).for_each(|exception| word(4 * exception, home(exception) | 1));
        put(MAIN, main);
        (2..60).for_each(|exception| put(home(exception), &[STAY]));
        handlers.iter().for_each(|(exception, code)| put(home(*exception), code));
        let mut cpu = Cpu::new(chip);
        cpu.reset().unwrap();
        cpu.set_register(5, 0);
        Self { cpu }
    }

    fn steps(&mut self, n: usize) {
        (0..n).for_each(|_| self.cpu.step().unwrap());
    }

    fn poke(&mut self, address: u32, value: u32) {
        self.cpu.write_private(address, Size::Word, value).unwrap();
    }

    fn peek(&mut self, address: u32) -> u32 {
        self.cpu.read_private(address, Size::Word).unwrap()
    }

    fn interrupt(&mut self, position: u32, priority: u8) {
        self.cpu.write_private(PRIORITY + position, Size::Byte, u32::from(priority)).unwrap();
        self.poke(ENABLE + 4 * (position / 32), 1 << (position % 32));
    }

    fn lines(&mut self, positions: &[u32]) {
        let lines = positions.iter().fold(0, |all, position| all | 1 << position);
        self.cpu.set_lines(lines, false);
    }

    fn trace(&self) -> u32 {
        self.cpu.register(5)
    }

    fn exception(&self) -> u32 {
        self.cpu.register(16) & 0x1FF
    }

    fn word(&mut self, address: u32) -> u32 {
        self.cpu.chip.read(address, Size::Word).unwrap()
    }
}
