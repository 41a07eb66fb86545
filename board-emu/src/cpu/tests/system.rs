//! SysTick, resets, clocks and copies.

use super::*;
use crate::time::NEVER;

const CSR: u32 = 0xE000_E010;
const RVR: u32 = 0xE000_E014;
const CVR: u32 = 0xE000_E018;

fn period(control: u32, reload: u32) -> Time {
    let mut b = Bench::new(&[WFI, 0xE7FD], &[(15, handler(1))]); // and back to WFI
    b.poke(RVR, reload);
    b.poke(CVR, 0);
    b.poke(CSR, control);
    let mut times = Vec::new();
    while times.len() < 4 {
        if b.cpu.is_asleep() {
            b.cpu.chip.now = b.cpu.next_event();
            times.push(b.cpu.next_event());
        } else {
            b.steps(1);
        }
        b.cpu.advance();
    }
    assert_eq!(times[3] - times[2], times[2] - times[1]);
    times[2] - times[1]
}

#[test]
fn systick_period_is_reload_plus_one() {
    let cycle = Chip::new(1, [0; 3]).rcc.core_cycle();
    assert_eq!(period(0b111, 999), 1000 * cycle);
    assert_eq!(period(0b011, 999), 8 * 1000 * cycle, "an eighth of the core's clock");
}

#[test]
fn systick_reads_count_and_countflag() {
    let mut b = Bench::new(&[STAY], &[]);
    let cycle = b.cpu.chip.rcc.core_cycle();
    b.poke(RVR, 100);
    b.poke(CSR, 0b101);
    assert_eq!(b.cpu.next_event(), NEVER, "it does not interrupt");
    b.cpu.chip.now += 10 * cycle;
    assert_eq!(b.peek(CVR), 91, "reloaded by the first cycle");
    b.cpu.chip.now += 91 * cycle;
    assert_eq!(b.peek(CVR), 0);
    assert_eq!([b.peek(CSR), b.peek(CSR)], [0x1_0005, 5], "COUNTFLAG is cleared by reading");
    b.cpu.chip.now += 1010 * cycle;
    assert_eq!(b.peek(CVR), 0, "ten periods");
}

#[test]
fn reset_request_needs_the_key() {
    let mut b = Bench::new(&[STAY], &[]);
    b.poke(0xE000_ED0C, 4);
    assert!(!b.cpu.take_reset_request());
    b.poke(0xE000_ED0C, 0x05FA_0004);
    assert!(b.cpu.take_reset_request());
    assert!(!b.cpu.take_reset_request());
}

#[test]
fn instruction_takes_1_5_cycles_and_stalls_on_busy_flash() {
    let mut b = Bench::new(&[NOP, NOP, NOP, STAY], &[]);
    let (cycle, start) = (b.cpu.chip.rcc.core_cycle(), b.cpu.chip.now);
    b.steps(2);
    assert_eq!(b.cpu.chip.now - start, 3 * cycle);
    b.cpu.chip.flash.busy_until = start + 1000 * cycle;
    b.steps(1);
    assert_eq!(b.cpu.chip.now, start + 1000 * cycle + 3 * cycle / 2);
}

#[test]
fn handlers_use_vtor_and_the_main_stack() {
    // MSR PSP, r0; MOVS r1, #2; MSR CONTROL, r1
    let main = [0xF380, 0x8809, 0x2102, 0xF381, 0x8814, STAY];
    let mut b = Bench::new(&main, &[(16, handler(1)), (17, handler(2))]);
    b.poke(0xE000_ED08, 0x0800_0000);
    b.interrupt(0, 0x10);
    b.cpu.set_register(0, 0x2000_4000);
    b.steps(3);
    assert_eq!(b.cpu.register(13), 0x2000_4000);
    b.lines(&[0]);
    b.steps(1);
    b.lines(&[]);
    assert_eq!((b.cpu.register(13), b.cpu.register(14)), (TOP, 0xFFFF_FFFD));
    assert_eq!(b.word(0x2000_4000 - 8), MAIN + 10);
    b.steps(3);
    assert_eq!((b.cpu.register(13), b.trace()), (0x2000_4000, 1));
}

#[test]
fn copy_continues_like_its_original() {
    let mut b = Bench::new(&[STAY], &[(16, handler(1)), (15, handler(2))]);
    b.interrupt(0, 0x10);
    b.poke(RVR, 40);
    b.poke(CSR, 0b111);
    b.lines(&[0]);
    b.steps(2);
    let mut copy = Bench { cpu: b.cpu.duplicate() };
    for bench in [&mut b, &mut copy] {
        bench.lines(&[]);
        for _ in 0..200 {
            bench.steps(1);
            bench.cpu.advance();
        }
    }
    let state = |b: &Bench| (0..17).map(|i| b.cpu.register(i)).collect::<Vec<u32>>();
    assert_eq!(state(&b), state(&copy));
    assert_eq!(b.cpu.counts.instructions, copy.cpu.counts.instructions);
    assert_eq!(b.cpu.chip.now, copy.cpu.chip.now);
    assert!(b.cpu.counts.handlers[15].runs > 1);
}
