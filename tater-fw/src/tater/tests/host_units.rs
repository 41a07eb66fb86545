//! HOSTUNITS: values of frames in the units of a BH8-280. The factors: `tater_wire::property::host_units`.

use super::board::{Bench, FakeBoard};
use crate::SetError;
use servo_core::mode::Mode;
use std::vec::Vec;
use tater_wire::property::{Access, ROWS, host_units};
use tater_wire::{Body, Destination, Group, MotorKind, Property, Torques};

fn foreign(straps: u8) -> Bench {
    let mut bench = Bench::new(straps);
    bench.set(Property::HOSTUNITS, 280).expect("a value of it");
    bench
}

#[test]
fn host_units_takes_0_and_280_and_nothing_else() {
    let mut bench = Bench::new(1);
    assert_eq!(bench.get(Property::HOSTUNITS), Some(0), "the default");
    for value in [1, 2, 140, 262, 279, 281, 282, -1, -280] {
        assert_eq!(
            bench.set(Property::HOSTUNITS, value),
            Err(SetError::Range(Property::HOSTUNITS)),
            "{value}"
        );
        assert_eq!(bench.get(Property::HOSTUNITS), Some(0), "{value}");
    }
    for value in [280, 0, 280] {
        bench.set(Property::HOSTUNITS, value).expect("a value of it");
        assert_eq!(bench.get(Property::HOSTUNITS), Some(value));
    }
}

/// What is stored is in the board's units, whatever they were when it was saved.
#[test]
fn host_units_are_stored_and_the_values_keep_their_meaning() {
    let mut bench = foreign(1);
    bench.set(Property::CT, 195_000).expect("in range");
    bench.set(Property::SAVE, -1).expect("saves");
    bench.settle();
    let mut bench = bench.restart();
    assert_eq!((bench.get(Property::HOSTUNITS), bench.get(Property::CTS)), (Some(280), Some(4096)));
    // 336 hall counts, the nearest of 335.9.
    assert_eq!(bench.get(Property::CT), Some(195_048));
    bench.set(Property::HOSTUNITS, 0).expect("a value of it");
    assert_eq!((bench.get(Property::CT), bench.get(Property::CTS)), (Some(336), Some(18)));
    bench.set(Property::DEF, 127).expect("forgets");
    bench.settle();
    let mut bench = bench.restart();
    assert_eq!((bench.get(Property::HOSTUNITS), bench.get(Property::CT)), (Some(0), Some(336)));
}

/// Every property, by the board's value and the table.
#[test]
fn every_answer_is_the_tables() {
    for straps in [1, 4, 5] {
        let mut bench = foreign(straps);
        let kind = MotorKind::of(bench.tater.node());
        for row in ROWS.iter().filter(|row| row.access != Access::WriteOnly) {
            let ours = bench.tater.property(row.property).expect("can be read");
            assert_eq!(
                bench.get(row.property),
                Some(host_units::to_host(row.property, kind, ours)),
                "{}",
                row.name
            );
        }
        for row in ROWS.iter().filter(|row| row.access == Access::WriteOnly) {
            assert_eq!(bench.get(row.property), Some(0), "{}", row.name);
        }
    }
}

#[test]
fn orders_and_measurements_are_in_foreign_units() {
    let mut bench = foreign(1);
    // What the present position is called: 1 rad.
    bench.set(Property::P, 81_487).expect("in idle");
    bench.tick();
    assert_eq!(bench.tater.status().position.round(), 140);
    assert_eq!(bench.get(Property::P), Some(81_270), "140 of 140.4 counts");
    bench.set(Property::E, 40_744).expect("in range");
    assert_eq!(bench.tater.property(Property::E), Some(70));
    // 0.5 rad/s of libbarrett.
    bench.set(Property::V, 40).expect("in range");
    bench.set(Property::MODE, 4).expect("a mode");
    bench.tick();
    assert_eq!((bench.tater.property(Property::VSET), bench.get(Property::VSET)), (Some(69), Some(40)));
    bench.set(Property::MODE, 0).expect("a mode");
    // 0.5 N m of libbarrett: 80 of its units, 16 of these.
    bench.set(Property::MODE, 2).expect("a mode");
    bench.set(Property::T, 80).expect("in range");
    bench.tick();
    assert_eq!((bench.tater.property(Property::T), bench.get(Property::T)), (Some(16), Some(80)));
}

#[test]
fn packed_torques_are_in_foreign_units_and_saturate_at_mt() {
    let hand = Destination::Group(Group::new(5).expect("a group"));
    for straps in 11..=14 {
        let mut bench = foreign(straps);
        bench.set(Property::MT, 1000).expect("in range");
        bench.set(Property::MODE, 2).expect("a mode");
        let kind = MotorKind::of(bench.tater.node());
        let most = host_units::to_board(Property::MT, kind, 1000);
        for torque in [80, -80, 400, -8191, 8191] {
            let packed = Torques::new(&[torque; 4]).expect("four");
            bench.say(hand, 0, Body::Torques(packed)).expect("heard");
            bench.tick();
            let ours = host_units::to_board(Property::T, kind, torque.into()).clamp(-most, most);
            assert_eq!(bench.tater.property(Property::T), Some(ours), "{torque} to node {straps}");
        }
    }
}

#[test]
fn value_out_of_range_after_translation_is_refused() {
    let mut bench = foreign(1);
    let before = (bench.get(Property::MT), bench.get(Property::E));
    assert_eq!(bench.set(Property::MT, 22_200), Err(SetError::Range(Property::MT)));
    assert_eq!(bench.set(Property::E, 1 << 25), Err(SetError::Range(Property::E)));
    assert_eq!(bench.set(Property::CTS, 4096), Err(SetError::Access(Property::CTS)));
    assert_eq!((bench.get(Property::MT), bench.get(Property::E)), before);
}

#[test]
fn another_nodes_get_is_answered_in_foreign_units() {
    let mut bench = foreign(1);
    bench.say(bench.own(), 6, Body::Get(Property::CT.id())).expect("answered");
    let values: Vec<Body> = bench.said().iter().map(|message| message.body).collect();
    let ct = host_units::to_host(Property::CT, MotorKind::Link, 331);
    let value = Property::CT.write(ct).expect("fits");
    assert_eq!(values, [Body::Set { property: tater_wire::message::VALUE, value }]);
}

/// The spread's IC is in degrees of its joint, not in its counts.
#[test]
fn steps_are_as_long_as_asked() {
    let mut bench = Bench::on(FakeBoard::new(4), 0);
    bench.set(Property::HOSTUNITS, 280).expect("a value of it");
    bench.set(Property::DS, 2000).expect("in range");
    bench.set(Property::CMD, 14).expect("IC");
    assert_eq!((bench.tater.property(Property::E), bench.tater.status().mode), (Some(9), Mode::Trapezoidal));
}

/// libbarrett waits for mode 0 where HOLD is 0; a host of this project's units sees mode 3 (decision 0069).
#[test]
fn mode_5_ends_as_hold_says_in_foreign_units_only() {
    for (host_units, hold, mode) in [(280, 0, 0), (280, 1, 3), (0, 0, 3), (0, 1, 3)] {
        let mut bench = Bench::new(1);
        bench.set(Property::HOSTUNITS, host_units).expect("a value of it");
        bench.set(Property::HOLD, hold).expect("in range");
        bench.set(Property::E, if host_units == 0 { 10 } else { 5805 }).expect("in range");
        bench.set(Property::MODE, 5).expect("a mode");
        bench.follow(2000);
        assert_eq!(
            (bench.get(Property::MODE), bench.get(Property::END)),
            (Some(mode), Some(1)),
            "{host_units} {hold}"
        );
    }
}

/// A goal beyond the joint is refused in the host's units too, and so is MODE 5 until a good one.
#[test]
fn mode_5_after_a_refused_goal_is_refused_in_foreign_units() {
    let mut bench = foreign(1);
    bench.set(Property::E, 40_000).expect("within the joint");
    let beyond = 250_000;
    assert_eq!(bench.set(Property::E, beyond), Err(SetError::Range(Property::E)));
    assert!(bench.set(Property::MODE, 5).is_err());
    assert_eq!((bench.get(Property::MODE), bench.get(Property::END)), (Some(0), Some(3)));
    bench.set(Property::E, 40_000).expect("within the joint");
    bench.set(Property::MODE, 5).expect("a mode");
    assert_eq!(bench.get(Property::MODE), Some(5));
}
