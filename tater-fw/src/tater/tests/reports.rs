//! Unasked reports, and answers that find no room.

use super::board::Bench;
use crate::SetError;
use crate::events::{BoardEvent, Entry};
use crate::tater::OUTBOX;
use servo_core::guard::fault::Fault;
use servo_core::mode::Mode;
use servo_core::{EndReason, Event};
use std::vec::Vec;
use tater_wire::{Body, Property};

fn said(bench: &mut Bench) -> Vec<(Property, i64)> {
    let words = bench.said().into_iter().map(|message| match message.body {
        Body::Set { property, value } => {
            let property = Property::of(property).expect("a property");
            (property, property.read(value))
        }
        body => panic!("{body:?}"),
    });
    words.collect()
}

#[test]
fn reports_are_sent_only_if_lflags_is_set() {
    let end = [(Property::MODE, 0), (Property::END, 5)];
    let both = [(Property::BD, 1), (Property::MODE, 0), (Property::END, 5)];
    let rows: [(i64, &[(Property, i64)]); 4] = [(0, &[]), (1, &end), (2, &both[..1]), (3, &both)];
    for (flags, expected) in rows {
        let mut bench = Bench::new(2);
        bench.set(Property::LFLAGS, flags).expect("in range");
        // A link that meets an object.
        bench.set(Property::M, 300).expect("moves");
        bench.ticks(300);
        assert_eq!(said(&mut bench), expected, "LFLAGS {flags}");
        assert_eq!(bench.get(Property::LFLAGS), Some(flags));
    }
}

#[test]
fn tick_signals_a_report_and_no_frame_overtakes_it() {
    let blocked = |flags| {
        let mut bench = Bench::new(2);
        bench.set(Property::LFLAGS, flags).expect("in range");
        bench.set(Property::P, 7).expect("in idle");
        bench.set(Property::M, 300).expect("moves");
        let reported = (0..300).any(|_| bench.tick_alone());
        assert!(reported && bench.said().is_empty(), "a tick says nothing itself");
        bench
    };
    let mut bench = blocked(3);
    assert!(bench.tick_alone(), "until it is told");
    bench.tater.flush();
    assert_eq!(said(&mut bench), [(Property::BD, 1), (Property::MODE, 0), (Property::END, 5)]);
    assert!(!bench.tick_alone());
    let mut bench = blocked(0);
    assert_eq!(bench.get(Property::BP), Some(7), "0 without a breakaway");
}

#[test]
fn reported_mode_is_the_one_after_the_end() {
    let mut bench = Bench::new(4);
    bench.set(Property::LFLAGS, 1).expect("in range");
    bench.set(Property::M, 20).expect("moves");
    bench.follow(3_000);
    // The spread's HOLD is 1.
    assert_eq!(said(&mut bench), [(Property::MODE, 3), (Property::END, 1)]);
    bench.set(Property::M, 0).expect("moves");
    bench.ticks(40);
    bench.set(Property::MODE, 0).expect("idle");
    assert_eq!(said(&mut bench), [(Property::MODE, 0), (Property::END, 3)], "in the same call");
}

fn recorded(bench: &mut Bench) -> Vec<BoardEvent> {
    std::iter::from_fn(|| bench.tater.next_event()).map(|entry| entry.event).collect()
}

#[test]
fn event_ring_records_orders_modes_refusals_and_ends() {
    let mut bench = Bench::new(4);
    let (m, t) = (Property::M, Property::CMD);
    for _ in 0..2 {
        bench.set(m, 50).expect("moves");
        bench.set(t, 21).expect("T");
    }
    let order = |property, value| BoardEvent::Order { property, value };
    let aborted = BoardEvent::Motor(Event::Ended { reason: EndReason::Aborted, mode: Mode::Idle });
    let once = [
        order(m, 50),
        BoardEvent::Mode(Mode::Trapezoidal),
        order(t, 21),
        aborted,
        BoardEvent::Mode(Mode::Idle),
    ];
    assert_eq!(recorded(&mut bench), [once, once].concat());
    let error = SetError::Range(Property::MT);
    assert_eq!(bench.set(Property::MT, 5000), Err(error));
    let refused = BoardEvent::Refused { property: Some(Property::MT.id()), error };
    assert_eq!(recorded(&mut bench), [refused]);
    let at = bench.tater.events().map(|entry| entry.at.0).collect::<Vec<_>>();
    assert!(at.len() == 11 && at.is_sorted(), "{at:?}");
}

#[test]
fn event_ring_has_the_tick_of_a_fault_and_no_streamed_torque() {
    let mut bench = Bench::new(4);
    bench.set(Property::MODE, 2).expect("idle");
    recorded(&mut bench);
    for torque in 0..100 {
        bench.set(Property::T, torque).expect("mode 2");
    }
    assert_eq!(recorded(&mut bench), []);
    bench.tater.bridge_fault();
    bench.ticks(1);
    let at = bench.now();
    bench.ticks(3);
    let entries: Vec<Entry> = std::iter::from_fn(|| bench.tater.next_event()).collect();
    let fault = BoardEvent::Motor(Event::Fault(Fault::Bridge));
    assert!(entries.iter().any(|entry| entry.event == fault && entry.at == at), "{at:?} {entries:?}");
}

fn end_and_mode(bench: &mut Bench) -> (Option<i64>, Option<i64>, Vec<(Property, i64)>) {
    let reports = said(bench);
    (bench.get(Property::END), bench.get(Property::MODE), reports)
}

#[test]
fn motion_refused_for_a_fault_sets_end_6_at_once() {
    let cmds = [7, 13, 14, 15, 16, 17, 18, 19, 20].map(|number| (Property::CMD, number));
    for (property, value) in [(Property::M, 40), (Property::MODE, 5)].into_iter().chain(cmds) {
        let mut bench = Bench::new(1);
        bench.set(Property::LFLAGS, 1).expect("in range");
        bench.tater.bridge_fault();
        bench.ticks(1);
        assert_eq!(bench.get(Property::END), Some(0), "no motion has ended");
        said(&mut bench);
        bench.set(property, value).expect_err("a fault is latched");
        let reports = [(Property::MODE, 0), (Property::END, 6)].to_vec();
        assert_eq!(end_and_mode(&mut bench), (Some(6), Some(0), reports), "{property:?} {value}");
        assert_eq!(bench.get(Property::ERROR), Some(6));
        bench.set(Property::STAT, 2).expect("clears it");
        assert_eq!(bench.get(Property::END), Some(6));
        bench.set(Property::M, 300).expect("moves");
        bench.ticks(3);
        assert_eq!((bench.get(Property::END), bench.get(Property::MODE)), (Some(0), Some(5)));
    }
}

#[test]
fn homing_that_cannot_find_a_stop_sets_end_3_at_once() {
    let mut bench = Bench::new(1);
    bench.set(Property::LFLAGS, 1).expect("in range");
    bench.set(Property::IVEL, 0).expect("in range");
    bench.set(Property::CMD, 13).expect_err("no velocity");
    let reports = [(Property::MODE, 0), (Property::END, 3)].to_vec();
    assert_eq!(end_and_mode(&mut bench), (Some(3), Some(0), reports));
    assert_eq!(bench.get(Property::ERROR), Some(0));
}

#[test]
fn refusal_leaves_end_to_a_motion_under_way_and_to_streamed_torque() {
    let mut bench = Bench::new(1);
    bench.set(Property::IVEL, 0).expect("in range");
    bench.set(Property::M, 300).expect("moves");
    bench.ticks(10);
    bench.set(Property::CMD, 13).expect_err("no velocity");
    assert_eq!((bench.get(Property::END), bench.get(Property::MODE)), (Some(0), Some(5)));
    bench.tater.bridge_fault();
    bench.ticks(1);
    assert_eq!(bench.get(Property::END), Some(6), "the motion's end");
    let mut bench = Bench::new(1);
    bench.tater.bridge_fault();
    bench.ticks(1);
    bench.set(Property::T, 100).expect_err("a fault is latched");
    assert_eq!(bench.get(Property::END), Some(0));
}

#[test]
fn answers_wait_for_room_in_order() {
    let mut bench = Bench::new(3);
    bench.board().room = 0;
    let own = bench.own();
    let asked: Vec<Property> =
        [Property::MT, Property::KP, Property::X0].into_iter().cycle().take(OUTBOX).collect();
    for property in &asked {
        assert_eq!(bench.say(own, 0, Body::Get(property.id())), Ok(()));
    }
    assert_eq!(bench.say(own, 0, Body::Get(Property::TSTOP.id())), Err(SetError::Busy(Property::TSTOP)));
    assert_eq!((bench.tater.unsent(), bench.said().len()), (1, 0));
    // Room for three; then for all.
    bench.board().room = 3;
    bench.tater.flush();
    assert_eq!(said(&mut bench), [(Property::MT, 750), (Property::KP, 120), (Property::X0, 0)]);
    bench.board().room = usize::MAX;
    bench.tater.flush();
    let rest: Vec<Property> = said(&mut bench).into_iter().map(|(property, _)| property).collect();
    assert_eq!(rest, asked[3..]);
    assert_eq!(bench.get(Property::TSTOP), Some(300), "asked again");
}
