//! Data processing: instructions that change only registers and flags.
//!
//! Unpredictable ones (ARMv7-M) are not generated: the two cores may differ.

use crate::case::{Case, Random};

/// `it`: inside an IT block.
pub fn any(random: &mut Random, case: &mut Case, it: bool) {
    match random.below(14) {
        0..=3 => narrow(random, case, it),
        4 => high(random, case, it),
        5 | 6 => modified_immediate(random, case),
        7 => plain_immediate(random, case),
        8 | 9 => shifted_register(random, case),
        10 => by_register(random, case),
        11 | 12 => multiply(random, case),
        _ => other(random, case),
    }
}

fn narrow(random: &mut Random, case: &mut Case, it: bool) {
    let code = match random.below(6) {
        0 => {
            let code = random.below(0x1800);
            // LSL #0 is MOVS, unpredictable in an IT block (A7.7.77).
            if it { code | 1 << 6 } else { code }
        }
        1 => 0x1800 | random.bits(11),
        2 => 0x2000 | random.bits(13),
        3 => 0x4000 | random.bits(10),
        // ADR, ADD with SP; ADD and SUB of SP.
        4 if random.coin() => 0xA000 | random.bits(12),
        4 => 0xB000 | random.bits(8),
        // SXTH, SXTB, UXTH, UXTB; REV, REV16, REVSH.
        _ if random.coin() => 0xB200 | random.bits(8),
        _ => *random.choose(&[0xBA00, 0xBA40, 0xBAC0]) | random.bits(6),
    };
    case.narrow(code);
}

/// ADD, CMP and MOV with high registers, but not into PC. Into SP only multiples of four: a Cortex-M3 clears
/// its two lowest bits (B1.4.1), Unicorn keeps them.
fn high(random: &mut Random, case: &mut Case, it: bool) {
    let (mut rd, rm) = (random.below(15), random.below(15));
    if rd == 13 && (it || rm == 13) {
        rd = 12;
    } else if rd == 13 {
        case.wide(0xF020_0003 | rm << 16 | rm << 8); // BIC rm, rm, #3
    }
    let split = |rd: u32| rd & 7 | (rd & 8) << 4;
    match random.below(3) {
        0 => case.narrow(0x4400 | rm << 3 | split(rd)),
        // Two low registers are unpredictable (A7.7.28).
        1 => case.narrow(0x4500 | rm << 3 | split(if rm < 8 { rd % 7 + 8 } else { rd })),
        _ => case.narrow(0x4600 | rm << 3 | split(rd)),
    }
}

/// Operations of A5.3.1 and A5.3.11: number, and whether they have a test form.
const OPERATIONS: [(u32, bool); 10] = [
    (0, true),
    (1, false),
    (2, false),
    (3, false),
    (4, true),
    (8, true),
    (10, false),
    (11, false),
    (13, true),
    (14, false),
];

fn operands(random: &mut Random) -> u32 {
    let (op, tests) = *random.choose(&OPERATIONS);
    let (mut rd, mut rn, mut s) = (random.register(), random.register(), random.bits(1));
    if tests && random.below(4) == 0 {
        (rd, s) = (15, 1);
    } else if matches!(op, 2 | 3) && random.below(4) == 0 {
        rn = 15; // MOV, MVN
    } else if matches!(op, 8 | 13) && random.below(8) == 0 {
        rn = 13; // ADD and SUB with SP
        if random.coin() {
            rd = 13;
        }
    }
    op << 21 | s << 20 | rn << 16 | rd << 8
}

fn modified_immediate(random: &mut Random, case: &mut Case) {
    let mut immediate = random.bits(12);
    // A repeated byte must not be 0 (A5.3.2).
    if immediate & 0xC00 == 0 && immediate & 0x300 != 0 && immediate & 0xFF == 0 {
        immediate |= 1;
    }
    let operands = operands(random);
    if operands >> 8 & 15 == 13 {
        immediate &= 0xFC; // as in `high`
    }
    case.wide(
        0xF000_0000 | operands | (immediate & 0x800) << 15 | (immediate & 0x700) << 4 | immediate & 0xFF,
    );
}

fn shifted_register(random: &mut Random, case: &mut Case) {
    let mut code = 0xEA00_0000 | operands(random) | random.register();
    // Into SP only with LSL #0 to #3 (A7.7.6), of which two give multiples of four: see `high`.
    let (kind, count) =
        if code >> 8 & 15 == 13 { (0, 2 + random.below(2)) } else { (random.bits(2), random.bits(5)) };
    code |= kind << 4 | (count & 0x1C) << 10 | (count & 3) << 6;
    case.wide(code);
}

/// A5.3.3.
fn plain_immediate(random: &mut Random, case: &mut Case) {
    let (rd, rn) = (random.register() << 8, random.register() << 16);
    let immediate = random.bits(1) << 26 | random.bits(3) << 12 | random.bits(8);
    let (lsb, width) = (random.below(32), random.below(32));
    let at = (lsb & 0x1C) << 10 | (lsb & 3) << 6;
    let field = lsb + width.min(31 - lsb);
    case.wide(match random.below(9) {
        0 => 0xF200_0000 | immediate | rd | *random.choose(&[rn, rn, 13 << 16, 15 << 16]),
        1 => 0xF2A0_0000 | immediate | rd | *random.choose(&[rn, rn, 13 << 16, 15 << 16]),
        2 => 0xF240_0000 | immediate | rd | random.bits(4) << 16,
        3 => 0xF2C0_0000 | immediate | rd | random.bits(4) << 16,
        // SSAT, USAT: ASR #0 is the SSAT16 of other cores (A7.7.134).
        4 => 0xF300_0000 | rd | rn | at | random.bits(5) | if lsb == 0 { 0 } else { random.bits(1) << 21 },
        5 => 0xF380_0000 | rd | rn | at | random.bits(5) | if lsb == 0 { 0 } else { random.bits(1) << 21 },
        // SBFX, UBFX: within the word.
        6 => *random.choose(&[0xF340_0000, 0xF3C0_0000]) | rd | rn | at | width.min(31 - lsb),
        // BFI, BFC.
        7 => 0xF360_0000 | rd | rn | at | field,
        _ => 0xF36F_0000 | rd | at | field,
    });
}

/// A5.3.12: shifts by a register, extensions, REV, RBIT, CLZ.
fn by_register(random: &mut Random, case: &mut Case) {
    let (rd, rn, rm) = (random.register() << 8, random.register() << 16, random.register());
    case.wide(match random.below(3) {
        0 => 0xFA00_F000 | random.bits(2) << 21 | random.bits(1) << 20 | rn | rd | rm,
        1 => {
            *random.choose(&[0xFA0F_F080, 0xFA1F_F080, 0xFA4F_F080, 0xFA5F_F080])
                | rd
                | random.bits(2) << 4
                | rm
        }
        // Both fields of the operand are the same (A7.7.112).
        _ => {
            let which = *random.choose(&[0xFA90_F080, 0xFA90_F090, 0xFA90_F0A0, 0xFA90_F0B0, 0xFAB0_F080]);
            which | rm << 16 | rd | rm
        }
    });
}

/// A5.3.13, A5.3.14.
fn multiply(random: &mut Random, case: &mut Case) {
    let (rn, rm, ra) = (random.register() << 16, random.register(), random.register() << 12);
    let rd = random.register();
    let long = || (rn | rm, (rd % 12 + 1) << 8, (rd % 12) << 12);
    case.wide(match random.below(5) {
        0 => 0xFB00_F000 | rn | rm | rd << 8,
        1 => 0xFB00_0000 | rn | rm | rd << 8 | ra,
        2 => 0xFB00_0010 | rn | rm | rd << 8 | ra,
        3 => {
            // High and low are two registers (A7.7.147).
            let (operands, high, low) = long();
            *random.choose(&[0xFB80_0000, 0xFBA0_0000, 0xFBC0_0000, 0xFBE0_0000]) | operands | high | low
        }
        _ => *random.choose(&[0xFB90_F0F0, 0xFBB0_F0F0]) | rn | rm | rd << 8,
    });
}

/// MRS and MSR of the flags, hints without effect, barriers.
fn other(random: &mut Random, case: &mut Case) {
    match random.below(6) {
        // MRS of APSR, IAPSR, EAPSR, xPSR, IPSR, EPSR, IEPSR.
        0 | 1 => case.wide(0xF3EF_8000 | random.register() << 8 | *random.choose(&[0, 1, 2, 3, 5, 6, 7])),
        2 | 3 => case.wide(0xF380_8800 | random.register() << 16 | random.bits(2)),
        4 => case.narrow(*random.choose(&[0xBF00, 0xBF40])),
        _ => case.wide(*random.choose(&[0xF3AF_8000, 0xF3BF_8F4F, 0xF3BF_8F5F, 0xF3BF_8F6F, 0xF890_F000])),
    }
}
