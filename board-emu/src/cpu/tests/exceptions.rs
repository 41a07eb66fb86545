//! Priorities, entry and return.

use super::*;

fn slow(first: u16, last: u16) -> Vec<u16> {
    [trace(first).as_slice(), &[NOP; 4], &trace(last), &[BX_LR]].concat()
}

/// Trace of interrupt 1 arriving in the handler of interrupt 0.
fn second_arrives(first: u8, second: u8, group: u32) -> u32 {
    let mut b = Bench::new(&[STAY], &[(16, slow(1, 2)), (17, handler(3))]);
    b.poke(0xE000_ED0C, 0x05FA_0000 | group << 8);
    b.interrupt(0, first);
    b.interrupt(1, second);
    b.steps(2);
    b.lines(&[0]);
    b.steps(3);
    b.lines(&[1]);
    b.steps(1);
    b.lines(&[]);
    b.steps(20);
    assert_eq!((b.exception(), b.cpu.pc(), b.cpu.register(13)), (0, MAIN, TOP));
    b.trace()
}

#[test]
fn only_a_more_urgent_interrupt_preempts() {
    assert_eq!(second_arrives(0x80, 0x40, 0), 0x132, "more urgent");
    assert_eq!(second_arrives(0x80, 0x80, 0), 0x123, "as urgent");
    assert_eq!(second_arrives(0x80, 0xC0, 0), 0x123, "less urgent");
    assert_eq!(second_arrives(0x80, 0x8F, 0), 0x123, "four bits only");
    // With PRIGROUP 5 the upper two bits make the group: 0x80 and 0xB0 are equal.
    assert_eq!(second_arrives(0xB0, 0x80, 5), 0x123, "sub-priority");
    assert_eq!(second_arrives(0xB0, 0x40, 5), 0x132, "another group");
}

#[test]
fn pending_exceptions_run_by_priority_then_number() {
    let mut b = Bench::new(&[STAY], &[(16, handler(1)), (17, handler(2)), (50, handler(3))]);
    for (position, priority) in [(0, 0x40), (1, 0x30), (34, 0x30)] {
        b.interrupt(position, priority);
    }
    b.lines(&[0, 1, 34]);
    b.lines(&[]);
    b.steps(9);
    assert_eq!(b.trace(), 0x231);
    // Tail-chaining: three handlers, one frame.
    assert_eq!(b.cpu.lowest_sp(), TOP - 32);
}

#[test]
fn basepri_masks_equal_and_lower_priorities() {
    // MOVS r0, #0x80; MSR BASEPRI, r0
    let mut b = Bench::new(&[0x2080, 0xF380, 0x8811, STAY], &[(16, handler(1)), (17, handler(2))]);
    b.interrupt(0, 0x80);
    b.interrupt(1, 0x70);
    b.steps(2);
    b.lines(&[0]);
    b.steps(4);
    assert_eq!(b.trace(), 0);
    b.lines(&[0, 1]);
    b.lines(&[]);
    b.steps(4);
    assert_eq!(b.trace(), 2);
    assert_eq!(b.cpu.read_special(17), 0x80);
    // BASEPRI_MAX only raises: 0x90 and 0 are ignored.
    for (value, left) in [(0x90, 0x80), (0x20, 0x20), (0, 0x80)] {
        let mut c = Bench::new(&[0x2080, 0xF380, 0x8811, 0x2000 | value, 0xF380, 0x8812, STAY], &[]);
        c.steps(4);
        assert_eq!(c.cpu.read_special(17), left);
    }
}

#[test]
fn wfi_wakes_with_primask_set_without_entry() {
    let mut b = Bench::new(&[CPSID, WFI, 0x3501, CPSIE, NOP, STAY], &[(16, handler(7))]);
    b.interrupt(0, 0x10);
    b.steps(2);
    assert!(b.cpu.is_asleep());
    b.lines(&[5]);
    assert!(b.cpu.is_asleep(), "5 is not enabled");
    b.lines(&[0]);
    assert!(!b.cpu.is_asleep());
    b.lines(&[]);
    b.steps(2);
    assert_eq!(b.trace(), 1, "ADDS after WFI, no handler");
    b.steps(3);
    assert_eq!(b.trace(), 0x17);
}

#[test]
fn wfe_consumes_an_earlier_event() {
    let mut b = Bench::new(&[0xBF40, 0xBF20, 0xBF20, NOP], &[]); // SEV, WFE, WFE
    b.steps(2);
    assert!(!b.cpu.is_asleep());
    b.steps(1);
    assert!(b.cpu.is_asleep());
}

#[test]
fn line_pends_at_its_edge_and_while_high() {
    let run = |after_entry: &[&[u32]]| {
        let mut b = Bench::new(&[STAY], &[(16, handler(1))]);
        b.interrupt(0, 0x10);
        b.lines(&[0]);
        b.steps(1);
        for lines in after_entry {
            b.lines(lines);
        }
        b.steps(3);
        b.lines(&[]);
        b.steps(12);
        b.trace()
    };
    assert_eq!(run(&[&[]]), 1, "cleared in the handler");
    assert_eq!(run(&[&[], &[0], &[]]), 0x11, "a pulse while its handler runs");
    assert_eq!(run(&[]), 0x11, "still high at the return");
    // A pending interrupt outlasts its line.
    let mut b = Bench::new(&[CPSID, NOP, CPSIE, STAY], &[(16, handler(1))]);
    b.interrupt(0, 0x10);
    b.steps(1);
    b.lines(&[0]);
    b.lines(&[]);
    b.steps(8);
    assert_eq!(b.trace(), 1);
}

#[test]
fn software_pends_and_unpends() {
    let mut b = Bench::new(&[CPSID, STAY], &[(20, handler(4))]);
    b.interrupt(4, 0x10);
    b.steps(1);
    b.poke(PEND, 1 << 4);
    assert_eq!(b.peek(PEND), 1 << 4);
    assert_eq!(b.peek(0xE000_ED04) >> 12 & 0x1FF, 20, "VECTPENDING");
    b.poke(UNPEND, 1 << 4);
    assert_eq!(b.peek(PEND), 0);
    b.lines(&[4]);
    b.poke(UNPEND, 1 << 4);
    assert_eq!(b.peek(PEND), 1 << 4, "its line is high");
    b.poke(0xE000_EF00, 6);
    assert_eq!(b.peek(PEND), 1 << 4 | 1 << 6, "STIR");
}

#[test]
fn entry_stores_eight_words_and_aligns_by_stkalign() {
    // MOVS r0, #11; PUSH {r0}: four bytes off alignment.
    for (stkalign, frame) in [(0, TOP - 4 - 32), (1 << 9, TOP - 8 - 32)] {
        let mut b = Bench::new(&[0x200B, 0xB401, STAY], &[(16, handler(1))]);
        b.poke(0xE000_ED14, stkalign);
        b.interrupt(0, 0x10);
        b.steps(2);
        for (register, value) in [(1, 0x11), (2, 0x22), (3, 0x33), (12, 0xCC), (14, 0xEE)] {
            b.cpu.set_register(register, value);
        }
        b.lines(&[0]);
        b.steps(1);
        b.lines(&[]);
        assert_eq!((b.cpu.register(13), b.cpu.register(14), b.exception()), (frame, 0xFFFF_FFF9, 16));
        let stored: Vec<u32> = (0..7).map(|i| b.word(frame + 4 * i)).collect();
        assert_eq!(stored, [11, 0x11, 0x22, 0x33, 0xCC, 0xEE, MAIN + 4]);
        assert_eq!(b.word(frame + 28) >> 9 & 1, u32::from(stkalign != 0), "bit 9 of the stored xPSR");
        [0, 1, 2, 3, 12].iter().for_each(|&register| b.cpu.set_register(register, 0));
        b.steps(2);
        assert_eq!((b.cpu.register(13), b.cpu.pc(), b.exception()), (TOP - 4, MAIN + 4, 0));
        assert_eq!([0, 1, 2, 3, 12, 14].map(|i| b.cpu.register(i)), [11, 0x11, 0x22, 0x33, 0xCC, 0xEE]);
    }
}

#[test]
fn exception_clears_the_exclusive_monitor() {
    // LDREX r1, [r0]; NOP; STREX r2, r1, [r0]
    let main = [0xE850, 0x1F00, NOP, 0xE840, 0x1200, STAY];
    for (interrupted, failed) in [(false, 0), (true, 1)] {
        let mut b = Bench::new(&main, &[(16, handler(1))]);
        b.interrupt(0, 0x10);
        b.cpu.set_register(0, 0x2000_4000);
        b.steps(1);
        b.lines(if interrupted { &[0] } else { &[] });
        b.steps(1);
        b.lines(&[]);
        b.steps(6);
        assert_eq!(b.cpu.register(2), failed);
    }
}

#[test]
fn it_state_survives_an_interrupt() {
    // CMP r0, r0; ITE EQ; ADDEQ r1, #1; ADDNE r1, #2
    let mut b = Bench::new(&[0x4280, 0xBF0C, 0x3101, 0x3102, STAY], &[(16, handler(1))]);
    b.interrupt(0, 0x10);
    b.cpu.set_register(1, 0);
    b.steps(2);
    b.lines(&[0]);
    b.steps(1);
    b.lines(&[]);
    b.steps(6);
    assert_eq!((b.trace(), b.cpu.register(1)), (1, 1));
}

#[test]
fn svc_is_immediate_and_pendsv_is_last() {
    let mut b = Bench::new(&[0xDF00, 0x3501, STAY], &[(11, handler(2)), (14, handler(3))]);
    b.poke(0xE000_ED20, 0x00F0_0000); // PendSV is the least urgent
    b.steps(1);
    assert_eq!(b.exception(), 11);
    assert_eq!(b.word(TOP - 8), MAIN + 2, "SVC returns to what follows it");
    b.poke(0xE000_ED04, 1 << 28);
    b.steps(3);
    assert_eq!((b.exception(), b.trace()), (11 + 3, 2), "chained");
    b.steps(4);
    assert_eq!(b.trace(), 0x24, "2, 3 and then the 1 of ADDS");
}

#[test]
fn nmi_cannot_be_masked() {
    let mut b = Bench::new(&[CPSID, 0xB671, STAY], &[(2, handler(9))]); // CPSID i, CPSID f
    b.steps(3);
    b.cpu.set_lines(0, true);
    b.cpu.set_lines(0, false);
    b.steps(3);
    assert_eq!(b.trace(), 9);
    assert_eq!(b.cpu.read_special(19), 1, "an NMI leaves FAULTMASK set");
}

#[test]
fn instructions_count_for_the_handler_that_executes_them() {
    let mut b = Bench::new(&[STAY], &[(16, slow(1, 2)), (17, handler(3))]);
    b.interrupt(0, 0x80);
    b.interrupt(1, 0x40);
    b.steps(5);
    b.lines(&[0]);
    b.steps(3);
    b.lines(&[1]);
    b.steps(1);
    b.lines(&[]);
    b.steps(20);
    let counts = &b.cpu.counts;
    let whole = |at: usize, n| counts::Handler { runs: 1, total: n, max: n, ..counts.handlers[at] };
    assert_eq!(counts.handlers[16], whole(16, 2 * counts::ENTRY + 9), "what preempts it does not count");
    assert_eq!(counts.handlers[17], whole(17, 2 * counts::ENTRY + 3));
    assert_eq!(
        counts.handlers[0].total + counts.handlers[16].total + counts.handlers[17].total,
        counts.instructions
    );
    assert!(counts.running.is_empty());
}
