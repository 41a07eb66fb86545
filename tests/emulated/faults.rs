//! Faults at the pins of a board with a turning motor: bridge off, brake engaged, cause reported.

use board_emu::bridge;
use board_emu::chip::Reset;
use tater_wire::{FaultCode, Property};

use super::bench::{Bench, production};

fn code(fault: FaultCode) -> Option<i64> {
    Some(i64::from(fault.code()))
}

/// A stuck line must be detected within 18 counts, one of the rotor's 9 turns, at 50 counts/s.
const STUCK_US: u64 = 400_000;

#[test]
fn stuck_or_open_hall_line_ends_the_motion() {
    let Some(programs) = production() else { return };
    for (line, level) in (0..3).flat_map(|line| [(line, false), (line, true)]) {
        let mut bench = Bench::moving(&programs);
        bench.board_mut().stick_hall(line, Some(level));
        let after_us = bench.safe_after_us(STUCK_US);
        let what = if level { "high or open" } else { "low" };
        let after_us = after_us.unwrap_or_else(|| panic!("line {line} {what}: still driven"));
        assert_eq!(bench.get(Property::ERROR), code(FaultCode::Halls), "line {line} {what}");
        assert_eq!(bench.get(Property::STAT), Some(2), "recoverable");
        println!("figure: hall line {line} {what}: bridge off after {:.1} ms", after_us as f64 / 1000.0);
    }
}

#[test]
fn spikes_shorter_than_the_filter_have_no_effect() {
    let Some(programs) = production() else { return };
    for phase in 0..SPIKE_PHASES {
        let mut bench = Bench::moving(&programs);
        bench.wait_us(phase * 200 / SPIKE_PHASES);
        spike(&mut bench);
        assert_eq!(bench.get(Property::ERROR), Some(0), "phase {phase}");
        assert_eq!(bench.get(Property::P), Some(160), "phase {phase}: arrived");
        let counts = bench.board().rig().truth().counts;
        assert!((counts - 160.0).abs() <= 1.0, "phase {phase}: where it says that it is");
    }
}

/// Starts of the spikes within their interval.
const SPIKE_PHASES: u64 = 10;

fn spike(bench: &mut Bench) {
    for i in 0..4000 {
        // Each line in turn, high and low, 8 us of 200; the filter needs 14.
        let now = bench.board().rig().halls() >> (i % 3) & 1 == 1;
        bench.board_mut().stick_hall(i % 3, Some(!now));
        bench.wait_us(8);
        bench.board_mut().stick_hall(i % 3, None);
        bench.wait_us(192);
        // Five spikes are a tick; each 32 ms they shift, so that every phase of the tick is hit.
        if i % 160 == 0 {
            bench.wait_us(8);
        }
    }
    bench.wait_ms(300);
}

#[test]
fn glitches_lose_no_count_or_end_the_motion() {
    let Some(programs) = production() else { return };
    for line in 0..3 {
        let mut bench = Bench::moving(&programs);
        for _ in 0..20 {
            let now = bench.board().rig().halls() >> line & 1 == 1;
            bench.board_mut().stick_hall(line, Some(!now));
            bench.wait_us(40);
            bench.board_mut().stick_hall(line, None);
            bench.wait_ms(10);
        }
        bench.wait_ms(1000);
        match bench.get(Property::ERROR) {
            Some(0) => {
                let (says, is) =
                    (bench.get(Property::P).expect("answers"), bench.board().rig().truth().counts);
                assert!((is - says as f64).abs() <= 1.0, "line {line}: says {says}, is {is}");
            }
            error => {
                assert_eq!(error, code(FaultCode::Halls), "line {line}");
                assert!(bench.is_safe(), "line {line}");
            }
        }
    }
}

#[test]
fn cut_bus_cable_stops_the_board() {
    let Some(programs) = production() else { return };
    let mut bench = Bench::awake(&programs);
    bench.set(Property::MODE, 4);
    bench.set(Property::V, 100);
    bench.wait_ms(200);
    assert!(bench.is_driven(), "mode 4 drives");
    bench.bus.cut(0, true);
    let after_us = bench
        .safe_after_us(2_200_000)
        .expect("HOSTMS, 2 s, without a frame in modes 2 and 4 (decision 0013)");
    bench.bus.cut(0, false);
    assert_eq!(bench.get(Property::ERROR), code(FaultCode::HostLost));
    println!("figure: cable cut in mode 4: bridge off after {:.1} ms", after_us as f64 / 1000.0);
}

#[test]
fn crystal_failure_switches_off_and_is_reported_later() {
    let Some(programs) = production() else { return };
    let mut bench = Bench::moving(&programs);
    let before = bench.resets();
    {
        let chip = bench.board_mut().machine_mut().chip_mut();
        let now = chip.now;
        chip.rcc.set_crystal(false, now);
        chip.touched = true;
    }
    let after_us = bench.safe_after_us(1000).expect("the clock security system trips the break");
    // It cannot start: the watchdog resets it again and again, with pins in reset state.
    for _ in 0..200 {
        bench.wait_ms(10);
        assert!(bench.is_safe());
    }
    let resets = bench.resets() - before;
    assert!(resets >= 3, "{resets} resets in 2 s");
    {
        let chip = bench.board_mut().machine_mut().chip_mut();
        let now = chip.now;
        chip.rcc.set_crystal(true, now);
        chip.touched = true;
    }
    bench.wait_ms(1500);
    assert_eq!(bench.get(Property::STAT), Some(0), "in the monitor");
    let error = bench.get(Property::ERROR);
    assert!(error == code(FaultCode::Clock) || error == code(FaultCode::Watchdog), "{error:?}");
    println!(
        "figure: crystal dead: bridge off after {after_us} us; {resets} resets in 2 s; ERROR {error:?} after"
    );
}

#[test]
fn brown_out_leaves_the_bridge_off_without_a_fault() {
    let Some(programs) = production() else { return };
    let mut bench = Bench::moving(&programs);
    // A sag below the threshold that RAM survives, and a loss of the supply.
    for lost in [false, true] {
        if lost {
            bench.board_mut().power_off();
            assert!(bench.is_safe());
            bench.wait_ms(20);
            bench.board_mut().power_on();
        } else {
            bench.board_mut().reset(Reset::Power);
        }
        assert!(bench.is_safe(), "pins as reset leaves them");
        bench.wait_ms(100);
        assert_eq!(bench.get(Property::STAT), Some(0), "in the monitor");
        assert_eq!(bench.get(Property::ERROR), Some(0), "a loss of the supply is no fault of the board's");
        bench.wake();
        assert!(bench.is_safe());
    }
}

#[test]
fn break_input_switches_off_without_an_instruction() {
    let Some(programs) = production() else { return };
    let mut bench = Bench::moving(&programs);
    for _ in 0..50 {
        let mut board = bench.board().duplicate();
        let before = board.machine().cpu.counts.instructions;
        let now = board.machine().now();
        board.machine_mut().chip_mut().set_pin((1, 12), Some(false));
        let chip = board.machine().chip();
        assert_eq!(bridge::of(chip), Ok(hil_world::rig::Bridge::Off), "at {now}");
        assert_eq!(board.machine().cpu.counts.instructions, before, "no instruction");
        bench.wait_us(51);
    }
    // It stays off after the comparator releases, 20 us later, until the host has cleared the fault.
    bench.board_mut().machine_mut().chip_mut().set_pin((1, 12), Some(false));
    bench.wait_us(20);
    bench.board_mut().machine_mut().chip_mut().set_pin((1, 12), None);
    bench.set(Property::M, 20);
    for _ in 0..1000 {
        assert!(!bench.is_driven());
        bench.wait_us(100);
    }
    assert_eq!(bench.get(Property::ERROR), code(FaultCode::Bridge));
    bench.set(Property::STAT, 2);
    bench.wait_ms(10);
    assert_eq!(bench.get(Property::ERROR), Some(0), "cleared");
    assert!(!bench.is_driven(), "cleared, and not told to move");
    let from = bench.board().rig().truth().counts;
    bench.set(Property::M, 20);
    bench.wait_ms(300);
    assert!((bench.board().rig().truth().counts - from).abs() > 5.0, "it moves again");
}
