//! What is said unasked, and what happens to answers that find no room.

use super::board::Bench;
use crate::tater::{OUTBOX, SetError};
use servo_core::{EndReason, Event};
use std::vec::Vec;
use tater_wire::{Body, Property};

/// What was said to the host: numbers of properties and values.
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
fn nothing_is_said_unasked_unless_lflags_says_so() {
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
fn a_tick_says_that_there_is_a_report_and_no_frame_overtakes_it() {
    // A link that meets an object, as above.
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
fn the_mode_reported_is_the_one_that_follows_the_end() {
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

#[test]
fn events_are_kept_for_an_observer_the_oldest_go_first() {
    let mut bench = Bench::new(4);
    for _ in 0..6 {
        bench.set(Property::M, 50).expect("moves");
        bench.set(Property::CMD, 21).expect("T");
    }
    let ends: Vec<_> = std::iter::from_fn(|| bench.tater.event()).collect();
    assert_eq!(ends.len(), 6);
    assert!(ends.iter().all(|event| matches!(event, Event::Ended { reason: EndReason::Aborted, .. })));
}

#[test]
fn answers_wait_for_room_in_order_and_none_is_lost_silently() {
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
    assert_eq!(said(&mut bench), [(Property::MT, 750), (Property::KP, 60), (Property::X0, 0)]);
    bench.board().room = usize::MAX;
    bench.tater.flush();
    let rest: Vec<Property> = said(&mut bench).into_iter().map(|(property, _)| property).collect();
    assert_eq!(rest, asked[3..]);
    assert_eq!(bench.get(Property::TSTOP), Some(300), "asked again");
}
