//! A rotor without power coasts on: what must wait until it stands, and what must not be believed if it does not.

use super::board::Bench;
use servo_core::mode::Mode;
use servo_core::units::{Micros, MilliVolts};
use tater_wire::Property;

fn set(bench: &mut Bench, property: Property, value: i64) {
    bench.set(property, value).expect("taken");
}

/// A homed board on its way at 1000 counts/s.
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

/// Saves until a page must be erased, which it must not be yet.
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
fn no_page_is_erased_before_the_rotor_has_stood_for_a_fifth_of_a_second() {
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
        // Coasts, ever slower.
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
fn a_motion_that_waits_for_the_tick_is_not_held_up_by_a_page() {
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
fn what_is_saved_while_it_coasts_is_not_trusted() {
    for (rests, trusted) in [(0, false), (150, false), (201, true)] {
        let mut bench = moving();
        set(&mut bench, Property::MODE, 0);
        let count = bench.count;
        bench.tick_to(count + 1);
        bench.ticks(rests);
        set(&mut bench, Property::SAVE, -1);
        let said = bench.get(Property::P);
        set(&mut bench, Property::STAT, 0);
        // The monitor runs, and the rotor turns on to where the halls are the same.
        if !trusted {
            bench.count += 6;
        }
        let mut bench = bench.restart();
        assert_eq!(bench.tater.status().homed, trusted, "after {rests} ms");
        assert!(!trusted || bench.get(Property::P) == said);
    }
}

#[test]
fn a_reset_at_a_count_takes_the_trust() {
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
fn a_hall_fault_takes_the_trust_in_the_stored_position_too() {
    let mut bench = moving();
    set(&mut bench, Property::MODE, 0);
    bench.ticks(300);
    set(&mut bench, Property::SAVE, -1);
    bench.settle();
    // The cable falls off; the rotor is turned to where the halls are the same; the cable is back.
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
fn an_edge_whose_interrupt_does_not_come_is_the_second_tick_s() {
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
fn an_edge_that_went_back_before_its_interrupt_does_not_count_as_left() {
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
