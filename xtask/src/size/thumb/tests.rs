//! Encodings as disassembled by llvm-objdump, or from the manual's diagrams where it had none.

use super::*;

const AT: u32 = 0x0800_4000;

fn of(halves: &[u16]) -> Instruction {
    let bytes: Vec<u8> = halves.iter().flat_map(|half| half.to_le_bytes()).collect();
    decode(AT, &bytes).unwrap()
}

fn flow(halves: &[u16]) -> Flow {
    of(halves).flow
}

#[test]
fn length_follows_from_the_first_half_word() {
    for (halves, len) in [
        (&[0xBF00, 0][..], 2),
        (&[0xE7FB, 0], 2),
        (&[0xE92D, 0x0F00], 4),
        (&[0xF004, 0xFF73], 4),
        (&[0xF8DD, 0xB064], 4),
    ] {
        assert_eq!(of(halves).len, len, "{halves:x?}");
    }
    assert_eq!(decode(AT, &[0x2D, 0xE9]), None, "half of push.w");
    assert_eq!(decode(AT, &[0x00]), None);
}

#[test]
fn calls_and_jumps_have_their_targets() {
    let to = |offset: i32| (AT + 4).wrapping_add_signed(offset);
    for (halves, expected) in [
        (&[0xF004, 0xFF73][..], Flow::Call(to(0x4EE6))),
        (&[0xF7FD, 0xFDC9], Flow::Call(to(-0x246E))),
        (&[0xF7FF, 0xBAB7], Flow::Jump(to(-0xA92))),
        (&[0xF000, 0xBECC], Flow::Jump(to(0xD98))),
        (&[0xE7FB], Flow::Jump(to(-0xA))),
        (&[0xE00D], Flow::Jump(to(0x1A))),
        (&[0xD001], Flow::Branch(to(0x2))),
        (&[0xD1F4], Flow::Branch(to(-0x18))),
        (&[0xF47F, 0xAF03], Flow::Branch(to(-0x1FA))),
        (&[0xF200, 0x82BB], Flow::Branch(to(0x576))),
        (&[0xB161], Flow::Branch(to(0x18))),
        // By A7.7.12 and A7.7.18: bits J1 and J2.
        (&[0xF040, 0xA000], Flow::Branch(to(0x4_0000))),
        (&[0xF040, 0x8800], Flow::Branch(to(0x8_0000))),
        (&[0xF000, 0xF000], Flow::Call(to(0x40_0000))),
        (&[0xF000, 0xD800], Flow::Call(to(0x80_0000))),
        (&[0xBB82], Flow::Branch(to(0x60))),
    ] {
        assert_eq!(flow(halves), expected, "{halves:x?}");
    }
}

#[test]
fn register_targets_are_classified() {
    for (halves, expected) in [
        (&[0x4770][..], Flow::Return),           // bx lr
        (&[0x46F7], Flow::Return),               // mov pc, lr
        (&[0xBD80], Flow::Return),               // pop {r7, pc}
        (&[0xE8BD, 0x8FF0], Flow::Return),       // pop.w {r4-r11, pc}
        (&[0xF85D, 0xFB04], Flow::Return),       // ldr pc, [sp], #4
        (&[0x4700], Flow::LastCallRegister),     // bx r0
        (&[0x46B7], Flow::JumpAmong),            // mov pc, r6
        (&[0x44B7], Flow::JumpRegister),         // add pc, r6
        (&[0xF8DF, 0xF010], Flow::JumpRegister), // ldr.w pc, [pc, #16]
        (&[0xF852, 0xF023], Flow::JumpRegister), // ldr.w pc, [r2, r3, lsl #2]
        (&[0xE891, 0x8001], Flow::JumpRegister), // ldm.w r1, {r0, pc}
        (&[0x4788], Flow::CallRegister),         // blx r1
        (&[0x47D0], Flow::CallRegister),         // blx r10
        (&[0xE8DF, 0xF006], Flow::Table { wide: false, register: 15 }),
        (&[0xE8DF, 0xF016], Flow::Table { wide: true, register: 15 }),
        (&[0xE8D1, 0xF006], Flow::Table { wide: false, register: 1 }), // tbb [r1, r6]
        (&[0xDEFE], Flow::Trap),                                       // udf #254
        (&[0xF7F0, 0xA000], Flow::Trap),                               // udf.w #0
        (&[0xF004, 0xE800], Flow::Unknown),                            // blx of an address
        (&[0xDF00], Flow::Exception),                                  // svc #0
        (&[0xDFFF], Flow::Exception),                                  // svc #255
        (&[0xF8DD, 0xB064], Flow::Next),                               // ldr.w r11, [sp, #0x64]
        (&[0xF89D, 0xF010], Flow::Next),                               // pld [sp, #16]
    ] {
        assert_eq!(flow(halves), expected, "{halves:x?}");
    }
}

#[test]
fn stack_depth_follows_push_and_pop() {
    for (halves, bytes) in [
        (&[0xB5F0][..], 20),         // push {r4, r5, r6, r7, lr}
        (&[0xBDF0], -20),            // pop {r4, r5, r6, r7, pc}
        (&[0xB410], 4),              // push {r4}
        (&[0xBC10], -4),             // pop {r4}
        (&[0xE92D, 0x0F00], 16),     // push.w {r8-r11}
        (&[0xE8BD, 0x0F00], -16),    // pop.w {r8-r11}
        (&[0xF84D, 0xBD04], 4),      // str r11, [sp, #-4]!
        (&[0xF85D, 0xBB04], -4),     // ldr r11, [sp], #4
        (&[0xE96D, 0x4502], 8),      // strd r4, r5, [sp, #-8]!
        (&[0xE8FD, 0x4502], -8),     // ldrd r4, r5, [sp], #8
        (&[0xB0A3], 0x8C),           // sub sp, #0x8c
        (&[0xB004], -0x10),          // add sp, #0x10
        (&[0xF5AD, 0x5D9D], 0x13A0), // sub.w sp, sp, #0x13a0
        (&[0xF50D, 0x5D9D], -0x13A0),
        (&[0xF5AD, 0x7D79], 0x3E4),
        (&[0xF6AD, 0x2DB8], 0xAB8),  // subw sp, sp, #0xab8
        (&[0xF20D, 0x5D64], -0x564), // addw sp, sp, #0x564
        // These only read it.
        (&[0xAF03], 0),         // add r7, sp, #0xc
        (&[0x466F], 0),         // mov r7, sp
        (&[0x9010], 0),         // str r0, [sp, #0x40]
        (&[0xF50D, 0x64FF], 0), // add.w r4, sp, #0x7f8
        (&[0xF60D, 0x3448], 0), // addw r4, sp, #0xb48
        (&[0xF8DD, 0xB064], 0), // ldr.w r11, [sp, #0x64]
        (&[0xE9CD, 0x1615], 0), // strd r1, r6, [sp, #84]
        (&[0xF858, 0x0036], 0), // ldr.w r0, [r8, r6, lsl #3]
        (&[0xE8A1, 0x000C], 0), // stm.w r1!, {r2, r3}
    ] {
        assert_eq!(of(halves).stack, Stack::Grows(bytes), "{halves:x?}");
    }
}

#[test]
fn unknown_stack_pointer_is_reported() {
    for halves in [
        &[0x468D][..],     // mov sp, r1
        &[0x44A5],         // add sp, r4
        &[0xF381, 0x8808], // msr msp, r1
        &[0xF381, 0x8809], // msr psp, r1
        &[0xF381, 0x8814], // msr control, r1
        &[0xF1A7, 0x0D18], // sub.w sp, r7, #24
        &[0xEBAD, 0x0D01], // sub.w sp, sp, r1
        &[0xF02D, 0x0D07], // bic sp, sp, #7
        &[0xF8D0, 0xD000], // ldr.w sp, [r0]
    ] {
        assert_eq!(of(halves).stack, Stack::Set, "{halves:x?}");
    }
}

#[test]
fn modified_immediates_match_the_manual() {
    // A5.3.2, table A5-11.
    for (imm12, value) in [
        (0x0AB, 0xAB),
        (0x1AB, 0x00AB_00AB),
        (0x2AB, 0xAB00_AB00),
        (0x3AB, 0xABAB_ABAB),
        (0x400, 0x8000_0000),
        (0xFFF, 0x0000_01FE),
        (0xD9D, 0x13A0),
    ] {
        assert_eq!(expand(imm12), value, "{imm12:#x}");
    }
}

#[test]
fn masks_conditions_and_half_constants_are_decoded() {
    assert_eq!(of(&[0xB672]).mask, Mask::Set, "cpsid i");
    assert_eq!(of(&[0xB662]).mask, Mask::Clear, "cpsie i");
    assert_eq!(of(&[0xB671]).mask, Mask::Same, "cpsid f");
    assert_eq!(of(&[0xF380, 0x8810]).mask, Mask::Clear, "msr primask, r0");
    assert_eq!(of(&[0xF380, 0x8811]).mask, Mask::Same, "msr basepri, r0");
    for (half, count) in [(0xBF28, 1), (0xBFC8, 1), (0xBF9E, 3), (0xBF1F, 4), (0xBF41, 4), (0xBF14, 2)] {
        assert_eq!(of(&[half]).conditional, count, "{half:x}");
    }
    assert_eq!(of(&[0xBF30]).conditional, 0, "wfi");
    let half = |register, upper, value| Some(Half { register, upper, value });
    assert_eq!(of(&[0xF24E, 0x2000]).half, half(0, false, 0xE200));
    assert_eq!(of(&[0xF64D, 0x6183]).half, half(1, false, 0xDE83));
    assert_eq!(of(&[0xF2CE, 0x0000]).half, half(0, true, 0xE000));
    assert!(of(&[0xBF00]).nop && !of(&[0xBF30]).nop);
}

#[test]
fn adr_names_its_register_and_address() {
    for (halves, register, value) in [
        (&[0xA202][..], 2, 0x0800_4138 + 8),        // adr r2, 8
        (&[0xF20F, 0x0210], 2, 0x0800_4138 + 0x10), // adr.w r2, 16
        (&[0xF2AF, 0x0904], 9, 0x0800_4138 - 4),    // adr.w r9, -4
    ] {
        let bytes: Vec<u8> = halves.iter().flat_map(|half: &u16| half.to_le_bytes()).collect();
        for at in [0x0800_4134, 0x0800_4136] {
            let found = decode(at, &bytes).and_then(|found| found.address);
            assert_eq!(found, Some(Address { register, value }), "{halves:x?}");
        }
    }
}
