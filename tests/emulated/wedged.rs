//! Modified instructions: a task that hangs, an undefined instruction.

use board_emu::chip::Reset;
use board_emu::time::US;
use tater_f103::map::{APPLICATION, FLASH};
use tater_wire::{FaultCode, Property};

use super::bench::{Bench, production};

/// `b .`
const WEDGE: u16 = 0xE7FE;
/// `udf #0`
const UNDEFINED: u16 = 0xDE00;

/// Exception numbers.
const TASKS: [(&str, u32); 6] = [
    ("hall", 16 + 30),
    ("tick", 16 + 29),
    ("receive", 16 + 20),
    ("sent", 16 + 19),
    ("housekeeping", 15),
    ("idle", 0),
];

fn patch(bench: &mut Bench, address: u32, code: u16) {
    bench.board_mut().machine_mut().chip_mut().flash.load(address & !1, &code.to_le_bytes());
}

/// Start of an exception's handler; for 0, the place where the program waits.
fn handler(bench: &mut Bench, exception: u32) -> u32 {
    if exception == 0 {
        let idle = (0..10_000).any(|_| {
            bench.wait_us(10);
            bench.board().machine().is_waiting()
        });
        assert!(idle, "it never waits");
        return bench.board().machine().cpu.pc();
    }
    let at = (APPLICATION.start - FLASH.start + 4 * exception) as usize;
    let chip = bench.board().machine().chip();
    let bytes = chip.flash.bytes[at..at + 4].try_into().expect("four");
    u32::from_le_bytes(bytes) & !1
}

#[test]
fn watchdog_resets_a_board_with_a_wedged_task() {
    let Some(programs) = production() else { return };
    for (name, exception) in TASKS {
        let mut bench = Bench::moving(&programs);
        let address = handler(&mut bench, exception);
        let resets = bench.resets();
        let begin = bench.board().machine().now();
        patch(&mut bench, address, WEDGE);
        // Triggers the tasks that only the bus calls.
        bench.set(Property::M, 20);
        bench.ask(Property::MODE);
        while bench.resets() == resets {
            bench.wait_ms(1);
            assert!(bench.board().machine().now() - begin < 1_500_000 * US, "{name}: no reset");
        }
        let after_ms = (bench.board().machine().now() - begin) / US / 1000;
        assert!(bench.is_safe(), "{name}");
        bench.wait_ms(100);
        assert_eq!(bench.get(Property::STAT), Some(0), "{name}: in the monitor");
        assert_eq!(bench.get(Property::ERROR), Some(i64::from(FaultCode::Watchdog.code())), "{name}");
        println!("figure: task {name} wedged: reset after {after_ms} ms, ERROR 24");
    }
}

/// `cpsid i`
const MASK: u16 = 0xB672;

/// Longest time from what stops the tick until the bridge is off, us.
const TICK_STOPPED_US: u64 = 60_000;

#[test]
fn bridge_is_off_within_sixty_ms_of_what_stops_the_tick() {
    let Some(programs) = production() else { return };
    let cases: [(&str, u32, &[u16]); 3] = [
        ("the tick hangs", 16 + 29, &[WEDGE]),
        ("the hall task, above the tick, hangs", 16 + 30, &[WEDGE]),
        ("interrupts stay masked", 0, &[MASK, WEDGE]),
    ];
    for (name, exception, codes) in cases {
        let mut bench = Bench::moving(&programs);
        let address = handler(&mut bench, exception) & !1;
        let resets = bench.resets();
        for (at, &code) in (address..).step_by(2).zip(codes) {
            patch(&mut bench, at, code);
        }
        let wedge = address + 2 * (codes.len() as u32 - 1);
        let wedged = (0..REACHED_US / 10).any(|_| {
            bench.wait_us(10);
            bench.board().machine().cpu.pc() & !1 == wedge
        });
        assert!(wedged && bench.is_driven(), "{name}: not reached");
        let after_us = bench.safe_after_us(2 * TICK_STOPPED_US).unwrap_or(u64::MAX);
        println!("figure: {name}: bridge off after {after_us} us");
        assert!(after_us <= TICK_STOPPED_US, "{name}: bridge off after {after_us} us");
        bench.wait_ms(150);
        let causes: Vec<_> =
            bench.board().machine().resets[resets..].iter().map(|&(cause, _)| cause).collect();
        assert_eq!(causes, [Reset::WindowWatchdog], "{name}");
        assert!(bench.is_safe(), "{name}");
        assert_eq!(bench.get(Property::STAT), Some(0), "{name}: in the monitor");
        assert_eq!(bench.get(Property::ERROR), Some(i64::from(FaultCode::Watchdog.code())), "{name}");
    }
}

/// A period of the slowest task, housekeeping's 100 ms, and a tick; edges come more often.
const REACHED_US: u64 = 101_000;

#[test]
fn undefined_instruction_switches_off_and_keeps_the_reason() {
    let Some(programs) = production() else { return };
    for (name, exception) in TASKS.into_iter().filter(|&(_, exception)| exception != 0) {
        let mut bench = Bench::moving(&programs);
        let address = handler(&mut bench, exception);
        patch(&mut bench, address, UNDEFINED);
        bench.set(Property::M, 20);
        bench.ask(Property::MODE);
        let resets = bench.resets();
        let after_us = bench.safe_after_us(REACHED_US);
        let after_us = after_us.unwrap_or_else(|| panic!("{name}: driven {REACHED_US} us after"));
        println!("figure: task {name} at no instruction: bridge off after {after_us} us");
        bench.wait_ms(150);
        let causes: Vec<_> =
            bench.board().machine().resets[resets..].iter().map(|&(cause, _)| cause).collect();
        assert_eq!(causes, [Reset::Software], "{name}: the handler's own, before any watchdog");
        assert!(bench.is_safe(), "{name}");
        assert_eq!(bench.get(Property::STAT), Some(0), "{name}: in the monitor");
        assert_eq!(bench.get(Property::ERROR), Some(i64::from(FaultCode::HardFault.code())), "{name}");
    }
}

#[test]
fn undefined_instruction_in_the_monitor_keeps_the_reason() {
    let Some(programs) = production() else { return };
    let mut bench = Bench::in_monitor(&programs);
    let resets = bench.resets();
    // The monitor never sleeps: use its next instruction.
    let address = bench.board().machine().cpu.pc();
    let was = half_word(&bench, address);
    patch(&mut bench, address, UNDEFINED);
    bench.wait_ms(1);
    patch(&mut bench, address, was);
    bench.wait_ms(100);
    assert_eq!(bench.resets(), resets + 1);
    assert_eq!(bench.get(Property::ERROR), Some(i64::from(FaultCode::HardFault.code())));
}

fn half_word(bench: &Bench, address: u32) -> u16 {
    let at = (address - FLASH.start) as usize;
    let chip = bench.board().machine().chip();
    u16::from_le_bytes(chip.flash.bytes[at..at + 2].try_into().expect("two"))
}
