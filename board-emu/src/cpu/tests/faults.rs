//! Faults and the status registers.

use super::*;

const PRECISE: u32 = 0x8200;
const FORCED: u32 = 1 << 30;

/// A core in the handler that took the fault of this instruction.
fn after(main: &[u16], registers: &[(usize, u32)], enabled: u32) -> Bench {
    let mut b = Bench::new(main, &[]);
    b.poke(SHCSR, enabled);
    b.poke(0xE000_ED14, 0x10); // division by 0 is trapped
    registers.iter().for_each(|&(register, value)| b.cpu.set_register(register, value));
    b.steps(1);
    b
}

#[test]
fn load_from_unmapped_address_records_it_in_bfar() {
    let main = [0x6801, STAY]; // LDR r1, [r0]
    let mut b = after(&main, &[(0, 0x3000_0000), (1, 5)], 0);
    assert_eq!((b.exception(), b.peek(CFSR), b.peek(HFSR), b.peek(BFAR)), (3, PRECISE, FORCED, 0x3000_0000));
    assert_eq!(b.word(TOP - 8), MAIN, "it returns to the load");
    assert_eq!(b.cpu.register(1), 5);
    b.cpu.write_private(CFSR + 1, Size::Byte, 0xFF).unwrap();
    assert_eq!(b.peek(CFSR), 0, "written with 1 to clear, by bytes");
    let mut b = after(&main, &[(0, 0x3000_0000)], 1 << 17);
    assert_eq!((b.exception(), b.peek(HFSR)), (5, 0), "enabled, it has its own handler");
}

#[test]
fn fault_below_present_priority_escalates() {
    let mut b = Bench::new(&[CPSID, 0x6801, STAY], &[]);
    b.poke(SHCSR, 1 << 17);
    b.cpu.set_register(0, 0x3000_0000);
    b.steps(2);
    assert_eq!((b.exception(), b.peek(HFSR)), (3, FORCED));
}

/// Name, code, registers before it, exception that takes it, CFSR.
type Wrong<'a> = (&'a str, &'a [u16], &'a [(usize, u32)], u32, u32);

#[test]
fn each_instruction_fault_sets_its_bit() {
    let cases: [Wrong<'_>; 9] = [
        ("UDF", &[0xDE00], &[], 6, 1 << 16),
        ("no such instruction", &[0xFFFF, 0xFFFF], &[], 6, 1 << 19),
        ("a coprocessor", &[0xEE00, 0x0A10], &[], 6, 1 << 19),
        ("UDF.W", &[0xF7F0, 0xA000], &[], 6, 1 << 16),
        ("SDIV by 0", &[0xFB91, 0xF0F2], &[(2, 0)], 6, 1 << 25),
        ("LDM", &[0xC806], &[(0, 0x2000_0002)], 6, 1 << 24),
        ("LDRD", &[0xE9D0, 0x1200], &[(0, 0x2000_0002)], 6, 1 << 24),
        ("LDREX", &[0xE850, 0x1F00], &[(0, 0x2000_0002)], 6, 1 << 24),
        ("a store to locked flash", &[0x6001], &[(0, 0x0800_8000)], 5, PRECISE),
    ];
    for (what, code, registers, exception, status) in cases {
        let mut b = after(code, registers, 7 << 16);
        assert_eq!((b.exception(), b.peek(CFSR)), (exception, status), "{what}");
        assert_eq!(b.word(TOP - 8), MAIN, "{what}");
    }
}

#[test]
fn branch_to_unexecutable_memory_faults_at_target() {
    let cases = [
        ("not Thumb", 0x0800_0300, 6, 1 << 17),
        ("nothing", 0x3000_0001, 5, 1 << 8),
        ("peripherals", 0x4000_0001, 4, 1),
    ];
    for (what, target, exception, status) in cases {
        let mut b = after(&[0x4700], &[(0, target)], 7 << 16); // BX r0
        b.steps(1);
        assert_eq!((b.exception(), b.peek(CFSR)), (exception, status), "{what}");
        assert_eq!(b.word(TOP - 8), target & !1, "{what}");
    }
}

#[test]
fn breakpoint_without_debugger_is_a_hard_fault() {
    let mut b = after(&[0xBE00], &[], 7 << 16);
    assert_eq!((b.exception(), b.peek(HFSR), b.peek(0xE000_ED30)), (3, 1 << 31, 2));
}

#[test]
fn fault_in_hard_fault_locks_up() {
    let mut b = Bench::new(&[0x6801], &[(3, vec![0x6801])]);
    b.cpu.set_register(0, 0x3000_0000);
    b.steps(1);
    assert!(matches!(b.cpu.step(), Err(Problem::Lockup { .. })));
}

#[test]
fn stack_below_ram_is_a_hard_fault() {
    let mut b = Bench::new(&[STAY], &[(16, handler(1))]);
    b.interrupt(0, 0x10);
    b.cpu.set_register(13, 0x2000_0010);
    b.lines(&[0]);
    b.steps(1);
    assert_eq!((b.exception(), b.peek(CFSR), b.peek(HFSR)), (3, 1 << 12, FORCED), "STKERR");
    assert_eq!(b.peek(PEND), 1, "the interrupt waits");
    // PUSH {r0}
    let mut b = after(&[0xB401], &[(13, 0x2000_0000)], 0);
    assert_eq!((b.exception(), b.peek(BFAR)), (3, 0x1FFF_FFFC));
    assert_eq!(b.cpu.lowest_sp(), 0x2000_0000 - 32);
}

#[test]
fn invalid_exception_return_is_a_usage_fault() {
    for code in [0xFFFF_FFF1_u32, 0xFFFF_FFF5, 0xFFFF_0FF9] {
        let mut b = Bench::new(&[STAY], &[(16, vec![0x4700])]); // BX r0
        b.poke(SHCSR, 1 << 18);
        b.interrupt(0, 0x10);
        b.lines(&[0]);
        b.cpu.set_register(0, code);
        b.steps(1);
        assert_eq!((b.exception(), b.peek(CFSR)), (6, 1 << 18), "{code:#x}");
    }
}

#[test]
fn unmodeled_access_ends_the_run_with_address_and_value() {
    let mut b = Bench::new(&[0x6001], &[]); // STR r1, [r0]
    b.cpu.set_register(0, 0xE000_1008);
    b.cpu.set_register(1, 77);
    let problem = b.cpu.step().unwrap_err();
    assert!(
        matches!(problem, Problem::NotModeled { address: 0xE000_1008, value: Some(77), .. }),
        "{problem}"
    );
}
