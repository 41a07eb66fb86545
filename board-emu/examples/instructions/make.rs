//! Generates a random case, with branches and IT blocks.

use crate::case::{Case, Random, WINDOW_LEN, target};
use crate::{alu, memory};

/// The flags and Q, and Thumb state of xPSR.
const FLAGS: u32 = 0xF800_0000;
const THUMB: u32 = 1 << 24;

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

/// Generates IT with one to four instructions. A load or store comes first, while its registers still have
/// their prepared values; a branch comes last (ARMv7-M A4.1.3). No conditional B, CBZ or IT inside (A7.7.12,
/// A7.7.21, A7.7.38).
fn it_block(random: &mut Random, case: &mut Case) {
    let n = 1 + random.below(4);
    let first = random.below(15);
    // AL has no else (A7.7.38).
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
        // Not ADD PC, PC, which is unpredictable (A7.7.4), and not SP, whose value is arbitrary.
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
