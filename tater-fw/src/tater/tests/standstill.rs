//! A rotor without power coasts on: actions that must wait for standstill, and positions that must not be
//! trusted before it.

use super::board::Bench;
use servo_core::mode::Mode;
use servo_core::units::{Micros, MilliVolts};
use tater_wire::Property;

fn set(bench: &mut Bench, property: Property, value: i64) {
    bench.set(property, value).expect("taken");
}

/// A homed board moving at 1000 counts/s.
fn moving() -> Bench {
    let mut bench = Bench::new(1);
    bench.home();
    bench.settle();
    set(&mut bench, Property::M, 300);
    bench.ticks(50);
    for _ in 0..30 {
        let count = bench.count;
        bench.tick_to(count + 1);
    }
    assert_eq!(bench.tater.status().mode, Mode::Trapezoidal);
    bench
}

fn fill(bench: &mut Bench) {
    for round in 1..=60 {
        for property in [Property::X0, Property::X1, Property::X2, Property::X3, Property::X4, Property::X5] {
            set(bench, property, round);
        }
        set(bench, Property::SAVE, -1);
        for _ in 0..200 {
            bench.tater.store();
        }
    }
}

#[test]
fn page_erase_waits_for_200_ms_of_standstill() {
    let stops: [fn(&mut Bench); 3] = [
        |bench| set(bench, Property::MODE, 0),
        |bench| set(bench, Property::CMD, 21),
        |bench| bench.board().analog.bus = MilliVolts(40_000),
    ];
    for stop in stops {
        let mut bench = moving();
        fill(&mut bench);
        stop(&mut bench);
        let before = bench.board().flash.erases;
        for wait in (0..198).chain([198; 3]) {
            let count = bench.count;
            bench.tick_to(count + 1);
            for _ in 0..wait {
                bench.tater.store();
                bench.tick();
            }
        }
        assert_eq!(bench.tater.drive().duty, None);
        assert_eq!(bench.board().flash.erases, before);
        bench.ticks(2);
        bench.settle();
        assert!(bench.board().flash.erases > before);
    }
}

#[test]
fn motion_waiting_for_the_tick_is_not_delayed_by_an_erase() {
    let mut bench = moving();
    fill(&mut bench);
    set(&mut bench, Property::MODE, 0);
    bench.ticks(300);
    set(&mut bench, Property::MODE, 3);
    let before = bench.board().flash.erases;
    for _ in 0..10 {
        bench.tater.store();
    }
    assert_eq!(bench.board().flash.erases, before);
}

#[test]
fn position_saved_while_coasting_is_not_trusted() {
    for (rests, trusted) in [(0, false), (150, false), (201, true)] {
        let mut bench = moving();
        set(&mut bench, Property::MODE, 0);
        let count = bench.count;
        bench.tick_to(count + 1);
        bench.ticks(rests);
        set(&mut bench, Property::SAVE, -1);
        let said = bench.get(Property::P);
        set(&mut bench, Property::STAT, 0);
        // The monitor runs, and the rotor coasts to a position with the same hall code.
        if !trusted {
            bench.count += 6;
        }
        let mut bench = bench.restart();
        assert_eq!(bench.tater.status().homed, trusted, "after {rests} ms");
        assert!(!trusted || bench.get(Property::P) == said);
    }
}

#[test]
fn reset_during_a_count_ends_the_trust() {
    for counts in [false, true] {
        let mut bench = moving();
        set(&mut bench, Property::MODE, 0);
        bench.ticks(300);
        set(&mut bench, Property::SAVE, -1);
        bench.settle();
        if counts {
            // No tick has seen it yet.
            let next = bench.count + 1;
            bench.board().turn_to(next);
            let now = bench.now.wrapping_add(Micros(200));
            bench.tater.hall(now);
            bench.count += 6;
        }
        set(&mut bench, Property::STAT, 0);
        assert_eq!(bench.restart().tater.status().homed, !counts);
    }
}

#[test]
fn hall_fault_ends_the_trust_in_the_stored_position() {
    let mut bench = moving();
    set(&mut bench, Property::MODE, 0);
    bench.ticks(300);
    set(&mut bench, Property::SAVE, -1);
    bench.settle();
    // The cable comes off; the rotor is turned to a position with the same hall code; the cable is back.
    bench.board().halls = 7;
    bench.ticks(20);
    bench.count += 6;
    let count = bench.count;
    bench.board().turn_to(count);
    bench.ticks(20);
    assert!(!bench.tater.status().homed);
    assert!(!bench.restart().tater.status().homed);
}

#[test]
fn edge_without_interrupt_is_taken_by_the_second_tick() {
    let mut bench = Bench::new(1);
    bench.ticks(20);
    let count = bench.tater.status().position.round();
    bench.board().turn_to(1);
    bench.tick_alone();
    assert_eq!(bench.tater.status().position.round(), count, "left to the interrupt");
    bench.tick_alone();
    assert_eq!(bench.tater.status().position.round(), count + 1);
}

#[test]
fn edge_reversed_before_its_interrupt_is_not_pending() {
    let mut bench = Bench::new(1);
    bench.ticks(20);
    let count = bench.tater.status().position.round();
    for to in [1, 0, 1] {
        bench.board().turn_to(to);
        bench.tick_alone();
        assert_eq!(bench.tater.status().position.round(), count, "the line at {to}");
    }
    bench.tick_alone();
    assert_eq!(bench.tater.status().position.round(), count + 1);
}

/// 71.6 min later the clock is back at the time of the last edge.
#[test]
fn reversal_when_the_clock_has_wrapped_is_a_motion() {
    for late_us in [20, 99, 300] {
        let mut bench = Bench::new(1);
        bench.tick_to(1);
        let edge_at = bench.now.wrapping_add(Micros(1000_u32.wrapping_neg()));
        for minutes in 1..=71 {
            bench.now = edge_at.wrapping_add(Micros(minutes * 60_000_000));
            bench.ticks(1);
            let now = bench.now;
            bench.tater.housekeeping(now);
        }
        // `tick_to` has its edge 100 µs after the last tick.
        bench.now = edge_at.wrapping_add(Micros(late_us)).wrapping_add(Micros(100_u32.wrapping_neg()));
        bench.tick_to(0);
        assert!(bench.tater.status().velocity.round() < 0, "{late_us} µs");
    }
}
