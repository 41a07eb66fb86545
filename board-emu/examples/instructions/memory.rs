//! Loads and stores in all modes, except those that are unpredictable (ARMv7-M) or fault.

use crate::case::{Case, Random, WINDOW, WINDOW_LEN, target};

/// `inside`: in an IT block and not last, where it must not branch (A4.1.3).
pub fn any(random: &mut Random, case: &mut Case, inside: bool) {
    match random.below(10) {
        0 | 1 => narrow(random, case),
        2 => stack(random, case, inside),
        3 | 4 => immediate(random, case, inside),
        5 => register(random, case, inside),
        6 => literal(random, case),
        7 => pair(random, case),
        8 => multiple(random, case, inside),
        _ if inside => immediate(random, case, inside),
        _ => table(random, case),
    }
}

fn place(random: &mut Random, align: u32) -> u32 {
    let quarter = WINDOW_LEN as u32 / 4;
    (WINDOW + quarter + random.below(2 * quarter - 8)) / align * align
}

/// Sets a base so that base plus offset is in the window.
fn aim(random: &mut Random, case: &mut Case, base: u32, offset: u32) {
    // Mostly aligned, as in real programs.
    let align = *random.choose(&[4, 4, 1]);
    case.registers[base as usize] = place(random, align).wrapping_sub(offset);
}

fn narrow(random: &mut Random, case: &mut Case) {
    let (rt, rn, rm) = (random.bits(3), random.bits(3), random.bits(3));
    if random.coin() {
        let rm = if rm == rn { (rm + 1) % 8 } else { rm };
        case.narrow(0x5000 | random.bits(3) << 9 | rm << 6 | rn << 3 | rt);
        case.registers[rm as usize] = random.value();
        aim(random, case, rn, case.registers[rm as usize]);
        return;
    }
    let (base, size) = *random.choose(&[(0x6000, 4), (0x7000, 1), (0x8000, 2)]);
    let imm5 = random.bits(5);
    case.narrow(base | random.bits(1) << 11 | imm5 << 6 | rn << 3 | rt);
    aim(random, case, rn, imm5 * size);
}

/// Relative to SP; PUSH and POP.
fn stack(random: &mut Random, case: &mut Case, inside: bool) {
    case.registers[13] = place(random, 4);
    if random.below(4) == 0 {
        let imm8 = random.bits(8);
        case.narrow(0x9000 | random.bits(1) << 11 | random.bits(3) << 8 | imm8);
        case.registers[13] -= 4 * imm8;
        return;
    }
    // An empty list is unpredictable (A7.7.99, A7.7.101).
    let list = random.bits(8).max(1);
    if random.coin() {
        case.narrow(0xB400 | random.bits(1) << 8 | list);
    } else {
        let pc = if inside { 0 } else { random.bits(1) };
        case.narrow(0xBC00 | pc << 8 | list);
        case.set_word(case.registers[13] + 4 * list.count_ones(), target(random));
    }
}

/// Kinds of A5.3.7 to A5.3.10: bits of the first half-word, bytes.
const KINDS: [(u32, u32); 8] = [
    (0xF800_0000, 1),
    (0xF820_0000, 2),
    (0xF840_0000, 4),
    (0xF810_0000, 1),
    (0xF830_0000, 2),
    (0xF850_0000, 4),
    (0xF910_0000, 1),
    (0xF930_0000, 2),
];

const LDR: u32 = 0xF850_0000;

/// A data register; for LDR also SP and, outside IT blocks, PC.
fn transferred(random: &mut Random, kind: u32, inside: bool) -> u32 {
    match random.below(8) {
        0 if kind == LDR && !inside => 15,
        1 if kind == LDR => 13,
        _ => random.register(),
    }
}

/// A word loaded into PC must be an aligned target (A7.7.43), one loaded into SP a multiple of four (B1.4.1).
fn aim_at_target(random: &mut Random, case: &mut Case, rt: u32, base: u32, offset: u32) {
    if matches!(rt, 13 | 15) {
        let address = place(random, 4);
        case.registers[base as usize] = address.wrapping_sub(offset);
        let word = if rt == 15 { target(random) } else { random.word() & !3 };
        case.set_word(address, word);
    } else {
        aim(random, case, base, offset);
    }
}

fn immediate(random: &mut Random, case: &mut Case, inside: bool) {
    let (kind, _) = *random.choose(&KINDS);
    let (rt, rn) = (transferred(random, kind, inside), random.register());
    if random.coin() {
        let offset = random.bits(12);
        case.wide(kind | 1 << 23 | rn << 16 | rt << 12 | offset);
        aim_at_target(random, case, rt, rn, offset);
        return;
    }
    let (offset, mut mode) = (random.bits(8), *random.choose(&[1, 3, 4, 5, 7, 6]));
    // Write-back into the data register is unpredictable (A7.7.43, A7.7.160). Mode 6 is LDRT and the like,
    // without SP and PC (A7.7.67).
    if rt == rn && mode & 1 == 1 || mode == 6 && matches!(rt, 13 | 15) {
        mode = 4;
    }
    case.wide(kind | rn << 16 | rt << 12 | 1 << 11 | mode << 8 | offset);
    let moved = if mode & 2 == 2 { offset } else { offset.wrapping_neg() };
    aim_at_target(random, case, rt, rn, if mode & 4 == 4 { moved } else { 0 });
}

fn register(random: &mut Random, case: &mut Case, inside: bool) {
    let (kind, _) = *random.choose(&KINDS);
    let (rt, rn, mut rm) = (transferred(random, kind, inside), random.register(), random.register());
    if rm == rn {
        rm = (rm + 1) % 8;
    }
    let shift = random.bits(2);
    case.wide(kind | rn << 16 | rt << 12 | shift << 4 | rm);
    case.registers[rm as usize] = random.value();
    aim_at_target(random, case, rt, rn, case.registers[rm as usize] << shift);
}

fn literal(random: &mut Random, case: &mut Case) {
    if random.coin() {
        case.narrow(0x4800 | random.bits(11));
        return;
    }
    let (kind, _) = *random.choose(&KINDS[3..]);
    case.wide(kind | random.bits(1) << 23 | 15 << 16 | random.register() << 12 | random.bits(12));
}

fn pair(random: &mut Random, case: &mut Case) {
    let (rt, load) = (random.register(), random.bits(1));
    // Two different registers (A7.7.50).
    let second = if rt == 14 { 0 } else { (rt + 1) % 13 };
    let (mut rn, offset) = (random.register(), random.bits(8));
    // Index, up, write-back; neither index nor write-back encodes another instruction.
    let mut mode = *random.choose(&[0b1000, 0b1100, 0b1001, 0b1101, 0b0001, 0b0101]);
    if rn == rt || rn == second {
        mode = mode & 0b0100 | 0b1000;
    }
    if load == 1 && random.below(8) == 0 {
        (rn, mode) = (15, mode & 0b0100 | 0b1000);
    }
    case.wide(0xE840_0000 | mode << 21 | load << 20 | rn << 16 | rt << 12 | second << 8 | offset);
    if rn == 15 {
        return;
    }
    let moved = if mode & 4 == 4 { offset * 4 } else { (offset * 4).wrapping_neg() };
    let used = if mode & 8 == 8 { moved } else { 0 };
    case.registers[rn as usize] = place(random, 4).wrapping_sub(used);
}

fn multiple(random: &mut Random, case: &mut Case, inside: bool) {
    let load = random.bits(1);
    if random.coin() {
        let rn = random.bits(3);
        let mut list = random.bits(8).max(1);
        // A stored base with write-back must be the first (A7.7.159).
        if load == 0 && list >> rn & 1 == 1 {
            list &= !((1 << rn) - 1);
        }
        case.narrow(0xC000 | load << 11 | rn << 8 | list);
        case.registers[rn as usize] = place(random, 4);
        return;
    }
    let (rn, down, wback) = (*random.choose(&[0, 3, 5, 8, 12, 13, 14]), random.bits(1), random.bits(1));
    let mut list = random.bits(13);
    // Not both PC and LR, at least two, not a base with write-back (A7.7.41, A7.7.159).
    if load == 1 && !inside && random.coin() {
        list |= 1 << 15;
    } else {
        list |= random.bits(1) << 14;
    }
    if wback == 1 {
        list &= !(1 << rn);
    }
    while list.count_ones() < 2 {
        list |= 2 << random.below(2);
        list |= 1 << 4;
        list &= !(wback << rn);
    }
    let op = if down == 1 { 0xE900_0000 } else { 0xE880_0000 };
    case.wide(op | wback << 21 | load << 20 | rn << 16 | list);
    // Within the window: at most 14 words.
    let base = WINDOW + 64 + 4 * random.below(32);
    case.registers[rn as usize] = base;
    if list >> 15 == 1 {
        let last = if down == 1 { base - 4 } else { base + 4 * (list.count_ones() - 1) };
        case.set_word(last, target(random));
    }
}

/// TBB, TBH; the table may follow the instruction.
fn table(random: &mut Random, case: &mut Case) {
    let (rn, rm, half) = (random.register(), random.register(), random.bits(1));
    let rm = if rm == rn { (rm + 1) % 8 } else { rm };
    let base = if random.below(4) == 0 { 15 } else { rn };
    case.wide(0xE8D0_F000 | base << 16 | half << 4 | rm);
    if base == 15 {
        case.registers[rm as usize] = random.below(100);
    } else {
        let index = random.value();
        case.registers[rm as usize] = index;
        aim(random, case, rn, index << half);
    }
}

/// A load and a store with another instruction between, or a store alone, which must fail. Same address and
/// width: other combinations are implementation-defined (A3.4.1).
pub fn exclusives(random: &mut Random, case: &mut Case) {
    let size = random.below(3);
    let (rn, rt, rd, rs) = (8, random.below(4), 4 + random.below(4), 9 + random.below(4));
    let offset = if size == 0 { random.bits(8) } else { 0 };
    let (load, store) = match size {
        0 => (0xE850_0F00 | offset, 0xE840_0000 | rd << 8 | offset),
        1 => (0xE8D0_0F4F, 0xE8C0_0F40 | rd),
        _ => (0xE8D0_0F5F, 0xE8C0_0F50 | rd),
    };
    case.wide(0xF3BF_8F2F); // CLREX
    case.registers[rn as usize] = place(random, 4) - 4 * offset;
    if random.below(4) > 0 {
        case.wide(load | rn << 16 | rt << 12);
        if random.below(4) == 0 {
            case.wide(0xF3BF_8F2F);
        } else if random.coin() {
            case.narrow(0x3000 | rt << 8 | random.bits(8));
        }
    }
    case.wide(store | rn << 16 | rs << 12);
    case.wide(store | rn << 16 | rs << 12);
}
